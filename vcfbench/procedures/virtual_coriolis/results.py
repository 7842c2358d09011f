"""From the points of a four-step calibration to its results: pure arithmetic, the same again from a record."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from msgspec import Struct

from vcfbench.analysis.column import CalibrationColumn, Quantity
from vcfbench.procedures.shared.column import results as columns
from vcfbench.procedures.shared.known.levels import K_VC_UNIT, at_measured_levels, generator_sheet, standing_for
from vcfbench.procedures.shared.sweep.schedule import KvcBy, SweepSettings
from vcfbench.procedures.virtual_coriolis.matching import Matching
from vcfbench.procedures.virtual_coriolis.settings import VirtualCoriolisSettings
from vcfbench.records.schema import Point
from vcfbench.station.settings import Match, ProcedureSettings

if TYPE_CHECKING:
    from vcfbench.analysis.scale_factor import Comparison, ScaleFactorResult
    from vcfbench.procedures.shared.budget.statement import Statement
    from vcfbench.procedures.shared.sweep.found import SweepFound
    from vcfbench.procedures.virtual_coriolis.null_matching import NullMatching


class VirtualCoriolisResult(Struct, frozen=True, kw_only=True):
    """Result of a four-step calibration: K_Vc, the columns of table and virtual Coriolis force, and their difference.

    V_Vc is that which a second meter measured, where the bench has one, else what the generator was set to.
    `scale_factor_error_u_percent` is combined, None where only the points are known. `scale_factor_error_u_fit_percent`
    is the scatter about the two lines, that is, lack of fit, and `scale_factor_error_u_readings_percent` what noise and
    the resolutions of meter and generator allow, through both slopes and K_Vc. Neither of these includes the
    generator's accuracy. A V_Vc that is set and not measured may be off by as much as `k_vc_u_generator` says (standard
    uncertainty), at step 2 and at each level of step 4 differently.
    """

    k_vc: Quantity
    """Rate that one volt of V_Vc stands for."""
    k_vc_u_generator: float
    """Standard uncertainty of K_Vc by the generator's accuracy alone, (deg/s)/V; 0 where V_Vc was measured."""
    v_vc10_v: float
    """V_Vc that gives the output of `match_rate_deg_s`; the paper's rate is 10 deg/s."""
    turntable: CalibrationColumn
    """Step 3: outputs against the table's rates."""
    virtual: CalibrationColumn
    """Step 4: outputs against the rates that V_Vc stood for."""
    scale_factor_error_percent: float
    """Difference of the virtual scale factor from that of the table."""
    scale_factor_error_u_percent: float | None
    scale_factor_error_u_fit_percent: float
    scale_factor_error_u_readings_percent: float
    comparison: Comparison
    match: Match
    match_rate_deg_s: float
    match_residual_v: float
    """Difference left between the two outputs at the best setting of V_Vc."""
    u_output_v: float
    """Standard uncertainty of one window's mean."""
    meter_resolution_v: float
    uncertainty: Statement | None = None
    """Combined uncertainties; None where only the points of the run are known."""

    def acceptance_values(self) -> Mapping[str, float | None]:
        """Return the values that ``[acceptance]`` limits, by its keys; the column is that measured on the table."""
        return {
            **columns.acceptance_values(self.turntable),
            "k_vc_deg_s_per_v": self.k_vc.value,
            "scale_factor_error_percent": self.scale_factor_error_percent,
            **({} if self.uncertainty is None or self.uncertainty.e_n is None else {"e_n": self.uncertainty.e_n}),
        }

    def acceptance_u95(self) -> Mapping[str, float]:
        """Return the expanded uncertainties of these, by the same keys."""
        return columns.acceptance_u95(self.uncertainty)


class SweptVirtualCoriolisResult(VirtualCoriolisResult, frozen=True, kw_only=True):
    """The same, of a run that did not visit the rates as the paper does."""

    turntable_sweep: SweepFound
    virtual_sweep: SweepFound


class NullPair(Struct, frozen=True):
    """A rate of the table, and the V_Vc with the same zero-subtracted output."""

    rate_deg_s: float
    v_vc_v: float
    residual_deg_s: float
    """Rate less that of its V_Vc."""
    left_v: float
    """Difference left between the two outputs, V; it is interpolated."""


class NullVirtualCoriolisResult(SweptVirtualCoriolisResult, frozen=True, kw_only=True):
    """The same, with K_Vc from null comparisons at rates of both signs."""

    k_vc_by: KvcBy
    coefficients: tuple[float, ...]
    """The rate that V_Vc stands for is the sum of these times V_Vc, its square, its cube, (deg/s)/V^p."""
    pairs: tuple[NullPair, ...]
    lack_of_fit_p: float | None
    """Probability of residuals as large if the curve is right."""
    lack_of_fit_deg_s: float | None
    """Root mean square of its residuals beyond their noise; in no uncertainty."""

    def rate_of(self, v_vc_v: float) -> float:
        """Return the rate that a V_Vc stands for, deg/s."""
        return math.fsum(each * v_vc_v ** (place + 1) for place, each in enumerate(self.coefficients))


def virtual_coriolis_results(
    points: Sequence[Point],
    match: Match,
    match_rate_deg_s: float,
    meter_resolution_v: float,
    settings: ProcedureSettings | None = None,
) -> VirtualCoriolisResult:
    """Return the results of a four-step calibration, with `settings` their uncertainties."""
    points = at_measured_levels(points)
    matching = Matching.of(points, match, match_rate_deg_s)
    asked = {"match": match, "match_rate_deg_s": match_rate_deg_s, "meter_resolution_v": meter_resolution_v}
    values = _four_steps(points, matching, meter_resolution_v, settings) | asked
    if settings is None or not columns.is_swept(settings):
        return VirtualCoriolisResult(**values)
    return SweptVirtualCoriolisResult(**values, **_sweeps(settings, standing_for(points, 4, matching.rate_of)))


