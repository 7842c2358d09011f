"""*LRN? of a 33220A: its settings as commands that bring them back. The reply of a real one is unverified."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

from simrack.instruments.agilent33220a import (
    arbitrary_commands,
    burst_commands,
    level_commands,
    modulation_commands,
    output_commands,
    pulse_commands,
    sweep_commands,
)

if TYPE_CHECKING:
    from simrack.instruments.agilent33220a.instrument import SimulatedAgilent33220A as _Model
    from simrack.scpi import Command


def _header(pattern: str) -> str:
    """Return the shortest spelling of a header."""
    return ":".join(re.sub("[a-z]", "", word) for word in re.sub(r"\[.*?\]", "", pattern).split(":"))


_COMMANDS: dict[str, Command] = {
    _header(command.pattern): command
    for module in (
        output_commands,
        level_commands,
        pulse_commands,
        modulation_commands,
        sweep_commands,
        burst_commands,
        arbitrary_commands,
    )
    for command in module.COMMANDS
}

_MODES = ("AM:STAT", "FM:STAT", "PM:STAT", "PWM:STAT", "FSK:STAT", "SWE:STAT", "BURS:STAT")
_FIRST = (
    *("UNIT:ANGL", "FORM:BORD", "OUTP:LOAD", "OUTP:POL", "OUTP:SYNC", "OUTP:TRIG:SLOP", "PHAS:UNL:ERR:STAT"),
    *(f"{mode}:{what}" for mode in ("AM", "FM", "PM", "PWM") for what in ("INT:FUNC", "INT:FREQ", "SOUR")),
    *("AM:DEPT", "FM:DEV", "PM:DEV", "FSK:FREQ", "FSK:INT:RATE", "FSK:SOUR"),
    *("FREQ:STAR", "FREQ:STOP", "SWE:SPAC", "SWE:TIME", "MARK:FREQ", "MARK"),
    *("TRIG:SOUR", "TRIG:SLOP", "TRIG:DEL", "BURS:MODE", "BURS:NCYC", "BURS:INT:PER", "BURS:PHAS", "BURS:GATE:POL"),
    *("FUNC:USER", "FUNC", "FUNC:SQU:DCYC", "FUNC:RAMP:SYMM", "FREQ"),
)
"""What the sine of *RST restricts least, then what it is restricted by."""
_PULSE = ("FUNC:PULS:WIDT", "FUNC:PULS:TRAN", "FUNC:PULS:HOLD", "PWM:DEV")
_LAST = ("VOLT:UNIT", "VOLT", "VOLT:OFFS", "VOLT:RANG:AUTO", "PHAS")
_OUTPUT = ("OUTP:TRIG", "OUTP")


def _said(header: str, model: _Model) -> str:
    command = _COMMANDS[header]
    assert command.query is not None  # noqa: S101  (a setting can be asked for)
    value = command.query(model)
    reply = "INF" if value == math.inf else command.reply(value)
    return f":{header} {reply!s}"


def learnt(model: _Model) -> str:
    """Return the commands; those of pulses only where there is one, since its limits are those of its period."""
    pulse = _PULSE if model.state.function == "PULS" else ()
    mode = f"{model.state.mode}:STAT"
    modes = (mode,) if mode in _MODES else ()
    headers = (*_FIRST, *pulse, *_LAST, *modes, *_OUTPUT)
    return ";".join(["*RST", *(_said(header, model) for header in headers)])
