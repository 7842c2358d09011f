"""White noise of the electronics behind the demodulator, up to a first-order corner.

It is the same for everybody at the same instant: values `1/64` of the corner's period apart come from the seed and the
place in bench time, block by block, with straight lines between them (which keep the density, and 97 % of the power).
"""

import math

import numpy as np
from numpy.typing import NDArray

TICKS_A_PERIOD = 64
REMEMBERED = 256
"""Ticks after which a first-order filter has forgotten 1e-11."""
BLOCK_TICKS = 4096
BLOCKS_KEPT = 256


class ElectronicNoise:
    """Noise of a one-sided density, V/sqrt(Hz), up to `corner_hz`; its random numbers come from `key`."""

    __slots__ = ("_blocks", "_kernel", "_key", "_tick_s")

    def __init__(self, density_v_sqrt_hz: float, corner_hz: float, key: tuple[int, ...]) -> None:
        self._key = key
        self._tick_s = 1.0 / (TICKS_A_PERIOD * corner_hz)
        kept = math.exp(-math.tau / TICKS_A_PERIOD)
        deviation_v = density_v_sqrt_hz * math.sqrt(math.pi / 2 * corner_hz)
        self._kernel = deviation_v * math.sqrt(1 - kept**2) * kept ** np.arange(REMEMBERED)
        self._blocks: dict[int, NDArray[np.float64]] = {}

    def at(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the volts at bench times."""
        ticks = times_s / self._tick_s
        places = np.floor(ticks).astype(np.int64)
        parts, blocks = ticks - places, places // BLOCK_TICKS
        volts = np.empty_like(times_s)
        for block in np.unique(blocks):
            held, first = blocks == block, int(block) * BLOCK_TICKS
            values = self._ticks(first, first + BLOCK_TICKS + 1)
            low, part = places[held] - first, parts[held]
            volts[held] = (1 - part) * values[low] + part * values[low + 1]
        return volts

    def integral(self, start_s: float, stop_s: float) -> float:
        """Return the integral between two bench times, V s."""
        first, last = math.floor(start_s / self._tick_s), math.ceil(stop_s / self._tick_s)
        knots = np.arange(first, last + 1) * self._tick_s
        values = self._ticks(first, last + 1)
        times = np.concatenate(([start_s], knots[(knots > start_s) & (knots < stop_s)], [stop_s]))
        return float(np.trapezoid(np.interp(times, knots, values), times))

    def _ticks(self, first: int, stop: int) -> NDArray[np.float64]:
        """Return the values at ticks from `first` up to, not including, `stop`."""
        blocks = range(first // BLOCK_TICKS, (stop - 1) // BLOCK_TICKS + 1)
        values = np.concatenate([self._block(each) for each in blocks])
        return values[first - blocks[0] * BLOCK_TICKS :][: stop - first]

    def _block(self, index: int) -> NDArray[np.float64]:
        if index not in self._blocks:
            if len(self._blocks) >= BLOCKS_KEPT:
                del self._blocks[next(iter(self._blocks))]
            before = self._drawn(index - 1)[BLOCK_TICKS - REMEMBERED + 1 :]
            driving = np.concatenate((before, self._drawn(index)))
            self._blocks[index] = np.convolve(driving, self._kernel, mode="valid")
        return self._blocks[index]

    def _drawn(self, index: int) -> NDArray[np.float64]:
        return np.random.default_rng([*self._key, index + 2]).standard_normal(BLOCK_TICKS)