def null_results(points: Sequence[Point], settings: VirtualCoriolisSettings) -> NullVirtualCoriolisResult:
    """Return the results of a four-step calibration whose K_Vc is from null comparisons at both signs."""
    from vcfbench.procedures.virtual_coriolis.null_matching import null_matching  # noqa: PLC0415  # numpy comes with it

    points = at_measured_levels(points)
    matching = null_matching(settings, points)
    curve = matching.curve
    columns = (matching.rate_deg_s, matching.v_vc_v, matching.residuals_deg_s, matching.left_v)
    return NullVirtualCoriolisResult(
        **_four_steps(points, matching, settings.meter_resolution_v, settings),
        **_sweeps(settings, standing_for(points, 4, matching.rate_of)),
        match=settings.match,
        match_rate_deg_s=settings.match_rate_deg_s,
        meter_resolution_v=settings.meter_resolution_v,
        k_vc_by=settings.k_vc_by,
        coefficients=tuple(matching.coefficients.tolist()),
        pairs=tuple(NullPair(*map(float, each)) for each in zip(*columns, strict=True)),
        lack_of_fit_p=None if curve is None else curve.lack_of_fit_p,
        lack_of_fit_deg_s=None if curve is None else curve.lack_of_fit_deg_s,
    )


def _sweeps(settings: SweepSettings, points: Sequence[Point]) -> dict[str, Any]:
    from vcfbench.procedures.shared.sweep.found import sweep_found  # noqa: PLC0415  # as above
    from vcfbench.procedures.shared.sweep.windows import sweep_of  # noqa: PLC0415  # numpy comes with it

    turntable, virtual = (sweep_found(settings, points, sweep_of(settings, points, step)) for step in (3, 4))
    return {"turntable_sweep": turntable, "virtual_sweep": virtual}


def _four_steps(
    points: Sequence[Point],
    matching: Matching | NullMatching,
    meter_resolution_v: float,
    settings: ProcedureSettings | None,
) -> dict[str, Any]:
    """Return K_Vc, both columns and how they differ, from points at the V_Vc that they are known to have."""
    from vcfbench.analysis.scale_factor import compare  # noqa: PLC0415  # numpy comes with it
    from vcfbench.procedures.shared.sweep.windows import sweep_of  # noqa: PLC0415  # as above

    measured = any(point.v_vc_measured_v is not None for point in points)
    generator = generator_sheet(settings or ProcedureSettings())
    u_v, u_level = (
        columns.u_output_v(points, meter_resolution_v),
        0.0 if measured else (math.ldexp(2.0 * math.sqrt(10.0), -generator.bits) / math.sqrt(12.0)),
    )
    points = standing_for(points, 4, matching.rate_of)
    noise_k_vc = matching.u_k_vc(columns.noise_std_v(points), columns.u_resolution_v(meter_resolution_v))
    u_k_vc = math.hypot(noise_k_vc, u_level * matching.k_vc)
    table, driven = (sweep_of(settings or ProcedureSettings(), points, step) for step in (3, 4))
    turntable = columns.fitted_column(table.points, table.u_v(u_v))
    levels = zip(driven.noise_gains, (u_level * matching.slope * point.v_vc_v for point in driven.points), strict=True)
    virtual = columns.fitted_column(driven.points, [math.hypot(gain * u_v, u_level_v) for gain, u_level_v in levels])
    comparison = compare(turntable, virtual)
    relative = math.hypot(u_k_vc / matching.k_vc, _relative_u(turntable), _relative_u(virtual))
    ratio = abs(virtual.line.scale_factor / turntable.line.scale_factor)
    stated = None
    if settings is not None and isinstance(matching, Matching):
        from vcfbench.procedures.virtual_coriolis.budget import four_step_statement  # noqa: PLC0415  # numpy comes with it

        stated = four_step_statement(settings, points, matching)
    elif settings is not None and not isinstance(matching, Matching):
        from vcfbench.procedures.virtual_coriolis.null_budget import null_statement  # noqa: PLC0415  # as above

        stated = null_statement(settings, points, matching)
    set_v = matching.v_vc_equal_v if isinstance(matching, Matching) else math.inf  # an offset cancels in pairs
    # Of a level that is known by its setting alone: relative, rectangular limits
    u_generator = 0.0 if measured else (generator.setting + generator.offset_v / abs(set_v)) / math.sqrt(3.0)
    return {
        "k_vc": columns.combined(Quantity(matching.k_vc, None, K_VC_UNIT, u_k_vc), stated, "k_vc"),
        "k_vc_u_generator": u_generator * abs(matching.k_vc),
        "v_vc10_v": matching.v_vc_equal_v,
        "turntable": columns.with_statement(turntable.column(), stated, "turntable."),
        "virtual": columns.with_statement(virtual.column(), stated, "virtual."),
        "scale_factor_error_percent": comparison.scale_factor_error_percent,
        "scale_factor_error_u_percent": None if stated is None else stated.value("scale_factor_error_percent").u,
        "scale_factor_error_u_fit_percent": comparison.u_fit_scale_factor_error_percent,
        "scale_factor_error_u_readings_percent": 100.0 * ratio * relative,
        "comparison": comparison,
        "match_residual_v": matching.residual_v,
        "u_output_v": u_v,
        "uncertainty": stated,
    }


def _relative_u(column: ScaleFactorResult) -> float:
    """Return the relative standard uncertainty of a slope from noise alone."""
    return 0.0 if column.type_a is None else column.type_a.u_scale_factor / column.line.scale_factor
