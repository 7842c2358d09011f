"""Columns of table and virtual Coriolis force: noise, line, accepted values; tables and figures of them."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TypeGuard

from msgspec.structs import replace

from vcfbench.analysis.column import CalibrationColumn, FittedValue
from vcfbench.analysis.scale_factor import ScaleFactorResult, characterise
from vcfbench.instructions.schedule import SweepSettings
from vcfbench.records.schema import Point, pooled_std_v
from vcfbench.records.stated import NOT_CONTAINED
from vcfbench.reports.document import Axis, Cell, Figure, Series, Table, Text, heads
from vcfbench.station.settings import ProcedureSettings
from vcfbench.uncertainty.found import SweepFound
from vcfbench.uncertainty.measurand import printed
from vcfbench.uncertainty.statement import Statement
from vcfbench.values.printing import incomplete
from vcfbench.values.value import Measurand, Unstated, Value


def stated(statement: Statement) -> Iterator[Value | Unstated]:
    """Yield the values of a statement, and the non-linearity where the points are too few for one."""
    yield from statement.stated()
    if not any(each.kind == "nonlinearity" for each in statement.stated()):
        yield Unstated("nonlinearity", "nonlinearity")


def with_statement(column: CalibrationColumn, statement: Statement, before: str = "") -> CalibrationColumn:
    """Return a column with the combined uncertainties that are stated of it under names that begin with `before`."""
    return replace(
        column,
        scale_factor=combined(column.scale_factor, statement.value(f"{before}scale_factor")),
        bias=combined(column.bias, statement.value(f"{before}bias")),
    )


def combined(of_fit: FittedValue, stated: Measurand) -> FittedValue:
    """Return a value with the combined uncertainty that is stated of it."""
    return replace(of_fit, u=stated.u, dof=stated.dof, u95=stated.u95, missing=stated.missing)


def is_swept(settings: ProcedureSettings) -> TypeGuard[SweepSettings]:
    """Return True if the rates are visited otherwise than the paper does."""
    return isinstance(settings, SweepSettings) and not settings.as_in_the_paper


def u_output_v(points: Sequence[Point], meter_resolution_v: float) -> float:
    """Return the standard uncertainty of one window's mean, V: pooled type A, the meter's resolution as type B.

    The resolution is rectangular, a/sqrt(12), and taken to be common to the readings of a window: without enough noise
    to dither it, averaging does not make it smaller. The meter's gain and the table's rate are common to all points and
    belong to a budget.
    """
    type_a_v = noise_std_v(points) / math.sqrt(min(point.n for point in points))
    return math.hypot(type_a_v, u_resolution_v(meter_resolution_v))


def noise_std_v(points: Sequence[Point]) -> float:
    """Return the standard deviation of one reading, V, that the means of windows scatter by.

    Where windows were taken again it is their scatter, since that holds the flicker that readings within a window do
    not see; it is never less than the readings' own.
    """
    return max(pooled_std_v(points), repeat_std_v(points) * math.sqrt(min(point.n for point in points)))


def repeat_std_v(points: Sequence[Point]) -> float:
    """Return the standard deviation of the means of windows taken again at the same setting, V; 0 without any."""
    groups: dict[tuple[int, float, float], list[float]] = {}
    for point in points:
        groups.setdefault((point.step, point.rate_deg_s, point.v_vc_v), []).append(point.output_v)
    degrees = sum(len(group) - 1 for group in groups.values())
    if not degrees:
        return 0.0
    centres = {key: math.fsum(group) / len(group) for key, group in groups.items()}
    squares = math.fsum((output_v - centres[key]) ** 2 for key, group in groups.items() for output_v in group)
    return math.sqrt(squares / degrees)


def u_resolution_v(meter_resolution_v: float) -> float:
    """Return the standard uncertainty of a reading by the meter's resolution, V, rectangular."""
    return meter_resolution_v / math.sqrt(12.0)


def fitted_column(points: Sequence[Point], u_v: float | Sequence[float]) -> ScaleFactorResult:
    """Return the line through the outputs of a column, with its residuals."""
    return characterise([point.rate_deg_s for point in points], [point.output_v for point in points], u_v)


RATE = Axis("Omega_z", "deg/s")


def sweep_text(name: str, sweep: SweepFound) -> Text:
    """Describe order, zeros and repeats, where the rates were not visited as the paper does."""
    times = f", {sweep.repeat} times" if sweep.repeat > 1 else ""
    said = [f"{name}: order {sweep.order.value}, zeros {sweep.zeros.value}{times}; {sweep.windows} windows"]
    if sweep.zero_drift_v is not None:
        said.append(f"  the zero drifted by {1e3 * sweep.zero_drift_v:+.4g} mV from first to last; it is subtracted")
    if earth_deg_s := sweep.earth_rate_deg_s:
        said.append(f"  the Earth's rate about the table's axis, {earth_deg_s:+.6f} deg/s, is added to the rates")
    said += [
        f"  repeatability of the {each.name.replace('_', ' ')} within this run: s {each.sd:.2g} {each.unit} "
        f"(u {each.u:.1g}, {each.dof} degrees of freedom; noise alone {each.noise:.2g})"
        for each in sweep.repeatability
    ]
    if (loop := sweep.hysteresis) is not None:
        verdict = "seen" if loop.seen else "not more than noise"
        said.append(
            f"  hysteresis {loop.difference.value:+.2g} % of full scale at {loop.rate_deg_s:+g} deg/s, "
            f"u {loop.difference.u:.1g}: {verdict} (noise alone stays below {loop.by_noise_percent:.2g} with 95 %)"
        )
        said += [f"    not contained: {each}" for each in loop.holds_not]
    return Text("\n".join(said))


