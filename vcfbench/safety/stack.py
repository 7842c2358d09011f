"""The safety stack: brings every opened instrument to its safe state, in spite of errors.

First every instrument is told to stop or to switch off, without waiting for any answer. Then the actions run in
declared order: motion, stimulus, power, the rest; within a stage the last opened first. Each is isolated from the
others, has a deadline, and is proved by a read-back of its own beside what the driver reports. What is not proved is
told once more.
"""

from __future__ import annotations

import threading
from contextlib import suppress
from enum import IntEnum
from typing import TYPE_CHECKING

from msgspec import Struct
from msgspec.structs import replace

from vcfbench.clock import Deadline, WallClock, start_thread, within
from vcfbench.errors import NotSafe
from vcfbench.interfaces import SafeReport
from vcfbench.safety.signals import LeaveNow

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from vcfbench.clock import Clock
    from vcfbench.interfaces import Instrument, UnprovedCommand
    from vcfbench.safety.signals import StopSignals

_TELLING_S = 0.45
"""Wall time in which all are told."""
_TURN_S = 0.1
"""Wall time after which the next is told, though this one is still being connected to."""
_RETURN_S = 5.0
"""Wall time for which one whose connection is gone goes on being told: the connection may come back."""
_BETWEEN_S = 0.1


class Stage(IntEnum):
    """Stage of making an instrument safe: first those that can hurt people, last those that others lean on.

    Instruments of `REST` drive nothing; one that does not answer is no danger.
    """

    MOTION = 0
    STIMULUS = 1
    POWER = 2
    REST = 3


class SafeAction(Struct, frozen=True):
    """Making one instrument safe: within `deadline_s` of bench time; `verify` returns the fault, or None."""

    stage: Stage
    instrument: Instrument
    deadline_s: float
    verify: Callable[[], str | None]


class SafetyStack:
    """Opened instruments and the actions that make them safe.

    `patience` is the wall time (s) that an action may take beyond which it counts as hanging, per second of its
    deadline; `grace_s` is added to it.
    """

    def __init__(self, clock: Clock, *, patience: float = 1.0, grace_s: float = 2.0) -> None:
        self._clock = clock
        self._patience = patience
        self._grace_s = grace_s
        self._actions: list[SafeAction] = []
        self.disbelieved: dict[str, str] = {}
        """By instrument why its read-back proves nothing any more."""
        self._over = threading.Event()

    def register(self, action: SafeAction) -> None:
        """Add the safe action of an instrument that was just opened."""
        self._actions.append(action)

    @property
    def longest_s(self) -> float:
        """The most wall time that making safe takes."""
        return _RETURN_S + sum(self._longest_s(action) for action in self._actions)

    def _longest_s(self, action: SafeAction) -> float:
        return action.deadline_s * self._patience + self._grace_s

    def make_safe(self) -> list[SafeReport]:
        """Run every action and return the reports in the order of running; never raises for an instrument."""
        reports: list[SafeReport] = []
        pending = self._in_order()
        try:
            _tell(pending, self._over)
            for action in pending:
                reports.append(self._run(action))  # noqa: PERF401  # what was done must survive LeaveNow
            return _with_last_words(pending, reports, self._over)
        except LeaveNow:  # it is raised once
            left = pending[len(reports) :]
            unsaved = (_report(action.instrument, "a third signal ended the making safe") for action in left)
            return _with_last_words(pending, [*reports, *map(_judged, left, unsaved)], self._over)

    def make_safe_until_ended(self, signals: StopSignals) -> list[SafeReport]:
        """Make safe as `make_safe` does, then end the handling of `signals`.

        Raises:
            NotSafe: a third signal ended it when some were not judged.
        """
        try:
            signals.allow_end()
            reports = self.make_safe()
            signals.close()
        except LeaveNow:  # raised once; just before or after: nothing may have been told yet
            self.command_safe()
            said = "NOT SAFE: making safe was ended by a third signal"
            raise NotSafe(said, hint="go and look at every instrument") from None
        return reports

    def command_safe(self) -> None:
        """Send every instrument its stop or off command, without waiting for an answer; within half a second."""
        _tell(self._in_order(), self._over)

    def _in_order(self) -> list[SafeAction]:
        """Return the actions by stage, within a stage the last registered first."""
        latest_first = list(reversed(self._actions))
        latest_first.sort(key=lambda action: action.stage)
        return latest_first

    def _run(self, action: SafeAction) -> SafeReport:
        """Run one action in a thread of its own, so that one that hangs does not keep the others from running."""
        done: list[SafeReport] = []  # a list, for the thread to answer in
        wall_s = self._longest_s(action)
        within(wall_s, lambda: done.append(self._isolated(action)))
        return _judged(action, done[0] if done else _report(action.instrument, f"still busy after {wall_s:g} s"))

    def close(self) -> None:
        """Close every instrument, the last opened first; one that fails or hangs keeps no other from being closed."""
        self._over.set()  # who comes back after this is none of ours
        while self._actions:
            instrument = self._actions.pop().instrument
            within(self._grace_s, lambda: _close(instrument))  # noqa: B023  # run before the loop goes on

    def _isolated(self, action: SafeAction) -> SafeReport:
        instrument = action.instrument
        try:
            report = instrument.make_safe(Deadline.after(self._clock, action.deadline_s))
            wrong = action.verify() if report.safe else None
        except BaseException as error:  # noqa: BLE001  # whatever one instrument does, the next must be made safe
            return _report(instrument, f"{type(error).__name__}: {error}")
        if (why := self.disbelieved.get(instrument.name)) and report.safe:
            wrong = f"its read-back proves nothing: {why}"
        return report if wrong is None else _report(instrument, f"reported safe, but {wrong}")


