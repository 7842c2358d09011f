"""Student's t without SciPy, whose import would take longer than the whole analysis."""

from __future__ import annotations

import math
from statistics import NormalDist

__all__ = ["student_t"]

_LARGE_DOF = 200
"""From here on the series of :func:`_expanded` is good to 1e-10."""


def student_t(dof: int, confidence: float = 0.95) -> float:
    """Return the two-sided quantile: a t variable of `dof` degrees of freedom stays within it with `confidence`."""
    if dof < 1:
        raise ValueError(f"at least one degree of freedom is needed, got {dof}")
    if dof >= _LARGE_DOF:
        return _expanded(NormalDist().inv_cdf(0.5 + confidence / 2.0), dof)
    low, high = 0.0, math.pi / 2.0
    for _ in range(60):
        middle = (low + high) / 2.0
        low, high = (middle, high) if _inside(middle, dof) < confidence else (low, middle)
    return math.sqrt(dof) * math.tan(low)


def _inside(angle: float, dof: int) -> float:
    """Return P(|t| < sqrt(dof) * tan(angle)); Abramowitz and Stegun 26.7.3 and 26.7.4."""
    cosine, sine = math.cos(angle), math.sin(angle)
    odd = dof % 2 == 1
    term = cosine if odd else 1.0
    total = 0.0
    for k in range(1 + odd, dof, 2):
        total += term
        term *= cosine * cosine * k / (k + 1)
    return (angle + sine * total) * 2.0 / math.pi if odd else sine * total


def _expanded(normal: float, dof: int) -> float:
    """Return the t quantile from the normal one; Abramowitz and Stegun 26.7.5."""
    z = normal
    terms = (
        z,
        (z**3 + z) / 4,
        (5 * z**5 + 16 * z**3 + 3 * z) / 96,
        (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / 384,
        (79 * z**9 + 776 * z**7 + 1482 * z**5 - 1920 * z**3 - 945 * z) / 92160,
    )
    return math.fsum(term / math.pow(dof, power) for power, term in enumerate(terms))
