"""Input rate limits: the largest rate of either sign that the output follows, and the output beyond.

IEEE 1431, 12.10. The rate is raised in growing steps until the output falls short of the straight line through small
rates by a share of what the line has there; the limit is bisected. Where the bench ends first it is a bound.
"""

import math
from collections.abc import Iterator, Sequence
from functools import partial
from statistics import fmean
from typing import Annotated, Any, ClassVar

from msgspec import Struct

from vcfbench import steps
from vcfbench.analysis.chopped import CHOPPED
from vcfbench.analysis.input_limits import Limit, Line, limit_of
from vcfbench.belief.agreement import SLOPES
from vcfbench.belief.jumps import watched
from vcfbench.belief.walk import require_answer
from vcfbench.errors import MeasurementError
from vcfbench.instructions import routines, v_vc
from vcfbench.instructions.procedure import Procedure, Watched, roles
from vcfbench.instructions.scale_factor import (
    LevelSettings,
    ScaleFactorBy,
    rates_by,
    require_as_used,
    scale_factor_used,
    tells_scale_factor,
)
from vcfbench.records.schema import Point
from vcfbench.reports.document import Axis, Figure, Report, Series, Text
from vcfbench.station.bounds import ranged, said
from vcfbench.station.invalid_value import InvalidValue
from vcfbench.station.settings import V_VC_RANGE_V
from vcfbench.steps.measured import Measured
from vcfbench.steps.step import Routine, answer
from vcfbench.uncertainty.at_rest import as_rate
from vcfbench.uncertainty.measurand import measurand, titled, value_table
from vcfbench.uncertainty.window_sum import noise_v, output_of, windows_without_times
from vcfbench.values.printing import incomplete
from vcfbench.values.sources import METER_GAIN
from vcfbench.values.value import Measurand, UncertaintyPart, Value

_LINE, _RAISED, _BEYOND, _BACK, _AGAIN = 1, 2, 3, 4, 5
"""Steps of the points: small rates, the search, beyond the limit, at the small rate again; and what is compared with
those before, at the end: small rates and the last of each search."""
_HELD = frozenset({_LINE, _RAISED, _AGAIN})
"""Steps whose windows must give the same at the same rate: what comes right after the limit need not."""


class RateLimitsSettings(LevelSettings, frozen=True, kw_only=True):
    """Settings of the input rate limits, in addition to those of all procedures."""

    smooth: ClassVar[bool] = False

    warm_up_s: Annotated[float, ranged(0.0, 86_400.0, "wait after power-on")] = 1800.0
    level_deg_s: Annotated[float, ranged(1.0, 10_000.0, "small rate of both signs, through which the line goes")] = 50.0
    short_share: Annotated[
        Annotated[float, ranged(1e-4, 0.5)] | None,
        said("share of the output that is missing at the limit; default 0.01, or the limit of V_Vc if not measured"),
    ] = None
    growth: Annotated[
        float, ranged(1.05, 3.0, "ratio of each rate to the rate before, until the output falls short")
    ] = 1.5
    resolution_deg_s: Annotated[float, ranged(0.05, 100.0, "width to which a limit is bisected", option=True)] = 0.5
    beyond: Annotated[float, ranged(1.01, 2.0, "ratio of the last rate to the limit")] = 1.05

    @property
    def by_table(self) -> bool:
        """True if the table turns, and V_Vc is off."""
        return self.by is ScaleFactorBy.TABLE

    @property
    def most_deg_s(self) -> float:
        """Largest rate within the limits: of the table, or by V_Vc."""
        limits = self.station.limits
        if self.by_table:
            return limits.max_rate_deg_s or 0.0
        most_v = V_VC_RANGE_V if limits.max_v_vc_v is None else limits.max_v_vc_v
        return (1.0 - 1e-12) * abs(self.k_vc_guess_deg_s_per_v) * most_v  # rounding takes no level beyond the limit

    @property
    def fastest_deg_s(self) -> float:
        return self.most_deg_s if self.by_table else super().fastest_deg_s

    @property
    def off_levels(self) -> float:
        """Possible error of the ratio of two unmeasured levels of V_Vc, relative; 0 if measured."""
        known = self.station.sources
        if self.by_table or v_vc.has_v_vc_meter(self):
            return 0.0
        gain, offset_v = known.generator_gain or 0.0, known.generator_offset_v or 0.0
        return math.hypot(gain, gain, offset_v / self.level_v)

    @property
    def may_lack(self) -> float:
        """Part of the line's output that may lack at a limit."""
        return max(0.01, 2.0 * self.off_levels) if self.short_share is None else self.short_share

    def contradictions(self) -> Iterator[InvalidValue]:
        yield from super().contradictions()
        yield from windows_without_times(self)
        if self.most_deg_s and self.level_deg_s >= self.most_deg_s:
            yield InvalidValue("level_deg_s", f"less than {self.most_deg_s:g} deg/s (limits)", self.level_deg_s)

    def input_of(self, point: Point) -> float:
        """Return the rate of the table, deg/s, or the measured or set V_Vc, V."""
        known_v = point.v_vc_v if point.v_vc_measured_v is None else point.v_vc_measured_v
        return point.rate_deg_s if self.by_table else known_v


