"""K_Vc as a curve: the rate that a V_Vc stands for, ``k0 + k1 V + k2 V^2 + k3 V^3``, from matched pairs of both signs.

At each rate of the table the V_Vc is found that gives the same output, zeros subtracted. Both have uncertainties, some
in common (gain and offset of the meter, of the table). The fit is generalised least squares with errors in both, as in
ISO 6143 for calibration gases. k1 is K_Vc for small signals, k2 and k3 are the modulator's even and odd curvature.
"""

import math
from collections.abc import Mapping

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike

from vcfbench.analysis.arrays import Floats
from vcfbench.errors import ConfigError
from vcfbench.values.quantile import chi_square_tail

_ROUNDS = 50
_SETTLED = 1e-6
"""A change of every coefficient by less than that of its uncertainty is none."""


class Curvature(Struct, frozen=True):
    """The modulator's own curve: it acts as ``V + second_per_v V^2 + third_per_v2 V^3``."""

    second_per_v: float
    u_second_per_v: float
    third_per_v2: float
    u_third_per_v2: float


class KVcCurve(Struct, frozen=True):
    """A fitted curve; its uncertainty comes from the measured pairs, not from the fit."""

    coefficients: tuple[float, ...]
    """k0, k1, ... in (deg/s)/V^i."""
    covariance: tuple[tuple[float, ...], ...]
    """Covariance of the coefficients."""
    v_vc_low_v: float
    v_vc_high_v: float
    """Least and largest matched V_Vc, between which the curve holds."""
    residuals_deg_s: tuple[float, ...]
    """Rate less curve at the measured V_Vc, in the order of the pairs."""
    chi_square: float
    dof: int
    lack_of_fit_p: float | None
    """Probability of residuals as large or larger if the curve is right; below 0.01 it is not. None without dof."""
    lack_of_fit_deg_s: float
    """Root mean square of the residuals beyond their uncertainties; it is in no uncertainty."""

    @property
    def k_vc(self) -> float:
        """K_Vc of small signals, (deg/s)/V."""
        return self.coefficients[1]

    def curvature(self) -> Curvature:
        """Return the modulator's curve, with k1 as its unit; raises ConfigError for a fit below the third order."""
        if len(self.coefficients) < 4:
            raise ConfigError(f"a fit of order {len(self.coefficients) - 1} has no second and third order")
        k = np.array(self.coefficients)
        covariance = np.array(self.covariance)
        found = []
        for place in (2, 3):
            gradient = np.zeros(k.size)
            gradient[1], gradient[place] = -k[place] / k[1] ** 2, 1.0 / k[1]
            found += [float(k[place] / k[1]), math.sqrt(gradient @ covariance @ gradient)]
        return Curvature(*found)


def covariance_of(values: ArrayLike, u: ArrayLike, u_gain: float = 0.0, u_offset: float = 0.0) -> Floats:
    """Return the covariance of readings of one instrument.

    Args:
        values: the readings.
        u: standard uncertainty of each by itself (or one for all), in their unit.
        u_gain: relative standard uncertainty that all share.
        u_offset: standard uncertainty of an offset that all share.
    """
    read = np.asarray(values, dtype=np.float64)
    alone = np.broadcast_to(np.asarray(u, dtype=np.float64), read.shape) ** 2
    return np.asarray(np.diag(alone) + u_gain**2 * np.outer(read, read) + u_offset**2)


def fit_k_vc_curve(
    rate_deg_s: ArrayLike, v_vc_v: ArrayLike, rate_covariance: ArrayLike, v_vc_covariance: ArrayLike, order: int = 3
) -> KVcCurve:
    """Fit the curve to matched pairs.

    Args:
        rate_deg_s: rates of the table, of both signs.
        v_vc_v: V_Vc, as measured, with the same zero-subtracted output.
        rate_covariance: of the rates, with what the matching of the outputs leaves; see :func:`covariance_of`.
        v_vc_covariance: of the V_Vc.
        order: of the polynomial.

    Raises:
        ConfigError: fewer pairs than coefficients, rates of one sign, covariances that are none, or no solution.
    """
    rate, v = np.asarray(rate_deg_s, dtype=np.float64), np.asarray(v_vc_v, dtype=np.float64)
    if rate.ndim != 1 or rate.shape != v.shape or order < 1 or rate.size < order + 1:
        raise ConfigError(f"{rate.size} rates and {v.size} V_Vc do not determine a curve of order {order}")
    if not (np.isfinite(rate).all() and np.isfinite(v).all()):
        raise ConfigError("a rate or a V_Vc is not a finite number")
    if not (rate.min() < 0.0 < rate.max() and v.min() < 0.0 < v.max()):
        raise ConfigError("pairs of both signs are needed: from one sign alone the even order goes into K_Vc")
    if len(set(v.tolist())) < order + 1:
        raise ConfigError(f"{len(set(v.tolist()))} different V_Vc do not determine a curve of order {order}")
    scale = float(np.abs(v).max())
    of_rate = _covariance(rate_covariance, rate.size, "rate")
    of_v = _covariance(v_vc_covariance, v.size, "V_Vc") / scale**2
    found, covariance, weight = _solve(rate, v / scale, of_rate, of_v, order)
    units = scale ** np.arange(order + 1)
    powers = np.vander(v / scale, order + 1, increasing=True)
    residuals = rate - powers @ found
    chi_square = float(residuals @ weight @ residuals)
    dof = rate.size - order - 1
    # The root of the mean square of the residuals beyond that which their uncertainties leave after the fit
    expected = np.linalg.inv(weight) - powers @ covariance @ powers.T
    beyond = float(residuals @ residuals) - float(np.trace(expected))
    return KVcCurve(
        coefficients=tuple((found / units).tolist()),
        covariance=tuple(tuple(row) for row in (covariance / np.outer(units, units)).tolist()),
        v_vc_low_v=float(v.min()),
        v_vc_high_v=float(v.max()),
        residuals_deg_s=tuple(residuals.tolist()),
        chi_square=chi_square,
        dof=dof,
        lack_of_fit_p=chi_square_tail(chi_square, dof) if dof > 0 else None,
        lack_of_fit_deg_s=math.sqrt(max(0.0, beyond) / residuals.size),
    )


