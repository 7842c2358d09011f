"""What a power cut may leave of each protocol that writes: every state, and what readers make of it."""

from __future__ import annotations

import errno
import json
import os
import shutil
import tempfile
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from vcfbench.errors import BenchError, ConfigError
from vcfbench.records.device_values import Conditions, Measured
from vcfbench.records.devices import DeviceStore, SelfCalibration
from vcfbench.records.export import write_text
from vcfbench.records.journal import Journal, append_line, read_journal
from vcfbench.safety import lock
from vcfbench.safety.lock import instrument_locks
from vcfbench.testing.disk import Disk, DiskState

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

TABLE = "step,rate_deg_s\n1,10.0\n1,0.0\n"


def states_after_each(folder: Path, act: Callable[[list[int]], None]) -> Iterator[tuple[list[int], Path]]:
    """Do `act` on a disk; yield every state before each of its operations and at its end, with what was said by then.

    It notes in its argument what it may rely on; the states lie in directories of their own.
    """
    place, said = folder / "disk", list[int]()
    place.mkdir()
    found: list[tuple[list[int], dict[str, bytes | None]]] = []

    def before(_number: int, _what: str) -> None:
        found.extend((list(said), dict(state.files)) for state in disk.after_power_cut())

    with Disk(place, before) as disk:
        act(said)
        before(0, "")
    for number, (known, files) in enumerate(found):
        laid = folder / str(number)
        laid.mkdir()
        for name, data in sorted(files.items()):
            if data is None:
                (laid / name).mkdir()
            else:
                (laid / name).write_bytes(data)
        yield known, laid


def test_journal_keeps_every_written_line(tmp_path: Path) -> None:
    def write(said: list[int]) -> None:
        (tmp_path / "disk" / "run").mkdir()
        journal = Journal(tmp_path / "disk" / "run" / "journal.jsonl")
        journal.header({"run": "run"})
        said.append(0)
        for number in (1, 2, 3):
            journal.write("step", {"n": number, "t_s": float(number), "end_s": float(number)})
            said.append(number)
        journal.footer({"status": "complete", "points": 0, "error": None})
        said.append(4)
        journal.close()

    count = 0
    for said, place in states_after_each(tmp_path, write):
        count += 1
        path = place / "run" / "journal.jsonl"
        if not path.exists():
            assert said == []
            continue
        record = read_journal(path)
        numbers = [line.get("n", 0 if line["type"] == "header" else 4) for line in record.lines]
        assert numbers[: len(said)] == said
        assert numbers == list(range(len(numbers)))
        assert record.damage is None or len(numbers) < 5  # of the line under way its zeros may stand there
    assert count > 20


def test_watchdogs_line_harms_no_other_line(tmp_path: Path) -> None:
    def write(said: list[int]) -> None:
        path = tmp_path / "disk" / "journal.jsonl"
        journal = Journal(path)
        journal.header({"run": "run"})
        journal.write("step", {"n": 1, "t_s": 1.0, "end_s": 1.0})
        journal.close()
        descriptor = os.open(path, os.O_WRONLY | os.O_APPEND)
        os.write(descriptor, b'{"type":"step","n":2,"t_s":2')  # it died there
        os.close(descriptor)
        said.append(1)
        append_line(path, {"type": "watchdog", "safe": True})
        said.append(2)

    for said, place in states_after_each(tmp_path, write):
        if said:
            kinds = [line["type"] for line in read_journal(place / "journal.jsonl").lines]
            assert kinds[:2] == ["header", "step"]
            assert kinds[2:] in ([], ["watchdog"])
            assert len(said) == 1 or kinds[2:]


def test_results_are_whole_or_not_there(tmp_path: Path) -> None:
    def write(said: list[int]) -> None:
        write_text(tmp_path / "disk" / "points.csv", "of before\n")
        write_text(tmp_path / "disk" / "points.csv", TABLE)
        said.append(1)

    for _, place in states_after_each(tmp_path, write):
        path = place / "points.csv"
        assert not path.exists() or path.read_text() in {"of before\n", TABLE}


def entry(number: int) -> SelfCalibration:
    nothing = Measured(value=float(number), u=0.0)
    at = Conditions(bench="b", run="r", simulated=True, positive_rail_v=10.0, negative_rail_v=-10.0)
    return SelfCalibration(
        serial="G",
        done=datetime(2026, 1, 1, tzinfo=UTC),
        procedure="self-calibration",
        certificate=None,
        scale_factor_v_per_deg_s=nothing,
        bias_v=nothing,
        conditions=at,
    )


def test_device_entry_is_whole_or_absent(tmp_path: Path) -> None:
    def write(said: list[int]) -> None:
        for number in (1, 2):
            DeviceStore(tmp_path / "disk" / "devices").add(entry(number))
            said.append(number)

    for said, place in states_after_each(tmp_path, write):
        store = DeviceStore(place / "devices")
        try:
            found = [each.record for each in store.entries("G")]
        except ConfigError:  # no device of that name yet
            found = []
        assert found[: len(said)] == [entry(number) for number in said]
        assert all(each in (entry(1), entry(2)) for each in found)


