"""Waveforms of the DSO7104B on their way out: preamble, codes, blocks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from copy import deepcopy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simrack.instruments.dso7104b.declarations import SOURCE, clipped
from simrack.instruments.dso7104b.installed import INVALID
from simrack.instruments.dso7104b.instrument import SimulatedDso7104B
from simrack.instruments.dso7104b.math_settings import MathTrace, math_scale, math_trace
from simrack.instruments.dso7104b.sampling import memory_points
from simrack.scpi import Boolean, Choice, Command, Number, Rows, attribute, boolean, real, signed_integer

ROWS = Rows()

_LEVELS = {"BYTE": 256, "WORD": 65536, "ASC": 65536}
_HOLE = 0.0
"""Code of a place without data."""
_FORMATS = {"BYTE": 0, "WORD": 1, "ASC": 4}
_TEXT_POINTS = 2048
_TYPES = {"NORM": 0, "PEAK": 1, "AVER": 2, "HRES": 3}


def _listed(model: SimulatedDso7104B, wanted: float) -> int:
    """Return the largest of 100, 250, 500, 1000, 2000, 5000 ... 4000000, 8000000 that is not above `wanted`."""
    return max(each for each in model.kind.record_lengths if each <= max(100, wanted))


def _points(model: SimulatedDso7104B) -> int:
    """Return the number of points that :WAVeform:DATA? sends: a listed number, rounded down."""
    state = model.state
    wanted = state.waveform.points
    # RAW and MAX read the memory, which only a stopped acquisition of NORM or HRES type holds: averages have at most
    # 1000 points, minima and maxima are those of the screen (siblings' guides)
    shallow = state.acquire.type in {"AVER", "PEAK"} or state.waveform.source == "FUNC"
    if state.waveform.points_mode == "NORM" or model.running or shallow:
        return _listed(model, min(wanted, model.kind.screen_points))
    return min(_listed(model, wanted), memory_points(model.state, model.kind))


@ROWS.do(
    "WAVeform:POINts",
    (Number(words={"NORMal": -1.0, "MAXimum": -2.0, "RAW": -3.0}),),
    query=_points,
    reply=signed_integer,
    reads=True,
)
def _set_points(model: SimulatedDso7104B, points: float) -> None:
    """Take a number, or NORMal, MAXimum, RAW, which set the mode too."""
    screen, deepest = model.kind.screen_points, model.kind.record_lengths[-1]
    words = {-1.0: ("NORM", screen), -2.0: ("MAX", deepest), -3.0: ("RAW", deepest)}
    if points in words:
        model.state.waveform.points_mode, model.state.waveform.points = words[points]
        return
    most = screen if model.state.waveform.points_mode == "NORM" else deepest
    model.state.waveform.points = _listed(model, clipped(model, points, 100, most))


# --- scaling


def _math(model: SimulatedDso7104B) -> MathTrace:
    return math_trace(model.state, model.shown.record, _points(model))


def _vertical(model: SimulatedDso7104B) -> tuple[float, float]:
    """Return range and offset of the source as it was acquired."""
    if model.state.waveform.source == "FUNC":
        return math_scale(model.state)
    view = model.shown.record.views[int(model.state.waveform.source[4:])]
    return view.range_v, view.offset_v


def _horizontal(model: SimulatedDso7104B) -> tuple[float, float]:
    """Return increment and origin, s; Hz of an FFT."""
    if model.state.waveform.source == "FUNC":
        trace = _math(model)
        return trace.step, trace.first
    screen = model.shown.record.screen
    return screen.range_s / _points(model), screen.left_s


def _scaling(model: SimulatedDso7104B) -> tuple[float, float, int, float, float, int]:
    """Return xincrement, xorigin, xreference, yincrement, yorigin, yreference: the value sent where yorigin is."""
    levels = _LEVELS[model.state.waveform.format]
    range_, offset = _vertical(model)
    return (*_horizontal(model), 0, range_ / levels, offset, 0 if _signed(model) else levels // 2)


def _signed(model: SimulatedDso7104B) -> bool:
    """Return True if codes are sent as signed integers; of ASCii numbers :WAVeform:UNSigned says nothing."""
    return model.state.waveform.format != "ASC" and not model.state.waveform.unsigned


@ROWS.query("WAVeform:PREamble")
def _preamble(model: SimulatedDso7104B) -> Any:
    return model.look(lambda: _preamble_now(model))


def _preamble_now(model: SimulatedDso7104B) -> str:
    x_increment, x_origin, x_reference, y_increment, y_origin, y_reference = _scaling(model)
    fields = (
        signed_integer(_FORMATS[model.state.waveform.format]),
        signed_integer(_TYPES[model.state.acquire.type]),
        signed_integer(_points(model)),
        signed_integer(_average_count(model)),
        model.nr3(x_increment),
        model.nr3(x_origin),
        signed_integer(x_reference),
        model.nr3(y_increment),
        model.nr3(y_origin),
        signed_integer(y_reference),
    )
    return ",".join(fields)


def _average_count(model: SimulatedDso7104B) -> int:
    return int(model.state.acquire.count) if model.state.acquire.type == "AVER" else 1


def _scaled(name: str, index: int, *, integer: bool = False) -> Command:
    def read(model: SimulatedDso7104B) -> Any:
        def found() -> str:
            value = _scaling(model)[index]
            return signed_integer(value) if integer else model.nr3(value)

        return model.look(found)

    return Command(f"WAVeform:{name}", query=read)


# --- data


def _codes(model: SimulatedDso7104B) -> Iterator[NDArray[np.float64]]:
    """Return the record of the waveform source as it is now, block by block, as unsigned codes of the format."""
    if not _shown(model):
        return iter((np.full(_points(model), _HOLE),))
    range_, offset = _vertical(model)
    levels = _LEVELS[model.state.waveform.format]
    return (_coded(volts, range_, offset, levels) for volts in _blocks(model))


def _blocks(model: SimulatedDso7104B) -> Iterator[NDArray[np.float64]]:
    if model.state.waveform.source == "FUNC":
        return iter((_math(model).values,))
    channel, points = int(model.state.waveform.source[4:]), _points(model)
    peak = model.state.acquire.type == "PEAK"
    return model.shown.record.peak_blocks(channel, points) if peak else model.shown.record.blocks(channel, points)


def _coded(volts: NDArray[np.float64], range_: float, offset: float, levels: int) -> NDArray[np.float64]:
    """Return samples as whole codes: 1 is below the converter's range, the highest above."""
    codes = np.subtract(volts, offset)
    codes *= levels / range_
    np.round(codes, out=codes)
    codes += levels // 2
    unit = levels // 256
    if codes.min() < 2 * unit - unit / 2:
        codes[codes < 2 * unit - unit / 2] = 1
    if codes.max() > 254 * unit + unit / 2:
        codes[codes > 254 * unit + unit / 2] = levels - 1
    return codes


