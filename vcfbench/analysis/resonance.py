"""Resonance and rate response from gains at a number of frequencies.

Two closed forms: a mode driven at f, ``|H| = h f0^2 / sqrt((f0^2 - f^2)^2 + (f f0 / Q)^2)``, h at low frequencies; and
the response of an open-loop gyroscope with split modes to a rate (or a V_Vc) of frequency f, where both side bands
f_drive +- f pass through the sense modes and are demodulated. With a single mode that is close to
df^2 / (df^2 - f^2): +3 dB at 0.54 df, a peak near df, -3 dB at 1.55 df.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from vcfbench.analysis.model_fit import fit_model, propagated
from vcfbench.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from vcfbench.analysis.model_fit import ModelFit

__all__ = ["BandPoint", "RateResponse", "Resonance", "SenseMode", "fit_rate_response", "fit_resonance", "rate_response"]

Floats: TypeAlias = "NDArray[np.float64]"


@dataclass(frozen=True, slots=True)
class Resonance:
    """A driven mode."""

    frequency_hz: float
    u_frequency_hz: float
    q: float
    u_q: float
    peak: float
    """Gain at the natural frequency, in the unit of the gains."""
    u_peak: float
    chi_square: float
    dof: int


@dataclass(frozen=True, slots=True)
class SenseMode:
    """A sense mode that is known, beside the one that is fitted."""

    frequency_hz: float
    q: float
    gain: float
    """Of its force and its pick-off together, over that of the fitted mode; negative where it acts the other way."""


@dataclass(frozen=True, slots=True)
class BandPoint:
    """One point of the rate response, Hz."""

    frequency_hz: float
    u_frequency_hz: float


@dataclass(frozen=True, slots=True)
class RateResponse:
    """A fitted rate response."""

    split_hz: float
    """Drive less sense frequency, positive."""
    u_split_hz: float
    q: float
    """Of the sense mode."""
    u_q: float
    static_gain: float
    """Gain at frequency 0, in the unit of the gains."""
    u_static_gain: float
    plus_3_db: BandPoint
    """Where the gain has risen by 3 dB: the 'bandwidth' of mode-split gyroscopes."""
    peak: BandPoint
    peak_gain: float
    """Over the static gain."""
    minus_3_db: BandPoint
    """Where it has fallen 3 dB below the static gain."""
    chi_square: float
    dof: int


def fit_resonance(frequency_hz: ArrayLike, gain: ArrayLike, u_gain: ArrayLike) -> Resonance:
    """Fit f0, Q and height of a driven mode to gains and their standard uncertainties.

    Raises:
        ConfigError: fewer than four points, a gain or uncertainty that is not positive, or no resonance among them.

    """
    f, gains, u = _checked(frequency_hz, gain, u_gain, 4)
    place = int(gains.argmax())
    above = f[gains > gains[place] / math.sqrt(2.0)]
    width = max(float(np.ptp(above)), float(np.diff(f).min()))
    start = np.array([f[place], f[place] / width, gains[place]])
    fit = fit_model(lambda p: (_driven(p, f) - gains) / u, start, "resonance")
    u_parameters = np.sqrt(np.diag(fit.covariance)).tolist()
    frequency, q, peak = np.abs(fit.parameters).tolist()
    return Resonance(frequency, u_parameters[0], q, u_parameters[1], peak, u_parameters[2], fit.chi_square, fit.dof)


def _driven(parameters: Floats, f: Floats) -> Floats:
    frequency, q, peak = parameters
    return np.asarray(abs(peak / q) / np.hypot(1.0 - (f / frequency) ** 2, f / (frequency * q)))


def rate_response(
    frequency_hz: ArrayLike, drive_hz: float, split_hz: float, q: float, others: tuple[SenseMode, ...] = ()
) -> Floats:
    """Return |H(f)| / |H(0)| of an open-loop gyroscope whose sense mode lies `split_hz` below the drive.

    Both side bands of the carrier: with g(nu) = 1 / (omega_y^2 - nu^2 + j nu omega_y / Q), summed over the modes,
    H is g(omega + omega_d) + conj(g(omega_d - omega)), demodulated in phase with the force.
    """
    f = np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))
    modes = (SenseMode(drive_hz - split_hz, q, 1.0), *others)

    def response(at: Floats) -> NDArray[np.complex128]:
        total = np.zeros(at.shape, dtype=np.complex128)
        for mode in modes:
            for side in (drive_hz + at, at - drive_hz):
                total += mode.gain / (mode.frequency_hz**2 - side**2 + 1j * side * mode.frequency_hz / mode.q)
        return total

    return np.asarray(np.abs(response(f)) / np.abs(response(np.zeros(1))))


def fit_rate_response(
    frequency_hz: ArrayLike,
    gain: ArrayLike,
    u_gain: ArrayLike,
    drive_hz: float,
    others: tuple[SenseMode, ...] = (),
) -> RateResponse:
    """Fit split, Q and static gain to gains at modulation frequencies, and find the points of the band.

    Args:
        frequency_hz: modulation frequencies, from well below the peak to above it, Hz.
        gain: output over input, positive; a known output filter already divided out.
        u_gain: standard uncertainty of each gain (or one for all).
        drive_hz: frequency of the carrier, Hz.
        others: further sense modes, known.

    Raises:
        ConfigError: fewer than four points, a gain or uncertainty that is not positive, or no peak among them.

    """
    f, gains, u = _checked(frequency_hz, gain, u_gain, 4)
    place = int(gains.argmax())
    low = gains[int(f.argmin())]
    q = max(1.0, float(gains[place] / low)) * drive_hz / f[place]
    start = np.array([f[place], q, low])
    fit = fit_model(lambda p: (p[2] * rate_response(f, drive_hz, p[0], p[1], others) - gains) / u, start, "bandwidth")
    split, sense_q, static = fit.parameters.tolist()
    u_split, u_q, u_static = np.sqrt(np.diag(fit.covariance)).tolist()

    def curve(parameters: Floats) -> _Curve:
        return _Curve(drive_hz, float(parameters[0]), float(parameters[1]), others)

    return RateResponse(
        split_hz=split,
        u_split_hz=u_split,
        q=sense_q,
        u_q=u_q,
        static_gain=static,
        u_static_gain=u_static,
        plus_3_db=_point(lambda p: curve(p).plus_3_db(), fit),
        peak=_point(lambda p: curve(p).peak(), fit),
        peak_gain=curve(fit.parameters).gain(curve(fit.parameters).peak()),
        minus_3_db=_point(lambda p: curve(p).minus_3_db(), fit),
        chi_square=fit.chi_square,
        dof=fit.dof,
    )


@dataclass(frozen=True, slots=True)
class _Curve:
    """The relative gain of one gyroscope, and its points."""

    drive_hz: float
    split_hz: float
    q: float
    others: tuple[SenseMode, ...]

    def gain(self, at_hz: float) -> float:
        return float(rate_response(at_hz, self.drive_hz, self.split_hz, self.q, self.others)[0])

    def peak(self) -> float:
        from scipy.optimize import minimize_scalar  # noqa: PLC0415 - SciPy costs more to import than all the rest

        bounds = (0.5 * self.split_hz, 1.5 * self.split_hz)
        found = minimize_scalar(lambda at: -self.gain(at), bounds=bounds, method="bounded", options={"xatol": 1e-9})
        return float(found.x)

    def plus_3_db(self) -> float:
        return self._crossing(math.sqrt(2.0), 0.0, self.split_hz)

    def minus_3_db(self) -> float:
        """The first one: another mode may raise the gain again."""
        low = self.split_hz
        steps = low + 0.05 * self.split_hz * np.arange(1, 100)
        below = rate_response(steps, self.drive_hz, self.split_hz, self.q, self.others) < math.sqrt(0.5)
        return self._crossing(math.sqrt(0.5), low, float(steps[below.argmax()]))

    def _crossing(self, level: float, low_hz: float, high_hz: float) -> float:
        from scipy.optimize import brentq  # noqa: PLC0415 - as above

        ends = (self.gain(low_hz) - level) * (self.gain(high_hz) - level)
        if not ends < 0.0:
            raise ConfigError(f"bandwidth: the fitted response never passes {level:.3f} of its static gain")
        return float(brentq(lambda at: self.gain(at) - level, low_hz, high_hz, xtol=1e-10))


def _point(value: Callable[[Floats], float], fit: ModelFit) -> BandPoint:
    return BandPoint(value(fit.parameters), propagated(value, fit))


def _checked(frequency_hz: ArrayLike, gain: ArrayLike, u_gain: ArrayLike, least: int) -> tuple[Floats, Floats, Floats]:
    f, gains = np.asarray(frequency_hz, dtype=np.float64), np.asarray(gain, dtype=np.float64)
    u = np.broadcast_to(np.asarray(u_gain, dtype=np.float64), gains.shape)
    if f.ndim != 1 or f.shape != gains.shape or f.size < least:
        raise ConfigError(f"at least {least} frequencies with a gain each are needed, got {f.size} and {gains.size}")
    if not (np.isfinite(f).all() and (gains > 0.0).all() and np.isfinite(gains).all() and (u > 0.0).all()):
        raise ConfigError("frequencies must be finite, gains and their uncertainties positive")
    order = np.argsort(f)
    return f[order], gains[order], u[order]
