"""A simulated Newport ESP300/301 motion controller with one rotary stage on axis 1.

Commands after pages of the ESP300 manual and three public clients: axis number, two letters, value, carriage return;
``;`` chains; replies end in CR LF. The words of errors are those of PyMeasure's list. That a value which is missing is
error 38 is what the manual of a sibling (NewStep) says of AC. Unverified: that it holds of the other commands, 19200
Bd, the digits of numbers, that blanks are passed over everywhere (so a sibling's manual), the stage's limits, which
error an interlock reports, that a software limit stops a jog by its ramp, the values and limits of what is kept only.

Not simulated: programs in the controller (XX, EP, EX), groups of axes, units of lengths. The unit that is set counts in
all rates, accelerations and positions; the highest rate and acceleration (VU, AU) stay in degrees.
"""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import ClassVar

from simrack.handlers import Handlers
from simrack.rate_tables.axis import ServoAxis, TableErrors, TableWorld
from simrack.rate_tables.interlocked import Interlocked
from simrack.rate_tables.line import LineDevice, SerialTiming

__all__ = ["EspTable", "TableErrors"]

_TIMING = SerialTiming(baud=19200.0, processing_s=0.002)
_COMMAND = re.compile(r"(\d*)\s*([A-Za-z]{2})\s*([?]|[+-]?\d+(?:\.\d*)?|[+-])?")
_UNKNOWN, _RANGE, _AXIS, _MISSING = 6, 7, 37, 38
_EMERGENCY_STOP, _INTERLOCK = 4, 129
_AXIS_RANGE, _ABOVE_LIMIT, _BELOW_LIMIT, _TOO_FAST, _NOT_ENABLED = 101, 106, 107, 110, 113
_SHUT_DOWN = {"emergency_stop": _EMERGENCY_STOP, "drive_fault": 102, "following_error": 103, "over_rate": 110}
"""Errors of what shuts axis 1 down by itself; anything else is the interlock."""
_UNIT_DEG = {7: 1.0, 8: 0.9, 9: 180.0 / math.pi, 10: 0.18 / math.pi, 11: 0.18e-3 / math.pi}
"""Displacement units of SN that are angles: degree, gradian, radian, its thousandth and millionth."""
_WAIT_POLL_S = 0.01
_WORDS = {
    0: "NO ERROR DETECTED",
    _UNKNOWN: "COMMAND DOES NOT EXIST",
    _RANGE: "PARAMETER OUT OF RANGE",
    _AXIS: "AXIS NUMBER MISSING",
    _MISSING: "COMMAND PARAMETER MISSING",
    9: "AXIS NUMBER OUT OF RANGE",
    _EMERGENCY_STOP: "EMERGENCY STOP ACTIVATED",
    _AXIS_RANGE: "PARAMETER OUT OF RANGE",
    _ABOVE_LIMIT: "AXIS-1 POSITIVE SOFTWARE LIMIT DETECTED",
    _BELOW_LIMIT: "AXIS-1 NEGATIVE SOFTWARE LIMIT DETECTED",
    _INTERLOCK: "AXIS-1 DIGITAL I/O INTERLOCK DETECTED",
    102: "AXIS-1 AMPLIFIER FAULT DETECTED",
    103: "AXIS-1 FOLLOWING ERROR THRESHOLD EXCEEDED",
    110: "AXIS-1 MAXIMUM VELOCITY EXCEEDED",
    _NOT_ENABLED: "AXIS-1 MOTOR NOT ENABLED",
}
_MAX_RATE_DEG_S = 400.0
_MAX_ACCELERATION_DEG_S2 = 1000.0
_REAL, _WHOLE, _HEXADECIMAL = "{:.4f}".format, "{:.0f}".format, lambda value: f"{int(value):X}H"
_KEPT = {
    verb: (value, highest, form)
    for form, highest, values in (
        (_REAL, _MAX_RATE_DEG_S, {"VU": _MAX_RATE_DEG_S, "VB": 0, "JH": 20, "JW": 0, "OH": 20, "OL": 0}),
        (_REAL, _MAX_ACCELERATION_DEG_S2, {"AU": _MAX_ACCELERATION_DEG_S2}),
        (_REAL, 2e9, {"AE": 400, "JK": 1000, "AF": 0, "FE": 1, "KP": 40, "KI": 0.5, "KD": 100, "KS": 500}),
        (_REAL, 60.0, {"QI": 1, "QV": 48, "SU": 0.0002, "FR": 0.02}),
        (_WHOLE, 250, {"FP": 4, "QM": 1, "QS": 100, "TJ": 1}),
        (_HEXADECIMAL, 0xFFFF, {"ZB": 0, "ZH": 0x24}),
    )
    for verb, value in values.items()
}
"""Settings by their two letters (InstrumentKit's driver): value at first, highest value, form of the reply.

VU limits VA, and AU limits AC and AG; the others change nothing of this stage.
"""
_WANT_A_VALUE = frozenset({"VA", "AC", "AG", "MV", "PA", "PR", "SN", "SL", "SR", "MT", *_KEPT})
"""What means nothing without a value or a question mark."""


