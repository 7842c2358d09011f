"""The safety stack: brings everything that was opened to its safe state, whatever else has gone wrong.

Actions run in declared order: motion, stimulus, power, the rest; within a stage the last opened first. Each is
isolated from the others, has a deadline, and is proved by a read-back of its own beside what the driver reports.
"""

from __future__ import annotations

import threading
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import TYPE_CHECKING

from vcfbench.clock import Deadline
from vcfbench.errors import NotSafe
from vcfbench.interfaces import SafeReport

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from vcfbench.clock import Clock
    from vcfbench.interfaces import Instrument

__all__ = ["LeaveNow", "SafeAction", "SafetyStack", "Stage", "not_safe"]


class Stage(IntEnum):
    """When an instrument is made safe: what can hurt people first, what others lean on last.

    Instruments of `REST` drive nothing; one that does not answer is no danger.
    """

    MOTION = 0
    STIMULUS = 1
    POWER = 2
    REST = 3


class LeaveNow(BaseException):
    """Raised into the unwinding by a third signal: stop making safe, say what is not."""


@dataclass(frozen=True, slots=True)
class SafeAction:
    """How one instrument is made safe: within `deadline_s` of bench time; `verify` returns what is wrong, or None."""

    stage: Stage
    instrument: Instrument
    deadline_s: float
    verify: Callable[[], str | None]


class SafetyStack:
    """What was opened and how it is made safe.

    `patience` is the wall time (s) that an action may take beyond which it counts as hanging, per second of its
    deadline; `grace_s` is added to it.
    """

    def __init__(self, clock: Clock, *, patience: float = 1.0, grace_s: float = 2.0) -> None:
        self._clock = clock
        self._patience = patience
        self._grace_s = grace_s
        self._actions: list[SafeAction] = []

    def register(self, action: SafeAction) -> None:
        """Add the safe action of an instrument that was just opened."""
        self._actions.append(action)

    def make_safe(self) -> list[SafeReport]:
        """Run every action and return the reports in the order of running; never raises for an instrument."""
        reports: list[SafeReport] = []
        pending = self._in_order()
        try:
            for action in pending:
                reports.append(self._run(action))  # noqa: PERF401  # what was done must survive LeaveNow
        except LeaveNow:
            left = pending[len(reports) :]
            unsaved = (_report(action.instrument, "not made safe: a third signal ended it") for action in left)
            reports += map(_judged, left, unsaved)
        return reports

    def _in_order(self) -> list[SafeAction]:
        """Return the actions by stage, within a stage the last registered first."""
        latest_first = list(reversed(self._actions))
        latest_first.sort(key=lambda action: action.stage)
        return latest_first

    def _run(self, action: SafeAction) -> SafeReport:
        """Run one action in a thread of its own, so that one that hangs does not keep the others from running."""
        done: list[SafeReport] = []  # a list, for the thread to answer in
        wall_s = action.deadline_s * self._patience + self._grace_s
        _within(wall_s, lambda: done.append(self._isolated(action)))
        return _judged(action, done[0] if done else _report(action.instrument, f"still busy after {wall_s:g} s"))

    def close(self) -> None:
        """Close every instrument, the last opened first; one that fails or hangs keeps no other from being closed."""
        while self._actions:
            instrument = self._actions.pop().instrument
            _within(self._grace_s, lambda: _close(instrument))  # noqa: B023  # run before the loop goes on

    def _isolated(self, action: SafeAction) -> SafeReport:
        instrument = action.instrument
        try:
            report = instrument.make_safe(Deadline.after(self._clock, action.deadline_s))
            wrong = action.verify() if report.safe else None
        except BaseException as error:  # noqa: BLE001  # whatever one instrument does, the next must be made safe
            return _report(instrument, f"{type(error).__name__}: {error}")
        return report if wrong is None else _report(instrument, f"reported safe, but {wrong}")


def _judged(action: SafeAction, report: SafeReport) -> SafeReport:
    """Return what `report` means for the bench: who drives nothing is no danger."""
    if action.stage is Stage.REST and not report.safe:
        return replace(report, safe=True, detail=f"it only listens, but: {report.detail}")
    return report


def _within(wall_s: float, act: Callable[[], object]) -> None:
    """Run `act` in a thread and leave it behind when it takes longer than `wall_s`."""
    worker = threading.Thread(target=act, daemon=True)
    try:
        worker.start()
    except RuntimeError:  # no threads left, or the interpreter is ending: better without a limit than not at all
        act()
    else:
        worker.join(wall_s)


def _close(instrument: Instrument) -> None:
    with suppress(
        BaseException
    ):  # it is safe already, or was said not to be; a connection that will not close is no news
        instrument.close()


def not_safe(reports: Iterable[SafeReport]) -> NotSafe | None:
    """Return the error that names everything in `reports` that is not safe, None when all is."""
    unsafe = [_located(report) for report in reports if not report.safe]
    if not unsafe:
        return None
    return NotSafe(f"NOT SAFE: {'; '.join(unsafe)}", hint="make it safe by hand before anything else")


def _located(report: SafeReport) -> str:
    """Say once where `report` comes from: its detail may be an error that names the instrument too."""
    where = f"{report.instrument} at {report.resource}: "
    return where + report.detail.removeprefix(where)


def _report(instrument: Instrument, detail: str) -> SafeReport:
    return SafeReport(instrument=instrument.name, resource=instrument.resource, safe=False, detail=detail)
