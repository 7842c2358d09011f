"""Waveforms of the PCB at far more points than they have anything to show: computed coarsely, interpolated.

An oscilloscope takes up to 4 GSa/s of signals below 20 kHz. Cubic interpolation through points 2 us apart is off by at
most 0.0234 (w h)^4, 2e-6 of a sine at 7 kHz, a tenth of a step of its 16-bit waveform format.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

COARSE_S = 2e-6
FEWEST = 1024
LEAST_SAVING = 4


class Coarse(Struct, frozen=True):
    """Every `share`-th of `count` evenly spaced times, with the neighbours that a cubic needs at both ends."""

    first_s: float
    step_s: float
    count: int
    share: int

    def times_s(self) -> NDArray[np.float64]:
        """Return the coarse times: one before the first, two after the last interval."""
        intervals = -(-self.count // self.share)
        places = np.arange(-1, intervals + 2, dtype=np.float64)
        return np.asarray(self.first_s + places * (self.step_s * self.share))

    def interpolated(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the fine values from those at :meth:`times_s`: one Lagrange cubic an interval."""
        x = np.arange(self.share) / self.share
        weights = np.array(
            (-x * (x - 1) * (x - 2) / 6, (x * x - 1) * (x - 2) / 2, -x * (x + 1) * (x - 2) / 2, x * (x * x - 1) / 6)
        )
        fine = np.lib.stride_tricks.sliding_window_view(values, 4) @ weights
        return np.asarray(fine.reshape(-1)[: self.count])


def coarser(times_s: NDArray[np.float64]) -> Coarse | None:
    """Return the coarse times for evenly spaced ones that are dense, None where they are not."""
    if times_s.ndim != 1 or len(times_s) < FEWEST:
        return None
    step = float(times_s[-1] - times_s[0]) / (len(times_s) - 1)
    share = int(COARSE_S / step) if step > 0 else 0
    if share < LEAST_SAVING or float(np.abs(np.diff(times_s) - step).max()) > 0.01 * COARSE_S:
        return None
    return Coarse(float(times_s[0]), step, len(times_s), share)
