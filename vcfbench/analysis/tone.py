"""Sines of known frequency in records of a meter: spacing of the samples, size and noise of each tone.

Each record holds one sine. The meter's own time base is not known well enough, so the spacing of its samples is found
from a strong one.
"""

import math
from collections.abc import Sequence
from contextlib import suppress
from itertools import pairwise

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.sine_fit import fit_sine
from vcfbench.errors import ConfigError, MeasurementError

BINS = range(2, 9)
"""Lines of the spectrum either side of a tone that its noise is read from."""
HARMONICS = 3
_FINER, _TINY = 16, 1e-300
"""Lines of a spectrum for each that the record tells apart; power of no line."""
_APART = 1.5
"""Lines of the spectrum between sines that a record tells apart."""
_ROUNDING = 1e-12
"""Relative rounding error of an amplitude without noise."""


class Tone(Struct, frozen=True):
    """One sine in a record, the aperture of the samples divided out; amplitudes in the unit of the samples."""

    frequency_hz: float
    amplitude: float
    u_amplitude: float
    """From the noise about this frequency in this record alone."""
    third: float
    """Third harmonic as the cube of the tone has it, with its sign: cos 3 phi where the tone is cos phi."""
    spacing_s: float
    """Spacing of the samples."""
    noise_dof: float
    noise_hz: tuple[float, ...] = ()
    """Lines beside the tone from which the noise was read, Hz; none: the tone's own place."""
    alone: bool = True
    """Whether the spacing of the samples folds no harmonic onto the tone, another one or the mean."""
    u_third: float = 0.0
    """As `u_amplitude`, from the noise about three times the frequency."""


def true_spacing_s(records: Sequence[tuple[float, ArrayLike]], interval_s: float, late_s: float = 1e-3) -> float:
    """Return the interval of the samples, s, from sines of known frequency; at most `late_s` above `interval_s`.

    All records have one spacing, at which most of them have a line that stands above what is beside it: the noise of a
    narrow mode may be the strongest line of each. Where it is so is fitted in the strongest of these sines.

    Raises:
        ConfigError: fewer than 64 samples, a frequency that they do not hold, or no sine there.
    """
    highest_hz, most = max(hz for hz, _ in records), max(np.size(volts) for _, volts in records)
    tried_s = interval_s + np.linspace(0.0, late_s, max(2, math.ceil(late_s * highest_hz * most / 0.2) + 1))
    stands, sizes = np.zeros(tried_s.size), []
    for hz, volts in records:
        values = _checked(volts, interval_s + late_s, hz)
        power = np.abs(np.fft.fft(values - values.mean(), _FINER * values.size)) ** 2
        beside = np.mean([np.roll(power, sign * _FINER * step) for step in BINS for sign in (-1, 1)], axis=0)
        at = np.rint(hz * tried_s * power.size).astype(int)
        stands += np.log1p(power[at] / (beside[at] + _ROUNDING * power.max() + _TINY))
        sizes.append(hz * np.sqrt(power[at]) / values.size)
    place = int(stands.argmax())
    for each in np.argsort([-size[place] for size in sizes], kind="stable").tolist():
        hz, volts = records[each]
        with suppress(MeasurementError):
            spacing_s = float(fit_sine(volts, 1.0, hz * float(tried_s[place])).frequency_hz / hz)
            if abs(spacing_s - float(tried_s[place])) < late_s:  # else it walked away in the noise of a narrow mode
                return spacing_s
    raise ConfigError(f"no sine of {', '.join(f'{hz:g}' for hz, _ in records)} Hz was found")


def fit_tone(samples: ArrayLike, spacing_s: float, aperture_s: float, frequency_hz: float, *, mains_hz: float) -> Tone:
    """Fit a sine of known frequency, its harmonics and the mains to samples that are `spacing_s` apart.

    Raises:
        ConfigError: fewer than 64 samples, or a frequency that they do not hold.
    """
    values = _checked(samples, spacing_s, frequency_hz)
    cycles = frequency_hz * spacing_s
    steps = np.arange(values.size) - (values.size - 1) / 2.0
    turns = [cycles * order for order in range(1, HARMONICS + 1)]
    seen_at = sorted(abs(math.remainder(each, 1.0)) for each in (0.0, *turns))
    alone = min(after - before for before, after in pairwise(seen_at)) * values.size > _APART
    turns = turns if alone else turns[:1]
    if abs(frequency_hz - mains_hz) * spacing_s * values.size > 2.0:
        turns.append(mains_hz * spacing_s)
    angle = 2.0 * math.pi * np.outer(steps, turns)
    basis = np.column_stack([np.ones_like(steps), steps / values.size, np.cos(angle), np.sin(angle)])
    found, *_ = np.linalg.lstsq(basis, values, rcond=None)
    tone, third = (complex(found[2 + n], -found[2 + len(turns) + n]) for n in (0, HARMONICS - 1 if alone else 0))
    left, width = values - basis @ found, 1.0 / values.size

    def noise(turn: float) -> tuple[float, Floats]:
        """Return u of an amplitude, and the lines of the spectrum beside it that tell it, in turns a sample."""
        places = abs(math.remainder(turn, 1.0)) + np.array([sign * step * width for step in BINS for sign in (-1, 1)])
        keep = (places > 1.5 * width) & (places < 0.5 - width)
        for other in turns:
            keep &= np.abs(places - abs(math.remainder(other, 1.0))) > 1.5 * width
        places = places[keep]
        lines = np.exp(-2j * math.pi * np.outer(places, np.arange(values.size))) @ left
        power = 2.0 / values.size**2 * float(np.mean(np.abs(lines) ** 2)) if places.size else math.inf
        return math.sqrt(power), places

    u_amplitude, places = noise(turns[0])
    if not places.size:
        raise ConfigError("no part of the spectrum about the tone shows the noise alone")
    swing = tone / abs(tone)
    once, thrice = (float(np.sinc(order * frequency_hz * aperture_s)) for order in (1, HARMONICS))
    return Tone(
        frequency_hz=frequency_hz,
        amplitude=abs(tone) / once,
        u_amplitude=u_amplitude / once,
        third=alone * (third * swing.conjugate() ** 3).real / thrice,
        spacing_s=spacing_s,
        noise_dof=2.0 * places.size,
        noise_hz=tuple((places / spacing_s).tolist()),
        alone=alone,
        u_third=noise(turns[HARMONICS - 1])[0] / abs(thrice) if alone else 0.0,
    )


def _checked(samples: ArrayLike, spacing_s: float, frequency_hz: float) -> Floats:
    values = np.asarray(samples, dtype=np.float64)
    if values.size < 64 or 2.0 * frequency_hz * spacing_s > 0.95:
        raise ConfigError(f"{values.size} samples, one every {spacing_s:g} s, hold no sine of {frequency_hz:g} Hz")
    return values