class RateLimit(Struct, frozen=True):
    """Limit of one sign, or the bound where the bench ended before it: the largest rate, less its U95.

    `at` is the input of either, V_Vc in V or deg/s. `clipped` is the output beyond, `rises_beyond` its slope there over
    the line's, `comes_back` the output at the small rate afterwards less that before.
    """

    limit: Measurand | None
    at_least_deg_s: float | None
    at: float
    clipped: Measurand | None = None
    rises_beyond: float | None = None
    comes_back: Measurand | None = None


class RateLimitsResult(Struct, frozen=True):
    """Result of the input rate limits; `short_share` is the part of the line's output that may lack."""

    positive: RateLimit
    negative: RateLimit
    short_share: float
    by: str
    line: Line
    scale_factor_v_per_deg_s: float
    scale_factor_from: str

    def stated(self) -> Iterator[Value]:
        """Yield its values; of a limit that was not reached the largest rate of the bench."""
        for name, each in (("positive", self.positive), ("negative", self.negative)):
            words = (
                f"{name} input rate limit",
                f"output beyond the limit, {name}",
                f"output after minus before overrange, {name}",
            )
            if each.at_least_deg_s is not None:
                size = f"{name}_input_rate_limit", None, "deg/s"
                yield Value(*size, form="at-least", low=abs(each.at_least_deg_s), words=f"{words[0]}, its size")
            for said_of, found in zip(words, (each.limit, each.clipped, each.comes_back), strict=True):
                if found is not None:
                    yield titled(said_of, found)


def _answers(settings: RateLimitsSettings, work: steps.Plan) -> steps.Plan:
    yield from work
    if not settings.by_table:
        yield steps.DisableVvc()
        yield steps.Settle(settings.settle_s, "gyro settles, generator off")
        yield from routines.require_answer(settings)


@routines.framed(
    *(routines.energised, routines.drive_seen, routines.held_at_rest, _answers), partial(watched, steps=_HELD)
)
def rate_limits(settings: RateLimitsSettings) -> steps.Plan:
    """Measure the line, then search the limit of either side, and compare repeated rates."""
    if not settings.by_table:
        yield from v_vc.ready_v_vc_meter(settings, V_VC_RANGE_V)
        yield from routines.v_vc_on(settings.settle_s)
    yield steps.Note(f"The line through {settings.level_deg_s:g} deg/s of both signs")
    points: list[Point] = []
    for way in CHOPPED:
        points.append((yield from _point(settings, _LINE, way * settings.level_deg_s, points)))
    require_answer(settings, points)
    line = _line(settings, points)
    for each in (each for each in points if each.rate_deg_s):
        _require_same_leads(settings, line, each)
    again: list[float] = []
    for sign in (1.0, -1.0):
        yield steps.Note(f"{'Positive' if sign > 0.0 else 'Negative'} rates until the output falls short of the line")
        good, bad, most = settings.level_deg_s, math.inf, settings.most_deg_s
        while good < most and bad - good > settings.resolution_deg_s:
            rate_deg_s = min(good * settings.growth, most) if bad == math.inf else 0.5 * (good + bad)
            points.append((yield from _point(settings, _RAISED, sign * rate_deg_s, points)))
            good, bad = (good, rate_deg_s) if _short(settings, line, points[-1]) else (rate_deg_s, bad)
            if bad - good <= settings.resolution_deg_s:
                beyond_deg_s = min(settings.beyond * bad, most)
                points.append((yield from _point(settings, _BEYOND, sign * beyond_deg_s, points)))
                if not _short(settings, line, points[-1]):  # it was noise
                    good, bad = beyond_deg_s, math.inf
        if bad < math.inf:
            points.append((yield from _point(settings, _BACK, sign * settings.level_deg_s, points)))
            _require_same_leads(settings, line, points[-1])
        again += [sign * each for each in (settings.level_deg_s, good, bad) if math.isfinite(each)]
    yield steps.Note("Small rates and the last of each search again, to compare")
    for rate_deg_s in again:
        points.append((yield from _point(settings, _AGAIN, rate_deg_s, points)))


