"""Correlation of successive readings within windows, and its effect on their means.

A gyroscope whose noise is slow, as by a narrow mode, gives readings that are not independent of each other: their
scatter over the root of their number is too little for a mean. Of readings that remember the last one by the share
`rho` the variance of a mean is (1 + rho) / (1 - rho) as large (Bartlett 1946, J. R. Stat. Soc. B 8, 27). Flicker that
outweighs the white noise within a window counts as such a memory too, beside its own part of a budget.
"""

import math
from collections.abc import Sequence
from functools import cache
from operator import mul

from msgspec import Struct

from vcfbench.values.quantile import t_quantile

_FEWEST_READINGS, _MOST_READINGS = 5, 32
"""Of a piece of a window: fewer tell nothing, more need no larger matrix."""
_FEWEST_PIECES = 8
"""So many scatter enough to be tested by their own scatter."""
_CHANCE = 1e-4
"""Chance that independent readings are taken for correlated ones."""
_LEAST_SIGMAS = 3.71
"""That of a normal distribution, which Student's is not below."""
_ALIKE = 1e-4
"""Variance of a piece's correlation below which all are alike: something moves the readings that is no noise."""
_RHOS = tuple(math.tanh(place / 40.0) for place in range(121))
"""Correlations that are told from each other; the largest is 0.995."""


class Correlation(Struct):
    """Correlation of each reading with the next one, window after window."""

    growth: float = 1.0
    """Factor of the variance of means; 1 where no correlation stands out of its own scatter."""
    pieces: int = 0
    excess: float = 0.0
    """Sum over pieces of the correlation about their means, less that of independent readings."""
    squares: float = 0.0
    """Sum of its squares."""
    products_v2: float = 0.0
    """Products of neighbours, all pieces together."""
    variance_v2: float = 0.0
    """Squares, likewise."""

    def add(self, readings_v: Sequence[float]) -> None:
        """Add the readings of one window, V; a window with few digits is ignored."""
        count = len(readings_v)
        if count < _FEWEST_READINGS or 2 * len(set(readings_v)) < count:
            return
        size = count // math.ceil(count / _MOST_READINGS)
        for first in range(0, count - size + 1, size):
            piece = readings_v[first : first + size]
            mean_v = math.fsum(piece) / size
            off = [each - mean_v for each in piece]
            products, squares = math.fsum(map(mul, off, off[1:])), math.fsum(map(mul, off, off))
            excess = products / squares + 1.0 / size  # of independent ones about their mean it is -1 / n
            self.pieces += 1
            self.excess += excess
            self.squares += excess * excess
            self.products_v2 += products
            self.variance_v2 += squares
        self.growth, mean = 1.0, self.excess / self.pieces
        variance = (self.squares - self.pieces * mean**2) / max(1, self.pieces - 1)
        if self.pieces < _FEWEST_PIECES or variance < _ALIKE:
            return
        sigmas = mean / math.sqrt(variance / self.pieces)
        if sigmas < _LEAST_SIGMAS or sigmas < t_quantile(2.0 * _CHANCE, self.pieces - 1):
            return
        import numpy as np  # noqa: PLC0415  # commands that measure nothing come here as well, and take longer by it

        rho = float(np.interp(self.products_v2 / self.variance_v2, _expected(size), _RHOS))
        # The mean of few readings is not all that they remember, and their scatter about it too little
        whole = (1.0 + rho) / (1.0 - rho) - 2.0 * rho * (1.0 - rho**count) / (count * (1.0 - rho) ** 2)
        self.growth = whole * (count - 1) / (count - whole)


@cache
def _expected(size: int) -> tuple[float, ...]:
    """Return products of neighbours over squares, about the mean of `size` readings, expected for each of `_RHOS`."""
    import numpy as np  # noqa: PLC0415  # as above

    at = np.arange(size)
    left = np.eye(size) - 1.0 / size
    products = left @ (np.eye(size, k=1) + np.eye(size, k=-1)) @ left / 2.0
    covariances = np.power(np.reshape(_RHOS, (-1, 1, 1)), np.abs(at[:, None] - at))
    over = np.einsum("ij,kji->k", products, covariances) / np.einsum("ij,kji->k", left, covariances)
    return tuple(over.tolist())
