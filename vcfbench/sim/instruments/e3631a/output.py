"""One output of the simulated E3631A: what it is set to, and the voltage and current that are really there.

Source: Keysight E3631A User's Guide E3631-90002, ed. 10, 2018 (p. 118, 186-187).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from vcfbench.sim.sources import Ripple

if TYPE_CHECKING:
    from vcfbench.sim.instruments.e3631a.errors import SupplyErrors
    from vcfbench.sim.instruments.e3631a.kinds import OutputKind
    from vcfbench.sim.scpi import Register
    from vcfbench.sim.world import World

__all__ = ["Output", "stepped"]

_RAMP_STEPS = 8
_SETTLED = math.log(100.0)
"""Settling times of the guide are to 1 % of the excursion."""


@dataclass(slots=True)
class _Ramp:
    """An exponential approach, handed to the World in steps."""

    start_s: float
    from_v: float
    to_v: float
    tau_s: float
    step: int = 1

    def instant_s(self) -> float:
        """Return when the next step is due."""
        left = 1.0 - self.step / _RAMP_STEPS
        return self.start_s + self.tau_s * (-math.log(left) if left > 0 else _SETTLED)

    def level_v(self) -> float:
        """Return the level of the next step."""
        return self.from_v + (self.to_v - self.from_v) * self.step / _RAMP_STEPS


class Output:
    """One output: its settings, and the voltage and current really there."""

    __slots__ = (
        "_world",
        "amps",
        "current_a",
        "errors",
        "kind",
        "level_v",
        "limited",
        "quantised",
        "rail",
        "ramp",
        "register",
        "rippling",
        "triggered_amps",
        "triggered_volts",
        "voltage_v",
        "volts",
    )

    def __init__(
        self, kind: OutputKind, world: World, rail: str | None, register: Register, errors: SupplyErrors
    ) -> None:
        self.kind = kind
        self.rail = rail
        self.register = register
        self.errors = errors.of(kind.name)
        self.quantised = errors.quantised
        self._world = world
        self.level_v = 0.0
        self.voltage_v = 0.0
        self.current_a = 0.0
        self.limited = False
        self.rippling = False
        self.ramp: _Ramp | None = None
        self.volts = 0.0
        self.amps = 0.0
        self.triggered_volts: float | None = None
        self.triggered_amps: float | None = None

    def forget_triggered(self) -> None:
        """Forget the pending levels."""
        self.triggered_volts = None
        self.triggered_amps = None

    def head_for(self, level_v: float) -> None:
        """Start towards the open-circuit level `level_v` from now on."""
        if level_v == (self.level_v if self.ramp is None else self.ramp.to_v):
            return
        rising = abs(level_v) > abs(self.level_v)
        idle, full = self.kind.rise_s if rising else self.kind.fall_s
        share = min(1.0, self.current_a / self.kind.amps.maximum)
        tau = (idle + (full - idle) * share) / _SETTLED
        self.ramp = _Ramp(self._world.clock.now(), self.level_v, level_v, tau)

    def advance(self, now_s: float) -> None:
        """Take the steps of the ramp that are due; regulation is found afterwards."""
        while self.ramp is not None and self.ramp.instant_s() <= now_s:
            self.level_v = self.ramp.level_v()
            self.ramp.step += 1
            if self.ramp.step > _RAMP_STEPS:
                self.level_v, self.ramp = self.ramp.to_v, None

    def limit_a(self) -> float:
        """Return the current at which the output really goes to constant current."""
        errors = self.errors
        amps = stepped(self.amps, self.kind.amp_step) if self.quantised else self.amps
        return max(0.0, amps * (1.0 + errors.current_programming_gain) + errors.current_programming_offset_a)

    def regulate(self) -> None:
        """Find voltage and current with the present load, constant voltage or constant current."""
        limit = self.limit_a()
        voltage, current = self.level_v, self._load_a(self.level_v)
        self.limited = current > limit
        if self.limited:
            voltage, current = self._at_limit(limit)
        voltage -= self._sagged(voltage, current)
        self._ripple(on=bool(voltage))
        if self.rail is not None and voltage != self.voltage_v:
            self._world.set_rail(self.rail, voltage)
        self.voltage_v, self.current_a = voltage, current

    def _sagged(self, voltage_v: float, current_a: float) -> float:
        """Return what the current takes off the voltage."""
        share = current_a / self.kind.rated_a
        return self.kind.sign * current_a * self.errors.resistance_ohm + voltage_v * self.errors.sag * share

    def _ripple(self, *, on: bool) -> None:
        """Put the ripple on the rail as the output gets or loses its voltage."""
        errors = self.errors
        if self.rail is None or not errors.ripple_v or on == self.rippling:
            return
        self.rippling = on
        ripple = Ripple(errors.ripple_v, errors.ripple_hz, errors.ripple_phase_rad)
        self._world.set_ripple(self.rail, ripple if on else None)

    def show(self, *, on: bool) -> None:
        """Show the regulation in the condition register: 2 constant voltage, 1 constant current, 0 off (p. 118)."""
        self.regulate()
        self.register.set_condition((1 if self.limited else 2) if on else 0)

    def _load_a(self, voltage_v: float) -> float:
        return 0.0 if self.rail is None else self._world.rail_current_a(self.rail, voltage_v)

    def _at_limit(self, limit: float) -> tuple[float, float]:
        """Return the voltage at which the load draws the limit, by bisection, and that current."""
        low, high = 0.0, self.level_v
        for _ in range(40):
            middle = (low + high) / 2
            low, high = (low, middle) if self._load_a(middle) > limit else (middle, high)
        return low, min(limit, self._load_a(low))

    def voltage_reading(self) -> float:
        """Return what the voltmeter of the output shows."""
        reading = self.voltage_v * (1.0 + self.errors.readback_gain) + self.errors.readback_offset_v
        return stepped(reading, self.kind.volt_step) if self.quantised else reading

    def current_reading(self) -> float:
        """Return what the ammeter of the output shows; positive for every output (unverified for N25V)."""
        reading = self.current_a * (1.0 + self.errors.current_readback_gain) + self.errors.current_readback_offset_a
        return stepped(reading, self.kind.amp_step) if self.quantised else reading


def stepped(value: float, step: float) -> float:
    """Return `value` as a converter of this `step` has it."""
    return round(value / step) * step
