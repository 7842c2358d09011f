"""Evaluation of the DSO7104B's math settings: trace of a record, and scale.

Unverified, from memory of the 6000 series programmer's guide: that a math trace has the points of the screen, at most
1000. Range and offset that were never set follow the sources; so do span and centre of an FFT, which then shows all
frequencies.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from simrack.instruments.dso7104b.math_trace import FFT_POINTS, TWO_SOURCES, Spectrum, combined, transformed
from simrack.instruments.dso7104b.record import Digitised, Record
from simrack.instruments.dso7104b.settings import ScopeSettings

_MOST_POINTS = 1000
MATH_RANGES = {
    "ADD": (8e-6, 800e3),
    "SUBT": (8e-6, 800e3),
    "MULT": (8e-6, 800e3),
    "INT": (8e-9, 400e3),
    "DIFF": (80e-3, 8e12),
    "SQRT": (8e-6, 800e3),
    "FFT": (8.0, 800.0),
}
"""Least and largest range by operation."""
_FFT_RANGE_DB, _FFT_CENTRE_DBV = 160.0, -60.0


class MathTrace(Struct, frozen=True):
    """Values at `first + n step`: seconds, or hertz of an FFT."""

    first: float
    step: float
    values: NDArray[np.float64]
    clipped: bool

    def places(self) -> NDArray[np.float64]:
        """Return the abscissae."""
        return self.first + self.step * np.arange(len(self.values), dtype=np.float64)


def math_trace(state: ScopeSettings, record: Record, points: int) -> MathTrace:
    """Return the math trace of a record."""
    points = min(points, _MOST_POINTS)
    screen = record.screen
    if state.function.operation == "FFT":
        count = fft_points(record.screen.range_s, record.kept.rate_hz)
        source, step_s = _operand(state, record, count), record.screen.range_s / count
        lines = Spectrum.of(source.volts, step_s, state.function.window)
        centre, span = fft_band(state, 0.5 / step_s)
        start = centre - span / 2.0
        return MathTrace(start, span / points, lines.shown(start, start + span, points), source.clipped)
    step = screen.range_s / points
    one = _operand(state, record, points)
    if state.function.operation not in TWO_SOURCES:
        return MathTrace(screen.left_s, step, transformed(state.function.operation, one.volts, step), one.clipped)
    other = _channel(record, state.function.source[2], points)
    values = combined(state.function.operation, one.volts, other.volts)
    return MathTrace(screen.left_s, step, values, one.clipped or other.clipped)


def fft_points(range_s: float, rate_hz: float) -> int:
    """Return the number of samples that an FFT is of: those on the screen, thinned out to at most `FFT_POINTS`."""
    return max(2, min(FFT_POINTS, round(range_s * rate_hz)))


def fft_band(state: ScopeSettings, highest_hz: float) -> tuple[float, float]:
    """Return centre and span of an FFT, Hz: as set but not beyond half the sample rate, else all that there is."""
    span = min(state.function.span_hz or highest_hz, highest_hz)
    return (span / 2.0 if state.function.centre_hz is None else state.function.centre_hz), span


def _operand(state: ScopeSettings, record: Record, points: int) -> Digitised:
    """Return the first source, which may be g(t): a sum, a difference or a product."""
    if state.function.source[1] != "GOFT":
        return _channel(record, state.function.source[1], points)
    one, other = (_channel(record, each, points) for each in state.function.goft_source.values())
    return type(one)(
        combined(state.function.goft_operation, one.volts, other.volts),
        one.clipped or other.clipped,
        one.step_v + other.step_v,
    )


def _channel(record: Record, source: str, points: int) -> Digitised:
    return record.digitised(int(source[4:]), points)


def math_scale(state: ScopeSettings) -> tuple[float, float]:
    """Return range and offset of the math trace on the screen."""
    range_ = state.function.range or _own_range(state)
    centre = _FFT_CENTRE_DBV if state.function.operation == "FFT" else 0.0
    return range_, (centre if state.function.offset is None else state.function.offset)


def _own_range(state: ScopeSettings) -> float:
    """Return a range that holds every value that the sources' screens can give."""
    operation = state.function.operation
    one = _source_range(state, state.function.source[1])
    other = _source_range(state, state.function.source[2])
    ranges = {
        "ADD": one + other,
        "SUBT": one + other,
        "MULT": one * other / 2.0,
        "INT": one * state.timebase.range_s / 2.0,
        "DIFF": 100.0 * one / state.timebase.range_s,
        "SQRT": 2.0 * math.sqrt(one),
        "FFT": _FFT_RANGE_DB,
    }
    low, high = MATH_RANGES[operation]
    return float(min(max(ranges[operation], low), high))


def _source_range(state: ScopeSettings, source: str) -> float:
    if source != "GOFT":
        return state.channel_of(source).range_v
    one, other = (state.channel_of(each).range_v for each in state.function.goft_source.values())
    return one * other / 2.0 if state.function.goft_operation == "MULT" else one + other
