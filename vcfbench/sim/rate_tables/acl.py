"""A simulated ACUTROL3000 motion controller with one continuous axis, spoken to in ACL over a serial line.

Sources: Acutronic TM-8004-C (ACL), TM-9385A (interlocks), TM-9388 (user guide), TM-9411 (RS-232 hook-up); the grammar
is in :mod:`vcfbench.sim.rate_tables.acl_language`. Unverified, and said so where it matters: the reply prefix's byte
order, the body of an acknowledgement, the numeric error codes (their appendix is missing from the manual), the
coding of the mode bits, and what a faulty command answers.
"""

from __future__ import annotations

import math
import struct
from collections import deque
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

from vcfbench.sim.motion import Swing
from vcfbench.sim.rate_tables.acl_language import MAX_MESSAGE_CHARS, BadCommand, Request, parse_message
from vcfbench.sim.rate_tables.axis import Axis, PositionMoves, TableErrors, TableWorld
from vcfbench.sim.rate_tables.interlocked import interlock_adjustments
from vcfbench.sim.rate_tables.line import LineDevice, SerialTiming

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from vcfbench.sim.adjustment import Adjustment

__all__ = ["AclTable", "AxisLimits", "Header", "TableErrors"]

Header = Literal["none", "u32le2", "u32be2"]

_TIMING = SerialTiming(baud=9600.0, processing_s=0.002)
"""9600 8N1 (TM-9411); 2 ms is what TCP clients see, so it is the controller's own share."""
_DRIVE_ENABLE_DELAY_S = 0.2
"""Interlock:Close to servoed: a configured parameter on the real unit; clients leave 0.25 s (unverified)."""

_PARSING = 1
_OUT_OF_RANGE = 2
_TOO_LONG = 3
_LOCAL = 4
_WORDS = {
    0: "NO ERROR",
    _PARSING: "COMMAND PARSING ERROR",
    _OUT_OF_RANGE: "PARAMETER OUT OF RANGE",
    _TOO_LONG: "MESSAGE TOO LONG",
    _LOCAL: "REMOTE NOT ACTIVE",
}
"""The numbers and most of the words are ours: the manual's list of codes is missing."""

_MODES = ("Position", "Rate", "Arate", "Synthesis", "Track", "Abort", "Off")
"""In the order of TM-8004-C 4.7; their place is taken as the code in A1STATE bits 0-3 (inferred)."""

_POLL_S = 0.002
"""How often the measured rate is looked at when it decides what happens next."""
_LAZY_POLL_S = 0.05
"""The same at constant rate."""
_AT_REST_DEG_S = 0.02
"""Measured rate at which an orderly shutdown opens the servo."""

_STB_INTERLOCK, _STB_AXIS, _STB_SUMMARY, _STB_QUEUE = 0x01, 0x02, 0x40, 0x80
_SOFT_ABORT_BIT, _RATE_TRIP_BIT, _TRACKING_BIT = 0, 1, 2
_INTERLOCK_BITS = {"drive_fault": 6, "door": 7, "emergency_stop": 8, "interlock": 9}
"""Power-amplifier acknowledgement, inputs 1 and 2 (what they are wired to is the installation's), front panel."""
_HELD_DEG_S2 = 1e4
"""How fast an axis that something holds comes to rest (chosen)."""
_SETTLE_S = 0.15
"""Pause for the rate loop before a turning axis that was stopped begins to oscillate (chosen)."""
_TRACK_MS = 1.0
"""Interval between demands in TRACK mode, if none is given (TM-8004-C 4.7.7)."""
_TRACK_REACH_S = 0.1
"""In TRACK mode with a demanded rate the lag in position is made up within this time (chosen)."""
_UNLIMITED_DEG = 1e9


class _Refusal(Exception):
    """A command that parses but cannot be done; `code` is the error number."""

    def __init__(self, code: int) -> None:
        super().__init__(_WORDS[code])
        self.code = code


@dataclass(frozen=True, slots=True)
class AxisLimits:
    """Working limits of one profiler mode: deg/s, deg/s2, deg/s3."""

    rate_deg_s: float
    acceleration_deg_s2: float
    jerk_deg_s3: float


@dataclass(frozen=True, slots=True)
class _GlobalLimits:
    """Limits that hold in every mode."""

    low_deg: float
    high_deg: float
    trip_deg_s: float
    tracking_deg: float


_FACTORY = AxisLimits(1000.0, 4200.0, 1e6)
"""Rate and acceleration of the BD125 table without load (its data sheet)."""
_FACTORY_GLOBAL = _GlobalLimits(-_UNLIMITED_DEG, _UNLIMITED_DEG, 1200.0, 10.0)
_POWER_ON = AxisLimits(1000.0, 100.0, 1e6)
_POWER_ON_GLOBAL = _GlobalLimits(-_UNLIMITED_DEG, _UNLIMITED_DEG, 1100.0, 5.0)


@dataclass(frozen=True, slots=True)
class _OscillatorSetup:
    """Configure:Oscillator (TM-8004-C 4.2.19). Power-on values are chosen; a frequency is taken at once, not slewed."""

    enabled: str = "Disable"
    amplitude_slew: float = 10.0
    frequency_slew: float = 1.0
    amplitude_of: str = "Position"
    frequency_mode: str = "Linear"


@dataclass(slots=True)
class _Demand:
    """What the host has asked for, used or not."""

    rate_deg_s: float = 0.0
    position_deg: float = 0.0
    acceleration_deg_s2: float = 0.0
    delta_deg: float = 0.0
    oscillator: tuple[float, float, float] = (0.0, 0.0, 0.0)