_LEAST_SHARE = 0.001
"""Share of the variance from which a contribution is shown; all are in the JSON."""


def statement_tables(statement: Statement) -> list[Table | Text]:
    """Lay out the combined uncertainties, their contributions, E_n, and their omissions."""
    columns = heads("<value | :.7g | U95:.2g | u:.2g | k:.2f | <unit | <definition")
    rows: list[tuple[Cell | str | float | None, ...]] = []
    shares = heads("<value | <contribution | u:.2g | <unit | share [%]:.1f")
    lines, names = [], {each.name for each in statement.values}
    for each in statement.values:
        words = each.named.words
        value, u, u95 = printed(each)
        rows.append((words, value, u95, u, each.coverage_factor, each.unit, each.of + incomplete(each.missing)))
        if f"{each.name}_deg_s" in names:  # a bias has its contributions once, as a rate
            continue
        causes: dict[str, float] = {}
        for part in each.parts:
            cause = part.source.partition(": ")[0]
            causes[cause] = causes.get(cause, 0.0) + part.share
        shown = sorted((item for item in causes.items() if item[1] >= _LEAST_SHARE), key=lambda item: -item[1])
        for place, (cause, share) in enumerate(shown):
            of = "" if place else words
            lines.append((of, cause, each.u * math.sqrt(share), each.unit, 100.0 * share))
    for bound in statement.bounds:
        value, u, u95 = printed(bound)
        of = bound.of.rpartition("; ")[2]
        rows.append((bound.named.words, value, u95, u, bound.coverage_factor, bound.unit, of))
    ratio = "" if statement.e_n is None else f"E_n of the two methods {statement.e_n:.3g} (above 1 they disagree)\n"
    return [
        Table(columns, rows, f"Values with their combined uncertainty (95 %){incomplete(statement.missing)}"),
        Table(shares, lines, f"Uncertainty budget (causes below {100.0 * _LEAST_SHARE:g} % are left out)"),
        Text(ratio + "\n  ".join(["basis of the uncertainties:", *statement.known_from])),
        Text("\n  ".join([NOT_CONTAINED, *statement.not_in_u])),
    ]


def line_words(name: str, column: CalibrationColumn, values: Mapping[str, Value], before: str = "") -> str:
    """Describe the line of a column, whose values are those under names that begin with `before`."""
    slope, bias, bend = (values.get(f"{before}{each}") for each in ("scale_factor", "bias", "nonlinearity"))
    ppm = column.nonlinearity_ppm
    others = [(ppm.max_span_rounded, "the paper's way (max_span_rounded)"), (ppm.max_fs, "of full scale (max_fs)")]
    said = [f"{each:.0f} {words}" for each, words in others if each is not None]
    if bend is not None:
        said.insert(0, f"of the span {bend.with_u95} (max_span)")
    return (
        f"{name}: V = {column.scale_factor.value:+.8f} Omega_z {column.bias.value:+.6f}\n"
        f"  scale factor {'-' if slope is None else slope.with_u95}; bias {'-' if bias is None else bias.with_u95}\n"
        f"  non-linearity {'; '.join(said) or '-'}"
    )


def outputs_figure(title: str, lines: Sequence[tuple[str, Sequence[Point], CalibrationColumn]]) -> Figure:
    """Draw the outputs of each column against the rate, and its line through them."""
    series = []
    for name, points, column in lines:
        rates = [p.rate_deg_s for p in points]
        ends, slope, bias_v = (min(rates), max(rates)), column.scale_factor.value, column.bias.value
        through = [slope * rate + bias_v for rate in ends]
        series += [
            Series(name, rates, [p.output_v for p in points], _u_outputs(points, column)),
            Series(f"{name}, least-squares line", ends, through, kind="line"),
        ]
    return Figure(title, RATE, Axis("output", "V"), series)


def _u_outputs(points: Sequence[Point], column: CalibrationColumn) -> tuple[float, ...] | None:
    return None if column.type_a is None else (column.type_a.u_output_v,) * len(points)


def residuals_figure(lines: Sequence[tuple[str, Sequence[Point], CalibrationColumn]]) -> Figure:
    """Draw the residuals of each line, in ppm of its span: the largest is the non-linearity."""
    series = []
    for name, points, column in lines:
        rates = [p.rate_deg_s for p in points]
        ppm = 1e6 / (abs(column.scale_factor.value) * (max(rates) - min(rates)))
        u_ppm = None if (u_v := _u_outputs(points, column)) is None else [ppm * each for each in u_v]
        series.append(Series(name, rates, [ppm * each for each in column.residuals_v], u_ppm))
    beside = "U is of the outputs read; errors of the rates are not in it."
    return Figure(
        "Residuals of the least-squares line", RATE, Axis("residual of the span", "ppm"), series, caption=beside
    )
