"""K_Vc of a four-step calibration from null comparisons at rates of both signs: half a difference, or a curve.

Rates are those relative to V_Vc = 0: ``rate = sum of c_p V^p`` for p from 1. From one pair of rates there is c_1 alone,
K_Vc, out of which the half difference keeps the modulator's even order. What a curve calls k0 is not used.
"""

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.chopped import CHOPPED, DIFFERENCES
from vcfbench.analysis.k_vc_curve import KVcCurve, coefficient_weights, fit_k_vc_curve
from vcfbench.errors import ConfigError
from vcfbench.instructions.schedule import KvcBy
from vcfbench.procedures.null_comparison.blocks import block_covariance, blocks_of, noise_of, nulled_levels
from vcfbench.procedures.null_comparison.plan import block
from vcfbench.procedures.virtual_coriolis.settings import VirtualCoriolisSettings
from vcfbench.records.schema import Point

TABLE, DRIVEN = 1, 2
"""The steps of the four whose windows are blocks; the search has a number of its own."""

_ORDER = 3


class NullMatching(Struct, frozen=True):
    """Result of the null comparisons; arrays go over the pairs, +r1, -r1, +r2, ..., or over all windows."""

    match_rate_deg_s: float
    rate_deg_s: Floats
    v_vc_v: Floats
    """With the same zero-subtracted output as on the table."""
    taken_v: Floats
    """V_Vc at which the windows were taken: near an end of a generator's range it may be some per cent away."""
    left_v: Floats
    """Difference left between the two outputs."""
    per_deg_s: Floats
    """Output per rate there, V/(deg/s)."""
    left_weights: Floats
    """(pairs, windows): how the outputs of the windows make `left_v`."""
    coefficients: Floats
    """c_1, c_2, ...: (deg/s)/V^p."""
    weights: Floats
    """(coefficients, pairs): weight of each pair's rate in each coefficient."""
    readings: Floats
    """Number of readings of each window."""
    curve: KVcCurve | None

    @property
    def k_vc(self) -> float:
        """K_Vc, (deg/s)/V: half the difference of the matches, or that of small signals of the curve."""
        return float(self.coefficients[0])

    @property
    def v_vc_equal_v(self) -> float:
        """V_Vc that stands for the matching rate, V."""
        return self.level_for(self.match_rate_deg_s)

    @property
    def residual_v(self) -> float:
        """The largest difference left between two outputs, V; it is interpolated."""
        return float(self.left_v[np.abs(self.left_v).argmax()])

    @property
    def slope(self) -> float:
        """Output over V_Vc (V/V), of small signals."""
        return float(self.per_deg_s.mean()) * self.k_vc

    @property
    def residuals_deg_s(self) -> Floats:
        """Rate less that of its V_Vc, of each pair."""
        return np.asarray(self.rate_deg_s - np.array([self.rate_of(volts) for volts in self.v_vc_v]))

    def rate_of(self, v_vc_v: float) -> float:
        """Return the rate that a V_Vc stands for, deg/s."""
        return float(np.polynomial.polynomial.polyval(v_vc_v, [0.0, *self.coefficients]))

    def slope_of(self, v_vc_v: Floats) -> Floats:
        """Return the slope of that rate with V_Vc, (deg/s)/V."""
        derivative = np.polynomial.polynomial.polyder(np.array([0.0, *self.coefficients]))
        return np.asarray(np.polynomial.polynomial.polyval(v_vc_v, derivative) + 0.0 * v_vc_v)

    def level_for(self, rate_deg_s: float) -> float:
        """Return the V_Vc that stands for a rate, V, by Newton's method: the curve is nearly straight.

        ConfigError: it is not.
        """
        level_v = rate_deg_s / self.k_vc
        for _ in range(50):
            off = self.rate_of(level_v) - rate_deg_s
            if abs(off) <= 1e-12 * max(1.0, abs(rate_deg_s)):
                return level_v
            level_v -= off / float(self.slope_of(np.array([level_v]))[0])
        raise ConfigError(f"the curve of K_Vc does not reach {rate_deg_s:g} deg/s")

    @property
    def noise_weights(self) -> Floats:
        """(coefficients, windows): change of the coefficients by a volt at the output of each window."""
        return np.asarray((self.weights / self.per_deg_s) @ self.left_weights)

    def u_k_vc(self, std_v: float, common_v: float) -> float:
        """Return the standard uncertainty of K_Vc by noise and resolution, (deg/s)/V; see :meth:`Matching.u_k_vc`."""
        u_v = np.hypot(std_v / np.sqrt(self.readings), common_v)
        return float(np.linalg.norm(self.noise_weights[0] * u_v))


