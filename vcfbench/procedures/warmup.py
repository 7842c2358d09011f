"""Warm-up: the output at rest from power-on until it is steady, and the exponential that it follows.

First the output is read quickly while the drive loop starts (turn-on), then in means of a minute. The run ends when
three of them in a row agree and their slope is below the bias instability a minute (after IEEE 952, 6.6), not before
`shortest_s`, since the end of an exponential is not seen in its middle; or at `longest_s`, and then says so.
"""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from statistics import median
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from vcfbench import steps
from vcfbench.analysis.allan import Sampling
from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.noise_fit import Coefficients
from vcfbench.belief.jumps import watched
from vcfbench.clock import sleep
from vcfbench.instructions import routines
from vcfbench.instructions.procedure import Procedure, Watched, roles
from vcfbench.instructions.scale_factor import LookedAtSettings, ScaleFactor, rates_by, scale_factor_used
from vcfbench.records.schema import Point
from vcfbench.reports.document import Axis, Figure, Report, Series, Table, Text, heads
from vcfbench.station.bounds import ranged
from vcfbench.station.invalid_value import InvalidValue
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.station.settings import Sources
from vcfbench.steps.measured import Foreseen, Measured
from vcfbench.steps.step import Context, Reading, Routine, Step, StepResult, answer
from vcfbench.uncertainty.at_rest import about_horizon, as_rate, flicker_part, parts_at_rest
from vcfbench.uncertainty.measurand import budget_table, measurand, printed
from vcfbench.uncertainty.windows import Flicker
from vcfbench.values.value import Measurand, UncertaintyPart

_SIGMAS = 3.0
_FLOOR = 0.6643
"""Floor of the Allan deviation over the bias instability."""
_SHOWS = 3.0
"""An exponential below so many of its uncertainties is not seen, and has no time constant."""
_PARAMETERS = 3
_LONGEST = 3.0
"""Longest time constant that is looked for, in lengths of the record: beyond, the creep is a line in it."""
_TIME_CONSTANTS = 300
"""Number of time constants that are tried."""
_UNLIKELY, _RESOLVED = 1e-6, 30
"""Part of the likelihood that is nothing, and how many time constants must share the rest."""
_FIT_S = 10.0
"""The curve is fitted to means of so many seconds."""


_QUICK_NPLC = 1.0
_QUICK_INTERVAL_S = 0.1
"""While the drive loop starts: ten readings a second of one power-line cycle."""


class WarmupSettings(LookedAtSettings, frozen=True, kw_only=True):
    """Settings of the warm-up, in addition to those of all procedures."""

    creeps: ClassVar[bool] = True
    checked_warm: ClassVar[bool] = False
    waits: ClassVar[str] = "shortest_s"
    shortest_s: Annotated[float, ranged(180.0, 86_400.0, "shortest time from power-on to steady")] = 1800.0
    longest_s: Annotated[float, ranged(180.0, 86_400.0, "longest time from power-on, steady or not")] = 3600.0
    window_s: Annotated[float, ranged(10.0, 600.0, "length of the means that must agree")] = 60.0
    bias_instability_deg_h: Annotated[
        float, ranged(1e-3, 1e6, "B of this gyroscope from its zero record: limit of steady")
    ] = 5.6
    turn_on_tolerance_deg_s: Annotated[
        float, ranged(1e-3, 1e3, "the output is on once it stays this close to its final value")
    ] = 1.0

    @property
    def readings_a_window(self) -> int:
        """Number of readings of one mean."""
        return max(4, round(self.window_s / self.sample_interval_s))

    @property
    def warm_again_s(self) -> float:
        """Waiting time as a part of a run: the shortest."""
        return self.shortest_s

    def contradictions(self) -> Iterator[InvalidValue]:
        yield from super().contradictions()
        if self.longest_s < self.shortest_s:
            yield InvalidValue("longest_s", f"at least shortest_s, {self.shortest_s:g} s", self.longest_s)
        if self.shortest_s < 3.0 * self.window_s:
            yield InvalidValue("shortest_s", f"at least three windows of {self.window_s:g} s", self.shortest_s)


