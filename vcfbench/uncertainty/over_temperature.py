"""A value over temperature: a parabola with its coefficients and their uncertainties, and the hysteresis."""

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from vcfbench.analysis.arrays import Floats
from vcfbench.errors import ConfigError
from vcfbench.uncertainty.measurand import measurand
from vcfbench.values.quantile import t_of_largest
from vcfbench.values.value import Measurand, UncertaintyPart


class Temperatures(Struct, frozen=True):
    """Temperatures of some values, degC, shape (n,), and whether each was come to from below.

    `u_alike_k` is how far all may be off alike, `u_each_k` each by itself, standard uncertainties.
    """

    at_c: Floats
    rising: Sequence[bool]
    reference_c: float
    u_alike_k: float = 0.0
    u_each_k: float = 0.0
    near_k: float = 0.5
    """Difference up to which two temperatures, one from below and one from above, are compared."""


class Cause(Struct, frozen=True):
    """Common error of the values at all temperatures by one source: its covariance, degrees of freedom.

    `floor` is what it does to a mean, where the covariance is that of differences alone (flicker); else None.
    """

    source: str
    covariance: Floats
    dof: float | None = None
    floor: float | None = None


class Parabola(Struct, frozen=True):
    """A parabola: value, slope and curvature at the reference, the largest hysteresis, and the residuals."""

    value: Measurand
    tc: Measurand
    tc2: Measurand
    hysteresis: Measurand | None
    lack_of_fit: float | None


def over_temperature(
    temperatures: Temperatures, values: Sequence[float], causes: Sequence[Cause], unit: str
) -> Parabola:
    """Fit a parabola by least squares; the coefficients are in the unit of the values."""
    return _parabola(temperatures, values, causes, unit)


def relative_over_temperature(
    temperatures: Temperatures, values: Sequence[float], causes: Sequence[Cause], unit: str
) -> Parabola:
    """Fit a parabola by least squares; the coefficients are in ppm of the value at the reference, as it is stated."""
    return _parabola(temperatures, values, causes, unit, per="ppm")


def _parabola(
    temperatures: Temperatures, values: Sequence[float], causes: Sequence[Cause], unit: str, per: str = ""
) -> Parabola:
    at = temperatures.at_c - temperatures.reference_c
    powers = np.vander(at, 3, increasing=True)
    if np.linalg.matrix_rank(powers) < 3:
        raise ConfigError("expected readings at three different temperatures or more")
    making, y = np.linalg.pinv(powers), np.array(values)
    found = making @ y
    moves = np.vander(at, 2, increasing=True) @ (found[1:] * (1.0, 2.0))
    each_k = np.diag((moves * temperatures.u_each_k) ** 2)
    known = [*causes, *([Cause("temperatures, each by itself", each_k)] if temperatures.u_each_k else [])]
    moved = np.array([found[1], 2.0 * found[2], 0.0])
    factor, of = (1e6 / float(found[0]), found / found[0]) if per else (1.0, np.zeros(3))

    def made(number: int, unit: str, factor: float, of: float) -> Measurand:
        """Return a coefficient, or `of` what it is of the value: that moves with it."""
        weights, alike = making[number] - of * making[0], float(moved[number] - of * moved[0])
        parts = [_part(cause, weights, factor, mean=number == 0) for cause in known]
        parts.append(UncertaintyPart("temperature, the same at all", abs(factor * alike) * temperatures.u_alike_k))
        held = [part for part in parts if part.u > 0.0]
        return measurand(float(factor * found[number]), unit, held)

    rest, free, units = y - powers @ found, len(values) - 3, f"({per or unit})" if "/" in (per or unit) else per or unit
    return Parabola(
        made(0, unit, 1.0, 0.0),
        made(1, f"{units}/K", factor, float(of[1])),
        made(2, f"{units}/K^2", factor, float(of[2])),
        _hysteresis(temperatures, y, powers @ found, known, (per or unit, factor)),
        None if free <= 0 else float(abs(factor) * math.sqrt(float(rest @ rest) / free)),
    )


def _part(cause: Cause, weights: Floats, factor: float, *, mean: bool) -> UncertaintyPart:
    """Return the contribution of a cause to a combination of the values."""
    variance = max(0.0, float(weights @ cause.covariance @ weights))
    u = cause.floor if mean and cause.floor is not None else math.sqrt(variance)
    dof = None if cause.dof is None or math.isinf(cause.dof) else cause.dof
    return UncertaintyPart(cause.source, abs(factor) * u, dof)


def _hysteresis(
    temperatures: Temperatures, values: Floats, fitted: Floats, causes: Sequence[Cause], units: tuple[str, float]
) -> Measurand | None:
    """Return the largest difference of going down less going up at one temperature, the parabola taken off.

    Its expanded uncertainty is one that all of them keep together. Where one is seen beyond its own, it is the largest
    of those; else the one that could be the largest.
    """
    unit, factor = units
    found: dict[bytes, Measurand] = {}
    at_c, rising = temperatures.at_c, np.array(temperatures.rising)
    for here_c in at_c:
        near = np.abs(at_c - here_c) <= temperatures.near_k
        down, up = (near & ~rising).astype(float), (near & rising).astype(float)
        if down.any() and up.any():
            weights = down / down.sum() - up / up.sum()
            parts = [_part(cause, weights, factor, mean=False) for cause in causes]
            difference = float(factor * (weights @ values - weights @ fitted))
            found[weights.tobytes()] = measurand(difference, unit, [each for each in parts if each.u > 0.0])
    together = []
    for each in found.values():
        factor = t_of_largest(len(found), math.inf if each.dof is None else each.dof)
        together.append(replace(each, u95=factor * each.u))
    if beyond := [each for each in together if abs(each.value) > each.u95]:
        return max(beyond, key=lambda each: abs(each.value))
    return max(together, key=most, default=None)


def most(difference: Measurand) -> float:
    """Return the size that a difference stays below with 95 %."""
    return abs(difference.value) + difference.u95