class AclTable(LineDevice):
    """The controller with its table. It keeps turning when the host goes silent: ACL knows no host time-out.

    `header` is the prefix of every reply: none, or error code and length as two 32-bit words of either byte order.
    Without a prefix a command is acknowledged by ``OK``, a faulty one by an empty line (both unverified).
    """

    def __init__(self, world: TableWorld, errors: TableErrors, header: Header = "none") -> None:
        super().__init__(world.clock, _TIMING, terminators=b"\r\n", longest=MAX_MESSAGE_CHARS)
        self._motion = world.table
        self._axis = Axis(world, errors)
        self._moves = PositionMoves(world, self._axis)
        self._header = header
        self._wired = errors.interlocks
        self.remote_active = True
        """The front panel's ACTIVATE REMOTE; while it is off no command acts, queries do."""
        self._mode = "Off"
        self._demand = _Demand()
        self._limits = dict.fromkeys(_MODES, _POWER_ON)
        self._global = _POWER_ON_GLOBAL
        self._lockout = False
        self._remote_lockout = False
        self._closing_at_s: float | None = None
        self._aborting = False
        self._unservo_bit = 0
        self._faults = 0
        self._interlocks_now = 0
        self._interlocks_latched = 0
        self._stb = 0
        self._service_enable = _STB_INTERLOCK
        self._event_enable = 0
        self._binary = False
        self._inputs = [0.0] * 12
        self._setup = _OscillatorSetup()
        self._swing: Swing | None = None
        self._swing_s = 0.0
        self._swing_due_s: float | None = None
        self._track_s = _TRACK_MS / 1e3
        self._track_due_s: float | None = None
        self._jammed = False
        self._at_end = 0
        self._queue: deque[str] = deque(maxlen=64)
        self._commands = self._command_table()
        self._queries = self._query_table()

    # --- outside the wire -------------------------------------------------------------------------------------

    def set_interlock(self, cause: str | int, *, faulty: bool) -> None:
        """Break or restore an interlock: by the name that it has on any table, or bit 0...15 of ours.

        A broken one drops the drive at once if the axis is servoed, and stays latched until Interlock:Reset.

        Raises:
            ValueError: there is none of that name.
        """
        if isinstance(cause, str) and cause not in _INTERLOCK_BITS:
            raise ValueError(f"an interlock is one of {', '.join(_INTERLOCK_BITS)}, not {cause!r}")
        mask = (1 << (_INTERLOCK_BITS[cause] if isinstance(cause, str) else cause)) if self._wired else 0
        self._interlocks_now = self._interlocks_now | mask if faulty else self._interlocks_now & ~mask
        self._advance()

    def jam(self, *, held: bool) -> None:
        """Hold the axis from outside, or let it go: the tracking error trips while it should turn."""
        self._jammed = held
        self._advance()

    def adjustments(self) -> Iterable[Adjustment]:
        """Return what can be seen and changed of a served table from outside its wire."""
        return interlock_adjustments(self, self._broken, lambda: self._jammed, self._shut_down_by)

    def _broken(self) -> list[str]:
        return [cause for cause, bit in _INTERLOCK_BITS.items() if self._interlocks_now >> bit & 1]

    def _shut_down_by(self) -> list[str]:
        causes = [cause for cause, bit in _INTERLOCK_BITS.items() if self._interlocks_latched >> bit & 1]
        trips = {_RATE_TRIP_BIT: "over_rate", _TRACKING_BIT: "following_error"}
        return causes + [cause for bit, cause in trips.items() if self._faults >> bit & 1]

    # --- the wire ---------------------------------------------------------------------------------------------

    def _answer(self, message: bytes) -> bytes | None:
        replies, code = list[str](), 0
        for item in parse_message(message.decode("latin-1")):
            try:
                reply = self._do(item)
            except _Refusal as refusal:
                self._log(refusal.code, item)
                code = code or refusal.code
            else:
                if reply is not None:
                    replies.append(reply)
        return self._framed(code, replies)

    def _overflow(self) -> bytes | None:
        self._note(f"{_TOO_LONG},{_WORDS[_TOO_LONG]}")
        return self._framed(_TOO_LONG, [])

    def _framed(self, code: int, replies: list[str]) -> bytes:
        text = ";".join(replies) if replies else "" if code else "OK"
        # latin-1: a reply in BINARY format carries bytes of any value
        body = text.encode("latin-1")
        if self._header == "none":
            return body + b"\r\n"
        return struct.pack("<II" if self._header == "u32le2" else ">II", code, len(body)) + body

    def _do(self, item: Request | BadCommand) -> str | None:
        if isinstance(item, BadCommand):
            raise _Refusal(_PARSING)
        # Act2000 compatibility: the question mark of a Read may be left out
        if item.query or item.path.startswith("Read:"):
            return self._query(item)
        action = self._commands.get(item.path)
        if action is None:
            raise _Refusal(_PARSING)
        if not self.remote_active:
            raise _Refusal(_LOCAL)
        action(item.arguments)
        return None

    def _query(self, request: Request) -> str:
        query = self._queries.get(request.path)
        if query is None:
            raise _Refusal(_PARSING)
        return query(request.arguments)

    def _log(self, code: int, item: Request | BadCommand) -> None:
        name = str(item) if isinstance(item, BadCommand) else item.path
        self._note(f"{code},{_WORDS[code]},{name}")

    def _note(self, text: str) -> None:
        self._queue.append(text)
        self._stb |= _STB_QUEUE

    # --- what happens by itself -------------------------------------------------------------------------------

    def _advance(self) -> None:
        self._close_when_due()
        self._check_interlocks()
        self._check_rate()
        self._check_tracking()
        self._check_end()
        self._check_track()
        self._moves.advance()
        if self._swing_due_s is not None and self._clock.now() >= self._swing_due_s:
            self._swing_due_s = None
            self._begin_to_swing()
        if self._aborting and self._motion.profile_complete() and abs(self._axis.rate_deg_s()) <= _AT_REST_DEG_S:
            self._aborting = False
            self._motion.open_servo()

    def _own_events_s(self) -> tuple[float, ...]:
        instants = (
            *(self._closing_at_s, self._moves.due_s, self._swing_due_s, self._track_due_s),
            *(self._abort_ends_s(), self._trip_due_s(), self._end_due_s(), self._held_due_s()),
        )
        return tuple(instant for instant in instants if instant is not None)

    def _abort_ends_s(self) -> float | None:
        acceleration = self._limits["Abort"].acceleration_deg_s2
        if not self._aborting or acceleration == 0.0:
            return None
        return self._clock.now() + max(abs(self._motion.profile_rate_deg_s()) / acceleration, _POLL_S)

    def _trip_due_s(self) -> float | None:
        """Return when the rate may trip: the crossing of a ramp beyond the trip, then poll by poll."""
        goal, trip = self._goal_deg_s(), self._global.trip_deg_s
        if self._motion.servo_closed and self._motion.oscillating and self._peak_deg_s() > trip:
            return self._clock.now() + _POLL_S
        if self._aborting or not self._motion.servo_closed or abs(goal) <= trip:
            return None
        if not self._ramp_direction():
            return self._clock.now() + _LAZY_POLL_S
        along = math.copysign(1.0, goal) * self._motion.profile_rate_deg_s()
        wait = (trip - along) / self._limits[self._mode].acceleration_deg_s2
        return self._clock.now() + max(wait, _POLL_S)

    def _peak_deg_s(self) -> float:
        """Return the largest rate of the oscillation, deg/s."""
        return 0.0 if self._swing is None else abs(self._swing.to_deg) * 2 * math.pi * self._swing.frequency_hz

    def _held_due_s(self) -> float | None:
        if not self._motion.servo_closed or not (self._jammed or self._faults >> _TRACKING_BIT & 1):
            return None
        return self._clock.now() + _LAZY_POLL_S

    def _end_due_s(self) -> float | None:
        """Return when a rate run must begin to brake before an end of travel, if there is one."""
        rate = self._motion.profile_rate_deg_s()
        if not self._motion.servo_closed or not rate or math.isinf(self._left_deg(rate)):
            return None
        fastest = max(abs(rate), abs(self._goal_deg_s()))
        return self._clock.now() + max(self._left_deg(rate) / fastest / 2.0, _POLL_S)

    def _left_deg(self, rate_deg_s: float) -> float:
        """Return the way left until the axis must brake for the end that it turns to, deg; inf where there is none."""
        end = self._global.high_deg if rate_deg_s > 0.0 else self._global.low_deg
        acceleration = self._limits[self._mode].acceleration_deg_s2
        if abs(end) >= _UNLIMITED_DEG or not acceleration:
            return math.inf
        braking_deg = rate_deg_s**2 / (2.0 * acceleration) + abs(rate_deg_s) * _POLL_S
        return (end - self._axis.angle_deg()) * math.copysign(1.0, rate_deg_s) - braking_deg

    def _check_end(self) -> None:
        """Stop a run at the end of travel: the command processor does not go beyond a position limit."""
        rate = self._motion.profile_rate_deg_s()
        if not self._motion.servo_closed or self._moves.active or self._mode not in {"Rate", "Arate"}:
            return
        if rate * self._motion.goal_deg_s() > 0.0 and self._left_deg(rate) <= 0.0:
            self._at_end = 1 if rate > 0.0 else -1
            self._motion.demand_rate(0.0, self._limits[self._mode].acceleration_deg_s2)

    def _check_track(self) -> None:
        if self._track_due_s is not None and self._clock.now() >= self._track_due_s:
            self._track_due_s = None
            self._mode = "Off"  # TM-8004-C 4.7.7
            self._follow()

    def _check_tracking(self) -> None:
        if not self._motion.servo_closed:
            return
        if self._faults >> _TRACKING_BIT & 1:
            if abs(self._axis.rate_deg_s()) <= _AT_REST_DEG_S:
                self._motion.open_servo()
        elif self._jammed and self._motion.profile_rate_deg_s() and self._motion.goal_deg_s():
            self._faults |= 1 << _TRACKING_BIT
            self._unservo_bit = 7
            self._aborting = False
            self._moves.cancel()
            self._fault("TRACKING ERROR FAULT")
            self._motion.demand_rate(0.0, _HELD_DEG_S2)

    def _goal_deg_s(self) -> float:
        """Return the rate that the profile goes to."""
        if self._aborting:
            return 0.0
        return self._moves.goal_deg_s if self._moves.active else self._profiled_rate()

    def _close_when_due(self) -> None:
        if self._closing_at_s is None or self._clock.now() < self._closing_at_s:
            return
        self._closing_at_s = None
        self._motion.close_servo()
        self._follow()

    def _check_interlocks(self) -> None:
        servoing = self._motion.servo_closed or self._closing_at_s is not None
        if not self._interlocks_now or not servoing:  # tested only while servoed (TM-9385A)
            return
        self._interlocks_latched |= self._interlocks_now
        self._closing_at_s = None
        self._aborting = False
        self._unservo_bit = 7
        self._moves.cancel()
        self._motion.open_servo()
        self._fault("HARDWARE INTERLOCK")

    def _check_rate(self) -> None:
        if not self._motion.servo_closed or self._faults & (1 << _RATE_TRIP_BIT):
            return
        if abs(self._axis.rate_deg_s()) > self._global.trip_deg_s:
            self._faults |= 1 << _RATE_TRIP_BIT | 1 << _SOFT_ABORT_BIT
            self._fault("MAXIMUM RATE FAULT")
            self._abort(6)

    def _fault(self, words: str) -> None:
        self._stb |= _STB_INTERLOCK | _STB_AXIS
        self._queue.append(f"0,{words}")

    def _abort(self, reason_bit: int) -> None:
        """Ramp to rest by the ABORT profile, then open the servo; `reason_bit` of A1STATE says why."""
        self._aborting = True
        self._moves.cancel()
        self._unservo_bit = reason_bit
        acceleration = self._limits["Abort"].acceleration_deg_s2
        if acceleration > 0.0:
            self._motion.demand_rate(0.0, acceleration)

    def _follow(self) -> None:
        """Let the profiler act on the demand of the present mode; a zero acceleration limit inhibits every change."""
        if not self._motion.servo_closed or self._aborting:
            return
        limits = self._limits[self._mode]
        if limits.acceleration_deg_s2 == 0.0:
            return
        self._moves.cancel()
        self._swing_due_s = None
        if self._mode == "Synthesis":
            self._swing_about_here(limits)
        elif self._mode == "Track":
            self._track(limits)
        elif self._mode == "Position" and limits.rate_deg_s > 0.0:
            self._moves.start(self._nearest_target(), limits.rate_deg_s, limits.acceleration_deg_s2)
        else:
            self._motion.demand_rate(self._profiled_rate(), limits.acceleration_deg_s2)

    def _swing_about_here(self, limits: AxisLimits) -> None:
        """Oscillate about the present position; a turning axis is stopped first, for it would have no centre."""
        rate = abs(self._motion.profile_rate_deg_s())
        if not self._motion.oscillating and rate:
            self._motion.demand_rate(0.0, limits.acceleration_deg_s2)
            self._swing_due_s = self._clock.now() + rate / limits.acceleration_deg_s2 + _SETTLE_S
        else:
            self._begin_to_swing()

    def _begin_to_swing(self) -> None:
        now, going = self._clock.now(), self._swing if self._motion.oscillating else None
        magnitude, frequency, phase = self._demand.oscillator
        slew = self._setup.amplitude_slew / self._per_degree(frequency)
        present, phase_rad = (0.0, math.radians(phase)) if going is None else _state_of(going, now - self._swing_s)
        self._swing = Swing(present, self._amplitude_deg(magnitude, frequency), slew, frequency, phase_rad)
        self._swing_s = now
        self._motion.oscillate(self._swing)

    def _per_degree(self, frequency_hz: float) -> float:
        """Return how much of the regulated state a degree of amplitude is."""
        power = {"Position": 0, "Rate": 1, "Acceleration": 2}[self._setup.amplitude_of]
        return (2 * math.pi * frequency_hz) ** power if frequency_hz else 1.0

    def _amplitude_deg(self, magnitude: float, frequency_hz: float) -> float:
        """Return the amplitude that the limits of SYNTHESIS mode leave of what was demanded, deg."""
        limits, turning = self._limits["Synthesis"], 2 * math.pi * frequency_hz
        if not turning:
            return 0.0  # a sinusoid of frequency 0 is a constant
        most = min(limits.rate_deg_s / turning, limits.acceleration_deg_s2 / turning**2)
        return max(-most, min(most, magnitude / self._per_degree(frequency_hz)))

    def _track(self, limits: AxisLimits) -> None:
        """Go to the demanded state; the real profile is time-optimal, this one makes up its lag in a set time."""
        rate = self._demand.rate_deg_s
        if rate == 0.0 and limits.rate_deg_s > 0.0:
            self._moves.start(self._nearest_target(), limits.rate_deg_s, limits.acceleration_deg_s2)
            return
        wanted = rate + (self._nearest_target() - self._axis.angle_deg()) / _TRACK_REACH_S
        wanted = max(-limits.rate_deg_s, min(limits.rate_deg_s, wanted))
        self._motion.demand_rate(wanted, limits.acceleration_deg_s2)

    def _nearest_target(self) -> float:
        """Return the accumulated angle nearest to the present one that shows the demanded position (shortest path)."""
        present = self._axis.angle_deg()
        target = present + math.remainder(self._demand.position_deg - present, 360.0)
        return max(self._global.low_deg, min(self._global.high_deg, target))

    def _follow_position(self) -> None:
        if self._mode == "Track":
            self._demand.rate_deg_s = 0.0
            self._keep_tracking()
        if self._mode in {"Position", "Track"}:
            self._follow()

    def _keep_tracking(self) -> None:
        """Begin to wait for the next demand: the first one after the mode starts the test (TM-8004-C 4.7.7)."""
        self._track_due_s = self._clock.now() + self._track_s if self._track_s else None

    def _profiled_rate(self) -> float:
        if self._mode not in {"Rate", "Arate"}:
            return 0.0
        if self._demand.rate_deg_s * self._at_end > 0.0:
            return 0.0
        limit = self._limits[self._mode].rate_deg_s
        return max(-limit, min(limit, self._demand.rate_deg_s))

    # --- commands ---------------------------------------------------------------------------------------------

    def _command_table(self) -> dict[str, Callable[[tuple[str, ...]], None]]:
        return {
            "Configure:Oscillator": self._configure_oscillator,
            "Demand:Rate": self._demand_rate,
            "Demand:Position": self._demand_position,
            "Demand:DeltaPosition": self._demand_delta,
            "Demand:Acceleration": self._demand_acceleration,
            "Demand:Oscillator": self._demand_oscillator,
            "Demand:InputVariable": self._demand_input,
            "Demand:ShortVector": lambda a: self._demand_vector(a, 2),
            "Demand:Vector": lambda a: self._demand_vector(a, 3),
            "Interlock:Close": self._interlock_close,
            "Interlock:Open": self._interlock_open,
            "Interlock:Reset": self._interlock_reset,
            "Limit": self._set_limit,
            "Limit:Acceleration": lambda a: self._set_mode_limit(a, "acceleration_deg_s2"),
            "Limit:Rate": lambda a: self._set_mode_limit(a, "rate_deg_s"),
            "Limit:Jerk": lambda a: self._set_mode_limit(a, "jerk_deg_s3"),
            "Limit:Vtrip": lambda a: self._set_global_limit(a, "trip_deg_s"),
            "Limit:HighPosition": lambda a: self._set_global_limit(a, "high_deg"),
            "Limit:LowPosition": lambda a: self._set_global_limit(a, "low_deg"),
            "Limit:Global": self._set_global,
            "Mode": self._set_mode,
            **{f"Mode:{mode}": self._mode_command(mode) for mode in _MODES if mode != "Abort"},
            "Status:MSGClr": lambda _: self._queue.clear(),
            "Utility:Lockout": lambda a: setattr(self, "_lockout", _switch(a)),
            "Utility:RemoteLockout": lambda a: setattr(self, "_remote_lockout", _switch(a)),
            "Utility:Format": self._set_format,
            "*CLS": lambda _: self._clear_status(),
            "*SRE": lambda a: setattr(self, "_service_enable", _integer(_one(a), 0, 255)),
            "*ESE": lambda a: setattr(self, "_event_enable", _integer(_one(a), 0, 255)),
        }

    def _mode_command(self, mode: str) -> Callable[[tuple[str, ...]], None]:
        return lambda arguments: self._select(mode, arguments)

    def _select(self, mode: str, arguments: tuple[str, ...]) -> None:
        _axis(arguments, most=2 if mode == "Track" else 1)
        if mode == "Track":
            self._track_s = _interval_ms(arguments[1] if len(arguments) == 2 else None) / 1e3
        self._mode, self._track_due_s = mode, None
        self._follow()

    def _set_mode(self, arguments: tuple[str, ...]) -> None:
        mode = _word(_count(arguments, 2)[1], _MODES)
        if mode == "Abort":
            raise _Refusal(_OUT_OF_RANGE)  # used by the controller itself only
        self._select(mode, arguments[:1])

    def _demand_rate(self, arguments: tuple[str, ...]) -> None:
        (self._demand.rate_deg_s,) = _axis_values(arguments, 1)
        self._at_end = 0 if self._demand.rate_deg_s * self._at_end <= 0.0 else self._at_end
        if self._mode in {"Rate", "Arate"}:
            self._follow()

    def _demand_position(self, arguments: tuple[str, ...]) -> None:
        (self._demand.position_deg,) = _axis_values(arguments, 1)
        self._follow_position()

    def _demand_delta(self, arguments: tuple[str, ...]) -> None:
        (self._demand.delta_deg,) = _axis_values(arguments, 1)
        self._demand.position_deg += self._demand.delta_deg
        self._follow_position()

    def _demand_acceleration(self, arguments: tuple[str, ...]) -> None:
        (self._demand.acceleration_deg_s2,) = _axis_values(arguments, 1)

    def _demand_oscillator(self, arguments: tuple[str, ...]) -> None:
        amplitude, frequency, phase = _axis_values(arguments, 3)
        if frequency < 0.0:
            raise _Refusal(_OUT_OF_RANGE)
        self._demand.oscillator = (amplitude, frequency, phase)
        if self._mode == "Synthesis":
            self._follow()

    def _configure_oscillator(self, arguments: tuple[str, ...]) -> None:
        axis, enabled, amplitude, frequency, amplitude_of, frequency_mode = _count(arguments, 6)
        _axis((axis,))
        slews = _number(amplitude), _number(frequency)
        if min(slews) <= 0.0:
            raise _Refusal(_OUT_OF_RANGE)
        state = _word(amplitude_of, ("Position", "Rate", "Acceleration"))
        mode = _word(frequency_mode, ("Linear", "Logarithmic"))
        self._setup = _OscillatorSetup(_word(enabled, ("Enable", "Disable")), *slews, state, mode)

    def _ask_setup(self, arguments: tuple[str, ...]) -> str:
        _axis(arguments, everything=False)
        setup = self._setup
        slews = _decimal(setup.amplitude_slew), _decimal(setup.frequency_slew)
        return ",".join((setup.enabled, *slews, setup.amplitude_of, setup.frequency_mode))

    def _demand_input(self, arguments: tuple[str, ...]) -> None:
        register, value = _count(arguments, 2)
        self._inputs[_integer(register, 1, 12) - 1] = _number(value)

    def _demand_vector(self, arguments: tuple[str, ...], size: int) -> None:
        values = _axis_values(arguments, size)
        self._demand.position_deg, self._demand.rate_deg_s = values[:2]
        if size == 3:
            self._demand.acceleration_deg_s2 = values[2]
        if self._mode == "Track":
            self._keep_tracking()
        if self._mode in {"Rate", "Arate", "Position", "Track"}:
            self._follow()

    def _interlock_close(self, arguments: tuple[str, ...]) -> None:
        _axis(arguments)
        if self._motion.servo_closed or self._closing_at_s is not None:
            return
        if self._faulted():
            self._stb |= _STB_INTERLOCK
            return
        self._unservo_bit = 0
        self._closing_at_s = self._clock.now() + _DRIVE_ENABLE_DELAY_S

    def _interlock_open(self, arguments: tuple[str, ...]) -> None:
        _axis(arguments)
        self._closing_at_s = None
        if self._motion.servo_closed and not self._aborting:
            self._abort(5)
            self._advance()

    def _interlock_reset(self, arguments: tuple[str, ...]) -> None:
        if arguments:
            raise _Refusal(_PARSING)
        if not self._motion.servo_closed:  # no effect on a servoed axis
            self._faults = 0
            self._interlocks_latched = 0

    def _set_limit(self, arguments: tuple[str, ...]) -> None:
        axis, mode, *values = _count(arguments, 5)
        _axis((axis,))
        wanted = AxisLimits(*(_number(value) for value in values))
        self._change_limits(_word(mode, _MODES), wanted)

    def _set_mode_limit(self, arguments: tuple[str, ...], name: str) -> None:
        mode, axis, value = _count(arguments, 3)
        _axis((axis,))
        mode = _word(mode, _MODES)
        self._change_limits(mode, replace(self._limits[mode], **{name: _number(value)}))

    def _change_limits(self, mode: str, wanted: AxisLimits) -> None:
        _within(wanted.rate_deg_s, _FACTORY.rate_deg_s)
        _within(wanted.acceleration_deg_s2, _FACTORY.acceleration_deg_s2)
        _within(wanted.jerk_deg_s3, _FACTORY.jerk_deg_s3)
        self._limits[mode] = wanted
        if mode == self._mode:
            self._follow()

    def _set_global_limit(self, arguments: tuple[str, ...], name: str) -> None:
        # the mode is there for Act2000's sake; the ACUTROL3000 has one value for all (TM-8004-C 4.6.4)
        mode, axis, value = _count(arguments, 3)
        _word(mode, _MODES)
        _axis((axis,))
        self._change_global(replace(self._global, **{name: _number(value)}))

    def _set_global(self, arguments: tuple[str, ...]) -> None:
        axis, *values = _count(arguments, 5)
        _axis((axis,))
        self._change_global(_GlobalLimits(*(_number(value) for value in values)))

    def _change_global(self, wanted: _GlobalLimits) -> None:
        _within(wanted.trip_deg_s, _FACTORY_GLOBAL.trip_deg_s)
        _within(wanted.tracking_deg, _FACTORY_GLOBAL.tracking_deg)
        if not -_UNLIMITED_DEG <= wanted.low_deg < wanted.high_deg <= _UNLIMITED_DEG:
            raise _Refusal(_OUT_OF_RANGE)
        self._global = wanted

    def _set_format(self, arguments: tuple[str, ...]) -> None:
        self._binary = _word(_one(arguments), ("Float", "Binary")) == "Binary"

    def _clear_status(self) -> None:
        self._stb = 0
        self._queue.clear()

    # --- queries ----------------------------------------------------------------------------------------------

    def _query_table(self) -> dict[str, Callable[[tuple[str, ...]], str]]:
        return {
            "*IDN": lambda _: "Acutronic R&D USA,Acutrol3000,0,A8800-001-01.000-a",
            "*STB": lambda _: self._status_byte_text(clearing=True),
            "*SRE": lambda _: str(self._service_enable),
            "*ESE": lambda _: str(self._event_enable),
            "*ESR": lambda _: "0",
            "Configure:Oscillator": self._ask_setup,
            "Demand:Rate": lambda a: self._of_axis(a, (self._demand.rate_deg_s, _RATE)),
            "Demand:Position": lambda a: self._of_axis(a, (self._demand.position_deg, _ANGLE)),
            "Demand:DeltaPosition": lambda a: self._of_axis(a, (self._demand.delta_deg, _ANGLE)),
            "Demand:Acceleration": lambda a: self._of_axis(a, (self._demand.acceleration_deg_s2, _ACCELERATION)),
            "Demand:Oscillator": self._ask_oscillator,
            "Demand:InputVariable": lambda a: _decimal(self._inputs[_integer(_one(a), 1, 12) - 1]),
            "Demand:ShortVector": lambda a: self._of_axis(a, *self._demanded()[:2]),
            "Demand:Vector": lambda a: self._of_axis(a, *self._demanded()),
            "Interlock": self._ask_interlock,
            "Limit": self._ask_limit,
            "Limit:Acceleration": lambda a: self._ask_mode_limit(a, "acceleration_deg_s2"),
            "Limit:Rate": lambda a: self._ask_mode_limit(a, "rate_deg_s"),
            "Limit:Jerk": lambda a: self._ask_mode_limit(a, "jerk_deg_s3"),
            "Limit:Vtrip": lambda a: self._ask_global_limit(a, "trip_deg_s"),
            "Limit:HighPosition": lambda a: self._ask_global_limit(a, "high_deg"),
            "Limit:LowPosition": lambda a: self._ask_global_limit(a, "low_deg"),
            "Limit:Absolute": lambda a: _listed(a, *_values(_FACTORY), *_global_values(_FACTORY_GLOBAL)),
            "Limit:Global": lambda a: _listed(a, *_global_values(self._global)),
            "Mode": self._ask_mode,
            "Query:System": lambda _: "1,1",
            "Query:Error": lambda a: _WORDS.get(_integer(_one(a), 0, 65535), "UNKNOWN ERROR"),
            "Query:TotalVariables": lambda _: "0",
            "Read:Position": lambda a: self._of_axis(a, self._measured()[0]),
            "Read:Rate": lambda a: self._of_axis(a, self._measured()[1]),
            "Read:Acceleration": lambda a: self._of_axis(a, self._measured()[2]),
            "Read:Vector": lambda a: self._of_axis(a, *self._measured()),
            "Read:ShortVector": lambda a: self._of_axis(a, *self._measured()[:2]),
            "Status:CSR": self._ask_condition,
            "Status:STB": lambda _: self._status_byte_text(clearing=False),
            "Status:MSG": self._ask_messages,
            "Utility:Lockout": lambda _: "ON" if self._lockout else "OFF",
            "Utility:RemoteLockout": lambda _: "ON" if self._remote_lockout else "OFF",
            "Utility:Format": lambda _: "BINARY" if self._binary else "FLOAT",
        }

    def _of_axis(self, arguments: tuple[str, ...], *states: tuple[float, float]) -> str:
        """Return the motion states of the axis, each (value, weight of the top bit in BINARY format)."""
        _axis(arguments, everything=False)
        if not self._binary:
            return ";".join(_decimal(value) for value, _ in states)
        block = b"".join(_scaled(value, weight) for value, weight in states)
        length = str(len(block))
        return f"#{len(length)}{length}" + block.decode("latin-1")

    def _measured(self) -> tuple[tuple[float, float], ...]:
        return (
            (_wrapped(self._axis.angle_deg()), _ANGLE),
            (self._axis.rate_deg_s(), _RATE),
            (self._acceleration(), _ACCELERATION),
        )

    def _demanded(self) -> tuple[tuple[float, float], ...]:
        demand = self._demand
        return (
            (demand.position_deg, _ANGLE),
            (demand.rate_deg_s, _RATE),
            (demand.acceleration_deg_s2, _ACCELERATION),
        )

    def _acceleration(self) -> float:
        """Return the profiled acceleration now, deg/s2; the real controller estimates it from the encoder."""
        direction = self._ramp_direction()
        return direction * self._limits["Abort" if self._aborting else self._mode].acceleration_deg_s2

    def _ramp_direction(self) -> int:
        if not self._motion.servo_closed or self._motion.profile_complete():
            return 0
        return 1 if self._goal_deg_s() > self._motion.profile_rate_deg_s() else -1

    def _ask_oscillator(self, arguments: tuple[str, ...]) -> str:
        _axis(arguments, everything=False)
        return ";".join(_decimal(value) for value in self._demand.oscillator)

    def _ask_interlock(self, arguments: tuple[str, ...]) -> str:
        _axis(arguments, everything=False)
        if self._faulted():
            return "Fault"
        return "Close" if self._motion.servo_closed else "Open"

    def _faulted(self) -> bool:
        return bool(self._faults or self._interlocks_latched or self._interlocks_now)

    def _ask_mode(self, arguments: tuple[str, ...]) -> str:
        _axis(arguments, everything=False)
        return self._mode  # the full word, as a real unit answers; the manual prints the first letter

    def _ask_limit(self, arguments: tuple[str, ...]) -> str:
        axis, mode = _count(arguments, 2)
        return _listed((axis,), *_values(self._limits[_word(mode, _MODES)]))

    def _ask_mode_limit(self, arguments: tuple[str, ...], name: str) -> str:
        mode, axis = _count(arguments, 2)
        _axis((axis,), everything=False)
        return _decimal(getattr(self._limits[_word(mode, _MODES)], name))

    def _ask_global_limit(self, arguments: tuple[str, ...], name: str) -> str:
        # the manual's examples ask both "? P,3" and "? 2"
        _axis(arguments[-1:], everything=False)
        return _decimal(getattr(self._global, name))

    def _status_byte_text(self, *, clearing: bool) -> str:
        summary = _STB_SUMMARY if self._stb & self._service_enable else 0
        value = self._stb | summary
        if clearing:
            self._stb = 0
        return str(value)

    def _ask_messages(self, arguments: tuple[str, ...]) -> str:
        if not arguments or len(arguments) > 2 or arguments[0].upper() not in {"QERROR", "QFAULT", "QALL"}:
            raise _Refusal(_OUT_OF_RANGE)
        wanted = 1 if len(arguments) == 1 else _message_count(arguments[1])
        messages = [self._queue.popleft() for _ in range(min(wanted, len(self._queue)))]
        if not self._queue:  # the bit says that there are messages, as a summary bit does (unverified)
            self._stb &= ~_STB_QUEUE
        return ";".join(messages)

    def _ask_condition(self, arguments: tuple[str, ...]) -> str:
        if not 1 <= len(arguments) <= 2:
            raise _Refusal(_OUT_OF_RANGE)
        registers = self._registers()
        value = registers.get(arguments[0].upper())
        if value is None:
            raise _Refusal(_OUT_OF_RANGE)
        if len(arguments) == 1:
            return str(value)
        return str(value >> _integer(arguments[1], 0, 15) & 1)

    def _registers(self) -> dict[str, int]:
        """Return the condition registers by name (TM-8004-C appendix B)."""
        state, dynamic, interlocks = self._state_register(), self._dynamic_register(), self._interlocks()
        axis = bool(state) | bool(dynamic) << 1
        return {
            "A1STATE": state,
            "A1STATIC": state,
            "A1DYN": dynamic,
            "A1ERR": 0,
            "A1SWFLT": self._faults,
            "A1SWFAULT": self._faults,
            "A1INTLK": interlocks,
            "A1": axis,
            "ACP": bool(axis) << 1,
            "SI": bool(interlocks) << 2 | bool(self._faults) << 3,
            "G1INTLK": (interlocks >> 7 & 3) | (interlocks >> 9 & 1) << 15,
            "SUP": 1,
            "SUP1": 1 | self.remote_active << 1 | self._remote_lockout << 2 | self._lockout << 3 | self._queue_bits(),
            "RI": 0,
        }

    def _queue_bits(self) -> int:
        return (not self._queue) << 13 | (len(self._queue) == self._queue.maxlen) << 12

    def _interlocks(self) -> int:
        return self._interlocks_latched | self._interlocks_now

    def _state_register(self) -> int:
        mode = "Abort" if self._aborting else self._mode
        servoed = self._motion.servo_closed
        reason = 0 if servoed or not self._unservo_bit else 1 << self._unservo_bit
        return _MODES.index(mode) | servoed << 4 | reason | bool(self._faults or self._interlocks_latched) << 8

    def _dynamic_register(self) -> int:
        if not self._motion.servo_closed:
            return 0
        direction, complete = self._ramp_direction(), self._motion.profile_complete()
        limited = self._mode in {"Rate", "Arate"} and complete and self._demand.rate_deg_s != self._profiled_rate()
        rate_bit = 4 if self._demand.rate_deg_s > 0 else 5
        arrived = self._mode in {"Position", "Track"} and complete and not self._moves.active
        ends = (self._at_end > 0) << 6 | (self._at_end < 0) << 7
        swings = self._motion.oscillating
        synthesizer = (swings and complete) << 10 | swings << 11
        profiler = arrived << 8 | (complete and not swings) << 9
        return (direction > 0) << 2 | (direction < 0) << 3 | limited << rate_bit | ends | profiler | synthesizer


