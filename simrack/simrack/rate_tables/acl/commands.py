"""Commands and queries of the ACUTROL3000 (TM-8004-C 4): demand, servo, limits, modes, readings, registers."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from msgspec.structs import replace

from simrack.handlers import Handlers
from simrack.rate_tables.acl import language
from simrack.rate_tables.acl.drive import NORMAL_UNSERVO_BIT, AclDrive
from simrack.rate_tables.acl.language import StateFormat
from simrack.rate_tables.acl.limits import FACTORY, FACTORY_OVERALL, AclLimits, AxisLimits, Demand, OverallLimits
from simrack.rate_tables.acl.profiler import Profiler, interval_ms
from simrack.rate_tables.acl.protection import Protection
from simrack.rate_tables.acl.status import AclStatus, FrontPanel


class DemandCommands:
    """Commands of Demand; a demand of the present mode acts at once."""

    _QUERIES = Handlers()
    _COMMANDS = Handlers()

    def __init__(self, demand: Demand, profiler: Profiler, states: StateFormat) -> None:
        self._demand = demand
        self._profiler = profiler
        self._states = states
        self._inputs = [0.0] * 12

    def commands(self) -> dict[str, language.Action]:
        """Return the commands of the demand."""
        return {
            "Demand:Rate": self._rate,
            "Demand:Position": self._position,
            **self._COMMANDS.bound(self),
            "Demand:Acceleration": self._acceleration,
            "Demand:ShortVector": lambda a: self._vector(a, 2),
            "Demand:Vector": lambda a: self._vector(a, 3),
        }

    def queries(self) -> dict[str, language.Query]:
        """Return the queries of the demand."""
        demand, of_axis = self._demand, self._states.of_axis
        return {
            "Demand:Rate": lambda a: of_axis(a, (demand.rate_deg_s, language.RATE)),
            "Demand:Position": lambda a: of_axis(a, (demand.position_deg, language.ANGLE)),
            "Demand:DeltaPosition": lambda a: of_axis(a, (demand.delta_deg, language.ANGLE)),
            "Demand:Acceleration": lambda a: of_axis(a, (demand.acceleration_deg_s2, language.ACCELERATION)),
            **self._QUERIES.bound(self),
            "Demand:InputVariable": lambda a: language.decimal(
                self._inputs[language.integer(language.one(a), 1, 12) - 1]
            ),
            "Demand:ShortVector": lambda a: of_axis(a, *self._demanded()[:2]),
            "Demand:Vector": lambda a: of_axis(a, *self._demanded()),
        }

    def _rate(self, arguments: language.Arguments) -> None:
        (self._demand.rate_deg_s,) = language.axis_values(arguments, 1)
        self._profiler.leave_end()
        if self._profiler.regulates_rate:
            self._profiler.follow()

    def _position(self, arguments: language.Arguments) -> None:
        (self._demand.position_deg,) = language.axis_values(arguments, 1)
        self._follow_position()

    @_COMMANDS.of("Demand:DeltaPosition")
    def _delta(self, arguments: language.Arguments) -> None:
        (self._demand.delta_deg,) = language.axis_values(arguments, 1)
        self._demand.position_deg += self._demand.delta_deg
        self._follow_position()

    def _follow_position(self) -> None:
        if self._profiler.mode == "Track":
            self._demand.rate_deg_s = 0.0
            self._profiler.track_test.take()
        if self._profiler.mode in {"Position", "Track"}:
            self._profiler.follow()

    def _acceleration(self, arguments: language.Arguments) -> None:
        (self._demand.acceleration_deg_s2,) = language.axis_values(arguments, 1)

    @_COMMANDS.of("Demand:Oscillator")
    def _oscillator(self, arguments: language.Arguments) -> None:
        amplitude, frequency, phase = language.axis_values(arguments, 3)
        if frequency < 0.0:
            raise language.Refusal(language.OUT_OF_RANGE)
        self._demand.oscillator = (amplitude, frequency, phase)
        if self._profiler.mode == "Synthesis":
            self._profiler.follow()

    @_COMMANDS.of("Demand:InputVariable")
    def _input(self, arguments: language.Arguments) -> None:
        register, value = language.counted(arguments, 2)
        self._inputs[language.integer(register, 1, 12) - 1] = language.number(value)

    def _vector(self, arguments: language.Arguments, size: int) -> None:
        values = language.axis_values(arguments, size)
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
            (demand.position_deg, language.ANGLE),
            (demand.rate_deg_s, language.RATE),
            (demand.acceleration_deg_s2, language.ACCELERATION),
        )

    @_QUERIES.of("Demand:Oscillator")
    def _ask_oscillator(self, arguments: language.Arguments) -> str:
        language.check_axis(arguments, everything=False)
        return ";".join(language.decimal(value) for value in self._demand.oscillator)


class InterlockCommands:
    """Commands of Interlock; `advance` does everything due of the whole controller."""

    _COMMANDS = Handlers()

    def __init__(self, drive: AclDrive, protection: Protection, status: AclStatus, advance: Callable[[], None]) -> None:
        self._drive = drive
        self._protection = protection
        self._status = status
        self._advance = advance

    def commands(self) -> dict[str, language.Action]:
        """Return the commands of the servo."""
        return self._COMMANDS.bound(self)

    def queries(self) -> dict[str, language.Query]:
        """Return the queries of the servo."""
        return {"Interlock": self._ask}

    @_COMMANDS.of("Interlock:Close")
    def _close(self, arguments: language.Arguments) -> None:
        language.check_axis(arguments)
        if self._drive.servoed_or_closing:
            return
        if self._protection.faulted:
            self._status.summarise_interlock()
        else:
            self._drive.close()

    @_COMMANDS.of("Interlock:Open")
    def _open(self, arguments: language.Arguments) -> None:
        language.check_axis(arguments)
        self._drive.closing_at_s = None
        if self._drive.servoed and not self._drive.aborting:
            self._drive.abort(NORMAL_UNSERVO_BIT)
            self._advance()

    @_COMMANDS.of("Interlock:Reset")
    def _reset(self, arguments: language.Arguments) -> None:
        if arguments:  # the manual has none, a client of a real table names its axis and expects an OK
            language.check_axis(arguments)
        if not self._drive.servoed:  # no effect on a servoed axis
            self._protection.reset()

    def _ask(self, arguments: language.Arguments) -> str:
        language.check_axis(arguments, everything=False)
        if self._protection.faulted:
            return "Fault"
        return "Close" if self._drive.servoed else "Open"


_OF_A_MODE = {"Limit:Acceleration": "acceleration_deg_s2", "Limit:Rate": "rate_deg_s", "Limit:Jerk": "jerk_deg_s3"}
_OVERALL = {"Limit:Vtrip": "trip_deg_s", "Limit:HighPosition": "high_deg", "Limit:LowPosition": "low_deg"}


class LimitCommands:
    """Limit and all below it; new limits of the present mode act at once."""

    _COMMANDS = Handlers()

    def __init__(self, limits: AclLimits, profiler: Profiler) -> None:
        self._limits = limits
        self._profiler = profiler

    def commands(self) -> dict[str, language.Action]:
        """Return the commands of limits."""
        return {
            "Limit": self._set,
            **self._COMMANDS.bound(self),
            **{path: partial(self._set_one, name) for path, name in _OF_A_MODE.items()},
            **{path: partial(self._set_one_overall, name) for path, name in _OVERALL.items()},
        }

    def queries(self) -> dict[str, language.Query]:
        """Return the queries of limits."""
        return {
            "Limit": self._ask,
            "Limit:Absolute": lambda a: language.listed(a, *FACTORY.values(), *FACTORY_OVERALL.values()),
            "Limit:Global": lambda a: language.listed(a, *self._limits.overall.values()),
            **{path: partial(self._ask_one, name) for path, name in _OF_A_MODE.items()},
            **{path: partial(self._ask_one_overall, name) for path, name in _OVERALL.items()},
        }

    def _set(self, arguments: language.Arguments) -> None:
        axis, mode, *values = language.counted(arguments, 5)
        language.check_axis((axis,))
        wanted = AxisLimits(*(language.number(value) for value in values))
        self._change(language.word(mode, language.MODES), wanted)

    def _set_one(self, name: str, arguments: language.Arguments) -> None:
        mode, axis, value = language.counted(arguments, 3)
        language.check_axis((axis,))
        mode = language.word(mode, language.MODES)
        self._change(mode, replace(self._limits.of(mode), **{name: language.number(value)}))

    def _change(self, mode: str, wanted: AxisLimits) -> None:
        self._limits.change(mode, wanted)
        if mode == self._profiler.mode:
            self._profiler.follow()

    def _set_one_overall(self, name: str, arguments: language.Arguments) -> None:
        # the mode is there for Act2000's sake; the ACUTROL3000 has one value for all (TM-8004-C 4.6.4)
        mode, axis, value = language.counted(arguments, 3)
        language.word(mode, language.MODES)
        language.check_axis((axis,))
        self._limits.change_overall(replace(self._limits.overall, **{name: language.number(value)}))

    @_COMMANDS.of("Limit:Global")
    def _set_overall(self, arguments: language.Arguments) -> None:
        axis, *values = language.counted(arguments, 5)
        language.check_axis((axis,))
        self._limits.change_overall(OverallLimits(*(language.number(value) for value in values)))

    def _ask(self, arguments: language.Arguments) -> str:
        axis, mode = language.counted(arguments, 2)
        return language.listed((axis,), *self._limits.of(language.word(mode, language.MODES)).values())

    def _ask_one(self, name: str, arguments: language.Arguments) -> str:
        mode, axis = language.counted(arguments, 2)
        language.check_axis((axis,), everything=False)
        return language.decimal(getattr(self._limits.of(language.word(mode, language.MODES)), name))

    def _ask_one_overall(self, name: str, arguments: language.Arguments) -> str:
        # the manual's examples ask both "? P,3" and "? 2"
        language.check_axis(arguments[-1:], everything=False)
        return language.decimal(getattr(self._limits.overall, name))


class ModeCommands:
    """Mode and all below it."""

    def __init__(self, profiler: Profiler) -> None:
        self._profiler = profiler

    def commands(self) -> dict[str, language.Action]:
        """Return the commands that select a mode."""
        return {
            "Mode": self._set,
            **{f"Mode:{mode}": partial(self._select, mode) for mode in language.MODES if mode != "Abort"},
        }

    def queries(self) -> dict[str, language.Query]:
        """Return the query of the mode."""
        return {"Mode": self._ask}

    def _select(self, mode: str, arguments: language.Arguments) -> None:
        language.check_axis(arguments, most=2 if mode == "Track" else 1)
        if mode == "Track":
            self._profiler.track_test.select(interval_ms(arguments[1] if len(arguments) == 2 else None))
        self._profiler.select(mode)

    def _set(self, arguments: language.Arguments) -> None:
        mode = language.word(language.counted(arguments, 2)[1], language.MODES)
        if mode == "Abort":
            raise language.Refusal(language.OUT_OF_RANGE)  # used by the controller itself only
        self._select(mode, arguments[:1])

    def _ask(self, arguments: language.Arguments) -> str:
        language.check_axis(arguments, everything=False)
        return self._profiler.mode  # the full word, as a real unit answers; the manual prints the first letter


class Readback:
    """Read and all below it."""

    def __init__(self, drive: AclDrive, profiler: Profiler, states: StateFormat) -> None:
        self._axis = drive.axis
        self._profiler = profiler
        self._states = states

    def queries(self) -> dict[str, language.Query]:
        """Return the queries of readings."""
        of_axis = self._states.of_axis
        return {
            "Read:Position": lambda a: of_axis(a, self._position()),
            "Read:Rate": lambda a: of_axis(a, self._rate()),
            "Read:Acceleration": lambda a: of_axis(a, self._acceleration()),
            "Read:Vector": lambda a: of_axis(a, self._position(), self._rate(), self._acceleration()),
            "Read:ShortVector": lambda a: of_axis(a, self._position(), self._rate()),
        }

    def _position(self) -> tuple[float, float]:
        return round(self._axis.angle_deg() % 360.0, 5) % 360.0, language.ANGLE

    def _rate(self) -> tuple[float, float]:
        return self._axis.rate_deg_s(), language.RATE

    def _acceleration(self) -> tuple[float, float]:
        return self._profiler.acceleration_deg_s2(), language.ACCELERATION


class Registers:
    """Status:CSR: the present registers, by name."""

    _REGISTERS = Handlers()

    def __init__(
        self,
        drive: AclDrive,
        demand: Demand,
        profiler: Profiler,
        protection: Protection,
        *,
        status: AclStatus,
        panel: FrontPanel,
    ) -> None:
        self._drive = drive
        self._demand = demand
        self._profiler = profiler
        self._protection = protection
        self._status = status
        self._panel = panel
        self._registers: dict[str, Callable[[], int]] = {
            **self._REGISTERS.bound(self),
            "A1ERR": lambda: 0,
            "A1SWFLT": lambda: protection.faults,
            "A1SWFAULT": lambda: protection.faults,
            "A1INTLK": lambda: protection.interlocks,
            "ACP": lambda: bool(self._axis()) << 1,
            "SI": lambda: bool(protection.interlocks) << 2 | bool(protection.faults) << 3,
            "G1INTLK": lambda: (protection.interlocks >> 7 & 3) | (protection.interlocks >> 9 & 1) << 15,
            "SUP": lambda: 1,
            "RI": lambda: 0,
        }

    def queries(self) -> dict[str, language.Query]:
        """Return the query of a register."""
        return {"Status:CSR": self._ask}

    def _ask(self, arguments: language.Arguments) -> str:
        if not 1 <= len(arguments) <= 2:
            raise language.Refusal(language.OUT_OF_RANGE)
        register = self._registers.get(arguments[0].upper())
        if register is None:
            raise language.Refusal(language.OUT_OF_RANGE)
        value = register()
        if len(arguments) == 1:
            return str(value)
        return str(value >> language.integer(arguments[1], 0, 15) & 1)

    @_REGISTERS.of("A1")
    def _axis(self) -> int:
        return bool(self._state()) | bool(self._dynamic()) << 1

    @_REGISTERS.of("A1STATE", "A1STATIC")
    def _state(self) -> int:
        drive = self._drive
        mode = "Abort" if drive.aborting else self._profiler.mode
        reason = 0 if drive.servoed or not drive.unservo_bit else 1 << drive.unservo_bit
        return language.MODES.index(mode) | drive.servoed << 4 | reason | self._protection.tripped << 8

    @_REGISTERS.of("A1DYN")
    def _dynamic(self) -> int:
        if not self._drive.servoed:
            return 0
        return self._ramping() | self._limited() | self._profiling()

    def _ramping(self) -> int:
        direction = self._profiler.ramp_direction()
        return (direction > 0) << 2 | (direction < 0) << 3

    def _limited(self) -> int:
        """Return the bits of limits that keep the axis from its demand: rate limits and ends of travel."""
        profiler, demanded = self._profiler, self._demand.rate_deg_s
        complete = self._drive.motion.profile_complete()
        limited = profiler.regulates_rate and complete and demanded != profiler.profiled_rate_deg_s()
        return limited << (4 if demanded > 0 else 5) | (profiler.at_end > 0) << 6 | (profiler.at_end < 0) << 7

    def _profiling(self) -> int:
        """Return the bits of the state of profiler and synthesizer."""
        complete, swings = self._drive.motion.profile_complete(), self._drive.motion.oscillating
        arrived = self._profiler.mode in {"Position", "Track"} and complete and not self._drive.moves.active
        return arrived << 8 | (complete and not swings) << 9 | (swings and complete) << 10 | swings << 11

    @_REGISTERS.of("SUP1")
    def _supervisor(self) -> int:
        panel, status = self._panel, self._status
        in_command = panel.remote_active << 1 | panel.remote_lockout << 2 | panel.lockout << 3
        return 1 | in_command | status.full << 12 | status.empty << 13


def system_queries() -> dict[str, language.Query]:
    """Return the queries of the controller itself."""
    return {
        "*IDN": lambda _: "Acutronic R&D USA,Acutrol3000,0,A8800-001-01.000-a",
        "Query:System": lambda _: "1,1",
        "Query:Error": lambda arguments: language.WORDS.get(
            language.integer(language.one(arguments), 0, 65535), "UNKNOWN ERROR"
        ),
        "Query:TotalVariables": lambda _: "0",
    }
