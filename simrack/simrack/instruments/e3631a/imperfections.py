"""Errors of a specimen of the E3631A, and the published accuracy that they are drawn from.

Source: Keysight E3631A User's Guide E3631-90002, ed. 10, 2018 (p. 186).
"""

from __future__ import annotations

import math
import random
from collections.abc import Mapping  # msgspec reads the annotation
from types import MappingProxyType
from typing import TYPE_CHECKING, ClassVar

from msgspec import Struct, field
from msgspec.structs import replace

from simrack.instruments.e3631a.kinds import N25V, P6V, P25V, OutputKind
from simrack.sources import Ripple, Sine

if TYPE_CHECKING:
    import numpy as np

_SQRT2 = math.sqrt(2.0)
_NOISE_LIMIT_V = 0.35e-3
"""Ripple and noise from 20 Hz to 20 MHz, rms (p. 186)."""
_HARMONICS = (2, 3, 4)
_NOISE_HZ, _NOISE_LINES = (30.0, 2000.0), 8
"""The noise is so many lines of equal size between these frequencies; a real one's goes on above them."""


class OutputErrors(Struct, frozen=True):
    """Imperfections of one output of a specimen; gains are relative errors."""

    programming_gain: float = 0.0
    """Voltage programming, V/V (p. 186)."""
    programming_offset_v: float = 0.0
    """Voltage programming, V (p. 186)."""
    current_programming_gain: float = 0.0
    """Current limit, A/A (p. 186)."""
    current_programming_offset_a: float = 0.0
    """Current limit, A (p. 186)."""
    readback_gain: float = 0.0
    """Voltage read-back, V/V (p. 186)."""
    readback_offset_v: float = 0.0
    """Voltage read-back, V (p. 186)."""
    current_readback_gain: float = 0.0
    """Current read-back, A/A (p. 186)."""
    current_readback_offset_a: float = 0.0
    """Current read-back, A (p. 186)."""
    resistance_ohm: float = 0.0
    """Output resistance: the fixed 2 mV of the load regulation per rated current, ohm (p. 186)."""
    sag: float = 0.0
    """Relative fall of the voltage at rated current, V/V: the 0.01 % of the load regulation (p. 186)."""
    line_gain: float = 0.0
    """Relative change of the voltage by the mains being off nominal, V/V (line regulation 0.01 %, p. 186).

    The mains stay as they are, so it is constant.
    """
    ripple_v: float = 0.0
    """Ripple on the output while it is on, Vrms (below 0.35 mV, p. 186)."""
    ripple_hz: float = 100.0
    """Frequency of the ripple, Hz: twice the mains (the guide names a band, 20 Hz to 20 MHz; unverified)."""
    ripple_phase_rad: float = 0.0
    """Phase of the ripple at bench time 0, rad."""
    ripple_harmonics_v: float = 0.0
    """Second to fourth harmonic of the ripple, each in inverse proportion to its order, Vrms together (unverified)."""
    reverse_v: float = 0.0
    """Voltage of opposite polarity while it is off, without load, V: below 0.6 V (p. 96; a user measured 0.481 V).

    It is seen by its own voltmeter alone: what it does to the PCB is not simulated.
    """
    noise_v: float = 0.0
    """Noise on the output while it is on, Vrms; ripple and noise together are below 0.35 mV and 2 mVpp (p. 186)."""

    def ripple(self) -> Ripple:
        """Return the ripple and noise on the output; the phases of a simulated unit follow from those of its ripple."""
        phases = random.Random(self.ripple_phase_rad)  # noqa: S311  (noise, not secrets)
        loudness = math.hypot(*(1.0 / order for order in _HARMONICS))
        harmonics = [
            (_SQRT2 * self.ripple_harmonics_v / order / loudness, order * self.ripple_hz) for order in _HARMONICS
        ]
        step = math.log(_NOISE_HZ[1] / _NOISE_HZ[0]) / _NOISE_LINES
        noise = [
            (_SQRT2 * self.noise_v / math.sqrt(_NOISE_LINES), _NOISE_HZ[0] * math.exp(step * (line + phases.random())))
            for line in range(_NOISE_LINES)
        ]
        beside = tuple(
            Sine(size, hertz, phases.uniform(-math.pi, math.pi)) for size, hertz in (*harmonics, *noise) if size
        )
        return Ripple(self.ripple_v, self.ripple_hz, self.ripple_phase_rad, beside)


