"""The hardware counter of an InfiniiVision oscilloscope: rising edges through the trigger level, in its own gate.

Gate, digits and what it counts are the 5000 series user's guide's (p. 187). It is a reciprocal counter here: whole
periods over the time that they took; of less than one there is nothing to count.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from vcfbench.sim.instruments.dso7104b.filters import COUPLING_S
from vcfbench.sim.instruments.dso7104b.trigger import held

if TYPE_CHECKING:
    from vcfbench.sim.instruments.dso7104b.inputs import Signals
    from vcfbench.sim.instruments.dso7104b.trigger import Comparator

__all__ = ["counted_hz", "gate_s"]

_SHORTEST_S, _LONGEST_S = 0.1, 1.0
_DIGITS = 5
_BLOCK_POINTS = 1 << 18
_MOST_POINTS = 1 << 24
_UNKNOWN_POINTS = 1 << 22
"""How often a gate is looked at where nothing tells how fast the signal is."""
_LOOKS, _LOOK_POINTS, _LOOK_STEP_S = 16, 2048, 4e-9
_LOOK_TIMES_S = _LOOK_STEP_S * np.arange(_LOOK_POINTS, dtype=np.float64)
_A_PERIOD = 10.0
_STEPS = 8.0


def gate_s(range_s: float) -> float:
    """Return how long it counts: 100 ms or twice the time window, whichever is longer, up to 1 s."""
    return min(max(_SHORTEST_S, 2.0 * range_s), _LONGEST_S)


def counted_hz(signals: Signals, channel: int, comparator: Comparator, start_s: float, stop_s: float) -> float | None:
    """Return the frequency of an input over a gate, Hz to five digits; None without a whole period in it."""
    view = signals.views[channel]
    known = signals.sines(channel, start_s, stop_s)
    if known is not None and len(known.sines) <= 1:
        seen = known.high_passed(COUPLING_S) if view.ac else known
        low_v, high_v = seen.reach_v()
        crosses = low_v < comparator.low_v and high_v >= comparator.high_v and bool(seen.sines)
        frequency_hz = seen.sines[0].frequency_hz if crosses else 0.0
        return _rounded(frequency_hz) if frequency_hz * (stop_s - start_s) >= 1.0 else None
    first, last, periods = _periods(signals, channel, comparator, start_s, stop_s)
    return _rounded(periods / (last - first)) if periods else None


def _rounded(frequency_hz: float) -> float:
    return float(f"{frequency_hz:.{_DIGITS - 1}e}")


def _periods(
    signals: Signals, channel: int, comparator: Comparator, start_s: float, stop_s: float
) -> tuple[float, float, int]:
    """Return first and last rising edge, and how many periods are between them."""
    step_s = _step_s(signals, channel, comparator, start_s, stop_s)
    count = math.ceil((stop_s - start_s) / step_s)
    first = last = -math.inf
    edges, high = 0, True
    for begin in range(0, count, _BLOCK_POINTS):
        times = start_s + step_s * np.arange(begin, min(begin + _BLOCK_POINTS, count) + 1, dtype=np.float64)
        volts = signals.volts(channel, times)
        highs = held(volts, comparator, high_before=high)
        rises = np.flatnonzero(~highs[:-1] & highs[1:])
        high = bool(highs[-1])
        if len(rises):
            ends = rises[[0, -1]]
            places = times[ends] + (comparator.high_v - volts[ends]) / (volts[ends + 1] - volts[ends]) * step_s
            first = first if edges else float(places[0])
            last, edges = float(places[1]), edges + len(rises)
    return first, last, max(0, edges - 1)


def _step_s(signals: Signals, channel: int, comparator: Comparator, start_s: float, stop_s: float) -> float:
    """Return how closely it is looked at: as closely as the signal moves, or as closely as it was seen to move."""
    span_s, finest_s = stop_s - start_s, signals.finest_s(channel)
    least_s = span_s / _MOST_POINTS
    if finest_s:
        return max(least_s, min(_STEPS * finest_s, 1e-6 if finest_s >= 1e-6 else math.inf, span_s / _LOOK_POINTS))
    rises = 0
    for begin_s in np.linspace(start_s, stop_s - _LOOK_POINTS * _LOOK_STEP_S, _LOOKS).tolist():
        highs = held(signals.volts(channel, begin_s + _LOOK_TIMES_S), comparator)
        rises += int((~highs[:-1] & highs[1:]).sum())
    often_s = _LOOKS * _LOOK_POINTS * _LOOK_STEP_S / rises if rises > _LOOKS else math.inf
    return max(least_s, min(span_s / _UNKNOWN_POINTS, often_s / _A_PERIOD))
