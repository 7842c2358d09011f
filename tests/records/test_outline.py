"""What a list shows of a journal; the journals are written here line by line, as docs/records.md has them."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any
from zlib import crc32

import pytest

from vcfbench.records.journal import read_journal
from vcfbench.records.outline import Mark, outline_of
from vcfbench.records.schema import Status

if TYPE_CHECKING:
    from pathlib import Path

HEADER = {"type": "header", "format": 2, "procedure": "turntable", "bench": {"name": "paper"}, "seed": 7}
FOOTER = {"type": "footer", "status": "complete", "points": 1}
POINT = {"step": 1, "rate_deg_s": 5.0, "v_vc_v": 0.0, "output_v": -0.5, "std_v": 0.0, "n": 2}


def step(number: int, **values: Any) -> dict[str, Any]:
    return {"type": "step", "n": number, "step_kind": "X", "t_s": float(number), "end_s": number + 0.5, **values}


def chunk(number: int) -> dict[str, Any]:
    return {"type": "readings", "n": 2, "chunk": number, "readings": [{"t_s": 2.1, "voltage_v": -0.5}]}


WHOLE = [HEADER, step(1), chunk(1), chunk(2), step(2, point=POINT, chunks=2), step(3), FOOTER]


def written(path: Path, lines: list[dict[str, Any]], tail: str = "\n") -> Path:
    journal = path / "journal.jsonl"
    journal.write_text("\n".join(map(json.dumps, lines)) + tail, encoding="utf-8")
    return journal


def test_a_whole_journal_says_what_a_list_shows(tmp_path: Path) -> None:
    outline = outline_of(written(tmp_path, WHOLE))
    assert outline is not None
    assert (outline.procedure, outline.bench, outline.seed) == ("turntable", "paper", 7)
    assert (outline.status, outline.marks) == (Status.COMPLETE, (Mark(5.0, 0.0, -0.5),))


def test_lines_that_the_footer_vouches_for_are_not_read(tmp_path: Path) -> None:
    """A journal as it was written has a list's answer in its first and last line; a changed one is read in full."""
    journal = written(tmp_path, WHOLE)
    *before, _ = journal.read_bytes().splitlines(keepends=True)
    data = b"".join(before)
    footer = json.dumps({**FOOTER, "crc32": crc32(data)}).encode() + b"\n"
    journal.write_bytes(data + footer)
    outline = outline_of(journal)
    assert outline is not None
    assert (outline.points, outline.marks, outline.status) == (1, None, Status.COMPLETE)
    journal.write_bytes(data.replace(b"turntable", b"Turntable") + footer)
    assert outline_of(journal) is None
    assert read_journal(journal).status is Status.DAMAGED


@pytest.mark.parametrize(
    "lines",
    [
        [],
        WHOLE[1:],
        WHOLE[:-1],
        [HEADER, *WHOLE],
        [*WHOLE, FOOTER],
        [HEADER, *WHOLE[2:]],
        [HEADER, *WHOLE[4:]],
        [*WHOLE[:3], *WHOLE[4:]],
        [*WHOLE[:4], step(2, chunks=2), *WHOLE[5:]],
        [HEADER, step(1, end_s=9.0), *WHOLE[2:]],
        [HEADER, step(1, t_s=0.7, end_s=0.2), *WHOLE[2:]],
        [HEADER, step(1, n="1"), *WHOLE[2:]],
        [{**HEADER, "format": 99}, *WHOLE[1:]],
        [*WHOLE[:-1], {**FOOTER, "status": "grand"}],
    ],
)
def test_any_other_is_left_to_the_full_reading(tmp_path: Path, lines: list[dict[str, Any]]) -> None:
    assert outline_of(written(tmp_path, lines)) is None


@pytest.mark.parametrize("tail", ["", "\n{", "\n[1]\n", "\n\n\x00\n"])
def test_nor_is_one_with_another_tail(tmp_path: Path, tail: str) -> None:
    assert outline_of(written(tmp_path, WHOLE, tail)) is None


def test_what_has_an_outline_is_called_the_same_by_the_full_reading(tmp_path: Path) -> None:
    """Every cut and every doubled or missing line of a journal: no list says of it what its record does not."""
    tried = [[*WHOLE[:first], *WHOLE[last:]] for first in range(7) for last in range(first + 1, 8)]
    tried += [[*WHOLE[:first], *WHOLE[last:]] for first in range(8) for last in range(first + 1)]
    for lines in tried:
        journal = written(tmp_path, lines)
        outline = outline_of(journal)
        if outline is not None:
            record = read_journal(journal)
            assert (outline.status, len(outline.marks)) == (record.status, len(record.points))
