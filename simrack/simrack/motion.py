"""True motion of the rate table: ramps, oscillation, rate loop, mean-rate error, angle-locked ripple, coasting.

A command makes a plan of segments from now on. In each segment the true rate is a sum of exponentials, known in
closed form at any time, and the gyro takes exactly that sum as its input. The ripple (*wow*, and the steps of a
stepping motor) turns with the profile at constant rate and is left out during ramps and oscillations, where it would
be a chirp of some ten ppm of the rate; so is the flutter (:mod:`simrack.flutter`), a share of the rate. What angle
it leaves behind when the rate changes the loop takes back: the angle never walks away from the profile's.
"""

from __future__ import annotations

import cmath
import math
from itertools import chain
from typing import TYPE_CHECKING

from msgspec import Struct
from msgspec.structs import replace

from simrack.s_curve import JerkSegment, ramp

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from simrack.clock import Clock
    from simrack.flutter import Flutter
    from simrack.mechanics import TableMechanics

ARCSEC = math.pi / 648000.0
_SLIGHT = 1e-4
_BENT = 0.05
_SQUARE = ((1, 1.5), (2, -0.15), (3, 1.0 / 90.0))
"""Weights of exp(k x) and exp(-k x), k each, whose sum less its value at 0 is x^2: to 3e-11 of it up to `_BENT`."""
_HALVINGS = 60
MEMORY_S = 1.0
"""For how long the motion before a command can be looked back at."""


class RateSegment(Struct, frozen=True):
    """True rate over [start_s, stop_s): `rate + slope t + Re sum a exp(s t)` in deg/s, t from `start_s`.

    And beside that `shaking_deg_s` times the flutter's rate. By `astray_deg` the angle was off at the start, beyond
    what belongs to this flutter; `terms` take it back.
    """

    start_s: float
    stop_s: float
    angle_deg: float
    rate_deg_s: float
    slope_deg_s2: float
    terms: tuple[tuple[complex, complex], ...]
    flutter: Flutter | None = None
    shaking_deg_s: float = 0.0
    astray_deg: float = 0.0
    begun_s: float = 0.0
    """The flutter's angle at the start, s/sqrt(Hz): of the rate's noise of unit density."""

    def rate_at(self, instant_s: float) -> float:
        """Return the true rate at bench time `instant_s`, deg/s."""
        t = instant_s - self.start_s
        rate = self.rate_deg_s + self.slope_deg_s2 * t + sum([(a * cmath.exp(s * t)).real for a, s in self.terms])
        return rate if self.flutter is None else rate + self.shaking_deg_s * self.flutter.rate_at(instant_s)

    def angle_at(self, instant_s: float) -> float:
        """Return the true angle at bench time `instant_s`, deg, unwrapped."""
        t = instant_s - self.start_s
        turned = self.rate_deg_s * t + 0.5 * self.slope_deg_s2 * t * t
        angle = self.angle_deg + turned + sum([(a * (cmath.exp(s * t) - 1) / s).real for a, s in self.terms])
        if self.flutter is None:
            return angle
        return angle + self.shaking_deg_s * (self.flutter.angle_at(instant_s) - self.begun_s)

    def fluttered_deg(self, instant_s: float, back_per_s: float) -> float:
        """Return the amount by which flutter has the angle off at bench time `instant_s`, deg."""
        left = self.astray_deg * math.exp(-back_per_s * (instant_s - self.start_s)) if self.astray_deg else 0.0
        return left if self.flutter is None else left + self.shaking_deg_s * self.flutter.angle_at(instant_s)

    def askew(self, share: float) -> RateSegment:
        """Return the rates along a tilted axis, each times that share; the angle is not simulated."""
        return replace(
            self,
            rate_deg_s=share * self.rate_deg_s,
            slope_deg_s2=share * self.slope_deg_s2,
            terms=tuple((share * a, s) for a, s in self.terms),
            shaking_deg_s=share * self.shaking_deg_s,
        )


class RateRipple(Struct, frozen=True):
    """A part of the angle error: `arcsec` sin(`harmonic` angle + `phase_rad`)."""

    arcsec: float
    harmonic: int
    phase_rad: float = 0.0


