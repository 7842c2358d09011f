"""Flutter of the table: the noise of its torque as its loop lets it through.

The controller holds the encoder's angle, so flutter is noise of the *angle*, which stays bounded however long the table
turns. Through a loop of the second order white noise of the torque gives an angle that is flat below the loop's
frequency f0 and falls beyond it, and a rate whose density S(f) = (2 z f0 f)^2 / ((f0^2 - f^2)^2 + (2 z f0 f)^2), of
unit size at f0, falls to either side: as f^2 towards 0.

It is a sum of `LINES` sines, one in each band, at random in it and with a random phase. So it is known at any instant,
whoever looks when, and gyroscope, encoder and control port have the same. Up to twice f0 bands are f0/20 wide, 1.25 Hz
at 25 Hz: who resolves less than that sees lines.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct

from simrack.mechanics import TableMechanics

if TYPE_CHECKING:
    from numpy.typing import NDArray

_EVEN, _GEOMETRIC = 40, 8
LINES = _EVEN + _GEOMETRIC
_EVEN_TO, _REACH = 2.0, 20.0
"""Up to where bands are evenly wide, and where the last begins, which has all the rest; times the loop's frequency."""
_GRID = 4001
_SHAKES = 1
"""Its random stream, beside the gyroscope's (:mod:`vcfbench.sim.gyro.gyro`)."""


class Flutter(Struct, frozen=True):
    """Noise of the rate of unit density at the loop's frequency, 1/sqrt(Hz), and the angle that goes with it, t in s.

    The rate is the real part of sum `rates` exp(i `speeds_rad_s` t), the angle that of its integral without a constant.
    """

    speeds_rad_s: NDArray[np.float64]
    rates: NDArray[np.complex128]
    angles_s: NDArray[np.complex128]

    @classmethod
    def of(cls, mechanics: TableMechanics, seed: int) -> Flutter | None:
        """Return the flutter of a table, from random numbers of its own; None if it has none."""
        if not mechanics.flutter_per_sqrt_hz:
            return None
        return cls.drawn(mechanics.loop_hz, mechanics.loop_damping, np.random.default_rng([seed, _SHAKES]))

    @classmethod
    def drawn(cls, loop_hz: float, damping: float, random: np.random.Generator) -> Flutter:
        """Return the flutter of one specimen: each band's variance, in one line of it."""
        further = np.geomspace(_EVEN_TO, _REACH, _GEOMETRIC)
        edges = loop_hz * np.concatenate((np.linspace(0.0, _EVEN_TO, _EVEN + 1), further[1:], [_REACH**3]))
        frequencies = np.concatenate(([0.0], loop_hz * np.geomspace(1e-3, _REACH**3, _GRID)))
        through = (2.0 * damping * loop_hz * frequencies) ** 2
        density = through / ((loop_hz**2 - frequencies**2) ** 2 + through)
        steps = 0.5 * (density[1:] + density[:-1]) * np.diff(frequencies)
        below = np.concatenate(([0.0], np.cumsum(steps)))  # variance of the rate below each frequency
        variances = np.diff(np.interp(edges, frequencies, below))
        spots = edges[1:-2] + (edges[2:-1] - edges[1:-2]) * random.uniform(size=LINES - 2)
        # below, where the angle is flat, what stands for the band's angle as for its rate; above, next to nothing
        places = np.concatenate(([edges[1] / math.sqrt(3.0)], spots, [edges[-2] * math.sqrt(2.0)]))
        rates = np.sqrt(2.0 * variances) * np.exp(1j * random.uniform(0.0, 2.0 * np.pi, LINES))
        speeds = 2.0 * np.pi * places
        return cls(speeds, rates, rates / (1j * speeds))

    def rate_at(self, instant_s: float) -> float:
        """Return the rate, 1/sqrt(Hz)."""
        return float((self.rates @ np.exp(1j * self.speeds_rad_s * instant_s)).real)

    def angle_at(self, instant_s: float) -> float:
        """Return the angle, s/sqrt(Hz)."""
        return float((self.angles_s @ np.exp(1j * self.speeds_rad_s * instant_s)).real)
