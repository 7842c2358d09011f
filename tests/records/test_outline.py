"""What a list shows of a journal; the journals are written here line by line, as docs/records.md has them."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest

from tests.seals import sealed
from vcfbench.records.journal import read_journal
from vcfbench.records.outline import outline_of
from vcfbench.records.schema import Status

if TYPE_CHECKING:
    from pathlib import Path

HEADER = {"type": "header", "format": 3, "procedure": "turntable", "bench": {"name": "paper"}, "seed": 7}
FOOTER = {"type": "footer", "status": "complete", "points": 1}
POINT = {"step": 1, "rate_deg_s": 5.0, "v_vc_v": 0.0, "output_v": -0.5, "std_v": 0.0, "n": 2}


def step(number: int, **values: Any) -> dict[str, Any]:
    return {"type": "step", "n": number, "step_kind": "X", "t_s": float(number), "end_s": number + 0.5, **values}


def chunk(number: int) -> dict[str, Any]:
    return {"type": "readings", "n": 2, "chunk": number, "readings": [{"t_s": 2.1, "voltage_v": -0.5}]}


WHOLE = [HEADER, step(1), chunk(1), chunk(2), step(2, point=POINT, chunks=2), step(3), FOOTER]


def written(path: Path, lines: list[dict[str, Any]], tail: str = "") -> Path:
    journal = path / "journal.jsonl"
    journal.write_bytes(sealed("".join(f"{json.dumps(line)}\n" for line in lines).encode()) + tail.encode())
    return journal


def test_a_whole_journal_says_what_a_list_shows(tmp_path: Path) -> None:
    outline = outline_of(written(tmp_path, WHOLE))
    assert outline is not None
    assert (outline.procedure, outline.bench, outline.seed) == ("turntable", "paper", 7)
    assert (outline.status, outline.points) == (Status.COMPLETE, 1)


def test_a_changed_journal_is_left_to_the_full_reading(tmp_path: Path) -> None:
    journal = written(tmp_path, WHOLE)
    journal.write_bytes(journal.read_bytes().replace(b"turntable", b"Turntable"))
    assert outline_of(journal) is None
    assert read_journal(journal).status is Status.DAMAGED


def test_one_without_seals_is_left_to_the_full_reading(tmp_path: Path) -> None:
    journal = tmp_path / "journal.jsonl"
    journal.write_text("".join(f"{json.dumps(line)}\n" for line in WHOLE), encoding="utf-8")
    assert outline_of(journal) is None
    assert read_journal(journal).status is Status.DAMAGED


@pytest.mark.parametrize(
    "lines",
    [
        [],
        WHOLE[1:],
        WHOLE[:-1],
        [{**HEADER, "format": 99}, *WHOLE[1:]],
        [*WHOLE[:-1], {**FOOTER, "status": "grand"}],
    ],
)
def test_any_other_is_left_to_the_full_reading(tmp_path: Path, lines: list[dict[str, Any]]) -> None:
    assert outline_of(written(tmp_path, lines)) is None


@pytest.mark.parametrize("tail", ["{", "[1]\n", "\n\x00\n"])
def test_nor_is_one_with_another_tail(tmp_path: Path, tail: str) -> None:
    assert outline_of(written(tmp_path, WHOLE, tail)) is None


def test_outline_has_status_of_full_reading(tmp_path: Path) -> None:
    """Every cut of a journal as it was written: no list says of it what its record does not."""
    whole = written(tmp_path, WHOLE).read_bytes().splitlines(keepends=True)
    for first in range(7):
        for last in range(first, 8):
            journal = tmp_path / "journal.jsonl"
            journal.write_bytes(b"".join([*whole[:first], *whole[last:]]))
            if (outline := outline_of(journal)) is not None:
                record = read_journal(journal)
                assert (outline.status, outline.points) == (record.status, len(record.points))
