"""Acquisition of a record out of the World: arm, look for the trigger, keep the stretch around it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Protocol

from msgspec import Struct

from simrack.instruments.dso7104b.inputs import Signals
from simrack.instruments.dso7104b.trigger import TriggerSearch

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Mapping, Sequence

    _Stepping = Generator[None, None, "CapturedRecord | None"]
    from simrack.instruments.dso7104b.inputs import ChannelRecording, ChannelView, ScopeWorld, Screen
    from simrack.instruments.dso7104b.trigger import Trigger
    from simrack.trace import Piece

AUTO_TRIGGER_S = 0.02
"""How long AUTO waits for a trigger; the guide says that AUTO suits signals above 50 Hz (unverified)."""
_SEARCH_S = 1e-3
_LONGEST_SEARCH_S = 0.05
_REARM_S = 10e-6
"""From the end of a segment until the next can begin to fill (unverified)."""
_STARTED_ANEW_S = 2.0
"""Of a longer silence only the last part is searched: at two microseconds a point this takes a tenth of a second."""
_REMEMBERED_S = 11.0
"""The longest duration that a trigger measures, and a little more."""
_AVERAGED_SHARE = 0.01
"""Of the screen: what a point of high resolution may take from beyond its edges, at 100 points."""


class Pace(Struct, frozen=True):
    """Pace of the acquisitions.

    Args:
        auto: trigger by itself where nothing does for a while.
        repeats: acquisitions of an average.
        segments: acquisitions of a segmented one, each a record of its own.
        holdoff_s: time from one trigger to the next at least.
        not_before_s: bench time before which no trigger counts, from the holdoff of the one before.
        smooth: points are means of what is around them.
    """

    auto: bool
    repeats: int = 1
    segments: int = 0
    holdoff_s: float = 0.0
    not_before_s: float = -math.inf
    smooth: bool = False


class CapturedRecord(Struct, frozen=True):
    """Captured signals, and the instants of the triggers."""

    signals: Signals
    triggers_s: tuple[float, ...]


class Acquisition(Protocol):
    """One armed acquisition: go through :meth:`step` at :attr:`due_s` until it gives a record."""

    screen: Screen
    due_s: float

    def step(self) -> _Stepping:
        """Return, after slices of work, capture and triggers if there is a complete record, else None."""

    def force(self) -> None:
        """Trigger at once, independent of the signal."""

    def close(self) -> None:
        """Give up."""


class Arming(Struct, frozen=True):
    """Everything that an acquisition is armed with.

    Args:
        screen: the window.
        views: how each channel looks at its node.
        trigger: what it waits for.
        pace: how acquisitions follow each other.
        past: asks what is known, up to now, of the nodes of channels that are AC coupled.
    """

    screen: Screen
    views: Mapping[int, ChannelView]
    trigger: Trigger
    pace: Pace
    past: Callable[[], Mapping[int, Sequence[Piece]]]


def acquisition(world: ScopeWorld, arming: Arming) -> Acquisition:
    """Arm: from AUTO sweep one record is wanted soon, otherwise nothing may be missed however long it takes."""
    pace = arming.pace
    return (_Swept if pace.auto and not pace.segments else _Patient)(world, arming)


class _Armed:
    """Common base of both ways to acquire."""

    def __init__(self, world: ScopeWorld, arming: Arming) -> None:
        self._world = world
        self.screen = screen = arming.screen
        self._views, self._past = arming.views, arming.past
        self._pace = arming.pace
        self._search = TriggerSearch(arming.trigger)
        self._forced = False
        # a little more than the screen, for skew and time base error, and what filters remember
        beyond_s = max((view.remembered_s for view in arming.views.values()), default=0.0)
        if arming.pace.smooth:
            beyond_s += _AVERAGED_SHARE * screen.range_s
        self._before_s = max(0.0, -screen.left_s) * 1.001 + 1e-8 + beyond_s
        self._after_s = max(0.0, screen.left_s + screen.range_s) * 1.001 + 1e-8 + beyond_s
        self._search_s = max(_SEARCH_S, screen.range_s)
        self._armed_s = world.clock.now()
        self.due_s = 0.0

    def force(self) -> None:
        """Trigger at once, independent of the signal."""
        self._forced = True

    def close(self) -> None:
        """Give up."""

    def _crossing(self, signals: Signals, start_s: float, stop_s: float) -> Generator[None, None, float | None]:
        return self._search.finding(signals, max(start_s, self._pace.not_before_s), stop_s)

    def _repeats_s(self) -> float:
        """Return the time of the further acquisitions of an average, which see the same steady signal."""
        return (self._pace.repeats - 1) * max(self._before_s + self._after_s, self._pace.holdoff_s)


class _Swept(_Armed):
    """AUTO sweep: capture after capture until there is a trigger or it is given up to wait."""

    def __init__(self, world: ScopeWorld, arming: Arming) -> None:
        super().__init__(world, arming)
        self._found: CapturedRecord | None = None
        self._arm()

    def _arm(self) -> None:
        self._start_s = self._world.clock.now()
        self.due_s = self._start_s + self._before_s + self._search_s + self._after_s
        capture = self._world.capture(self._start_s, self.due_s)
        self._signals = Signals(capture, self._views, self._past())

    def step(self) -> _Stepping:
        """Return the record once it is complete, else None (and a later `due_s`)."""
        if self._world.clock.now() < self.due_s:
            return None
        if self._found is None:
            self._found = yield from self._look()
            if self._found is None:
                # Look for the trigger in a longer stretch, but not past the patience of AUTO
                longest = self._armed_s + AUTO_TRIGGER_S - self._world.clock.now()
                self._search_s = max(self._search_s, min(2.0 * self._search_s, longest))
                self._arm()
                return None
            if self._pace.repeats > 1:
                self.due_s += self._repeats_s()
                return None
        return self._found

    def _look(self) -> _Stepping:
        opening, waited = self._start_s + self._before_s, self._world.clock.now() - self._armed_s
        crossing = yield from self._crossing(self._signals, opening, opening + self._search_s)
        if crossing is not None:
            return CapturedRecord(self._signals, (crossing,))
        if self._forced or waited >= AUTO_TRIGGER_S:
            return CapturedRecord(self._signals, (opening,))
        return None


class _Patient(_Armed):
    """NORMal sweep and segmented memory: everything is recorded from arming on, so that nothing is missed."""

    def __init__(self, world: ScopeWorld, arming: Arming) -> None:
        super().__init__(world, arming)
        self._recording: ChannelRecording = world.record()
        self._signals = Signals(self._recording, self._views, self._past())
        self._triggers_s: list[float] = []
        self._from_s = self._armed_s + self._before_s
        self._waiting_since_s = self._from_s
        self._complete = False
        self.due_s = self._from_s + self._search_s + self._after_s

    def close(self) -> None:
        """Give up, or be done: nothing more is recorded."""
        self._recording.close()

    def step(self) -> _Stepping:
        """Return the record once it is complete, else None (and a later `due_s`)."""
        if self._world.clock.now() < self.due_s:
            return None
        if not self._complete:
            # Take every trigger whose record is over; come back for the next
            now = self._world.clock.now()
            while not self._complete:
                trigger_s = yield from self._next(now - self._after_s)
                if trigger_s is None:
                    break
                self._triggers_s.append(trigger_s)
                self._complete = len(self._triggers_s) >= max(1, self._pace.segments)
                refilled_s = trigger_s + self._after_s + _REARM_S + self._before_s
                self._from_s = self._waiting_since_s = max(refilled_s, trigger_s + self._pace.holdoff_s)
                self._search_s = max(_SEARCH_S, self.screen.range_s)
            if not self._complete:
                if not self._triggers_s:
                    self._recording.forget(self._from_s - self._before_s - _REMEMBERED_S)
                self._search_s = min(2.0 * self._search_s, max(self._search_s, _LONGEST_SEARCH_S))
                self.due_s = max(now, self._from_s + self._after_s) + self._search_s
            if not self._complete:
                return None
            self.close()
            if self._pace.repeats > 1 and not self._pace.segments:
                self.due_s += self._repeats_s()
                return None
        return CapturedRecord(self._signals, tuple(self._triggers_s))

    def _next(self, horizon_s: float) -> Generator[None, None, float | None]:
        """Return the next trigger up to the horizon, real, forced or automatic."""
        if horizon_s - self._from_s > _STARTED_ANEW_S:
            self._from_s = horizon_s - _STARTED_ANEW_S
        crossing = yield from self._crossing(self._signals, self._from_s, horizon_s)
        by_itself = self._waiting_since_s + AUTO_TRIGGER_S if self._pace.auto else math.inf
        if crossing is not None:
            return min(crossing, by_itself)
        if self._forced and horizon_s >= self._from_s:
            return horizon_s
        self._from_s = max(self._from_s, horizon_s)
        return by_itself if by_itself <= horizon_s else None
