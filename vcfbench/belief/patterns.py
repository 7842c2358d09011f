"""Faults as patterns in time in a series of windows: the test of each, and its smallest detectable size.

A pattern is an offset from one window to another, or a walk from one on, in volts or in shares of what is read (a gain
that changes). Its size by generalised least squares over its standard uncertainty is a test for each pattern (Willsky
and Jones 1976, *A generalized likelihood ratio approach to detection and estimation of jumps in linear systems*).
"""

from collections.abc import Iterator, Mapping

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from vcfbench.analysis.arrays import Floats

MOST_WINDOWS = 4000
"""Windows that are held against each other: 0.7 GB of memory."""
ONE_SIDED = 1.645
"""Quantile of the normal distribution for 95 %: what is found is as far from what is there as its noise has it."""
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
    count: int
    """Number of windows."""
    begin: NDArray[np.int32]
    end: NDArray[np.int32]
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
            return Pattern(place - len(self.begin) + 1, self.count - 1, walks=True)
        return Pattern(int(self.begin[place]), int(self.end[place]) - 1, walks=False)


def patterns_of(
    series: Floats, free: Floats, covariance: Floats, at_s: Floats, scales: Mapping[str, Floats]
) -> Iterator[Patterns]:
    """Yield the patterns of each of `scales` in a series of means; each takes memory with the square of the windows.

    Args:
        series: the means, (n,).
        free: terms that the series may have of any size, (n, k), k < n.
        covariance: how the means may be off these terms, (n, n).
        at_s: the middles of the windows, s, (n,).
        scales: what each window has of a pattern of size 1, by its unit: ones for volts, the means for a gain, (n,);
            or where it has some of what another is moved by, (n, n).

    Raises:
        LinAlgError: the covariance is none.
        MemoryError: the windows are too many.
    """
    count = series.size
    if count > MOST_WINDOWS:
        raise MemoryError(f"{count} windows, at most {MOST_WINDOWS} are held against each other")
    left = np.linalg.inv(np.linalg.cholesky(covariance))
    basis, _ = np.linalg.qr(left @ free)
    of_terms = basis.T @ left
    left -= basis @ of_terms  # what the free terms leave of each window
    series = left @ series
    later = np.triu(np.ones((count + 1, count + 1), dtype=bool), 1)
    begin, end = (
        np.asarray(np.delete(each, count - 1), np.int32) for each in np.nonzero(later)
    )  # all together are the bias
    for unit, scale in scales.items():
        steps, walks = _in_time(left @ scale if scale.ndim > 1 else left * scale, at_s)
        along = series @ steps
        along = np.concatenate([along[begin] - along[end], series @ walks])
        shows = np.concatenate([_squares(steps.T @ steps, begin, end), np.square(walks).sum(axis=0)])
        del steps, walks
        taken, walked = _in_time(of_terms @ scale if scale.ndim > 1 else of_terms * scale, at_s)
        of_all = np.concatenate([_squares(taken.T @ taken, begin, end), np.square(walked).sum(axis=0)])
        of_all += shows
        seen = shows > _UNSEEN * of_all
        yield Patterns(unit, count, begin, end, np.where(seen, along, 0.0), np.where(seen, shows, 0.0))


def _in_time(windows: Floats, at_s: Floats) -> tuple[Floats, Floats]:
    """Return the steps, (k, n + 1), and the walks, (k, n - 2), of columns that are windows, (k, n).

    A step goes from its window to the end; a stretch is the difference of two, so that there are as many columns as
    windows. A walk is 0 up to its window, then linear, 1 if from the first to the last: a sum of steps.
    """
    steps = np.zeros((len(windows), at_s.size + 1))
    np.cumsum(windows[:, ::-1], axis=1, out=steps[:, -2::-1])
    lasts_s = max(float(at_s[-1] - at_s[0]), 1e-9)
    grown = steps[:, 1:-1] * (np.diff(at_s) / lasts_s)
    np.cumsum(grown[:, ::-1], axis=1, out=grown[:, ::-1])
    return steps, grown[:, : max(0, at_s.size - 2)]


def _squares(products: Floats, begin: NDArray[np.int32], end: NDArray[np.int32]) -> Floats:
    """Return the squares of all stretches, by the products of the steps that they begin and end with.

    Of the differences of two columns: a column for each pair needs memory with the cube of the windows.
    """
    own = products.diagonal()
    return np.asarray(own[begin] + own[end] - 2.0 * products[begin, end])
