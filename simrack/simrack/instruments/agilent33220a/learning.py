"""*LRN? of a 33220A: its settings as commands that bring them back. The reply of a real one is unverified."""

from __future__ import annotations

import math

from simrack.instruments.agilent33220a.instrument import SimulatedAgilent33220A as _Model

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


def learnt(model: _Model) -> str:
    """Return the commands; those of pulses only where there is one, since its limits are those of its period."""
    pulse = _PULSE if model.state.function == "PULS" else ()
    mode = (f"{model.state.mode}:STAT",) if model.state.mode else ()
    headers = [f":{header}" for header in (*_FIRST, *pulse, *_LAST, *mode, *_OUTPUT)]
    asked = model.table.compile(";".join(f"{header}?" for header in headers))
    values = [step.handler(model, *step.arguments) for step in asked]
    replies = ["INF" if value == math.inf else step.reply(value) for step, value in zip(asked, values, strict=True)]
    return ";".join(["*RST", *(f"{header} {reply!s}" for header, reply in zip(headers, replies, strict=True))])
