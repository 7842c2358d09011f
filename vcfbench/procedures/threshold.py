"""Threshold, resolution and dead band: small steps of V_Vc, or of the table, about rest and about a rate.

IEEE 1431 (12.10) asks for them, IEEE 528 defines them: threshold and resolution are the smallest input, and change of
input, of which the output shows a stated share (half) of what the scale factor promises; in the dead band it shows less
than a tenth. No table comes as near to rest as V_Vc: 0.1 mV is 0.015 deg/s, and a meter on it resolves 1 uV.
"""

import math
from collections.abc import Iterator, Sequence
from statistics import fmean
from typing import Annotated, ClassVar, Literal, Self, cast

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from vcfbench import steps
from vcfbench.analysis.chopped import CHOPPED, Block
from vcfbench.analysis.input_limits import DeadBand, fit_dead_band
from vcfbench.belief.jumps import watched
from vcfbench.clock import utc_now
from vcfbench.devices.device import require_like_known
from vcfbench.errors import MeasurementError
from vcfbench.files import shown
from vcfbench.instructions import routines, v_vc
from vcfbench.instructions.kept import require_valid
from vcfbench.instructions.procedure import Procedure, Watched, roles
from vcfbench.instructions.scale_factor import ScaleFactorBy, not_on_bench, require_as_used, tells_scale_factor
from vcfbench.procedures.null_comparison.blocks import blocks_of, noise_of
from vcfbench.records.devices import Certificate, last_certificate
from vcfbench.records.schema import Point
from vcfbench.reports.document import Axis, Figure, Report, Series, Table, Text, heads
from vcfbench.station.bounds import Rate, ranged, said, several
from vcfbench.station.invalid_value import InvalidValue
from vcfbench.steps.step import Routine
from vcfbench.uncertainty.measurand import finite, measurand, titled, value_table
from vcfbench.values.sources import MISALIGNMENT, TABLE_RATE, V_VC_GAIN, V_VC_NOISE, V_VC_OFFSET
from vcfbench.values.value import Measurand, UncertaintyPart, Value

_AT_REST, _AT_RATE, _SEARCH = 1, 2, 3
"""Steps of the points: the blocks about rest, those about a rate, and the search for the level of rest."""
_WANTED_U = 0.1
"""Standard uncertainty of the smallest step's share that so many blocks are taken for."""
_ONE_SIDED = 1.645
"""Standard uncertainties that chance passes once in 20."""