def _short(settings: RateLimitsSettings, line: Line, point: Point) -> bool:
    return line.lacks(settings.input_of(point), point.output_v) > settings.may_lack


def _require_same_leads(settings: RateLimitsSettings, line: Line, point: Point) -> None:
    """Raise MeasurementError where the output at the small rate is not about where the line's windows have it.

    Beyond the limits it may be anywhere: a modulator that is driven too far turns it round as swapped leads do.
    """
    at = settings.input_of(point)
    of_small = (1.0 - line.lacks(at, point.output_v)) * abs(at / (0.5 * line.apart))
    if not SLOPES[0] <= of_small <= SLOPES[1]:
        raise MeasurementError(
            f"at {point.rate_deg_s:+g} deg/s the output moves by {point.output_v - line.zero_v:+.4g} V, "
            f"{of_small:+.3g} times as far as at {settings.level_deg_s:g} deg/s in the windows of the line",
            instrument="multimeter",
            step=str(point.step),
            hint="a lead is off or swapped: check the leads of the output and of V_Vc",
        )


def _line(settings: RateLimitsSettings, points: Sequence[Point]) -> Line:
    line = Line.of(list(map(settings.input_of, points[: len(CHOPPED)])), [each.output_v for each in points])
    if not settings.by_table or tells_scale_factor(settings):
        slope = line.slope if settings.by_table else line.slope / settings.k_vc_guess_deg_s_per_v
        require_as_used(settings, slope, by_v_vc=not settings.by_table)
    return line


def _point(settings: RateLimitsSettings, step: int, rate_deg_s: float, before: Sequence[Point]) -> Routine[Point]:
    """Go to a rate of the table, or to the V_Vc that stands for it, and average a window."""
    previous_deg_s, v_vc_v, more = before[-1].rate_deg_s if before else 0.0, 0.0, dict[str, Any]()
    table_deg_s = rate_deg_s * settings.by_table if settings.station.limits.max_rate_deg_s else None
    if not settings.by_table:
        v_vc_v = yield from routines.set_v_vc(settings, rate_deg_s / settings.k_vc_guess_deg_s_per_v)
        if v_vc.has_v_vc_meter(settings):
            more = {"v_vc_tolerance_v": v_vc.v_vc_tolerance_v(settings, v_vc_v)}
    elif rate_deg_s != previous_deg_s:
        yield from routines.go_to_rate(settings, rate_deg_s, previous_deg_s=previous_deg_s)
    raised = abs(rate_deg_s) > settings.level_deg_s  # a clipped output does not scatter as is expected
    window = {**routines.window_of(settings), **({"noise_v": None} if raised else {})}
    kinds = (steps.AcquireClipped, steps.AcquireClippedWithVvc) if raised else (steps.Acquire, steps.AcquireWithVvc)
    result = yield kinds[bool(more)](step, rate_deg_s, v_vc_v, table_deg_s, **more, **window)
    return answer(result, steps.Window).point


def results(settings: RateLimitsSettings, measured: Measured) -> RateLimitsResult:
    """Return the limit of either sign, and the output beyond it."""
    scale, windows = scale_factor_used(settings), [window for _, window in measured.found(steps.Window)]
    line = _line(settings, [each.point for each in windows])
    up, down = (_side(settings, windows, line, sign) for sign in (1, -1))
    return RateLimitsResult(up, down, settings.may_lack, settings.by.value, line, scale.value, scale.source)