class WarmupResult(Struct, frozen=True):
    """A warm-up; times count from power-on.

    Of an exponential that is not seen, amplitude, time constant and warm-up are None.
    """

    turn_on_s: float | None
    """From then on the output stays within the tolerance; None: it had not come to that when the log ended."""
    turn_on_resolution_s: float
    steady: bool
    """True if the last three means agreed."""
    lasted_s: float
    bias_end: Measurand
    """b_inf of b_inf + a exp(-t / tau), as the mean over the horizon about the record, deg/s."""
    amplitude: Measurand | None
    time_constant: Measurand | None
    warm_up: Measurand | None
    """Time until the exponential has fallen below the bias instability."""
    bias_instability_deg_s: float
    chi_square: float
    dof: int
    scale_factor_v_per_deg_s: ScaleFactor
    means_t_s: tuple[float, ...]
    means_deg_s: tuple[float, ...]
    means_u_deg_s: tuple[float, ...]

    def curve_deg_s(self, t_s: float) -> float:
        """Return the fitted output at `t_s` after power-on, deg/s."""
        if self.amplitude is None or self.time_constant is None:
            return self.bias_end.value
        return self.bias_end.value + self.amplitude.value * math.exp(-t_s / self.time_constant.value)


def is_steady(settings: WarmupSettings, points: Sequence[Point]) -> bool:
    """Return True if the last three means agree within three sigma, and move by less than the instability a minute.

    Sigma is that of a mean: its readings' scatter over the root of their number, and the flicker floor.
    """
    last = points[-3:]
    if len(last) < 3:
        return False
    instability_v = abs(scale_factor_used(settings).value) * _b_deg_s(settings)
    means = [point.output_v for point in last]
    variance = sum(point.std_v**2 / point.n for point in last) / len(last)
    sigma_v = math.sqrt(variance + (_FLOOR * instability_v) ** 2)
    window_s = settings.readings_a_window * settings.sample_interval_s
    slope_v_min = abs(means[-1] - means[0]) / ((len(means) - 1) * window_s / 60.0)
    return max(means) - min(means) <= _SIGMAS * sigma_v and slope_v_min <= instability_v


def warmup_results(
    settings: WarmupSettings,
    scale: ScaleFactor,
    log: Sequence[tuple[float, float]],
    windows: Sequence[tuple[Floats, Floats]],
    *,
    steady: bool,
    creeps: bool = True,
) -> WarmupResult:
    """Return the results of a warm-up.

    Args:
        settings: of the run.
        scale: by which outputs are rates.
        log: time from power-on (s) and output (V) of each quick reading.
        windows: the same of the windows, an array each.
        steady: whether the last means agreed.
        creeps: whether there may be an exponential to be found; none is foreseen.
    """
    instability_deg_s, known = _b_deg_s(settings), settings.station.sources
    log = [(t_s, volts / scale.value) for t_s, volts in log]
    windows = [(t_s, volts / scale.value) for t_s, volts in windows]
    begin_s, end_s, means, u_scatter = _means(windows, settings.sample_interval_s)
    u_white = np.maximum(u_scatter, settings.meter_resolution_v / abs(scale.value) / math.sqrt(12.0))
    # The Cholesky factor of the means' covariance: their white noise, and flicker about its own mean. Flicker has no
    # mean of its own: what it is over this record counts as part of the bias
    law = Coefficients(bias_instability=instability_deg_s).phase_noise(Sampling.without_gaps(1.0))
    share = np.hstack([np.eye(means.size), -np.eye(means.size)]) / (end_s - begin_s)[:, None]
    about = np.eye(means.size) - 1.0 / means.size
    slow = about @ share @ law.among(np.concatenate([end_s, begin_s])) @ share.T @ about.T
    root: Floats = np.asarray(np.linalg.cholesky(slow + np.diag(u_white**2)), dtype=np.float64)
    ones, white = np.linalg.solve(root, np.column_stack([np.ones(means.size), means])).T
    weight = float(ones @ ones)
    bias, u_bias = float(ones @ white) / weight, 1.0 / math.sqrt(weight)
    chi_square = float(((white - bias * ones) ** 2).sum())
    dof, creep = means.size - 1, dict[str, Measurand]()
    if creeps and means.size > _PARAMETERS:
        least, known_bias, found = _creep(begin_s, end_s, means, root, instability_deg_s)
        if chi_square - least > _SHOWS**2:
            chi_square, (bias, u_bias), creep, dof = least, known_bias, found, means.size - _PARAMETERS
    # An exponential that was not seen may be there: what the bench file knows of the warm-up is in the mean then
    begun_s, ended_s, seen = float(begin_s[0]), float(end_s[-1]), bool(creep)
    around = parts_at_rest(settings, bias * scale.value, scale.value, ended_s)
    flicker = Flicker(3600.0 * instability_deg_s, math.inf, "bias_instability_deg_h")
    per_deg_h = abs(scale.value) / 3600.0 * about_horizon([begun_s], [ended_s], known.horizon_h)
    parts = [
        UncertaintyPart("fit", abs(scale.value) * u_bias),
        flicker_part(flicker, per_deg_h),
        *(part for part in around if not (seen and part.source == "warm-up")),
    ]
    missing = [name for name in known.missing("bias") if not (seen and name == "warm-up")]
    return WarmupResult(
        turn_on_s=_turn_on(log, settings.turn_on_tolerance_deg_s),
        turn_on_resolution_s=max((later[0] - t_s for (t_s, _), later in pairwise(log)), default=0.0),
        steady=steady,
        lasted_s=ended_s,
        bias_end=as_rate(
            measurand(bias * scale.value, "V", parts, missing), scale.value, scale.u, settings.null_v
        ).called("bias_end", "bias_at_rest_deg_s", "bias, warm"),
        amplitude=creep.get("amplitude"),
        time_constant=creep.get("time_constant"),
        warm_up=creep.get("warm_up"),
        bias_instability_deg_s=instability_deg_s,
        chi_square=chi_square,
        dof=dof,
        scale_factor_v_per_deg_s=scale,
        means_t_s=tuple(float(t_s.mean()) for t_s, _ in windows),
        means_deg_s=tuple(float(rate.mean()) for _, rate in windows),
        means_u_deg_s=tuple(float(np.std(rate, ddof=1)) / math.sqrt(rate.size) for _, rate in windows),
    )