class ThresholdSettings(v_vc.KnownVvcSettings, frozen=True, kw_only=True):
    """Settings of threshold, resolution and dead band, in addition to those of all procedures."""

    by: Annotated[ScaleFactorBy, said("source of the steps: V_Vc or the table", option=True)] = ScaleFactorBy.V_VC
    steps_deg_s: Annotated[tuple[Rate, ...], several(3, 100, "sizes of the steps, each taken to both sides")] = (
        *(2.0, 1.0, 0.5, 0.2),
        *(0.1, 0.05, 0.02),
    )
    at_rate_deg_s: Annotated[float, ranged(0.0, 5e3, "rate about which the resolution is taken")] = 10.0
    share: Annotated[float, ranged(0.1, 0.9, "share of the expected output at threshold and resolution")] = 0.5
    at_most_s: Annotated[float, ranged(60.0, 1e6, "run time up to which blocks beyond `cycles` are added")] = 7200.0
    v_vc_range_v: Annotated[Literal[1, 10, 100], said("fixed range of the meter on V_Vc")] = 1
    k_vc_deg_s_per_v: Annotated[
        Annotated[float, ranged(-1e6, 1e6)] | None,
        said("K_Vc; default: the device's certificate (--dut), else k_vc_guess_deg_s_per_v"),
    ] = None
    k_vc_u_deg_s_per_v: Annotated[
        Annotated[float, ranged(0.0, 1e6)] | None,
        said("standard uncertainty of K_Vc; without it values in deg/s are incomplete"),
    ] = None

    of_device: ClassVar[tuple[str, ...]] = ("k_vc_deg_s_per_v", "k_vc_u_deg_s_per_v")
    smooth: ClassVar[bool] = False

    def recalled(self) -> Self:
        """Return these settings with flicker and K_Vc of the device; ConfigError: its certificate is out of date."""
        settings = super().recalled()
        entries = () if self.dut is None else self.store.standing(self.dut)
        if self.k_vc_deg_s_per_v is not None:
            require_like_known(self, self.k_vc_deg_s_per_v, f"k_vc_deg_s_per_v = {self.k_vc_deg_s_per_v:g}", entries)
        entry = last_certificate(entries)
        if self.k_vc_deg_s_per_v is not None or entry is None:
            return settings
        record = cast("Certificate", entry.record)
        require_valid(record, shown(entry.path), utc_now(), outdated=self.outdated)
        u = math.sqrt(record.k_vc.covariance[1][1])
        return replace(settings, k_vc_deg_s_per_v=record.k_vc.coefficients[1], k_vc_u_deg_s_per_v=u)

    @property
    def early_look(self) -> tuple[str, ...]:
        """V_Vc by its K_Vc, where the bench file expects a scale factor."""
        return ("rate_source",) if tells_scale_factor(self) and self.by is ScaleFactorBy.V_VC else ()

    @property
    def k_vc_looked_at(self) -> float | None:
        """K_Vc of the settings, by which V_Vc makes the steps."""
        return self.k_vc_deg_s_per_v if self.by is ScaleFactorBy.V_VC else None

    def require_known_answer(self, slope: float, within: float, *, by_v_vc: bool) -> None:
        """See that the output answers to V_Vc as K_Vc and the expected scale factor have it."""
        per = self.k_vc_guess_deg_s_per_v / self.k_vc if by_v_vc else 1.0
        require_as_used(self, per * slope, abs(per) * within, by_v_vc=False)

    @property
    def k_vc(self) -> float:
        """K_Vc of the certificate, the settings or the guess, (deg/s)/V."""
        return self.expected_gyro().k_vc if self.k_vc_deg_s_per_v is None else self.k_vc_deg_s_per_v

    @property
    def sizes_deg_s(self) -> tuple[float, ...]:
        """The steps without sign, each once, the largest first."""
        return tuple(sorted({abs(each) for each in self.steps_deg_s}, reverse=True))

    @property
    def fastest_deg_s(self) -> float:
        return self.at_rate_deg_s + self.sizes_deg_s[0]

    def contradictions(self) -> Iterator[InvalidValue]:
        yield from super().contradictions()
        largest, *_, smallest = self.sizes_deg_s if len(self.sizes_deg_s) > 2 else (1.0, 0.0)
        if not smallest:
            yield InvalidValue("steps_deg_s", "three different sizes or more, without 0", list(self.steps_deg_s))
        if self.at_rate_deg_s < 2.0 * largest:
            yield InvalidValue("at_rate_deg_s", f"at least twice the largest step, {largest:g}", self.at_rate_deg_s)
        most_deg_s = self.station.limits.max_rate_deg_s
        yield from not_on_bench(self.by, self.station)
        if self.k_vc_deg_s_per_v == 0.0:
            yield InvalidValue("k_vc_deg_s_per_v", "a number that is not 0", 0.0)
        elif self.by is ScaleFactorBy.V_VC:
            yield from self.beyond_range(self.fastest_deg_s / self.k_vc, self.fastest_deg_s)
        elif most_deg_s is not None and self.fastest_deg_s > most_deg_s:
            yield InvalidValue("at_rate_deg_s", f"{most_deg_s:g} deg/s with the largest step", self.at_rate_deg_s)
        elif smallest < self.rate_tolerance_deg_s:
            expected = f"at least {self.rate_tolerance_deg_s:g} deg/s (rate_tolerance_deg_s), which is rest"
            yield InvalidValue("steps_deg_s", expected, smallest)


class InputLimit(Struct, frozen=True):
    """A limit of the input, as a rate and, where V_Vc made the steps, as V_Vc.

    Where it is not `seen`, noise makes as much of none once in 20, and what is known is `at_most_deg_s` (95 %).
    """

    deg_s: Measurand
    v_vc_v: Measurand | None
    seen: bool
    at_most_deg_s: float

    def value(self, name: str, words: str = "") -> Value:
        """Return the value, or a bound if noise may make as much."""
        found = self.deg_s.called(name, words=words)
        return found if self.seen else found.bound("below", self.at_most_deg_s)