def _side(settings: RateLimitsSettings, windows: Sequence[steps.Window], line: Line, sign: int) -> RateLimit:
    points, scale = [each.point for each in windows], scale_factor_used(settings)
    slope = line.slope if settings.by_table else scale.value
    own = [each for each, point in enumerate(points) if point.rate_deg_s * sign > 0.0]
    tried = [each for each in own if points[each].step not in {_BACK, _AGAIN}]
    inputs = [settings.input_of(points[each]) for each in tried]
    of_line = sum(points[each].step == _LINE for each in tried)
    window_v = math.sqrt(fmean(points[each].std_v ** 2 / points[each].n for each in tried))
    outputs_v = [points[each].output_v for each in tried]
    found = limit_of(line, settings.may_lack, inputs, outputs_v, of_line, noise_v=window_v)
    if found is None:
        most = max(inputs, key=abs)
        of_slope = dict(enumerate(line.weights(most, 0.0)))
        noise = noise_v(settings, windows, of_slope, points[: len(CHOPPED)])
        parts = [*noise, *_of_inputs(settings, Limit(most, 0.0, 0, 1.0, 1.0), line)]
        reached = as_rate(measurand(line.slope * most, "V", parts), slope, 0.0 if settings.by_table else scale.u)
        return RateLimit(None, math.copysign(max(abs(reached.value) - reached.u95, 0.0), reached.value), most)
    weights = dict(enumerate(found.weights(line, settings.may_lack, of_input=settings.by_table)))
    noise = noise_v(settings, windows, {**weights, tried[found.first]: 1.0 / found.leaves}, points[: len(CHOPPED)])
    parts = [*noise, *_of_inputs(settings, found, line)]
    gaps = settings.station.sources.missing("k_vc") if settings.by_table else ()
    at_limit = measurand(line.slope * found.at, "V", parts, {"table rate", "misalignment"}.intersection(gaps))
    u_slope = 0.0 if settings.by_table else scale.u
    limit = as_rate(at_limit, slope, u_slope)
    beyond, back = (max(each for each in own if points[each].step == step) for step in (_BEYOND, _BACK))
    before = [each for each in own if points[each].step == _LINE]
    again = {back: 1.0, **dict.fromkeys(before, -1.0 / len(before))}
    came_v = math.fsum(weight * points[each].output_v for each, weight in again.items())
    came = as_rate(measurand(came_v, "V", noise_v(settings, windows, again, points[: len(CHOPPED)])), slope, u_slope)
    return RateLimit(limit, None, found.at, output_of(settings, points[beyond]), found.rises, came)


def _of_inputs(settings: RateLimitsSettings, found: Limit, line: Line) -> Iterator[UncertaintyPart]:
    """Yield the effects of width and inputs on the line's output at a limit, V.

    An error of V_Vc counts only as far as the output still rises: where it stands, it stands at any V_Vc.
    """
    known, size_v, rises = settings.station.sources, abs(line.slope * found.at), abs(found.rises) / found.leaves
    limits = {"last interval": abs(line.slope) * found.half_width, "V_Vc as set": size_v * rises * settings.off_levels}
    if settings.by_table:
        limits["table rate"] = size_v * (known.table_rate or 0.0)
        limits["misalignment"] = size_v * (1.0 - math.cos(math.radians(known.misalignment_deg or 0.0)))
    else:
        meter = v_vc.meter_error(settings, "multimeter")
        yield UncertaintyPart(METER_GAIN, size_v * meter.u_gain, of=meter.owner)
    for source, limit_v in limits.items():
        if limit_v:
            yield UncertaintyPart(source, limit_v / math.sqrt(3.0), rectangular=True)


def report(settings: RateLimitsSettings, measured: Measured, found: RateLimitsResult) -> Report:
    """Report the limits, and the output against the line."""
    line, of = (
        found.line,
        "of the table" if settings.by_table else "by the line's slope against V_Vc, curvature included,",
    )
    words = [
        f"limit: the rate {of} above which the output is more than {100.0 * found.short_share:.3g} % short",
        f"of the line through {settings.level_deg_s:g} deg/s of both signs{'; rails as set' * bool(settings.rails)}",
        rates_by(found.scale_factor_v_per_deg_s, found.scale_factor_from),
    ]
    for each in (found.positive, found.negative):
        bound = f"limit not reached: it is beyond {each.at_least_deg_s or 0.0:+.5g} deg/s, where the bench ends"
        words.append(bound if each.limit is None else incomplete(each.limit.missing).removeprefix("; "))
    per = 1.0 if settings.by_table else line.slope / found.scale_factor_v_per_deg_s
    taken = [(settings.input_of(each), each.output_v) for each in measured if each.rate_deg_s]
    rates, more = [per * at for at, _ in sorted(taken)], [-100.0 * line.lacks(*each) for each in sorted(taken)]
    drawn = Figure(
        "Output relative to the line", Axis("rate", "deg/s"), Axis("more", "%"), [Series("output", rates, more)]
    )
    known = value_table(found.stated())
    text = Text("\n".join(dict.fromkeys(filter(None, words))))
    return Report([*([known] if known.rows else []), text, drawn])


RATE_LIMITS = Procedure(
    name="rate-limits",
    method=(
        "A straight line is taken through small rates of both signs; the rate (V_Vc, or the table) is raised until "
        "the output falls short of it, the limit is bisected, and one rate beyond and the small one are taken."
    ),
    settings=RateLimitsSettings,
    plan=rate_limits,
    results=results,
    report=report,
    needs=roles("multimeter"),
    either=roles("rate_source", "rate_table"),
    uses=roles("power", "oscilloscope", "v_vc_meter"),
    unforeseen=dict.fromkeys(("limit", "clipped", "comes_back"), "it goes with where the output ends"),
    watched=Watched(_HELD),
)
