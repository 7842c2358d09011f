"""Even and odd parts of a calibration: which imperfection of a chain a residual pattern speaks for.

A pair of rates +w and -w gives the chopped scale factor (y(+w) - y(-w)) / 2w, free of bias and of every even term,
and the even part (y(+w) + y(-w)) / 2, which holds exactly those.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike

from vcfbench.analysis.regression import checked_points


class Pair(Struct, frozen=True):
    """Chopped scale factor and even part of the points at +`rate_deg_s` and -`rate_deg_s`."""

    rate_deg_s: float
    scale_factor: float
    """Chopped scale factor, V/(deg/s)."""
    even_v: float
    """Half the sum of the two outputs, V."""


def sign_pairs(rate_deg_s: ArrayLike, output_v: ArrayLike) -> list[Pair]:
    """Return the pairs by falling magnitude; outputs measured repeatedly at one rate are averaged first."""
    rate, output = checked_points(rate_deg_s, output_v)
    rates = np.array(sorted(set(rate.tolist())))  # np.unique would load numpy.ma
    place = np.searchsorted(rates, rate)
    means = np.bincount(place, weights=output) / np.bincount(place)
    positive = rates[::-1][rates[::-1] > 0.0]
    opposite = np.searchsorted(rates, -positive)
    paired = rates[opposite] == -positive
    plus = means[np.searchsorted(rates, positive[paired])]
    minus = means[opposite[paired]]
    columns = (positive[paired], (plus - minus) / (2.0 * positive[paired]), (plus + minus) / 2.0)
    return [Pair(*values) for values in zip(*(column.tolist() for column in columns), strict=True)]
