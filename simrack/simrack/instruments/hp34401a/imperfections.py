"""Imperfections of a 34401A, drawn from its published one-year accuracy (User's Guide p. 216-221).

The maker designs for better than four standard deviations within the published limits (p. 227), so every error is drawn
normally with a quarter of its limit, and none goes beyond it. Where a limit depends on range and function, the error is
given as a share of it, -1 to 1.

Of the ac table (p. 218) the class from 10 Hz to 20 kHz and the counter's ends were at hand; the other classes, the
errors at low frequencies and those of crest factors are as generally quoted, unverified.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct, field


def _share(rng: np.random.Generator) -> float:
    """Return a share of a published limit: a quarter is one standard deviation, one the end."""
    return float(min(max(rng.normal(0.0, 0.25), -1.0), 1.0))


class AcErrors(Struct, frozen=True):
    """Imperfections of the ac voltage function."""

    gain_error: float = 0.0
    """Relative error of the reading at all frequencies (p. 218: 0.06 % from 10 Hz to 20 kHz, 0.045 % of it here)."""
    range_gain_error: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    """Further relative error of each range, lowest first: the published limit does not say that they share one."""
    low_frequency_error: float = 0.0
    """Further relative error at 3 Hz, falling with the fourth power (p. 218: 1 % at 3 Hz, 0.35 % at 5 Hz)."""
    flatness_error: float = 0.0
    """Further relative error at 300 kHz, rising with the square (p. 218: 4 % from 100 kHz, 0.6 % and 0.12 % below)."""
    range_share: float = 0.0
    """Share of the published error of range (p. 218: 0.03 % of range, 0.04 % on the lowest)."""
    crest_share: float = 0.0
    """Share of the published additional error for waveforms that are no sine (p. 218: 0.05 % to 0.4 % of reading)."""
    noise: float = 0.0
    """White noise of a reading, rms, as a part of the range (unverified)."""

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> AcErrors:
        """Return a specimen; the limits of the three errors of reading add up to less than the published one."""
        return cls(
            gain_error=0.00045 * _share(rng),
            low_frequency_error=0.007 * _share(rng),
            flatness_error=0.024 * _share(rng),
            range_share=_share(rng),
            crest_share=_share(rng),
            noise=3e-6,
        )


class CounterErrors(Struct, frozen=True):
    """Imperfections of frequency and period."""

    timebase_error: float = 0.0
    """Relative error of the reading at all frequencies (p. 218: 0.01 % from 40 Hz, 0.008 % of it here)."""
    low_frequency_error: float = 0.0
    """Further relative error at 3 Hz, falling with the square (p. 218: 0.1 % at 3 Hz, 0.05 %, 0.03 %, 0.01 %)."""
    noise: float = 0.0
    """White noise, rms, as a multiple of the resolution that goes with the gate time (unverified)."""

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> CounterErrors:
        """Return a specimen."""
        return cls(8e-5 * _share(rng), 8e-4 * _share(rng), 0.3)


class OhmsErrors(Struct, frozen=True):
    """Imperfections of resistance, continuity and diode test."""

    reading_share: float = 0.0
    """Share of the published error of reading (p. 216: 0.01 % up to 1 Mohm, 0.04 % at 10 Mohm, 0.8 % at 100 Mohm)."""
    range_share: float = 0.0
    """Share of the published error of range (p. 216: 0.004 % at 100 ohm, 0.001 % above, 0.01 % at 100 Mohm)."""
    lead_ohm: float = 0.0
    """What leads and input add in two-wire measurements (p. 216: up to 0.2 ohm without null)."""

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> OhmsErrors:
        """Return a drawn unit; the leads' part is uniform up to its limit."""
        return cls(_share(rng), _share(rng), float(rng.uniform(0.0, 0.2)))


class CurrentErrors(Struct, frozen=True):
    """Imperfections of the current functions; their input is not wired, so no error of reading shows."""

    dc_range_share: float = 0.0
    """Share of the published error of range (p. 216: 0.02 %, 0.005 %, 0.01 % and 0.02 % of 10 mA, 100 mA, 1 A, 3 A)."""
    ac_range_share: float = 0.0
    """Share of the published error of range (p. 218: 0.04 % of 1 A, 0.06 % of 3 A)."""

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> CurrentErrors:
        """Return a specimen."""
        return cls(_share(rng), _share(rng))


class MeterErrors(Struct, frozen=True):
    """Imperfections of a specimen, those of dc voltage first; each can be set by itself."""

    gain_error: float = 0.0
    """Relative error of the reading on the 10 V range, V/V (p. 216: 1 year 0.0035 %); on the others as its limit."""
    offset_v: float = 0.0
    """Offset on the 10 V range, V (p. 216: 0.0005 % of range); on the others as its limit, 0.0035 % of 0.1 V."""
    unzeroed_offset_v: float = 0.0
    """Further offset on the 10 V range while autozero is off, V (p. 216: 0.0002 % of range + 5 uV)."""
    noise: float = 0.0
    """White noise, rms, as a multiple of the resolution that goes with the integration time."""
    short_noise: float = 0.0
    """Further noise of 1, 0.2 and 0.02 power line cycles, rms, as a part of the published one (p. 217)."""
    input_ohm: float = math.inf
    """Input resistance: 10 Mohm +-1 %, above 10 Gohm on the lower ranges with automatic impedance (p. 53)."""
    quantised: bool = False
    """Whether readings come in steps of a tenth of the resolution (unverified; the format has more digits)."""
    noise_seed: int = 0
    """Seed of the noise."""
    ac: AcErrors = field(default_factory=AcErrors)
    counter: CounterErrors = field(default_factory=CounterErrors)
    ohms: OhmsErrors = field(default_factory=OhmsErrors)
    current: CurrentErrors = field(default_factory=CurrentErrors)

    @classmethod
    def none(cls) -> MeterErrors:
        """Return an ideal specimen."""
        return cls()

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> MeterErrors:
        """Return a specimen drawn from the 1-year accuracy of the 10 V range as four standard deviations (p. 227).

        What was added later is drawn later, so that a seed keeps its meaning.
        """
        return cls(
            gain_error=float(rng.normal(0.0, 35e-6 / 4)),
            offset_v=float(rng.normal(0.0, 50e-6 / 4)),
            unzeroed_offset_v=float(rng.normal(0.0, 25e-6 / 4)),
            noise=0.3,
            short_noise=0.25,
            input_ohm=float(10e6 * (1 + rng.uniform(-0.01, 0.01))),
            quantised=True,
            noise_seed=int(rng.integers(1 << 31)),
            ac=AcErrors.drawn(rng),
            counter=CounterErrors.drawn(rng),
            ohms=OhmsErrors.drawn(rng),
            current=CurrentErrors.drawn(rng),
        )
