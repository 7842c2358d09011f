from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import threading
from typing import TYPE_CHECKING, Any, cast

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.seals import sealed
from vcfbench.clock import sleep
from vcfbench.errors import BenchError, ConfigError
from vcfbench.files import try_lock
from vcfbench.records import journal as journal_module
from vcfbench.records.journal import (
    Journal,
    MemoryJournal,
    SimulatedJournal,
    append_line,
    being_written,
    lines_of,
    read_header,
    read_journal,
)
from vcfbench.records.outline import outline_of
from vcfbench.records.schema import Point, Status

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench.records.signing import SigningKey

POINT = Point(3, 200.0, 0.0, -2.5536, 1e-4, 10)


def write(path: Path, points: int = 5, status: str = "complete") -> bytes:
    journal = Journal(path)
    journal.header({"run": "r", "procedure": "turntable"})
    for number in range(1, points + 1):
        journal.write("step", {"n": number, "point": POINT.as_json()})
    journal.footer({"status": status})
    journal.close()
    return path.read_bytes()


def test_a_whole_journal_is_read_back(tmp_path: Path) -> None:
    write(tmp_path / "j")
    record = read_journal(tmp_path / "j")
    assert record.status is Status.COMPLETE
    assert record.points == (POINT,) * 5
    assert record.header["procedure"] == "turntable"


def test_every_line_is_json_and_carries_the_time_of_day(tmp_path: Path) -> None:
    lines = write(tmp_path / "j").decode().splitlines()
    assert [json.loads(line)["type"] for line in lines] == ["header", *["step"] * 5, "footer"]
    assert all(json.loads(line)["utc"].endswith("+00:00") for line in lines)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return write(tmp_path_factory.mktemp("journal") / "j")


@settings(max_examples=60)
@given(cut=st.floats(0.0, 1.0, exclude_max=True))
def test_cut_journal_keeps_whole_lines_and_is_incomplete(
    whole: bytes, tmp_path_factory: pytest.TempPathFactory, cut: float
) -> None:
    kept = whole[: int(cut * len(whole))]
    path = tmp_path_factory.getbasetemp() / "cut.jsonl"
    path.write_bytes(kept)
    record = read_journal(path)
    assert record.status is Status.INCOMPLETE
    whole_steps = kept[: kept.rfind(b"\n") + 1].count(b'"point"')
    assert record.points == (POINT,) * whole_steps


