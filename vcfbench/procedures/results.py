"""From the points of a run to its results: pure arithmetic, so that a record gives the same results again."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from vcfbench.procedures.matching import Matching

if TYPE_CHECKING:
    from collections.abc import Sequence

    from vcfbench.analysis.scale_factor import ScaleFactorResult
    from vcfbench.procedures.settings import Match
    from vcfbench.record.schema import Point

__all__ = ["K_VC_UNIT", "pooled_std_v", "turntable_results", "u_output_v", "virtual_coriolis_results"]

K_VC_UNIT = "(deg/s)/V"


def turntable_results(points: Sequence[Point], meter_resolution_v: float) -> dict[str, Any]:
    """Return the results of a turntable calibration: those of its one column."""
    return _column(points, u_output_v(points, meter_resolution_v)).as_json()


def virtual_coriolis_results(
    points: Sequence[Point], match: Match, match_rate_deg_s: float, meter_resolution_v: float
) -> dict[str, Any]:
    """Return the results of a four-step calibration.

    `scale_factor_error_u_percent` is what the noise of the readings and the meter's resolution allow, through both
    slopes and K_Vc; `scale_factor_error_fit_u_percent` is what the scatter about the two lines adds, that is, lack of
    fit.
    """
    from vcfbench.analysis.scale_factor import compare  # noqa: PLC0415  # numpy comes with it

    u_v = u_output_v(points, meter_resolution_v)
    turntable, virtual = (_column(_of_step(points, step), u_v) for step in (3, 4))
    matching = Matching.of(points, match, match_rate_deg_s)
    u_k_vc = matching.u_k_vc(pooled_std_v(points), _u_resolution_v(meter_resolution_v))
    comparison = compare(turntable, virtual)
    relative = math.hypot(u_k_vc / matching.k_vc, _relative_u(turntable), _relative_u(virtual))
    ratio = abs(virtual.line.scale_factor / turntable.line.scale_factor)
    return {
        "k_vc": {"value": matching.k_vc, "u": u_k_vc, "unit": K_VC_UNIT},
        "v_vc10_v": matching.v_vc_equal_v,
        "turntable": turntable.as_json(),
        "virtual": virtual.as_json(),
        "scale_factor_error_percent": comparison.scale_factor_error_percent,
        "scale_factor_error_u_percent": 100.0 * ratio * relative,
        "scale_factor_error_fit_u_percent": comparison.u_scale_factor_error_percent,
        "comparison": comparison.as_json(),
        "match": match.value,
        "match_rate_deg_s": match_rate_deg_s,
        "match_residual_v": matching.residual_v,
        "u_output_v": u_v,
        "meter_resolution_v": meter_resolution_v,
    }


def pooled_std_v(points: Sequence[Point]) -> float:
    """Return the standard deviation of one reading, V, from all windows: ten readings know theirs to a quarter."""
    degrees = sum(point.n - 1 for point in points)
    return math.sqrt(math.fsum((point.n - 1) * point.std_v**2 for point in points) / degrees)


def u_output_v(points: Sequence[Point], meter_resolution_v: float) -> float:
    """Return the standard uncertainty of one window's mean, V: pooled type A, the meter's resolution as type B.

    The resolution is rectangular, a/sqrt(12), and taken to be common to the readings of a window: without enough noise
    to dither it, averaging does not make it smaller. The meter's gain and the table's rate are common to all points and
    belong to a budget.
    """
    type_a_v = pooled_std_v(points) / math.sqrt(min(point.n for point in points))
    return math.hypot(type_a_v, _u_resolution_v(meter_resolution_v))


def _u_resolution_v(meter_resolution_v: float) -> float:
    return meter_resolution_v / math.sqrt(12.0)


def _of_step(points: Sequence[Point], step: int) -> list[Point]:
    return [point for point in points if point.step == step]


def _column(points: Sequence[Point], u_v: float) -> ScaleFactorResult:
    from vcfbench.analysis.scale_factor import characterise  # noqa: PLC0415  # numpy comes with it

    return characterise([point.rate_deg_s for point in points], [point.output_v for point in points], u_v)


def _relative_u(column: ScaleFactorResult) -> float:
    """Return the relative standard uncertainty of a slope from noise alone."""
    return 0.0 if column.type_a is None else column.type_a.u_scale_factor / column.line.scale_factor
