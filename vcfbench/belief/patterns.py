"""Faults as patterns in time in a series of windows: each tested, and the smallest that the test would have found.

A pattern is an offset from one window to another, or a walk from one on, in volts or in shares of what is read (a gain
that changes). Its size by generalised least squares over its standard uncertainty is a test for each pattern (Willsky
and Jones 1976, *A generalized likelihood ratio approach to detection and estimation of jumps in linear systems*).
"""

from collections.abc import Mapping

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from vcfbench.analysis.arrays import Floats

_UNSEEN = 1e-4
"""A pattern of which the free terms leave less than this share (of its square) is not asked for."""


class Pattern(Struct, frozen=True):
    """A pattern in time: from window `first` to `last`, both included; it `walks` to the end, or is an offset."""

    first: int
    last: int
    walks: bool


class Patterns(Struct, frozen=True):
    """Patterns of one series and one unit: all stretches of windows but the whole, then the walks.

    `along` is what is left of the series along what the free terms leave of each pattern, in standard uncertainties
    times the root of `shows`, (m,); `shows` is the square of what they leave, 0 where that is too little to ask for.
    """

    unit: str
    in_time: Floats
    """(n, n + 1 + n - 2): the steps and walks in time that patterns are made of."""
    begin: NDArray[np.intp]
    end: NDArray[np.intp]
    along: Floats
    shows: Floats

    @property
    def sigmas(self) -> Floats:
        """Size of each pattern over its standard uncertainty, (m,); 0 of those that are not asked for."""
        return np.asarray(self.along / np.sqrt(np.where(self.shows > 0.0, self.shows, np.inf)))

    @property
    def sizes(self) -> Floats:
        """Size of each pattern, in its unit, (m,)."""
        return np.asarray(self.along / np.where(self.shows > 0.0, self.shows, np.inf))

    def smallest(self, sigmas: float) -> Floats:
        """Return the size at which each pattern is so many standard uncertainties, (m,); infinite if never."""
        return np.asarray(
            sigmas * np.divide(1.0, np.sqrt(self.shows), out=np.full(self.shows.shape, np.inf), where=self.shows > 0.0)
        )

    def pattern(self, place: int) -> Pattern:
        """Return one of them by its place."""
        if place >= len(self.begin):
            return Pattern(place - len(self.begin) + 1, self.in_time.shape[0] - 1, walks=True)
        return Pattern(int(self.begin[place]), int(self.end[place]) - 1, walks=False)


def walks_of(at_s: Floats) -> Floats:
    """Return the walks, (n, n - 2), a column each: 0 up to a window, then linear, 1 if from the first to the last."""
    lasts_s = max(float(at_s[-1] - at_s[0]), 1e-9)
    return np.asarray(np.maximum(0.0, at_s[:, None] - at_s[: max(0, at_s.size - 2)]) / lasts_s)


def patterns_of(
    series: Floats, free: Floats, covariance: Floats, at_s: Floats, scales: Mapping[str, Floats]
) -> list[Patterns]:
    """Return the patterns of each of `scales` in a series of means.

    Args:
        series: the means, (n,).
        free: terms that the series may have of any size, (n, k), k < n.
        covariance: how the means may be off these terms, (n, n).
        at_s: the middles of the windows, s, (n,).
        scales: what each window has of a pattern of size 1, by its unit: ones for volts, the means for a gain, (n,);
            or where it has some of what another is moved by, (n, n).

    Raises:
        LinAlgError: the covariance is none.
    """
    count, terms = series.size, free.shape[1]
    # A stretch is the difference of two steps, so that there are as many columns as windows
    in_time = np.column_stack([np.arange(count)[:, None] >= np.arange(count + 1), walks_of(at_s)])
    columns = np.column_stack(
        [free, series, *(each @ in_time if each.ndim > 1 else each[:, None] * in_time for each in scales.values())]
    )
    whitened = np.linalg.solve(np.linalg.cholesky(covariance), columns)
    basis, _ = np.linalg.qr(whitened[:, :terms])
    rest = whitened[:, terms:]
    left = rest - basis @ (basis.T @ rest)
    begin, end = (np.delete(each, count - 1) for each in np.triu_indices(count + 1, 1))  # all together are the bias
    found = []
    for at, unit in enumerate(scales):
        own = slice(1 + at * in_time.shape[1], 1 + (at + 1) * in_time.shape[1])
        shows, of_all = _squares(left[:, own], begin, end), _squares(rest[:, own], begin, end)
        along = left[:, 0] @ left[:, own]
        along = np.concatenate([along[begin] - along[end], along[count + 1 :]])
        seen = shows > _UNSEEN * of_all
        found.append(Patterns(unit, in_time, begin, end, np.where(seen, along, 0.0), np.where(seen, shows, 0.0)))
    return found


def _squares(columns: Floats, begin: NDArray[np.intp], end: NDArray[np.intp]) -> Floats:
    """Return the squares of all patterns, by the columns of the steps that they begin and end with, and of the walks.

    Of the differences of two columns: a column for each pair needs memory with the cube of the windows.
    """
    steps, walks = np.split(columns, [int(end.max()) + 1], axis=1)
    products, own = steps.T @ steps, np.square(steps).sum(axis=0)
    return np.concatenate([own[begin] + own[end] - 2.0 * products[begin, end], np.square(walks).sum(axis=0)])
