"""Noise that is the same for whoever looks: each of its values follows from a seed and its number alone.

White noise is a sum over scales. The mean over 512 ticks is a Gaussian of its own; its halves differ from it by plus
and minus another, their halves again, down to a tick. So a piece of a millisecond needs no ticks, and what an
oscilloscope sees of single ticks adds up to it. Between ticks it goes straight, which gives it its bandwidth.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from vcfbench.sim.instruments.agilent33220a.playing import cosines
from vcfbench.sim.sources import Piece

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from vcfbench.sim.instruments.agilent33220a.waveforms import Values
    from vcfbench.sim.sources import Bend

__all__ = ["CREST", "Noise", "gaussian"]

CREST = 3.3
"""Peak over rms: the amplitude of noise is 6.6 times its rms (unverified)."""
_TICK_S = 0.319 / 9e6
"""Straight lines between ticks are 3 dB down at 0.319 of their rate: 9 MHz, typical of the 33220A (unverified)."""
_LEVELS = 9
_COARSE_BINS = 2048
_MIX = (np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB))
_STEP = 0x9E3779B97F4A7C15


class Noise(Struct, frozen=True):
    """offset_v and Gaussian noise of `rms_v`, clipped at its crest."""

    offset_v: float
    rms_v: float
    seed: int
    source_ohm: float = 50.0

    @property
    def _tick_v(self) -> float:
        return self.rms_v * math.sqrt(1.5)  # a straight line between two has 2/3 of their power, on average

    def at(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the open-circuit volts at bench times."""
        ticks = times_s / _TICK_S - 0.5
        whole = np.floor(ticks)
        numbers, part = whole.astype(np.int64), ticks - whole
        volts = (1 - part) * self._ticks_v(numbers) + part * self._ticks_v(numbers + 1)
        return np.asarray(self.offset_v + np.clip(volts, -CREST * self.rms_v, CREST * self.rms_v))

    def _ticks_v(self, numbers: NDArray[np.int64]) -> Values:
        size = self._tick_v
        volts = self._means_v(numbers >> _LEVELS)
        for level in range(_LEVELS):
            differing = size / math.sqrt(2 << level) * gaussian(self.seed, level, numbers >> (level + 1))
            volts += np.where((numbers >> level) & 1, differing, -differing)
        return volts

    def _means_v(self, numbers: NDArray[np.int64]) -> Values:
        """Return the means over 512 ticks."""
        return self._tick_v / math.sqrt(1 << _LEVELS) * gaussian(self.seed, _LEVELS, numbers)

    def piece(self, start_s: float, bend: Bend) -> Piece:
        """Return what an input makes of it, from means over 18 us."""
        bin_s = _TICK_S * (1 << _LEVELS)
        first = math.floor(start_s / bin_s)
        means = self.offset_v + self._means_v(np.arange(first, first + _COARSE_BINS))
        rest = self.rms_v**2
        made = bend[0] + bend[1] * means + bend[2] * (means**2 + rest) + bend[3] * means * (means**2 + 3 * rest)
        lasts = _COARSE_BINS * bin_s
        constant, slope, terms = cosines(made, lasts)
        since = start_s - first * bin_s
        turned = tuple((a * np.exp(s * since), s) for a, s in terms)
        return Piece(start_s, start_s + lasts - since, constant, slope, turned)

    def divided(self, share: float) -> Noise:
        """Return what it is behind a load."""
        offset_v, rms_v = self.offset_v * share, self.rms_v * share
        return replace(self, offset_v=offset_v, rms_v=rms_v, source_ohm=self.source_ohm * share)


def gaussian(seed: int, stream: int, numbers: NDArray[np.int64]) -> Values:
    """Return a Gaussian of deviation 1 for each number: two hashes of it, by Box and Muller."""
    key = _hashed(np.array([(seed * 64 + stream) % 2**64], dtype=np.uint64))
    first = _hashed(numbers.astype(np.uint64) ^ key)
    second = _hashed(first ^ np.uint64(_STEP))
    radius = np.sqrt(-2 * np.log(_unit(first)))
    return np.asarray(radius * np.cos(2 * math.pi * _unit(second)))


def _hashed(numbers: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Mix 64 bits (the finaliser of splitmix64, Steele, Lea and Flood 2014)."""
    mixed = numbers + np.uint64(_STEP)
    mixed = (mixed ^ (mixed >> np.uint64(30))) * _MIX[0]
    mixed = (mixed ^ (mixed >> np.uint64(27))) * _MIX[1]
    return np.asarray(mixed ^ (mixed >> np.uint64(31)))


def _unit(hashed: NDArray[np.uint64]) -> Values:
    """Return numbers above 0 and up to 1."""
    return np.asarray(((hashed >> np.uint64(11)).astype(np.float64) + 1) * 2.0**-53)