class Swing(Struct, frozen=True):
    """A sinusoid of the angle: amplitude now, amplitude in the end, its slew; frequency; phase now."""

    from_deg: float
    to_deg: float
    slew_deg_s: float
    frequency_hz: float
    phase_rad: float

    @property
    def lasts_s(self) -> float:
        """Time that the amplitude takes to change, s."""
        return abs(self.to_deg - self.from_deg) / self.slew_deg_s

    def growing(self) -> tuple[tuple[complex, complex], ...]:
        """Return the rate while the amplitude changes, exponents on t from now, deg/s.

        The angle is Im((b + c t) exp(i(w t + phase))); t stands for the difference of two exponentials close to each
        other, which is off by less than 1e-8 of it.
        """
        c = math.copysign(self.slew_deg_s, self.to_deg - self.from_deg)
        apart = _SLIGHT / self.lasts_s
        turning = 2j * math.pi * self.frequency_hz
        angle = [(complex(self.from_deg), turning)]
        angle += [(complex(sign * c / (2 * apart)), turning + sign * apart) for sign in (1, -1)]
        return self._rate(angle)

    def grown(self) -> tuple[tuple[complex, complex], ...]:
        """Return the rate from then on, exponents on t from then, deg/s."""
        turning = 2j * math.pi * self.frequency_hz
        return self._rate([(self.to_deg * cmath.exp(turning * self.lasts_s), turning)])

    def _rate(self, angle: Sequence[tuple[complex, complex]]) -> tuple[tuple[complex, complex], ...]:
        """Return the derivative of Im sum a exp(s t), turned by the phase, as Re sum."""
        return tuple((-1j * a * s * cmath.exp(1j * self.phase_rad), s) for a, s in angle)


class _Profile(Struct, frozen=True):
    """One piece of the commanded profile and the state of the rate loop at its start; `terms` as of a segment."""

    start_s: float
    rate_deg_s: float
    slope_deg_s2: float
    loop_deg_s: float
    loop_deg_s2: float
    terms: tuple[tuple[complex, complex], ...] = ()

    def rate_at(self, instant_s: float) -> float:
        """Return the commanded rate, deg/s."""
        t = instant_s - self.start_s
        return self.rate_deg_s + self.slope_deg_s2 * t + sum([(a * cmath.exp(s * t)).real for a, s in self.terms])

    def acceleration_at(self, instant_s: float) -> float:
        """Return the amount by which the commanded rate changes, deg/s2."""
        t = instant_s - self.start_s
        return self.slope_deg_s2 + sum((a * s * cmath.exp(s * t)).real for a, s in self.terms)


def _bent(piece: JerkSegment) -> tuple[float, tuple[tuple[complex, complex], ...]]:
    """Return 1/2 jerk t^2 of a piece as a constant and exponentials, the terms that a segment may have."""
    if not piece.jerk_deg_s3:
        return 0.0, ()
    slow = _BENT / piece.lasts_s
    size = 0.5 * piece.jerk_deg_s3 / slow**2
    terms = tuple((complex(size * weight), complex(sign * k * slow)) for k, weight in _SQUARE for sign in (1, -1))
    return -sum([a.real for a, _ in terms]), terms


