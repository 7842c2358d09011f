"""Frequency and quality factor of a mode from its free decay.

The model is ``offset + amplitude * exp(-t / tau) * cos(2 pi f t + phase)``; the natural frequency and Q follow from
omega_0^2 = (2 pi f)^2 + 1/tau^2 and Q = omega_0 tau / 2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from vcfbench.analysis.model_fit import ModelFit, fit_model, propagated
from vcfbench.analysis.sine_fit import spectral_peak_hz
from vcfbench.errors import ConfigError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = ["RingDown", "fit_ring_down"]

Floats: TypeAlias = "NDArray[np.float64]"

_PIECES = 8


@dataclass(frozen=True, slots=True)
class RingDown:
    """A free decay; amplitude and offset in the unit of the samples."""

    frequency_hz: float
    """Natural frequency, without the damping's pull."""
    u_frequency_hz: float
    q: float
    u_q: float
    decay_s: float
    """Time constant of the amplitude."""
    u_decay_s: float
    amplitude: float
    """At the first sample."""
    offset: float
    residual_rms: float
    dof: int


def fit_ring_down(samples: ArrayLike, interval_s: float) -> RingDown:
    """Fit a free decay to equally spaced `samples`, which begin after the force has stopped.

    The uncertainties are those of independent noise as large as the residuals.

    Raises:
        ConfigError: fewer than 32 finite samples, or nothing that decays.

    """
    values = np.asarray(samples, dtype=np.float64)
    if values.ndim != 1 or values.size < 4 * _PIECES:
        raise ConfigError(f"a ring-down needs at least {4 * _PIECES} samples, got {values.size}")
    if not np.isfinite(values).all():
        raise ConfigError("a sample is not a finite number: the channel was overloaded, or not sampled")
    times = np.asarray(interval_s * np.arange(values.size), dtype=np.float64)
    frequency, rate = _start(values, times, interval_s)
    fit = fit_model(lambda p: _residuals(p, values, times), np.array([frequency, rate]), "ring-down")
    rms = math.sqrt(fit.chi_square / (values.size - 5))
    fit = ModelFit(fit.parameters, fit.covariance * rms**2, fit.chi_square, values.size - 5)
    if fit.parameters[1] <= 0.0:
        raise ConfigError("ring-down: the oscillation does not decay")
    a, b, offset = _linear(fit.parameters, values, times)[0]
    return RingDown(
        frequency_hz=_natural_hz(fit.parameters),
        u_frequency_hz=propagated(_natural_hz, fit),
        q=_q(fit.parameters),
        u_q=propagated(_q, fit),
        decay_s=float(1.0 / fit.parameters[1]),
        u_decay_s=propagated(lambda p: float(1.0 / p[1]), fit),
        amplitude=math.hypot(a, b),
        offset=offset,
        residual_rms=rms,
        dof=fit.dof,
    )


def _natural_hz(parameters: Floats) -> float:
    frequency, rate = parameters
    return math.hypot(float(frequency), float(rate) / (2.0 * math.pi))


def _q(parameters: Floats) -> float:
    return math.pi * _natural_hz(parameters) / float(parameters[1])


def _linear(parameters: Floats, values: Floats, times: Floats) -> tuple[list[float], Floats]:
    """Return cosine, sine and offset that fit best for a frequency and a decay rate, and the residuals."""
    frequency, rate = parameters
    angle, envelope = 2.0 * math.pi * frequency * times, np.exp(-rate * times)
    basis = np.column_stack([envelope * np.cos(angle), envelope * np.sin(angle), np.ones_like(times)])
    found, *_ = np.linalg.lstsq(basis, values, rcond=None)
    return found.tolist(), values - basis @ found


def _residuals(parameters: Floats, values: Floats, times: Floats) -> Floats:
    return _linear(parameters, values, times)[1]


def _start(values: Floats, times: Floats, interval_s: float) -> tuple[float, float]:
    """Return a first frequency from the spectrum and a first decay rate from the beat-down envelope of the pieces."""
    frequency = spectral_peak_hz(values, interval_s)
    turned = (values - values.mean()) * np.exp(-2j * math.pi * frequency * times)
    size = values.size // _PIECES
    envelope = np.abs(turned[: size * _PIECES].reshape(_PIECES, size).mean(axis=1))
    used = envelope > 0.05 * envelope.max()
    if used.sum() < 2:
        return frequency, 2.0 / (size * interval_s)
    middle = (np.flatnonzero(used) + 0.5) * size * interval_s
    slope = np.polyfit(middle, np.log(envelope[used]), 1, w=envelope[used])[0]
    return frequency, max(-float(slope), 0.1 / float(times[-1]))
