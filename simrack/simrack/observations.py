"""Observers of a World over a time: averaging windows, captures, recordings. A World hands them its stretches."""

from __future__ import annotations

import bisect
import math
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

from simrack.clock import Clock
from simrack.trace import Piece, Stretch, Trace, piece_of

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


_EARLY_S = 1e-9


class Window:
    """An averaging window on a node."""

    __slots__ = ("_integral_v_s", "_world", "node", "start_s", "stop_s")

    def __init__(self, world: Observed, node: str, start_s: float, stop_s: float) -> None:
        self._world = world
        self._integral_v_s = 0.0
        self.node = node
        self.start_s = start_s
        self.stop_s = stop_s

    def mean_v(self) -> float:
        """Return the mean voltage over the window.

        Raises:
            RuntimeError: the window is not over yet.
        """
        if not self._world.reach(self.stop_s):
            raise RuntimeError("the averaging window is not over yet")
        return self._integral_v_s / (self.stop_s - self.start_s)

    def take(self, stretch: Stretch) -> None:
        """Add a stretch that lies within the window."""
        self._integral_v_s += stretch.integral(self.node)


class Capture:
    """A stretch of time whose waveforms can be looked at, at carrier level too."""

    __slots__ = ("_stretches", "_world", "start_s", "stop_s")

    def __init__(self, world: Observed, start_s: float, stop_s: float) -> None:
        self._world = world
        self._stretches: list[Stretch] = []
        self.start_s = start_s
        self.stop_s = stop_s

    def samples(self, node: str, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the node's volts at absolute times within the capture, in the shape of `times_s`.

        Raises:
            RuntimeError: the capture is not over yet.
        """
        import numpy as np  # noqa: PLC0415  (kept out of the import of the package)

        times = np.asarray(times_s, dtype=float)
        self._require_over(times)
        starts = [each.start_s for each in self._stretches]
        held = np.clip(np.searchsorted(starts, times, side="right") - 1, 0, None)
        volts = np.empty_like(times)
        for index in np.unique(held):
            volts[held == index] = self._stretches[index].at(node, times[held == index])
        return volts

    def finest_s(self, node: str) -> float:
        """Return a time within which a cubic describes a node's voltage, except at jumps."""
        return min((each.finest_s(node) for each in self._stretches), default=math.inf)

    def fed(self, node: str) -> bool:
        """Return True if a node's voltage is put on it from outside the PCB."""
        return all(each.fed(node) for each in self._stretches)

    def whole(self, start_s: float, stop_s: float) -> bool:
        """Return True if nothing happened between two times that could make a node jump."""
        return sum(each.start_s < stop_s and each.stop_s > start_s for each in self._stretches) <= 1

    def pieces(self, node: str) -> list[Piece]:
        """Return the pieces known of a node up to now, oldest first."""
        self._world.advance()
        return [piece_of(stretch, node) for stretch in self._stretches]

    def take(self, stretch: Stretch) -> None:
        """Keep a stretch that lies within the capture."""
        self._stretches.append(stretch)

    def _require_over(self, times_s: NDArray[np.float64]) -> None:
        del times_s
        self._world.advance()
        if self._world.reached_s < self.stop_s:
            raise RuntimeError("the capture is not over yet")


class Recording(Capture):
    """A capture without an end: the past can be looked at already. It leaves no mark in the World's course."""

    __slots__ = ("_open",)

    def __init__(self, world: Observed, start_s: float) -> None:
        super().__init__(world, start_s, math.inf)
        self._open = True

    def forget(self, before_s: float) -> None:
        """Drop everything that was over before a time."""
        self._stretches = [each for each in self._stretches if each.stop_s > before_s]

    def close(self) -> None:
        """Keep the pieces so far and take nothing more."""
        self._world.advance()
        self._world.dismiss(self)
        self._open = False

    def _require_over(self, times_s: NDArray[np.float64]) -> None:
        self._world.advance()
        if self._open and times_s.size and self._world.reached_s < times_s.max():
            raise RuntimeError("the recording has not reached this instant")


class Observed(ABC):
    """A World that hands its stretches to its observers; each question takes it through time."""

    nodes: tuple[str, ...]

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.reached_s = clock.now()
        """The bench time that it was taken to."""
        self._edges_s: list[float] = []
        self._observers: list[Window | Capture | Trace] = []

    @abstractmethod
    def _go(self, stop_s: float, *, seen: bool) -> Stretch | None:
        """Go on to an instant, with nothing happening before; return the stretch if it is to be `seen`."""

    def _next_event_s(self) -> float:
        """Return when something happens next by itself."""
        return math.inf

    def reach(self, instant_s: float) -> bool:
        """Take it to an instant if it has not been there; return True if that lies in the past."""
        if instant_s > self.clock.now():
            return False
        while self.reached_s < instant_s:
            self._step(instant_s)
        return True

    def _step(self, target_s: float) -> None:
        """Go on to an instant, but no further than the next event and the next edge of an observation."""
        edge = self._edges_s[0] if self._edges_s else math.inf
        stop = min(target_s, edge, self._next_event_s())
        looking = [each for each in self._observers if each.start_s <= self.reached_s]
        stretch = self._go(stop, seen=bool(looking))
        self.reached_s = stop
        if stretch is not None:
            for each in looking:
                each.take(stretch)
        if stop == edge:
            del self._edges_s[: bisect.bisect_right(self._edges_s, stop)]
            self._observers = [each for each in self._observers if each.stop_s > stop]

    def advance(self) -> None:
        """Take it to `clock.now()`."""
        self.reach(self.clock.now())

    def window(self, node: str, start_s: float, stop_s: float) -> Window:
        """Register an averaging window that begins now or later.

        Raises:
            ValueError: it begins in the past, does not last, or the node is unknown.
        """
        self._require(node, self.nodes)
        start_s = self._coming(start_s, stop_s)
        window = Window(self, node, start_s, stop_s)
        self._observe(window)
        return window

    def capture(self, start_s: float, stop_s: float) -> Capture:
        """Register a stretch of time that begins now or later, whose waveforms will be asked for.

        Raises:
            ValueError: it begins in the past or does not last.
        """
        start_s = self._coming(start_s, stop_s)
        capture = Capture(self, start_s, stop_s)
        self._observe(capture)
        return capture

    def record(self) -> Recording:
        """Keep all that happens from now on, until the recording is closed."""
        self.advance()
        recording = Recording(self, self.reached_s)
        self._observers.append(recording)
        return recording

    def trace(self, span_s: float) -> Trace:
        """Keep the last `span_s` of every node from now on, until the trace is ended."""
        self.advance()
        trace = Trace(self.reached_s, span_s, self.advance, self.dismiss)
        self._observers.append(trace)
        return trace

    def _coming(self, start_s: float, stop_s: float) -> float:
        """Return the start of an observation; a start in the past by less than 1 ns is round-off and becomes now."""
        now = self.clock.now()
        if not now - _EARLY_S <= start_s < stop_s:
            raise ValueError(f"an observation from {start_s} to {stop_s} s cannot be registered at {now} s")
        return max(start_s, now)

    def _observe(self, observer: Window | Capture) -> None:
        self._observers.append(observer)
        for edge in (observer.start_s, observer.stop_s):
            if edge > self.reached_s:
                bisect.insort(self._edges_s, edge)

    def dismiss(self, observer: Recording | Trace) -> None:
        """Remove an observer."""
        if observer in self._observers:
            self._observers.remove(observer)

    @staticmethod
    def _require(name: str, known: tuple[str, ...]) -> None:
        if name not in known:
            raise ValueError(f"{name!r} is none of {', '.join(known)}")