class StepShare(Struct, frozen=True):
    """Share of the expected output that a step showed to either side, and its standard uncertainty."""

    about_deg_s: float
    step_deg_s: float
    plus: float
    minus: float
    u: float


class ThresholdResult(Struct, frozen=True):
    """Result of threshold, resolution and dead band; the dead band's half width, the threshold from its middle."""

    dead_band: InputLimit
    threshold: InputLimit
    resolution: InputLimit
    shares: tuple[StepShare, ...]
    blocks: int
    """Blocks of each step."""

    def stated(self) -> Iterator[Value]:
        """Yield its values."""
        yield self.dead_band.value("dead_band", "dead band, half width")
        yield self.threshold.value("threshold")
        yield self.resolution.value("resolution")


@routines.framed(routines.energised, routines.drive_seen, routines.held_at_rest, watched)
def threshold(settings: ThresholdSettings) -> steps.Plan:
    """Find the level of rest, then step about it and about a rate."""
    by_v_vc, sizes = settings.by is ScaleFactorBy.V_VC, settings.sizes_deg_s
    rest_v, at, used = 0.0, 0.0, set[float]()
    if by_v_vc:
        yield from v_vc.ready_v_vc_meter(settings, settings.v_vc_range_v)
        rest_v = yield from _level_of_rest(settings)
    blocks, taken = settings.cycles, 0
    while taken < blocks:
        for step, about_deg_s in ((_AT_REST, 0.0), (_AT_RATE, settings.at_rate_deg_s)):
            for size_deg_s in sizes:
                points: list[Point] = []
                for sign in CHOPPED:
                    point = yield from _window(settings, step, about_deg_s + sign * size_deg_s, rest_v, at)
                    at = point.v_vc_v if by_v_vc else point.rate_deg_s
                    used.add(at)
                    points.append(point)
                if not taken and len(used) == 3:
                    blocks = _blocks_wanted(settings, points)
                    yield steps.Note(f"{blocks} blocks of {len(sizes)} steps, about rest and about a rate")
        taken += 1
    if by_v_vc:
        yield from v_vc.measured_levels(settings, sorted(used))


def _window(
    settings: ThresholdSettings, step: int, rate_deg_s: float, rest_v: float, previous_deg_s: float
) -> Routine[Point]:
    """Go to a rate of the table, or to the V_Vc that stands for it, and take a window."""
    if settings.by is ScaleFactorBy.V_VC:
        set_v = yield from routines.set_v_vc(settings, rest_v + rate_deg_s / settings.k_vc)
        return (yield from v_vc.take_driven(settings, step, rate_deg_s=rate_deg_s, v_vc_v=set_v, table_deg_s=None))
    if rate_deg_s != previous_deg_s:
        yield from routines.go_to_rate(settings, rate_deg_s, previous_deg_s=previous_deg_s)
    return (yield from routines.take(settings, step, rate_deg_s=rate_deg_s, v_vc_v=0.0, table_deg_s=rate_deg_s))


def _level_of_rest(settings: ThresholdSettings) -> Routine[float]:
    """Return the setting of V_Vc at which the output is that with the generator off, the modulator's leakage undone.

    MeasurementError: the output does not answer.
    """
    yield steps.Settle(settings.settle_s, "gyro settles, generator off")
    rest = yield from routines.take(settings, _SEARCH, rate_deg_s=0.0, v_vc_v=0.0)
    yield from routines.v_vc_on(settings.settle_s)
    level_v = 0.0
    for span_deg_s in (settings.fastest_deg_s, settings.sizes_deg_s[0], settings.sizes_deg_s[0]):
        below = yield from _window(settings, _SEARCH, -span_deg_s, level_v, 0.0)
        middle = yield from _window(settings, _SEARCH, 0.0, level_v, 0.0)
        above = yield from _window(settings, _SEARCH, span_deg_s, level_v, 0.0)
        below_v, middle_v, above_v = (v_vc.measured_level([each], {}) for each in (below, middle, above))
        rise_v = above.output_v - below.output_v
        if not abs(rise_v) > 10.0 * max(below.std_v, above.std_v) / math.sqrt(rest.n):
            raise MeasurementError(
                f"steps of {span_deg_s:g} deg/s either way by V_Vc move the output by {rise_v:+.3g} V",
                instrument="multimeter",
                step=str(_SEARCH),
                hint="check the lead of V_Vc; a wide dead band needs larger steps_deg_s",
            )
        level_v += below_v + (rest.output_v - below.output_v) * (above_v - below_v) / rise_v - middle_v
    return level_v


