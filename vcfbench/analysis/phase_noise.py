"""Second-order statistics of the phase (the angle) under power-law noise of the rate, exact at any lag.

The phase of such noise is not stationary, but its differences are: their covariances follow from a generalised
autocovariance s(t) of the phase (Greenhall and Riley, *Uncertainty of stability variances based on finite differences*,
2003):

    quantisation Q^2 [t = 0],  white -N^2 |t| / 2,  flicker B^2 t^2 ln|t| / (2 pi),  random walk K^2 |t|^3 / 12.

The factors are such that the Allan variances are 3 Q^2/tau^2, N^2/tau, (2 ln 2/pi) B^2 and K^2 tau/3.
"""

import math
from collections.abc import Callable
from functools import cache, lru_cache
from typing import Final

import numpy as np
from msgspec import Struct

from vcfbench.analysis.arrays import Floats

_SINGLY = 16384
"""So many lags are summed one by one; beyond, the smooth stretches between corners by Gauss's rule."""
_SHORT = 32
_NODES = 12


class PhaseNoise(Struct, frozen=True):
    """A mixture of the four laws: coefficients Q, N, B, K in the record's unit, with time in samples.

    The square of a negative Q is negative: readings that a filter has in common with their neighbours.
    """

    quantisation: float = 0.0
    white: float = 0.0
    flicker: float = 0.0
    random_walk: float = 0.0

    def squares(self) -> Floats:
        """Return Q^2, N^2, B^2, K^2; every covariance is linear in them."""
        found = np.square([self.quantisation, self.white, self.flicker, self.random_walk])
        found[0] = math.copysign(found[0], self.quantisation)
        return found

    def covariance(self, lag: Floats) -> Floats:
        """Return the generalised autocovariance of the phase at `lag` samples."""
        total = np.zeros(lag.shape)
        for square, law in zip(self.squares().tolist(), _LAWS, strict=True):
            if square:
                total += square * law(np.abs(lag))
        return total

    def among(self, times: Floats) -> Floats:
        """Return the covariances of the phase at `times`, in samples, with each other, (n, n)."""
        return self.covariance(times[:, None] - times)


_LAWS: Final[tuple[Callable[[Floats], Floats], ...]] = (
    lambda distance: np.asarray(distance == 0.0, dtype=np.float64),
    lambda distance: -0.5 * distance,
    lambda distance: distance**2 * np.log(np.maximum(distance, 1e-300)) / (2.0 * math.pi),
    lambda distance: distance * distance * distance / 12.0,
)
"""The autocovariances that the coefficient 1 gives at a distance in samples, in the order of `PhaseNoise.squares`."""


def _each_law(lag: Floats) -> Floats:
    """Return the covariance of each law at `lag` samples, shape (4, n)."""
    return np.stack([law(np.abs(lag)) for law in _LAWS])


class CorrelatedSquares(Struct, frozen=True):
    """Two means of squared differences of one phase, as random variables."""

    mean_first: float
    """Expectation of a squared first difference."""
    covariance: float
    """Covariance of the two means of squares."""
    covariance_of_means: float
    """Covariance of the means of the differences themselves, unsquared."""


def correlated_squares(
    noise: PhaseNoise, terms_first: int, first: int, terms_second: int, second: int
) -> CorrelatedSquares:
    """Return the covariance of the mean squares of two sets of second differences.

    The first set are `terms_first` successive differences at the stride `first`, the second likewise. Gaussian: the
    covariance of two squares is twice the square of the covariance.
    """
    of_first, of_each, of_products = sums_of_lags(terms_first, first, terms_second, second)
    squares = noise.squares()
    scale = float(terms_first) * float(terms_second)
    return CorrelatedSquares(
        mean_first=float(of_first @ squares),
        covariance=2.0 * float(squares @ of_products @ squares) / scale,
        covariance_of_means=float(of_each @ squares) / scale,
    )


@lru_cache(maxsize=4096)
def sums_of_lags(terms_first: int, first: int, terms_second: int, second: int) -> tuple[Floats, Floats, Floats]:
    """Return for each law with the coefficient 1 the terms of :func:`correlated_squares`.

    The expectations of a squared first difference, (4,); the sums over all lags of the covariances of the differences,
    (4,), and of the products of those of two laws, (4, 4). A fit of the noise asks for the same ones again and again.
    """
    shifts = _shifts(first, second)
    low, high = 1 - terms_first, terms_second - 1
    if high - low < _SINGLY:  # all shifted lags are whole and share one table
        lags, counts = np.arange(low, high + 1, dtype=np.float64), np.ones(high - low + 1)
        least = low + min(shifts)
        table = _each_law(np.arange(least, high + max(shifts) + 1, dtype=np.float64))
        covariances = np.zeros((4, lags.size))
        for shift, weight in shifts.items():
            begin = low + shift - least
            covariances += weight * table[:, begin : begin + lags.size]
    else:
        lags, counts = _lags(low, high, [-shift for shift in shifts])
        covariances = np.zeros((4, lags.size))
        for shift, weight in shifts.items():
            covariances += weight * _each_law(lags + shift)
    counts *= np.minimum(np.minimum(terms_first, terms_second), np.minimum(terms_second - lags, terms_first + lags))
    own = _shifts(first, first)
    of_first = _each_law(np.array(list(own), dtype=np.float64)) @ np.array(list(own.values()), np.float64)
    return of_first, covariances @ counts, (covariances * counts) @ covariances.T


def _shifts(first: int, second: int) -> dict[int, int]:
    """Return by how much the phases of two second differences are apart, each with the product of their weights."""
    shifts: dict[int, int] = {}
    for i, a in enumerate((1, -2, 1)):
        for j, b in enumerate((1, -2, 1)):
            shift = j * second - i * first
            shifts[shift] = shifts.get(shift, 0) + a * b
    return shifts


_rule = cache(np.polynomial.legendre.leggauss)
"""Nodes and weights of Gauss and Legendre, asked for with each of thousands of covariances."""


def _lags(low: int, high: int, corners: list[int]) -> tuple[Floats, Floats]:
    """Return lags and weights whose weighted sum is that over every whole lag from `low` to `high`.

    The covariance is smooth but for its corners, at which each lag counts singly. Stretches grow with the distance from
    the nearest corner; a long one is an integral (from half a lag before to half a lag behind it).
    """
    steps = 2.0 ** np.arange(3, math.ceil(math.log2(2 * (high - low))))
    around = np.concatenate([-steps, [0.0, 1.0], steps])
    edges = np.unique(np.concatenate([np.add.outer(corners, around).ravel(), [low, high + 1]]))
    edges = edges[(edges >= low) & (edges <= high + 1)]
    begins, widths = edges[:-1], np.diff(edges)
    short, long = widths <= _SHORT, widths > _SHORT
    counts = widths[short].astype(np.intp)
    singly = np.repeat(begins[short], counts) + np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    nodes, shares = _rule(_NODES)
    middle = begins[long] + (widths[long] - 1.0) / 2.0
    spread = (middle[:, None] + widths[long][:, None] / 2.0 * nodes).ravel()
    weights = (widths[long][:, None] / 2.0 * shares).ravel()
    lags = np.concatenate([singly, spread])
    return lags, np.concatenate([np.ones(lags.size - spread.size), weights])
