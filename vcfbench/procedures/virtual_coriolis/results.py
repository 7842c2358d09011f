"""Results of a four-step calibration: pure arithmetic on its points, the same again from a record; their report."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

from msgspec import Struct

from vcfbench.analysis.column import CalibrationColumn, FittedValue
from vcfbench.analysis.scale_factor import Comparison, ScaleFactorResult, compare
from vcfbench.instructions.schedule import KvcBy, SweepSettings
from vcfbench.instructions.v_vc import K_VC_UNIT, at_measured_levels, generator_sheet, standing_for
from vcfbench.procedures.virtual_coriolis.budget import four_step_statement
from vcfbench.procedures.virtual_coriolis.matching import Matching
from vcfbench.procedures.virtual_coriolis.null_matching import NullMatching, null_matching
from vcfbench.procedures.virtual_coriolis.settings import VirtualCoriolisSettings
from vcfbench.records.schema import Point
from vcfbench.records.stated import values_of
from vcfbench.reports.document import Axis, Figure, Report, Series, Table, Text, heads
from vcfbench.station.settings import Match
from vcfbench.uncertainty import columns
from vcfbench.uncertainty.found import SweepFound, sweep_found
from vcfbench.uncertainty.statement import Statement
from vcfbench.uncertainty.windows import sweep_of
from vcfbench.values.value import Unstated, Value


class VirtualCoriolisResult(Struct, frozen=True, kw_only=True):
    """Result of a four-step calibration: K_Vc, the columns of table and virtual Coriolis force, and their difference.

    V_Vc is that which a second meter measured, where the bench has one, else what the generator was set to.
    `scale_factor_error_u_percent` is combined. `scale_factor_error_u_fit_percent` is the scatter about the two lines,
    that is, lack of fit, and `scale_factor_error_u_readings_percent` what noise and the resolutions of meter and
    generator allow, through both slopes and K_Vc. Neither of these includes the generator's accuracy. A V_Vc that is
    set and not measured may be off by as much as `k_vc_u_generator` says (standard uncertainty), at step 2 and at each
    level of step 4 differently.

    >>> quick = {"rates_deg_s": [10, 0, -10], "samples": 3}
    >>> found = vcfbench.run("virtual-coriolis", seed=3, settings=quick, runs=None).results
    >>> f"K_Vc {found.k_vc.value:.0f} (deg/s)/V, {found.scale_factor_error_percent:.1f} % from the table"
    'K_Vc 150 (deg/s)/V, 0.0 % from the table'
    """

    k_vc: FittedValue
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
    scale_factor_error_u_percent: float
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
    uncertainty: Statement
    """Combined uncertainties."""

    def stated(self) -> Iterator[Value | Unstated]:
        """Yield its values; limits are those of the column that was measured on the table."""
        yield from columns.stated(self.uncertainty)


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


def virtual_coriolis_results(settings: VirtualCoriolisSettings, points: Sequence[Point]) -> VirtualCoriolisResult:
    """Return the results of a four-step calibration."""
    points = at_measured_levels(points)
    if settings.k_vc_by is KvcBy.ONE_POINT:
        matched = Matching.of(points, settings.match, settings.match_rate_deg_s)
        values = _four_steps(settings, points, matched)
        if not columns.is_swept(settings):
            return VirtualCoriolisResult(**values)
        return SweptVirtualCoriolisResult(**values, **_sweeps(settings, standing_for(points, 4, matched.rate_of)))
    matching = null_matching(settings, points)
    curve = matching.curve
    pairs = (matching.rate_deg_s, matching.v_vc_v, matching.residuals_deg_s, matching.left_v)
    return NullVirtualCoriolisResult(
        **_four_steps(settings, points, matching),
        **_sweeps(settings, standing_for(points, 4, matching.rate_of)),
        k_vc_by=settings.k_vc_by,
        coefficients=tuple(matching.coefficients.tolist()),
        pairs=tuple(NullPair(*map(float, each)) for each in zip(*pairs, strict=True)),
        lack_of_fit_p=None if curve is None else curve.lack_of_fit_p,
        lack_of_fit_deg_s=None if curve is None else curve.lack_of_fit_deg_s,
    )


def _sweeps(settings: SweepSettings, points: Sequence[Point]) -> dict[str, Any]:
    turntable, virtual = (sweep_found(settings, points, sweep_of(settings, points, step)) for step in (3, 4))
    return {"turntable_sweep": turntable, "virtual_sweep": virtual}


def _four_steps(
    settings: VirtualCoriolisSettings, points: Sequence[Point], matching: Matching | NullMatching
) -> dict[str, Any]:
    """Return K_Vc, both columns and how they differ, from points at the V_Vc that they are known to have."""
    measured = any(point.v_vc_measured_v is not None for point in points)
    generator, resolution_v = generator_sheet(settings), settings.meter_resolution_v
    u_v = columns.u_output_v(points, resolution_v)
    u_level = 0.0 if measured else math.ldexp(2.0 * math.sqrt(10.0), -generator.bits) / math.sqrt(12.0)
    points = standing_for(points, 4, matching.rate_of)
    noise_k_vc = matching.u_k_vc(columns.noise_std_v(points), columns.u_resolution_v(resolution_v))
    u_k_vc = math.hypot(noise_k_vc, u_level * matching.k_vc)
    table, driven = (sweep_of(settings, points, step) for step in (3, 4))
    turntable = columns.fitted_column(table.points, table.u_v(u_v))
    levels = zip(driven.noise_gains, (u_level * matching.slope * point.v_vc_v for point in driven.points), strict=True)
    virtual = columns.fitted_column(driven.points, [math.hypot(gain * u_v, u_level_v) for gain, u_level_v in levels])
    comparison = compare(turntable, virtual)
    relative = math.hypot(u_k_vc / matching.k_vc, _relative_u(turntable), _relative_u(virtual))
    ratio = abs(virtual.line.scale_factor / turntable.line.scale_factor)
    stated = four_step_statement(settings, points, matching)
    set_v = matching.v_vc_equal_v if isinstance(matching, Matching) else math.inf  # an offset cancels in pairs
    # Of a level that is known by its setting alone: relative, rectangular limits
    u_generator = 0.0 if measured else (generator.setting + generator.offset_v / abs(set_v)) / math.sqrt(3.0)
    return {
        "k_vc": columns.combined(FittedValue("", matching.k_vc, K_VC_UNIT, u_fit=u_k_vc), stated.value("k_vc")),
        "k_vc_u_generator": u_generator * abs(matching.k_vc),
        "v_vc10_v": matching.v_vc_equal_v,
        "turntable": columns.with_statement(turntable.column(settings.null_v), stated, "turntable."),
        "virtual": columns.with_statement(virtual.column(settings.null_v), stated, "virtual."),
        "scale_factor_error_percent": comparison.scale_factor_error_percent,
        "scale_factor_error_u_percent": stated.value("scale_factor_error_percent").u,
        "scale_factor_error_u_fit_percent": comparison.u_fit_scale_factor_error_percent,
        "scale_factor_error_u_readings_percent": 100.0 * ratio * relative,
        "comparison": comparison,
        "match": settings.match,
        "match_rate_deg_s": settings.match_rate_deg_s,
        "match_residual_v": matching.residual_v,
        "u_output_v": u_v,
        "meter_resolution_v": resolution_v,
        "uncertainty": stated,
    }


def _relative_u(column: ScaleFactorResult) -> float:
    """Return the relative standard uncertainty of a slope from noise alone."""
    return 0.0 if column.type_a is None else column.type_a.u_scale_factor / column.line.scale_factor


def virtual_coriolis_report(_settings: object, points: Sequence[Point], found: VirtualCoriolisResult) -> Report:
    """Report a four-step calibration: steps 3 and 4 like the paper's Table 1, both lines, and how they differ."""
    k_vc, rounded = found.k_vc, found.comparison.scale_factor_error_percent_rounded
    by_curve = found.rate_of if isinstance(found, NullVirtualCoriolisResult) else None
    points = standing_for(at_measured_levels(points), 4, by_curve or (lambda v_vc_v: k_vc.value * v_vc_v))
    table = [point for point in points if point.step == 3]
    virtual = [point for point in points if point.step == 4]
    lines = [("turntable", table, found.turntable), ("virtual Coriolis", virtual, found.virtual)]
    # Lay out steps 3 and 4 with the V_Vc that stood for each rate
    four = heads("Omega_z [deg/s]:g | turntable [V]:.5f | virtual Coriolis [V]:.5f | V_Vc [V]:.5f")
    pairs = list(zip(table, virtual, strict=True))
    noise = found.turntable.type_a, found.virtual.type_a
    u_v = None if None in noise else math.hypot(*(each.u_output_v for each in noise if each is not None))
    difference = Series(
        "virtual Coriolis minus turntable",
        [left.rate_deg_s for left, _ in pairs],
        [1e3 * (right.output_v - left.output_v) for left, right in pairs],
        None if u_v is None else [1e3 * u_v] * len(pairs),
    )
    axes, sweeps = (columns.RATE, Axis("difference of the outputs", "mV")), {}
    if isinstance(found, SweptVirtualCoriolisResult):
        sweeps = {"turntable": found.turntable_sweep, "virtual Coriolis": found.virtual_sweep}
    nulls: list[Table | Text] = []
    if isinstance(found, NullVirtualCoriolisResult):
        # The matches where K_Vc is from null comparisons, and the curve through them
        left = heads("rate [deg/s]:g | V_Vc [V]:.6f | rate - K_Vc [deg/s]:.1e | mismatch [V]:.1e")
        rows = [(p.rate_deg_s, p.v_vc_v, p.residual_deg_s, p.left_v) for p in found.pairs]
        title = f"V_Vc that gives the same output change as the table ({found.k_vc_by.value})"
        nulls.append(Table(left, rows, title))
        if found.lack_of_fit_p is not None:
            terms = " ".join(f"{each:+.8g} V^{place}" for place, each in enumerate(found.coefficients, start=1))
            lack = f"deviation from the curve {found.lack_of_fit_deg_s:.1e} deg/s rms (p = {found.lack_of_fit_p:.2g})"
            nulls.append(Text(f"rate = {terms}\n  {lack}; in no uncertainty"))
    values = values_of(found)
    as_printed = "" if rounded is None else f"; {rounded:.3f} % from slopes rounded as the paper prints them"
    k_vc_line = (
        f"K_Vc = {values['k_vc'].with_u95}, u of noise and resolution alone {k_vc.u_fit or 0.0:.2g}; "
        f"V_Vc at {found.match_rate_deg_s:g} deg/s {found.v_vc10_v:.6g} V (match: {found.match.value})"
    )
    u_line = (
        f"  u from noise and resolution {found.scale_factor_error_u_readings_percent:.2g} %, "
        f"from scatter about the lines {found.scale_factor_error_u_fit_percent:.2g} %"
    )
    error_line = f"scale factor error {values['scale_factor_error_percent'].with_u95}{as_printed}"
    fits = (
        columns.line_words("turntable", found.turntable, values, "turntable."),
        columns.line_words("virtual Coriolis", found.virtual, values, "virtual."),
    )
    return Report(
        [
            Table(four, [(left.rate_deg_s, left.output_v, right.output_v, right.v_vc_v) for left, right in pairs]),
            Text("\n".join([k_vc_line, *fits, error_line, u_line])),
            *nulls,
            *(columns.sweep_text(name, sweep) for name, sweep in sweeps.items()),
            *columns.statement_tables(found.uncertainty),
            columns.outputs_figure("Output against rate, real and virtual", lines),
            columns.residuals_figure(lines),
            Figure("Virtual Coriolis minus turntable", *axes, [difference]),
        ]
    )
