"""The commands of a 33220A, in the order of the manual's list, and what each of them does to the model."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from vcfbench.sim.instruments.agilent33220a.arbitrary import crest, mean
from vcfbench.sim.instruments.agilent33220a.rules import (
    SHORTEST_EDGE_S,
    fm_limit_hz,
    longest_edge_s,
    widest_swing_s,
    width_limits_s,
)
from vcfbench.sim.instruments.agilent33220a.settings import FREQUENCY_HZ, FUNCTIONS, MAX_PEAK_V, MIN_VPP, conflict
from vcfbench.sim.scpi import (
    COMMON_COMMANDS,
    Boolean,
    Choice,
    Command,
    CommandTable,
    Integer,
    Limits,
    Number,
    Parameter,
    Quantity,
    ScpiError,
    Special,
    Text,
    boolean,
    condition,
    enable,
    event,
    next_error,
    quoted,
    real,
    signed_integer,
)
from vcfbench.sim.scpi.lexer import Kind, Token

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from vcfbench.sim.instruments.agilent33220a.instrument import Agilent33220A as _Model

__all__ = ["TABLE"]

_number = real(13)

# --- parameters of its own ------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class _Name(Parameter):
    """A free name without quotes: a letter, then letters, digits or underscores, at most 12 (unverified)."""

    def parse(self, token: Token) -> str:
        if token.kind is not Kind.WORD:
            raise self.refuse_kind(token)
        if len(token.text) > 12:
            raise ScpiError(-144)
        return token.text


@dataclass(frozen=True, slots=True, kw_only=True)
class _DacPoints(Parameter):
    """A block of 16-bit words or a number -8191...8191."""

    def parse(self, token: Token) -> bytes | float:
        if token.kind is Kind.BLOCK:
            return token.text.encode("latin-1")
        if token.kind is not Kind.NUMBER:
            raise self.refuse_kind(token)
        return token.number


# --- handlers ---------------------------------------------------------------------------------------------------


def _setting(
    pattern: str, key: str, parameter: Parameter, reply: Callable[[Any], str] = str, takes_s: float = 0.0
) -> Command:
    """Declare a setting that depends on nothing else."""

    def write(model: _Model, value: Any) -> None:
        model.state[key] = value
        model.settle()

    return Command(pattern, (parameter,), do=write, query=lambda model: model.state[key], reply=reply, takes_s=takes_s)


def _panel(pattern: str, key: str, parameter: Parameter, reply: Callable[[Any], str]) -> Command:
    def write(model: _Model, value: Any) -> None:
        model.panel[key] = value

    return Command(pattern, (parameter,), do=write, query=lambda model: model.panel[key], reply=reply)


def _mode(pattern: str, mode: str) -> Command:
    return Command(
        pattern,
        (Boolean(),),
        do=lambda model, state: model.switch_mode(mode, on=state),
        query=lambda model: model.state["mode"] == mode,
        reply=boolean,
    )


def _frequency_limits(model: _Model) -> Limits:
    return Limits(*FREQUENCY_HZ[model.state["func"]], default=1000.0)


def _amplitude_limits(model: _Model) -> Limits:
    unit = model.state["unit"]
    low, high, default = (
        model.levels.in_unit(oc * model.levels.share, unit)
        for oc in (MIN_VPP, 2 * MAX_PEAK_V, 0.1 / model.levels.share)
    )
    return Limits(low, high, default=default)


def _offset_limits(model: _Model) -> Limits:
    room = model.levels.room_v() * model.levels.share
    return Limits(-room, room, default=0.0)


def _level_limits(model: _Model) -> Limits:
    return Limits(-model.levels.max_v(), model.levels.max_v())


def _select(model: _Model, function: str) -> None:
    model.rules.select(function)
    model.update()


def _vpp_of(model: _Model, given: Quantity) -> float:
    """Return an amplitude argument in Vpp as shown, within the limits of the instrument."""
    unit = given.unit or model.state["unit"]
    if unit == "V":
        unit = "VPP"
    if unit == "DBM" and math.isinf(model.state["load"]):
        raise conflict("amplitude units changed to Vpp due to high-Z load")
    if unit != "DBM" and given.value <= 0.0:
        return model.levels.clipped(given.value, Limits(MIN_VPP * model.levels.share, math.inf), "amplitude")
    vpp = model.levels.in_vpp(given.value, unit)
    low, high = MIN_VPP * model.levels.share, 2.0 * model.levels.max_v()
    if not low * (1 - 1e-12) <= vpp <= high * (1 + 1e-12):
        return model.levels.clipped(vpp, Limits(low, high), "amplitude")
    return model.levels.in_vpp(model.levels.rounded(given.value), unit)


def _set_amplitude(model: _Model, given: Quantity) -> None:
    model.levels.set_amplitude(_vpp_of(model, given))
    model.update()


def _amplitude(model: _Model) -> float:
    return model.levels.in_unit(model.levels.amplitude_vpp(), model.state["unit"])


def _set_offset(model: _Model, volts: float) -> None:
    model.levels.set_offset(model.levels.rounded(volts))
    model.update()


def _offset(model: _Model) -> float:
    return model.levels.offset_v()


def _levels(model: _Model) -> tuple[float, float]:
    """Return low and high level as shown."""
    half = model.levels.amplitude_vpp() / 2.0
    return _offset(model) - half, _offset(model) + half


def _set_high(model: _Model, high: float) -> None:
    low, gap = _levels(model)[0], MIN_VPP * model.levels.share
    high = model.levels.rounded(high)
    if high - low < gap:
        low = max(high - gap, -model.levels.max_v())
        high = max(high, low + gap)
        model.engine.report(conflict("low level changed due to high level"))
    model.levels.set_high_and_low(high, low)
    model.update()


def _set_low(model: _Model, low: float) -> None:
    high, gap = _levels(model)[1], MIN_VPP * model.levels.share
    low = model.levels.rounded(low)
    if high - low < gap:
        high = min(low + gap, model.levels.max_v())
        low = min(low, high - gap)
        model.engine.report(conflict("high level changed due to low level"))
    model.levels.set_high_and_low(high, low)
    model.update()


def _set_unit(model: _Model, unit: str) -> None:
    if unit == "DBM" and math.isinf(model.state["load"]):
        unit = "VPP"
        model.engine.report(conflict("amplitude units changed to Vpp due to high-Z load"))
    model.state["unit"] = unit


def _set_load(model: _Model, ohm: float) -> None:
    """Change what is shown, not what comes out."""
    model.state["load"] = ohm
    if math.isinf(ohm) and model.state["unit"] == "DBM":
        _set_unit(model, "DBM")


def _set_range_auto(model: _Model, state: object) -> None:
    model.state["range_auto"] = True
    model.update()
    model.state["range_auto"] = state is True


def _apply(function: str) -> Command:
    """Declare APPLy for one function."""

    def write(model: _Model, frequency: float | None, amplitude: Any, offset: Any) -> None:
        model.state.update(mode="", trigger="IMM", duty=50.0, symmetry=100.0, range_auto=True, offset=0.0)
        low, high = FREQUENCY_HZ[function]
        model.state["freq"] = min(max(1000.0 if frequency is None else frequency, low), high)
        model.rules.select(function)
        _apply_levels(model, amplitude, offset)
        model.state["output"] = True
        model.update()

    return Command(f"APPLy:{FUNCTIONS[function]}", _apply_parameters(function), do=write, takes_s=_SWITCH_S)


def _apply_levels(model: _Model, amplitude: Any, offset: Any) -> None:
    """Set amplitude, then the offset that fits it; direct voltage ignores the amplitude and keeps the old one.

    What MIN and MAX stand for depends on the function, and those of the offset on the amplitude: both come late.
    """
    if model.state["func"] != "DC":
        given = Special.DEF if amplitude is None else amplitude
        model.levels.set_amplitude(_vpp_of(model, _AMPLITUDE.settle(given, model)))
    volts = _OFFSET.settle(Special.DEF if offset is None else offset, model)
    model.levels.set_offset(model.levels.rounded(volts))


def _apply_parameters(function: str) -> tuple[Parameter, ...]:
    limits = Limits(*FREQUENCY_HZ[function], default=1000.0)
    return (
        Number(unit="HZ", limits=limits, name="frequency", required=False),
        Number(unit=_AMPLITUDE_UNITS, deferred=True, with_unit=True, required=False),
        Number(unit="V", deferred=True, required=False),
    )


def _applied(model: _Model) -> str:
    values = (model.state["freq"], _amplitude(model), _offset(model))
    return quoted(f"{model.state['func']} " + ",".join(map(_number, values)))


def _set_period(model: _Model, seconds: float) -> None:
    model.set_frequency(1.0 / seconds)


def _width_limits(model: _Model) -> Limits:
    """Return the widths that fit the period, s."""
    return Limits(*width_limits_s(model.state))


def _set_width(model: _Model, seconds: float) -> None:
    model.state["width"] = seconds
    model.settle()


def _duty_of_pulse_limits(model: _Model) -> Limits:
    shortest, longest = width_limits_s(model.state)
    return Limits(100.0 * shortest * model.state["freq"], 100.0 * longest * model.state["freq"])


def _set_pulse_duty(model: _Model, percent: float) -> None:
    _set_width(model, percent / 100.0 / model.state["freq"])


def _edge_limits(model: _Model) -> Limits:
    return Limits(SHORTEST_EDGE_S, longest_edge_s(model.state))


def _set_user(model: _Model, name: str) -> None:
    model.memory.points(name)
    model.state["user"] = name
    model.update()


def _take_phase_as_reference(model: _Model) -> None:
    """Call the present phase 0: what comes out stays as it is."""
    model.take_phase_as_reference()


def _duty_swing_limits(model: _Model) -> Limits:
    return Limits(0.0, 100.0 * widest_swing_s(model.state) * model.state["freq"])


def _set_duty_swing(model: _Model, percent: float) -> None:
    model.state["PWM:dev"] = percent / 100.0 / model.state["freq"]
    model.settle()


def _duty_limits(model: _Model) -> Limits:
    return Limits(20.0, 80.0, 50.0) if model.state["freq"] <= 10e6 else Limits(40.0, 60.0, 50.0)


def _angle_limits(reach_deg: float, low_deg: float) -> Callable[[_Model], Limits]:
    def limits(model: _Model) -> Limits:
        factor = math.pi / 180.0 if model.state["angle"] == "RAD" else 1.0
        return Limits(low_deg * factor, reach_deg * factor)

    return limits


def _angle(pattern: str, key: str, low_deg: float, high_deg: float) -> Command:
    """Declare an angle: kept in degrees, said in UNIT:ANGLe."""

    def write(model: _Model, value: float) -> None:
        model.state[key] = math.degrees(value) if model.state["angle"] == "RAD" else value
        model.update()

    def read(model: _Model) -> float:
        degrees: float = model.state[key]
        return math.radians(degrees) if model.state["angle"] == "RAD" else degrees

    return Command(pattern, (Number(limits=_angle_limits(high_deg, low_deg)),), do=write, query=read, reply=_number)


def _sweep(pattern: str, read: Callable[[float, float], float], write: Callable[..., tuple[float, float]]) -> Command:
    """Declare one of STARt, STOP, CENTer, SPAN, which share two numbers."""

    def do(model: _Model, value: float) -> None:
        low, high = _FIRST_HZ, FREQUENCY_HZ[model.state["func"]][1]
        wanted = write(model.state["start"], model.state["stop"], value)
        model.state["start"], model.state["stop"] = (min(max(hz, low), high) for hz in wanted)
        model.restart()

    return Command(
        pattern,
        (Number(unit="HZ", limits=_sweep_limits),),
        do=do,
        query=lambda model: read(model.state["start"], model.state["stop"]),
        reply=_number,
    )


def _sweep_limits(model: _Model) -> Limits:
    high = FREQUENCY_HZ[model.state["func"]][1]
    return Limits(-high, high)


def _set_burst_mode(model: _Model, mode: str) -> None:
    """Triggered bursts of noise are none: the burst is off then."""
    model.state["burst_mode"] = mode
    model.rules.select(model.state["func"])
    model.restart()


def _set_cycles(model: _Model, cycles: float) -> None:
    model.state["cycles"] = cycles
    if math.isinf(cycles) and model.state["trigger"] == "IMM":
        model.state["trigger"] = "BUS"
        model.engine.report(conflict("infinite burst changed trigger source to MANUAL"))
        model.restart()
    model.settle()


def _set_trigger(model: _Model, source: str) -> None:
    if source == "IMM" and math.isinf(model.state["cycles"]):
        model.state["cycles"] = 50000.0
        model.engine.report(conflict("turned off infinite burst to allow immediate trigger source"))
    model.state["trigger"] = source
    model.restart()


def _bus_trigger(model: _Model) -> None:
    if model.state["trigger"] != "BUS":
        raise ScpiError(-211)
    model.fire()


def _load_points(model: _Model, place: str, *points: float) -> None:
    del place
    model.load(list(points))


def _load_dac(model: _Model, place: str, first: bytes | float, *others: bytes | float) -> None:
    del place
    values = _dac_block(first, model.state["order"]) if isinstance(first, bytes) else _dac_list((first, *others))
    if any(not -8191 <= value <= 8191 for value in values):
        raise ScpiError(-222)
    model.load([value / 8191.0 for value in values])


def _dac_block(data: bytes, order: str) -> list[float]:
    if len(data) % 2:
        raise ScpiError(800, "Block length must be even")
    words = struct.unpack(f"{'>' if order == 'NORM' else '<'}{len(data) // 2}h", data)
    return [float(word) for word in words]


def _dac_list(values: tuple[bytes | float, ...]) -> list[float]:
    if any(isinstance(value, bytes) for value in values):
        raise ScpiError(-168)
    return [round(value) for value in values if not isinstance(value, bytes)]


def _attribute(name: str, of: Callable[[Sequence[float]], float], reply: Callable[[float], str] = _number) -> Command:
    return Command(
        f"DATA:ATTRibute:{name}",
        query=lambda model, which: of(model.memory.points(which or model.state["user"])),
        query_parameters=(_Name(required=False),),
        reply=reply,
    )


def _names(names: list[str]) -> str:
    return ",".join(map(quoted, names)) or '""'


def _delete_all(model: _Model) -> None:
    for name in model.memory.kept_names():
        model.delete(name)


def _name_state(model: _Model, place: int, name: str | None) -> None:
    model.state_names[place] = name or f"STATE_{place}"


def _learn(model: _Model) -> str:
    """Return settings as commands: *RCL-able text; the real unit's is longer and unverified."""
    state = model.state
    parts = (
        f":FUNC {state['func']}",
        f":OUTP:LOAD {_number(state['load'])}",
        f":FREQ {_number(state['freq'])}",
        f":VOLT:UNIT {state['unit']}",
        f":VOLT {_number(_amplitude(model))}",
        f":VOLT:OFFS {_number(_offset(model))}",
        f":OUTP:POL {state['polarity']}",
        f":OUTP {boolean(state['output'])}",
    )
    return ";".join(parts)