# --- arguments and replies ------------------------------------------------------------------------------------

_ANGLE, _RATE, _ACCELERATION = 180.0, 11250.0, 703125.0
"""Weight of the top bit in BINARY format: deg, deg/s, deg/s2 (TM-8004-C 5.1.2)."""


def _scaled(value: float, weight: float) -> bytes:
    # least significant byte first (TM-8004-C 2.4)
    return struct.pack("<i", (round(value / weight * 2**31) + 2**31) % 2**32 - 2**31)


def _decimal(value: float) -> str:
    # adding zero turns a rounded -0.0 into 0.0: the controller sends no bare minus
    return f"{round(value, 5) + 0.0:.5f}"


def _wrapped(angle_deg: float) -> float:
    return round(angle_deg % 360.0, 5) % 360.0


def _values(limits: AxisLimits) -> tuple[float, float, float]:
    return limits.rate_deg_s, limits.acceleration_deg_s2, limits.jerk_deg_s3


def _global_values(limits: _GlobalLimits) -> tuple[float, float, float, float]:
    return limits.low_deg, limits.high_deg, limits.trip_deg_s, limits.tracking_deg


def _listed(arguments: tuple[str, ...], *values: float) -> str:
    _axis(arguments, everything=False)
    return ",".join(_decimal(value) for value in values)


