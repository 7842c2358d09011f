"""APPLy, FUNCtion, FREQuency, OUTPut and PHASe of a 33220A."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from simrack.instruments.agilent33220a.declarations import (
    LEVEL_S,
    POLARITIES,
    SLOPES,
    SWITCH_S,
    TUNE_S,
    angle,
    frequency_limits,
    nr3,
    setting,
)
from simrack.instruments.agilent33220a.level_commands import (
    AMPLITUDE,
    AMPLITUDE_UNITS,
    OFFSET,
    amplitude_shown,
    offset_shown,
    vpp_of,
)
from simrack.instruments.agilent33220a.settings import FUNCTIONS
from simrack.scpi import Boolean, Choice, Command, Limits, Number, Parameter, Special, attribute, boolean, quoted

if TYPE_CHECKING:
    from simrack.instruments.agilent33220a.instrument import SimulatedAgilent33220A as _Model


def _select(model: _Model, function: str) -> None:
    model.rules.select(function)
    model.update()


def _apply(function: str) -> Command:
    """Declare APPLy for one function."""

    def write(model: _Model, frequency: float | None, amplitude: Any, offset: Any) -> None:
        state = model.state
        state.mode, state.trigger, state.range_auto = "", "IMM", True
        state.duty_percent, state.symmetry_percent, state.offset_v = 50.0, 100.0, 0.0
        low, high = model.kind.frequency_hz[function]
        model.state.frequency_hz = min(max(1000.0 if frequency is None else frequency, low), high)
        model.rules.select(function)
        _apply_levels(model, amplitude, offset)
        model.state.output = True
        model.update()

    return Command(f"APPLy:{FUNCTIONS[function]}", _apply_parameters(function), do=write, takes_s=SWITCH_S)


def _apply_levels(model: _Model, amplitude: Any, offset: Any) -> None:
    """Set amplitude, then the offset that fits it; direct voltage ignores the amplitude and keeps the old one.

    What MIN and MAX stand for depends on the function, and those of the offset on the amplitude: both come late.
    """
    if model.state.function != "DC":
        given = Special.DEF if amplitude is None else amplitude
        model.levels.set_amplitude(vpp_of(model, AMPLITUDE.settle(given, model)))
    volts = OFFSET.settle(Special.DEF if offset is None else offset, model)
    model.levels.set_offset(model.levels.rounded(volts))


_FREQUENCY_WORDS = {"RAMP": "ramp frequency", "PULS": "pulse frequency", "USER": "user frequency"}
"""What a frequency is called that one function alone does not reach."""


def _apply_parameters(function: str) -> tuple[Parameter, ...]:
    def limits(model: _Model) -> Limits:
        return Limits(*model.kind.frequency_hz[function], default=1000.0)

    return (
        Number(unit="HZ", limits=limits, name=_FREQUENCY_WORDS.get(function, "frequency"), required=False),
        Number(unit=AMPLITUDE_UNITS, deferred=True, with_unit=True, required=False),
        Number(unit="V", deferred=True, required=False),
    )


def _applied(model: _Model) -> str:
    values = (model.state.frequency_hz, amplitude_shown(model), offset_shown(model))
    return quoted(f"{model.state.function} " + ",".join(map(nr3, values)))


def _duty_limits(model: _Model) -> Limits:
    return Limits(20.0, 80.0, 50.0) if model.state.frequency_hz <= 10e6 else Limits(40.0, 60.0, 50.0)


def _duty_word(model: _Model) -> str:
    return "duty cycle" if model.state.frequency_hz <= 10e6 else "duty cycle limited by frequency"


def _frequency_word(model: _Model) -> str:
    return _FREQUENCY_WORDS.get(model.state.function, "frequency")


COMMANDS = (
    *(_apply(function) for function in FUNCTIONS),
    Command("APPLy", query=_applied),
    attribute(
        "[SOURce:]FUNCtion[:SHAPe]", Choice(tuple(FUNCTIONS.values())), "state.function", do=_select, takes_s=SWITCH_S
    ),
    attribute(
        "[SOURce:]FREQuency",
        Number(unit="HZ", limits=frequency_limits, name=_frequency_word),
        "state.frequency_hz",
        nr3,
        do=lambda model, value: model.set_frequency(value),
        takes_s=TUNE_S,
    ),
    setting(
        "[SOURce:]FUNCtion:SQUare:DCYCle",
        Number(unit="PCT", limits=_duty_limits, name=_duty_word),
        "state.duty_percent",
        nr3,
    ),
    setting(
        "[SOURce:]FUNCtion:RAMP:SYMMetry", Number(unit="PCT", limits=Limits(0.0, 100.0)), "state.symmetry_percent", nr3
    ),
    setting("OUTPut[:STATe]", Boolean(), "state.output", boolean, takes_s=LEVEL_S),
    setting("OUTPut:POLarity", POLARITIES, "state.polarity"),
    setting("OUTPut:SYNC[:STATe]", Boolean(), "state.sync", boolean),
    setting("OUTPut:TRIGger[:STATe]", Boolean(), "state.trigger_out", boolean),
    setting("OUTPut:TRIGger:SLOPe", SLOPES, "state.trigger_out_slope"),
    angle("[SOURce:]PHASe[:ADJust]", "state.phase_deg", -360.0, 360.0),
    Command("[SOURce:]PHASe:REFerence", do=lambda model: model.take_phase_as_reference()),
    setting("[SOURce:]PHASe:UNLock:ERRor:STATe", Boolean(), "state.unlock_error", boolean),
    setting("UNIT:ANGLe", Choice(("DEGree", "RADian")), "state.angle"),
)