class OutputAccuracy(Struct, frozen=True):
    """Published 12-month accuracy at 25 +- 5 C (p. 186): relative part and fixed part."""

    programming: tuple[float, float]
    current: tuple[float, float]
    readback: tuple[float, float]


_ACCURACY: Mapping[str, OutputAccuracy] = MappingProxyType(
    {
        "P6V": OutputAccuracy((1e-3, 5e-3), (2e-3, 10e-3), (1e-3, 5e-3)),
        "P25V": OutputAccuracy((0.5e-3, 20e-3), (1.5e-3, 4e-3), (0.5e-3, 10e-3)),
        "N25V": OutputAccuracy((0.5e-3, 20e-3), (1.5e-3, 4e-3), (0.5e-3, 10e-3)),
    }
)


class SupplyErrors(Struct, frozen=True):
    """Imperfections of a specimen; each can be set by itself."""

    accuracy: ClassVar[Mapping[str, OutputAccuracy]] = _ACCURACY
    p6v: OutputErrors = field(default_factory=OutputErrors)
    """The +6 V output."""
    p25v: OutputErrors = field(default_factory=OutputErrors)
    """The +25 V output."""
    n25v: OutputErrors = field(default_factory=OutputErrors)
    """The -25 V output."""
    tracking_gain: float = 0.0
    """Relative error of the -25 V output added while it tracks, V/V (0.2 %, p. 186)."""
    tracking_offset_v: float = 0.0
    """Error of the -25 V output added while it tracks, V (20 mV, p. 186)."""
    quantised: bool = False
    """Whether outputs and readings come in the steps of the converters (p. 186)."""

    @classmethod
    def none(cls) -> SupplyErrors:
        """Return an ideal specimen."""
        return cls()

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> SupplyErrors:
        """Return a specimen drawn from the published accuracy taken as four standard deviations.

        That is how the maker sets the limits of the 34401A (its User's Guide p. 227); for the supply it is inferred.
        """
        drawn = cls(
            p6v=_drawn_output(rng, P6V, cls.accuracy["P6V"]),
            p25v=_drawn_output(rng, P25V, cls.accuracy["P25V"]),
            n25v=_drawn_output(rng, N25V, cls.accuracy["N25V"]),
            tracking_gain=_draw(rng, 2e-3),
            tracking_offset_v=_draw(rng, 20e-3),
            quantised=True,
        )
        p6v, p25v, n25v = (_disturbed(rng, each) for each in (drawn.p6v, drawn.p25v, drawn.n25v))
        return replace(drawn, p6v=p6v, p25v=p25v, n25v=n25v)

    def of(self, name: str) -> OutputErrors:
        """Return the errors of output `name`."""
        return {"P6V": self.p6v, "P25V": self.p25v, "N25V": self.n25v}[name]


def _draw(rng: np.random.Generator, limit: float) -> float:
    return float(rng.normal(0.0, limit / 4.0))


def _drawn_output(rng: np.random.Generator, kind: OutputKind, accuracy: OutputAccuracy) -> OutputErrors:
    limits = (*accuracy.programming, *accuracy.current, *accuracy.readback, *accuracy.current)
    names = OutputErrors.__struct_fields__[: len(limits)]
    drawn = {name: _draw(rng, limit) for name, limit in zip(names, limits, strict=True)}
    return OutputErrors(**drawn, resistance_ohm=2e-3 / kind.rated_a, sag=1e-4)


def _disturbed(rng: np.random.Generator, errors: OutputErrors) -> OutputErrors:
    """Return the errors with the mains' part of the output: ripple below its limit at any phase, line.

    Harmonics and noise are parts of the ripple, and of what it leaves of the limit of all together.
    """
    line_gain, ripple_v = _draw(rng, 1e-4), float(rng.uniform(0.1e-3, _NOISE_LIMIT_V))
    left_v = math.sqrt(_NOISE_LIMIT_V**2 - ripple_v**2)
    return replace(
        errors,
        line_gain=line_gain,
        ripple_v=ripple_v,
        ripple_phase_rad=float(rng.uniform(-math.pi, math.pi)),
        ripple_harmonics_v=min(0.4 * ripple_v, 0.6 * left_v),
        noise_v=min(0.2 * ripple_v, 0.4 * left_v),
        reverse_v=0.3 + 0.3 * (ripple_v / _NOISE_LIMIT_V),  # a part of the limit, as the ripple is of its own
    )