def test_a_lock_file_in_any_state_locks_nobody_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lock, "_DYING_S", 0.0)  # this process has signed, and does not die

    def write(_said: list[int]) -> None:
        monkeypatch.setenv("VCFBENCH_LOCKS", str(tmp_path / "disk"))
        with instrument_locks("one", {"power": "GPIB0::5::INSTR"}):
            pass

    for _, place in states_after_each(tmp_path, write):
        monkeypatch.setenv("VCFBENCH_LOCKS", str(place))
        with instrument_locks("two", {"power": "GPIB0::5::INSTR"}) as left:
            assert all(json.dumps(each) for each in left.values())


def test_failed_synchronisation_is_bench_error(tmp_path: Path) -> None:
    for failing in range(1, 12):

        def before(number: int, what: str, at: int = failing) -> None:
            if what.endswith("sync") and number >= at:
                raise OSError(5, "Input/output error")

        place = tmp_path / str(failing)
        place.mkdir()
        with Disk(place, before):
            try:
                journal = Journal(place / "journal.jsonl")
                journal.header({"run": "run"})
                journal.write("step", {"n": 1, "t_s": 0.0, "end_s": 0.0})
                journal.close()
                write_text(place / "points.csv", TABLE)
            except BenchError as error:
                assert "Input/output error" in str(error)  # noqa: PT017
        assert read_journal(place / "journal.jsonl").damage is None


class PowerOff(BaseException):
    """Ends a program as a power cut does."""


class Devices(RuleBasedStateMachine):
    """The store of one device on a disk: entries added by two writers at once, full disks, power cuts."""

    def __init__(self) -> None:
        super().__init__()
        self._folder = Path(tempfile.mkdtemp())
        self._number = 0
        self._left = 0
        self._act: Callable[[str], None] | None = None
        self.added: dict[str, int] = {}
        """Entries that were said to be there, by name."""
        self.perhaps: set[int] = set()
        """Entries whose writer was told that they could not be kept, or died."""
        self._begin(DiskState({"devices": None}))

    def _begin(self, state: DiskState) -> None:
        self._number += 1
        place = self._folder / str(self._number)
        place.mkdir()
        state.lay(place)
        self.store = DeviceStore(place / "devices")
        self.disk = Disk(place, self._before).__enter__()

    def _before(self, _number: int, what: str) -> None:
        self._left -= 1
        if self._left == 0 and (act := self._act) is not None:
            self._act = None
            act(what)

    def teardown(self) -> None:
        self.disk.__exit__()
        shutil.rmtree(self._folder)

    def _add(self, *, at: int = 0, act: Callable[[str], None] | None = None) -> None:
        """Add an entry; before the operation `at` of it do `act`."""
        self._number += 1
        number, highest = self._number, max(self.added, default="")
        self.perhaps.add(number)
        self._left, self._act = at, act
        name = self.store.add(entry(number)).name
        self.perhaps.remove(number)
        assert name > highest
        assert name not in self.added
        self.added[name] = number

    @rule(at=st.integers(1, 8))
    def two_writers(self, at: int) -> None:
        self._add(at=at, act=lambda _what: self._add())

    @rule(at=st.integers(1, 8))
    def full(self, at: int) -> None:
        def refuse(_what: str) -> None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        with suppress(ConfigError):  # the last operations take a draft away, without which it is there all the same
            self._add(at=at, act=refuse)

    @rule(at=st.integers(1, 8), seed=st.integers(0, 1 << 32))
    def power_cut(self, at: int, seed: int) -> None:
        states, drawn = list[DiskState](), Random(seed)  # noqa: S311  # a test

        def cut(_what: str) -> None:
            states.extend(self.disk.after_power_cut(drawn))
            self.disk.stopped = True
            raise PowerOff

        with suppress(PowerOff):
            self._add(at=at, act=cut)
        self.disk.__exit__()
        self._begin(states[0] if states else next(self.disk.after_power_cut(drawn)))

    @invariant()
    def what_was_added_is_there_and_nothing_in_part(self) -> None:
        found = {each.name: each.record for each in self.store.entries("G")}
        assert self.added.items() <= {name: _number_of(each) for name, each in found.items()}.items()
        assert {_number_of(each) for name, each in found.items() if name not in self.added} <= self.perhaps


def _number_of(record: object) -> int:
    assert isinstance(record, SelfCalibration)
    return int(record.bias_v.value)


class TestDevices(Devices.TestCase):
    """Some."""

    settings = settings(max_examples=30, stateful_step_count=8)


@pytest.mark.exhaustive
class TestManyDevices(Devices.TestCase):
    """Many."""

    settings = settings(max_examples=100, stateful_step_count=20, suppress_health_check=list(HealthCheck))
