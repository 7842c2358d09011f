"""What an oscilloscope's inputs see of the World, before its converter."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Protocol

import numpy as np
from msgspec import Struct

if TYPE_CHECKING:
    from collections.abc import Hashable, Mapping

    from numpy.typing import NDArray

    from vcfbench.clock import Clock

__all__ = ["EXTERNAL", "LINE", "Capture", "ChannelView", "Recording", "ScopeWorld", "Screen", "Signals", "seen"]

LINE, EXTERNAL = 0, 5
"""Numbers of the trigger inputs that are no channels; nothing is plugged in at EXTernal."""
MAINS_HZ = 50.0


class Capture(Protocol):
    """A stretch of time of the World."""

    def samples(self, node: str, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the node's volts at absolute times."""
        ...

    def finest_s(self, node: str) -> float:
        """Return a time in which the node's voltage bends so little that a cubic tells it; 0 where that is unknown."""
        ...

    def whole(self, start_s: float, stop_s: float) -> bool:
        """Tell whether nothing happened between two times that could make a node jump."""
        ...


class Recording(Capture, Protocol):
    """A stretch of time without an end yet."""

    def forget(self, before_s: float) -> None:
        """Drop what was over before a time."""
        ...

    def close(self) -> None:
        """Keep what there is and take nothing more."""
        ...


class ScopeWorld(Protocol):
    """What the oscilloscope needs of the World."""

    @property
    def clock(self) -> Clock:
        """Bench time."""
        ...

    def capture(self, start_s: float, stop_s: float) -> Capture:
        """Register a stretch of time."""
        ...

    def record(self) -> Recording:
        """Keep all that happens from now on."""
        ...

    def load_node(self, who: Hashable, node: str, resistance_ohm: float) -> None:
        """Hang a resistance on a node; inf takes it off."""
        ...


class Screen(Struct, frozen=True):
    """The time window that is shown: from `left_s` for `range_s`, trigger at 0."""

    left_s: float
    range_s: float

    @property
    def right_s(self) -> float:
        """The end of the window, s."""
        return self.left_s + self.range_s

    def times_s(self, points: int, start: int = 0, count: int | None = None) -> NDArray[np.float64]:
        """Return the sample times of `points` from the left edge, or `count` of them from the `start`-th on."""
        stop = points if count is None else start + count
        return self.left_s + np.arange(start, stop, dtype=np.float64) * (self.range_s / points)


class ChannelView(Struct, frozen=True):
    """How a channel looks at its node."""

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

    @property
    def shown_per_real(self) -> float:
        """Displayed over real volts, with the sign."""
        return -self.probe if self.inverted else self.probe


def seen(capture: Capture, view: ChannelView, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return displayed volts at absolute times, before AC coupling and the channel's own errors."""
    if view.node is None:
        return np.zeros(len(times_s))
    volts = np.asarray(capture.samples(view.node, times_s), dtype=np.float64)
    return volts * view.shown_per_real


class Signals(Struct, frozen=True):
    """What the trigger circuits see: the channels, the mains, the empty EXTernal input."""

    capture: Capture
    views: Mapping[int, ChannelView]

    def volts(self, channel: int, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return displayed volts at absolute times."""
        if channel == LINE:
            return np.sin(2.0 * math.pi * MAINS_HZ * times_s)
        view = self.views.get(channel)
        return np.zeros(len(times_s)) if view is None else seen(self.capture, view, times_s)

    def finest_s(self, channel: int) -> float:
        """Return a time in which an input bends so little that a cubic tells it; 0 where that is unknown."""
        if channel == LINE:
            return 0.05 / (2.0 * math.pi * MAINS_HZ)
        view = self.views.get(channel)
        return math.inf if view is None or view.node is None else self.capture.finest_s(view.node)
