"""What the ACUTROL3000's axis is asked for by the host (TM-8004-C 4.3)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simrack.rate_tables.acl.arguments import (
    Action,
    Arguments,
    Query,
    axis_values,
    check_axis,
    counted,
    integer,
    number,
    one,
)
from simrack.rate_tables.acl.refusal import OUT_OF_RANGE, Refusal
from simrack.rate_tables.acl.replies import ACCELERATION, ANGLE, RATE, decimal

if TYPE_CHECKING:
    from simrack.rate_tables.acl.demand import Demand
    from simrack.rate_tables.acl.profiler import Profiler
    from simrack.rate_tables.acl.replies import StateFormat


class DemandCommands:
    """Demand and all below it; what the present mode uses acts at once."""

    def __init__(self, demand: Demand, profiler: Profiler, states: StateFormat) -> None:
        self._demand = demand
        self._profiler = profiler
        self._states = states
        self._inputs = [0.0] * 12

    def commands(self) -> dict[str, Action]:
        """Return what can be demanded."""
        return {
            "Demand:Rate": self._rate,
            "Demand:Position": self._position,
            "Demand:DeltaPosition": self._delta,
            "Demand:Acceleration": self._acceleration,
            "Demand:Oscillator": self._oscillator,
            "Demand:InputVariable": self._input,
            "Demand:ShortVector": lambda a: self._vector(a, 2),
            "Demand:Vector": lambda a: self._vector(a, 3),
        }

    def queries(self) -> dict[str, Query]:
        """Return what can be asked about the demand."""
        demand, of_axis = self._demand, self._states.of_axis
        return {
            "Demand:Rate": lambda a: of_axis(a, (demand.rate_deg_s, RATE)),
            "Demand:Position": lambda a: of_axis(a, (demand.position_deg, ANGLE)),
            "Demand:DeltaPosition": lambda a: of_axis(a, (demand.delta_deg, ANGLE)),
            "Demand:Acceleration": lambda a: of_axis(a, (demand.acceleration_deg_s2, ACCELERATION)),
            "Demand:Oscillator": self._ask_oscillator,
            "Demand:InputVariable": lambda a: decimal(self._inputs[integer(one(a), 1, 12) - 1]),
            "Demand:ShortVector": lambda a: of_axis(a, *self._demanded()[:2]),
            "Demand:Vector": lambda a: of_axis(a, *self._demanded()),
        }

    def _rate(self, arguments: Arguments) -> None:
        (self._demand.rate_deg_s,) = axis_values(arguments, 1)
        self._profiler.leave_end()
        if self._profiler.regulates_rate:
            self._profiler.follow()

    def _position(self, arguments: Arguments) -> None:
        (self._demand.position_deg,) = axis_values(arguments, 1)
        self._follow_position()

    def _delta(self, arguments: Arguments) -> None:
        (self._demand.delta_deg,) = axis_values(arguments, 1)
        self._demand.position_deg += self._demand.delta_deg
        self._follow_position()

    def _follow_position(self) -> None:
        if self._profiler.mode == "Track":
            self._demand.rate_deg_s = 0.0
            self._profiler.track_test.take()
        if self._profiler.mode in {"Position", "Track"}:
            self._profiler.follow()

    def _acceleration(self, arguments: Arguments) -> None:
        (self._demand.acceleration_deg_s2,) = axis_values(arguments, 1)

    def _oscillator(self, arguments: Arguments) -> None:
        amplitude, frequency, phase = axis_values(arguments, 3)
        if frequency < 0.0:
            raise Refusal(OUT_OF_RANGE)
        self._demand.oscillator = (amplitude, frequency, phase)
        if self._profiler.mode == "Synthesis":
            self._profiler.follow()

    def _input(self, arguments: Arguments) -> None:
        register, value = counted(arguments, 2)
        self._inputs[integer(register, 1, 12) - 1] = number(value)

    def _vector(self, arguments: Arguments, size: int) -> None:
        values = axis_values(arguments, size)
        self._demand.position_deg, self._demand.rate_deg_s = values[:2]
        if size == 3:
            self._demand.acceleration_deg_s2 = values[2]
        if self._profiler.mode == "Track":
            self._profiler.track_test.take()
        if self._profiler.mode in {"Rate", "Arate", "Position", "Track"}:
            self._profiler.follow()

    def _demanded(self) -> tuple[tuple[float, float], ...]:
        demand = self._demand
        return (
            (demand.position_deg, ANGLE),
            (demand.rate_deg_s, RATE),
            (demand.acceleration_deg_s2, ACCELERATION),
        )

    def _ask_oscillator(self, arguments: Arguments) -> str:
        check_axis(arguments, everything=False)
        return ";".join(decimal(value) for value in self._demand.oscillator)
