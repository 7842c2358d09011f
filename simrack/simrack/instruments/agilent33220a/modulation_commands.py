"""AM, FM, PM, PWM and FSKey."""

from __future__ import annotations

from simrack.instruments.agilent33220a.declarations import (
    FIRST_HZ,
    angle,
    frequency_limits,
    mode_switch,
    nr3,
    part_of_period,
    setting,
)
from simrack.instruments.agilent33220a.rules import fm_limit_hz, widest_swing_s
from simrack.scpi import Choice, Limits, Number

_SOURCES = Choice(("INTernal", "EXTernal"))
_SHAPE_WORDS = Choice(("SINusoid", "SQUare", "RAMP", "NRAMp", "TRIangle", "NOISe", "USER"))
_MODULATION_HZ = Number(unit="HZ", limits=Limits(2e-3, 20e3), name="frequency")

COMMANDS = (
    *(
        setting(f"[SOURce:]{mode}:INTernal:FUNCtion", _SHAPE_WORDS, f"state.{mode.lower()}.function")
        for mode in ("AM", "FM", "PM", "PWM")
    ),
    *(
        setting(f"[SOURce:]{mode}:INTernal:FREQuency", _MODULATION_HZ, f"state.{mode.lower()}.frequency_hz", nr3)
        for mode in ("AM", "FM", "PM", "PWM")
    ),
    *(
        setting(f"[SOURce:]{mode}:SOURce", _SOURCES, f"state.{mode.lower()}.source")
        for mode in ("AM", "FM", "PM", "PWM")
    ),
    setting("[SOURce:]AM:DEPTh", Number(unit="PCT", limits=Limits(0.0, 120.0)), "state.am_depth_percent", nr3),
    setting(
        "[SOURce:]FM:DEViation",
        Number(unit="HZ", limits=lambda model: Limits(FIRST_HZ, fm_limit_hz(model.state, model.kind))),
        "state.fm_deviation_hz",
        nr3,
    ),
    angle("[SOURce:]PM:DEViation", "state.pm_deviation_deg", 0.0, 360.0),
    setting(
        "[SOURce:]PWM:DEViation",
        Number(unit="S", limits=lambda model: Limits(0.0, widest_swing_s(model.state, model.kind))),
        "state.pwm_deviation_s",
        nr3,
    ),
    part_of_period(
        "[SOURce:]PWM:DEViation:DCYCle", "pwm_deviation_s", lambda state, kind: (0.0, widest_swing_s(state, kind))
    ),
    setting(
        "[SOURce:]FSKey:FREQuency",
        Number(unit="HZ", limits=frequency_limits, name="frequency"),
        "state.fsk.frequency_hz",
        nr3,
    ),
    setting("[SOURce:]FSKey:INTernal:RATE", Number(unit="HZ", limits=Limits(2e-3, 100e3)), "state.fsk.rate_hz", nr3),
    setting("[SOURce:]FSKey:SOURce", _SOURCES, "state.fsk.source"),
    *(mode_switch(f"[SOURce:]{mode}:STATe", mode) for mode in ("AM", "FM", "PM", "PWM")),
    mode_switch("[SOURce:]FSKey:STATe", "FSK"),
)
