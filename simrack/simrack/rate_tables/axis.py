"""The axis of a simulated rate table as its controller sees it: true motion through encoder and read-back.

The true motion and its errors (servo loop, mean-rate error, wow, flutter) belong to the World's table; here are the
errors of what the controller *says*, which is what a driver reads, and what shuts an axis down by itself: interlocks,
the over-rate trip, ends of travel, a stalled motor.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Literal, Protocol

from msgspec import Struct

from simrack.clock import Clock
from simrack.motion import Swing, TableMotion
from simrack.s_curve import peak_deg_s

if TYPE_CHECKING:
    import numpy as np

INTERLOCKS = ("interlock", "door", "emergency_stop", "drive_fault")
"""What can break the current that must flow for a drive to be on: master interlock, door switch, emergency stop, and
the power amplifier's own acknowledgement."""
_POLL_S = 0.002
"""How often the measured rate is looked at when it decides what happens next."""
_AT_REST_DEG_S = 0.02
"""Measured rate at which an axis that is held is let go by its drive: what holds it goes on holding it."""
_LOCKED_DEG_S2 = 1e4
"""How fast an axis that is held, or has lost its steps, comes to rest (chosen)."""

_ASKED_S = 0.02
"""Readings nearer to each other than this are one to a read-back that is one behind."""

_REACHED_DEG = 1e-4
_STILL_DEG_S = 1e-9
_SETTLE_S = 0.15
"""Pause at the end of a ramp for the rate loop, before the position is looked at again."""


class TableWorld(Protocol):
    """The part of the World that a simulated table needs."""

    @property
    def clock(self) -> Clock:
        """Bench time."""

    @property
    def table(self) -> TableMotion:
        """The table's true motion."""


class TableErrors(Struct, frozen=True):
    """Imperfections of the read-back of one specimen, zero switching each off, and its protection.

    Raises:
        ValueError: delay or estimate would look further back than the motion is remembered.
    """

    encoder_error_deg: float
    """Once-per-turn encoder error, amplitude, deg (BD125 data sheet: position accuracy 1 arcsec RSS)."""
    encoder_phase_deg: float
    """Angle at which the encoder error crosses zero, deg."""
    angle_resolution_deg: float
    """Quantum of the position read-back, deg (BD125 data sheet: 1e-5 deg)."""
    rate_resolution_deg_s: float
    """Quantum of the rate, deg/s: of the read-back and of the demand (BD125 data sheet: 1e-5 deg/s; that it is also
    that of the demand is likely)."""
    readback_delay_s: float = 0.0
    """Age of what the controller says, s, at most 0.5 s (chosen; unverified for every table)."""
    rate_estimate_s: float = 0.0
    """Time over which the rate is estimated from the encoder's angle, s, at most 0.5 s (chosen; unverified)."""

    over_rate_trip_deg_s: float = 1100.0
    """Measured rate beyond which the axis shuts down, deg/s; 0 never. ACL has its own limit instead, Vtrip (chosen)."""
    interlocks: bool = True
    """Whether the axis has interlocks (door, emergency stop, drive fault, master), which drop the drive when broken."""

    def __post_init__(self) -> None:
        """Refuse times that are none."""
        for seconds in (self.readback_delay_s, self.rate_estimate_s):
            if not 0.0 <= seconds <= 0.5:
                raise ValueError("a number at least 0 and at most 0.5")

    @classmethod
    def none(cls) -> TableErrors:
        """Return a read-back without errors."""
        return cls(0.0, 0.0, 0.0, 0.0)

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> TableErrors:
        """Return a specimen drawn from the BD125 data sheet: amplitude such that the RSS figure is one sigma."""
        amplitude_deg = math.sqrt(2.0) / 3600.0 * abs(float(rng.standard_normal()))
        return cls(amplitude_deg, float(rng.uniform(0.0, 360.0)), 1e-5, 1e-5, 1e-3, 20e-3)


