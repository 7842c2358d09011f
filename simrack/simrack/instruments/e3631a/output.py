"""One output of the simulated E3631A: its settings, and its true voltage and current.

Source: Keysight E3631A User's Guide E3631-90002, ed. 10, 2018 (p. 118, 186-187).
"""

from __future__ import annotations

import math

from msgspec import Struct

from simrack.instruments.e3631a.imperfections import SupplyErrors
from simrack.instruments.e3631a.kinds import OutputKind
from simrack.scpi import Register
from simrack.sources import NOTHING_V, Approach
from simrack.world import World

_LOOKS = 8
"""How often, in equal shares of its way, an output that moves looks whether its load still draws what it did."""
_TO_1_PERCENT = math.log(100.0)
"""Settling times of the guide are to 1 % of the excursion."""
_TRANSIENT_S = 50e-6 / _TO_1_PERCENT
"""Time constant after a load step: the guide has it back within 15 mV in less than 50 us (p. 186)."""
_OFF_COURSE_V = 1e-4
"""How far a moving output may be from what it would be at rest with this load before its way is found anew."""
_BEYOND_S = 1e-9
_HALVINGS = 40


class _Ramp(Struct):
    """An exponential approach of the open-circuit level."""

    start_s: float
    from_v: float
    to_v: float
    tau_s: float
    looks: int = 0

    def level_v(self, now_s: float) -> float:
        """Return the level at a time."""
        return self.to_v + (self.from_v - self.to_v) * math.exp(-(now_s - self.start_s) / self.tau_s)

    def instant_s(self) -> float:
        """Return when it is looked at next; the last time is its end."""
        left = 1.0 - (self.looks + 1) / _LOOKS
        excursion = max(1.0, 2.0 * abs(self.to_v - self.from_v) / NOTHING_V)
        return self.start_s + self.tau_s * (-math.log(left) if left > 0 else max(_TO_1_PERCENT, math.log(excursion)))

    def when_s(self, level_v: float) -> float:
        """Return when it has a level between its ends."""
        return self.start_s + self.tau_s * math.log((self.from_v - self.to_v) / (level_v - self.to_v))


class _Regulated(Struct, frozen=True):
    """A working point: voltage with the present load, and whether the current is at its limit."""

    voltage_v: float
    current_a: float
    limited: bool