@settings(max_examples=25)
@given(data=st.binary(max_size=200))
def test_noise_is_an_empty_record_that_is_never_complete(data: bytes, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.getbasetemp() / "noise.jsonl"
    path.write_bytes(data)
    record = read_journal(path)
    assert record.status in {Status.INCOMPLETE, Status.DAMAGED}
    assert record.points == ()


def test_what_comes_after_a_torn_line_proves_nothing(tmp_path: Path) -> None:
    lines = write(tmp_path / "j").splitlines(keepends=True)
    (tmp_path / "torn").write_bytes(b"".join([*lines[:3], lines[3][:20] + b"\n", *lines[4:]]))
    record = read_journal(tmp_path / "torn")
    assert record.status is Status.DAMAGED
    assert record.damage == "line 4 is no JSON object"
    assert len(record.points) == 2


def test_a_line_nested_deeper_than_any_is_none(tmp_path: Path) -> None:
    deep = b'{"a":' + b"[" * 100_000 + b"]" * 100_000 + b"}\n"
    (tmp_path / "j").write_bytes(write(tmp_path / "whole").splitlines(keepends=True)[0] + deep)
    assert read_journal(tmp_path / "j").damage == "line 2 is no JSON object"


def test_a_line_without_end_is_not_read_to_its_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(journal_module, "_LONGEST_LINE", 200)
    (tmp_path / "j").write_bytes(write(tmp_path / "whole").splitlines(keepends=True)[0] + b"[" * 1000)
    assert read_journal(tmp_path / "j").damage == "line 2 has more than 200 bytes"


def test_an_existing_journal_is_never_opened_for_writing(tmp_path: Path) -> None:
    data = write(tmp_path / "j")
    with pytest.raises(BenchError, match="cannot be written: File exists"):
        Journal(tmp_path / "j")
    assert (tmp_path / "j").read_bytes() == data


def test_a_later_format_is_refused(tmp_path: Path) -> None:
    (tmp_path / "j").write_text('{"type":"header","format":99}\n')
    with pytest.raises(ConfigError, match="format 99"):
        read_journal(tmp_path / "j")


HEADER = '{"type":"header","format":3,"procedure":"turntable","bench":{"name":"b"}}\n'


@pytest.mark.parametrize(
    "text",
    [
        HEADER + '{"type":"footer"}\n',
        HEADER + '{"type":"footer","status":"splendid"}\n',
        HEADER + '{"type":"step","point":{}}\n{"type":"footer","status":"complete"}\n',
        HEADER + '{"type":"step","point":3}\n{"type":"footer","status":"complete"}\n',
        '{"type":"header","format":3,"bench":3}\n',
        '{"type":"header","format":3,"bench":[]}\n',
        HEADER + '{"type":"footer","status":"aborted","error":"in words alone"}\n',
        HEADER + '{"type":"footer","status":"aborted","error":[]}\n',
        HEADER + '{"type":"step","n":1,"step_kind":"Acquire","point":POINT,"result":[]}\n',
        HEADER + '{"type":"step","n":1,"point":BIG}\n{"type":"footer","status":"complete"}\n',
    ],
)
def test_what_no_journal_wrote_is_one_sentence(text: str, tmp_path: Path) -> None:
    point = json.dumps(POINT.as_json())
    text = text.replace("POINT", point).replace("BIG", point.replace("200.0", "1e308"))
    (tmp_path / "j").write_bytes(sealed(text.encode()))
    with pytest.raises(ConfigError, match="no record of this program"):
        read_journal(tmp_path / "j")


def test_a_missing_journal_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="there is no such file"):
        read_journal(tmp_path / "none")


def test_one_write_and_one_sync_a_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    journal = Journal(tmp_path / "j")
    writes: list[bytes] = []
    synced: list[int] = []
    real_write = os.write

    def count(descriptor: int, data: bytes) -> int:
        writes.append(data)
        return real_write(descriptor, data)

    monkeypatch.setattr(os, "write", count)
    monkeypatch.setattr(journal_module, "_sync", synced.append)
    journal.write("step", {"n": 1})
    journal.write("step", {"n": 2})
    assert [data.count(b"\n") for data in writes] == [1, 1]
    assert len(synced) == 2
    journal.close()


