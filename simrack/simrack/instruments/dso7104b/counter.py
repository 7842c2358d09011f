"""The hardware counter of an InfiniiVision oscilloscope: rising edges through the trigger level, in its own gate.

Gate, digits and what it counts are the 5000 series user's guide's (p. 187). It is a reciprocal counter here: whole
periods over the time that they took; of less than one there is nothing to count.
"""

from __future__ import annotations

import math
from collections.abc import Generator

import numpy as np
from msgspec import Struct

from simrack.instruments.dso7104b.filters import COUPLING_S
from simrack.instruments.dso7104b.inputs import Signals
from simrack.instruments.dso7104b.trigger import Comparator, held

_SHORTEST_S, _LONGEST_S = 0.1, 1.0
_DIGITS = 5
_BLOCK_POINTS = 1 << 15
_MOST_POINTS = 1 << 21
"""How often a gate is looked at."""
_PARTS = 64
_LOOKS, _LOOK_POINTS, _LOOK_STEP_S = 16, 2048, 4e-9
_LOOK_TIMES_S = _LOOK_STEP_S * np.arange(_LOOK_POINTS, dtype=np.float64)
_A_PERIOD = 10.0
_STEPS = 8.0


def gate_s(range_s: float) -> float:
    """Return the time for which it counts: 100 ms or twice the time window, whichever is longer, up to 1 s."""
    return min(max(_SHORTEST_S, 2.0 * range_s), _LONGEST_S)


def counted_hz(
    signals: Signals, channel: int, comparator: Comparator, start_s: float, stop_s: float
) -> Generator[None, None, float | None]:
    """Return, after slices of work, the frequency of an input over a gate, Hz; None without a whole period in it."""
    view = signals.views[channel]
    known = signals.sines(channel, start_s, stop_s)
    if known is not None and len(known.sines) <= 1:
        seen = known.high_passed(COUPLING_S) if view.ac else known
        low_v, high_v = seen.reach_v()
        crosses = low_v < comparator.low_v and high_v >= comparator.high_v and bool(seen.sines)
        frequency_hz = seen.sines[0].frequency_hz if crosses else 0.0
        return frequency_hz if frequency_hz * (stop_s - start_s) >= 1.0 else None
    yield from signals.preparing(channel)
    step_s = yield from _step_s(signals, channel, comparator, start_s, stop_s)
    periods, lasted_s = 0, list[float]()
    for part in _parts(start_s, stop_s, step_s):
        count, lasted = yield from _periods(signals, channel, comparator, part)
        periods += count
        lasted_s.append(lasted)
    return periods / math.fsum(lasted_s) if periods else None


def five_digits(frequency_hz: float) -> float:
    """Return a frequency with the digits of the counter."""
    return float(f"{frequency_hz:.{_DIGITS - 1}e}")


class _Part(Struct, frozen=True):
    """A part of the gate, and in the number of steps that it is looked at."""

    start_s: float
    stop_s: float
    steps: int


def _parts(start_s: float, stop_s: float, step_s: float) -> list[_Part]:
    """Return the gate; of one that would take too many steps, parts that are spread over it."""
    steps = math.ceil((stop_s - start_s) / step_s)
    if steps <= _MOST_POINTS:
        return [_Part(start_s, stop_s, steps)]
    steps = _MOST_POINTS // _PARTS
    lasts_s = steps * step_s
    return [_Part(begin, begin + lasts_s, steps) for begin in np.linspace(start_s, stop_s - lasts_s, _PARTS).tolist()]


def _periods(
    signals: Signals, channel: int, comparator: Comparator, part: _Part
) -> Generator[None, None, tuple[int, float]]:
    """Return, after slices of work, the number of whole periods, and their duration."""
    step_s = (part.stop_s - part.start_s) / part.steps
    at_once = signals.at_once(channel, step_s, _BLOCK_POINTS)
    first = last = -math.inf
    edges, high = 0, True
    for begin in range(0, part.steps, at_once):
        places = np.arange(begin, min(begin + at_once, part.steps) + 1, dtype=np.float64)
        times = np.minimum(part.start_s + step_s * places, part.stop_s)
        volts = signals.volts(channel, times)
        highs = held(volts, comparator, high_before=high)
        rises = np.flatnonzero(~highs[:-1] & highs[1:])
        high = bool(highs[-1])
        if len(rises):
            ends = rises[[0, -1]]
            at_s = times[ends] + (comparator.high_v - volts[ends]) / (volts[ends + 1] - volts[ends]) * step_s
            first = first if edges else float(at_s[0])
            last, edges = float(at_s[1]), edges + len(rises)
        yield
    return (edges - 1, last - first) if edges > 1 else (0, 0.0)


def _step_s(
    signals: Signals, channel: int, comparator: Comparator, start_s: float, stop_s: float
) -> Generator[None, None, float]:
    """Return, after slices, how closely it is looked at: as closely as the signal moves, or as it was seen to move."""
    span_s, finest_s = stop_s - start_s, signals.finest_s(channel)
    if finest_s:
        return min(_STEPS * finest_s, 1e-6 if finest_s >= 1e-6 else math.inf, span_s / _LOOK_POINTS)
    rises = 0
    for begin_s in np.linspace(start_s, stop_s - _LOOK_POINTS * _LOOK_STEP_S, _LOOKS).tolist():
        highs = held(signals.volts(channel, begin_s + _LOOK_TIMES_S), comparator)
        rises += int((~highs[:-1] & highs[1:]).sum())
        yield
    often_s = _LOOKS * _LOOK_POINTS * _LOOK_STEP_S / rises if rises > _LOOKS else math.inf
    return min(span_s / _MOST_POINTS, often_s / _A_PERIOD)
