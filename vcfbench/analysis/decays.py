"""Free decays at carrier level: of modes beside a carrier that goes on, and of the carrier itself once it is let go.

Samples are mixed down with the carrier's frequency and averaged in windows of a Hann's shape, one after the other, so
that their noise stays independent. Then a decay is a complex exponential, and what goes on is a constant.
"""

import math
from typing import TypeAlias

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike, NDArray

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.model_fit import fit_model
from vcfbench.errors import ConfigError

Complexes: TypeAlias = "NDArray[np.complex128]"

_WINDOW_S = 2e-3
"""Length of a window: modes within 200 Hz of the carrier."""
_RELEASE_WINDOW_S = 1e-3
_LEAST_WINDOWS = 30
_SEEN = 8.0
"""A spectral line by so much above the median is another mode; a rate by so many of its uncertainties is one."""
_NEAR_HZ = 3.0
"""Within this of the carrier, or of a mode that is known, a line is not another mode's."""
_LEAST_RELEASED = 8


class RingingMode(Struct, frozen=True):
    """A mode that rings down: natural frequency, quality factor, amplitude as the record begins."""

    frequency_hz: float
    q: float
    amplitude_v: float


def fit_decays(samples: ArrayLike, interval_s: float, carrier_hz: float) -> tuple[RingingMode, ...]:
    """Fit one or two modes that decay beside a carrier of known frequency, the strongest first.

    Raises:
        ConfigError: too short a record, or nothing that decays.
    """
    times, mixed = _mixed(samples, interval_s, carrier_hz, _WINDOW_S)
    if times.size < _LEAST_WINDOWS:
        raise ConfigError(f"decays beside a carrier need {_LEAST_WINDOWS * _WINDOW_S:g} s, got {times[-1]:g} s")
    first = _line(mixed - mixed[-times.size // 4 :].mean(), times, [0.0])
    if first is None:
        raise ConfigError(f"nothing decays beside {carrier_hz:.1f} Hz")
    parameters, sizes, left = _fitted(np.array([first, 4.0 / times[-1]]), mixed, times)
    second = _line(left, times, [0.0, float(parameters[0])])
    if second is not None:
        parameters, sizes, _ = _fitted(np.array([*parameters, second, parameters[1]]), mixed, times)
    off = parameters.reshape(-1, 2)[:, 0] * _WINDOW_S  # the share of a line that passes the means of Hann's windows
    amplitudes = np.abs(sizes[1:]) / (np.sinc(off) / (1.0 - off**2))
    modes = [
        _decay(carrier_hz + float(offset_hz), float(rate), float(size))
        for (offset_hz, rate), size in zip(parameters.reshape(-1, 2), amplitudes, strict=True)
    ]
    return tuple(sorted(modes, key=lambda mode: -mode.amplitude_v))


def _decay(frequency_hz: float, rate: float, amplitude: float) -> RingingMode:
    if rate <= 0.0:
        raise ConfigError(f"the oscillation at {frequency_hz:.1f} Hz does not decay")
    natural_hz = math.hypot(frequency_hz, rate / (2.0 * math.pi))
    return RingingMode(natural_hz, math.pi * natural_hz / rate, amplitude)


def _mixed(samples: ArrayLike, interval_s: float, carrier_hz: float, window_s: float) -> tuple[Floats, Complexes]:
    """Return the middles of the windows, s, and the phasors of the carrier's frequency in them."""
    values = np.asarray(samples, dtype=np.float64)
    size = round(window_s / interval_s)
    if size < 8 or 2.5 * carrier_hz * interval_s > 1.0:
        raise ConfigError(f"samples every {interval_s:g} s are too far apart for {carrier_hz:g} Hz")
    count = values.size // size
    times = interval_s * np.arange(count * size)
    shape = np.hanning(size + 2)[1:-1]
    turned = values[: times.size] * np.exp(-2j * math.pi * carrier_hz * times)
    phasors = 2.0 * turned.reshape(count, size) @ (shape / shape.sum())
    middles = interval_s * (size * np.arange(count) + (size - 1) / 2.0)
    return np.asarray(middles), np.asarray(phasors)


def _line(signal: Complexes, times: Floats, known_hz: list[float]) -> float | None:
    """Return the offset of the strongest spectral line that is no known one's, Hz; None where none stands out."""
    count = 8 * signal.size
    level = np.abs(np.fft.fft(signal * np.hanning(2 * signal.size)[signal.size :], count))
    offset_hz = np.fft.fftfreq(count, float(times[1] - times[0]))
    free = np.all([np.abs(offset_hz - each) > _NEAR_HZ for each in known_hz], axis=0)
    place = int(np.where(free, level, 0.0).argmax())
    return float(offset_hz[place]) if level[place] > _SEEN * float(np.median(level)) else None


def _fitted(start: Floats, mixed: Complexes, times: Floats) -> tuple[Floats, Complexes, Complexes]:
    """Fit offset (Hz) and rate (1/s) of each mode; return them, the constant and the amplitudes, and what is left."""

    def shared(parameters: Floats) -> tuple[Complexes, Complexes]:
        pairs = parameters.reshape(-1, 2)
        exponents = -pairs[:, 1] + 2j * math.pi * pairs[:, 0]
        basis = np.column_stack([np.ones_like(times), np.exp(np.outer(times, exponents))])
        sizes, *_ = np.linalg.lstsq(basis, mixed, rcond=None)
        return np.asarray(sizes), np.asarray(mixed - basis @ sizes)

    def residuals(parameters: Floats) -> Floats:
        _, left = shared(parameters)
        return np.concatenate([left.real, left.imag])

    found = fit_model(residuals, start, "decays beside a carrier").parameters
    return found, *shared(found)


def fit_release(samples: ArrayLike, interval_s: float, carrier_hz: float) -> RingingMode:
    """Fit the decay of an oscillation that is held at first, is then let go, and is no longer seen at last.

    When it is let go shows in its amplitude; the record ends for the fit where the amplitude drops at once.

    Raises:
        ConfigError: it never drops, or decays for less than 8 ms.
    """
    times, mixed = _mixed(samples, interval_s, carrier_hz, _RELEASE_WINDOW_S)
    level = np.abs(mixed)
    if not level[:3].min(initial=math.inf) > 0.0:
        raise ConfigError(f"the oscillation at {carrier_hz:.1f} Hz is not seen to decay freely: the record has none")
    gone = np.flatnonzero(level < 0.5 * level[:3].max())
    # The window before may hold a part of the drop.
    end = int(gone[0]) - 1 if gone.size else level.size
    start = _let_go(np.log(level[:end])) if end > _LEAST_RELEASED else end
    if end - start < _LEAST_RELEASED:
        raise ConfigError(f"the oscillation at {carrier_hz:.1f} Hz is not seen to decay freely for 8 ms")
    t, seen = times[start:end], mixed[start:end]
    weight = np.abs(seen)
    rate, size = np.polyfit(t, np.log(weight), 1, w=weight)
    left = np.log(weight) - (rate * t + size)
    u_rate = math.sqrt(float(left @ left) / (t.size - 2) / float(np.sum((t - t.mean()) ** 2)))
    if -rate < _SEEN * u_rate:
        raise ConfigError(f"the oscillation at {carrier_hz:.1f} Hz is not seen to decay freely: it is gone at once")
    turn, _ = np.polyfit(t, np.unwrap(np.angle(seen)), 1, w=weight)
    return _decay(carrier_hz + float(turn) / (2.0 * math.pi), -float(rate), math.exp(float(size)))


def _let_go(logarithm: Floats) -> int:
    """Return the first window that lies wholly in the decay: a constant and then a line fit best about there."""
    places = np.arange(logarithm.size)
    invalid_values = []
    for place in range(logarithm.size - 4):
        after = places >= place
        kinked = np.column_stack([np.ones(places.size), np.where(after, places - place, 0.0)])
        found, *_ = np.linalg.lstsq(kinked, logarithm, rcond=None)
        invalid_values.append(float(np.sum((logarithm - kinked @ found) ** 2)))
    return int(np.argmin(invalid_values)) + 1
