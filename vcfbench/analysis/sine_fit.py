"""Sines in sampled waveforms: the four-parameter fit of IEEE 1057, and phases between channels.

The model is ``offset + amplitude * cos(2 pi f t + phase)`` with t = 0 at the first sample.
"""

import math

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike

from vcfbench.analysis.arrays import Floats
from vcfbench.errors import ConfigError, MeasurementError

_ROUNDS = 200  # weights follow residuals: where channels tell two frequencies, a round leaves 3 quarters of the step
_SETTLED = 1e-9
"""A step of the frequency by less than that of a cycle over the record is none."""


class Sine(Struct, frozen=True):
    """A fitted sine; its amplitude in the unit of the samples."""

    frequency_hz: float
    amplitude: float
    phase_rad: float
    """At the first sample, of a cosine, in -pi to pi."""


class PhaseDifference(Struct, frozen=True):
    """The second of two sines of one frequency against the first."""

    phase_deg: float
    """Phase of the second less that of the first, -180 to 180: positive where the second leads."""
    gain: float
    """Amplitude of the second over that of the first."""


def fit_sine(samples: ArrayLike, interval_s: float, start_hz: float | None = None) -> Sine:
    """Fit frequency, amplitude, phase and offset (IEEE 1057, four parameters).

    Args:
        samples: equally spaced, at least five.
        interval_s: their spacing, s.
        start_hz: where to look; without it at the largest line of the spectrum.

    Raises:
        ConfigError: too few or not finite samples.
        MeasurementError: no sine that the fit settles on.
    """
    channels = _checked([samples])
    frequency_hz, ((a,), (b,)) = _common(channels, interval_s, start_hz)
    # The phase is carried from the middle of the record to the first sample
    lead_s = (channels.shape[1] - 1) / 2.0 * interval_s
    phase_rad = math.atan2(-b, a) - 2.0 * math.pi * frequency_hz * lead_s
    return Sine(frequency_hz, math.hypot(a, b), math.remainder(phase_rad, 2.0 * math.pi))


def u_of_frequency(samples: ArrayLike, interval_s: float, fitted: Sine) -> float:
    """Return the standard uncertainty of a fitted frequency by white residuals, Hz.

    It is the bound that a fit of all four parameters reaches (Rife and Boorstyn 1974, *Single tone parameter estimation
    from discrete-time observations*).
    """
    (taken,) = _checked([samples])
    times = np.asarray((np.arange(taken.size) - (taken.size - 1) / 2.0) * interval_s)
    basis, found = _at(taken[None, :], times, fitted.frequency_hz)
    left = float(np.sqrt(np.mean((taken - (basis @ found)[:, 0]) ** 2)))
    return float(math.sqrt(6.0 / taken.size) / (math.pi * taken.size * interval_s) * left / fitted.amplitude)


def phase_difference(
    first: ArrayLike, second: ArrayLike, interval_s: float, start_hz: float | None = None
) -> PhaseDifference:
    """Return phase and gain of `second` against `first`, sampled at the same instants, fitted with one frequency.

    Raises:
        ConfigError: channels of different lengths, or as for :func:`fit_sine`.
    """
    _, (cosine, sine) = _common(_checked([first, second]), interval_s, start_hz)
    amplitude = np.hypot(cosine, sine)
    phase = np.arctan2(-sine, cosine)
    turned = math.remainder(float(phase[1] - phase[0]), 2.0 * math.pi)
    return PhaseDifference(math.degrees(turned), float(amplitude[1] / amplitude[0]))


def _spectral_peak_hz(samples: Floats, interval_s: float) -> float:
    """Return the frequency of the largest line, between the bins by a parabola through a Hann window's logarithms."""
    windowed = (samples - samples.mean()) * np.hanning(samples.size)
    level = np.abs(np.fft.rfft(windowed))
    place = int(level[1:].argmax()) + 1
    shift = 0.0
    if 1 <= place < level.size - 1 and level[place - 1 : place + 2].min() > 0.0:
        before, at, after = np.log(level[place - 1 : place + 2])
        shift = 0.5 * (before - after) / (before - 2.0 * at + after)
    return float((place + shift) / (samples.size * interval_s))


