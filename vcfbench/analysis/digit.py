"""The last digit of a record: from which digit on its noise, and its mean, are no longer known.

Noise that spans a digit makes errors of rounding that are even and independent, q/sqrt(12). What is left of the place
of the mean within its digit falls as exp(-2 pi^2 s^2/q^2): the scatter is right within 3 % under a digit of two
standard deviations. Beyond it readings tell little of the noise, and their mean stays within its digit (B. Widrow,
I. Kollar, Quantization Noise, Cambridge 2008, chapter 4).
"""

import math
from typing import Final

import numpy as np
from msgspec import Struct

from vcfbench.analysis.arrays import Floats

FINE: Final = 1.0
"""Digit in standard deviations of the noise up to which it needs no word."""
COARSE: Final = 2.0
"""Digit from which on the noise is not known."""
_SAMPLE: Final = 200_000
_SAME: Final = 1e-6
"""Part of the range within which readings differ by what a computer rounds off."""
_LEAST_LAG: Final = 8
_DECADES: Final = 9
"""Digits that a reading has at most."""


class Digit(Struct, frozen=True):
    """The least step between readings, 0 without one, and the scatter of readings that are 1, 2, 4, ... apart."""

    step: float
    scatter: tuple[float, ...]

    def over(self, intervals: int) -> float:
        """Return the scatter over so many intervals, and eight at least: all that a filter leaves of it."""
        place = math.ceil(math.log2(max(_LEAST_LAG, intervals)))
        return self.scatter[min(place, len(self.scatter) - 1)]

    def in_sd(self, intervals: int) -> float:
        """Return the step in standard deviations that noise with a memory of so many `intervals` had before rounding.

        Errors of readings that follow each other by less than a quarter of a digit are not independent.
        """
        if not self.step:
            return 0.0
        scatter = min(self.over(intervals), 2.0 * self.scatter[0])
        return self.step / math.sqrt(max(scatter**2 - self.step**2 / 12.0, 1e-4 * self.step**2))

    def left_by_place(self, intervals: int) -> float:
        """Return the part of the noise's variance by which it changes with the place of the mean, rms."""
        square = 1.0 / max(self.in_sd(intervals), 0.1) ** 2
        return math.exp(-2.0 * math.pi**2 * square) * (1.0 / (math.pi**2 * square) + 4.0) / math.sqrt(2.0)


def least_step(record: Floats) -> float:
    """Return the least step between two readings of a record, shape (n,), that differ; 0 without one."""
    part = record[:_SAMPLE]
    steps = np.diff(np.sort(part))
    steps = steps[steps > _SAME * float(np.ptp(part))]
    return float(steps.min()) if steps.size else 0.0


def decimal_digit(values: Floats) -> float:
    """Return the largest power of ten of which all values are multiples, as written numbers are; 0 without one."""
    largest = float(np.abs(values).max())
    for power in range(_DECADES if largest else 0):
        digit = 10.0 ** (math.floor(math.log10(largest)) - power)
        if (np.abs(values / digit - np.round(values / digit)) < _SAME).all():
            return digit
    return 0.0


def digit_of(record: Floats) -> Digit:
    """Return the digit of a record, shape (n,), in its unit."""
    part = record[:_SAMPLE]
    lags = [2**place for place in range(int(math.log2(max(2, part.size // 4))))]
    scatter = [math.sqrt(0.5 * float(np.mean((part[lag:] - part[:-lag]) ** 2))) for lag in lags]
    return Digit(least_step(part), tuple(scatter))
