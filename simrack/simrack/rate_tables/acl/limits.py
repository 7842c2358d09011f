"""Limits of the ACUTROL3000's axis, by mode and absolute, and the states that the host demands of it."""

from __future__ import annotations

import math

from msgspec import Struct

from simrack.rate_tables.acl.language import MODES, OUT_OF_RANGE, Refusal, check_within

FRAME_S = 1e-4
"""One frame of the profiler, at its 10 kHz (ACUTROL3000e data sheet): in less than that the acceleration steps."""
UNLIMITED_DEG = 1e9
"""Where an axis that turns on and on has its ends of travel."""


class AxisLimits(Struct, frozen=True):
    """Working limits of one profiler mode: deg/s, deg/s2, deg/s3."""

    rate_deg_s: float
    acceleration_deg_s2: float
    jerk_deg_s3: float

    @property
    def ramps(self) -> tuple[float, float]:
        """The acceleration and jerk of its ramps; an infinite jerk where a frame is enough to reach the acceleration.

        That every mode's profile obeys the jerk limit, ABORT's too, is what the manual's limits say; unverified.
        """
        steps = self.acceleration_deg_s2 <= self.jerk_deg_s3 * FRAME_S
        return self.acceleration_deg_s2, math.inf if steps else self.jerk_deg_s3

    @property
    def inhibits(self) -> bool:
        """True if nothing may change, not even to stop: acceleration or jerk is 0."""
        return self.acceleration_deg_s2 == 0.0 or self.jerk_deg_s3 == 0.0

    def values(self) -> tuple[float, float, float]:
        """Return them in the order in which the controller lists them."""
        return self.rate_deg_s, self.acceleration_deg_s2, self.jerk_deg_s3


class OverallLimits(Struct, frozen=True):
    """Limits that hold in every mode."""

    low_deg: float
    high_deg: float
    trip_deg_s: float
    tracking_deg: float

    def values(self) -> tuple[float, float, float, float]:
        """Return them in the order in which the controller lists them."""
        return self.low_deg, self.high_deg, self.trip_deg_s, self.tracking_deg


FACTORY = AxisLimits(1000.0, 4200.0, 1e6)
"""Rate and acceleration of the BD125 table without load (its data sheet)."""
FACTORY_OVERALL = OverallLimits(-UNLIMITED_DEG, UNLIMITED_DEG, 1200.0, 10.0)
_POWER_ON = AxisLimits(1000.0, 100.0, 1e6)
_POWER_ON_OVERALL = OverallLimits(-UNLIMITED_DEG, UNLIMITED_DEG, 1100.0, 5.0)


class AclLimits:
    """The present limits."""

    def __init__(self) -> None:
        self._by_mode = dict.fromkeys(MODES, _POWER_ON)
        self._overall = _POWER_ON_OVERALL

    @property
    def overall(self) -> OverallLimits:
        """Return the limits that hold in every mode."""
        return self._overall

    def of(self, mode: str) -> AxisLimits:
        """Return the limits of a mode."""
        return self._by_mode[mode]

    def change(self, mode: str, wanted: AxisLimits) -> None:
        """Set the limits of a mode.

        Raises:
            Refusal: beyond the factory's.
        """
        for value, most in zip(wanted.values(), FACTORY.values(), strict=True):
            check_within(value, most)
        self._by_mode[mode] = wanted

    def change_overall(self, wanted: OverallLimits) -> None:
        """Set the limits that hold in every mode.

        Raises:
            Refusal: beyond the factory's, or ends of travel that leave nothing between them.
        """
        check_within(wanted.trip_deg_s, FACTORY_OVERALL.trip_deg_s)
        check_within(wanted.tracking_deg, FACTORY_OVERALL.tracking_deg)
        if not -UNLIMITED_DEG <= wanted.low_deg < wanted.high_deg <= UNLIMITED_DEG:
            raise Refusal(OUT_OF_RANGE)
        self._overall = wanted


class Demand(Struct):
    """The demanded states; a selected mode uses its own, stale or not."""

    rate_deg_s: float = 0.0
    position_deg: float = 0.0
    acceleration_deg_s2: float = 0.0
    delta_deg: float = 0.0
    oscillator: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Magnitude of the regulated state, frequency in Hz, phase in degrees."""
