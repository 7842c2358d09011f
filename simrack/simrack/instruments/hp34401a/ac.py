"""The ac path of the 34401A: a blocking capacitor, an amplifier, and a true-rms converter with its filter.

A node is looked at as the World keeps it. Sines in closed form are treated so, whatever their frequency. What a
generator plays is known by its power between any two instants and by the lines of its spectrum, of which the amplifier
leaves a part. The PCB's own nodes, which can only be asked for their volts, are slow: they are sampled. Corners and the
converter's weighting were chosen such that the published additional errors and settling times come out (User's Guide
p. 58, 81, 218); the shapes themselves are unverified. Transients of the blocking capacitor after a step of the direct
voltage are left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterable
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from simrack.components import Path, Values, ended, summed_powers
from simrack.instruments.hp34401a.imperfections import AcErrors
from simrack.trace import Piece, merged

SETTLING_S = MappingProxyType({3.0: 7.0, 20.0: 1.0, 200.0: 0.1})
"""What the converter's output depends on, by filter: its settling time to 0.01 % (p. 58)."""
_CORNER_HZ = MappingProxyType({3.0: 0.1, 20.0: 1.22, 200.0: 4.83})
"""Equivalent first-order corner: 0.74 % low at 10 Hz with the medium filter, 0.73 % at 40 Hz with the fast (p. 218)."""
_TOP_HZ = 1e6
"""Second-order upper corner: 0.4 % low at 300 kHz, the end of the specified band (unverified)."""
_INPUT_OHM = 1e6
_INPUT_F = 100e-12
"""Input impedance of the ac functions (p. 219)."""
_LOW_HZ = 3.0
_HIGH_HZ = 3e5
"""The specified band (p. 218)."""
_WINDOW_POINTS = 3**10
"""Samples over a window: coprime to the periods that round frequencies have in it, so each is met at many phases."""
_SLICE = 1 << 13
"""So many of them are worked out in one go."""
_PEAK_POINTS = 4096
_FORGOTTEN = 1e-9
_CREST_LIMITS = ((1.0, 5e-4), (math.sqrt(2.0), 0.0), (2.0, 5e-4), (3.0, 1.5e-3), (4.0, 3e-3), (5.0, 4e-3))
"""Crest factor and the published additional error at the end of its class (p. 218); a sine has none."""


class Detected(NamedTuple):
    """Signal behind the blocking capacitor: rms as the converter shows it, and the largest peak."""

    rms_v: float
    peak_v: float


