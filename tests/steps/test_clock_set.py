"""A clock of the computer that is set within a run is told, and no date of the record hides it."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import vcfbench
from vcfbench import clock
from vcfbench.archive.days import days_of
from vcfbench.archive.verified import verify_run
from vcfbench.clock import CLOCK_SET, TimeOfDay
from vcfbench.steps.events import StepFinished

MOVED_S = st.one_of(st.floats(2.5, 1e6), st.floats(-1e6, -2.5))


class Setting:
    """Sets the clock once so many steps are over; it stands at `by`."""

    def __init__(self, after: int, by_s: float) -> None:
        self.after, self.by_s, self.moved = after, by_s, timedelta()

    def handle(self, event: Any) -> None:
        if isinstance(event, StepFinished) and event.number == self.after:
            self.moved = timedelta(seconds=self.by_s)

    def now(self, tz: Any = None) -> datetime:
        return datetime.now(tz or UTC) + self.moved  # noqa: TID251  # clock.utc_now calls it


@settings(max_examples=3, deadline=None)
@given(after=st.integers(1, 40), by_s=MOVED_S)
def test_clock_that_is_set_stands_in_the_record(after: int, by_s: float) -> None:
    setting = Setting(after, by_s)
    with TemporaryDirectory() as runs, patch.object(clock, "datetime", setting):
        run = vcfbench.run("turntable", "ideal", settings={"samples": 2}, runs=runs, observers=[setting])
        again = vcfbench.load_run(run.directory)
        (told,) = (each for each in again.not_checked if each.startswith(CLOCK_SET))
        assert told in run.not_checked
        way, _, size_s = told.removeprefix(CLOCK_SET).split()[:3]
        assert way == ("ahead" if by_s > 0.0 else "back")
        assert float(size_s) == pytest.approx(abs(by_s), abs=1.0)
        assert verify_run(run.directory or "").verdict == "PASS"
        assert told in vcfbench.text_of(again.report())
        first, last = days_of(again) or ("", "")
        now = datetime.now(UTC)  # noqa: TID251
        ends = sorted(f"{each:%Y-%m-%d}" for each in (now, now + timedelta(seconds=by_s)))
        assert [first, last] == ends


def test_clock_that_goes_on_is_not_told(tmp_path: Path) -> None:
    run = vcfbench.run("turntable", "ideal", settings={"samples": 2}, runs=tmp_path)
    assert not [each for each in run.not_checked if CLOCK_SET in each]


@given(by_s=MOVED_S, passed_s=st.floats(0.0, 1e3), stood_s=st.floats(0.0, 20.0), slew=st.floats(-5e-4, 5e-4))
@settings(max_examples=200, deadline=None)
def test_slewed_clock_and_a_stall_are_no_jump(by_s: float, passed_s: float, stood_s: float, slew: float) -> None:
    start = datetime(2026, 12, 1, tzinfo=UTC)
    up = iter([0.0, 0.0, passed_s, passed_s + stood_s] * 2)
    for moved_s, said in ((0.0, False), (by_s + (stood_s if by_s > 0.0 else -stood_s), True)):
        utc = iter([start, start + timedelta(seconds=passed_s * (1.0 + slew) + moved_s)])
        with (
            patch.object(clock, "uptime_s", lambda: next(up)),
            patch.object(clock, "utc_now", lambda utc=utc: next(utc)),
        ):
            watch = TimeOfDay()
            assert bool(watch.was_set()) is said
