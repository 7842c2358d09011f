"""Every byte of a sealed journal, and lines forged, doubled, taken away or put elsewhere."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tests.records.test_journal import write
from tests.seals import sealed
from vcfbench.errors import ConfigError
from vcfbench.records import journal as journal_module
from vcfbench.records.journal import append_line, read_journal
from vcfbench.records.schema import Status
from vcfbench.records.seal import Sealer

if TYPE_CHECKING:
    from pathlib import Path

NOT_THERE = "was changed: its seal differs"


def damage_of(path: Path, data: bytes) -> str | None:
    path.write_bytes(data)
    try:
        return read_journal(path).damage
    except ConfigError as error:
        return str(error)


@pytest.mark.parametrize("killed", [False, True])
def test_no_byte_of_a_sealed_journal_changes_unseen(tmp_path: Path, *, killed: bool) -> None:
    """In a record that was killed too, the last line and its end included."""
    data = write(tmp_path / "j", points=1)
    data = data[: data.rindex(b"\n", 0, -1) + 1] if killed else data
    for place in (*range(0, len(data), 11), *range(len(data) - 5, len(data))):
        changed = data[:place] + bytes([data[place] ^ 1 << place % 8]) + data[place + 1 :]
        assert damage_of(tmp_path / "j", changed), (place, data[place : place + 20])


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (lambda lines: [*lines[:3], *lines[4:]], 4),
        (lambda lines: [*lines[:3], lines[2], *lines[3:]], 4),
        (lambda lines: [*lines[:3], lines[4], lines[3], *lines[5:]], 4),
        (lambda lines: [*lines[:3], sealed(b'{"type":"step","n":3}\n'), *lines[4:]], 4),
        (lambda lines: lines[1:], 1),
    ],
)
def test_the_first_line_that_is_another_is_named(change: object, line: int, tmp_path: Path) -> None:
    lines = write(tmp_path / "j").splitlines(keepends=True)
    assert callable(change)
    assert damage_of(tmp_path / "j", b"".join(change(lines))) == f"line {line} {NOT_THERE}"


@pytest.mark.parametrize("end", [b"[", b"[\n", b"[" * 3000, None])
def test_of_two_damages_the_first_is_named(end: bytes | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also before a last line that is sealed over the first, and whose end is another."""
    monkeypatch.setattr(journal_module, "_LONGEST_LINE", 1000)
    header, line, *_ = write(tmp_path / "j").splitlines(keepends=True)
    forged = header + line[:-4] + b'-"}\n'
    sealed_over = Sealer(forged).sealed(b'{"type":"note"}')[:-1] + b" "
    assert damage_of(tmp_path / "j", forged + (sealed_over if end is None else end)) == f"line 2 {NOT_THERE}"


def test_a_line_is_added_where_the_first_is_not_whole(tmp_path: Path) -> None:
    (tmp_path / "j").write_bytes(b'{"type":"hea')
    append_line(tmp_path / "j", {"type": "watchdog", "safe": True})
    (line,) = (tmp_path / "j").read_bytes().splitlines()
    assert line.startswith(b'{"type":"watchdog","safe":true,')


def test_a_line_that_is_added_later_is_sealed(tmp_path: Path) -> None:
    path = tmp_path / "j"
    data = write(path)
    path.write_bytes(data[: data.rindex(b"\n", 0, -1) + 20])  # torn in the footer
    append_line(path, {"type": "watchdog", "safe": True})
    record = read_journal(path)
    assert (record.damage, record.status, record.lines[-1]["type"]) == (None, Status.INCOMPLETE, "watchdog")


@pytest.mark.parametrize("number", [1, 2])
def test_records_of_formats_without_seals_are_refused(number: int, tmp_path: Path) -> None:
    path = tmp_path / "j"
    path.write_text(f'{{"type":"header","format":{number}}}\n{{"type":"footer","status":"aborted","points":0}}\n')
    with pytest.raises(ConfigError, match=f"a record of format {number}; this version reads format 3"):
        read_journal(path)
