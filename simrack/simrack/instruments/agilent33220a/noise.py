"""Noise that is the same for every observer: each of its values follows from a seed and its number alone.

White noise is a sum over scales. The mean over 512 ticks is a Gaussian of its own; its halves differ from it by plus
and minus another, their halves again, down to a tick. So a piece of a millisecond needs no ticks, and what an
oscilloscope sees of single ticks adds up to it. Each tick sounds through a low pass, which gives it its bandwidth.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, partial

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from simrack.components import SHORTEST_S, Path, Simple
from simrack.instruments.agilent33220a.playing import cosines
from simrack.instruments.agilent33220a.waveforms import Values
from simrack.sources import Bend, Piece

CREST = 3.3
"""Peak over rms: the amplitude of noise is 6.6 times its rms (unverified)."""
_TICK_S = 25e-9
_TICKS = 8
"""How many ticks are heard at an instant, each by what a raised cosine leaves of a sinc."""
_CORNER_HZ = 11.218856e6
"""Of that sinc: so the noise is 3 dB down at 9 MHz, typical of the 33220A (unverified), and 50 dB at 20 MHz."""
_SLOW_GAIN = 1.4894
"""What this low pass makes of slow noise, as a part of what it makes of all noise."""
_LEFT_BY_CLIPPING = 0.99910
"""Rms of a Gaussian of deviation 1 that is clipped at `CREST`."""
_LINES = 1000
_LEVELS = 9
_COARSE_BINS = 2048
_OFFSETS = range(1 - _TICKS // 2, 1 + _TICKS // 2)
_MIX = (np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB))
_STEP = 0x9E3779B97F4A7C15


class NoiseSource(Simple, frozen=True):
    """Gaussian noise of `rms_v` about offset_v, clipped at its crest."""

    offset_v: float
    rms_v: float
    seed: int
    source_ohm: float = 50.0

    def at(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the open-circuit volts at bench times."""
        ticks = times_s / _TICK_S - 0.5
        whole = np.floor(ticks)
        numbers, part = whole.astype(np.int64), ticks - whole
        heard = [_heard(part - offset) for offset in _OFFSETS]
        loudness = np.sqrt(sum(each**2 for each in heard))
        volts = sum(each * tick_v for each, tick_v in zip(heard, self._about_v(numbers), strict=True)) / loudness
        return np.asarray(self.offset_v + np.clip(volts, -CREST * self.rms_v, CREST * self.rms_v))

    def _about_v(self, numbers: NDArray[np.int64]) -> Values:
        """Return the ticks that are heard at some, a row an offset: those of a short time are drawn once."""
        first, last = int(numbers.min()) + _OFFSETS[0], int(numbers.max()) + _OFFSETS[-1]
        wanted = numbers + np.array(_OFFSETS)[:, None]
        if last - first > _TICKS * len(numbers):
            return self._ticks_v(wanted)
        return np.asarray(self._row_v(first, last)[wanted - (first >> _LEVELS << _LEVELS)])

    def _row_v(self, first: int, last: int) -> Values:
        """Return the volts of all ticks in the 512s that contain `first` and `last`, as `_ticks_v` defines them."""
        volts = self._means_v(np.arange(first >> _LEVELS, (last >> _LEVELS) + 1)) / _SLOW_GAIN
        for level in reversed(range(_LEVELS)):
            begun = first >> _LEVELS << (_LEVELS - level - 1)
            numbers = np.arange(begun, begun + len(volts))
            differing = self.rms_v / math.sqrt(2 << level) * gaussian(self.seed, level, numbers)
            volts = np.stack((volts - differing, volts + differing), axis=-1).ravel()
        return volts

    def _ticks_v(self, numbers: NDArray[np.int64]) -> Values:
        """Return the volts of ticks, rows of neighbours: what these have in common is drawn once."""

        def each(drawn: Callable[[NDArray[np.int64]], Values], level: int) -> Values:
            blocks = numbers >> level
            few = blocks[0] + np.arange(int((blocks[-1] - blocks[0]).max()) + 1)[:, None]
            return np.asarray(np.take_along_axis(drawn(few), blocks - blocks[0], axis=0))

        volts = each(self._means_v, _LEVELS) / _SLOW_GAIN
        for level in reversed(range(_LEVELS)):
            differing = self.rms_v / math.sqrt(2 << level) * each(partial(gaussian, self.seed, level), level + 1)
            volts += np.where((numbers >> level) & 1, differing, -differing)
        return np.asarray(volts)

    def _means_v(self, numbers: NDArray[np.int64]) -> Values:
        """Return the means over 512 ticks."""
        return _SLOW_GAIN * self.rms_v / math.sqrt(1 << _LEVELS) * gaussian(self.seed, _LEVELS, numbers)

    def piece(self, start_s: float, bend: Bend) -> Piece:
        """Return the pick-up after the input's non-linearity, from means over 18 us."""
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

    def divided(self, share: float) -> NoiseSource:
        """Return the source behind a load."""
        offset_v, rms_v = self.offset_v * share, self.rms_v * share
        return replace(self, offset_v=offset_v, rms_v=rms_v, source_ohm=self.source_ohm * share)

    def components(self) -> tuple[NoiseSource]:
        """Return that it is one."""
        return (self,)

    # --- as a component, for who looks through a path of limited bandwidth ------------------------------------------

    @property
    def pace_hz(self) -> None:
        """It never repeats."""
        return

    @property
    def turning(self) -> None:
        """None: noise has no cycles."""
        return

    @property
    def finest_s(self) -> float:
        """An eighth of the shortest period that a path lets through."""
        return 2.5 * SHORTEST_S

    def means(self, edges_s: Values) -> Values:
        """Return it in the middles, where they are far apart its means over some 10 us."""
        middles = (edges_s[1:] + edges_s[:-1]) / 2
        if edges_s[-1] - edges_s[0] > len(middles) * _TICK_S * (1 << _LEVELS):
            return np.asarray(self.offset_v + self._means_v(_blocks(middles)))
        return self.at(middles)

    def powers(self, edges_s: Values, path: Path) -> tuple[Values, Values]:
        """Return its means over some 10 us, and the means of its square: of faster noise the expected ones."""
        slow_v = self._means_v(_blocks((edges_s[1:] + edges_s[:-1]) / 2))
        rest = self.rms_v**2 * (_left(path) * _LEFT_BY_CLIPPING**2 - _SLOW_GAIN**2 / (1 << _LEVELS))
        means = self.offset_v + slow_v
        return np.asarray(means), np.asarray(means**2 + max(rest, 0.0))

    def peak_v(self, path: Path) -> float:
        """Return its crest behind the path."""
        return CREST * self.rms_v * math.sqrt(_left(path))


def _blocks(times_s: Values) -> NDArray[np.int64]:
    """Return in which 512 ticks times are."""
    return np.floor(times_s / (_TICK_S * (1 << _LEVELS))).astype(np.int64)


def _heard(ticks: Values) -> Values:
    """Return the size of a tick so many ticks after it, up to half of `_TICKS`."""
    bell = np.cos(math.pi * ticks / _TICKS) ** 2
    return np.where(np.abs(ticks) < _TICKS / 2, np.sinc(2 * _CORNER_HZ * _TICK_S * ticks) * bell, 0.0)


@cache
def _density() -> tuple[Values, Values]:
    """Return frequencies, and the density of the noise's power there."""
    ticks = np.linspace(-_TICKS / 2, _TICKS / 2, 64 * _TICKS + 1)
    hertz = np.asarray((np.arange(_LINES) + 0.5) / (2 * _TICK_S * _LINES), dtype=np.float64)
    return hertz, np.asarray((np.cos(math.tau * _TICK_S * np.outer(hertz, ticks)) @ _heard(ticks)) ** 2)


def _left(path: Path) -> float:
    """Return the part of the noise's power that is behind a path."""
    hertz, density = _density()
    return float(density @ np.abs(path(hertz)) ** 2 / density.sum())


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