def _count(arguments: tuple[str, ...], count: int) -> tuple[str, ...]:
    if len(arguments) != count:
        raise _Refusal(_OUT_OF_RANGE)
    return arguments


def _one(arguments: tuple[str, ...]) -> str:
    return _count(arguments, 1)[0]


def _axis(arguments: tuple[str, ...], *, most: int = 1, everything: bool = True) -> None:
    """Refuse an axis that does not exist; ALL is for commands only."""
    if not 1 <= len(arguments) <= most:
        raise _Refusal(_OUT_OF_RANGE)
    if arguments[0] != "1" and not (everything and arguments[0].upper() == "ALL"):
        raise _Refusal(_OUT_OF_RANGE)


def _axis_values(arguments: tuple[str, ...], count: int) -> tuple[float, ...]:
    axis, *values = _count(arguments, count + 1)
    _axis((axis,))
    return tuple(_number(value) for value in values)


def _number(text: str) -> float:
    # NRf with blanks allowed around the exponent, no suffix, no infinity (TM-8004-C 2.6.1.2)
    compact = "".join(text.split())
    if not compact or not set(compact) <= set("+-.0123456789eE"):
        raise _Refusal(_OUT_OF_RANGE)
    try:
        value = float(compact)
    except ValueError:
        raise _Refusal(_OUT_OF_RANGE) from None
    if abs(value) > 1e30:
        raise _Refusal(_OUT_OF_RANGE)
    return value


