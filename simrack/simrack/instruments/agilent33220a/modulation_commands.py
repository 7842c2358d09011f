"""AM, FM, PM, PWM and FSKey."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simrack.instruments.agilent33220a.declarations import (
    FIRST_HZ,
    angle,
    frequency_limits,
    mode_switch,
    nr3,
    setting,
)
from simrack.instruments.agilent33220a.rules import fm_limit_hz, widest_swing_s
from simrack.scpi import Choice, Command, Limits, Number

if TYPE_CHECKING:
    from simrack.instruments.agilent33220a.instrument import SimulatedAgilent33220A as _Model


def _duty_swing_limits(model: _Model) -> Limits:
    return Limits(0.0, 100.0 * widest_swing_s(model.state, model.kind) * model.state["freq"])


def _set_duty_swing(model: _Model, percent: float) -> None:
    model.state["PWM:dev"] = percent / 100.0 / model.state["freq"]
    model.settle()


_SOURCES = Choice(("INTernal", "EXTernal"))
_SHAPE_WORDS = Choice(("SINusoid", "SQUare", "RAMP", "NRAMp", "TRIangle", "NOISe", "USER"))
_MODULATION_HZ = Number(unit="HZ", limits=Limits(2e-3, 20e3), name="frequency")

COMMANDS = (
    *(
        setting(f"[SOURce:]{mode}:INTernal:FUNCtion", f"{mode}:func", _SHAPE_WORDS)
        for mode in ("AM", "FM", "PM", "PWM")
    ),
    *(
        setting(f"[SOURce:]{mode}:INTernal:FREQuency", f"{mode}:freq", _MODULATION_HZ, nr3)
        for mode in ("AM", "FM", "PM", "PWM")
    ),
    *(setting(f"[SOURce:]{mode}:SOURce", f"{mode}:source", _SOURCES) for mode in ("AM", "FM", "PM", "PWM")),
    setting("[SOURce:]AM:DEPTh", "AM:depth", Number(unit="PCT", limits=Limits(0.0, 120.0)), nr3),
    setting(
        "[SOURce:]FM:DEViation",
        "FM:dev",
        Number(unit="HZ", limits=lambda model: Limits(FIRST_HZ, fm_limit_hz(model.state, model.kind))),
        nr3,
    ),
    angle("[SOURce:]PM:DEViation", "PM:dev", 0.0, 360.0),
    setting(
        "[SOURce:]PWM:DEViation",
        "PWM:dev",
        Number(unit="S", limits=lambda model: Limits(0.0, widest_swing_s(model.state, model.kind))),
        nr3,
    ),
    Command(
        "[SOURce:]PWM:DEViation:DCYCle",
        (Number(unit="PCT", limits=_duty_swing_limits),),
        do=_set_duty_swing,
        query=lambda model: 100.0 * model.state["PWM:dev"] * model.state["freq"],
        reply=nr3,
    ),
    setting("[SOURce:]FSKey:FREQuency", "FSK:freq", Number(unit="HZ", limits=frequency_limits, name="frequency"), nr3),
    setting("[SOURce:]FSKey:INTernal:RATE", "FSK:rate", Number(unit="HZ", limits=Limits(2e-3, 100e3)), nr3),
    setting("[SOURce:]FSKey:SOURce", "FSK:source", _SOURCES),
    *(mode_switch(f"[SOURce:]{mode}:STATe", mode) for mode in ("AM", "FM", "PM", "PWM")),
    mode_switch("[SOURce:]FSKey:STATe", "FSK"),
)