def covariance_parts(
    curve: KVcCurve, v_vc_v: ArrayLike, of_rate: Mapping[str, ArrayLike], of_v_vc: Mapping[str, ArrayLike]
) -> dict[str, Floats]:
    """Return the contribution of each source to the covariance of the coefficients; their sum is that covariance.

    Args:
        curve: the fit.
        v_vc_v: V_Vc of its pairs.
        of_rate: sources by name, each with its part of the rates' covariance.
        of_v_vc: the same of V_Vc.

    Raises:
        ConfigError: the parts are all zero, or depend on each other completely.
    """
    v = np.asarray(v_vc_v, dtype=np.float64)
    slope = _slope(np.array(curve.coefficients), v)
    through = np.outer(slope, slope)
    parts = {name: np.asarray(part, dtype=np.float64) for name, part in of_rate.items()}
    parts |= {name: np.asarray(part, dtype=np.float64) * through for name, part in of_v_vc.items()}
    making = coefficient_weights(curve, v, sum(parts.values(), start=np.zeros((v.size, v.size))))
    return {name: making @ part @ making.T for name, part in parts.items()}


def coefficient_weights(curve: KVcCurve, v_vc_v: ArrayLike, covariance: ArrayLike) -> Floats:
    """Return the weight of each pair's rate in each coefficient, (coefficients, pairs).

    Args:
        curve: the fit.
        v_vc_v: V_Vc of its pairs.
        covariance: of the rates, that of V_Vc through the curve's slope in it.

    Raises:
        ConfigError: the covariance is zero or singular.
    """
    v = np.asarray(v_vc_v, dtype=np.float64)
    scale = float(np.abs(v).max())
    powers = np.vander(v / scale, len(curve.coefficients), increasing=True)
    weighted = powers.T @ _inverse(np.asarray(covariance, dtype=np.float64))
    making = _inverse(weighted @ powers) @ weighted
    return np.asarray(making / (scale ** np.arange(powers.shape[1]))[:, None])


def _covariance(given: ArrayLike, count: int, what: str) -> Floats:
    matrix = np.asarray(given, dtype=np.float64)
    if matrix.shape != (count, count) or not np.allclose(matrix, matrix.T) or (np.diag(matrix) < 0.0).any():
        raise ConfigError(f"the covariance of the {what} must be symmetric, {count} by {count}, got {matrix.shape}")
    return matrix


def _inverse(matrix: Floats) -> Floats:
    try:
        return np.asarray(np.linalg.inv(matrix), np.float64)
    except np.linalg.LinAlgError as error:
        raise ConfigError("the uncertainties of the pairs are zero or depend on each other completely") from error


def _slope(coefficients: Floats, v: Floats) -> Floats:
    return np.asarray(np.polynomial.polynomial.polyval(v, np.polynomial.polynomial.polyder(coefficients)))


def _solve(rate: Floats, v: Floats, of_rate: Floats, of_v: Floats, order: int) -> tuple[Floats, Floats, Floats]:
    """Return coefficients, covariance and the inverse covariance of the residuals: most likely true V_Vc included.

    Gauss and Newton about the adjusted V_Vc: there the curve is linear in what it is still off.
    """
    adjusted = v.copy()
    found: Floats = np.asarray(
        np.linalg.lstsq(np.vander(v, order + 1, increasing=True), rate, rcond=None)[0], np.float64
    )
    for _ in range(_ROUNDS):
        powers, slope = np.vander(adjusted, order + 1, increasing=True), _slope(found, adjusted)
        weight = _inverse(of_rate + of_v * np.outer(slope, slope))
        covariance = _inverse(powers.T @ weight @ powers)
        target = rate - slope * (v - adjusted)
        step = covariance @ powers.T @ weight @ target - found
        found = found + step
        left = target - powers @ found
        adjusted = v + of_v @ (slope * (weight @ left))
        if (np.abs(step) <= _SETTLED * np.sqrt(np.diag(covariance))).all():
            return found, covariance, weight
    raise ConfigError("the curve of K_Vc does not settle: the uncertainties of V_Vc are as large as the V_Vc")