def _blocks_wanted(settings: ThresholdSettings, points: Sequence[Point]) -> int:
    """Return how many blocks let the smallest step's share be known well, by the noise of one; within the time."""
    block, sizes = Block(tuple(each.output_v for each in points)), settings.sizes_deg_s
    plus_v, minus_v = block.differences_v
    u_v = math.sqrt(noise_of(settings, [block], points).covariance_v2[0][0])
    wanted = (2.0 * sizes[0] * u_v / (max(abs(plus_v - minus_v), u_v) * sizes[-1] * _WANTED_U)) ** 2
    window_s = settings.samples * settings.sample_interval_s + settings.settle_s
    most = int(settings.at_most_s / (2.0 * len(sizes) * len(CHOPPED) * window_s))
    return max(settings.cycles, min(most, math.ceil(wanted)))


def results(settings: ThresholdSettings, points: Sequence[Point]) -> ThresholdResult:
    """Return the limits of the input from the blocks about rest and about the rate."""
    at_rest, of_rest, shown = _about(settings, points, _AT_REST, 0.0)
    at_rate, of_rate, shown_at_rate = _about(settings, points, _AT_RATE, settings.at_rate_deg_s)
    beyond = 1.0 / (1.0 - settings.share)  # an input so many half widths from the middle shows the share
    return ThresholdResult(
        _limit(settings, at_rest, of_rest, 1.0),
        _limit(settings, at_rest, of_rest, beyond),
        _limit(settings, at_rate, of_rate, beyond),
        (*shown, *shown_at_rate),
        sum(point.step == _AT_REST for point in points) // (len(CHOPPED) * len(settings.sizes_deg_s)),
    )


