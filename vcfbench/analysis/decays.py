"""Free decays at carrier level: of modes next to a carrier, and of the carrier itself.

Modes are fitted to the samples as they are: v = v0 + A cos(w t) + B sin(w t) + sum of e^(-r t) (a cos(w' t) + b sin(w'
t)), the carrier's w known. Of the carrier that was let go the samples are mixed down and averaged in windows of a
Hann's shape, one after the other, so that their noise stays independent; then its decay is a complex exponential.
"""

import cmath
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
    """Fit one or two modes that decay next to a carrier of known frequency, the strongest first.

    Raises:
        ConfigError: too short a record, or nothing that decays.
    """
    values = _fine_enough(samples, interval_s, carrier_hz)
    record = _Samples(values, interval_s)
    if carrier_hz * record.length_s < _LEAST_PERIODS:
        raise ConfigError(
            f"decays next to a carrier need {_LEAST_PERIODS / carrier_hz:.2g} s, got {record.length_s:.2g} s"
        )
    late = 3 * values.size // 4  # by then little else is left
    none = np.zeros(0)
    level, a, b = _sizes(_Samples(values[late:], interval_s), carrier_hz, none)
    begun = complex(a, -b) * cmath.exp(-2j * math.pi * carrier_hz * interval_s * late)
    left = _left(record, carrier_hz, none, np.array([level, begun.real, -begun.imag]))
    first = _line(left, record, carrier_hz, {0.0: min(_NEAR_HZ, 0.5 / record.length_s)})
    if first is None:
        raise ConfigError(f"no decay was found next to {carrier_hz:.1f} Hz")
    parameters = _fitted(np.array(first), record, carrier_hz)
    left = _left(record, carrier_hz, parameters, _sizes(record, carrier_hz, parameters))
    second = _line(left, record, carrier_hz, {0.0: _NEAR_HZ, float(parameters[0]): _NEAR_HZ})
    if second is not None:
        with suppress(ConfigError):  # lost in the noise that moves both
            both = _fitted(np.array([*parameters, second[0], parameters[1]]), record, carrier_hz)
            parameters = both if both[3] > 0.0 else parameters
    sizes = _sizes(record, carrier_hz, parameters)[3:].reshape(-1, 2)
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


