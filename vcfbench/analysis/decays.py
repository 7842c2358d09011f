"""Free decays at carrier level: of modes beside a carrier that goes on, and of the carrier itself once it is let go.

Modes are fitted to the samples as they are: v = v0 + A cos(w t) + B sin(w t) + sum of e^(-r t) (a cos(w' t) + b sin(w'
t)), the carrier's w known. Of the carrier that was let go the samples are mixed down and averaged in windows of a
Hann's shape, one after the other, so that their noise stays independent; then its decay is a complex exponential.
"""

import math
from contextlib import suppress
from typing import TypeAlias

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike, NDArray

from vcfbench.analysis.arrays import Floats
from vcfbench.errors import ConfigError

Complexes: TypeAlias = "NDArray[np.complex128]"

_LEAST_PERIODS = 30.0
"""Of the carrier, in a record."""
_REACH = 0.5
"""Share of the carrier's frequency within which modes are looked for."""
_RELEASE_WINDOW_S, _RELEASE_PERIODS = 1e-3, 3.5
"""Length of a window, at least that and so many periods: else what is mixed up to twice the carrier passes."""
_SEEN = 8.0
"""A spectral line by so much above the median is another mode; a rate by so many of its uncertainties is one."""
_NEAR_HZ = 3.0
"""Within this of a mode that is known a line is not another mode's."""
_LEAST_RELEASED = 8
_ROUNDS, _SETTLED = 40, 1e-7
"""Steps of the search for modes, the last of which is that small over the record."""


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
    values = _fine_enough(samples, interval_s, carrier_hz)
    times: Floats = np.asarray(interval_s * np.arange(values.size), dtype=np.float64)
    if carrier_hz * times[-1] < _LEAST_PERIODS:
        raise ConfigError(f"decays beside a carrier need {_LEAST_PERIODS / carrier_hz:.2g} s, got {times[-1]:.2g} s")
    steady = _basis(times, carrier_hz, np.zeros(0))
    late = 3 * times.size // 4  # by then little else is left
    left = values - steady @ _solved(steady[late:], values[late:])
    first = _line(left, times, carrier_hz, {0.0: min(_NEAR_HZ, 0.5 / times[-1])})
    if first is None:
        raise ConfigError(f"nothing decays beside {carrier_hz:.1f} Hz")
    parameters, left = _fitted(np.array(first), values, times, carrier_hz)
    second = _line(left, times, carrier_hz, {0.0: _NEAR_HZ, float(parameters[0]): _NEAR_HZ})
    if second is not None:
        with suppress(ConfigError):  # lost in the noise that moves both
            both, _ = _fitted(np.array([*parameters, second[0], parameters[1]]), values, times, carrier_hz)
            parameters = both if both[3] > 0.0 else parameters
    sizes = _solved(_basis(times, carrier_hz, parameters), values)[3:].reshape(-1, 2)
    modes = [
        _decay(carrier_hz + float(offset_hz), float(rate), math.hypot(*size))
        for (offset_hz, rate), size in zip(parameters.reshape(-1, 2), sizes, strict=True)
    ]
    return tuple(sorted(modes, key=lambda mode: -mode.amplitude_v))


def _decay(frequency_hz: float, rate: float, amplitude: float) -> RingingMode:
    if rate <= 0.0:
        raise ConfigError(f"the oscillation at {frequency_hz:.1f} Hz does not decay")
    natural_hz = math.hypot(frequency_hz, rate / (2.0 * math.pi))
    return RingingMode(natural_hz, math.pi * natural_hz / rate, amplitude)


def _fine_enough(samples: ArrayLike, interval_s: float, carrier_hz: float) -> Floats:
    if 2.1 * carrier_hz * interval_s > 1.0:
        raise ConfigError(f"samples every {interval_s:g} s are too far apart for {carrier_hz:g} Hz")
    return np.asarray(samples, dtype=np.float64)


def _basis(times: Floats, carrier_hz: float, parameters: Floats) -> Floats:
    """Return a constant, the carrier's cosine and sine, and those of each mode (its offset, Hz, and rate, 1/s)."""
    columns = [np.ones_like(times)]
    for offset_hz, rate in [(0.0, 0.0), *parameters.reshape(-1, 2)]:
        swing = np.exp((2j * math.pi * (carrier_hz + offset_hz) - rate) * times)
        columns += [swing.real, swing.imag]
    return np.column_stack(columns)


def _solved(basis: Floats, values: Floats) -> Floats:
    """Return the least-squares solution by normal equations: the columns are of different frequencies."""
    return np.asarray(np.linalg.solve(basis.T @ basis, basis.T @ values))


