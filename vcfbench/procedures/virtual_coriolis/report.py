"""Report of a four-step calibration: the paper's Table 1 and its figures, both lines, and their comparison."""

import math
from collections.abc import Sequence

from vcfbench.procedures.shared.column.report import (
    RATE,
    line_words,
    outputs_figure,
    residuals_figure,
    statement_tables,
    sweep_text,
)
from vcfbench.procedures.shared.known.levels import at_measured_levels, standing_for
from vcfbench.procedures.virtual_coriolis.results import (
    NullVirtualCoriolisResult,
    SweptVirtualCoriolisResult,
    VirtualCoriolisResult,
)
from vcfbench.records.schema import Point
from vcfbench.reports.document import Axis, Column, Figure, Report, Series, Table, Text


def virtual_coriolis_report(_settings: object, points: Sequence[Point], results: VirtualCoriolisResult) -> Report:
    """Report a four-step calibration: steps 3 and 4 like the paper's Table 1, both lines, and how they differ."""
    k_vc = results.k_vc.value
    by_curve = results.rate_of if isinstance(results, NullVirtualCoriolisResult) else None
    points = standing_for(at_measured_levels(points), 4, by_curve or (lambda v_vc_v: k_vc * v_vc_v))
    table = [point for point in points if point.step == 3]
    virtual = [point for point in points if point.step == 4]
    lines = [("turntable", table, results.turntable), ("virtual Coriolis", virtual, results.virtual)]
    # Lay out steps 3 and 4 with the V_Vc that stood for each rate
    columns = (
        *(Column("Omega_z", "deg/s", "g"), Column("turntable", "V", ".5f")),
        *(Column("virtual Coriolis", "V", ".5f"), Column("V_Vc", "V", ".5f")),
    )
    pairs = list(zip(table, virtual, strict=True))
    noise = results.turntable.type_a, results.virtual.type_a
    u_v = None if None in noise else math.hypot(*(each.u_output_v for each in noise if each is not None))
    difference = Series(
        "virtual Coriolis minus turntable",
        [left.rate_deg_s for left, _ in pairs],
        [1e3 * (right.output_v - left.output_v) for left, right in pairs],
        None if u_v is None else [1e3 * u_v] * len(pairs),
    )
    sweeps = {}
    if isinstance(results, SweptVirtualCoriolisResult):
        sweeps = {"turntable": results.turntable_sweep, "virtual Coriolis": results.virtual_sweep}
    return Report(
        [
            Table(columns, [(left.rate_deg_s, left.output_v, right.output_v, right.v_vc_v) for left, right in pairs]),
            Text(_comparison(results)),
            *_nulls(results),
            *(sweep_text(name, sweep) for name, sweep in sweeps.items()),
            *statement_tables(results.uncertainty),
            outputs_figure("Output against rate, real and virtual", lines),
            residuals_figure(lines),
            Figure("Virtual Coriolis minus turntable", RATE, Axis("difference of the outputs", "mV"), [difference]),
        ]
    )


def _nulls(results: VirtualCoriolisResult) -> list[Table | Text]:
    """Lay out the matches where K_Vc is from null comparisons, and the curve through them."""
    if not isinstance(results, NullVirtualCoriolisResult):
        return []
    columns = (
        *(Column("rate", "deg/s", "g"), Column("V_Vc", "V", ".6f")),
        *(Column("rate - K_Vc", "deg/s", ".1e"), Column("left", "V", ".1e")),
    )
    rows = [(p.rate_deg_s, p.v_vc_v, p.residual_deg_s, p.left_v) for p in results.pairs]
    matches = Table(columns, rows, f"V_Vc with the same zero-subtracted output as the table ({results.k_vc_by.value})")
    if results.lack_of_fit_p is None:
        return [matches]
    terms = " ".join(f"{each:+.8g} V^{place}" for place, each in enumerate(results.coefficients, start=1))
    lack = f"lack of fit {results.lack_of_fit_deg_s:.1e} deg/s rms (p = {results.lack_of_fit_p:.2g}); in no uncertainty"
    return [matches, Text(f"rate = {terms}\n  {lack}")]


def _comparison(results: VirtualCoriolisResult) -> str:
    k_vc, rounded = results.k_vc, results.comparison.scale_factor_error_percent_rounded
    as_printed = "" if rounded is None else f", {rounded:.3f} % from slopes rounded as the paper prints them"
    k_vc_line = (
        f"K_Vc = {k_vc.value:.6g} {k_vc.unit}, u of noise and resolution {k_vc.u_fit or 0.0:.2g}; "
        f"V_Vc at {results.match_rate_deg_s:g} deg/s {results.v_vc10_v:.6g} V (match: {results.match.value})"
    )
    u_line = (
        f"  u from noise and resolution {results.scale_factor_error_u_readings_percent:.2g} %, "
        f"from scatter about the lines {results.scale_factor_error_u_fit_percent:.2g} %"
    )
    error_line = f"scale factor error {results.scale_factor_error_percent:.4f} %{as_printed}"
    fits = (line_words("turntable", results.turntable), line_words("virtual Coriolis", results.virtual))
    return "\n".join([k_vc_line, *fits, error_line, u_line])
