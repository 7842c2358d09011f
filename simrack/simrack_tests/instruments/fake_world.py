"""A World of closed forms: a node's voltage is a function of time, its mean over a window is exact."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from simrack.attendance import AttendedClock
from simrack.clock import VirtualClock
from simrack.sources import Sine
from simrack.trace import Piece

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from simrack.sources import Approach, Played, Ripple


@dataclass(frozen=True)
class FakeWindow:
    world: FakeWorld
    start_s: float
    stop_s: float

    def mean_v(self) -> float:
        """Mean of offset + slope t, exact."""
        assert self.world.clock.now() >= self.stop_s - 1e-12
        return self.world.offset_v + self.world.slope_v_s * (self.start_s + self.stop_s) / 2


@dataclass(frozen=True)
class FakeCapture:
    world: FakeWorld

    def fed(self, node: str) -> bool:
        assert node == "output"
        return False

    def samples(self, node: str, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        assert node == "output"
        world = self.world
        return world.offset_v + world.amplitude_v * np.sin(2 * np.pi * world.frequency_hz * times_s)


Waveform = Callable[["NDArray[np.float64]"], "NDArray[np.float64]"]


class FakeHistory:
    """What the node did since the history was begun: sines, or a waveform that can only be asked for its volts."""

    def __init__(self, world: FakeWorld) -> None:
        self.world = world
        self.start_s = world.clock.now()

    def pieces(self, node: str) -> list[Piece]:
        assert node == "output"
        now = self.world.clock.now()
        changes = [*self.world.signals, (now, ())]
        parts = [(max(start, self.start_s), stop, signal) for (start, signal), (stop, _) in pairwise(changes)]
        return [self._piece(start, stop, signal) for start, stop, signal in parts if stop > start]

    def _piece(self, start_s: float, stop_s: float, signal: tuple[Sine, ...] | Waveform | Played) -> Piece:
        if not isinstance(signal, tuple) and hasattr(signal, "components"):
            return Piece(start_s, stop_s, 0.0, None, signal.at, source=(signal, 1.0))
        if not isinstance(signal, tuple):
            return Piece(start_s, stop_s, 0.0, None, signal)
        turned = tuple(
            Sine(each.amplitude_v, each.frequency_hz, each.phase_rad + math.tau * each.frequency_hz * start_s)
            for each in signal
        )
        return Piece(start_s, stop_s, self.world.offset_v, turned, lambda times: self._sum(signal, times))

    def _sum(self, sines: tuple[Sine, ...], times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(
            self.world.offset_v
            + sum(each.amplitude_v * np.sin(math.tau * each.frequency_hz * times_s + each.phase_rad) for each in sines)
        )

    def end(self) -> None:
        """Nothing is kept anyway."""


class FakeWorld:
    """A node "output" that is offset + slope t (windows) or offset + sine (captures), and resistive rails."""

    def __init__(self) -> None:
        self.clock = AttendedClock(VirtualClock())
        self.offset_v = 1.25
        self.slope_v_s = 0.0
        self.amplitude_v = 0.0
        self.frequency_hz = 0.0
        self.resistance_ohm = math.inf
        self.signals: list[tuple[float, tuple[Sine, ...] | Waveform | Played]] = [(0.0, ())]
        self.load_ohm = {"positive": 100.0, "negative": 100.0}
        self.rails: list[tuple[float, str, Approach]] = []
        self.windows: list[tuple[float, float]] = []
        self.ripples: dict[str, Ripple | None] = {}

    def value_v(self, node: str) -> float:
        assert node == "output"
        return self.offset_v + self.slope_v_s * self.clock.now()

    def window(self, node: str, start_s: float, stop_s: float) -> FakeWindow:
        assert node == "output"
        assert start_s >= self.clock.now()
        self.windows.append((start_s, stop_s))
        return FakeWindow(self, start_s, stop_s)

    def capture(self, start_s: float, stop_s: float) -> FakeCapture:
        assert self.clock.now() <= start_s < stop_s
        return FakeCapture(self)

    def play(self, *sines: Sine, waveform: Waveform | None = None, source: Played | None = None) -> None:
        """Change what is on the node from now on, beside its direct voltage; a waveform is of bench time."""
        self.signals.append((self.clock.now(), source or waveform or sines))

    def trace(self, span_s: float) -> FakeHistory:
        assert span_s >= 7.0
        return FakeHistory(self)

    def source_ohm(self, node: str) -> float:
        assert node == "output"
        return self.resistance_ohm

    def on_load(self, regulate: Callable[[], None]) -> None:
        self.on_load_change = regulate

    def set_ripple(self, rail: str, ripple: Ripple | None) -> None:
        self.ripples[rail] = ripple

    def move_rail(self, rail: str, approach: Approach) -> None:
        self.rails.append((self.clock.now(), rail, approach))

    def rail_v(self, rail: str, instant_s: float | None = None) -> float:
        """The rail now, or at an instant."""
        instant = self.clock.now() if instant_s is None else instant_s
        ways = (way for start, name, way in reversed(self.rails) if name == rail and start <= instant)
        return next((way.at(instant) for way in ways), 0.0)

    def drawing(self) -> None:
        """Say nothing: its loads are looked at each time."""

    def rail_current_a(self, rail: str, voltage_v: float) -> float:
        return abs(voltage_v) / self.load_ohm[rail]