@ROWS.query("WAVeform:DATA")
def _data(model: SimulatedDso7104B) -> Any:
    return model.look(lambda: _data_now(model))


def _asked(model: SimulatedDso7104B) -> tuple[Any, ...]:
    """Return everything that the data of :WAVeform:DATA? depend on, beside the record."""
    state, waveform = model.state, model.state.waveform
    math_ = deepcopy(state.function) if waveform.source == "FUNC" else None
    sent = (waveform.source, waveform.format, waveform.unsigned, waveform.byte_order, state.acquire.type, math_)
    return (_shown(model), _points(model), *sent)


def _shown(model: SimulatedDso7104B) -> bool:
    """Return True if the source is shown: a source that is off has holes alone.

    PyMeasure's tests for a real DSOX1102G expect something that can be read; a hole is a place without data (5000
    series guide). That holes are what is sent is unverified.
    """
    return model.state.is_shown(model.state.waveform.source)


def _data_now(model: SimulatedDso7104B) -> Any:
    form, signed = model.state.waveform.format, _signed(model)
    if form == "ASC":
        written = _writing(model)
        texts = (written(some) for codes in _codes(model) for some in _cut(codes))
        return model.shown.sent(_asked(model), (b"," * (place > 0) + text for place, text in enumerate(texts)))
    half = _LEVELS[form] // 2 if signed else 0
    order = ">" if model.state.waveform.byte_order == "MSBF" else "<"
    kind = ("i" if signed else "u") + ("1" if form == "BYTE" else "2")
    return model.shown.sent(_asked(model), (_bytes(codes, half, f"{order}{kind}") for codes in _codes(model)))


