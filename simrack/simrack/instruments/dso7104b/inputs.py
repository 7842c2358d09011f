"""Inputs of an oscilloscope, before its converter."""

from __future__ import annotations

import math
from collections.abc import Generator, Hashable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np
from msgspec import Struct

from simrack.clock import Clock
from simrack.components import ended
from simrack.instruments.dso7104b.filters import (
    UNKNOWN_AT_ONCE,
    Capacitor,
    Sines,
    closed_form,
    looks,
    low_passed,
    time_constant_s,
)
from simrack.trace import History, Piece

if TYPE_CHECKING:
    from numpy.typing import NDArray

LINE, EXTERNAL = 0, 5
"""Numbers of the trigger inputs that are no channels; nothing is plugged in at EXTernal."""
MAINS_HZ = 50.0
_TOUCHING_S = 1e-9


class ChannelCapture(Protocol):
    """A stretch of time of the World."""

    def samples(self, node: str, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the node's volts at absolute times."""

    def finest_s(self, node: str) -> float:
        """Return a time within which a cubic describes the node's voltage; 0 if unknown."""

    def whole(self, start_s: float, stop_s: float) -> bool:
        """Return True if nothing happened between two times that could make a node jump."""

    def pieces(self, node: str) -> list[Piece]:
        """Return the pieces known of a node up to now, oldest first."""


class ChannelRecording(ChannelCapture, Protocol):
    """A stretch of time without an end yet."""

    def forget(self, before_s: float) -> None:
        """Drop everything that was over before a time."""

    def close(self) -> None:
        """Keep the pieces so far and take nothing more."""


class ScopeWorld(Protocol):
    """The part of the World that the oscilloscope needs."""

    @property
    def clock(self) -> Clock:
        """Bench time."""

    def capture(self, start_s: float, stop_s: float) -> ChannelCapture:
        """Register a stretch of time."""

    def record(self) -> ChannelRecording:
        """Keep all that happens from now on."""

    def trace(self, span_s: float) -> History:
        """Keep the last `span_s` from now on."""

    def load_node(self, who: Hashable, node: str, resistance_ohm: float) -> None:
        """Hang a resistance on a node; inf takes it off."""


class Screen(Struct, frozen=True):
    """The time window that is shown: from `left_s` for `range_s`, trigger at 0."""

    left_s: float
    range_s: float

    def times_s(self, points: int, start: int = 0, count: int | None = None) -> NDArray[np.float64]:
        """Return the sample times of `points` from the left edge, or `count` of them from the `start`-th on."""
        stop = points if count is None else start + count
        times = np.arange(start, stop, dtype=np.float64)
        times *= self.range_s / points
        times += self.left_s
        return times


class ChannelView(Struct, frozen=True):
    """View of a channel on its node."""

    node: str | None
    """Node of the PCB; None for an open input."""
    range_v: float
    """Full screen, displayed volts."""
    offset_v: float
    """Displayed volts at the centre of the screen."""
    probe: float
    """Displayed over real volts."""
    inverted: bool
    ac: bool
    skew_s: float = 0.0
    """How much later the channel is shown than it is."""
    limit_hz: float = math.inf
    """Corner of the bandwidth limit."""

    @property
    def shown_per_real(self) -> float:
        """Displayed over real volts, with the sign."""
        return -self.probe if self.inverted else self.probe

    @property
    def remembered_s(self) -> float:
        """Time before an instant that its filters need, s; nor is it shown when it is."""
        return abs(self.skew_s) + (20.0 * time_constant_s(self.limit_hz) if math.isfinite(self.limit_hz) else 0.0)


def finest_so_far_s(capture: ChannelCapture, node: str) -> float:
    """Return a capture's `finest_s` of all up to now: where nobody has looked yet, it does not know what there is."""
    finest = capture.finest_s(node)
    if math.isinf(finest):
        capture.pieces(node)
        finest = capture.finest_s(node)
    return finest


class Signals:
    """Signals at converters and trigger circuits: the channels, the mains, the empty EXTernal input.

    Args:
        capture: the stretch of time.
        views: how each channel looks at its node.
        past: what is known of a channel's node before that, oldest first, where a blocking capacitor is to know it.
    """

    def __init__(
        self,
        capture: ChannelCapture,
        views: Mapping[int, ChannelView],
        past: Mapping[int, Sequence[Piece]] | None = None,
    ) -> None:
        self.capture = capture
        self.views = views
        self._past = past or {}
        self._capacitors: dict[int, tuple[float, Capacitor]] = {}

    def volts(self, channel: int, times_s: NDArray[np.float64], *, ac: bool = False) -> NDArray[np.float64]:
        """Return displayed volts at evenly spaced bench times, before the channel's own errors; `ac` is the trigger's.

        Coupling of channel and trigger together count once.
        """
        if channel == LINE:
            return np.sin(2.0 * math.pi * MAINS_HZ * times_s)
        view = self.views.get(channel)
        if view is None or view.node is None:
            return np.zeros(len(times_s))
        real_s = times_s - view.skew_s if view.skew_s else times_s
        volts = self._limited(view, view.node, real_s)
        if view.ac or ac:
            volts = volts - self._blocked(channel, view.node, real_s)
        return volts * view.shown_per_real

    def _limited(self, view: ChannelView, node: str, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        def read(at_s: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.asarray(self.capture.samples(node, at_s), dtype=np.float64)

        if math.isinf(view.limit_hz):
            return read(times_s)
        tau_s = time_constant_s(view.limit_hz)
        known = closed_form(self.capture.pieces(node), float(times_s[0]), float(times_s[-1]))
        if known is not None:
            return known.low_passed(tau_s).at(times_s)
        return low_passed(read, times_s, tau_s, self.capture.finest_s(node))

    def at_once(self, channel: int, step_s: float, most: int) -> int:
        """Return how many values of an input, `step_s` apart, are one slice of work; of a known one `most`."""
        view = self.views.get(channel)
        if view is None or view.node is None or finest_so_far_s(self.capture, view.node):
            return most
        each = 1 if math.isinf(view.limit_hz) else looks(step_s, time_constant_s(view.limit_hz), 0.0)
        return min(most, UNKNOWN_AT_ONCE // each)

    def preparing(self, channel: int, *, ac: bool = False) -> Iterator[None]:
        """Charge the blocking capacitor of an input, if it has one, slice by slice; else :meth:`volts` does it."""
        view = self.views.get(channel)
        if view is not None and view.node is not None and (view.ac or ac):
            yield from self._charging(channel, view.node)

    def _blocked(self, channel: int, node: str, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the voltage of an input's blocking capacitor; 0 where the lead hangs free."""
        charged = ended(self._charging(channel, node))
        return np.zeros(len(times_s)) if charged is None else charged.at(times_s)

    def _charging(self, channel: int, node: str) -> Generator[None, None, Capacitor | None]:
        pieces = self.capture.pieces(node)
        if not pieces:
            return None
        until_s = pieces[-1].stop_s
        made = self._capacitors.get(channel)
        if made is None or made[0] != until_s:
            past = self._past.get(channel, ())
            before = past if past and abs(past[-1].stop_s - pieces[0].start_s) < _TOUCHING_S else ()
            made = until_s, Capacitor([*before, *pieces], self.capture.finest_s(node))
            yield from made[1].charging()
            self._capacitors[channel] = made
        return made[1]

    def sines(self, channel: int, start_s: float, stop_s: float) -> Sines | None:
        """Return an input in closed form, displayed volts before AC coupling; None where it has none."""
        view = self.views.get(channel)
        if view is None or view.node is None:
            return None
        known = closed_form(self.capture.pieces(view.node), start_s - view.skew_s, stop_s - view.skew_s)
        if known is None:
            return None
        limited = known if math.isinf(view.limit_hz) else known.low_passed(time_constant_s(view.limit_hz))
        return limited.scaled(view.shown_per_real).later(view.skew_s)

    def slow(self, channel: int, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the voltage that AC coupling takes off an input, displayed volts at bench times."""
        view = self.views.get(channel)
        if view is None or view.node is None:
            return np.zeros(len(times_s))
        return self._blocked(channel, view.node, times_s - view.skew_s) * view.shown_per_real

    def finest_s(self, channel: int) -> float:
        """Return a time within which a cubic describes an input; 0 if unknown."""
        if channel == LINE:
            return 0.05 / (2.0 * math.pi * MAINS_HZ)
        view = self.views.get(channel)
        return math.inf if view is None or view.node is None else self.capture.finest_s(view.node)
