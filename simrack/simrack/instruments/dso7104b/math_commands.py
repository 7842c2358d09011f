"""Math commands of the DSO7104B; what their settings make of a record says :mod:`.math_settings`.

Formats and names are the 6000 series programmer's guide's, from memory (unverified), ranges and the default operation
ADD as well.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from simrack.instruments.dso7104b.declarations import CHANNEL, clipped, setting
from simrack.instruments.dso7104b.math_settings import MATH_RANGES, fft_band, fft_points, math_scale
from simrack.instruments.dso7104b.math_trace import TWO_SOURCES
from simrack.instruments.dso7104b.sampling import sample_rate_hz
from simrack.scpi import Boolean, Choice, Command, Limits, Number, ScpiError, boolean

if TYPE_CHECKING:
    from simrack.instruments.dso7104b.instrument import SimulatedDso7104B


def _shown_band(model: SimulatedDso7104B) -> tuple[float, float]:
    """Return centre and span of an FFT at the present time base."""
    range_s = model.state["TIM:RANG"]
    rate_hz = sample_rate_hz(model.state, model.kind)
    return fft_band(model.state, 0.5 * fft_points(range_s, rate_hz) / range_s)


def _set_operation(model: SimulatedDso7104B, operation: str) -> None:
    """Choose the operation; the scale follows anew. Two sources cannot be g(t) and another (number unverified)."""
    if operation in TWO_SOURCES and model.state["FUNC:SOUR1"] == "GOFT":
        raise ScpiError(-221)
    if operation != model.state["FUNC:OPER"]:
        model.state.update({"FUNC:RANG": None, "FUNC:OFFS": None})
    model.state["FUNC:OPER"] = operation
    model.shown.forget_traces()


def _set_source(model: SimulatedDso7104B, index: int, source: str) -> None:
    """Choose a source; only the first can be g(t), and only where there is no second."""
    if source == "GOFT" and index == 2:
        raise ScpiError(-224)
    if source == "GOFT" and model.state["FUNC:OPER"] in TWO_SOURCES:
        raise ScpiError(-221)
    _put(model, f"FUNC:SOUR{index}", source)


def _put(model: SimulatedDso7104B, key: str, value: Any) -> None:
    model.state[key] = value
    model.shown.forget_traces()


def _set_range(model: SimulatedDso7104B, range_: float) -> None:
    _put(model, "FUNC:RANG", clipped(model, range_, *MATH_RANGES[model.state["FUNC:OPER"]]))


def _choice(pattern: str, key: str, choice: Choice) -> Command:
    """Declare a word that changes the trace."""
    return Command(
        pattern, (choice,), do=lambda model, word: _put(model, key, word), query=lambda model: model.state[key]
    )


def _frequency(pattern: str, key: str, limits: Limits, index: int) -> Command:
    return Command(
        pattern,
        (Number(unit="HZ", limits=limits),),
        do=lambda model, hertz: _put(model, key, hertz),
        query=lambda model: model.nr3(_shown_band(model)[index]),
        query_parameters=(),
    )


def _offset(pattern: str) -> Command:
    return Command(
        pattern,
        (Number(unit=("V", "DB")),),
        do=lambda model, level: _put(model, "FUNC:OFFS", level),
        query=lambda model: model.nr3(math_scale(model.state)[1]),
    )


def _learned(model: SimulatedDso7104B) -> str:
    """Return the settings in the shape of the guide's sample."""
    state = model.state
    range_, offset = math_scale(state)
    return (
        f":FUNC:OPER {state['FUNC:OPER']};DISP {boolean(state['FUNC:DISP'])};SOUR1 {state['FUNC:SOUR1']};"
        f"SOUR2 {state['FUNC:SOUR2']};RANG {range_:+.2E};OFFS {offset:+.5E}"
    )


_OPERATION = Choice(("ADD", "SUBTract", "MULTiply", "INTegrate", "DIFFerentiate", "FFT", "SQRT"))

FUNCTION_COMMANDS = (
    Command("FUNCtion", query=_learned),
    setting("FUNCtion:DISPlay", "FUNC:DISP", Boolean(), boolean),
    Command("FUNCtion:OPERation", (_OPERATION,), do=_set_operation, query=lambda model: model.state["FUNC:OPER"]),
    Command(
        "FUNCtion:SOURce<1-2>",
        (Choice(("CHANnel<1-4>", "GOFT")),),
        do=_set_source,
        query=lambda model, index: model.state[f"FUNC:SOUR{index}"],
    ),
    _choice("FUNCtion:GOFT:OPERation", "GOFT:OPER", Choice(("ADD", "SUBTract", "MULTiply"))),
    Command(
        "FUNCtion:GOFT:SOURce<1-2>",
        (CHANNEL,),
        do=lambda model, index, source: _put(model, f"GOFT:SOUR{index}", source),
        query=lambda model, index: model.state[f"GOFT:SOUR{index}"],
    ),
    Command(
        "FUNCtion:RANGe",
        (Number(unit=("V", "DB")),),
        do=_set_range,
        query=lambda model: model.nr3(math_scale(model.state)[0]),
    ),
    Command(
        "FUNCtion:SCALe",
        (Number(unit=("V", "DB")),),
        do=lambda model, scale: _set_range(model, 8.0 * scale),
        query=lambda model: model.nr3(math_scale(model.state)[0] / 8.0),
    ),
    _offset("FUNCtion:OFFSet"),
    _offset("FUNCtion:REFerence"),
    _choice("FUNCtion:WINDow", "FUNC:WIND", Choice(("RECTangular", "HANNing", "FLATtop", "BHARris"))),
    _frequency("FUNCtion:CENTer", "FUNC:CENT", Limits(0.0, 25e9), 0),
    _frequency("FUNCtion:SPAN", "FUNC:SPAN", Limits(1.0, 100e9), 1),
)
"""What is said to :FUNCtion."""