def _checked(channels: list[ArrayLike]) -> Floats:
    values = [np.asarray(channel, dtype=np.float64) for channel in channels]
    if any(channel.ndim != 1 or channel.shape != values[0].shape for channel in values):
        raise ConfigError(f"channels must be as long as each other, got {[channel.shape for channel in values]}")
    if values[0].size < 5:
        raise ConfigError(f"a sine fit needs at least five samples, got {values[0].size}")
    if not all(np.isfinite(channel).all() for channel in values):
        raise ConfigError("a sample is not a finite number: the channel was overloaded, or not sampled")
    if any(np.ptp(channel) == 0.0 for channel in values):
        raise _no_sine("the samples of a channel never change")
    return np.array(values)


def _no_sine(why: str) -> MeasurementError:
    return MeasurementError(
        f"no sine found: {why}",
        hint="look at the leads of the output, of V_Vc and of the oscilloscope, at the carrier, the demodulator and "
        "the PCB's supply",
    )


def _common(channels: Floats, interval_s: float, start_hz: float | None) -> tuple[float, Floats]:
    """Return the frequency that fits all channels best, and the cosine and the sine in each of them, (2, channels).

    By Gauss and Newton from `start_hz` or the spectrum. Angles are counted from the middle of the record, where they
    are surest.
    """
    number, count = channels.shape
    times = np.asarray((np.arange(count) - (count - 1) / 2.0) * interval_s)
    strongest = channels[np.ptp(channels, axis=1).argmax()]
    frequency = _spectral_peak_hz(strongest, interval_s) if start_hz is None else start_hz
    most = 0.5 / (count * interval_s)
    for _ in range(_ROUNDS):
        basis, found = _at(channels, times, frequency)
        left = channels.T - basis @ found
        rms = np.sqrt(np.sum(left**2, axis=0) / (times.size - 3.0))
        # A channel without residuals must not weigh infinitely
        largest = float(rms.max())
        rms = np.maximum(rms, 1e-12 * largest) if largest > 0.0 else np.ones_like(rms)
        weight = np.repeat(1.0 / rms, times.size)
        # The derivatives of all samples by the frequency and by each channel's three parameters
        rows = np.zeros((number, times.size, 1 + 3 * number))
        for channel, (cosine, sine, _) in enumerate(found.T):
            rows[channel, :, 0] = 2.0 * math.pi * times * (-cosine * basis[:, 1] + sine * basis[:, 0])
            rows[channel, :, 1 + 3 * channel : 4 + 3 * channel] = basis
        weighted = rows.reshape(number * times.size, -1) * weight[:, None]
        step = float(np.linalg.solve(weighted.T @ weighted, weighted.T @ (left.T.ravel() * weight))[0])
        frequency += max(-most, min(most, step))
        if abs(step) * count * interval_s < _SETTLED:
            return frequency, np.asarray(_at(channels, times, frequency)[1][:2])
    raise _no_sine(f"the fit does not settle near {frequency:g} Hz")


def _at(channels: Floats, times: Floats, frequency_hz: float) -> tuple[Floats, Floats]:
    """Return cosine, sine and 1 at all times, and their amounts that fit every channel."""
    angle = 2.0 * math.pi * frequency_hz * times
    basis = np.column_stack([np.cos(angle), np.sin(angle), np.ones_like(times)])
    found, _, rank, _ = np.linalg.lstsq(basis, channels.T, rcond=1e-9)
    if rank < 3 or not 0.0 < frequency_hz < math.inf:
        raise ConfigError(f"samples over {times[-1] - times[0]:g} s are too short for a sine of {frequency_hz:g} Hz")
    return basis, np.asarray(found)
