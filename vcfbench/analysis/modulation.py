"""Lock-in: a sine of known frequency in a record without gaps, window after window, and the noise about it.

The record is fitted with a constant, a trend, and the sine with its second and third harmonic. A curve of third order
makes three times as much of the fundamental as of the third harmonic, and shifts the mean by the second: so one record
tells the gain of small signals and what the sine does to the mean.
"""

import cmath
import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike, NDArray

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.phase_noise import PhaseNoise
from vcfbench.analysis.sine_fit import fit_sine
from vcfbench.errors import ConfigError

ORDERS = (1, 2, 3)
FLICKER_FLOOR = 2.0 * math.log(2.0) / math.pi
"""Allan variance of flicker noise of B = 1 at any time."""
_NEAREST, _FARTHEST = 2, 9
"""Lines of the spectrum, counted from a harmonic, that show the noise about it."""
_ROUNDS = 3
_MOST_OFF = 0.01
"""Largest relative difference of the frequency shown by a record from the nominal one: a meter's spacing is not known
below a millisecond."""


class Demodulated(Struct, frozen=True):
    """One record. Phasors are those of a cosine, the averaging over each reading divided out.

    `phase_rad` is that of the fundamental at the middle of the first reading. `phasors` are those of the three orders
    with that phase turned out of them, so that the first is real. `in_phase` are the fundamentals of the windows,
    likewise. `line_power` is the mean square of the spectrum's lines about each order, of which there are `lines`; the
    variance of an amplitude over n of the `readings` readings is ``2 * line_power / (readings * n)``.
    """

    readings: int
    mean: float
    phase_rad: float
    phasors: tuple[complex, complex, complex]
    in_phase: tuple[float, ...]
    line_power: tuple[float, float, float]
    lines: tuple[int, int, int]
    residual_rms: float

    def variance(self, order: int, readings: int) -> float:
        """Return the variance that noise gives an amplitude of `order` over so many readings."""
        return 2.0 * self.line_power[order - 1] / (self.readings * readings)


def demodulated(samples: ArrayLike, aperture_s: float, frequency_hz: float, windows: int) -> Demodulated:
    """Fit a record of readings that follow each other without gaps, and each of `windows` equal parts of it.

    Raises:
        ConfigError: no sine of that frequency is in it, or the record is too short to show the noise about it.
    """
    values = np.asarray(samples, dtype=np.float64)
    seen = fit_sine(values, aperture_s, frequency_hz)
    if abs(seen.frequency_hz / frequency_hz - 1.0) > _MOST_OFF:
        raise ConfigError(f"a sine of {frequency_hz:g} Hz was put in, the record shows one of {seen.frequency_hz:g} Hz")
    turns = _turns(values, seen.frequency_hz * aperture_s)
    basis = _basis(values.size, turns)
    found, *_ = np.linalg.lstsq(basis, values, rcond=None)
    averaged = np.sinc(np.array(ORDERS) * frequency_hz * aperture_s)
    phasors = _phasors(found) / averaged
    phase = cmath.phase(phasors[0])
    length = values.size // windows
    in_phase = []
    for first in range(0, windows * length, length):
        # The part of a record's basis with its trend about its own middle
        own = basis[first : first + length].copy()
        own[:, 1] -= own[:, 1].mean()
        part, *_ = np.linalg.lstsq(own, values[first : first + length], rcond=None)
        in_phase.append(float((_phasors(part)[0] / averaged[0] * cmath.exp(-1j * phase)).real))
    left = values - basis @ found
    # The mean square of the lines about each order, halfway to its neighbours at most, and how many they are
    cycles, power, lines = turns * left.size, [], []
    steps = range(_NEAREST, min(_FARTHEST, int(cycles / 2.0)) + 1)
    for order in ORDERS:
        places = [order * cycles + sign * step for step in steps for sign in (-1.0, 1.0)]
        kept = [each for each in places if 1.5 < each < 0.5 * left.size - 1.0]
        if not kept:
            raise ConfigError(f"{cycles:.3g} periods do not show the noise about a harmonic: at least 8 are needed")
        turned = np.exp(-2j * math.pi * np.outer(np.array(kept) / left.size, np.arange(left.size))) @ left
        power.append(float(np.mean(np.abs(turned) ** 2)))
        lines.append(len(kept))
    aligned = [complex(each * cmath.exp(-1j * order * phase)) for order, each in zip(ORDERS, phasors, strict=True)]
    scale = tuple(float(each / one**2) for each, one in zip(power, averaged, strict=True))
    return Demodulated(
        values.size,
        float(found[0]),
        phase,
        (aligned[0], aligned[1], aligned[2]),
        tuple(in_phase),
        (scale[0], scale[1], scale[2]),
        (lines[0], lines[1], lines[2]),
        float(np.std(left)),
    )


def _turns(values: Floats, start: float) -> float:
    """Return the cycles a reading that fit sine and harmonics best, by Gauss and Newton from `start`."""
    turns, steps = start, np.arange(values.size, dtype=np.float64)
    for _ in range(_ROUNDS):
        basis = _basis(values.size, turns)
        found, *_ = np.linalg.lstsq(basis, values, rcond=None)
        orders = 2.0 * math.pi * np.array(ORDERS)
        slope = steps * (basis[:, 2:5] @ (orders * found[5:8]) - basis[:, 5:8] @ (orders * found[2:5]))
        change, *_ = np.linalg.lstsq(np.column_stack([basis, slope]), values - basis @ found, rcond=None)
        turns += float(change[-1])
    return turns


def _basis(count: int, turns: float) -> Floats:
    steps = np.arange(count, dtype=np.float64)
    angle = 2.0 * math.pi * turns * np.outer(steps, ORDERS)
    return np.column_stack([np.ones(count), steps / count - 0.5, np.cos(angle), np.sin(angle)])


def _phasors(found: NDArray[np.floating]) -> NDArray[np.complex128]:
    return np.asarray(found[2:5] - 1j * found[5:8])


def static_response(frequency_hz: float, split_hz: float, in_phase_split_hz: float, in_phase_share: float) -> float:
    """Return the gain at a frequency far below the splits over that at rest, of two modes without damping.

    Raises:
        ConfigError: the frequency is not far below.
    """
    if not 0.0 <= frequency_hz < 0.3 * min(split_hz, in_phase_split_hz):
        raise ConfigError(f"{frequency_hz:g} Hz is not far below a split of {split_hz:g} Hz")
    own, far = (1.0 / (1.0 - (frequency_hz / each) ** 2) for each in (split_hz, in_phase_split_hz))
    return (1.0 - in_phase_share) * own + in_phase_share * far


def flicker_share(begin_s: Sequence[float], length_s: float, weights: Sequence[float]) -> float:
    """Return the variance that flicker noise of B = 1 gives ``sum weights * mean``, each mean over `length_s`.

    The weights add up to 0, else there is no such variance.
    """
    begin, weight = np.asarray(begin_s, dtype=np.float64), np.asarray(weights, dtype=np.float64)
    times = np.concatenate([begin + length_s, begin])
    shares = np.concatenate([weight, -weight]) / length_s
    return max(0.0, float(shares @ PhaseNoise(flicker=1.0).among(times) @ shares))  # rounding may make 0 less