def _preset_status(model: _Model) -> None:
    model.questionable.enable = 0


_AMPLITUDE_UNITS = ("VPP", "VRMS", "DBM", "V")
_AMPLITUDE = Number(unit=_AMPLITUDE_UNITS, limits=_amplitude_limits, with_unit=True)
_OFFSET = Number(unit="V", limits=_offset_limits, name="offset")
_SOURCES = Choice(("INTernal", "EXTernal"))
_SHAPE_WORDS = Choice(("SINusoid", "SQUare", "RAMP", "NRAMp", "TRIangle", "NOISe", "USER"))
_SLOPES = Choice(("POSitive", "NEGative"))
_POLARITIES = Choice(("NORMal", "INVerted"))
_STATES = Integer(limits=Limits(0, 4))
_MODULATION_HZ = Number(unit="HZ", limits=Limits(2e-3, 20e3), name="frequency")

_FIRST_HZ = 1e-6

_SWITCH_S = 0.1
_LEVEL_S = 0.03
_TUNE_S = 0.002
"""Times of a change of function, level (attenuator relays) and frequency (unverified)."""

TABLE = CommandTable(
    *COMMON_COMMANDS,
    # levels and functions
    *(_apply(function) for function in FUNCTIONS),
    Command("APPLy", query=_applied),
    Command(
        "[SOURce:]FUNCtion[:SHAPe]",
        (Choice(tuple(FUNCTIONS.values())),),
        do=_select,
        query=lambda model: model.state["func"],
        takes_s=_SWITCH_S,
    ),
    Command(
        "[SOURce:]FREQuency",
        (Number(unit="HZ", limits=_frequency_limits, name="frequency"),),
        do=lambda model, value: model.set_frequency(value),
        query=lambda model: model.state["freq"],
        reply=_number,
        takes_s=_TUNE_S,
    ),
    Command(
        "[SOURce:]VOLTage",
        (_AMPLITUDE,),
        do=_set_amplitude,
        query=_amplitude,
        reply=_number,
        takes_s=_LEVEL_S,
    ),
    Command(
        "[SOURce:]VOLTage:OFFSet",
        (_OFFSET,),
        do=_set_offset,
        query=_offset,
        reply=_number,
        takes_s=_LEVEL_S,
    ),
    Command(
        "[SOURce:]VOLTage:HIGH",
        (Number(unit="V", limits=_level_limits, name="high level"),),
        do=_set_high,
        query=lambda model: _levels(model)[1],
        reply=_number,
        takes_s=_LEVEL_S,
    ),
    Command(
        "[SOURce:]VOLTage:LOW",
        (Number(unit="V", limits=_level_limits, name="low level"),),
        do=_set_low,
        query=lambda model: _levels(model)[0],
        reply=_number,
        takes_s=_LEVEL_S,
    ),
    Command(
        "[SOURce:]VOLTage:UNIT",
        (Choice(("VPP", "VRMS", "DBM")),),
        do=_set_unit,
        query=lambda model: model.state["unit"],
    ),
    Command(
        "[SOURce:]VOLTage:RANGe:AUTO",
        (Boolean(words=("ONCE",)),),
        do=_set_range_auto,
        query=lambda model: model.state["range_auto"],
        reply=boolean,
    ),
    _setting(
        "[SOURce:]FUNCtion:SQUare:DCYCle",
        "duty",
        Number(unit="PCT", limits=_duty_limits, name="duty cycle"),
        _number,
    ),
    _setting("[SOURce:]FUNCtion:RAMP:SYMMetry", "symmetry", Number(unit="PCT", limits=Limits(0.0, 100.0)), _number),
    # pulse
    Command(
        "[SOURce:]PULSe:PERiod",
        (Number(unit="S", limits=Limits(200e-9, 2000.0)),),
        do=_set_period,
        query=lambda model: 1.0 / model.state["freq"],
        reply=_number,
        takes_s=_TUNE_S,
    ),
    Command(
        "[SOURce:]FUNCtion:PULSe:WIDTh",
        (Number(unit="S", limits=_width_limits, name="pulse width limited by period"),),
        do=_set_width,
        query=lambda model: model.state["width"],
        reply=_number,
    ),
    Command(
        "[SOURce:]FUNCtion:PULSe:DCYCle",
        (Number(unit="PCT", limits=_duty_of_pulse_limits, name="pulse duty cycle limited by period"),),
        do=_set_pulse_duty,
        query=lambda model: 100.0 * model.state["width"] * model.state["freq"],
        reply=_number,
    ),
    _setting("[SOURce:]FUNCtion:PULSe:HOLD", "hold", Choice(("WIDTh", "DCYCle"))),
    _setting("[SOURce:]FUNCtion:PULSe:TRANsition", "edge", Number(unit="S", limits=_edge_limits), _number),
    # output
    _setting("OUTPut[:STATe]", "output", Boolean(), boolean, takes_s=_LEVEL_S),
    Command(
        "OUTPut:LOAD",
        (Number(unit="OHM", limits=Limits(1.0, 10000.0, 50.0), words={"INFinity": math.inf}),),
        do=_set_load,
        query=lambda model: model.state["load"],
        reply=_number,
    ),
    _setting("OUTPut:POLarity", "polarity", _POLARITIES),
    _setting("OUTPut:SYNC[:STATe]", "sync", Boolean(), boolean),
    _setting("OUTPut:TRIGger[:STATe]", "trigger_out", Boolean(), boolean),
    _setting("OUTPut:TRIGger:SLOPe", "trigger_out_slope", _SLOPES),
    # phase
    _angle("[SOURce:]PHASe[:ADJust]", "phase", -360.0, 360.0),
    Command("[SOURce:]PHASe:REFerence", do=_take_phase_as_reference),
    _setting("[SOURce:]PHASe:UNLock:ERRor:STATe", "unlock_error", Boolean(), boolean),
    _setting("UNIT:ANGLe", "angle", Choice(("DEGree", "RADian"))),
    # modulation
    *(
        _setting(f"[SOURce:]{mode}:INTernal:FUNCtion", f"{mode}:func", _SHAPE_WORDS)
        for mode in ("AM", "FM", "PM", "PWM")
    ),
    *(
        _setting(f"[SOURce:]{mode}:INTernal:FREQuency", f"{mode}:freq", _MODULATION_HZ, _number)
        for mode in ("AM", "FM", "PM", "PWM")
    ),
    *(_setting(f"[SOURce:]{mode}:SOURce", f"{mode}:source", _SOURCES) for mode in ("AM", "FM", "PM", "PWM")),
    _setting("[SOURce:]AM:DEPTh", "AM:depth", Number(unit="PCT", limits=Limits(0.0, 120.0)), _number),
    _setting(
        "[SOURce:]FM:DEViation",
        "FM:dev",
        Number(unit="HZ", limits=lambda model: Limits(_FIRST_HZ, fm_limit_hz(model.state))),
        _number,
    ),
    _angle("[SOURce:]PM:DEViation", "PM:dev", 0.0, 360.0),
    _setting(
        "[SOURce:]PWM:DEViation",
        "PWM:dev",
        Number(unit="S", limits=lambda model: Limits(0.0, widest_swing_s(model.state))),
        _number,
    ),
    Command(
        "[SOURce:]PWM:DEViation:DCYCle",
        (Number(unit="PCT", limits=_duty_swing_limits),),
        do=_set_duty_swing,
        query=lambda model: 100.0 * model.state["PWM:dev"] * model.state["freq"],
        reply=_number,
    ),
    _setting(
        "[SOURce:]FSKey:FREQuency", "FSK:freq", Number(unit="HZ", limits=_frequency_limits, name="frequency"), _number
    ),
    _setting("[SOURce:]FSKey:INTernal:RATE", "FSK:rate", Number(unit="HZ", limits=Limits(2e-3, 100e3)), _number),
    _setting("[SOURce:]FSKey:SOURce", "FSK:source", _SOURCES),
    *(_mode(f"[SOURce:]{mode}:STATe", mode) for mode in ("AM", "FM", "PM", "PWM")),
    _mode("[SOURce:]FSKey:STATe", "FSK"),
    # sweep
    _sweep("[SOURce:]FREQuency:STARt", lambda start, _: start, lambda _, stop, value: (value, stop)),
    _sweep("[SOURce:]FREQuency:STOP", lambda _, stop: stop, lambda start, _, value: (start, value)),
    _sweep(
        "[SOURce:]FREQuency:CENTer",
        lambda start, stop: (start + stop) / 2.0,
        lambda start, stop, value: (value - (stop - start) / 2.0, value + (stop - start) / 2.0),
    ),
    _sweep(
        "[SOURce:]FREQuency:SPAN",
        lambda start, stop: stop - start,
        lambda start, stop, value: ((start + stop - value) / 2.0, (start + stop + value) / 2.0),
    ),
    _setting("[SOURce:]SWEep:SPACing", "spacing", Choice(("LINear", "LOGarithmic"))),
    _setting("[SOURce:]SWEep:TIME", "sweep_s", Number(unit="S", limits=Limits(1e-3, 500.0)), _number),
    _mode("[SOURce:]SWEep:STATe", "SWE"),
    _setting("MARKer:FREQuency", "marker", Number(unit="HZ", limits=_frequency_limits), _number),
    _setting("MARKer[:STATe]", "marker_on", Boolean(), boolean),
    # burst and trigger
    Command(
        "[SOURce:]BURSt:MODE",
        (Choice(("TRIGgered", "GATed")),),
        do=_set_burst_mode,
        query=lambda model: model.state["burst_mode"],
    ),
    Command(
        "[SOURce:]BURSt:NCYCles",
        (Number(limits=Limits(1, 50000), words={"INFinity": math.inf}, name="burst count"),),
        do=_set_cycles,
        query=lambda model: model.state["cycles"],
        reply=_number,
    ),
    _setting("[SOURce:]BURSt:INTernal:PERiod", "burst_period", Number(unit="S", limits=Limits(1e-6, 500.0)), _number),
    _angle("[SOURce:]BURSt:PHASe", "burst_phase", -360.0, 360.0),
    _mode("[SOURce:]BURSt:STATe", "BURS"),
    _setting("[SOURce:]BURSt:GATE:POLarity", "gate", _POLARITIES),
    Command(
        "TRIGger:SOURce",
        (Choice(("IMMediate", "EXTernal", "BUS")),),
        do=_set_trigger,
        query=lambda model: model.state["trigger"],
    ),
    _setting("TRIGger:SLOPe", "slope", _SLOPES),
    _setting("TRIGger:DELay", "delay", Number(unit="S", limits=Limits(0.0, 85.0), name="trigger delay"), _number),
    Command("TRIGger", do=lambda model: model.fire()),
    Command("*TRG", do=_bus_trigger, urgent=True),
    # arbitrary waveforms
    Command("DATA", (Choice(("VOLATILE",)), Number(limits=Limits(-1.0, 1.0))), do=_load_points, repeat=True),
    Command("DATA:DAC", (Choice(("VOLATILE",)), _DacPoints()), do=_load_dac, repeat=True),
    _setting("FORMat:BORDer", "order", Choice(("NORMal", "SWAPped"))),
    Command(
        "DATA:COPY",
        (_Name(), _Name(required=False)),
        do=lambda model, name, source: model.memory.keep(name, source or "VOLATILE"),
    ),
    Command("DATA:CATalog", query=lambda model: _names(model.memory.names())),
    Command("DATA:NVOLatile:CATalog", query=lambda model: _names(model.memory.kept_names())),
    Command("DATA:NVOLatile:FREE", query=lambda model: 4 - len(model.memory.kept_names()), reply=signed_integer),
    Command("DATA:DELete[:NAME]", (_Name(),), do=lambda model, name: model.delete(name)),
    Command("DATA:DELete:ALL", do=_delete_all),
    _attribute("AVERage", mean),
    _attribute("CFACtor", crest),
    _attribute("POINts", len, signed_integer),
    _attribute("PTPeak", lambda points: (max(points) - min(points)) / 2.0),
    Command("[SOURce:]FUNCtion:USER", (_Name(),), do=_set_user, query=lambda model: model.state["user"]),
    # states
    Command("*SAV", (_STATES,), do=lambda model, place: model.save(place)),
    Command("*RCL", (_STATES,), do=lambda model, place: model.recall(place), takes_s=_SWITCH_S),
    Command("*LRN", query=_learn),
    Command("*TST", query=lambda _: 0, reply=signed_integer, query_takes_s=5.0),
    Command(
        "MEMory:STATe:NAME",
        (_STATES, _Name(required=False)),
        do=_name_state,
        query=lambda model, place: model.state_names[place],
        query_parameters=(_STATES,),
        reply=quoted,
    ),
    Command("MEMory:STATe:DELete", (_STATES,), do=lambda model, place: model.forget(place)),
    Command(
        "MEMory:STATe:VALid",
        query=lambda model, place: model.has_stored(place),
        query_parameters=(_STATES,),
        reply=boolean,
    ),
    Command("MEMory:STATe:CATalog", query=lambda model: _names(list(model.state_names.values()))),
    Command(
        "MEMory:STATe:RECall:AUTO",
        (Boolean(),),
        do=lambda model, state: setattr(model, "auto_recall", state),
        query=lambda model: model.auto_recall,
        reply=boolean,
    ),
    Command("MEMory:NSTates", query=lambda _: 5, reply=signed_integer),
    # panel and system
    _panel("DISPlay", "display", Boolean(), boolean),
    _panel("DISPlay:TEXT", "text", Text(limit=40), quoted),
    Command("DISPlay:TEXT:CLEar", do=lambda model: model.panel.update(text="")),
    Command("SYSTem:BEEPer[:IMMediate]", do=lambda _: None),
    Command("SYSTem:ERRor:NEXT", query=next_error),  # of SCPI 1999.0, which it claims; unverified
    _panel("SYSTem:BEEPer:STATe", "beep", Boolean(), boolean),
    _panel("SYSTem:KLOCk[:STATe]", "lock", Boolean(), boolean),
    _panel("SYSTem:KLOCk:EXCLude", "exclude", Choice(("NONE", "LOCal")), str),
    Command("SYSTem:VERSion", query=lambda _: "1999.0"),
    Command(
        "SYSTem:COMMunicate:RLSTate",
        (Choice(("LOCal", "REMote", "RWLock")),),
        do=lambda model, state: setattr(model, "remote", state),
        query=lambda model: model.remote,
    ),
    _panel("SYSTem:COMMunicate:GPIB:ADDRess", "gpib", Integer(limits=Limits(0, 30)), signed_integer),
    _panel("SYSTem:COMMunicate:LAN:DHCP[:STATe]", "dhcp", Boolean(), boolean),
    _panel("SYSTem:COMMunicate:LAN:IPADdress", "address", Text(limit=15), quoted),
    _panel("SYSTem:COMMunicate:LAN:SMASk", "mask", Text(limit=15), quoted),
    _panel("SYSTem:COMMunicate:LAN:GATEway", "gateway", Text(limit=15), quoted),
    _panel("SYSTem:COMMunicate:LAN:HOSTname", "host", Text(limit=15), quoted),
    Command("SYSTem:COMMunicate:LAN:MAC", query=lambda _: '"0030D3002041"'),
    # status
    condition("STATus:QUEStionable:CONDition", lambda model: model.questionable),
    event("STATus:QUEStionable[:EVENt]", lambda model: model.questionable),
    enable("STATus:QUEStionable:ENABle", lambda model: model.questionable),
    Command("STATus:PRESet", do=_preset_status),
)
"""Every command of the model, in the order of the manual's list."""