def _judged(action: SafeAction, report: SafeReport) -> SafeReport:
    """Return `report` as it counts for the bench: an instrument that drives nothing is no danger."""
    if action.stage is Stage.REST and not report.safe:
        return replace(report, safe=True, detail=f"it only listens, but: {report.detail}")
    return report


class _Telling:
    """Tells one instrument to stop or to switch off, again and again while its connection is gone."""

    def __init__(self, instrument: Instrument, over: threading.Event) -> None:
        self.command: UnprovedCommand | None = None
        self._instrument = instrument
        self._over = over
        self._tried = threading.Event()

    def start(self) -> None:
        """Begin; without threads (the interpreter is ending) do it here, once."""
        try:
            start_thread(self._tell)
        except RuntimeError:
            self._tell_once()

    def wait(self, wall_s: float) -> None:
        """Wait until all commands were sent once, no longer than `wall_s`."""
        self._tried.wait(wall_s)

    def _tell(self) -> None:
        wall = WallClock()
        while not self._tell_once() and wall.now() < _RETURN_S and not self._over.wait(_BETWEEN_S):
            pass

    def _tell_once(self) -> bool:
        with suppress(Exception):  # a driver is anyone's code; the next must be told
            self.command = self._instrument.command_safe()
        self._tried.set()
        return self.command is not None and self.command.sent


def _tell(actions: Sequence[SafeAction], over: threading.Event) -> list[UnprovedCommand | None]:
    """Tell the instruments of `actions` in this order; None for one that hangs. `over` ends those that still go on."""
    wall = WallClock()
    tellings = [_Telling(action.instrument, over) for action in actions]
    for telling in tellings:
        telling.start()
        telling.wait(min(_TURN_S, _TELLING_S - wall.now()))
    for telling in tellings:
        telling.wait(_TELLING_S - wall.now())
    return [telling.command for telling in tellings]


def _with_last_words(
    actions: Sequence[SafeAction], reports: Sequence[SafeReport], over: threading.Event
) -> list[SafeReport]:
    """Tell once more the unsafe instruments, and add the last read-back to their reports."""
    unsafe = [action for action, report in zip(actions, reports, strict=True) if not report.safe]
    sent = iter(_tell(unsafe, over))
    return [report if report.safe else replace(report, unproved=next(sent) or report.unproved) for report in reports]


def _close(instrument: Instrument) -> None:
    with suppress(BaseException):  # it was said whether it is safe; a connection that will not close is no news
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
    detail = report.detail.removeprefix(where)
    return where + (detail if report.unproved is None else f"{report.unproved}; {detail}")


def _report(instrument: Instrument, detail: str) -> SafeReport:
    return SafeReport(instrument=instrument.name, resource=instrument.resource, safe=False, detail=detail)
