"""A simulated Ideal Aerosmith rate table, experimental: the subset that independent users agree on.

No manual is public. JOG, STO, ACL, PPO, HOM and the framing stand in two or three independent user programs; PVE,
SRV and ZER in one. Three letters and a value without a blank, carriage return; the reply is the data, if any, then a
prompt line. Whether the prompt follows a motion command at once is disputed, hence `prompt_after_motion`.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from vcfbench.sim.rate_tables.axis import ServoAxis, TableErrors, TableWorld
from vcfbench.sim.rate_tables.line import LineDevice, SerialTiming

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["AtlTable", "TableErrors"]

_TIMING = SerialTiming(baud=9600.0, processing_s=0.005)
_MAX_RATE_DEG_S = 360.0
"""Limit of the 1270VS."""
_HOMING_DEG_S = 20.0
_PROMPT = ">\r\n"
_REFUSED = "?"
_COMMAND = re.compile(r"([A-Za-z]{3})([+-]?\d+(?:\.\d*)?|[+-]?\.\d+)?")


class AtlTable(LineDevice):
    """The table. It is off after power-up; SRV1 switches it on, and so does the first JOG (unverified)."""

    def __init__(self, world: TableWorld, errors: TableErrors, *, prompt_after_motion: bool = True) -> None:
        super().__init__(world.clock, _TIMING, terminators=b"\r\n", longest=80)
        self._axis = ServoAxis(world, errors, acceleration_deg_s2=100.0)
        self._prompt_after_motion = prompt_after_motion
        self._commands: dict[str, Callable[[float | None], str]] = {
            "JOG": self._jog,
            "STO": self._stop,
            "ACL": self._accelerate,
            "HOM": self._home,
            "PPO": self._position,
            "PVE": self._velocity,
            "SRV": self._servo,
            "ZER": self._zero,
        }

    def _advance(self) -> None:
        self._axis.moves.advance()

    def _own_events_s(self) -> tuple[float, ...]:
        return self._axis.own_events_s()

    def _answer(self, message: bytes) -> bytes | None:
        match = _COMMAND.fullmatch(message.decode("latin-1").strip())
        verb, value = (match[1].upper(), match[2]) if match else ("", None)
        command = self._commands.get(verb)
        data = _REFUSED if command is None else command(None if value is None else float(value))
        if verb == "JOG" and data != _REFUSED and not self._prompt_after_motion:
            return None
        return f"{data}\r\n{_PROMPT}".encode()

    def _jog(self, rate_deg_s: float | None) -> str:
        if rate_deg_s is None or abs(rate_deg_s) > _MAX_RATE_DEG_S:
            return _REFUSED
        self._axis.enable()
        self._axis.run(rate_deg_s)
        return ""

    def _home(self, value: float | None) -> str:
        """Move to zero; whether the real prompt waits for the end is unknown, here it does not."""
        if value is not None:
            return _REFUSED
        self._axis.enable()
        self._axis.go_to(0.0, _HOMING_DEG_S)
        return ""

    def _stop(self, value: float | None) -> str:
        if value is not None:
            return _REFUSED
        if self._axis.enabled:
            self._axis.run(0.0)
        return ""

    def _accelerate(self, acceleration_deg_s2: float | None) -> str:
        if acceleration_deg_s2 is None or acceleration_deg_s2 <= 0.0:
            return _REFUSED
        self._axis.change_acceleration(acceleration_deg_s2)
        return ""

    def _position(self, value: float | None) -> str:
        return _REFUSED if value is not None else f"{self._axis.position_deg() % 360.0:.4f}"

    def _velocity(self, value: float | None) -> str:
        return _REFUSED if value is not None else f"{self._axis.rate_deg_s() + 0.0:.4f}"

    def _servo(self, value: float | None) -> str:
        if value not in {0.0, 1.0}:
            return _REFUSED
        if value:
            self._axis.enable()
        else:
            self._axis.disable()
        return ""

    def _zero(self, position_deg: float | None) -> str:
        self._axis.set_zero(position_deg or 0.0)
        return ""