class TableMotion:
    """The table as it really moves; simulated controllers of any dialect act on it.

    `before_change` is called before each command, so that whoever follows the motion can catch up with the old plan.
    Without `flutter` there is none, whatever the mechanics say of its size.
    """

    def __init__(
        self, clock: Clock, mechanics: TableMechanics, before_change: Callable[[], None], flutter: Flutter | None = None
    ) -> None:
        self._clock = clock
        self._mechanics = mechanics
        self._before_change = before_change
        self._flutter = flutter
        self.commands = 0
        """How many commands it has had: what follows from its profile holds until there is another."""
        self._servo_closed = False
        self._complete_s = -math.inf
        self._goal_deg_s = 0.0
        self._swings = False
        natural, damping = 2 * math.pi * mechanics.loop_hz, mechanics.loop_damping
        self._lag_s = 2 * damping / natural
        self._pole = complex(-damping * natural, natural * math.sqrt(1 - damping**2))
        harmonics = (mechanics.ripple_arcsec, mechanics.ripple_harmonic, mechanics.ripple_phase_rad)
        self._ripples = [RateRipple(*each) for each in zip(*harmonics, strict=True)]
        self._profiles: list[_Profile] = []
        self._segments = [RateSegment(clock.now(), math.inf, 0.0, 0.0, 0.0, ())]
        self._past: list[RateSegment] = []

    @property
    def servo_closed(self) -> bool:
        """True if the servo holds the table to the profile."""
        return self._servo_closed

    def add_ripple(self, *ripples: RateRipple) -> None:
        """Add ripple of the motor to the table, from the next command on."""
        self._ripples += ripples

    def demand_rate(self, rate_deg_s: float, acceleration_deg_s2: float, jerk_deg_s3: float = math.inf) -> None:
        """Ramp the profile from where it is to `rate_deg_s`, starting now, within an acceleration and a jerk.

        Raises:
            RuntimeError: the servo is open.
            ValueError: acceleration or jerk is not positive.
        """
        if not self._servo_closed:
            raise RuntimeError("the servo is open: close it before you set a rate")
        if not min(acceleration_deg_s2, jerk_deg_s3) > 0:
            raise ValueError("acceleration and jerk must be positive")
        self._before_change()
        now = self._clock.now()
        self._remember(now)
        start, slope = self.profile_rate_deg_s(), self.profile_acceleration_deg_s2()
        pieces = ramp(start, slope, rate_deg_s, most_deg_s2=acceleration_deg_s2, jerk_deg_s3=jerk_deg_s3)
        self._plan_demand(now, self.angle_deg(), pieces, rate_deg_s, loop=self._loop_at(now))

    def oscillate(self, swing: Swing) -> None:
        """Oscillate from now on about the angle that belongs to `swing`; a table that turns is to be stopped before.

        Raises:
            RuntimeError: the servo is open.
        """
        if not self._servo_closed:
            raise RuntimeError("the servo is open: the table takes no demand")
        self._before_change()
        now = self._clock.now()
        self._remember(now)
        angle, loop = self.angle_deg(), self._loop_at(now)
        grown_s, off_deg = now + swing.lasts_s, self._fluttered_deg(now)
        self._profiles, self._segments, self._swings = [], [], True
        if swing.lasts_s:
            self._then(_Profile(now, 0.0, 0.0, *loop, swing.growing()), grown_s, angle, off_deg)
            off_deg = self._fluttered_deg(grown_s)
            loop, angle = self._loop_after(self._profiles[-1], grown_s), self._segments[-1].angle_at(grown_s)
        self._then(_Profile(grown_s, 0.0, 0.0, *loop, swing.grown()), math.inf, angle, off_deg)
        self._complete_s, self._goal_deg_s = grown_s, 0.0

    def close_servo(self) -> None:
        """Close the servo: the profile holds the rate that the table has now."""
        if self._servo_closed:
            return
        self._before_change()
        now, rate, angle = self._clock.now(), self.rate_deg_s(), self.angle_deg()
        self._remember(now)
        self._servo_closed = True
        loop = rate / (1 + self._mechanics.rate_error)
        self._plan_demand(now, angle, [], loop, loop=(loop, 0.0))

    def open_servo(self) -> None:
        """Open the servo: dry and viscous friction bring the table to rest."""
        if not self._servo_closed:
            return
        self._before_change()
        now, rate, angle = self._clock.now(), self.rate_deg_s(), self.angle_deg()
        self._remember(now)
        self._servo_closed = self._swings = False
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
        for each in chain(reversed(self._segments), reversed(self._past)):
            if each.start_s <= instant:
                return each.angle_at(instant)
        return 0.0

    def profile_rate_deg_s(self) -> float:
        """Return the rate that the ramp has reached now, deg/s; with the servo open the true rate."""
        now = self._clock.now()
        profile = self._profile_at(now)
        return self.rate_deg_s() if profile is None else profile.rate_at(now)

    def profile_acceleration_deg_s2(self) -> float:
        """Return the amount by which the profile's rate changes now, deg/s2; 0 with the servo open."""
        now = self._clock.now()
        profile = self._profile_at(now)
        return 0.0 if profile is None else profile.acceleration_at(now)

    def goal_deg_s(self) -> float:
        """Return the rate at which the profile ends, deg/s; 0 of an oscillation, and with the servo open."""
        return self._goal_deg_s if self._servo_closed else 0.0

    def beyond_s(self, rate_deg_s: float) -> float:
        """Return the bench time from when on the ramp is above `rate_deg_s`, either way round; inf for never."""
        goal = self.goal_deg_s()
        if not abs(goal) > rate_deg_s:
            return math.inf
        stop_s = self._complete_s
        for profile in reversed(self._profiles[:-1]):
            if math.copysign(1.0, goal) * profile.rate_at(profile.start_s) <= rate_deg_s:
                return self._crossed_s(profile, stop_s, math.copysign(rate_deg_s, goal))
            stop_s = profile.start_s
        return -math.inf

    @staticmethod
    def _crossed_s(profile: _Profile, stop_s: float, rate_deg_s: float) -> float:
        """Return when a piece of the profile, which begins below a rate and ends above it by `stop_s`, crosses it."""
        early, late = profile.start_s, stop_s
        if not profile.terms:
            return early + (rate_deg_s - profile.rate_deg_s) / profile.slope_deg_s2
        away = math.copysign(1.0, profile.rate_at(stop_s) - rate_deg_s)
        for _ in range(_HALVINGS):
            middle = 0.5 * (early + late)
            beyond = away * (profile.rate_at(middle) - rate_deg_s) > 0.0
            early, late = (early, middle) if beyond else (middle, late)
        return late

    @property
    def oscillating(self) -> bool:
        """True if the profile is an oscillation."""
        return self._swings

    @property
    def complete_s(self) -> float:
        """Bench time at which the ramp reaches the demand, the oscillation its amplitude."""
        return self._complete_s

    def profile_complete(self) -> bool:
        """Return True if the ramp has reached the demand, the oscillation its amplitude."""
        return self._clock.now() >= self._complete_s

    def _remember(self, now_s: float) -> None:
        """Keep the segments that a new command is about to replace, for later looks at the past."""
        self.commands += 1
        self._past = [each for each in (*self._past, *self._segments) if now_s - MEMORY_S < each.stop_s]
        self._past = [each for each in self._past if each.start_s < now_s]

    def segment(self, instant_s: float) -> RateSegment:
        """Return the segment that holds at bench time `instant_s`, not before the latest command."""
        for each in self._segments:
            if instant_s < each.stop_s:
                return each
        return self._segments[-1]

    def _profile_at(self, instant_s: float) -> _Profile | None:
        for each in reversed(self._profiles):
            if each.start_s <= instant_s:
                return each
        return None

    def _loop_at(self, instant_s: float) -> tuple[float, float]:
        """Return rate and acceleration of the rate loop, before the mean-rate error and ripple."""
        profile = self._profile_at(instant_s)
        return (0.0, 0.0) if profile is None else self._loop_after(profile, instant_s)

    def _loop_after(self, profile: _Profile, instant_s: float) -> tuple[float, float]:
        t = instant_s - profile.start_s
        free = self._free(profile) * cmath.exp(self._pole * t)
        rate, slope = self._steady(profile, t)
        return rate + free.real, slope + (self._pole * free).real

    def _steady(self, profile: _Profile, t: float) -> tuple[float, float]:
        """Return rate and acceleration of the loop's forced motion, `t` after the profile's start."""
        rate = profile.rate_deg_s + profile.slope_deg_s2 * t - self._lag_s * profile.slope_deg_s2
        forced = [(a * cmath.exp(s * t), s) for a, s in self._followed(profile)]
        return rate + sum(a.real for a, _ in forced), profile.slope_deg_s2 + sum((a * s).real for a, s in forced)

    def _followed(self, profile: _Profile) -> Sequence[tuple[complex, complex]]:
        """Return the loop's answer to the oscillators of a profile: w^2 / (s^2 + 2 zeta w s + w^2) of each."""
        squared, damped = abs(self._pole) ** 2, -2 * self._pole.real
        return [(a * squared / (s * s + damped * s + squared), s) for a, s in profile.terms]

    def _free(self, profile: _Profile) -> complex:
        """Return c of the loop's free motion Re(c exp(pole t)), of u'' + 2 zeta w u' + w^2 u = w^2 r."""
        steady_rate, steady_slope = self._steady(profile, 0.0)
        rate, slope = profile.loop_deg_s - steady_rate, profile.loop_deg_s2 - steady_slope
        return complex(rate, (self._pole.real * rate - slope) / self._pole.imag)

    def _plan_demand(
        self, now: float, angle: float, pieces: Sequence[JerkSegment], goal: float, *, loop: tuple[float, float]
    ) -> None:
        """Plan the pieces of a ramp from now on, then the goal's rate for ever."""
        off_deg = self._fluttered_deg(now)
        self._profiles, self._segments, self._swings = [], [], False
        for piece in pieces:
            constant, terms = _bent(piece)
            profile = _Profile(now, piece.rate_deg_s + constant, piece.acceleration_deg_s2, *loop, terms)
            now += piece.lasts_s
            self._then(profile, now, angle, off_deg)
            loop, angle = self._loop_after(profile, now), self._segments[-1].angle_at(now)
            off_deg = self._fluttered_deg(now)
        self._complete_s, self._goal_deg_s = now, goal
        self._then(_Profile(now, goal, 0.0, *loop), math.inf, angle, off_deg)

    def _then(self, profile: _Profile, stop_s: float, angle: float, off_deg: float) -> None:
        self._profiles.append(profile)
        scale = 1 + self._mechanics.rate_error
        steady = scale * (profile.rate_deg_s - self._lag_s * profile.slope_deg_s2)
        free = (scale * self._free(profile), self._pole)
        ripple = self._ripple(profile, angle) if stop_s == math.inf and profile.rate_deg_s else ()
        forced = [(scale * a, s) for a, s in self._followed(profile)]
        slope = scale * profile.slope_deg_s2
        segment = RateSegment(profile.start_s, stop_s, angle, steady, slope, (free, *forced, *ripple))
        self._segments.append(segment if self._flutter is None else self._fluttering(segment, self._flutter, off_deg))

    def _fluttering(self, segment: RateSegment, flutter: Flutter, off_deg: float) -> RateSegment:
        """Return a segment with its flutter, if it turns at one rate; the loop takes back the error of the angle."""
        steady = segment.stop_s == math.inf and not self._swings
        shaking = self._mechanics.flutter_per_sqrt_hz * abs(segment.rate_deg_s) if steady else 0.0
        begun_s = flutter.angle_at(segment.start_s) if shaking else 0.0
        astray = off_deg - shaking * begun_s if shaking else off_deg
        back = abs(self._pole)
        terms = (*segment.terms, (complex(-back * astray), complex(-back))) if astray else segment.terms
        shaken = flutter if shaking else None
        return replace(segment, terms=terms, flutter=shaken, shaking_deg_s=shaking, astray_deg=astray, begun_s=begun_s)

    def _fluttered_deg(self, instant_s: float) -> float:
        """Return the amount by which flutter has the angle off, deg."""
        if self._flutter is None:
            return 0.0
        return self.segment(instant_s).fluttered_deg(instant_s, abs(self._pole))

    def _ripple(self, profile: _Profile, angle: float) -> Sequence[tuple[complex, complex]]:
        """Return the oscillators of the angle error sum A sin(k angle + phase), once the loop has settled."""
        scale, rate = 1 + self._mechanics.rate_error, profile.loop_deg_s - profile.rate_deg_s
        # angle by which the settling loop runs ahead of the profile in the end, deg
        lead = (profile.loop_deg_s2 - 2 * self._pole.real * rate) / abs(self._pole) ** 2
        origin, turning = math.radians(angle + scale * lead), math.radians(scale * profile.rate_deg_s)
        return [
            (
                scale * profile.rate_deg_s * k * each.arcsec * ARCSEC * cmath.exp(1j * (k * origin + each.phase_rad)),
                complex(0.0, k * turning),
            )
            for each in self._ripples
            for k in (each.harmonic,)
        ]
