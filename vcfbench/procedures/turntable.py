"""The turntable calibration: the gyro's output at rates of the table, generator off."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from msgspec.structs import asdict, replace

from vcfbench.analysis.column import CalibrationColumn
from vcfbench.belief.agreement import require_expected_column, require_steady_slope
from vcfbench.belief.jumps import watched
from vcfbench.instructions import schedule
from vcfbench.instructions.procedure import Procedure, Watched, roles
from vcfbench.instructions.routines import framed, go_to_rate, powered, ramp_to, take, take_reference
from vcfbench.records.schema import Point
from vcfbench.records.stated import values_of
from vcfbench.reports.document import Report, Table, Text, heads
from vcfbench.station.settings import ProcedureSettings
from vcfbench.steps import MeasureLatency, Note, Plan, Settle
from vcfbench.steps.step import Routine
from vcfbench.uncertainty import columns
from vcfbench.uncertainty import line as lines
from vcfbench.uncertainty.found import SweepFound, sweep_found
from vcfbench.uncertainty.nonlinearity import CurvedLine, line_statement, warming_v
from vcfbench.uncertainty.of_range import scale_factor_of_range
from vcfbench.uncertainty.statement import Circumstances, Statement
from vcfbench.uncertainty.windows import OutputSum, WindowNoise, sweep_of
from vcfbench.values.sources import Errors
from vcfbench.values.value import Unstated, Value

STEP = 1
"""The number that the points of this procedure carry: it has one step."""


@framed(powered, watched)
def turntable(settings: schedule.SweepSettings) -> Plan:
    """Calibrate on the rate table, the PCB holding V_Vc at 0 V."""
    yield Note("Step 1: the table turns at each rate, generator off")
    points = yield from table_sweep(settings, STEP)
    require_expected_column(points, settings.expected)
    yield from latency(settings)


def latency(settings: schedule.SweepSettings) -> Routine[None]:
    """Measure the latency of a stream with a counter, by ramps of the table."""
    stream = settings.station.stream
    if stream is not None and stream.counter is not None:
        deadline_s = settings.rate_deadline_s
        fastest_deg_s, a_deg_s2 = settings.fastest_deg_s, settings.acceleration_deg_s2
        yield MeasureLatency(fastest_deg_s, a_deg_s2, settings.rate_tolerance_deg_s, deadline_s)


def table_sweep(settings: schedule.SweepSettings, step: int, earlier: Sequence[Point] = ()) -> Routine[list[Point]]:
    """Take the zero, visit the rates in their order and take a point at each, go back to rest and take the zero again.

    Their slope must agree with that of points that were measured `earlier` with the generator off: the zero and the
    output at the matching rate. Returns the points, those of zeros apart.
    """
    previous_deg_s, reference = 0.0, tuple(earlier[:2])
    points: list[Point] = []
    zeros: list[Point] = []
    if words := schedule.sweep_words(settings):
        yield Note(f"The rates{words}")
    yield Settle(settings.settle_s, "gyro settles, table at rest")
    yield from take_reference(settings, step)
    for visit in settings.visits_deg_s:
        rate_deg_s = visit or 0.0
        yield from go_to_rate(settings, rate_deg_s, previous_deg_s=previous_deg_s)
        own, number = (points, step) if visit is not None else (zeros, schedule.ZERO_TABLE)
        own.append((yield from take(settings, number, rate_deg_s=rate_deg_s, v_vc_v=0.0, table_deg_s=rate_deg_s)))
        if reference:
            require_steady_slope(points[-2:], reference)
        previous_deg_s = rate_deg_s
    require_steady_slope(points, reference)
    yield from ramp_to(settings, 0.0, previous_deg_s=previous_deg_s)
    yield Settle(settings.settle_s, "gyro settles after the rate step")
    yield from take_reference(settings, step)
    return points


class TurntableResult(CalibrationColumn, frozen=True, kw_only=True):
    """Result of a calibration on the rate table: its one column.

    >>> f"{run.results.scale_factor.value:.5f} V/(deg/s), non-linearity {run.results.nonlinearity_ppm.max_span:.0f} ppm"
    '-0.01256 V/(deg/s), non-linearity 184 ppm'
    """

    uncertainty: Statement
    """Combined uncertainties."""

    def stated(self) -> Iterator[Value | Unstated]:
        """Yield its values."""
        yield from columns.stated(self.uncertainty)


class SweptTurntableResult(TurntableResult, frozen=True, kw_only=True):
    """The same, of a run that did not visit the rates as the paper does."""

    sweep: SweepFound


def turntable_results(settings: ProcedureSettings, points: Sequence[Point]) -> TurntableResult:
    """Return the results of a turntable calibration: those of its one column."""
    sweep = sweep_of(settings, points, STEP)
    stated = turntable_statement(settings, points)
    u_v = sweep.u_v(columns.u_output_v(points, settings.meter_resolution_v))
    column = columns.fitted_column(sweep.points, u_v).column(settings.null_v)
    values = {**asdict(columns.with_statement(column, stated)), "uncertainty": stated}
    if not columns.is_swept(settings):
        return TurntableResult(**values)
    return SweptTurntableResult(**values, sweep=sweep_found(settings, points, sweep))


_MEANINGS = {
    "scale_factor": ("V/(deg/s)", "slope of the least-squares line through the outputs on the table at these rates"),
    "bias": ("V", "intercept of that line, with Earth's rate, mean over horizon_h"),
    "bias_deg_s": ("deg/s", "that bias as a rate"),
    lines.ASYMMETRY: ("ppm", "slope at positive minus slope at negative rates, over their mean (asym)"),
}


def turntable_statement(settings: ProcedureSettings, points: Sequence[Point]) -> Statement:
    """Return the budget of a calibration on the table: scale factor, bias and non-linearity of its line."""
    line = lines.Line.of(sweep_of(settings, points, STEP))
    noise, around = WindowNoise.of(settings, points, line.scale_factor), Circumstances.of(settings)
    sources = [*lines.instrument_sources(settings.station.sources), *lines.earth_sources(settings, line.scale_factor)]
    uneven, sums = lines.Asymmetry.of(settings, line), lines.line_sums("table", line)
    if uneven is not None:
        sums.append(OutputSum(lines.ASYMMETRY, uneven.of_outputs @ line.mixing, "ppm"))

    def model(q: Errors) -> Mapping[str, Any]:
        own = {} if uneven is None else {lines.ASYMMETRY: uneven.value(q)}
        return around.applied({**lines.table_values(line, q, settings.null_v), **own}, q)

    curved = [CurvedLine.of("nonlinearity", line)]
    found = line_statement(
        *(settings, sources, sums),
        model=model,
        around=around,
        noise=noise,
        meanings=_MEANINGS,
        curved=curved,
        warming=warming_v(settings, points, line),
    )
    of_range = scale_factor_of_range(settings, points, STEP, found.value("scale_factor"))
    return replace(found, bounds=(*of_range, *found.bounds))


def turntable_report(_settings: object, points: Sequence[Point], results: TurntableResult) -> Report:
    """Report a turntable calibration: its column, its line, and its residuals."""
    points = [point for point in points if point.step == STEP]
    rows = [(p.rate_deg_s, p.output_v, p.std_v) for p in points]
    drawn = [("turntable", points, results)]
    return Report(
        [
            Table(heads("Omega_z [deg/s]:g | output [V]:.5f | s [V]:.1e"), rows),
            Text(columns.line_words("turntable", results, values_of(results))),
            *([columns.sweep_text("turntable", results.sweep)] if isinstance(results, SweptTurntableResult) else []),
            *columns.statement_tables(results.uncertainty),
            columns.outputs_figure("Output against the table's rate", drawn),
            columns.residuals_figure(drawn),
        ]
    )


TURNTABLE = Procedure(
    name="turntable",
    method=(
        "The rate table turns the gyroscope at each rate in turn, without V_Vc. At each rate the table's "
        "read-back is checked and the output is the mean of repeated readings. A least-squares line "
        "through the means gives scale factor (slope) and bias (its output at rate 0); what it leaves over gives the "
        "non-linearity. Uncertainties are combined after the GUM (JCGM 100)."
    ),
    settings=schedule.SweepSettings,
    needs=roles("multimeter", "rate_table"),
    uses=roles("power", "oscilloscope", "rate_source"),
    watched=Watched(),
    streams=True,
    several=True,
    plan=turntable,
    results=turntable_results,
    report=turntable_report,
)
