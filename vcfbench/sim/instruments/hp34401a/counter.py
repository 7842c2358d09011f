"""Frequency and period of the 34401A: a reciprocal counter behind the ac path (User's Guide p. 61, 218, 221)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from vcfbench.sim.instruments.hp34401a.ac import burst, phasors

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from vcfbench.sim.instruments.hp34401a.ac import Phasors, Response
    from vcfbench.sim.trace import Piece

__all__ = ["LONGEST_WAIT_S", "OVERHEAD_S", "mean_frequency_hz"]

OVERHEAD_S = 2.2e-3
"""What 9.8 and 80 readings a second leave beside gates of 0.1 and 0.01 s (p. 221)."""
LONGEST_WAIT_S = 1.0
"""How long the counter waits for a whole period before it says there is none (unverified)."""
_FIRST_LOOK_S = 2e-3
_FEW = 9
_POINTS_A_PERIOD = 64
_SAME = 1e-6


def mean_frequency_hz(pieces: list[Piece], start_s: float, stop_s: float, response: Response, least_v: float) -> float:
    """Return the frequency over a gate, 0 where no whole period of more than `least_v` rms was within it."""
    within = [piece for piece in pieces if piece.stop_s > start_s and piece.start_s < stop_s]
    if any(piece.sines is None for piece in within):
        return _Crossings(within, start_s, stop_s).frequency_hz(least_v)
    cycles = 0.0
    for piece in within:
        lasted = min(piece.stop_s, stop_s) - max(piece.start_s, start_s)
        cycles += lasted * _frequency_hz(phasors(piece, response), least_v)
    return cycles / (stop_s - start_s) if cycles >= 1.0 - _SAME else 0.0


def _frequency_hz(sines: Phasors, least_v: float) -> float:
    """Return how often a second a sum of sines rises through zero.

    One sine that is larger than all others together decides alone; harmonics are counted over their period; of
    anything else the largest sine is taken.
    """
    sizes = np.abs(sines.sizes)
    if math.sqrt(float(sizes @ sizes) / 2) < least_v:
        return 0.0
    largest = int(sizes.argmax())
    lowest = float(sines.speeds.min())
    ratios = sines.speeds / lowest
    if 2 * sizes[largest] <= sizes.sum() and float(np.abs(ratios - ratios.round()).max()) < _SAME:
        return _rises(sines, lowest) * lowest / math.tau
    return float(sines.speeds[largest]) / math.tau


def _rises(sines: Phasors, lowest_rad_s: float) -> int:
    """Return how often a periodic waveform rises through zero in a period."""
    points = _POINTS_A_PERIOD * max(1, round(float(sines.speeds.max()) / lowest_rad_s))
    volts = sines.at(np.linspace(0.0, math.tau / lowest_rad_s, points, endpoint=False))
    return int(((volts < 0.0) & (np.roll(volts, -1) >= 0.0)).sum())


class _Crossings:
    """Rising crossings of the mean of a waveform that can only be asked for its volts.

    A moment that holds some of them tells about how long a period is; then crossings farther and farther on are looked
    up where they must be, up to the end of the gate.
    """

    def __init__(self, pieces: list[Piece], start_s: float, stop_s: float) -> None:
        self._pieces = pieces
        self._start_s = start_s
        self._stop_s = stop_s
        self._mean_v = 0.0

    def frequency_hz(self, least_v: float) -> float:
        """Return the frequency, 0 without a whole period of more than `least_v` rms."""
        found = self._first(least_v)
        if len(found) < 2:
            return 0.0
        first, last, cycles = float(found[0]), float(found[-1]), len(found) - 1
        while (ahead := self._beyond(first, last, cycles)) is not None:
            last, cycles = ahead
        return cycles / (last - first)

    def _first(self, least_v: float) -> NDArray[np.float64]:
        span = min(_FIRST_LOOK_S, self._stop_s - self._start_s)
        while True:
            times, volts = burst(self._pieces, self._start_s, self._start_s + span)
            self._mean_v = float(volts.mean())
            found = _rising(times, volts - self._mean_v) if float(volts.std()) >= least_v else np.empty(0)
            if len(found) >= _FEW or span >= self._stop_s - self._start_s:
                return found
            span = min(8.0 * span, self._stop_s - self._start_s)

    def _beyond(self, first_s: float, last_s: float, cycles: int) -> tuple[float, int] | None:
        """Return a crossing up to twice as far on, and how many cycles it is from the first."""
        period = (last_s - first_s) / cycles
        more = min(cycles, int((self._stop_s - last_s) / period - 0.5))
        if more < 1:
            return None
        expected = last_s + more * period
        times, volts = burst(self._pieces, expected - period / 2, min(expected + period / 2, self._stop_s))
        found = _rising(times, volts - self._mean_v)
        if not len(found):
            return None
        nearest = float(found[np.abs(found - expected).argmin()])
        return nearest, cycles + more


def _rising(times_s: NDArray[np.float64], volts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return when volts rise through zero."""
    before = np.flatnonzero((volts[:-1] < 0.0) & (volts[1:] >= 0.0))
    low, high = volts[before], volts[before + 1]
    return np.asarray(times_s[before] - low / (high - low) * (times_s[1] - times_s[0]))
