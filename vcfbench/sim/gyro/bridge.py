"""The path of the noise within a stretch, drawn at a reading, given its start and its end.

What a step of :mod:`.noise` draws, the state at its end and the integral over it, is all that readings need. A picture
needs the path in between. It is drawn afterwards, from random numbers of its own, so that looking changes nothing that
is drawn later: a free path from the start is drawn on a grid, and what its end and its integral miss of the drawn ones
is spread over it by the covariances (conditional sampling by kriging, Matheron's rule). That is exact on the grid: the
path ends where the step ended, its mean is the mean of the step, and its statistics are those of noise that nobody
ever cut. Points are `GRID_S` apart, or an eighth of the beat of the farther sense mode with the carrier: filtered noise
has little above, so between them a cubic with its own slopes is exact to 1e-4 of it; of the noise in V_s both modes are
there, and of what lies beyond them, 1e-3 of its power, some is folded back. A stretch longer than `LONGEST_S` is halved
by the same rule first, and only the parts that are looked at are drawn.

The force noise is a base-band disturbance that rides on the carrier, so it has no part that turns against the carrier:
V_s shows the part that turns with it, which is the one that the demodulator brings down.
"""

import cmath
import math
from typing import Any

import numpy as np
from msgspec import Struct, field
from numpy.typing import NDArray

from vcfbench.sim.gyro.noise import BLOCK, NoiseState, NoisyChain, by_rows
from vcfbench.sim.gyro.shaken import Shaken

GRID_S = 0.5e-3
_A_BEAT = 8.0
"""Points of the grid in a beat, at least."""
LONGEST_S = 2.0
_SHOWN = 1e-6
"""Part of what the mode that V_s shows most has of it, from which on a mode is one that V_s shows."""
WITHOUT_WEIGHT = 1e-11
"""Part of the largest eigenvalue below which a direction is round-off; what its end misses is spread evenly."""


class _Span(Struct, frozen=True):
    """A piece of a stretch: the noise at both its ends and the integral of the filtered noise over it, V s."""

    start: NoiseState
    end: NoiseState
    integral_v_s: float
    duration_s: float