def _turn_on(log: Sequence[tuple[float, float]], tolerance_deg_s: float) -> float | None:
    """Return the time from which all readings lie within the tolerance of the median of the last fifth."""
    if not log:
        return None
    end_deg_s = median(rate for _, rate in log[-max(1, len(log) // 5) :])
    outside = [place for place, (_, rate) in enumerate(log) if abs(rate - end_deg_s) > tolerance_deg_s]
    first = outside[-1] + 1 if outside else 0
    return None if first > len(log) - max(1, len(log) // 5) else log[first][0]


def _means(windows: Sequence[tuple[Floats, Floats]], interval_s: float) -> tuple[Floats, Floats, Floats, Floats]:
    """Return begin, end, mean and white standard uncertainty of means of some seconds, whole blocks of each window."""
    block = max(1, round(_FIT_S / interval_s))
    begin_s, means, squares, degrees = [], [], 0.0, 0
    for t_s, rate in windows:
        size = min(block, rate.size)
        for first in range(0, rate.size - size + 1, size):
            part = rate[first : first + size]
            begin_s.append(float(t_s[first]))
            means.append(float(part.mean()))
            squares += float(((part - part.mean()) ** 2).sum())
            degrees += size - 1
    std = math.sqrt(squares / max(1, degrees))
    begin = np.array(begin_s)
    return begin, begin + size * interval_s, np.array(means), np.full(begin.size, std / math.sqrt(size))


def _creep(
    begin_s: Floats, end_s: Floats, means: Floats, root: Floats, instability_deg_s: float
) -> tuple[float, tuple[float, float], dict[str, Measurand]]:
    """Return chi-square, b_inf with its u (deg/s), and the exponential of the means, weighed by its likelihood.

    Each mean is the integral over its seconds.

    A time constant that noise has made short looks better known than it is, a long one worse: the slope of the fit at
    what was found is no measure of its uncertainty. So every time constant counts by its best fit, any logarithm being
    as likely beforehand, from a block's length to some records'.
    """
    ones, white = np.linalg.solve(root, np.column_stack([np.ones(means.size), means])).T
    weight = float(ones @ ones)
    mean = float(ones @ white) / weight
    white = white - mean * ones
    least_s, most_s = _FIT_S, _LONGEST * float(end_s[-1])
    while True:
        tau_s = np.geomspace(least_s, most_s, _TIME_CONSTANTS)
        begun, ended = (np.exp(-np.outer(each, 1.0 / tau_s)) for each in (begin_s, end_s))
        decays = np.linalg.solve(root, tau_s * (begun - ended) / (end_s - begin_s)[:, None])
        shares = ones @ decays / weight
        decays -= np.outer(ones, shares)
        squares = (decays**2).sum(axis=0)
        amplitudes = white @ decays / squares
        chi_square = float(white @ white) - amplitudes**2 * squares
        likely = np.exp(-0.5 * (chi_square - chi_square.min()))
        likely /= likely.sum()
        among = np.flatnonzero(likely > _UNLIKELY)
        if among.size > _RESOLVED:
            break
        # A warm-up far above the noise is known to less than a step between the time constants: look there again
        least_s, most_s = (float(tau_s[max(0, min(tau_s.size - 1, at))]) for at in (among[0] - 1, among[-1] + 1))

    def known(values: Floats, variances: Floats) -> tuple[float, float]:
        middle = float(likely @ values)
        return middle, math.sqrt(float(likely @ (variances + (values - middle) ** 2)))

    warm_up_s = tau_s * np.log(np.maximum(np.abs(amplitudes) / instability_deg_s, 1.0))
    by_amplitude, cools = np.zeros(tau_s.size), warm_up_s > 0.0
    by_amplitude[cools] = (tau_s**2 / squares)[cools] / amplitudes[cools] ** 2
    amplitude, u_amplitude = known(amplitudes, 1.0 / squares)
    bias = known(mean - amplitudes * shares, 1.0 / weight + shares**2 / squares)
    exponential = {
        "amplitude": measurand(amplitude, "deg/s", [UncertaintyPart("fit", u_amplitude)]),
        "time_constant": _stated(tau_s, likely, known(tau_s, 0.0 * tau_s)),
        "warm_up": _stated(warm_up_s, likely, known(warm_up_s, by_amplitude)),
    }
    return float(chi_square.min()), bias, exponential


def _stated(values_s: Floats, likely: Floats, found: tuple[float, float]) -> Measurand:
    """Return a time, with the half width about it that holds 95 % of the likelihood as its U95."""
    value, u = found
    away = np.abs(values_s - value)
    order = np.argsort(away)
    half = float(away[order][np.searchsorted(np.cumsum(likely[order]), 0.95)])
    return Measurand("", value, "s", u, u95=half, parts=(UncertaintyPart("fit", u),))


def warmup_report(_settings: object, _measured: Measured, found: WarmupResult) -> Report:
    """Report a warm-up: the figures, their omissions, and the curve."""
    scale = found.scale_factor_v_per_deg_s
    columns = heads("< | value:.5g | u:.2g | U95:.2g | unit")
    rows: list[Any] = [
        ("turn-on", found.turn_on_s, None, None, "s"),
        ("b_inf", *printed(found.bias_end), found.bias_end.unit),
    ]
    named = (("a", found.amplitude, "deg/s"), ("tau", found.time_constant, "s"), ("warm-up", found.warm_up, "s"))
    rows += [(name, *((None,) * 3 if each is None else printed(each)), unit) for name, each, unit in named]
    ended = "three means in a row agree" if found.steady else "NOT steady: the last three means disagree"
    unseen = "no exponential exceeds noise and flicker: no time constant, b_inf is the mean of all readings\n"
    said = (
        f"{rates_by(scale.value, scale.source)}\n{ended}, {found.lasted_s:.0f} s after power-on\n"
        f"{unseen if found.time_constant is None else ''}warm-up: until a exp(-t / tau) is below the bias instability, "
        f"{3600.0 * found.bias_instability_deg_s:.3g} deg/h; turn-on resolved to {found.turn_on_resolution_s:.2g} s\n"
        "u contains noise of the readings and flicker of that size; u of b_inf holds for the mean over horizon_h, and "
        "contains multimeter, temperature, phases and scale factor as far as they are known, not turn-on to turn-on"
    )
    times = found.means_t_s
    means = Series("means", times, found.means_deg_s, found.means_u_deg_s)
    curve = Series("fit", times, [found.curve_deg_s(t_s) for t_s in times], kind="line")
    axes = Axis("time from power-on", "s"), Axis("rate", "deg/s")
    figure = Figure("Warm-up of the output at rest", *axes, [means, curve])
    return Report([Text(said), Table(columns, rows), budget_table("b_inf", found.bias_end), figure])


class SwitchedOn(StepResult, Struct, frozen=True):
    """The bench time at which the supply was commanded on, s, and the output from then on."""

    t_s: float
    log: tuple[Reading, ...]

    def corrected(self, step: Step, known: Sources) -> Self:
        return replace(self, log=tuple(each.corrected(known) for each in self.log))

    def describe(self) -> str:
        return f"{len(self.log)} readings from power-on"


class SwitchOnAndLog(steps.EnableSupply, frozen=True):
    """Switch the supply on and read the output from the first instant, one reading every `interval_s`."""

    seconds: float
    interval_s: float

    def describe(self) -> str:
        return f"supply outputs on; the output every {self.interval_s:g} s for {self.seconds:g} s"

    @property
    def physical_s(self) -> float:
        return self.seconds

    def perform(self, context: Context) -> Any:
        clock, meter = context.bench.clock, context.bench.multimeter
        begun_s = clock.now()
        context.bench.power.enable_outputs()
        log = []
        while (now_s := clock.now()) < begun_s + self.seconds:
            log.append(Reading(now_s, context.believable(meter.read_voltage_v)))
            sleep(clock, max(0.0, now_s + self.interval_s - clock.now()))
        return SwitchedOn(begun_s, tuple(log))

    def predict(self, gyro: LinearGyro) -> Any:
        count = max(1, int(self.seconds / self.interval_s))
        return SwitchedOn(0.0, tuple(Reading(n * self.interval_s, gyro.output_v(0.0)) for n in range(count)))


@routines.framed(routines.off_afterwards, routines.held_at_rest)
def warmup(settings: WarmupSettings) -> steps.Plan:
    """Follow the output from power-on: V_Vc off, the table (where there is one) held still under servo."""
    yield steps.Note("Power-on")
    yield steps.ConfigureMeter(float(settings.meter_range_v), _QUICK_NPLC)
    yield from routines.source_off(settings)
    rails = routines.rails_of(settings)
    for rail in rails:  # noqa: UP028  # a tuple cannot be sent results
        yield rail
    yield SwitchOnAndLog(settings.drive.start_up_s, _QUICK_INTERVAL_S)
    yield steps.CheckRails(rails, settings.rail_tolerance_v)
    yield steps.ConfigureMeter(float(settings.meter_range_v), float(settings.nplc))
    seen = yield from routines.look_at_drive(settings)
    yield from routines.look_early(settings, held=True)
    yield steps.Note(f"The output at rest, {settings.shortest_s:g} to {settings.longest_s:g} s")
    table_deg_s = None if settings.station.limits.max_rate_deg_s is None else 0.0
    of_all = {**routines.window_of(settings), "samples": settings.readings_a_window}
    yield from watched(settings, _until_steady(settings, steps.Acquire(1, 0.0, 0.0, table_deg_s, **of_all)))
    yield from routines.require_answer(settings)
    yield from routines.look_again(settings, seen)


def _until_steady(settings: WarmupSettings, window: steps.Acquire) -> Routine[None]:
    """Take windows until three in a row agree, or the time is up."""
    points: list[Point] = []
    steady, elapsed_s = False, 0.0
    while not points or not (steady or elapsed_s + window.physical_s > settings.longest_s):
        points.append(answer((yield window), steps.Window).point)
        routines.require_alive(settings, points[-1])
        elapsed_s = settings.drive.start_up_s + len(points) * window.physical_s
        steady = elapsed_s >= settings.shortest_s and is_steady(settings, points)


def _b_deg_s(settings: WarmupSettings) -> float:
    """Return B, deg/s: that of the settings, or of the bench file, where that is larger and not assumed."""
    known = settings.station.sources
    stated = None if "bias_instability_deg_h" in known.assumed else known.bias_instability_deg_h
    return max(settings.bias_instability_deg_h, stated or 0.0) / 3600.0


def results(settings: WarmupSettings, measured: Measured) -> WarmupResult:
    """Return the results of a warm-up, its times counted from power-on."""
    ((_, switched),) = measured.found(SwitchedOn)
    log = [(each.t_s - switched.t_s, each.voltage_v) for each in switched.log]
    windows = [(each.t_s - switched.t_s, each.voltage_v) for each in measured.readings.windows]
    creeps = not isinstance(measured, Foreseen)
    scale = routines.scale_factor_seen(settings, measured)
    return warmup_results(settings, scale, log, windows, steady=is_steady(settings, measured), creeps=creeps)


WARMUP = Procedure(
    name="warmup",
    method=(
        "From power-on the output is recorded at rest until three means in a row agree, or the longest time is over. "
        "Turn-on is when the output first stays within its tolerance; an exponential fitted to the readings gives "
        "amplitude, time constant and warm-up time."
    ),
    settings=WarmupSettings,
    plan=warmup,
    results=results,
    report=warmup_report,
    unforeseen=dict.fromkeys(("amplitude", "time_constant", "warm_up"), "it goes with how the output warms up"),
    watched=Watched(),
    in_one_piece="a warm-up begins with power-on; after a break the gyroscope is warm, or cold again",
    needs=roles("power", "multimeter"),
    uses=roles("oscilloscope", "rate_source", "rate_table"),
)
