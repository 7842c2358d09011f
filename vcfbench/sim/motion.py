"""True motion of the rate table: trapezoid, rate loop, mean-rate error, angle-locked ripple, coasting.

A command makes a plan of segments from now on. In each segment the true rate is a sum of exponentials, known in
closed form at any time, and the gyro takes exactly that sum as its input. The ripple (*wow*) turns with the profile
at constant rate and is left out during ramps, where it would be a chirp of some ten ppm of the rate.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from vcfbench.clock import Clock
    from vcfbench.sim.parameters import TableMechanics

__all__ = ["MEMORY_S", "RateSegment", "TableMotion"]

ARCSEC = math.pi / 648000.0
MEMORY_S = 1.0
"""For how long the motion before a command can be looked back at."""


@dataclass(frozen=True, slots=True)
class RateSegment:
    """True rate over [start_s, stop_s): `rate + slope t + Re sum a exp(s t)` in deg/s, t from `start_s`."""

    start_s: float
    stop_s: float
    angle_deg: float
    rate_deg_s: float
    slope_deg_s2: float
    terms: tuple[tuple[complex, complex], ...]

    def rate_at(self, instant_s: float) -> float:
        """Return the true rate at bench time `instant_s`, deg/s."""
        t = instant_s - self.start_s
        return self.rate_deg_s + self.slope_deg_s2 * t + sum((a * cmath.exp(s * t)).real for a, s in self.terms)

    def angle_at(self, instant_s: float) -> float:
        """Return the true angle at bench time `instant_s`, deg, unwrapped."""
        t = instant_s - self.start_s
        turned = self.rate_deg_s * t + 0.5 * self.slope_deg_s2 * t * t
        return self.angle_deg + turned + sum((a * (cmath.exp(s * t) - 1) / s).real for a, s in self.terms)


@dataclass(frozen=True, slots=True)
class _Profile:
    """One piece of the commanded trapezoid and the state of the rate loop at its start."""

    start_s: float
    rate_deg_s: float
    slope_deg_s2: float
    loop_deg_s: float
    loop_deg_s2: float


class TableMotion:
    """The table as it really moves; simulated controllers of any dialect act on it.

    `before_change` is called before each command, so that whoever follows the motion can catch up with the old plan.
    """

    def __init__(self, clock: Clock, mechanics: TableMechanics, before_change: Callable[[], None]) -> None:
        self._clock = clock
        self._mechanics = mechanics
        self._before_change = before_change
        self._servo_closed = False
        self._complete_s = -math.inf
        natural, damping = 2 * math.pi * mechanics.loop_hz, mechanics.loop_damping
        self._lag_s = 2 * damping / natural
        self._pole = complex(-damping * natural, natural * math.sqrt(1 - damping**2))
        self._profiles: list[_Profile] = []
        self._segments = [RateSegment(clock.now(), math.inf, 0.0, 0.0, 0.0, ())]
        self._past: list[RateSegment] = []

    @property
    def servo_closed(self) -> bool:
        """Whether the servo holds the table to the profile."""
        return self._servo_closed

    def demand_rate(self, rate_deg_s: float, acceleration_deg_s2: float) -> None:
        """Ramp the profile from where it is to `rate_deg_s`, starting now.

        Raises:
            RuntimeError: the servo is open.
            ValueError: the acceleration is not positive.
        """
        if not self._servo_closed:
            raise RuntimeError("the servo is open: the table takes no rate demand")
        if acceleration_deg_s2 <= 0:
            raise ValueError("the acceleration must be positive")
        self._before_change()
        now = self._clock.now()
        self._remember(now)
        angle, profile, loop, loop_slope = self.angle_deg(), self.profile_rate_deg_s(), *self._loop_at(now)
        self._plan_demand(now, angle, profile, rate_deg_s, acceleration=acceleration_deg_s2, loop=(loop, loop_slope))

    def close_servo(self) -> None:
        """Close the servo: the profile holds the rate that the table has now."""
        if self._servo_closed:
            return
        self._before_change()
        now, rate, angle = self._clock.now(), self.rate_deg_s(), self.angle_deg()
        self._remember(now)
        self._servo_closed = True
        loop = rate / (1 + self._mechanics.rate_error)
        self._plan_demand(now, angle, loop, loop, acceleration=1.0, loop=(loop, 0.0))

    def open_servo(self) -> None:
        """Open the servo: dry and viscous friction bring the table to rest."""
        if not self._servo_closed:
            return
        self._before_change()
        now, rate, angle = self._clock.now(), self.rate_deg_s(), self.angle_deg()
        self._remember(now)
        self._servo_closed = False
        self._profiles, self._complete_s = [], -math.inf
        tau, dry = self._mechanics.friction_time_s, math.copysign(self._mechanics.friction_deg_s2, rate)
        stop = now + tau * math.log1p(abs(rate) / (abs(dry) * tau))
        coast = RateSegment(now, stop, angle, -dry * tau, 0.0, ((complex(rate + dry * tau), complex(-1 / tau)),))
        self._segments = [coast, RateSegment(stop, math.inf, coast.angle_at(stop), 0.0, 0.0, ())]

    def rate_deg_s(self) -> float:
        """Return the true rate now, deg/s."""
        now = self._clock.now()
        return self.segment(now).rate_at(now)

    def angle_deg(self) -> float:
        """Return the true angle turned so far, deg, unwrapped."""
        now = self._clock.now()
        return self.segment(now).angle_at(now)

    def past_angle_deg(self, ago_s: float) -> float:
        """Return the true angle `ago_s` ago, at most `MEMORY_S`, deg; before there was a table it stood at 0."""
        instant = self._clock.now() - ago_s
        for each in (*reversed(self._segments), *reversed(self._past)):
            if each.start_s <= instant:
                return each.angle_at(instant)
        return 0.0

    def profile_rate_deg_s(self) -> float:
        """Return the rate that the trapezoid has reached now, deg/s; with the servo open the true rate."""
        now = self._clock.now()
        profile = self._profile_at(now)
        return self.rate_deg_s() if profile is None else _profile_rate(profile, now)

    def profile_complete(self) -> bool:
        """Tell whether the trapezoid has reached the demand."""
        return self._clock.now() >= self._complete_s

    def _remember(self, now_s: float) -> None:
        """Keep what a new command is about to replace, for those who look back."""
        self._past = [each for each in (*self._past, *self._segments) if now_s - MEMORY_S < each.stop_s]
        self._past = [each for each in self._past if each.start_s < now_s]

    def segment(self, instant_s: float) -> RateSegment:
        """Return the segment that holds at bench time `instant_s`, not before the latest command."""
        for each in self._segments:
            if instant_s < each.stop_s:
                return each
        return self._segments[-1]

    def _profile_at(self, instant_s: float) -> _Profile | None:
        passed = [each for each in self._profiles if each.start_s <= instant_s]
        return passed[-1] if passed else None

    def _loop_at(self, instant_s: float) -> tuple[float, float]:
        """Return rate and acceleration of the rate loop, before the mean-rate error and ripple."""
        profile = self._profile_at(instant_s)
        return (0.0, 0.0) if profile is None else self._loop_after(profile, instant_s)

    def _loop_after(self, profile: _Profile, instant_s: float) -> tuple[float, float]:
        t = instant_s - profile.start_s
        free = self._free(profile) * cmath.exp(self._pole * t)
        steady = _profile_rate(profile, instant_s) - self._lag_s * profile.slope_deg_s2
        return steady + free.real, profile.slope_deg_s2 + (self._pole * free).real

    def _free(self, profile: _Profile) -> complex:
        """Return c of the loop's free motion Re(c exp(pole t)), of u'' + 2 zeta w u' + w^2 u = w^2 r."""
        rate = profile.loop_deg_s - (profile.rate_deg_s - self._lag_s * profile.slope_deg_s2)
        slope = profile.loop_deg_s2 - profile.slope_deg_s2
        return complex(rate, (self._pole.real * rate - slope) / self._pole.imag)

    def _plan_demand(
        self, now: float, angle: float, start: float, goal: float, *, acceleration: float, loop: tuple[float, float]
    ) -> None:
        duration = abs(goal - start) / acceleration
        self._complete_s = now + duration
        self._profiles, self._segments = [], []
        if duration > 0:
            ramp = _Profile(now, start, math.copysign(acceleration, goal - start), *loop)
            self._profiles.append(ramp)
            self._segments.append(self._follow(ramp, self._complete_s, angle))
            loop = self._loop_after(ramp, self._complete_s)
            angle = self._segments[-1].angle_at(self._complete_s)
        flat = _Profile(self._complete_s, goal, 0.0, *loop)
        self._profiles.append(flat)
        self._segments.append(self._follow(flat, math.inf, angle))

    def _follow(self, profile: _Profile, stop_s: float, angle: float) -> RateSegment:
        scale = 1 + self._mechanics.rate_error
        steady = scale * (profile.rate_deg_s - self._lag_s * profile.slope_deg_s2)
        free = (scale * self._free(profile), self._pole)
        ripple = self._ripple(profile, angle) if stop_s == math.inf and profile.rate_deg_s else ()
        return RateSegment(profile.start_s, stop_s, angle, steady, scale * profile.slope_deg_s2, (free, *ripple))

    def _ripple(self, profile: _Profile, angle: float) -> Sequence[tuple[complex, complex]]:
        """Return the oscillators of the angle error sum A sin(k angle + phase), once the loop has settled."""
        scale, lead = 1 + self._mechanics.rate_error, self._settled_lead(profile)
        origin, turning = math.radians(angle + scale * lead), math.radians(scale * profile.rate_deg_s)
        harmonics = zip(
            self._mechanics.ripple_arcsec,
            self._mechanics.ripple_harmonic,
            self._mechanics.ripple_phase_rad,
            strict=True,
        )
        return [
            (
                scale * profile.rate_deg_s * k * size * ARCSEC * cmath.exp(1j * (k * origin + phase)),
                complex(0.0, k * turning),
            )
            for size, k, phase in harmonics
        ]

    def _settled_lead(self, profile: _Profile) -> float:
        """Return the angle by which the settling loop runs ahead of the profile in the end, deg."""
        natural_squared = abs(self._pole) ** 2
        rate = profile.loop_deg_s - profile.rate_deg_s
        return (profile.loop_deg_s2 - 2 * self._pole.real * rate) / natural_squared


def _profile_rate(profile: _Profile, instant_s: float) -> float:
    return profile.rate_deg_s + profile.slope_deg_s2 * (instant_s - profile.start_s)
