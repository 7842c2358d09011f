"""A sine, as sources are made of them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from msgspec import Struct

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class Sine(Struct, frozen=True):
    """amplitude_v sin(2 pi frequency_hz t + phase_rad), t in bench time."""

    amplitude_v: float
    frequency_hz: float
    phase_rad: float

    def at(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return its volts at bench times."""
        return sines((self,), times_s)

    def value_v(self, now_s: float) -> float:
        """Return its volts at one bench time."""
        return self.amplitude_v * math.sin(math.tau * self.frequency_hz * now_s + self.phase_rad)

    def mean_v(self, start_s: float, stop_s: float) -> float:
        """Return its mean over a stretch of bench time."""
        turned = math.pi * self.frequency_hz * (stop_s - start_s)
        middle = math.pi * self.frequency_hz * (start_s + stop_s) + self.phase_rad
        return self.amplitude_v * math.sin(middle) * math.sin(turned) / turned


def sines(summed: tuple[Sine, ...], times_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the volts of a sum of sines at bench times."""
    import numpy as np  # noqa: PLC0415  (kept out of the import of the package)

    volts = np.zeros_like(times_s)
    for each in summed:
        volts += each.amplitude_v * np.sin(2 * math.pi * each.frequency_hz * times_s + each.phase_rad)
    return volts
