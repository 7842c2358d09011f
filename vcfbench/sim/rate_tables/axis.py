"""The axis of a simulated rate table as its controller sees it: true motion through encoder and read-back.

The true motion and its errors (servo loop, mean-rate error, wow) belong to the World's table; here are the errors
of what the controller *says*, which is what a driver reads.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    import numpy as np

    from vcfbench.clock import Clock

__all__ = ["Axis", "Motion", "PositionMoves", "ServoAxis", "TableErrors", "TableWorld"]

_REACHED_DEG = 1e-4
_SETTLE_S = 0.15
"""Pause at the end of a ramp for the rate loop, before the position is looked at again."""


class Motion(Protocol):
    """True motion of the table, as the World offers it."""

    @property
    def servo_closed(self) -> bool:
        """Tell whether the servo holds the table."""
        ...

    def demand_rate(self, rate_deg_s: float, acceleration_deg_s2: float) -> None:
        """Ramp to a rate from now on."""
        ...

    def close_servo(self) -> None:
        """Close the servo."""
        ...

    def open_servo(self) -> None:
        """Open the servo; the table coasts."""
        ...

    def rate_deg_s(self) -> float:
        """Return the true rate now."""
        ...

    def angle_deg(self) -> float:
        """Return the true accumulated angle now."""
        ...

    def past_angle_deg(self, ago_s: float) -> float:
        """Return the true accumulated angle a while ago."""
        ...

    def profile_rate_deg_s(self) -> float:
        """Return the profiled rate now."""
        ...

    def profile_complete(self) -> bool:
        """Tell whether the profile has reached the demand."""
        ...


class TableWorld(Protocol):
    """What a simulated table needs of the World."""

    @property
    def clock(self) -> Clock:
        """Bench time."""
        ...

    @property
    def table(self) -> Motion:
        """The table's true motion."""
        ...


@dataclass(frozen=True, slots=True)
class TableErrors:
    """Imperfections of the read-back of one specimen; zero switches each off.

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
    """Quantum of the rate read-back, deg/s (BD125 data sheet: 1e-5 deg/s)."""
    readback_delay_s: float = 0.0
    """Age of what the controller says, s, at most 0.5 s (chosen; unverified for every table)."""
    rate_estimate_s: float = 0.0
    """Time over which the rate is estimated from the encoder's angle, s, at most 0.5 s (chosen; unverified)."""

    def __post_init__(self) -> None:
        """Refuse times that are none."""
        for seconds in (self.readback_delay_s, self.rate_estimate_s):
            if not 0.0 <= seconds <= 0.5:
                raise ValueError("a number at least 0 and at most 0.5")

    @classmethod
    def none(cls) -> TableErrors:
        """Return a read-back that says what is."""
        return cls(0.0, 0.0, 0.0, 0.0)

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> TableErrors:
        """Return a specimen drawn from the BD125 data sheet: amplitude such that the RSS figure is one sigma."""
        amplitude_deg = math.sqrt(2.0) / 3600.0 * abs(float(rng.standard_normal()))
        return cls(amplitude_deg, float(rng.uniform(0.0, 360.0)), 1e-5, 1e-5, 1e-3, 20e-3)