class _Refused(Exception):
    def __init__(self, number: int) -> None:
        super().__init__(_WORDS[number])
        self.number = number


class EspTable(Interlocked, LineDevice):
    """The controller; motor off after power-up. Errors go to a queue read by TE? or TB?."""

    _OF_AXIS = Handlers()

    errors_class: ClassVar = TableErrors

    def __init__(self, world: TableWorld, errors: TableErrors) -> None:
        super().__init__(world, _TIMING, terminators=b"\r\n", longest=80)
        self._axis = ServoAxis(world, errors, acceleration_deg_s2=100.0)
        self._deceleration_deg_s2 = 100.0
        self._velocity_deg_s = 20.0
        self._unit = 7
        self._direction = 0
        self._errors: deque[int] = deque(maxlen=10)
        self._shared: dict[str, Callable[[str], str | None]] = {
            "VE": lambda _: "ESP301 Version 3.0.1 6/1/99",
            "TE": lambda _: str(self._errors.popleft() if self._errors else 0),
            "TB": lambda _: self._error_text(),
            "TS": lambda _: chr(0x40 | self._axis.moving() | self._axis.enabled << 4),
            "AB": lambda _: self._abort(),
            "ST": lambda _: self._stop(),
            "RS": lambda _: self._abort(),
            "SM": lambda _: None,
        }
        self._kept = {verb: value for verb, (value, *_) in _KEPT.items()}
        self._of_axis: dict[str, Callable[[str], str | None]] = {
            "ID": lambda _: "URS75CC, SN0001",
            **self._OF_AXIS.bound(self),
            "PA": lambda value: self._go_to(0.0, value),
            "PR": lambda value: self._go_to(self._axis.position_deg(), value),
            "OR": lambda _: self._go_to(0.0, "0"),
            "ST": lambda _: self._stop(),
            "MD": lambda _: str(int(not self._axis.moving())),
            "TP": lambda _: self._shown(self._axis.position_deg()),
            "TV": lambda _: self._shown(self._axis.rate_deg_s()),
            "DP": lambda _: self._shown(self._target_deg),
            "SL": lambda value: self._soft_limit(0, value),
            "SR": lambda value: self._soft_limit(1, value),
            "AB": lambda _: self._abort(),
            **dict.fromkeys(("UF", "QD"), lambda _: None),
            **{verb: partial(self._keep, verb) for verb in _KEPT},
        }
        self._target_deg = self._home_deg = 0.0
        self._soft_deg = [-math.inf, math.inf]
        self._waiting_s: float | None = None
        self._awaited_deg: float | None = None
        self._resumes_s = 0.0
        self._held: deque[bytes] = deque()

    def _advance(self) -> None:
        self._watch()
        self._check_soft_limits()
        if self._waiting_s is not None and (not self._axis.moving() or self._arrived()):
            self._resumes_s, self._waiting_s = self._clock.now() + self._waiting_s, None
        while self._held and self._waiting_s is None and self._clock.now() >= self._resumes_s:
            message = self._held.popleft()
            self._send(self._answer(message))

    def _own_events_s(self) -> tuple[float, ...]:
        now = self._clock.now()
        held = () if not self._held else (now + _WAIT_POLL_S,)
        watched = (now + _WAIT_POLL_S,) if self._direction and any(map(math.isfinite, self._soft_deg)) else ()
        return (*self._axis.own_events_s(), *held, *watched)

    @property
    def answering(self) -> bool:
        """True if a reply is under way, waits to be read, or is held up by WS."""
        return super().answering or bool(self._held)

    def _check_soft_limits(self) -> None:
        """Stop a jog that comes to a software limit: it brakes there, and so runs over it a little."""
        if not self._direction or not self._axis.enabled:
            return
        position, (low, high) = self._axis.position_deg(), self._soft_deg
        if self._direction > 0 and position >= high:
            self._stop()
            self._errors.append(_ABOVE_LIMIT)
        elif self._direction < 0 and position <= low:
            self._stop()
            self._errors.append(_BELOW_LIMIT)

    @_OF_AXIS.of("WS")
    def _wait_for_stop(self, value: str) -> None:
        """Let the following commands wait until the axis stands, and milliseconds beyond that."""
        self._waiting_s, self._awaited_deg = _number(value or "0", 60_000.0) / 1e3, None

    @_OF_AXIS.of("WP")
    def _wait_for_position(self, value: str) -> None:
        """Let the following commands wait until the axis is past a position, or stands."""
        self._waiting_s, self._awaited_deg = 0.0, self._degrees(value)

    def _arrived(self) -> bool:
        """True if the axis is past the position of WP."""
        rate_deg_s = self._axis.rate_deg_s()
        if self._awaited_deg is None or not rate_deg_s:
            return False
        return (self._axis.position_deg() - self._awaited_deg) * rate_deg_s >= 0.0

    def _keep(self, verb: str, value: str) -> str | None:
        _, highest, form = _KEPT[verb]
        if value == "?":
            return form(self._kept[verb])
        self._kept[verb] = _number(value, highest)
        return None

    @_OF_AXIS.of("SN")
    def _units(self, value: str) -> str | None:
        if value == "?":
            return str(self._unit)
        if (unit := int(_number(value, 11.0))) not in _UNIT_DEG:
            raise _Refused(_AXIS_RANGE)
        self._unit = unit
        return None

    def _shown(self, degrees: float) -> str:
        return f"{degrees / _UNIT_DEG[self._unit] + 0.0:.4f}"

    def _degrees(self, value: str) -> float:
        return _signed(value) * _UNIT_DEG[self._unit]

    def _soft_limit(self, side: int, value: str) -> str | None:
        if value == "?":
            return self._shown(max(-1e9, min(1e9, self._soft_deg[side])))
        self._soft_deg[side] = self._degrees(value)
        return None

    def _noticed(self, cause: str, /) -> None:
        self._direction = 0
        self._errors.append(_SHUT_DOWN.get(cause, _INTERLOCK))

    def _answer(self, message: bytes) -> bytes | None:
        replies = []
        commands = deque(filter(None, (part.strip() for part in message.decode("latin-1").split(";"))))
        while commands:
            if self._waiting_s is not None or self._clock.now() < self._resumes_s:
                self._held.append(";".join(commands).encode("latin-1"))
                break
            command = commands.popleft()
            try:
                reply = self._do(command)
            except _Refused as refused:
                self._errors.append(refused.number)
            else:
                if reply is not None:
                    replies.append(f"{reply}\r\n")
        return "".join(replies).encode("latin-1") or None

    def _do(self, command: str) -> str | None:
        match = _COMMAND.fullmatch(command)
        if match is None:
            raise _Refused(_UNKNOWN)
        axis, verb, value = match[1], match[2].upper(), match[3] or ""
        if not axis:
            return self._do_shared(verb, value)
        if axis != "1":
            raise _Refused(9)
        action = self._of_axis.get(verb)
        if action is None:
            raise _Refused(_UNKNOWN)
        if not value and verb in _WANT_A_VALUE:
            raise _Refused(_MISSING)
        return action(value)

    def _do_shared(self, verb: str, value: str) -> str | None:
        action = self._shared.get(verb)
        if action is None:
            raise _Refused(_AXIS if verb in self._of_axis else _UNKNOWN)
        return action(value)

    def _error_text(self) -> str:
        number = self._errors.popleft() if self._errors else 0
        return f"{number}, {round(self._clock.now() * 2500)}, {_WORDS[number]}"

    @_OF_AXIS.of("MO")
    def _motor_on(self, value: str) -> str | None:
        if value == "?":
            return str(int(self._axis.enabled))
        self._direction = 0
        if not self._axis.enable():
            raise _Refused(_SHUT_DOWN.get(min(self._axis.broken), _INTERLOCK))
        return None

    @_OF_AXIS.of("MF")
    def _motor_off(self, value: str) -> str | None:
        if value == "?":
            return str(int(not self._axis.enabled))
        self._axis.disable()
        self._direction = 0
        return None

    @_OF_AXIS.of("VA")
    def _velocity(self, value: str) -> str | None:
        if value == "?":
            return self._shown(self._velocity_deg_s)
        velocity_deg_s = _number(value, math.inf) * _UNIT_DEG[self._unit]
        if velocity_deg_s > self._kept["VU"]:
            raise _Refused(_TOO_FAST)
        self._velocity_deg_s = velocity_deg_s
        if self._direction and self._axis.enabled:
            self._axis.run(self._direction * self._velocity_deg_s)
        return None

    @_OF_AXIS.of("AC")
    def _acceleration(self, value: str) -> str | None:
        if value == "?":
            return self._shown(self._axis.acceleration_deg_s2)
        scale = _UNIT_DEG[self._unit]
        self._axis.change_acceleration(_positive(value, self._kept["AU"] / scale) * scale)
        return None

    @_OF_AXIS.of("AG")
    def _deceleration(self, value: str) -> str | None:
        if value == "?":
            return self._shown(self._deceleration_deg_s2)
        scale = _UNIT_DEG[self._unit]
        self._deceleration_deg_s2 = _positive(value, self._kept["AU"] / scale) * scale
        return None

    @_OF_AXIS.of("MT")
    @_OF_AXIS.of("MV")
    def _move(self, value: str) -> str | None:
        if value not in {"+", "-"}:
            raise _Refused(_AXIS_RANGE)
        if not self._axis.enabled:
            raise _Refused(_NOT_ENABLED)
        self._direction = 1 if value == "+" else -1
        self._axis.run(self._direction * self._velocity_deg_s)
        return None

    def _go_to(self, start_deg: float, value: str) -> str | None:
        """Move to `start_deg` and `value`; with a question mark tell where a move would start."""
        if value == "?":
            return self._shown(self._axis.position_deg())
        if not self._axis.enabled:
            raise _Refused(_NOT_ENABLED)
        target_deg = start_deg + self._degrees(value)
        if not self._soft_deg[0] <= target_deg <= self._soft_deg[1]:
            raise _Refused(_ABOVE_LIMIT if target_deg > self._soft_deg[1] else _BELOW_LIMIT)
        self._direction, self._target_deg = 0, target_deg
        self._axis.go_to(target_deg, self._velocity_deg_s)
        return None

    def _stop(self) -> None:
        self._direction = 0
        if not self._axis.enabled:
            return
        acceleration = self._axis.acceleration_deg_s2
        self._axis.change_acceleration(self._deceleration_deg_s2)
        self._axis.run(0.0)
        self._axis.change_acceleration(acceleration)

    def _abort(self) -> None:
        """AB: motor power off at once; the stage coasts."""
        self._direction = 0
        self._axis.disable()

    @_OF_AXIS.of("DH")
    def _define_home(self, value: str) -> str | None:
        if value == "?":
            return self._shown(self._home_deg)
        self._home_deg = _number(value or "0", 1e6) * _UNIT_DEG[self._unit]
        self._axis.set_zero(self._home_deg)
        return None


def _signed(value: str) -> float:
    try:
        return float(value)
    except ValueError:
        raise _Refused(_AXIS_RANGE) from None


def _number(value: str, high: float) -> float:
    number = _signed(value)
    if not 0.0 <= number <= high:
        raise _Refused(_AXIS_RANGE)
    return number


def _positive(value: str, high: float) -> float:
    number = _number(value, high)
    if number <= 0.0:
        raise _Refused(_AXIS_RANGE)
    return number
