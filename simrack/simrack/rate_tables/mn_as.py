"""A simulated three-axis table that speaks ``$MN<verb>,<args>*<hh>`` and answers ``$AS<verb>,...,OK*<hh>``.

Recovered from the client of such a table: hh is the sum, not the exclusive or, of the characters between ``$`` and
``*``. Unverified: what is answered to a refused message (here nothing), that remote control and servo are needed for
a run, the meaning of the argument ``1`` of REM, ENB, RUN and STP, the digits of numbers, what STS says at constant
rate (here: moving), that a ``$`` begins a message anew. One axis of the three turns; the others take what they are
told and are at rest.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import ClassVar

from simrack.handlers import Handlers
from simrack.rate_tables.axis import ServoAxis, TableErrors, TableWorld
from simrack.rate_tables.interlocked import Interlocked
from simrack.rate_tables.line import LineDevice, SerialTiming

__all__ = ["MnAsTable", "TableErrors", "character_sum"]

_TIMING = SerialTiming(baud=115200.0, processing_s=0.005)
_MESSAGE = re.compile(r"\$(MN([A-Z]{3})((?:,[^,*]*)*))\*([0-9A-Fa-f]{2})")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)")
_MOVING, _IN_PLACE = "1D", "00"
_POSITION_MODE, _RATE_MODE = 0, 1


def character_sum(text: str) -> str:
    """Return the sum of the characters modulo 256, two upper-case hexadecimal digits."""
    return f"{sum(text.encode('latin-1')) % 256:02X}"


class _Refused(Exception):
    """A message that the table does not take."""


class MnAsTable(Interlocked, LineDevice):
    """The table: local control, servo off after switching on."""

    errors_class: ClassVar = TableErrors
    _VERBS = Handlers()

    def __init__(self, world: TableWorld, errors: TableErrors, *, axis: int = 1) -> None:
        super().__init__(world, _TIMING, terminators=b"\r\n", longest=160)
        self._axis = ServoAxis(world, errors, acceleration_deg_s2=100.0)
        self._slot = axis - 1
        self._remote = False
        self._mode = _POSITION_MODE
        self._position_deg = 0.0
        self._rate_deg_s = 0.0
        self._verbs: dict[str, Callable[[list[float]], None]] = {
            "CHK": lambda _: None,
            "DIS": lambda _: self._axis.disable(),
            **self._VERBS.bound(self),
        }

    def _answer(self, message: bytes) -> bytes | None:
        text = message.decode("latin-1").strip()
        found = _MESSAGE.fullmatch(text[max(text.rfind("$"), 0) :])  # what broke off before it is lost
        if found is None or found[4].upper() != character_sum(found[1]):
            return None
        verb, arguments = found[2], found[3].split(",")[1:]
        try:
            reply = self._status() if verb == "STS" else self._do(verb, arguments)
        except _Refused:
            return None
        return f"${reply}*{character_sum(reply)}\r\n".encode()

    def _do(self, verb: str, arguments: list[str]) -> str:
        action = self._verbs.get(verb)
        if action is None or not all(map(_NUMBER.fullmatch, arguments)):
            raise _Refused
        action([float(text) for text in arguments])
        return f"AS{verb},OK"

    def _status(self) -> str:
        here = f"{self._axis.position_deg() % 360.0:.4f},{self._axis.rate_deg_s() + 0.0:.4f},"
        here += _MOVING if self._axis.moving() else _IN_PLACE
        axes = [f"0.0000,0.0000,{_IN_PLACE}"] * 3
        axes[self._slot] = here
        return f"ASSTS,{','.join(axes)},OK"

    @_VERBS.of("REM")
    def _take_over(self, _: list[float]) -> None:
        self._remote = True

    @_VERBS.of("LOC")
    def _give_back(self, _: list[float]) -> None:
        self._remote = False

    @_VERBS.of("ENB")
    def _enable(self, _: list[float]) -> None:
        if not self._remote or not self._axis.enable():
            raise _Refused

    @_VERBS.of("HMZ")
    def _home(self, _: list[float]) -> None:
        self._require_servo()
        self._axis.go_to(0.0, 20.0)

    @_VERBS.of("MOD")
    def _select(self, arguments: list[float]) -> None:
        mode = self._own(arguments)
        if self._axis.moving() or mode not in {_POSITION_MODE, _RATE_MODE, 2}:
            raise _Refused
        self._mode = int(mode)

    @_VERBS.of("POS")
    def _load_position(self, arguments: list[float]) -> None:
        self._position_deg = self._own(arguments)

    @_VERBS.of("VEL")
    def _load_rate(self, arguments: list[float]) -> None:
        self._rate_deg_s = self._own(arguments)

    @_VERBS.of("ACC")
    def _load_acceleration(self, arguments: list[float]) -> None:
        acceleration_deg_s2 = self._own(arguments)
        if acceleration_deg_s2 <= 0.0:
            raise _Refused
        self._axis.change_acceleration(acceleration_deg_s2)

    def _own(self, arguments: list[float]) -> float:
        if len(arguments) != 3:
            raise _Refused
        return arguments[self._slot]

    @_VERBS.of("RUN")
    def _run(self, _: list[float]) -> None:
        self._require_servo()
        if self._mode == _RATE_MODE:
            self._axis.run(self._rate_deg_s)
        elif self._mode == _POSITION_MODE and self._rate_deg_s:
            self._axis.go_to(self._position_deg, abs(self._rate_deg_s))

    @_VERBS.of("STP")
    def _stop(self, _: list[float]) -> None:
        if self._axis.enabled:
            self._axis.run(0.0)

    def _require_servo(self) -> None:
        if not self._remote or not self._axis.enabled:
            raise _Refused