def _bytes(codes: NDArray[np.float64], half: int, kind: str) -> bytes:
    if half:
        codes -= half
    return codes.astype(kind).tobytes()


def _cut(codes: NDArray[np.float64]) -> Iterator[NDArray[np.float64]]:
    """Yield codes in parts that are written as text within milliseconds."""
    return (codes[start : start + _TEXT_POINTS] for start in range(0, len(codes), _TEXT_POINTS))


def _writing(model: SimulatedDso7104B) -> Callable[[NDArray[np.float64]], bytes]:
    """Return a function that writes codes as numbers, by the present scaling."""
    _, _, _, increment, origin, reference = _scaling(model)
    number = real(5, model.exponent_digits)
    if not _shown(model):
        return lambda codes: ",".join([number(INVALID)] * len(codes)).encode()
    return lambda codes: ",".join(map(number, ((codes - reference) * increment + origin).tolist())).encode()


def _looked_at(of: Callable[[SimulatedDso7104B], str]) -> Callable[[SimulatedDso7104B], Any]:
    return lambda model: model.look(lambda: of(model))


@ROWS.query("WAVeform", reads=True)
def _learned(model: SimulatedDso7104B) -> str:
    """Return source, format and order of the data, in the shape of the siblings' guides."""
    state = model.state
    return (
        f":WAV:UNS {boolean(state.waveform.unsigned)};VIEW {state.waveform.view};BYT {state.waveform.byte_order};"
        f"FORM {state.waveform.format};POIN {signed_integer(_points(model))};SOUR {state.waveform.source}"
    )


WAVEFORM_COMMANDS = (
    *ROWS,
    attribute("WAVeform:SOURce", SOURCE, "state.waveform.source"),
    attribute("WAVeform:FORMat", Choice(("BYTE", "WORD", "ASCii")), "state.waveform.format"),
    attribute("WAVeform:UNSigned", Boolean(), "state.waveform.unsigned", boolean),
    attribute("WAVeform:BYTeorder", Choice(("MSBFirst", "LSBFirst")), "state.waveform.byte_order"),
    attribute("WAVeform:POINts:MODE", Choice(("NORMal", "MAXimum", "RAW")), "state.waveform.points_mode"),
    _scaled("XINCrement", 0),
    _scaled("XORigin", 1),
    _scaled("XREFerence", 2, integer=True),
    _scaled("YINCrement", 3),
    _scaled("YORigin", 4),
    _scaled("YREFerence", 5, integer=True),
    Command("WAVeform:COUNt", query=_average_count, reply=signed_integer, reads=True),
    Command("WAVeform:TYPE", query=lambda model: model.state.acquire.type, reads=True),
    Command("WAVeform:SEGMented:COUNt", query=_looked_at(lambda model: signed_integer(model.shown.segments()))),
    Command("WAVeform:SEGMented:TTAG", query=_looked_at(lambda model: model.nr3(model.shown.time_tag_s()))),
    attribute("WAVeform:VIEW", Choice(("MAIN",)), "state.waveform.view"),
)
"""What is said to :WAVeform."""
