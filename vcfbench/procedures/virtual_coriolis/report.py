"""What the two calibrations report: the paper's Table 1 and its figures, the lines, and how they compare."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from vcfbench.procedures.known.levels import at_measured_levels, standing_for
from vcfbench.procedures.virtual_coriolis.results import (
    NullVirtualCoriolisResult,
    SweptTurntableResult,
    SweptVirtualCoriolisResult,
)
from vcfbench.report.document import Axis, Column, Figure, Report, Series, Table, Text

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from vcfbench.analysis.column import CalibrationColumn
    from vcfbench.procedures.budget.statement import Statement
    from vcfbench.procedures.sweep.found import SweepFound
    from vcfbench.procedures.virtual_coriolis.results import TurntableResult, VirtualCoriolisResult
    from vcfbench.record.schema import Point

__all__ = ["turntable_report", "virtual_coriolis_report"]

_RATE = Axis("Omega_z", "deg/s")


def turntable_report(_settings: object, points: Sequence[Point], results: TurntableResult) -> Report:
    """Report a turntable calibration: its column, its line, and what it leaves over."""
    points = [point for point in points if point.step == 1]
    columns = (Column("Omega_z", "deg/s", "g"), Column("output", "V", ".5f"), Column("s", "V", ".1e"))
    rows = [(p.rate_deg_s, p.output_v, p.std_v) for p in points]
    lines = [("turntable", points, results)]
    return Report(
        [
            Table(columns, rows),
            Text(_fit("turntable", results)),
            *_sweeps(results),
            *_stated(results.uncertainty),
            _outputs("Output against the table's rate", lines),
            _residuals(lines),
        ]
    )


def virtual_coriolis_report(_settings: object, points: Sequence[Point], results: VirtualCoriolisResult) -> Report:
    """Report a four-step calibration: steps 3 and 4 like the paper's Table 1, both lines, and how they differ."""
    points = standing_for(at_measured_levels(points), 4, _rate_of(results))
    table = [point for point in points if point.step == 3]
    virtual = [point for point in points if point.step == 4]
    lines = [("turntable", table, results.turntable), ("virtual Coriolis", virtual, results.virtual)]
    return Report(
        [
            _table_1(table, virtual),
            Text(_comparison(results)),
            *_nulls(results),
            *_sweeps(results),
            *_stated(results.uncertainty),
            _outputs("Output against rate, real and virtual", lines),
            _residuals(lines),
            _difference(table, virtual, results),
        ]
    )


def _rate_of(results: VirtualCoriolisResult) -> Callable[[float], float]:
    if isinstance(results, NullVirtualCoriolisResult):
        return results.rate_of
    k_vc = results.k_vc.value
    return lambda v_vc_v: k_vc * v_vc_v


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


def _sweeps(results: TurntableResult | VirtualCoriolisResult) -> list[Text]:
    """Say what order, zeros and repeats tell, where the rates were not visited as the paper does."""
    found: list[tuple[str, SweepFound]] = []
    if isinstance(results, SweptTurntableResult):
        found = [("turntable", results.sweep)]
    elif isinstance(results, SweptVirtualCoriolisResult):
        found = [("turntable", results.turntable_sweep), ("virtual Coriolis", results.virtual_sweep)]
    return [Text("\n".join([f"{name}: {_visited(sweep)}", *_told(sweep)])) for name, sweep in found]


def _visited(sweep: SweepFound) -> str:
    times = f", {sweep.repeat} times" if sweep.repeat > 1 else ""
    return f"order {sweep.order.value}, zeros {sweep.zeros.value}{times}; {sweep.windows} windows"


def _told(sweep: SweepFound) -> Iterator[str]:
    if sweep.zero_drift_v is not None:
        yield f"  the zero drifted by {1e3 * sweep.zero_drift_v:+.4g} mV from first to last; it is taken off"
    if sweep.earth_rate_deg_s:
        yield f"  the Earth's rate about the table's axis, {sweep.earth_rate_deg_s:+.6f} deg/s, is added to the rates"
    yield from (f"  no whole turns at {each}" for each in sweep.no_whole_turns)
    for each in sweep.repeatability:
        known = (
            f"s {each.sd:.2g} {each.unit} (u {each.u:.1g}, {each.dof} degrees of freedom; noise alone {each.noise:.2g})"
        )
        yield f"  repeatability of the {each.name.replace('_', ' ')} within this run: {known}"
    if (loop := sweep.hysteresis) is not None:
        verdict = "seen" if loop.seen else "not more than noise"
        yield (
            f"  hysteresis {loop.difference.value:+.2g} % of full scale at {loop.rate_deg_s:+g} deg/s, "
            f"u {loop.difference.u:.1g}: {verdict} (noise alone stays below {loop.by_noise_percent:.2g} with 95 %)"
        )
        yield from (f"    not in it: {each}" for each in loop.holds_not)


_LEAST_SHARE = 0.001
"""Share of the variance from which a contribution is shown; all are in the JSON."""


def _stated(statement: Statement | None) -> list[Table | Text]:
    """Lay out the combined uncertainties, what they are made of, E_n, and what they do not hold."""
    if statement is None:
        return []
    columns = (
        *(Column("value", align="left"), Column("", "", ".7g"), Column("U95", "", ".2g"), Column("u", "", ".2g")),
        *(Column("k", "", ".2f"), Column("unit", align="left"), Column("of what", align="left")),
    )
    rows = [(v.name, v.value, v.u95, v.u, v.coverage_factor, v.unit, v.of) for v in statement.values]
    shares = (
        *(Column("value", align="left"), Column("contribution", align="left"), Column("u", "", ".2g")),
        *(Column("unit", align="left"), Column("share", "%", ".1f")),
    )
    lines = [
        (value.name if not place else "", each.source, each.u, value.unit, 100.0 * each.share)
        for value in statement.values
        for place, each in enumerate(each for each in value.contributions if each.share >= _LEAST_SHARE)
    ]
    ratio = [] if statement.e_n is None else [f"E_n of the two methods {statement.e_n:.3g} (above 1 they disagree)"]
    return [
        Table(columns, rows, "Values with their combined uncertainty (95 %)"),
        Table(shares, lines, "Largest contributions"),
        Text("\n".join([*ratio, "not in these uncertainties:", *(f"  {each}" for each in statement.not_in_u)])),
    ]