class Phasors(Struct, frozen=True):
    """Sines as `Re sum sizes exp(j speeds t)`, t from the start of their piece."""

    sizes: NDArray[np.complex128]
    speeds: NDArray[np.float64]

    def at(self, elapsed_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the sum at times from their origin."""
        return np.asarray((np.exp(1j * np.outer(elapsed_s, self.speeds)) @ self.sizes).real)

    def peak(self, duration_s: float) -> float:
        """Return the largest magnitude within a period of the slowest sine and over the whole duration."""
        if not len(self.sizes):
            return 0.0
        period = min(math.tau / float(self.speeds.min()), duration_s)
        looks = (np.linspace(0.0, span, _PEAK_POINTS) for span in (period, duration_s))
        return max(float(np.abs(self.at(times)).max()) for times in looks)


class AcResponse(Struct, frozen=True):
    """The way from a node of `source_ohm` to the converter, errors of the specimen included."""

    filter_hz: float
    errors: AcErrors
    source_ohm: float = 0.0

    @property
    def gain(self) -> float:
        """Gain of all frequencies."""
        return 1.0 + self.errors.gain_error

    @property
    def corner_hz(self) -> float:
        """The corner of the blocking capacitor with the filter."""
        return _CORNER_HZ[self.filter_hz]

    def slow(self, frequency_hz: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the response to low frequencies: blocking capacitor, filter."""
        f = np.maximum(frequency_hz, 1e-6)
        own = 1.0 + self.errors.low_frequency_error * np.minimum(_LOW_HZ / f, 1.0) ** 4
        return np.asarray(own / (1.0 - 1j * _CORNER_HZ[self.filter_hz] / f))

    def fast(self, frequency_hz: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the response to high frequencies: amplifier, input capacitance."""
        x = frequency_hz / _TOP_HZ
        amplified = 1.0 / (1.0 + 1j * math.sqrt(2.0) * x - x**2)
        loaded = 1.0 / (1.0 + self.source_ohm * (1.0 / _INPUT_OHM + 2j * math.pi * frequency_hz * _INPUT_F))
        own = 1.0 + self.errors.flatness_error * np.minimum(frequency_hz / _HIGH_HZ, 1.0) ** 2
        return np.asarray(amplified * loaded * own)

    def at(self, frequency_hz: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the transfer function."""
        return np.asarray(self.gain * self.slow(frequency_hz) * self.fast(frequency_hz))


def crest_limit(crest_factor: float) -> float:
    """Return the published additional error of reading at a crest factor, beyond 5 as at 5."""
    factors, limits = zip(*_CREST_LIMITS, strict=True)
    return float(np.interp(crest_factor, factors, limits))


def phasors(piece: Piece, response: AcResponse) -> Phasors:
    """Return the sines of a piece behind the response, without those too small to matter."""
    sines = piece.sines or ()
    frequencies = np.array([sine.frequency_hz for sine in sines])
    turned = np.array([-1j * sine.amplitude_v * np.exp(1j * sine.phase_rad) for sine in sines], dtype=complex)
    sizes = turned * response.at(frequencies) if len(sines) else turned
    kept = np.abs(sizes) > _FORGOTTEN * np.abs(sizes).max(initial=0.0)
    return Phasors(sizes[kept], math.tau * frequencies[kept])


def detect(pieces: Iterable[Piece], start_s: float, stop_s: float, response: AcResponse) -> Detected:
    """Return the result of :func:`detecting`, worked out at once."""
    return ended(detecting(pieces, start_s, stop_s, response))


def detecting(
    pieces: Iterable[Piece], start_s: float, stop_s: float, response: AcResponse
) -> Generator[None, None, Detected]:
    """Return, after slices of work, rms and peak over a window, weighted towards its middle (Hann).

    Nothing was before the first piece.
    """
    within = [piece for piece in pieces if piece.stop_s > start_s and piece.start_s < stop_s]
    if any(piece.sines is None for piece in within):
        return (yield from _banded(within, start_s, stop_s, response))
    mean_square = peak = 0.0
    for piece in within:
        sines = phasors(piece, response)
        part = (max(piece.start_s, start_s), min(piece.stop_s, stop_s))
        mean_square += _weighted_power(sines, piece.start_s, part, (start_s, stop_s))
        peak = max(peak, sines.peak(part[1] - part[0]))
    return Detected(math.sqrt(max(mean_square, 0.0)), peak)


def _weighted_power(sines: Phasors, origin_s: float, part: tuple[float, float], window: tuple[float, float]) -> float:
    """Return the integral of the square over `part`, weighted with the window's raised cosine; closed form.

    The square of a sum of sines is a sum of sines of the sums and differences of their frequencies, and so is its
    product with 1 - cos.
    """
    span = window[1] - window[0]
    bell = math.tau / span
    turn = bell * (window[0] - origin_s)

    def weighed(speeds: NDArray[np.float64]) -> NDArray[np.complex128]:
        centre, length = (part[0] + part[1]) / 2 - origin_s, part[1] - part[0]
        up = np.exp(-1j * turn) * _integral(speeds + bell, centre, length)
        down = np.exp(1j * turn) * _integral(speeds - bell, centre, length)
        return np.asarray((_integral(speeds, centre, length) - (up + down) / 2) / span)

    a, w = sines.sizes, sines.speeds
    sums = np.outer(a, a) * weighed(w[:, None] + w[None, :])
    differences = np.outer(a, a.conj()) * weighed(w[:, None] - w[None, :])
    return float((sums + differences).sum().real) / 2


def _integral(speeds: NDArray[np.float64], centre_s: float, length_s: float) -> NDArray[np.complex128]:
    """Return the integral of exp(j speed t) over a stretch about its centre."""
    return np.asarray(length_s * np.exp(1j * speeds * centre_s) * np.sinc(speeds * length_s / math.tau))


def _banded(
    pieces: list[Piece], start_s: float, stop_s: float, response: AcResponse
) -> Generator[None, None, Detected]:
    """Return rms and peak by the means of the volts and of their squares in small parts of the window."""
    edges = np.linspace(start_s, stop_s, _WINDOW_POINTS + 1)
    parts, means, squares, peak = yield from _in_parts(merged(pieces), edges, response.fast)
    widths, firsts = np.diff(parts), np.searchsorted(parts, edges[:-1])
    yield
    means, squares = (np.add.reduceat(each * widths, firsts) / np.diff(edges) for each in (means, squares))
    yield
    whole = _Spectrum.of(means, stop_s - start_s)
    yield
    power = whole.weighted(squares) - whole.mean**2 + whole.change(response.slow)
    peak = max(peak, float(np.abs(means - whole.mean).max()))
    return Detected(response.gain * math.sqrt(max(power, 0.0)), peak)


def _in_parts(
    pieces: list[Piece], edges_s: Values, path: Path
) -> Generator[None, None, tuple[Values, Values, Values, float]]:
    """Return edges that no piece ends between, the means of volts and squares between them, and the largest peak."""
    bounds = np.array([each for piece in pieces for each in (piece.start_s, piece.stop_s)])
    bounds = np.setdiff1d(bounds[(bounds > edges_s[0]) & (bounds < edges_s[-1])], edges_s)
    parts = np.insert(edges_s, np.searchsorted(edges_s, bounds), bounds)
    means, squares, peak = np.zeros(len(parts) - 1), np.zeros(len(parts) - 1), 0.0
    for piece in pieces:
        first, last = np.searchsorted(parts, (piece.start_s, piece.stop_s))
        if first < last:
            components = piece.components()
            for each in components:
                yield
                yield from each.preparing(path)
            for begun in range(first, last, _SLICE):
                yield
                held = slice(begun, min(begun + _SLICE, last))
                means[held], squares[held] = summed_powers(components, parts[held.start : held.stop + 1], path)
            peak = max(peak, sum(each.peak_v(path) for each in components))
    return parts, means, squares, peak


class _Spectrum(Struct, frozen=True):
    """Samples weighted with a raised cosine: their mean, the power of the rest, and where it lies."""

    mean: float
    frequencies_hz: NDArray[np.float64]
    powers: NDArray[np.float64]

    @classmethod
    def of(cls, volts: NDArray[np.float64], duration_s: float) -> _Spectrum:
        count = len(volts)
        weight = _bell(count)
        mean = float(weight @ volts)
        powers = np.abs(np.fft.rfft(np.sqrt(weight) * (volts - mean))) ** 2 / count
        powers[1:] *= 2.0  # both halves of the spectrum; a last bin of its own would be too small to matter
        return cls(mean, np.asarray(np.fft.rfftfreq(count, duration_s / count), dtype=np.float64), powers)

    def weighted(self, squares: Values) -> float:
        """Return the mean of squares by the same weights."""
        return float(_bell(len(squares)) @ squares)

    def change(self, part: Callable[[NDArray[np.float64]], NDArray[np.complex128]]) -> float:
        """Return the amount by which a part of the response changes the power."""
        return float(self.powers @ (np.abs(part(self.frequencies_hz)) ** 2 - 1.0))


def _bell(count: int) -> Values:
    """Return the weights of the parts of a window: a raised cosine, its sum 1."""
    return np.asarray(2.0 * np.sin(np.pi * (np.arange(count) + 0.5) / count) ** 2 / count)
