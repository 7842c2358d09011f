"""APPLy, FUNCtion, FREQuency, OUTPut and PHASe of a 33220A."""

from __future__ import annotations

from typing import Any

from simrack.instruments.agilent33220a import declarations, level_commands
from simrack.instruments.agilent33220a.instrument import SimulatedAgilent33220A as _Model
from simrack.instruments.agilent33220a.settings import FUNCTIONS
from simrack.scpi import Boolean, Choice, Command, Limits, Number, Parameter, Rows, Special, attribute, boolean, quoted

ROWS = Rows()


@ROWS.attribute(
    "[SOURce:]FUNCtion[:SHAPe]", Choice(tuple(FUNCTIONS.values())), "state.function", takes_s=declarations.SWITCH_S
)
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
        # Set amplitude, then the offset that fits it; direct voltage ignores the amplitude and keeps the old one.
        # What MIN and MAX stand for depends on the function, and those of the offset on the amplitude: both come
        # late.
        if model.state.function != "DC":
            given = Special.DEF if amplitude is None else amplitude
            model.levels.set_amplitude(level_commands.vpp_of(model, level_commands.AMPLITUDE.settle(given, model)))
        volts = level_commands.OFFSET.settle(Special.DEF if offset is None else offset, model)
        model.levels.set_offset(model.levels.rounded(volts))
        model.state.output = True
        model.update()

    return Command(f"APPLy:{FUNCTIONS[function]}", _apply_parameters(function), do=write, takes_s=declarations.SWITCH_S)


_FREQUENCY_WORDS = {"RAMP": "ramp frequency", "PULS": "pulse frequency", "USER": "user frequency"}
"""What a frequency is called that one function alone does not reach."""


def _apply_parameters(function: str) -> tuple[Parameter, ...]:
    def limits(model: _Model) -> Limits:
        return Limits(*model.kind.frequency_hz[function], default=1000.0)

    return (
        Number(unit="HZ", limits=limits, name=_FREQUENCY_WORDS.get(function, "frequency"), required=False),
        Number(unit=level_commands.AMPLITUDE_UNITS, deferred=True, with_unit=True, required=False),
        Number(unit="V", deferred=True, required=False),
    )


@ROWS.query("APPLy", reads=True)
def _applied(model: _Model) -> str:
    values = (model.state.frequency_hz, level_commands.amplitude_shown(model), level_commands.offset_shown(model))
    return quoted(f"{model.state.function} " + ",".join(map(declarations.nr3, values)))


def _duty_limits(model: _Model) -> Limits:
    return Limits(20.0, 80.0, 50.0) if model.state.frequency_hz <= 10e6 else Limits(40.0, 60.0, 50.0)


def _duty_word(model: _Model) -> str:
    return "duty cycle" if model.state.frequency_hz <= 10e6 else "duty cycle limited by frequency"


COMMANDS = (
    *ROWS,
    *(_apply(function) for function in FUNCTIONS),
    attribute(
        "[SOURce:]FREQuency",
        Number(
            unit="HZ",
            limits=declarations.frequency_limits,
            name=lambda model: _FREQUENCY_WORDS.get(model.state.function, "frequency"),
        ),
        "state.frequency_hz",
        declarations.nr3,
        do=lambda model, value: model.set_frequency(value),
        takes_s=declarations.TUNE_S,
    ),
    declarations.setting(
        "[SOURce:]FUNCtion:SQUare:DCYCle",
        Number(unit="PCT", limits=_duty_limits, name=_duty_word),
        "state.duty_percent",
        declarations.nr3,
    ),
    declarations.setting(
        "[SOURce:]FUNCtion:RAMP:SYMMetry",
        Number(unit="PCT", limits=Limits(0.0, 100.0)),
        "state.symmetry_percent",
        declarations.nr3,
    ),
    declarations.setting("OUTPut[:STATe]", Boolean(), "state.output", boolean, takes_s=declarations.LEVEL_S),
    declarations.setting("OUTPut:POLarity", declarations.POLARITIES, "state.polarity"),
    declarations.setting("OUTPut:SYNC[:STATe]", Boolean(), "state.sync", boolean),
    declarations.setting("OUTPut:TRIGger[:STATe]", Boolean(), "state.trigger_out", boolean),
    declarations.setting("OUTPut:TRIGger:SLOPe", declarations.SLOPES, "state.trigger_out_slope"),
    declarations.angle("[SOURce:]PHASe[:ADJust]", "state.phase_deg", -360.0, 360.0),
    Command("[SOURce:]PHASe:REFerence", do=lambda model: model.take_phase_as_reference()),
    declarations.setting("[SOURce:]PHASe:UNLock:ERRor:STATe", Boolean(), "state.unlock_error", boolean),
    declarations.setting("UNIT:ANGLe", Choice(("DEGree", "RADian")), "state.angle"),
)
