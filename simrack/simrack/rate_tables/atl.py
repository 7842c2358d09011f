"""A simulated Ideal Aerosmith rate table, experimental: the subset that independent users agree on.

No manual is public. JOG, STO, ACL, PPO, HOM and the framing stand in two or three independent user programs; the
other commands in one, and what they do is read from their use: VEL and MOV (or P) move to an angle, RMO by one; AMP,
FRQ or PER, CYC and SGO oscillate; STA tells a status word, whose bits are unknown (here bit 0: moving); MCO whether the
move is complete within a tolerance: users disagree what 1 means (here: it stands). HOF and ZER shift the zero. DIR,
SAV, CAL, CLU and REX are taken without effect. Three letters and a value without a blank, carriage return; the reply is
the data, if any, then a prompt line. Whether the prompt follows a motion command at once is disputed, hence
`prompt_after_motion`. What is refused answers ``?``: also a motion while an interlock is broken, for which the language
has no word.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import ClassVar

from simrack.handlers import Handlers
from simrack.rate_tables.axis import ServoAxis, TableErrors, TableWorld
from simrack.rate_tables.interlocked import Interlocked
from simrack.rate_tables.line import LineDevice, SerialTiming

__all__ = ["AtlTable", "TableErrors"]

_TIMING = SerialTiming(baud=9600.0, processing_s=0.005)
_MAX_RATE_DEG_S = 360.0
"""Limit of the 1270VS."""
_HOMING_DEG_S = 20.0
_PROMPT = ">\r\n"
_REFUSED = "?"
_COMMAND = re.compile(r"([A-Za-z]{3}|[Pp](?=[-+.\d]))([+-]?\d+(?:\.\d*)?|[+-]?\.\d+)?")


class AtlTable(Interlocked, LineDevice):
    """The table. It is off after power-up; SRV1 switches it on, and so does the first motion (unverified).

    What SRV0 has switched off only SRV1 switches on again (likely; unverified).
    """

    _COMMANDS = Handlers()

    errors_class: ClassVar = TableErrors

    def __init__(self, world: TableWorld, errors: TableErrors, *, prompt_after_motion: bool = True) -> None:
        super().__init__(world, _TIMING, terminators=b"\r\n", longest=80)
        self._axis = ServoAxis(world, errors, acceleration_deg_s2=100.0)
        self._prompt_after_motion = prompt_after_motion
        self._servo_off = False
        self._commands: dict[str, Callable[[float | None], str]] = {
            **self._COMMANDS.bound(self),
            **{verb: self._setting(verb) for verb in ("AMP", "FRQ", "PER", "CYC")},
            **{verb: lambda _: "" for verb in ("DIR", "SAV", "CAL", "CLU", "REX")},
        }
        self._speed_deg_s = 20.0
        self._sine = {"AMP": 0.0, "FRQ": 0.0, "PER": 0.0, "CYC": 0.0}
        self._sine_ends_s: float | None = None

    def _advance(self) -> None:
        self._watch()
        if self._sine_ends_s is not None and self._clock.now() >= self._sine_ends_s:
            self._end_sine()

    def _own_events_s(self) -> tuple[float, ...]:
        ends = () if self._sine_ends_s is None else (self._sine_ends_s,)
        return (*self._axis.own_events_s(), *ends)

    def _end_sine(self) -> None:
        self._sine_ends_s = None
        if self._axis.enabled:
            self._axis.run(0.0)

    def _answer(self, message: bytes) -> bytes | None:
        match = _COMMAND.fullmatch(message.decode("latin-1").strip())
        verb, value = (match[1].upper(), match[2]) if match else ("", None)
        command = self._commands.get(verb)
        data = _REFUSED if command is None else command(None if value is None else float(value))
        if verb in {"JOG", "SGO"} and data != _REFUSED and not self._prompt_after_motion:
            return None
        return f"{data}\r\n{_PROMPT}".encode()

    @_COMMANDS.of("JOG")
    def _jog(self, rate_deg_s: float | None) -> str:
        if rate_deg_s is None or abs(rate_deg_s) > _MAX_RATE_DEG_S:
            return _REFUSED
        if not self._powered():
            return _REFUSED
        self._sine_ends_s = None
        self._axis.run(rate_deg_s)
        return ""

    def _powered(self) -> bool:
        """Return True if the drive is on for a motion, which switches it on unless SRV0 has switched it off."""
        return not self._servo_off and self._axis.enable()

    @_COMMANDS.of("HOM")
    def _home(self, value: float | None) -> str:
        """Move to zero; whether the real prompt waits for the end is unknown, here it does not."""
        if value is not None:
            return _REFUSED
        return self._move_to(0.0, _HOMING_DEG_S)

    def _move_to(self, position_deg: float, speed_deg_s: float) -> str:
        if not self._powered():
            return _REFUSED
        self._sine_ends_s = None
        self._axis.go_to(position_deg, speed_deg_s)
        return ""

    @_COMMANDS.of("VEL")
    def _speed(self, speed_deg_s: float | None) -> str:
        if speed_deg_s is None or not 0.0 < speed_deg_s <= _MAX_RATE_DEG_S:
            return _REFUSED
        self._speed_deg_s = speed_deg_s
        return ""

    @_COMMANDS.of("MOV", "P")
    def _go_to(self, position_deg: float | None) -> str:
        return _REFUSED if position_deg is None else self._move_to(position_deg, self._speed_deg_s)

    @_COMMANDS.of("RMO")
    def _go_by(self, angle_deg: float | None) -> str:
        if angle_deg is None:
            return _REFUSED
        return self._move_to(self._axis.position_deg() + angle_deg, self._speed_deg_s)

    @_COMMANDS.of("STA")
    def _status(self, value: float | None) -> str:
        return _REFUSED if value is not None else str(int(self._axis.moving()))

    @_COMMANDS.of("MCO")
    def _complete(self, tolerance: float | None) -> str:
        return _REFUSED if tolerance is None else str(int(not self._axis.moving()))

    def _setting(self, verb: str) -> Callable[[float | None], str]:
        def take(value: float | None) -> str:
            if value is None or value < 0.0:
                return _REFUSED
            self._sine[verb] = value
            if verb == "PER":
                self._sine["FRQ"] = 1.0 / value if value else 0.0
            return ""

        return take

    @_COMMANDS.of("SGO")
    def _oscillate(self, value: float | None) -> str:
        """Oscillate by AMP, FRQ and CYC; no number of cycles is for ever."""
        amplitude_deg, frequency_hz, cycles = self._sine["AMP"], self._sine["FRQ"], self._sine["CYC"]
        fastest = amplitude_deg * 2.0 * math.pi * frequency_hz
        if value is not None or not 0.0 < fastest <= _MAX_RATE_DEG_S or not self._powered():
            return _REFUSED
        self._axis.oscillate(amplitude_deg, frequency_hz)
        self._sine_ends_s = self._clock.now() + cycles / frequency_hz if cycles else None
        return ""

    @_COMMANDS.of("STO")
    def _stop(self, value: float | None) -> str:
        if value is not None:
            return _REFUSED
        self._end_sine()
        return ""

    @_COMMANDS.of("ACL")
    def _accelerate(self, acceleration_deg_s2: float | None) -> str:
        if acceleration_deg_s2 is None or acceleration_deg_s2 <= 0.0:
            return _REFUSED
        self._axis.change_acceleration(acceleration_deg_s2)
        return ""

    @_COMMANDS.of("PPO")
    def _position(self, value: float | None) -> str:
        return _REFUSED if value is not None else f"{self._axis.position_deg() % 360.0:.4f}"

    @_COMMANDS.of("PVE")
    def _velocity(self, value: float | None) -> str:
        return _REFUSED if value is not None else f"{self._axis.rate_deg_s() + 0.0:.4f}"

    @_COMMANDS.of("SRV")
    def _servo(self, value: float | None) -> str:
        if value not in {0.0, 1.0}:
            return _REFUSED
        self._servo_off = not value
        if value:
            return "" if self._axis.enable() else _REFUSED
        self._axis.disable()
        return ""

    @_COMMANDS.of("ZER", "HOF")
    def _zero(self, position_deg: float | None) -> str:
        self._axis.set_zero(position_deg or 0.0)
        return ""