def _about(
    settings: ThresholdSettings, points: Sequence[Point], step: int, about_deg_s: float
) -> tuple[DeadBand, list[UncertaintyPart], list[StepShare]]:
    """Return the half width of the band in which steps about one input are invisible, and the response to each step."""
    by_v_vc = settings.by is ScaleFactorBy.V_VC
    by_hand = v_vc.levels_by_hand(settings, points) if by_v_vc else {}
    sizes, own = settings.sizes_deg_s, [point for point in points if point.step == step]
    taken = blocks_of(own)
    count, chopped = len(taken) // len(sizes), [Block(tuple(each.output_v for each in block)) for block in taken]
    inputs = [
        Block(tuple(v_vc.measured_level([p], by_hand) if by_v_vc else p.rate_deg_s for p in each)) for each in taken
    ]
    y, x = (np.array([b.differences_v for b in each]).reshape(count, -1).mean(axis=0) for each in (chopped, inputs))
    if (lost := np.flatnonzero(x == 0.0)).size:
        size = sizes[int(lost[0]) // 2]
        raise MeasurementError(
            f"steps of {size:g} deg/s about {about_deg_s:g} deg/s make no difference of V_Vc: the generator's own are "
            "larger there",
            instrument="rate_source",
            hint="larger steps_deg_s",
        )
    noise, rough = noise_of(settings, chopped, own), float(x @ y / (x @ x))
    scatter_v2 = [p.v_vc_std_v**2 / p.n for p in own if p.v_vc_std_v is not None]
    u_offset_v = v_vc.v_vc_error(settings).u_offset_v if by_v_vc and settings.v_vc_role is None else 0.0
    level = rough**2 * np.array([[1.0, 0.5], [0.5, 1.0]])  # both steps of a pair are from the same zero
    of_pair = {
        v_vc.READINGS: np.array(noise.covariance_v2) / count,
        V_VC_NOISE: level * (fmean(scatter_v2) / count if scatter_v2 else 0.0),
        V_VC_OFFSET: level * 2.0 * u_offset_v**2,
    }
    fit = fit_dead_band(x, y, {name: np.asarray(np.kron(np.eye(len(sizes)), each)) for name, each in of_pair.items()})
    parts = [
        UncertaintyPart(name, u, finite(noise.dof) if name == v_vc.READINGS else None) for name, u in fit.u.items()
    ]
    u_v = math.sqrt(of_pair[v_vc.READINGS][0, 0])
    seen = zip(sizes, (y / (fit.slope * x)).reshape(-1, 2).tolist(), x[::2].tolist(), strict=True)
    shares = [StepShare(about_deg_s, size, up, down, u_v / abs(fit.slope * of)) for size, (up, down), of in seen]
    return fit, [part for part in parts if part.u], shares


def _limit(settings: ThresholdSettings, half: DeadBand, parts: list[UncertaintyPart], beyond: float) -> InputLimit:
    """Return the limit of the input that is `beyond` half widths from the middle."""
    own, in_volts = [replace(part, u=beyond * part.u) for part in parts], None
    size, missing = beyond * half.half_width, False
    if settings.by is ScaleFactorBy.TABLE:
        of_rate = {TABLE_RATE: v_vc.table_rate_error(settings), MISALIGNMENT: v_vc.alignment_error(settings)}
        own += [UncertaintyPart(name, size * u) for name, u in of_rate.items()]
    else:
        error, k_vc, u_k_vc = v_vc.v_vc_error(settings), abs(settings.k_vc), settings.k_vc_u_deg_s_per_v
        own.append(UncertaintyPart(V_VC_GAIN, size * error.u_gain, None, error.owner))
        in_volts = measurand(size, "V", own)
        own = [replace(part, u=k_vc * part.u) for part in own]
        own.append(UncertaintyPart("K_Vc", size * (u_k_vc or 0.0)))
        size, missing = k_vc * size, u_k_vc is None
    found = measurand(size, "deg/s", own, ["K_Vc"] * missing)
    once_in_20 = _ONE_SIDED / 1.96 * found.u95
    return InputLimit(found, in_volts, size > once_in_20, max(size, 0.0) + once_in_20)


def report(settings: ThresholdSettings, _points: Sequence[Point], found: ThresholdResult) -> Report:
    """Report the limits, and the share that each step showed."""
    limits = {"dead band, half width": found.dead_band, "threshold": found.threshold, "resolution": found.resolution}
    volts = {f"{name} of V_Vc": each.v_vc_v for name, each in limits.items() if each.v_vc_v is not None}
    none = "not detected, at most {:.2g} deg/s (95 %)"
    words = [f"{name}: {'detected' if each.seen else none.format(each.at_most_deg_s)}" for name, each in limits.items()]
    with_what = "V_Vc" if settings.by is ScaleFactorBy.V_VC else "the table"
    method = (
        f"{found.blocks} blocks of each step by {with_what}, chopped against drift. Threshold and resolution are the "
        f"steps that show {100.0 * settings.share:g} % of the expected output, the threshold from the middle of the "
        "dead band. Model beyond the dead band: one line to either side, with equal slopes."
    )
    columns = heads("about [deg/s]:g | step [deg/s]:g | share, up [%]:.1f | share, down [%]:.1f | u [%]:.1f")
    shown = [(s.about_deg_s, s.step_deg_s, 100.0 * s.plus, 100.0 * s.minus, 100.0 * s.u) for s in found.shares]
    series = [
        Series(f"about {about:g} deg/s", [s.step_deg_s for s in own], [50.0 * (s.plus + s.minus) for s in own])
        for about in (0.0, settings.at_rate_deg_s)
        if (own := [s for s in found.shares if s.about_deg_s == about])
    ]
    return Report(
        [
            value_table([*found.stated(), *(titled(*each) for each in volts.items())]),
            Text("\n".join([*words, method])),
            Table(columns, shown, "Share of the expected output"),
            Figure("Share of the expected output", Axis("step", "deg/s"), Axis("share", "%"), series),
        ]
    )


THRESHOLD = Procedure(
    name="threshold",
    method=(
        "V_Vc, or the table, is stepped to both sides of rest, and of a rate, by less and less, chopped against drift. "
        "A line through the steps to either side tells the dead band between them, threshold and resolution."
    ),
    settings=ThresholdSettings,
    plan=threshold,
    results=results,
    report=report,
    needs=roles("multimeter"),
    either=roles("rate_source", "rate_table"),
    uses=roles("power", "oscilloscope", "v_vc_meter"),
    watched=Watched(),
)
