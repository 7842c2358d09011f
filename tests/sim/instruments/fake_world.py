"""A World of closed forms: a node's voltage is a function of time, its mean over a window is exact."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from vcfbench.clock import VirtualClock
from vcfbench.sim.attendance import AttendedClock

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from vcfbench.sim.sources import Ripple


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

    def samples(self, node: str, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        assert node == "output"
        world = self.world
        return world.offset_v + world.amplitude_v * np.sin(2 * np.pi * world.frequency_hz * times_s)


class FakeWorld:
    """A node "output" that is offset + slope t (windows) or offset + sine (captures), and resistive rails."""

    def __init__(self) -> None:
        self.clock = AttendedClock(VirtualClock())
        self.offset_v = 1.25
        self.slope_v_s = 0.0
        self.amplitude_v = 0.0
        self.frequency_hz = 0.0
        self.load_ohm = {"positive": 100.0, "negative": 100.0}
        self.rails: list[tuple[float, str, float]] = []
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

    def on_load(self, regulate: Callable[[], None]) -> None:
        self.on_load_change = regulate

    def set_ripple(self, rail: str, ripple: Ripple | None) -> None:
        self.ripples[rail] = ripple

    def set_rail(self, rail: str, voltage_v: float) -> None:
        self.rails.append((self.clock.now(), rail, voltage_v))

    def rail_v(self, rail: str) -> float:
        return next((volts for _, name, volts in reversed(self.rails) if name == rail), 0.0)

    def rail_current_a(self, rail: str, voltage_v: float) -> float:
        return abs(voltage_v) / self.load_ohm[rail]