class _Samples:
    """Samples of a record, and their sums with exponentials e^(p t), p complex, that the normal equations are made of.

    The record is cut into rows of one length, so that e^(p t) is a factor of the row times one of the place in it: a
    sum over all samples is then a product with the rows, and one of two exponentials needs no samples at all.
    """

    def __init__(self, values: Floats, interval_s: float) -> None:
        row = math.isqrt(values.size)
        self.values, self.interval_s, self.length_s = values, interval_s, interval_s * (values.size - 1)
        self._whole = values[: values.size // row * row].reshape(-1, row)
        self._rest = values[self._whole.size :]
        self._begins_s = interval_s * row * np.arange(len(self._whole) + 1)
        self._within_s = interval_s * np.arange(row)

    def sums(self, p: complex) -> Floats:
        """Return the sums of v Re e, v Im e, v t Re e and v t Im e over the samples v, where e = e^(p t)."""
        within, begins = np.exp(p * self._within_s), np.exp(p * self._begins_s)
        both = np.stack([within, self._within_s * within])
        rows = (both.view(np.float64).reshape(2, -1, 2).transpose(1, 0, 2).reshape(-1, 4).T @ self._whole.T).T
        last = (both[:, : self._rest.size] * self._rest).sum(axis=1)
        seen = np.append(rows.copy().view(np.complex128), last[None, :], axis=0)
        plain = complex(begins @ seen[:, 0])
        timed = complex(begins @ (seen[:, 1] + self._begins_s * seen[:, 0]))
        return np.array([plain.real, plain.imag, timed.real, timed.imag])

    def moments(self, p: complex) -> Complexes:
        """Return the sums of e^(p t), t e^(p t) and t^2 e^(p t) over the times of the samples."""
        within, begins = np.exp(p * self._within_s), np.exp(p * self._begins_s)
        powers = self._within_s ** np.arange(3)[:, None]
        whole, rest = powers @ within, powers[:, : self._rest.size] @ within[: self._rest.size]
        row = np.append(np.tile(whole, (len(begins) - 1, 1)), rest[None, :], axis=0)
        t = self._begins_s
        later = [row[:, 0], t * row[:, 0] + row[:, 1], t**2 * row[:, 0] + 2.0 * t * row[:, 1] + row[:, 2]]
        return np.asarray(np.asarray(later) @ begins)


def _exponents(carrier_hz: float, parameters: Floats) -> list[complex]:
    """Return the exponents, 1/s, of a constant, of the carrier and of each mode (its offset, Hz, and rate, 1/s)."""
    modes = [2j * math.pi * (carrier_hz + offset_hz) - rate for offset_hz, rate in parameters.reshape(-1, 2)]
    return [0j, 2j * math.pi * carrier_hz, *modes]


def _normal(samples: _Samples, exponents: list[complex]) -> tuple[Floats, Floats]:
    """Return the normal equations of Re e, Im e, t Re e, t Im e of each exponent: their products, and those with v.

    Re a Re b = Re(a b + a b*) / 2, Im a Im b = Re(a b* - a b) / 2, Re a Im b = Im(a b - a b*) / 2.
    """
    count = len(exponents)
    products = np.empty((count, 4, count, 4))
    for i, first in enumerate(exponents):
        for j, second in enumerate(exponents[: i + 1]):
            same, across = samples.moments(first + second), samples.moments(first + second.conjugate())
            for m in (0, 1):
                for n in (0, 1):
                    s, a = same[m + n], across[m + n]
                    block = 0.5 * np.array([[s.real + a.real, s.imag - a.imag], [s.imag + a.imag, a.real - s.real]])
                    products[i, 2 * m : 2 * m + 2, j, 2 * n : 2 * n + 2] = block
                    products[j, 2 * n : 2 * n + 2, i, 2 * m : 2 * m + 2] = block.T
    with_values = np.concatenate([samples.sums(each) for each in exponents])
    return products.reshape(4 * count, 4 * count), with_values


def _places(modes: int) -> list[int]:
    """Return the places, in the normal equations, of a constant and of cosine and sine of carrier and modes."""
    return [0, *(4 * each + part for each in range(1, modes + 2) for part in (0, 1))]


def _left(samples: _Samples, carrier_hz: float, parameters: Floats, sizes: Floats) -> Floats:
    """Return the remainder of the samples without a constant, the carrier and modes of these sizes."""
    times = samples.interval_s * np.arange(samples.values.size)
    phasors = [complex(sizes[0]), *(complex(a, -b) for a, b in sizes[1:].reshape(-1, 2))]
    left = samples.values
    for exponent, phasor in zip(_exponents(carrier_hz, parameters), phasors, strict=True):
        left = left - (phasor * np.exp(exponent * times)).real
    return left


def _line(
    left: Floats, record: _Samples, carrier_hz: float, known_hz: dict[float, float]
) -> tuple[float, float] | None:
    """Return offset (Hz) and about the rate (1/s) of the strongest spectral line that is no known one's.

    `known_hz` are the offsets of those, each with how near to it a line is its own. None: nothing stands out.
    """
    count = 4 * left.size
    level = np.abs(np.fft.rfft(left * np.hanning(2 * left.size)[left.size :], count))
    offset_hz = np.fft.rfftfreq(count, record.interval_s) - carrier_hz
    band = np.abs(offset_hz) < _REACH * carrier_hz
    level, offset_hz = level[band], offset_hz[band]
    free = np.all([np.abs(offset_hz - each) > near for each, near in known_hz.items()], axis=0)
    place = int(np.where(free, level, 0.0).argmax())
    if not level[place] > _SEEN * float(np.median(level)):
        return None
    # A decay's line is sqrt(3) r / pi wide at half its height; the fit starts from half of that r
    high = np.flatnonzero((level < 0.5 * level[place]) & free)
    low, up = high[high < place], high[high > place]
    wide_hz = offset_hz[up[0]] - offset_hz[low[-1]] if low.size and up.size else 0.0
    return float(offset_hz[place]), max(4.0 / record.length_s, math.pi / math.sqrt(3.0) * float(wide_hz) / 2.0)


def _sizes(samples: _Samples, carrier_hz: float, parameters: Floats) -> Floats:
    """Return the least-squares sizes of a constant and of cosine and sine of carrier and modes."""
    products, with_values = _normal(samples, _exponents(carrier_hz, parameters))
    kept = _places(parameters.size // 2)
    return np.asarray(np.linalg.solve(products[np.ix_(kept, kept)], with_values[kept]))


def _fitted(start: Floats, samples: _Samples, carrier_hz: float) -> Floats:
    """Fit offset (Hz) and rate (1/s) of each mode by Gauss and Newton, on normal equations."""
    found, length_s, modes = start, samples.length_s, start.size // 2
    kept = _places(modes)
    for _ in range(_ROUNDS):
        products, with_values = _normal(samples, _exponents(carrier_hz, found))
        sizes = np.linalg.solve(products[np.ix_(kept, kept)], with_values[kept])
        # The derivatives by offset, 2 pi t (b cos - a sin), and by rate, -t (a cos + b sin), are of t cos and t sin
        slopes = np.zeros((with_values.size, 2 * modes))
        for mode in range(modes):
            a, b = sizes[3 + 2 * mode : 5 + 2 * mode]
            slopes[8 + 4 * mode + 2 : 8 + 4 * mode + 4, 2 * mode] = 2.0 * math.pi * b, -2.0 * math.pi * a
            slopes[8 + 4 * mode + 2 : 8 + 4 * mode + 4, 2 * mode + 1] = -a, -b
        made = np.hstack([np.eye(with_values.size)[:, kept], slopes])
        left = with_values - products[:, kept] @ sizes
        change = np.linalg.solve(made.T @ products @ made, made.T @ left)[len(kept) :]
        most = np.ravel([(0.25 / length_s, 0.5 * max(rate, 1.0 / length_s)) for rate in found[1::2]])
        found = found + np.clip(change, -most, most)
        if float(np.abs(change).max()) * length_s < _SETTLED:
            return np.asarray(found)
    raise ConfigError(f"the decays next to {carrier_hz:.1f} Hz do not fit one or two modes")


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
    """Fit the decay of an oscillation that is driven first, then decays freely, and then vanishes.

    When it is let go shows in its amplitude; the record ends for the fit where the amplitude drops at once.

    Raises:
        ConfigError: it never drops, or decays for less than eight windows.
    """
    window_s = max(_RELEASE_WINDOW_S, _RELEASE_PERIODS / carrier_hz)
    times, mixed = _mixed(samples, interval_s, carrier_hz, window_s)
    level = np.abs(mixed)
    if not level[:3].min(initial=math.inf) > 0.0:
        raise ConfigError(f"the oscillation at {carrier_hz:.1f} Hz has no signal, so no decay can be fitted")
    gone = np.flatnonzero(level < 0.5 * level[:3].max())
    # The window before may hold a part of the drop.
    end = int(gone[0]) - 1 if gone.size else level.size
    start = _let_go(np.log(level[:end])) if end > _LEAST_RELEASED else end
    if end - start < _LEAST_RELEASED:
        raise ConfigError(f"the oscillation at {carrier_hz:.1f} Hz does not decay freely for 8 windows")
    t, seen = times[start:end], mixed[start:end]
    weight = np.abs(seen)
    rate, size = np.polyfit(t, np.log(weight), 1, w=weight)
    left = np.log(weight) - (rate * t + size)
    u_rate = math.sqrt(float(left @ left) / (t.size - 2) / float(np.sum((t - t.mean()) ** 2)))
    if -rate < _SEEN * u_rate:
        raise ConfigError(f"the oscillation at {carrier_hz:.1f} Hz vanishes at once, so it does not decay freely")
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