class Axis:
    """The axis as measured: encoder error and quantisation on the true motion."""

    def __init__(self, world: TableWorld, errors: TableErrors) -> None:
        self._world = world
        self._errors = errors

    def angle_deg(self) -> float:
        """Return the accumulated angle that the encoder gives now, deg."""
        return _quantised(self._encoder_deg(self._errors.readback_delay_s), self._errors.angle_resolution_deg)

    def rate_deg_s(self) -> float:
        """Return the rate estimated from the encoder, deg/s: its way over a time, or the true rate times its slope."""
        table, errors = self._world.table, self._errors
        if errors.rate_estimate_s:
            recent = self._encoder_deg(errors.readback_delay_s)
            way_deg = recent - self._encoder_deg(errors.readback_delay_s + errors.rate_estimate_s)
            return _quantised(way_deg / errors.rate_estimate_s, errors.rate_resolution_deg_s)
        slope = math.radians(self._errors.encoder_error_deg) * math.cos(self._electrical_rad(table.angle_deg()))
        return _quantised(table.rate_deg_s() * (1.0 + slope), self._errors.rate_resolution_deg_s)

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
    """Brings the axis to an angle by ramps of the rate, correcting what is left until the encoder is satisfied.

    :meth:`advance` must be called at `due_s`: the corners of the trapezoid are commands given then.
    """

    def __init__(self, world: TableWorld, axis: Axis) -> None:
        self._clock = world.clock
        self._motion = world.table
        self._axis = axis
        self._target_deg = 0.0
        self._rate_deg_s = 0.0
        self._acceleration_deg_s2 = 1.0
        self.goal_deg_s = 0.0
        self.due_s: float | None = None

    @property
    def active(self) -> bool:
        """Tell whether a move is under way."""
        return self.due_s is not None

    def start(self, target_deg: float, rate_deg_s: float, acceleration_deg_s2: float) -> None:
        """Move to the accumulated angle `target_deg`; a turning table is brought to rest first."""
        self._target_deg, self._rate_deg_s = target_deg, rate_deg_s
        self._acceleration_deg_s2 = acceleration_deg_s2
        self._next()

    def cancel(self) -> None:
        """Forget the move; the motion is not touched."""
        self.due_s = None

    def advance(self) -> None:
        """Give the commands that are due."""
        while self.due_s is not None and self._clock.now() >= self.due_s:
            self._next()

    def _next(self) -> None:
        rate = abs(self._motion.profile_rate_deg_s())
        left_deg = self._target_deg - self._axis.angle_deg()
        if rate > 1e-9:
            self._ramp(0.0, rate / self._acceleration_deg_s2 + _SETTLE_S)
        elif abs(left_deg) <= _REACHED_DEG:
            self.due_s = None
        else:
            # up, along and down again: the area of the trapezoid up to its second corner takes distance over rate
            peak = min(self._rate_deg_s, math.sqrt(self._acceleration_deg_s2 * abs(left_deg)))
            self._ramp(math.copysign(peak, left_deg), abs(left_deg) / peak)

    def _ramp(self, rate_deg_s: float, lasts_s: float) -> None:
        self.goal_deg_s = rate_deg_s
        self._motion.demand_rate(rate_deg_s, self._acceleration_deg_s2)
        self.due_s = self._clock.now() + lasts_s


class ServoAxis(Axis):
    """An axis whose controller knows one acceleration and runs at a commanded rate while its drive is on."""

    def __init__(self, world: TableWorld, errors: TableErrors, acceleration_deg_s2: float) -> None:
        super().__init__(world, errors)
        self._motion = world.table
        self.acceleration_deg_s2 = acceleration_deg_s2
        self.moves = PositionMoves(world, self)
        self._zero_deg = 0.0

    @property
    def enabled(self) -> bool:
        """Tell whether the drive is on."""
        return self._motion.servo_closed

    def enable(self) -> None:
        """Switch the drive on, at rest."""
        if not self.enabled:
            self._motion.close_servo()
            self.run(0.0)

    def disable(self) -> None:
        """Switch the drive off; the table coasts."""
        self.moves.cancel()
        self._motion.open_servo()

    def run(self, rate_deg_s: float) -> None:
        """Ramp to a rate."""
        self.moves.cancel()
        self._motion.demand_rate(rate_deg_s, self.acceleration_deg_s2)

    def go_to(self, position_deg: float, rate_deg_s: float) -> None:
        """Move to a position, counted from the zero that was set."""
        self.moves.start(position_deg + self._zero_deg, rate_deg_s, self.acceleration_deg_s2)

    def own_events_s(self) -> tuple[float, ...]:
        """Return when the next command of a move is due."""
        return () if self.moves.due_s is None else (self.moves.due_s,)

    def change_acceleration(self, acceleration_deg_s2: float) -> None:
        """Take another acceleration for the ramps that follow; the running one keeps its own."""
        self.acceleration_deg_s2 = acceleration_deg_s2

    def moving(self) -> bool:
        """Tell whether a move is under way, or the profile turns or ramps."""
        return self.moves.active or not self._motion.profile_complete() or self._motion.profile_rate_deg_s() != 0.0

    def position_deg(self) -> float:
        """Return the measured angle from the zero that was set, deg."""
        return self.angle_deg() - self._zero_deg

    def set_zero(self, position_deg: float = 0.0) -> None:
        """Let the present angle be `position_deg`."""
        self._zero_deg = self.angle_deg() - position_deg
