"""The 50 ohm inputs of the DSO7104B: they load the node, and switch themselves off above 5 V rms."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from simrack.instruments.dso7104b.inputs import ChannelCapture, ScopeWorld

FIFTY_OHM = 50.0
MOST_V_RMS = 5.0
"""Data sheet; what the protection measures exactly, and how fast, is not known."""
_LOOK_S = 0.01
_LOOK_POINTS = 2001


class Terminations:
    """The inputs with 50 ohm; the others, 1 Mohm parallel to 14 pF, load nothing.

    Args:
        world: where the nodes are.
        nodes: node of each channel that is wired.
        tripped: called with a channel that got too much.
    """

    def __init__(self, world: ScopeWorld, nodes: Mapping[int, str], tripped: Callable[[int], None]) -> None:
        self._world = world
        self._nodes = nodes
        self._tripped = tripped
        self._fifty: set[int] = set()
        self._look: tuple[ChannelCapture, float] | None = None
        self.due_s: float | None = None
        """When the protection has seen enough; None while it looks at nothing."""

    def terminate(self, channel: int, *, fifty: bool) -> None:
        """Switch the resistor of an input on or off; an open input feels nothing of it."""
        if channel not in self._nodes or fifty == (channel in self._fifty):
            return
        (self._fifty.add if fifty else self._fifty.discard)(channel)
        self._world.load_node((self, channel), self._nodes[channel], FIFTY_OHM if fifty else math.inf)

    def watch(self) -> None:
        """Begin to look at the voltage of the terminated inputs, unless that is under way."""
        if self._fifty and self.due_s is None:
            now = self._world.clock.now()
            self.due_s = now + _LOOK_S
            self._look = (self._world.capture(now, self.due_s), now)

    def judge(self) -> None:
        """Trip where it was too much, once the look is over."""
        if self._look is None or self.due_s is None or self._world.clock.now() < self.due_s:
            return
        (look, start_s), stop_s = self._look, self.due_s
        times = np.linspace(start_s, stop_s, _LOOK_POINTS)
        self._look = self.due_s = None
        for channel in sorted(self._fifty):
            volts = look.samples(self._nodes[channel], times)
            if math.sqrt(float(np.mean(volts**2))) > MOST_V_RMS:
                self._tripped(channel)