class _Waveform(Struct, frozen=True):
    """Evenly spaced over a span: the filtered noise, V; its slope, V/s; the noise of the envelope of V_s, V."""

    step_s: float
    filtered_v: NDArray[np.float64]
    slope_v_s: NDArray[np.float64]
    sense_v: NDArray[np.complex128]

    def filtered(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the filtered noise at times from its start: cubics with the slopes that the noise has."""
        return np.asarray(_cubics(self.filtered_v, self.step_s * self.slope_v_s, *self._places(times_s)))

    def sense(self, times_s: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the noise of the envelope at times from its start: cubics with the slopes of the neighbours."""
        return np.asarray(_cubics(self.sense_v, np.gradient(self.sense_v), *self._places(times_s)))

    def _places(self, times_s: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        last = len(self.filtered_v) - 1
        x = np.clip(times_s / self.step_s, 0.0, last)
        index = np.minimum(x.astype(np.intp), last - 1)
        return index, x - index


def _cubics(values: NDArray[Any], rises: NDArray[Any], index: NDArray[np.intp], x: NDArray[np.float64]) -> NDArray[Any]:
    """Return the values at `x` steps behind `index`, by cubics between the values that rise so much a step."""
    v0, v1, d0, d1 = values[index], values[index + 1], rises[index], rises[index + 1]
    return np.asarray(v0 + x * (d0 + x * (3 * (v1 - v0) - 2 * d0 - d1 + x * (2 * (v0 - v1) + d0 + d1))))


class NoisePath(Struct):
    """The noise of one stretch, t from its start.

    Args:
        noisy: the chain with what disturbed it.
        start: the noise at the start.
        end: the noise at the end; None of a look that is only at the start.
        integral_v_s: integral of the filtered noise over the stretch.
        duration_s: how long it lasted.
        key: what its random numbers come from.
        shaken: what the table's flutter made in it, which the end and the integral hold.
    """

    noisy: NoisyChain
    start: NoiseState
    end: NoiseState | None
    integral_v_s: float
    duration_s: float
    key: tuple[int, ...]
    shaken: Shaken | None = None
    _spans: dict[tuple[int, int], _Span] = field(default_factory=dict)
    """Without flutter, of each level and place that is looked at."""
    _waveforms: dict[int, _Waveform] = field(default_factory=dict)

    def filtered(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the filtered noise at times within the stretch, V."""
        volts = np.full(times_s.shape, (self.noisy.freed(self.start) @ self.noisy.shows)[0].real)
        for held, waveform, elapsed in self._looked_at(times_s):
            volts[held] = waveform.filtered(elapsed)
        return volts if self.shaken is None else volts + self.shaken.filtered.at(times_s).real

    def sense(self, times_s: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the noise of the envelope of V_s at times within the stretch, V."""
        volts = np.full(times_s.shape, (self.noisy.freed(self.start) @ self.noisy.shows)[2])
        for held, waveform, elapsed in self._looked_at(times_s):
            volts[held] = waveform.sense(elapsed)
        return volts if self.shaken is None else volts + self.shaken.sense.at(times_s)

    def variance_v2(self, duration_s: float) -> float:
        """Return the variance that the filtered noise is expected to have about its mean over a time, V^2."""
        own = self.noisy.variance_v2(duration_s)
        return own if self.shaken is None else own + self.shaken.variance_v2(duration_s)

    def carried_v_s(self, carrier_rad_s: float, duration_s: float) -> complex:
        """Return the integral of the noise of V_s on its carrier that its values at both ends make, V s."""
        speeds = self.noisy.moving + 1j * carrier_rad_s
        weights = self.noisy.shows[:, 2] / speeds
        turned = self.noisy.freed(self.end or self.start) * cmath.exp(1j * carrier_rad_s * duration_s)
        turned -= self.noisy.freed(self.start)
        return complex(weights @ turned)

    def _looked_at(
        self, times_s: NDArray[np.float64]
    ) -> list[tuple[NDArray[np.bool_], _Waveform, NDArray[np.float64]]]:
        """Return which of the times lie in which part, and where in it."""
        if self.end is None:
            return []
        level = max(0, math.ceil(math.log2(self.duration_s / LONGEST_S)))
        parts = 2**level
        length = self.duration_s / parts
        index = np.clip((times_s / length).astype(np.intp), 0, parts - 1)
        found = []
        for part in map(int, np.unique(index)):
            if part not in self._waveforms:
                self._waveforms[part] = _drawn(self.noisy, self._span(level, part), self._random(level, part, 1))
            held = index == part
            found.append((held, self._waveforms[part], times_s[held] - part * length))
        return found

    def _span(self, level: int, index: int) -> _Span:
        """Return one of the 2^level equal parts of the stretch without flutter; its other half comes with it."""
        if not level and self.end is not None:
            end, integral_v_s = self.end, self.integral_v_s
            if self.shaken is not None:
                end, integral_v_s = self.shaken.added(end, integral_v_s, -1.0)
            return _Span(self.start, end, integral_v_s, self.duration_s)
        if (level, index) not in self._spans:
            whole = self._span(level - 1, index // 2)
            halves = _halved(self.noisy, whole, self._random(level - 1, index // 2, 0))
            for half, span in enumerate(halves):
                self._spans[level, 2 * (index // 2) + half] = span
        return self._spans[level, index]

    def _random(self, *which: int) -> np.random.Generator:
        return np.random.default_rng([*self.key, *which])


def _halved(noisy: NoisyChain, span: _Span, random: np.random.Generator) -> tuple[_Span, _Span]:
    """Return both halves of a span, the noise in the middle drawn: a free one, then the correction to its end."""
    half_s = span.duration_s / 2
    once = noisy.interval(half_s)
    first, second = random.standard_normal((2, len(once.factor))) @ once.factor.T
    middle, integral_v_s = once.later(span.start).plus(first), once.integral_of(span.start) + float(first[-1])
    reached, further_v_s = once.later(middle).plus(second), once.integral_of(middle) + float(second[-1])
    missed = np.append(span.end.minus(reached), span.integral_v_s - integral_v_s - further_v_s)
    spread = noisy.spread(half_s, span.duration_s, _weights(noisy, span.duration_s, missed))
    middle, integral_v_s = middle.plus(spread), integral_v_s + float(spread[-1])
    return (
        _Span(span.start, middle, integral_v_s, half_s),
        _Span(middle, span.end, span.integral_v_s - integral_v_s, half_s),
    )


def _drawn(noisy: NoisyChain, span: _Span, random: np.random.Generator) -> _Waveform:
    """Return the noise on the grid of a span."""
    shows = noisy.shows
    own = np.abs(shows[: len(noisy.chain.eigenmodes), 2])  # of the modes, of which some turn against the carrier
    beats_hz = np.abs(noisy.chain.eigenmodes.imag[own > _SHOWN * own.max()]) / math.tau
    step_s = min(GRID_S, 1.0 / (_A_BEAT * float(beats_hz.max())))
    count = max(1, math.ceil(span.duration_s / step_s - 1e-6))
    grown = np.exp(np.multiply.outer(span.duration_s / count * np.arange(count + 1), noisy.moving))
    shown = by_rows(grown, noisy.freed(span.start)[:, None] * shows)
    if count > 1:
        shown += _fluctuation(noisy, span, grown, random)
    part = np.linspace(0.0, 1.0, count + 1)[:, None]  # what round-off leaves at the ends goes evenly
    missed = [noisy.freed(end) @ shows - seen for end, seen in ((span.start, shown[0]), (span.end, shown[-1]))]
    shown += (1.0 - part) * missed[0] + part * missed[1]
    filtered, slope, sense = shown.T
    return _Waveform(span.duration_s / count, filtered.real.copy(), slope.real.copy(), sense.copy())


def _fluctuation(
    noisy: NoisyChain, span: _Span, grown: NDArray[np.complex128], random: np.random.Generator
) -> NDArray[np.complex128]:
    """Return the noise gathered at each point of the grid, as it shows; `grown` is the free growth of the modes."""
    count = len(grown) - 1
    once, whole = noisy.interval(span.duration_s / count), noisy.interval(span.duration_s)
    factor = once.factor
    drawn = random.standard_normal((count, len(factor)))
    path = _summed(grown[1], by_rows(drawn.astype(np.complex128), noisy.freed_draws(factor.T)))
    ended = whole.later(span.start).plus(noisy.unfreed(path[-1]).minus(noisy.unfreed(0 * path[-1])))
    integral_v_s = float(factor[-1] @ drawn.sum(axis=0)) + once.integral_of(noisy.unfreed(path[:-1].sum(axis=0)))
    missed = np.append(span.end.minus(ended), span.integral_v_s - whole.integral_of(span.start) - integral_v_s)
    weights = _weights(noisy, span.duration_s, missed)
    return np.asarray(by_rows(path, noisy.shows) + noisy.spread_shown(grown, span.duration_s, weights))


def _weights(noisy: NoisyChain, duration_s: float, missed: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return Q^-1 of the missing part, Q the covariance gathered over the span; deficient directions get none."""
    covariance = noisy.covariance(duration_s)
    scale = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    safe = np.where(scale == 0.0, 1.0, scale)
    values, vectors = np.linalg.eigh(covariance / np.multiply.outer(safe, safe))
    kept = values > WITHOUT_WEIGHT * values[-1]
    along = (missed / safe) @ vectors[:, kept]
    return np.asarray(vectors[:, kept] @ (along / values[kept]) / safe)


def _summed(decay: NDArray[np.complex128], added: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return y_0 = 0 and y_(m+1) = decay y_m + added_m for every mode, block by block."""
    count, modes = added.shape
    blocks = -(-count // BLOCK)
    rows = np.zeros((blocks, BLOCK, modes), complex)
    rows.reshape(-1, modes)[:count] = added
    for place in range(1, BLOCK):
        rows[:, place] += decay * rows[:, place - 1]
    powers = decay ** np.arange(1, BLOCK + 1)[:, None]
    carried = np.zeros((blocks, modes), complex)
    for block in range(1, blocks):
        carried[block] = powers[-1] * carried[block - 1] + rows[block - 1, -1]
    rows += powers * carried[:, None, :]
    return np.concatenate((np.zeros((1, modes), complex), rows.reshape(-1, modes)[:count]))
