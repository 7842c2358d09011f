"""Limits of what studies may find: shares of truths within U95, errors over that, allowing for the number of runs."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

SHARES = 0.93, 0.975
"""U95 holds so much of the truths."""
RMS = 0.85, 1.15
CHANCE = 1e-4
"""Probability that a value at a limit is said to be beyond it."""


def scores(found: Iterable[tuple[float, float, float, float | None]]) -> list[float]:
    """Return the errors of some (value, truth, u, U95), over U95 / 1.96: of few records u alone is less than that."""
    return [(value - truth) / (u if u95 is None else u95 / 1.96) for value, truth, u, u95 in found]


def outside(held: Sequence[bool], z: Sequence[float] = ()) -> str:
    """Return what is beyond the limits in words; empty if nothing is.

    Args:
        held: whether U95 held the truth, or a bound was one, in each run.
        z: errors over U95 / 1.96; none of bounds.
    """
    from scipy.stats import binom, chi2  # noqa: PLC0415  # SciPy takes longer to import than all else

    runs, found = len(held), []
    low, high = binom.ppf(CHANCE, runs, SHARES[0]), binom.ppf(1.0 - CHANCE, runs, SHARES[1])
    if not low <= sum(held) <= high:
        found.append(f"{sum(held)} of {runs} hold the truth, {low:.0f} to {high:.0f} should")
    if z:
        rms = math.sqrt(math.fsum(each * each for each in z) / len(z))
        scatter = [math.sqrt(chi2.ppf(tail, len(z)) / len(z)) for tail in (CHANCE, 1.0 - CHANCE)]
        least, most = RMS[0] * scatter[0], RMS[1] * scatter[1]
        if not least <= rms <= most:
            found.append(f"rms z {rms:.2f}, {least:.2f} to {most:.2f} should be")
    return "; ".join(found)
