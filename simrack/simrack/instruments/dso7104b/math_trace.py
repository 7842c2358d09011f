"""The math trace of an InfiniiVision oscilloscope: one function of one or two channels, computed from their records.

Definitions after the siblings' guides: an integral begins with zero at the left edge; where a square root is undefined
the trace has holes, zeros; an FFT is in dBV, 0 dBV being a sine of 1 V rms. What is not known, of this model: the slope
that DIFFerentiate takes is the one between the two neighbours of a point here, the lowest level of an FFT -200 dBV.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

FFT_POINTS = 65536
_FLOOR_DBV = -200.0
_SAME = 1e-6
TWO_SOURCES = ("ADD", "SUBT", "MULT")

_COSINES: dict[str, tuple[float, ...]] = {
    "RECT": (1.0,),
    "HANN": (0.5, -0.5),
    "FLAT": (0.21557895, -0.41663158, 0.277263158, -0.083578947, 0.006947368),
    "BHAR": (0.35875, -0.48829, 0.14128, -0.01168),
}
"""Sums of cosines: Hann; the flat top of D'Antona and Ferrero; Harris's four-term minimum."""
WINDOWS = tuple(_COSINES)


def combined(operation: str, one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sum, the difference or the product of two records."""
    if operation == "ADD":
        return one + other
    return one - other if operation == "SUBT" else one * other


def transformed(operation: str, volts: NDArray[np.float64], step_s: float) -> NDArray[np.float64]:
    """Return the integral (V s), the derivative (V/s) or the square root of a record."""
    # Trapezoidal rule's sums from the left edge on
    functions: dict[str, Callable[[], NDArray[np.float64]]] = {
        "INT": lambda: np.concatenate(([0.0], np.cumsum((volts[1:] + volts[:-1]) * (step_s / 2.0)))),
        "DIFF": lambda: np.gradient(volts, step_s),
        "SQRT": lambda: np.sqrt(np.where(volts > 0.0, volts, 0.0)),
    }
    return np.asarray(functions[operation]())


class Spectrum(Struct, frozen=True):
    """An FFT: level at multiples of `step_hz`."""

    step_hz: float
    dbv: NDArray[np.float64]

    @classmethod
    def of(cls, volts: NDArray[np.float64], step_s: float, window: str) -> Spectrum:
        """Return the spectrum of a record seen through a window."""
        count = len(volts)
        turns = 2.0 * math.pi * np.arange(count) / count
        weights = np.sum([size * np.cos(n * turns) for n, size in enumerate(_COSINES[window])], axis=0)
        peaks = 2.0 * np.abs(np.fft.rfft(volts * weights)) / weights.sum()
        peaks[0] /= 2.0
        rms = peaks / math.sqrt(2.0)
        rms[0] = peaks[0]
        return cls(1.0 / (count * step_s), 20.0 * np.log10(np.maximum(rms, 10.0 ** (_FLOOR_DBV / 20.0))))

    def shown(self, start_hz: float, stop_hz: float, points: int) -> NDArray[np.float64]:
        """Return levels at `points` frequencies from `start_hz` on.

        Of several lines at one point the strongest; between two lines what joins them.
        """
        step_hz = (stop_hz - start_hz) / points
        if step_hz < self.step_hz:
            lines_hz = self.step_hz * np.arange(len(self.dbv))
            places_hz = start_hz + step_hz * np.arange(points)
            return np.asarray(np.interp(places_hz, lines_hz, self.dbv, _FLOOR_DBV, _FLOOR_DBV))
        edges = start_hz + (np.arange(points + 1) - 0.5) * step_hz
        # half a line up belongs to the next point always: rounding to even would show every second line twice
        places = np.clip(np.ceil(edges / self.step_hz - _SAME).astype(int), 0, len(self.dbv) - 1)
        levels = np.maximum.reduceat(self.dbv, places)[:-1]
        beyond = (edges[:-1] > self.step_hz * len(self.dbv)) | (edges[1:] < 0.0)
        levels[beyond] = _FLOOR_DBV
        return np.asarray(levels)