class SupplyOutput:
    """One output: its settings, and the voltage and current really there."""

    __slots__ = (
        "_followed",
        "_level_v",
        "_recovery",
        "_recovery_s",
        "_world",
        "amps",
        "current_a",
        "errors",
        "kind",
        "limited",
        "quantised",
        "rail",
        "ramp",
        "register",
        "reverse_v",
        "rippling",
        "terminal",
        "triggered_amps",
        "triggered_volts",
        "turns_s",
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
        self._level_v = 0.0
        self._recovery, self._recovery_s = Approach(0.0), _TRANSIENT_S
        self._followed: _Ramp | None = None
        self.terminal = Approach(0.0)
        """The voltage at its terminals."""
        self.turns_s = math.inf
        """When it will have come to its current limit, or off it, by its own movement."""
        self.reverse_v = 0.0
        """What its voltmeter reads the wrong way round, because it is off."""
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
        if level_v == (self._level_v if self.ramp is None else self.ramp.to_v):
            return
        now = self._world.clock.now()
        here = self.level_v(now)
        self.ramp = _Ramp(now, here, level_v, self._settling_s(rising=abs(level_v) > abs(here)))

    def _settling_s(self, *, rising: bool) -> float:
        """Return the time constant of a change of level with the present load."""
        idle, full = self.kind.rise_s if rising else self.kind.fall_s
        share = min(1.0, self.current_a / self.kind.amps.maximum)
        return (idle + (full - idle) * share) / _TO_1_PERCENT

    def level_v(self, now_s: float) -> float:
        """Return the voltage without load."""
        return self._level_v if self.ramp is None else self.ramp.level_v(now_s)

    @property
    def voltage_v(self) -> float:
        """The voltage at its terminals now."""
        return self.terminal.at(self._world.clock.now())

    def advance(self, now_s: float) -> None:
        """Count the looks at the ramp that are due; regulation is found afterwards."""
        while self.ramp is not None and self.ramp.instant_s() <= now_s:
            self.ramp.looks += 1
            if self.ramp.looks == _LOOKS:
                self._level_v, self.ramp = self.ramp.to_v, None

    def next_s(self) -> float:
        """Return when something next happens to it by itself; inf if nothing does."""
        return min(self.turns_s, math.inf if self.ramp is None else self.ramp.instant_s())

    def limit_a(self) -> float:
        """Return the current at which the output really goes to constant current."""
        errors = self.errors
        amps = stepped(self.amps, self.kind.amp_step) if self.quantised else self.amps
        return max(0.0, amps * (1.0 + errors.current_programming_gain) + errors.current_programming_offset_a)

    def regulate(self) -> None:
        """Find voltage and current with the present load, constant voltage or constant current, and go there.

        The voltage never jumps: what it is off its working point goes with the time constant of what changed.
        """
        now, limit = self._world.clock.now(), self.limit_a()
        here = self._working_point(self.level_v(now), limit)
        if self._rests_at(here):
            return
        goal_v = here.voltage_v if self.ramp is None or here.limited else self._constant_voltage(self.ramp.to_v)[0]
        self._go(now, here, goal_v)
        self.limited, self.current_a = here.limited, here.current_a
        self.turns_s = self._turn_s(now, limit)
        # Put the ripple on the rail as the output gets or loses its voltage
        on = bool(goal_v or self.terminal.terms)
        errors = self.errors
        if self.rail is None or not errors.ripple_v or on == self.rippling:
            return
        self.rippling = on
        self._world.set_ripple(self.rail, errors.ripple() if on else None)

    @property
    def at_rest(self) -> bool:
        """True if it is under way to nowhere, at a constant voltage."""
        return self.ramp is None and self._followed is None and not self.limited

    def _rests_at(self, here: _Regulated) -> bool:
        """True if it goes to this working point since the last look, and no ramp with it: nothing has changed."""
        if self.ramp is not None or self._followed is not None:
            return False
        same = here.limited == self.limited and here.current_a == self.current_a
        return same and here.voltage_v == self.terminal.goal_v

    def _working_point(self, level_v: float, limit: float) -> _Regulated:
        """Return where an open-circuit level comes to rest with the present load."""
        current = self._load_a(level_v)
        if current <= limit:
            return _Regulated(level_v - self._sagged(level_v, current), current, limited=False)
        # Voltage at which the load draws the limit, by bisection, and that current
        low, high = 0.0, level_v
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            low, high = (low, middle) if self._load_a(middle) > limit else (middle, high)
        voltage, current = low, min(limit, self._load_a(low))
        return _Regulated(voltage - self._sagged(voltage, current), current, limited=True)

    def _constant_voltage(self, level_v: float) -> tuple[float, float]:
        current = self._load_a(level_v)
        return level_v - self._sagged(level_v, current), current

    def _go(self, now_s: float, here: _Regulated, goal_v: float) -> None:
        """Set out for a goal from where the voltage is, unless it is on its way there."""
        gap_v, left_v = self.terminal.at(now_s) - here.voltage_v, self._recovery.at(now_s)
        strayed_v = abs(gap_v - left_v)
        on_way = self.ramp is self._followed
        tolerance_v = 0.0 if self.ramp is None else _OFF_COURSE_V
        on_way &= abs(goal_v - self.terminal.goal_v) <= tolerance_v and strayed_v <= max(tolerance_v, NOTHING_V)
        if on_way:
            return
        if here.limited != self.limited or strayed_v > abs(left_v):
            self._recovery_s = self._recovers_in_s(limited=here.limited)
        gap = ((gap_v, self._recovery_s),) if abs(gap_v) > NOTHING_V else ()
        way_v = here.voltage_v - goal_v
        way = ((way_v, self.ramp.tau_s),) if self.ramp is not None and way_v else ()
        self._recovery = Approach(0.0, now_s, gap)
        self._followed, self.terminal = self.ramp, Approach(goal_v, now_s, (*way, *gap))
        if self.rail is not None:
            self._world.move_rail(self.rail, self.terminal)

    def _recovers_in_s(self, *, limited: bool) -> float:
        """Return the time constant with which the voltage goes where regulation now wants it."""
        if limited:  # the load discharges the capacitor, which the limited current would keep where it is wanted
            level_v = self.level_v(self._world.clock.now())
            return self.kind.capacitance_f * abs(level_v) / self._load_a(level_v)
        return self._settling_s(rising=True) if self.limited else _TRANSIENT_S

    def _turn_s(self, now_s: float, limit: float) -> float:
        """Return when the ramp will have come to the current limit, or off it, with the present load."""
        if self.ramp is None or (self._load_a(self.ramp.to_v) > limit) == self.limited:
            return math.inf
        near, far = self.level_v(now_s), self.ramp.to_v
        for _ in range(_HALVINGS):
            middle = (near + far) / 2
            near, far = (middle, far) if (self._load_a(middle) > limit) == self.limited else (near, middle)
        return math.inf if far == self.ramp.to_v else max(self.ramp.when_s(far), now_s) + _BEYOND_S

    def _sagged(self, voltage_v: float, current_a: float) -> float:
        """Return the drop of the voltage by the current."""
        share = current_a / self.kind.rated_a
        return self.kind.sign * current_a * self.errors.resistance_ohm + voltage_v * self.errors.sag * share

    def show(self, *, on: bool) -> None:
        """Show the regulation in the condition register: 2 constant voltage, 1 constant current, 0 off (p. 118)."""
        self.regulate()
        self.register.set_condition((1 if self.limited else 2) if on else 0)

    def _load_a(self, voltage_v: float) -> float:
        return 0.0 if self.rail is None else self._world.rail_current_a(self.rail, voltage_v)

    def voltage_reading(self) -> float:
        """Return the reading of the output's voltmeter."""
        reading = self.voltage_v * (1.0 + self.errors.readback_gain) + self.errors.readback_offset_v
        reading -= self.kind.sign * self.reverse_v
        return stepped(reading, self.kind.volt_step) if self.quantised else reading

    def current_reading(self) -> float:
        """Return the reading of the output's ammeter; positive for every output (unverified for N25V)."""
        reading = self.current_a * (1.0 + self.errors.current_readback_gain) + self.errors.current_readback_offset_a
        return stepped(reading, self.kind.amp_step) if self.quantised else reading


def stepped(value: float, step: float) -> float:
    """Return `value` as a converter of this `step` has it."""
    return round(value / step) * step
