"""Dead band of a response: a line on either side of it, and nothing between."""

import math
from collections.abc import Mapping

import numpy as np
from msgspec import Struct

from vcfbench.analysis.arrays import Floats
from vcfbench.errors import ConfigError


class DeadBand(Struct, frozen=True):
    """Slope beyond a dead band, its half width in the unit of the input, and the uncertainty of that by source."""

    slope: float
    half_width: float
    u: Mapping[str, float]


def fit_dead_band(x: Floats, y: Floats, covariances: Mapping[str, Floats]) -> DeadBand:
    """Fit steps of both signs: generalised least squares of one slope, and an edge of its own on either side.

    Inputs within the edges show nothing, hence say no more, and are left out. Where there is no dead band its half
    width comes out as noise of either sign: it is no less likely to be below 0 than above.

    Args:
        x: steps of the input.
        y: what the output did.
        covariances: of `y`, by source.

    Raises:
        ConfigError: too few steps lie beyond the edges.
    """
    total, seen = np.sum(list(covariances.values()), axis=0), np.ones(x.size, dtype=bool)
    sides = np.stack([x > 0.0, x < 0.0], axis=1).astype(np.float64)
    while True:
        if min(np.unique(x[seen & (sign * x > 0.0)]).size for sign in (1.0, -1.0)) < 2:
            raise ConfigError("fewer than two steps to either side lie beyond the dead band: larger steps are needed")
        terms = np.column_stack([x, -sides])[seen]
        weighted = np.linalg.solve(total[np.ix_(seen, seen)], terms).T
        making = np.linalg.solve(weighted @ terms, weighted)
        slope, plus, minus = (making @ y[seen]).tolist()
        beyond = seen & (np.sign(x) * (x - sides @ np.array([plus, minus]) / slope) > 0.0)
        if (beyond == seen).all():
            break
        seen = beyond
    half = 0.5 * (plus - minus) / slope
    per = np.array([-half, 0.5, -0.5]) / slope @ making
    u = {name: math.sqrt(float(per @ each[np.ix_(seen, seen)] @ per)) for name, each in covariances.items()}
    return DeadBand(slope, half, u)