def _line(left: Floats, times: Floats, carrier_hz: float, known_hz: dict[float, float]) -> tuple[float, float] | None:
    """Return offset (Hz) and about the rate (1/s) of the strongest spectral line that is no known one's.

    `known_hz` are the offsets of those, each with how near to it a line is its own. None: nothing stands out.
    """
    count = 4 * left.size
    level = np.abs(np.fft.rfft(left * np.hanning(2 * left.size)[left.size :], count))
    offset_hz = np.fft.rfftfreq(count, float(times[1])) - carrier_hz
    band = np.abs(offset_hz) < _REACH * carrier_hz
    level, offset_hz = level[band], offset_hz[band]
    free = np.all([np.abs(offset_hz - each) > near for each, near in known_hz.items()], axis=0)
    place = int(np.where(free, level, 0.0).argmax())
    if not level[place] > _SEEN * float(np.median(level)):
        return None
    # A decay's line is sqrt(3) r / pi wide at half its height
    high = np.flatnonzero((level < 0.5 * level[place]) & free)
    low, up = high[high < place], high[high > place]
    wide_hz = offset_hz[up[0]] - offset_hz[low[-1]] if low.size and up.size else 0.0
    return float(offset_hz[place]), max(4.0 / float(times[-1]), math.pi / math.sqrt(3.0) * float(wide_hz) / 2.0)


def _fitted(start: Floats, values: Floats, times: Floats, carrier_hz: float) -> tuple[Floats, Floats]:
    """Fit offset (Hz) and rate (1/s) of each mode by Gauss and Newton; return them, and what is left."""
    found, length_s = start, float(times[-1])
    for _ in range(_ROUNDS):
        basis = _basis(times, carrier_hz, found)
        sizes = _solved(basis, values)
        left = values - basis @ sizes
        slopes = []
        for mode in range(found.size // 2):
            cosine, sine = basis[:, 3 + 2 * mode], basis[:, 4 + 2 * mode]
            a, b = sizes[3 + 2 * mode : 5 + 2 * mode]
            slopes += [2.0 * math.pi * times * (b * cosine - a * sine), -times * (a * cosine + b * sine)]
        change = _solved(np.column_stack([basis, *slopes]), left)[3 + found.size :]
        most = np.ravel([(0.25 / length_s, 0.5 * max(rate, 1.0 / length_s)) for rate in found[1::2]])
        found = found + np.clip(change, -most, most)
        if float(np.abs(change).max()) * length_s < _SETTLED:
            return found, left
    raise ConfigError(f"the decays beside {carrier_hz:.1f} Hz are not those of one or two modes")


def _mixed(samples: ArrayLike, interval_s: float, carrier_hz: float, window_s: float) -> tuple[Floats, Complexes]:
    """Return the middles of the windows, s, and the phasors of the carrier's frequency in them."""
    values = _fine_enough(samples, interval_s, carrier_hz)
    size = round(window_s / interval_s)
    count = values.size // size
    times = interval_s * np.arange(count * size)
    shape = np.hanning(size + 2)[1:-1]
    turned = values[: times.size] * np.exp(-2j * math.pi * carrier_hz * times)
    phasors = 2.0 * turned.reshape(count, size) @ (shape / shape.sum())
    middles = interval_s * (size * np.arange(count) + (size - 1) / 2.0)
    return np.asarray(middles), np.asarray(phasors)


def fit_release(samples: ArrayLike, interval_s: float, carrier_hz: float) -> RingingMode:
    """Fit the decay of an oscillation that is held at first, is then let go, and is no longer seen at last.

    When it is let go shows in its amplitude; the record ends for the fit where the amplitude drops at once.

    Raises:
        ConfigError: it never drops, or decays for less than eight windows.
    """
    window_s = max(_RELEASE_WINDOW_S, _RELEASE_PERIODS / carrier_hz)
    times, mixed = _mixed(samples, interval_s, carrier_hz, window_s)
    level = np.abs(mixed)
    if not level[:3].min(initial=math.inf) > 0.0:
        raise ConfigError(f"the oscillation at {carrier_hz:.1f} Hz is not seen to decay freely: the record has none")
    gone = np.flatnonzero(level < 0.5 * level[:3].max())
    # The window before may hold a part of the drop.
    end = int(gone[0]) - 1 if gone.size else level.size
    start = _let_go(np.log(level[:end])) if end > _LEAST_RELEASED else end
    if end - start < _LEAST_RELEASED:
        raise ConfigError(f"the oscillation at {carrier_hz:.1f} Hz is not seen to decay freely for 8 windows")
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
