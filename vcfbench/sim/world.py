"""The one physical world that all simulated instruments look at."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from vcfbench.sim.motion import TableMotion

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from vcfbench.clock import Clock
    from vcfbench.sim.parameters import BenchParameters

__all__ = ["Capture", "Drive", "Window", "World"]


@dataclass(frozen=True, slots=True)
class Drive:
    """What a generator puts out, open circuit: dc_v + amplitude_v sin(2 pi frequency_hz t + phase_rad), bench time."""

    dc_v: float
    amplitude_v: float = 0.0
    frequency_hz: float = 0.0
    phase_rad: float = 0.0
    source_ohm: float = 50.0


class Window:
    """An averaging window on a node."""

    def __init__(self, world: World, node: str, start_s: float, stop_s: float) -> None:
        self._world, self.node, self.start_s, self.stop_s = world, node, start_s, stop_s

    def mean_v(self) -> float:
        """Return the mean voltage over the window."""
        return self._world.value_v(self.node)


class Capture:
    """A stretch of time in which waveforms can be looked at."""

    def __init__(self, world: World, start_s: float, stop_s: float) -> None:
        self._world, self.start_s, self.stop_s = world, start_s, stop_s

    def samples(self, node: str, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the node's volts at absolute times within the capture."""
        import numpy as np  # noqa: PLC0415

        amplitude = {"drive": 1.0, "carrier": 2.0, "sense": 0.1}
        if node in amplitude and self._world.powered:
            return amplitude[node] * np.sin(2 * math.pi * 3488.9 * np.asarray(times_s))
        return np.full(np.shape(times_s), self._world.value_v(node))


class World:
    """First simple body: quasi-static gain; the full model replaces it behind the same names."""

    def __init__(self, clock: Clock, parameters: BenchParameters, seed: int) -> None:
        self.clock = clock
        self.parameters = parameters
        self.seed = seed
        self.table = TableMotion(clock, parameters.table, lambda: None)
        self._rails = {"positive": 0.0, "negative": 0.0}
        self._drive: Drive | None = None

    @property
    def powered(self) -> bool:
        """Whether both rails are up."""
        return self._rails["positive"] > 8 and self._rails["negative"] < -8

    def set_rail(self, rail: str, voltage_v: float) -> None:
        """Set the voltage really present at the pin from now on, signed: "positive" +10 V, "negative" -10 V."""
        self._rails[rail] = voltage_v

    def rail_current_a(self, rail: str, voltage_v: float) -> float:
        """Return the magnitude of the current that the PCB would draw from `rail` now at `voltage_v`."""
        del rail
        return self.parameters.supply.quiescent_a * min(1.0, abs(voltage_v) / self.parameters.supply.brown_out_v)

    def drive_v_vc(self, source: Drive | None) -> None:
        """Connect a generator to the V_Vc input, or None: the pull-down holds it and the modulator's switch opens."""
        self._drive = source

    def window(self, node: str, start_s: float, stop_s: float) -> Window:
        """Register an averaging window."""
        return Window(self, node, start_s, stop_s)

    def value_v(self, node: str) -> float:
        """Return the node's voltage now."""
        if node == "rail_positive":
            return self._rails["positive"]
        if node == "rail_negative":
            return self._rails["negative"]
        v_vc = 0.0 if self._drive is None else self._drive.dc_v
        if node == "v_vc":
            return v_vc
        if node != "output" or not self.powered:
            return 0.0
        switched = 0.0 if self._drive is None else self.parameters.virtual_path.offset_v
        rate = self.table.rate_deg_s() + 40.0 * (v_vc + switched)
        return -0.012542 * rate + self.parameters.output_stage.offset_v

    def capture(self, start_s: float, stop_s: float) -> Capture:
        """Register a stretch of time whose waveforms will be asked for."""
        return Capture(self, start_s, stop_s)
