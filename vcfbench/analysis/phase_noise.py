"""Second-order statistics of the phase (the angle) under power-law noise of the rate, exact at any lag.

The phase of such noise is not stationary, but its differences are: their covariances follow from a generalised
autocovariance s(t) of the phase (Greenhall and Riley, *Uncertainty of stability variances based on finite differences*,
2003):

    quantisation Q^2 [t = 0],  white -N^2 |t| / 2,  flicker B^2 t^2 ln|t| / (2 pi),  random walk K^2 |t|^3 / 12.

The factors are such that the Allan variances are 3 Q^2/tau^2, N^2/tau, (2 ln 2/pi) B^2 and K^2 tau/3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["CorrelatedSquares", "PhaseNoise", "correlated_squares"]

Floats: TypeAlias = "NDArray[np.float64]"

_SINGLY = 16384
"""So many lags are summed one by one; beyond, the smooth stretches between corners by Gauss's rule."""
_SHORT = 32
_NODES = 12
_FINEST = 64
"""Averages of the phase over more points than that are computed as if over so many, spread evenly."""


@dataclass(frozen=True, slots=True)
class PhaseNoise:
    """A mixture of the four laws: coefficients Q, N, B, K in the record's unit, with time in samples."""

    quantisation: float = 0.0
    white: float = 0.0
    flicker: float = 0.0
    random_walk: float = 0.0
    averaged_over: int = 1
    """How many successive phases each value is the sum of."""

    def averaged(self, count: int) -> PhaseNoise:
        """Return the same noise as seen in sums of `count` successive phases, which the modified variance uses."""
        return replace(self, averaged_over=count)

    def spaced(self, factor: int) -> PhaseNoise:
        """Return the same noise with time in units of `factor` samples."""
        return PhaseNoise(
            quantisation=self.quantisation,
            white=self.white * math.sqrt(factor),
            flicker=self.flicker * factor,
            random_walk=self.random_walk * factor**1.5,
        )

    def covariance(self, lag: Floats) -> Floats:
        """Return the generalised autocovariance of the phase (or of its sums) at `lag` samples."""
        if self.averaged_over == 1:
            return np.asarray(self._single(lag) + self.quantisation**2 * (lag == 0.0))
        count = min(self.averaged_over, _FINEST)
        stride = self.averaged_over / count
        offsets = np.arange(1 - count, count)
        weights = stride**2 * (count - np.abs(offsets))
        smooth = self._single(lag[:, None] + stride * offsets) @ weights
        return np.asarray(smooth + self.quantisation**2 * np.maximum(0.0, self.averaged_over - np.abs(lag)))

    def _single(self, lag: Floats) -> Floats:
        """Return what all but the quantisation give for single phases."""
        distance = np.abs(lag)
        total = -0.5 * self.white**2 * distance
        if self.flicker:
            total += self.flicker**2 / (2.0 * math.pi) * distance**2 * np.log(np.maximum(distance, 1e-300))
        if self.random_walk:
            total += self.random_walk**2 / 12.0 * distance**3
        return total


@dataclass(frozen=True, slots=True)
class CorrelatedSquares:
    """Two means of squared differences of one phase, as random variables."""

    mean_first: float
    """Expectation of a squared first difference."""
    mean_second: float
    covariance: float
    """Covariance of the two means of squares."""
    covariance_of_means: float
    """Covariance of the means of the differences themselves, unsquared."""


def correlated_squares(
    noise: PhaseNoise, terms_first: int, first: int, terms_second: int, second: int, *, order: int = 2
) -> CorrelatedSquares:
    """Return how the mean squares of two sets of differences of `order` vary together.

    The first set are `terms_first` successive differences at the stride `first`, the second likewise. Gaussian: the
    covariance of two squares is twice the square of the covariance.
    """
    shifts = _shifts(first, second, order)
    low, high = 1 - terms_first, terms_second - 1
    if high - low < _SINGLY:
        lags, counts = np.arange(low, high + 1, dtype=np.float64), np.ones(high - low + 1)
        covariance = _at_every_lag(noise, low, high, shifts)
    else:
        lags, counts = _lags(low, high, [-shift for shift in shifts])
        covariance = np.zeros_like(lags)
        for shift, weight in shifts.items():
            covariance += weight * noise.covariance(lags + shift)
    counts *= np.minimum(np.minimum(terms_first, terms_second), np.minimum(terms_second - lags, terms_first + lags))
    scale = float(terms_first) * float(terms_second)
    return CorrelatedSquares(
        mean_first=_variance(noise, first, order),
        mean_second=_variance(noise, second, order),
        covariance=2.0 * float(counts @ covariance**2) / scale,
        covariance_of_means=float(counts @ covariance) / scale,
    )


def _at_every_lag(noise: PhaseNoise, low: int, high: int, shifts: dict[int, int]) -> Floats:
    """Return the covariance of the differences at each lag; all shifted lags are whole and share one table."""
    first, last = low + min(shifts), high + max(shifts)
    table = noise.covariance(np.arange(first, last + 1, dtype=np.float64))
    covariance = np.zeros(high - low + 1)
    for shift, weight in shifts.items():
        begin = low + shift - first
        covariance += weight * table[begin : begin + covariance.size]
    return covariance


def _shifts(first: int, second: int, order: int) -> dict[int, int]:
    """Return by how much the phases of two differences are apart, each with the product of their weights."""
    weights = [(-1) ** i * math.comb(order, i) for i in range(order + 1)]
    shifts: dict[int, int] = {}
    for i, a in enumerate(weights):
        for j, b in enumerate(weights):
            shift = j * second - i * first
            shifts[shift] = shifts.get(shift, 0) + a * b
    return shifts


def _variance(noise: PhaseNoise, stride: int, order: int) -> float:
    shifts = _shifts(stride, stride, order)
    return float(np.array(list(shifts.values())) @ noise.covariance(np.array(list(shifts), dtype=np.float64)))


@cache  # it is asked for with each of thousands of covariances
def _rule() -> tuple[Floats, Floats]:
    """Return nodes and weights of Gauss and Legendre."""
    nodes, shares = np.polynomial.legendre.leggauss(_NODES)
    return nodes, shares


def _lags(low: int, high: int, corners: list[int]) -> tuple[Floats, Floats]:
    """Return lags and weights whose weighted sum is that over every whole lag from `low` to `high`.

    The covariance is smooth but for its corners, at which each lag counts singly. Stretches grow with the distance from
    the nearest corner; a long one is an integral (from half a lag before to half a lag behind it).
    """
    steps = 2.0 ** np.arange(3, math.ceil(math.log2(2 * (high - low))))
    around = np.concatenate([-steps[::-1], [0.0, 1.0], steps])
    edges = np.unique(np.concatenate([np.add.outer(corners, around).ravel(), [low, high + 1]]))
    edges = edges[(edges >= low) & (edges <= high + 1)]
    begins, widths = edges[:-1], np.diff(edges)
    short, long = widths <= _SHORT, widths > _SHORT
    counts = widths[short].astype(np.intp)
    singly = np.repeat(begins[short], counts) + np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    nodes, shares = _rule()
    middle = begins[long] + (widths[long] - 1.0) / 2.0
    spread = (middle[:, None] + widths[long][:, None] / 2.0 * nodes).ravel()
    weights = (widths[long][:, None] / 2.0 * shares).ravel()
    lags = np.concatenate([singly, spread])
    return lags, np.concatenate([np.ones(lags.size - spread.size), weights])
