"""Math commands of the DSO7104B; their settings are evaluated in :mod:`.math_settings`.

Formats and names are the 6000 series programmer's guide's, from memory (unverified), ranges and the default operation
ADD as well.
"""

from __future__ import annotations

from msgspec.structs import replace

from simrack.instruments.dso7104b.declarations import CHANNEL, clipped
from simrack.instruments.dso7104b.instrument import SimulatedDso7104B
from simrack.instruments.dso7104b.math_settings import MATH_RANGES, fft_band, fft_points, math_scale
from simrack.instruments.dso7104b.math_trace import TWO_SOURCES
from simrack.instruments.dso7104b.sampling import sample_rate_hz
from simrack.scpi import Boolean, Choice, Command, Limits, Number, Rows, ScpiError, attribute, boolean

ROWS = Rows()


def _shown_band(model: SimulatedDso7104B) -> tuple[float, float]:
    """Return centre and span of an FFT at the present time base."""
    range_s = model.state.timebase.range_s
    rate_hz = sample_rate_hz(model.state, model.kind)
    return fft_band(model.state, 0.5 * fft_points(range_s, rate_hz) / range_s)


def _set_source(model: SimulatedDso7104B, index: int, source: str) -> None:
    """Choose a source; only the first can be g(t), and only where there is no second."""
    if source == "GOFT" and index == 2:
        raise ScpiError(-224)
    if source == "GOFT" and model.state.function.operation in TWO_SOURCES:
        raise ScpiError(-221)
    model.state.function.source[index] = source
    _anew(model)


def _set_goft_source(model: SimulatedDso7104B, index: int, source: str) -> None:
    model.state.function.goft_source[index] = source
    _anew(model)


def _anew(model: SimulatedDso7104B) -> None:
    model.shown.forget_traces()


def _set_range(model: SimulatedDso7104B, range_: float) -> None:
    function = model.state.function
    function.range = clipped(model, range_, *MATH_RANGES[function.operation])
    _anew(model)


def _frequency(pattern: str, name: str, limits: Limits, index: int) -> Command:
    set_ = attribute(pattern, Number(unit="HZ", limits=limits), f"state.function.{name}", then=_anew)
    return replace(set_, query=lambda model: model.nr3(_shown_band(model)[index]))


def _offset(pattern: str) -> Command:
    set_ = attribute(pattern, Number(unit=("V", "DB")), "state.function.offset", then=_anew)
    return replace(set_, query=lambda model: model.nr3(math_scale(model.state)[1]))


@ROWS.query("FUNCtion", reads=True)
def _learned(model: SimulatedDso7104B) -> str:
    """Return the settings in the shape of the guide's sample."""
    state = model.state
    range_, offset = math_scale(state)
    return (
        f":FUNC:OPER {state.function.operation};DISP {boolean(state.function.shown)};SOUR1 {state.function.source[1]};"
        f"SOUR2 {state.function.source[2]};RANG {range_:+.2E};OFFS {offset:+.5E}"
    )


_OPERATION = Choice(("ADD", "SUBTract", "MULTiply", "INTegrate", "DIFFerentiate", "FFT", "SQRT"))


@ROWS.attribute("FUNCtion:OPERation", _OPERATION, "state.function.operation")
def _set_operation(model: SimulatedDso7104B, operation: str) -> None:
    """Choose the operation; the scale follows anew. Two sources cannot be g(t) and another (number unverified)."""
    if operation in TWO_SOURCES and model.state.function.source[1] == "GOFT":
        raise ScpiError(-221)
    if operation != model.state.function.operation:
        model.state.function.range = model.state.function.offset = None
    model.state.function.operation = operation
    model.shown.forget_traces()


FUNCTION_COMMANDS = (
    *ROWS,
    attribute("FUNCtion:DISPlay", Boolean(), "state.function.shown", boolean),
    Command(
        "FUNCtion:SOURce<1-2>",
        (Choice(("CHANnel<1-4>", "GOFT")),),
        do=_set_source,
        query=lambda model, index: model.state.function.source[index],
        reads=True,
    ),
    attribute(
        "FUNCtion:GOFT:OPERation", Choice(("ADD", "SUBTract", "MULTiply")), "state.function.goft_operation", then=_anew
    ),
    Command(
        "FUNCtion:GOFT:SOURce<1-2>",
        (CHANNEL,),
        do=_set_goft_source,
        query=lambda model, index: model.state.function.goft_source[index],
        reads=True,
    ),
    Command(
        "FUNCtion:RANGe",
        (Number(unit=("V", "DB")),),
        do=_set_range,
        query=lambda model: model.nr3(math_scale(model.state)[0]),
        reads=True,
    ),
    Command(
        "FUNCtion:SCALe",
        (Number(unit=("V", "DB")),),
        do=lambda model, scale: _set_range(model, 8.0 * scale),
        query=lambda model: model.nr3(math_scale(model.state)[0] / 8.0),
        reads=True,
    ),
    _offset("FUNCtion:OFFSet"),
    _offset("FUNCtion:REFerence"),
    attribute(
        "FUNCtion:WINDow", Choice(("RECTangular", "HANNing", "FLATtop", "BHARris")), "state.function.window", then=_anew
    ),
    _frequency("FUNCtion:CENTer", "centre_hz", Limits(0.0, 25e9), 0),
    _frequency("FUNCtion:SPAN", "span_hz", Limits(1.0, 100e9), 1),
)
"""What is said to :FUNCtion."""