def _interval_ms(text: str | None) -> float:
    """Return the interval of TRACK mode, ms; 0 is no test."""
    value = _TRACK_MS if text is None else _number(text)
    if not 0.0 <= value <= 65535.0:
        raise _Refusal(_OUT_OF_RANGE)
    return value


def _state_of(swing: Swing, elapsed_s: float) -> tuple[float, float]:
    """Return amplitude (deg) and phase (rad) that an oscillation has reached."""
    share = min(elapsed_s / swing.lasts_s, 1.0) if swing.lasts_s else 1.0
    reached = swing.from_deg + share * (swing.to_deg - swing.from_deg)
    return reached, swing.phase_rad + 2 * math.pi * swing.frequency_hz * elapsed_s


def _integer(text: str, low: int, high: int) -> int:
    value = _number(text)
    if value != int(value) or not low <= value <= high:
        raise _Refusal(_OUT_OF_RANGE)
    return int(value)


def _within(value: float, high: float) -> None:
    # zero is taken, and inhibits every change of motion: the manual only says "should never be commanded"
    if not 0.0 <= value <= high:
        raise _Refusal(_OUT_OF_RANGE)


def _word(text: str, words: tuple[str, ...]) -> str:
    found = next((word for word in words if text and word.upper().startswith(text.upper())), None)
    if found is None:
        raise _Refusal(_OUT_OF_RANGE)
    return found


def _switch(arguments: tuple[str, ...]) -> bool:
    text = _one(arguments).upper()
    if text not in {"ON", "OFF"}:
        raise _Refusal(_OUT_OF_RANGE)
    return text == "ON"


def _message_count(text: str) -> int:
    return 64 if text.upper() == "ALL" else _integer(text, 1, 64)
