"""Temperature of the gyro: one exponential an event, and its effect on the modes."""

import math

from msgspec import Struct

from vcfbench.sim.gyro.modes import Resonance
from vcfbench.sim.parameters import DriveMode, SenseMode, Thermal


class WarmUp(Struct, frozen=True):
    """Temperature from `start_s` on: goal + (start - goal) exp(-(t - start_s)/tau)."""

    start_s: float
    start_c: float
    goal_c: float
    time_constant_s: float

    def at(self, instant_s: float) -> float:
        """Return the temperature at `instant_s`, degC."""
        return self.goal_c + (self.start_c - self.goal_c) * math.exp(-(instant_s - self.start_s) / self.time_constant_s)

    def bands(self, thermal: Thermal) -> list[tuple[float, int]]:
        """Return when each band of `refresh_k` around a multiple of it is entered, the first at `start_s`.

        The instants follow from this exponential alone, so they do not depend on how time is cut.
        """
        width = thermal.refresh_k
        first, last = math.floor(self.start_c / width + 0.5), math.floor(self.goal_c / width + 0.5)
        upward = 1 if last > first else -1
        entered = [(self.start_s, first)]
        for band in range(first + upward, last + upward, upward) if last != first else ():
            edge = (band - 0.5 * upward) * width
            left = (edge - self.goal_c) / (self.start_c - self.goal_c)
            if 0 < left <= 1:
                entered.append((self.start_s - self.time_constant_s * math.log(left), band))
        return entered


def resonance_at(mode: DriveMode | SenseMode, thermal: Thermal, temperature_c: float) -> Resonance:
    """Return a mode's frequency and quality factor at a temperature."""
    rise = temperature_c - thermal.reference_c
    natural = 2 * math.pi * mode.frequency_hz * (1 + mode.frequency_coefficient_per_k * rise)
    return Resonance(natural, mode.quality * (1 + mode.quality_coefficient_per_k * rise))
