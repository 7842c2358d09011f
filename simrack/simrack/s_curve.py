"""Ramps of a rate within an acceleration and a jerk, the parts of a motion controller's profile.

The time-optimal way from one rate to another, which ends without acceleration: the acceleration grows by the jerk,
stays at its limit where there is time, and goes by the jerk. Without a limit of the jerk it steps, and the ramp is
straight.
"""

from __future__ import annotations

import math

from msgspec import Struct

_NOTHING_S = 1e-12


class JerkSegment(Struct, frozen=True):
    """A time of constant jerk: its length, rate and acceleration at its start, jerk; s, deg."""

    lasts_s: float
    rate_deg_s: float
    acceleration_deg_s2: float
    jerk_deg_s3: float = 0.0

    def rate_at(self, time_s: float) -> float:
        """Return the rate `time_s` after the start, deg/s."""
        return self.rate_deg_s + time_s * (self.acceleration_deg_s2 + 0.5 * time_s * self.jerk_deg_s3)

    def way_deg(self) -> float:
        """Return the angle turned, deg."""
        t = self.lasts_s
        return t * (self.rate_deg_s + t * (self.acceleration_deg_s2 / 2.0 + t * self.jerk_deg_s3 / 6.0))


def ramp(
    rate_deg_s: float, acceleration_deg_s2: float, goal_deg_s: float, *, most_deg_s2: float, jerk_deg_s3: float
) -> list[JerkSegment]:
    """Return the way from a rate that changes by `acceleration_deg_s2` now to `goal_deg_s`, none where it is there.

    Within `most_deg_s2` and `jerk_deg_s3`, both above 0; an infinite jerk forgets the acceleration of now. One that is
    beyond its limit is brought down to it.
    """
    if math.isinf(jerk_deg_s3):
        change = goal_deg_s - rate_deg_s
        return (
            [JerkSegment(abs(change) / most_deg_s2, rate_deg_s, math.copysign(most_deg_s2, change))] if change else []
        )
    a, j = acceleration_deg_s2, jerk_deg_s3
    way = math.copysign(1.0, goal_deg_s - rate_deg_s - a * abs(a) / (2.0 * j))  # beyond what it reaches by itself
    now, change = way * a, way * (goal_deg_s - rate_deg_s)
    peak = min(math.sqrt(max(j * change + now * now / 2.0, 0.0)), most_deg_s2)
    steep = abs(peak - now) / j
    along = (change - 0.5 * (now + peak) * steep - peak * peak / (2.0 * j)) / peak if peak else 0.0
    jerks = (math.copysign(j, peak - now), 0.0, -j)
    pieces, rate = [], rate_deg_s
    for lasts, starts, jerk in zip((steep, max(along, 0.0), peak / j), (now, peak, peak), jerks, strict=True):
        if lasts > _NOTHING_S:
            pieces.append(JerkSegment(lasts, rate, way * starts, way * jerk))
            rate = pieces[-1].rate_at(lasts)
    return pieces


def ramp_s(change_deg_s: float, most_deg_s2: float, jerk_deg_s3: float) -> float:
    """Return the time for which a change of the rate takes from constant rate to constant rate, s."""
    change = abs(change_deg_s)
    if change * jerk_deg_s3 < most_deg_s2**2:
        return 2.0 * math.sqrt(change / jerk_deg_s3)
    return change / most_deg_s2 + most_deg_s2 / jerk_deg_s3


def braking_deg(rate_deg_s: float, acceleration_deg_s2: float, *, most_deg_s2: float, jerk_deg_s3: float) -> float:
    """Return the angle turned until rest, deg."""
    pieces = ramp(rate_deg_s, acceleration_deg_s2, 0.0, most_deg_s2=most_deg_s2, jerk_deg_s3=jerk_deg_s3)
    return sum([piece.way_deg() for piece in pieces])


def peak_deg_s(distance_deg: float, most_deg_s2: float, jerk_deg_s3: float) -> float:
    """Return the rate up to which a move of this length speeds up, to brake at once, deg/s.

    Up and down, half a ramp's time each at the peak's rate: the distance is the peak times :func:`ramp_s`.
    """
    if math.isinf(jerk_deg_s3):
        return math.sqrt(most_deg_s2 * distance_deg)
    gentle = math.cbrt(0.25 * distance_deg**2 * jerk_deg_s3)
    if gentle * jerk_deg_s3 < most_deg_s2**2:
        return gentle
    lag = 0.5 * most_deg_s2**2 / jerk_deg_s3
    return math.sqrt(lag * lag + most_deg_s2 * distance_deg) - lag