class TableAxis:
    """The axis as measured: encoder error and quantisation on the true motion."""

    def __init__(self, world: TableWorld, errors: TableErrors) -> None:
        self._world = world
        self._errors = errors
        self._misread: Callable[[str, float], float] | None = None

    def misread(self, how: Literal["zero", "stuck", "half", "behind"]) -> Callable[[], None]:
        """Start wrong read-backs of rate and angle; return a function that ends them."""
        kept = {"rate": self.rate_deg_s(), "angle": self.angle_deg()}
        latest = dict.fromkeys(kept, -math.inf)
        shown = {"rate": 0.0, "angle": kept["angle"]} if how == "zero" else dict(kept)

        def misread(name: str, value: float) -> float:
            if how == "half":
                return value / 2.0 if name == "rate" else (value + shown[name]) / 2.0
            if how == "behind" and (now := self._world.clock.now()) - latest[name] > _ASKED_S:
                latest[name], shown[name], kept[name] = now, kept[name], value
            return shown[name]

        self._misread = misread
        return partial(setattr, self, "_misread", None)

    def angle_deg(self) -> float:
        """Return the accumulated angle that the encoder gives now, deg."""
        angle = _quantised(self._encoder_deg(self._errors.readback_delay_s), self._errors.angle_resolution_deg)
        return angle if self._misread is None else self._misread("angle", angle)

    def rate_deg_s(self) -> float:
        """Return the rate estimated from the encoder, deg/s: its way over a time, or the true rate times its slope."""
        rate = self._estimated_deg_s()
        return rate if self._misread is None else self._misread("rate", rate)

    def _estimated_deg_s(self) -> float:
        table, errors = self._world.table, self._errors
        if errors.rate_estimate_s:
            recent = self._encoder_deg(errors.readback_delay_s)
            way_deg = recent - self._encoder_deg(errors.readback_delay_s + errors.rate_estimate_s)
            return _quantised(way_deg / errors.rate_estimate_s, errors.rate_resolution_deg_s)
        slope = math.radians(self._errors.encoder_error_deg) * math.cos(self._electrical_rad(table.angle_deg()))
        return _quantised(table.rate_deg_s() * (1.0 + slope), self._errors.rate_resolution_deg_s)

    def in_steps_deg_s(self, rate_deg_s: float) -> float:
        """Return the rate that the controller makes of a demand: a whole number of its steps, deg/s."""
        stepped = _quantised(rate_deg_s, self._errors.rate_resolution_deg_s)
        return rate_deg_s if math.isclose(stepped, rate_deg_s) else stepped  # a whole number of steps keeps its digits

    def _encoder_deg(self, ago_s: float) -> float:
        """Return the angle that the encoder gave `ago_s` ago, deg."""
        table = self._world.table
        true = table.past_angle_deg(ago_s) if ago_s else table.angle_deg()
        return true + self._errors.encoder_error_deg * math.sin(self._electrical_rad(true))

    def _electrical_rad(self, angle_deg: float) -> float:
        return math.radians(angle_deg - self._errors.encoder_phase_deg)


def _quantised(value: float, quantum: float) -> float:
    return round(value / quantum) * quantum if quantum else value


class PositionMoves:
    """Brings the axis to an angle by ramps of the rate, then by corrections until the encoder is satisfied.

    :meth:`advance` must be called at `due_s`: the corners of the trapezoid are commands given then.
    """

    def __init__(self, world: TableWorld, axis: TableAxis) -> None:
        self._clock = world.clock
        self._motion = world.table
        self._axis = axis
        self._target_deg = 0.0
        self._rate_deg_s = 0.0
        self._acceleration_deg_s2 = 1.0
        self._jerk_deg_s3 = math.inf
        self.goal_deg_s = 0.0
        self.due_s: float | None = None

    @property
    def active(self) -> bool:
        """Return True if a move is under way."""
        return self.due_s is not None

    def start(
        self, target_deg: float, rate_deg_s: float, acceleration_deg_s2: float, jerk_deg_s3: float = math.inf
    ) -> None:
        """Move to the accumulated angle `target_deg`; a turning table is brought to rest first."""
        self._target_deg, self._rate_deg_s = target_deg, rate_deg_s
        self._acceleration_deg_s2, self._jerk_deg_s3 = acceleration_deg_s2, jerk_deg_s3
        self._next()

    def cancel(self) -> None:
        """Forget the move; the motion is not touched."""
        self.due_s = None

    def advance(self) -> None:
        """Give the commands that are due."""
        while self.due_s is not None and self._clock.now() >= self.due_s:
            self._next()

    def _next(self) -> None:
        left_deg = self._target_deg - self._axis.angle_deg()
        if abs(self._motion.profile_rate_deg_s()) > _STILL_DEG_S or not self._motion.profile_complete():
            self._ramp(0.0)
            self.due_s = self._motion.complete_s + _SETTLE_S
        elif abs(left_deg) <= _REACHED_DEG:
            self.due_s = None
        else:
            # up, along and down again: from its start to where it begins to brake takes distance over rate
            peak = min(self._rate_deg_s, peak_deg_s(abs(left_deg), self._acceleration_deg_s2, self._jerk_deg_s3))
            self._ramp(math.copysign(peak, left_deg))
            self.due_s = self._clock.now() + abs(left_deg) / peak

    def _ramp(self, rate_deg_s: float) -> None:
        self.goal_deg_s = rate_deg_s
        self._motion.demand_rate(rate_deg_s, self._acceleration_deg_s2, self._jerk_deg_s3)