def null_matching(settings: VirtualCoriolisSettings, points: Sequence[Point]) -> NullMatching:
    """Do the arithmetic of the null comparisons; ConfigError: they are no whole blocks, or do not determine a curve."""
    magnitudes, cycles = settings.magnitudes_deg_s, settings.null_cycles
    rate = np.array([sign * size for size in magnitudes for sign in (1.0, -1.0)])
    table, driven = (_differences(points, step, len(magnitudes), cycles) for step in (TABLE, DRIVEN))
    outputs, known_v = (np.array([getattr(p, name) for p in points]) for name in ("output_v", "v_vc_v"))
    left_v = (driven - table) @ outputs
    zeros = [p.v_vc_v for p in points if p.step == DRIVEN and p.rate_deg_s == 0.0]
    zero_v = math.fsum(zeros) / len(zeros)
    at_v = np.where(driven > 0.0, driven, 0.0) @ known_v  # the level's windows add up to 1, its zeros are below 0
    moved_v = driven @ outputs
    equal_v, per_v = nulled_levels(at_v, zero_v, moved_v, left_v)
    curve: KVcCurve | None = None
    if settings.k_vc_by is KvcBy.PLUS_MINUS:
        weights = np.array([[1.0, -1.0]]) / (equal_v[0] - equal_v[1])
        coefficients = weights @ rate
        per_deg_s = per_v / coefficients
    else:
        matched = [p for p in points if p.step in {TABLE, DRIVEN}]
        noise = noise_of(settings, [block(each) for each in blocks_of(matched)], matched)
        on_table = np.polynomial.Polynomial.fit(rate, table @ outputs, 3).convert()
        per_deg_s = np.asarray(np.polynomial.polynomial.polyval(rate, np.polynomial.polynomial.polyder(on_table.coef)))
        covariance = 2.0 * block_covariance(noise, len(magnitudes), cycles) / np.outer(per_deg_s, per_deg_s)
        curve = fit_k_vc_curve(rate, equal_v, covariance, np.zeros_like(covariance), _ORDER)
        weights = coefficient_weights(curve, equal_v, covariance)[1:]
        coefficients = np.array(curve.coefficients[1:])
    return NullMatching(
        *(settings.match_rate_deg_s, rate, equal_v, at_v, left_v, per_deg_s, driven - table, coefficients, weights),
        readings=np.array([float(point.n) for point in points]),
        curve=curve,
    )


def _differences(points: Sequence[Point], step: int, magnitudes: int, cycles: int) -> Floats:
    """Return the weights of all outputs in the mean differences of `step` from its zeros, (pairs, windows)."""
    places = np.array([place for place, point in enumerate(points) if point.step == step])
    if places.size != cycles * magnitudes * len(CHOPPED):
        raise ConfigError(f"expected {cycles} times {magnitudes} blocks of {len(CHOPPED)} windows, got {places.size}")
    blocks = places.reshape(cycles, magnitudes, len(CHOPPED))
    making = np.zeros((magnitudes, 2, len(points)))
    for number in range(magnitudes):
        for own in blocks[:, number]:
            making[number][:, own] += DIFFERENCES / cycles
    return making.reshape(2 * magnitudes, len(points))