def _table_1(table: Sequence[Point], virtual: Sequence[Point]) -> Table:
    """Lay out steps 3 and 4 with the V_Vc that stood for each rate."""
    columns = (
        *(Column("Omega_z", "deg/s", "g"), Column("turntable", "V", ".5f")),
        *(Column("virtual Coriolis", "V", ".5f"), Column("V_Vc", "V", ".5f")),
    )
    pairs = zip(table, virtual, strict=True)
    return Table(columns, [(left.rate_deg_s, left.output_v, right.output_v, right.v_vc_v) for left, right in pairs])


def _comparison(results: VirtualCoriolisResult) -> str:
    k_vc, rounded = results.k_vc, results.comparison.scale_factor_error_percent_rounded
    as_printed = "" if rounded is None else f", {rounded:.3f} % from slopes rounded as the paper prints them"
    k_vc_line = (
        f"K_Vc = {k_vc.value:.6g} {k_vc.unit}, u {k_vc.u:.2g}; "
        f"V_Vc at {results.match_rate_deg_s:g} deg/s {results.v_vc10_v:.6g} V (match: {results.match.value})"
    )
    u_line = (
        f"  u from noise and resolution {results.scale_factor_error_u_percent:.2g} %, "
        f"from scatter about the lines {results.scale_factor_error_fit_u_percent:.2g} %"
    )
    error_line = f"scale factor error {results.scale_factor_error_percent:.4f} %{as_printed}"
    fits = (_fit("turntable", results.turntable), _fit("virtual Coriolis", results.virtual))
    return "\n".join([k_vc_line, *fits, error_line, u_line])


def _fit(name: str, column: CalibrationColumn) -> str:
    scale_factor, bias, ppm = column.scale_factor, column.bias, column.nonlinearity_ppm
    return "\n".join(
        [
            f"{name}: V = {scale_factor.value:+.8f} Omega_z {bias.value:+.6f}",
            (
                f"  scale factor {1e3 * scale_factor.value:.5f} mV/(deg/s), u {1e3 * scale_factor.u:.1g}; "
                f"bias {1e3 * bias.value:.3f} mV, u {1e3 * bias.u:.1g}"
            ),
            (
                f"  non-linearity {_ppm(ppm.max_span)} ppm of the span (max_span), "
                f"{_ppm(ppm.max_span_rounded)} the paper's way (max_span_rounded), "
                f"{_ppm(ppm.max_fs)} of full scale (max_fs)"
            ),
        ]
    )


def _ppm(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


def _outputs(title: str, lines: Sequence[tuple[str, Sequence[Point], CalibrationColumn]]) -> Figure:
    """Draw the outputs of each column against the rate, and its line through them."""
    return Figure(
        title,
        _RATE,
        Axis("output", "V"),
        [
            each
            for name, points, column in lines
            for each in (_points(name, points, column), _line(name, points, column))
        ],
    )


def _points(name: str, points: Sequence[Point], column: CalibrationColumn) -> Series:
    return Series(name, [p.rate_deg_s for p in points], [p.output_v for p in points], _u_outputs(points, column))


def _u_outputs(points: Sequence[Point], column: CalibrationColumn) -> tuple[float, ...] | None:
    return None if column.type_a is None else (column.type_a.u_output_v,) * len(points)


def _line(name: str, points: Sequence[Point], column: CalibrationColumn) -> Series:
    ends = min(p.rate_deg_s for p in points), max(p.rate_deg_s for p in points)
    slope, bias_v = column.scale_factor.value, column.bias.value
    return Series(f"{name}, least-squares line", ends, [slope * rate + bias_v for rate in ends], kind="line")


def _residuals(lines: Sequence[tuple[str, Sequence[Point], CalibrationColumn]]) -> Figure:
    """Draw what each line leaves over, in ppm of full scale: of the output at the largest rate, bias apart."""
    series = []
    for name, points, column in lines:
        rates = [p.rate_deg_s for p in points]
        ppm = 1e6 / (abs(column.scale_factor.value) * max(map(abs, rates)))
        u_ppm = None if (u_v := _u_outputs(points, column)) is None else [ppm * each for each in u_v]
        series.append(Series(name, rates, [ppm * each for each in column.residuals_v], u_ppm))
    return Figure("Residuals of the least-squares line", _RATE, Axis("residual of full scale", "ppm"), series)


def _difference(table: Sequence[Point], virtual: Sequence[Point], results: VirtualCoriolisResult) -> Figure:
    """Draw how far the virtual column is from that of the table at each rate."""
    pairs = list(zip(table, virtual, strict=True))
    noise = results.turntable.type_a, results.virtual.type_a
    u_v = None if None in noise else math.hypot(*(each.u_output_v for each in noise if each is not None))
    difference = Series(
        "virtual Coriolis minus turntable",
        [left.rate_deg_s for left, _ in pairs],
        [1e3 * (right.output_v - left.output_v) for left, right in pairs],
        None if u_v is None else [1e3 * u_v] * len(pairs),
    )
    return Figure("Virtual Coriolis minus turntable", _RATE, Axis("difference of the outputs", "mV"), [difference])