class ServoAxis(TableAxis):
    """An axis whose controller has one acceleration and runs at a commanded rate while its drive is on.

    What shuts it down by itself is in `latched`, by name: those of `INTERLOCKS`, ``over_rate``, ``following_error``,
    ``travel`` and ``stalled``; the last two bring it to rest with its drive on. Interlocks are looked at while the
    drive is on, drop it at once, and bar it as long as they are broken. A number of `pull_out_deg_s` makes its motor a
    stepping motor, which loses its steps beyond that rate (0 never) and when held; a servo trips on following error.
    """

    def __init__(
        self,
        world: TableWorld,
        errors: TableErrors,
        acceleration_deg_s2: float,
        *,
        travel_deg: float = math.inf,
        pull_out_deg_s: float | None = None,
    ) -> None:
        super().__init__(world, errors)
        self._motion = world.table
        self._clock = world.clock
        self.acceleration_deg_s2 = acceleration_deg_s2
        self.moves = PositionMoves(world, self)
        self._zero_deg = 0.0
        self._travel_deg = travel_deg
        self._stepping = pull_out_deg_s is not None
        self._pull_out_deg_s = pull_out_deg_s or math.inf
        self._trip_deg_s = errors.over_rate_trip_deg_s or math.inf
        self._wired = errors.interlocks
        self.broken: set[str] = set()
        self.jammed = False
        """Whether something holds the axis."""
        self.latched: list[str] = []

    @property
    def enabled(self) -> bool:
        """Return True if the drive is on."""
        return self._motion.servo_closed

    @property
    def barred(self) -> bool:
        """Return True if a broken interlock keeps the drive off."""
        return self._wired and bool(self.broken)

    def enable(self) -> bool:
        """Switch the drive on, at rest, and forget the causes of a shutdown; return True if it is on."""
        if not self.barred:
            self.latched.clear()
            if not self.enabled:
                self._motion.close_servo()
                self.run(0.0)
        return self.enabled

    def disable(self) -> None:
        """Switch the drive off; the table coasts."""
        self.moves.cancel()
        self._motion.open_servo()

    def set_interlock(self, cause: str, *, faulty: bool) -> None:
        """Break or restore one of `INTERLOCKS`.

        Raises:
            ValueError: there is none of that name.
        """
        if cause not in INTERLOCKS:
            raise ValueError(f"an interlock is one of {', '.join(INTERLOCKS)}, not {cause!r}")
        (self.broken.add if faulty else self.broken.discard)(cause)
        self.advance()

    def jam(self, *, held: bool) -> None:
        """Hold the axis from outside, or let it go."""
        self.jammed = held
        self.advance()

    def clear_latched(self) -> None:
        """Forget the causes of a shutdown."""
        self.latched.clear()

    def advance(self) -> None:
        """Do everything due of a move, and everything that happens by itself."""
        self.moves.advance()
        if not self.enabled:
            return
        if self.barred:
            self._shut_down(*(cause for cause in INTERLOCKS if cause in self.broken))
        elif abs(self.rate_deg_s()) > self._trip_deg_s:
            self._shut_down("over_rate")
        elif self._beyond_travel():
            self._halt("travel")
        elif self._out_of_step():
            self._halt("stalled" if self._stepping else "following_error")
        elif "following_error" in self.latched and abs(self.rate_deg_s()) <= _AT_REST_DEG_S:
            self.disable()

    def _shut_down(self, *causes: str) -> None:
        self._latch(*causes)
        self.disable()

    def _latch(self, *causes: str) -> None:
        self.latched += [cause for cause in causes if cause not in self.latched]

    def _halt(self, cause: str) -> None:
        """Come to rest with the drive on."""
        self._latch(cause)
        self.moves.cancel()
        self._motion.demand_rate(0.0, self.acceleration_deg_s2 if cause == "travel" else _LOCKED_DEG_S2)

    def _beyond_travel(self) -> bool:
        """Return True if the axis goes on outwards beyond an end of its travel."""
        position = self.position_deg()
        return (
            abs(position) > self._travel_deg
            and position * self._motion.profile_rate_deg_s() > 0.0
            and (position * self._motion.goal_deg_s() > 0.0 or self._motion.oscillating)
        )

    def _out_of_step(self) -> bool:
        rate = abs(self._motion.profile_rate_deg_s())
        return rate > 0.0 and (rate > self._pull_out_deg_s or self.jammed) and self._motion.goal_deg_s() != 0.0

    def run(self, rate_deg_s: float) -> None:
        """Ramp to a rate."""
        self.moves.cancel()
        self._motion.demand_rate(rate_deg_s, self.acceleration_deg_s2)
        self.advance()

    def oscillate(self, amplitude_deg: float, frequency_hz: float, phase_rad: float = 0.0) -> None:
        """Oscillate about the present angle, at rest; the amplitude grows within two periods (unverified)."""
        self.moves.cancel()
        slew_deg_s = amplitude_deg * frequency_hz / 2.0
        self._motion.oscillate(Swing(0.0, amplitude_deg, slew_deg_s, frequency_hz, phase_rad))

    def go_to(self, position_deg: float, rate_deg_s: float) -> None:
        """Move to a position, counted from the zero that was set."""
        self.moves.start(position_deg + self._zero_deg, rate_deg_s, self.acceleration_deg_s2)

    def own_events_s(self) -> tuple[float, ...]:
        """Return when the next command of a move is due, and when something may shut the axis down."""
        return (*(() if self.moves.due_s is None else (self.moves.due_s,)), *self._watches_s())

    def _watches_s(self) -> Iterator[float]:
        """Yield when to look again, if the axis is on its way to where it must not be."""
        if not self.enabled:
            return
        now, goal = self._clock.now(), self._motion.goal_deg_s()
        fastest = 0.0 if self.jammed else min(self._trip_deg_s, self._pull_out_deg_s)
        if "following_error" in self.latched:
            yield now + _POLL_S
        if abs(goal) > fastest:  # whoever has commanded it
            yield max(self._motion.beyond_s(fastest), now + _POLL_S)
        if self._motion.oscillating and math.isfinite(min(fastest, self._travel_deg)):
            yield now + _POLL_S
        left = self._travel_deg - math.copysign(1.0, goal) * self.position_deg()
        if goal and math.isfinite(left):
            yield now + max(left / max(abs(goal), abs(self._motion.profile_rate_deg_s())), _POLL_S)

    def change_acceleration(self, acceleration_deg_s2: float) -> None:
        """Take another acceleration for the ramps that follow; the running one keeps its own."""
        self.acceleration_deg_s2 = acceleration_deg_s2

    def moving(self) -> bool:
        """Return True if a move is under way, or the profile turns or ramps."""
        motion = self._motion
        return (
            self.moves.active
            or not motion.profile_complete()
            or motion.oscillating
            or motion.profile_rate_deg_s() != 0.0
        )

    def position_deg(self) -> float:
        """Return the measured angle from the zero that was set, deg."""
        return self.angle_deg() - self._zero_deg

    def set_zero(self, position_deg: float = 0.0) -> None:
        """Set the present angle to `position_deg`."""
        self._zero_deg = self.angle_deg() - position_deg