def test_a_simulated_run_is_synchronised_at_its_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its lines are in the file at once all the same: who kills the program loses none."""
    synced: list[int] = []
    monkeypatch.setattr(journal_module, "_sync", synced.append)
    journal = SimulatedJournal(tmp_path / "j")
    journal.write("step", {"n": 1})
    assert [line["n"] for line in journal.lines()] == [1]
    assert not synced
    journal.footer({})
    assert len(synced) == 1
    journal.close()


def test_a_full_disk_is_an_error_of_the_bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    journal = Journal(tmp_path / "j")

    def full(*_: Any) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "write", full)
    with pytest.raises(BenchError, match="No space left on device; free space on its disk, then "):
        journal.write("step", {"n": 1})
    journal.close()


def test_line_ends_of_another_system_are_no_damage(tmp_path: Path) -> None:
    data = write(tmp_path / "j")
    (tmp_path / "j").write_bytes(data.replace(b"\n", b"\r\n"))
    assert read_journal(tmp_path / "j").status is Status.COMPLETE


@pytest.mark.parametrize("trouble", ["write", "half a line", "sync"])
def test_a_line_that_failed_leaves_nothing_behind(
    trouble: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The disk is full for a moment: the next line must not be joined to what it took of this one."""
    path, write = tmp_path / "j", os.write
    journal = Journal(path)
    journal.header({"procedure": "turntable", "bench": {"name": "paper"}})

    def fail(*_: Any) -> int:
        raise OSError(28, "No space left on device")

    def half(descriptor: int, data: bytes) -> int:
        return write(descriptor, data[: len(data) // 2])

    with monkeypatch.context() as full:
        if trouble == "sync":
            full.setattr("vcfbench.records.journal._sync", fail)
        else:
            full.setattr(os, "write", half if trouble == "half a line" else fail)
        with pytest.raises(BenchError, match="cannot be written"):
            journal.write("step", {"n": 1, "t_s": 0.0, "end_s": 1.0, "point": POINT.as_json()})
    journal.write("error", {"n": 1, "t_s": 1.0, "error": "it cannot be written"})
    journal.footer({"status": "aborted", "points": 0})
    journal.close()
    record = read_journal(path)
    assert (record.damage, record.status, len(record.errors)) == (None, Status.ABORTED, 1)
    outline = outline_of(path)
    assert outline is not None  # its sum holds


CHILD = """
import sys
from pathlib import Path
from vcfbench.records.journal import Journal
from vcfbench.records.schema import Point
journal = Journal(Path(sys.argv[1]))
journal.header({"procedure": "turntable"})
for number in range(1_000_000):
    journal.write("step", {"n": number + 1, "point": Point(3, float(number), 0.0, 0.0, 0.0, 10).as_json()})
    print(number, flush=True)
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="the system has no SIGKILL")
def test_a_killed_process_loses_no_point(tmp_path: Path) -> None:
    path = tmp_path / "j"
    with subprocess.Popen([sys.executable, "-c", CHILD, str(path)], stdout=subprocess.PIPE, text=True) as child:  # noqa: S603
        assert child.stdout is not None
        printed = [int(child.stdout.readline()) for _ in range(50)]
        child.kill()
        printed += [int(line) for line in child.stdout.read().splitlines()]
    record = read_journal(path)
    assert len(record.points) >= len(printed)
    assert [point.rate_deg_s for point in record.points] == list(range(len(record.points)))
    assert record.status is Status.INCOMPLETE


def test_line_is_added_whole_and_never_during_a_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "j"
    journal = Journal(path)
    journal.header({"run": "r", "procedure": "turntable"})
    assert being_written(path)
    assert read_journal(path).status is Status.RUNNING
    with pytest.raises(BenchError, match="is being written: its run goes on"):
        append_line(path, {"type": "watchdog"})
    journal.close()
    assert not being_written(path)
    before, write_whole = path.read_bytes(), os.write
    monkeypatch.setattr(journal_module.os, "write", lambda file, data: write_whole(file, data[:7]))
    with pytest.raises(BenchError, match=r"the disk took 7 of \d+ bytes"):
        append_line(path, {"type": "watchdog"})
    monkeypatch.undo()
    assert path.read_bytes() == before
    append_line(path, {"type": "watchdog"})
    assert path.read_bytes().startswith(before)
    assert read_journal(path).damage is None


def test_what_cannot_be_taken_back_hides_no_full_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_file: int, _size: int) -> None:
        raise OSError(errno.EIO, "Input/output error")

    journal = Journal(tmp_path / "j")
    monkeypatch.setattr(journal_module.os, "ftruncate", refuse)
    monkeypatch.setattr(journal_module.os, "write", lambda *_: 7)
    with pytest.raises(BenchError, match=r"the disk took 7 of \d+ bytes"):
        journal.header({"run": "r", "procedure": "turntable"})
    monkeypatch.undo()
    journal.close()


def test_torn_last_line_leaves_record_incomplete(tmp_path: Path) -> None:
    path = tmp_path / "j"
    whole = write(path)
    path.write_bytes(whole + b'{"type":"amend')
    assert read_journal(path).footer is not None
    assert read_journal(path).status is Status.INCOMPLETE


def test_header_is_read_alone_or_empty(tmp_path: Path) -> None:
    write(tmp_path / "j")
    assert read_header(tmp_path / "j")["procedure"] == "turntable"
    (tmp_path / "none").write_bytes(b'{"type":"step"}\n')
    assert read_header(tmp_path / "none") == {}
    (tmp_path / "torn").write_bytes(b'{"type":"header"}')
    assert read_header(tmp_path / "torn") == {}


@pytest.mark.parametrize(
    ("line", "began"),
    [
        (b'{"type":"header","utc":"2026-11-27T22:00:00+00:00"}\n', "2026-11-27T22:00:00+00:00"),
        (b'{"type":"header","utc":"2026-11-27T22:00:00+00:00"}', None),
        (b'{"type":"step","utc":"2026-11-27T22:00:00+00:00"}\n', None),
        (b'{"type":"header"}\n', None),
        (b"\xff\n", None),
    ],
)
def test_when_a_run_began_is_read_from_its_first_line(line: bytes, began: str | None, tmp_path: Path) -> None:
    (tmp_path / "j").write_bytes(line)
    assert read_header(tmp_path / "j").get("utc") == began


@pytest.mark.parametrize("number", ["true", '"3"', "3.0", "2", "4", "null"])
def test_a_format_is_a_number_that_is_known(number: str, tmp_path: Path) -> None:
    (tmp_path / "j").write_text(f'{{"type":"header","format":{number}}}\n')
    with pytest.raises(ConfigError, match=r"a record of format .*; this version reads format 3"):
        read_journal(tmp_path / "j")


def test_directory_names_are_on_disk_with_the_first_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else a power cut takes the directory with all that is in it; a simulated run can be made again."""
    seen: list[Path] = []
    monkeypatch.setattr(journal_module, "synchronise_names", seen.append)
    path = tmp_path / "runs" / "2026" / "j"
    path.parent.mkdir(parents=True)
    write(path)
    assert seen == [tmp_path / "runs" / "2026", tmp_path / "runs", tmp_path]
    simulated = SimulatedJournal(path.with_name("simulated"))
    simulated.header({})
    simulated.close()
    assert len(seen) == 3

    def fail(_: Any) -> None:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(journal_module, "synchronise_names", fail)
    monkeypatch.setattr(journal_module, "_sync", fail)
    journal, simulated = Journal(path.with_name("k")), SimulatedJournal(path.with_name("l"))
    with monkeypatch.context() as patch:
        patch.setattr(journal_module, "_sync", lambda _: None)
        with pytest.raises(BenchError, match="may be lost by a power cut: Input/output error"):
            journal.header({})
    with pytest.raises(BenchError, match="may be lost by a power cut: Input/output error"):
        simulated.footer({})
    journal.close()
    simulated.close()


@pytest.mark.parametrize("platform", ["linux", "darwin"])
def test_line_is_on_disk_by_the_call_of_its_system(
    platform: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []
    monkeypatch.setattr(sys, "platform", platform)
    monkeypatch.setattr(os, "fsync", lambda _: done.append("darwin"))
    monkeypatch.setattr(os, "fdatasync", lambda _: done.append("linux"), raising=False)
    journal = Journal(tmp_path / "j")
    journal.write("step", {})
    journal.close()
    assert done == [platform]


@pytest.mark.parametrize("trouble", ["write", "sync"])
def test_failed_addition_leaves_record_unchanged(trouble: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole, path = write(tmp_path / "j"), tmp_path / "j"
    path.write_bytes(whole + b'{"type":"st')  # torn

    def fail(*_: Any) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    if trouble == "write":
        monkeypatch.setattr(os, "write", fail)
    else:
        monkeypatch.setattr(journal_module, "_sync", fail)
    with pytest.raises(BenchError, match="cannot be written: No space left on device"):
        append_line(path, {"type": "watchdog"})
    assert path.read_bytes() == whole


def test_line_is_added_with_foreign_line_ends(tmp_path: Path) -> None:
    path = tmp_path / "j"
    killed = write(path).splitlines()[:-1]
    path.write_bytes(b"".join(line + b"\r\n" for line in killed))
    append_line(path, {"type": "watchdog"})
    record = read_journal(path)
    assert (record.damage, record.lines[-1]["type"]) == (None, "watchdog")


class Key:
    """A key that signs by writing down what."""

    def signature(self, seal: str) -> dict[str, str]:
        return {"signed": seal}


def test_a_signature_is_that_of_the_line_before(tmp_path: Path) -> None:
    path, key = tmp_path / "j", cast("SigningKey", Key())
    journal = Journal(path)
    journal.signature(key)  # of nothing
    assert path.read_bytes() == b""
    journal.header({"run": "r"})
    journal.signature(key)
    journal.close()
    append_line(path, {"type": "watchdog"}, key)
    record = read_journal(path)
    assert record.damage is None
    assert [line["type"] for line in record.lines] == ["header", "signature", "watchdog", "signature"]
    assert [line["signed"] for line in record.lines[1::2]] == [*record.seals[::2]]
    assert record.seal == record.seals[-1]


def test_journal_without_a_record_keeps_its_lines() -> None:
    journal = MemoryJournal()
    journal.header({"run": "r"})
    journal.signature(cast("SigningKey", Key()))
    journal.footer({})
    journal.close()
    assert [line["type"] for line in journal.lines()] == ["header", "footer"]


@pytest.mark.skipif(sys.platform == "win32", reason="there who has a file open keeps it locked")
def test_query_for_running_run_is_not_a_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It has the lock for an instant, and what a library has kept of its file has it no more."""
    path, kept = tmp_path / "j", list[int]()
    write(path)

    def lock(file: int) -> bool:
        kept.append(os.dup(file))
        return try_lock(file)

    with monkeypatch.context() as patch:
        patch.setattr(journal_module, "try_lock", lock)
        assert not being_written(path)
        assert not being_written(path)
    asking = os.open(path, os.O_RDWR)
    assert try_lock(asking)
    timer = threading.Timer(0.05, os.close, [asking])
    timer.start()
    waits: list[float] = []
    monkeypatch.setattr(journal_module, "sleep", lambda clock, wait_s: (waits.append(wait_s), sleep(clock, wait_s)))
    append_line(path, {"type": "watchdog"})
    assert {*waits} == {0.02}
    timer.join()
    for each in kept:
        os.close(each)


def test_without_locks_a_run_writes_and_nobody_knows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_locks(_: int) -> bool:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(journal_module, "try_lock", no_locks)
    journal = Journal(tmp_path / "j")
    journal.header({})
    assert not being_written(tmp_path / "j")
    append_line(tmp_path / "j", {"type": "watchdog"})
    journal.close()


def test_empty_or_missing_journal_is_not_locked(tmp_path: Path) -> None:
    """It may be about to be locked, and nobody is to come in between."""
    assert not being_written(tmp_path / "none")
    journal = Journal(tmp_path / "j")
    assert being_written(tmp_path / "j") is False
    journal.header({})
    assert being_written(tmp_path / "j")
    journal.close()


def test_lines_are_yielded_up_to_first_torn_line(tmp_path: Path) -> None:
    (tmp_path / "j").write_bytes(b'{"n":1}\n{"n":2}\n[3]\n{"n":4}\n')
    assert list(lines_of(tmp_path / "j")) == [{"n": 1}, {"n": 2}]
    (tmp_path / "j").write_bytes(b'{"n":1}\n{"n":2}')
    assert list(lines_of(tmp_path / "j")) == [{"n": 1}]
