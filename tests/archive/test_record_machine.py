"""A record, whatever is done to it in whatever order: runs, kills at any byte, resumes, amendments, second starters."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule
from msgspec import Struct

import vcfbench
from vcfbench.archive.amending import amend_run
from vcfbench.archive.verified import verify_run
from vcfbench.errors import BenchError, ConfigError
from vcfbench.records.journal import being_written

if TYPE_CHECKING:
    from collections.abc import Callable

    from vcfbench.records.schema import Point
    from vcfbench.steps.events import Event

QUICK = {"rates_deg_s": (10.0, 0.0, -10.0), "samples": 2, "sample_interval_s": 0.5, "settle_s": 0.5}
FRACTION = st.floats(0.0, 1.0)


class Kept(Struct):
    """What must stay of a record: its whole lines, the points that were shown, by size of the journal."""

    lines: bytes = b""
    shown: tuple[Point, ...] = ()
    complete: bool = False


class Watcher:
    """Sees a run: how long its journal is and what was shown at each event; at one of them others come."""

    def __init__(self, machine: Records, others_at: int, earlier: Path | None) -> None:
        self.shown: list[tuple[int, tuple[Point, ...]]] = []
        self._machine, self._others_at, self._earlier = machine, others_at, earlier
        self._points: list[Point] | None = None

    def handle(self, event: Event) -> None:
        [path] = [each for each in self._machine.runs.iterdir() if each not in self._machine.kept]
        if self._points is None:  # what was taken over comes without events
            self._points = list(vcfbench.load_run(path).points)
        point = event.result.recorded_point if isinstance(event, vcfbench.StepFinished) else None
        self._points += [] if point is None else [point]
        self.shown.append(((path / "journal.jsonl").stat().st_size, tuple(self._points)))
        if len(self.shown) == self._others_at:
            self._refused(path)

    def _refused(self, path: Path) -> None:
        """Nobody else goes on with a run that goes on, or with what it goes on with."""
        with pytest.raises(BenchError, match="its run goes on"):
            amend_run(path, {"operator": "B"}, reason="R")
        with pytest.raises(ConfigError, match="goes on: there is nothing to resume"):
            vcfbench.resume(path)
        if self._earlier is not None:
            with pytest.raises(ConfigError, match="is being resumed already"):
                vcfbench.resume(self._earlier)
        found = verify_run(path)
        assert (found.verdict, found.status) == ("PASS", "running"), found.wrong


class Records(RuleBasedStateMachine):
    """Records of one directory of runs."""

    def __init__(self) -> None:
        super().__init__()
        self.runs = Path(tempfile.mkdtemp())
        self.kept: dict[Path, Kept] = {}

    def teardown(self) -> None:
        shutil.rmtree(self.runs)

    def _one(self, which: int, *, complete: bool | None = None) -> Path:
        them = [path for path, kept in self.kept.items() if complete is None or kept.complete == complete]
        return them[which % len(them)]

    def _carried_out(self, act: Callable[[Watcher], Any], watcher: Watcher, cut: float | None) -> Path:
        path: Path = act(watcher).directory
        journal = path / "journal.jsonl"
        data, shown = journal.read_bytes(), vcfbench.load_run(path).points
        assert len(shown) == 3
        if cut is not None:
            data = data[: round(cut * (len(data) - 1))]
            journal.write_bytes(data)
            shown = next((points for size, points in reversed(watcher.shown) if size <= len(data)), ())
            for name in ("points.csv", "result.json"):
                (path / name).unlink()
        self.kept[path] = Kept(data[: data.rfind(b"\n") + 1], shown, cut is None)
        return path

    @rule(cut=st.none() | FRACTION, others_at=st.integers(1, 80))
    def start(self, cut: float | None, others_at: int) -> None:
        def act(watcher: Watcher) -> Any:
            return vcfbench.run("turntable", "ideal", settings=QUICK, runs=self.runs, observers=[watcher])

        self._carried_out(act, Watcher(self, others_at, None), cut)

    @precondition(lambda self: any(not each.complete for each in self.kept.values()))
    @rule(which=st.integers(0), cut=st.none() | FRACTION, others_at=st.integers(1, 40))
    def resume(self, which: int, cut: float | None, others_at: int) -> None:
        earlier = self._one(which, complete=False)
        if not self.kept[earlier].lines:
            with pytest.raises(ConfigError, match="no whole line"):
                vcfbench.resume(earlier)
            return
        watcher = Watcher(self, others_at, earlier)
        path = self._carried_out(lambda watcher: vcfbench.resume(earlier, observers=[watcher]), watcher, cut)
        if cut is None:
            shown = self.kept[earlier].shown
            assert self.kept[path].shown[: len(shown)] == shown

    @precondition(lambda self: self.kept)
    @rule(which=st.integers(0), field=st.sampled_from(["dut", "operator", "checked_by", "tags.batch"]))
    def amend(self, which: int, field: str) -> None:
        path = self._one(which)
        kept = self.kept[path]
        if not kept.lines:
            with pytest.raises(ConfigError):
                amend_run(path, {field: "new"}, reason="R")
            return
        value = str(kept.lines.count(b"\n"))  # another each time
        amend_run(path, {field: value}, reason="R")
        data = (path / "journal.jsonl").read_bytes()
        assert data.startswith(kept.lines)
        assert data.count(b"\n") == kept.lines.count(b"\n") + 1
        kept.lines = data

    @precondition(lambda self: any(each.lines for each in self.kept.values()))
    @rule(which=st.integers(0), place=FRACTION, bit=st.integers(0, 7))
    def change(self, which: int, place: float, bit: int) -> None:
        path = self._one(which)
        kept, journal = self.kept[path], path / "journal.jsonl"
        if not kept.lines:
            return
        data, at = bytearray(before := journal.read_bytes()), round(place * (len(kept.lines) - 1))
        if not kept.complete and at == len(kept.lines) - 1:
            return  # then it ends within its last line, as a record does that was killed there
        data[at] ^= 1 << bit
        journal.write_bytes(data)
        found = verify_run(path)
        assert (found.verdict, found.line) == ("FAIL", kept.lines.count(b"\n", 0, at) + 1), found.wrong
        journal.write_bytes(before)

    @invariant()
    def every_record_is_what_was_written(self) -> None:
        for path, kept in self.kept.items():
            journal = path / "journal.jsonl"
            assert journal.read_bytes().startswith(kept.lines)
            assert not being_written(journal)
            found = verify_run(path)
            assert found.verdict == ("PASS" if kept.lines else "FAIL"), found.wrong
            if kept.lines:
                run = vcfbench.load_run(path)
                assert run.points[: len(kept.shown)] == kept.shown
                assert (run.status == "complete") == kept.complete


class TestRecords(Records.TestCase):
    """Some."""

    settings = settings(max_examples=3, stateful_step_count=6, suppress_health_check=list(HealthCheck))


@pytest.mark.exhaustive
class TestManyRecords(Records.TestCase):
    """Many."""

    settings = settings(max_examples=10, stateful_step_count=12, suppress_health_check=list(HealthCheck))
