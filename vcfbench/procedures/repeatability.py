"""Repeatability over switch-ons: scale factor and bias from one power-on to the next, and the transient after each.

The gyroscope is off and cools, is switched on, warms up and is measured; so many times. The standard deviation from
switch-on to switch-on is the repeatability of JJF 1535-2015 (3.2) and GJB 2426A, and IEEE 1431, 12.9 and 12.11, ask for
it. It is stated with the limits that so few switch-ons leave it (chi-square), beside what noise alone makes.
"""

import math
from collections.abc import Iterator, Sequence
from itertools import combinations
from statistics import fmean, stdev
from typing import Annotated, Any, ClassVar

from msgspec import Struct, structs

from vcfbench import steps
from vcfbench.analysis.allan import Sampling
from vcfbench.analysis.chopped import CHOPPED, Block
from vcfbench.analysis.noise_fit import Coefficients, NoiseFit, u_of_combination
from vcfbench.belief.chopped_level import chopped, table_due_deg_s
from vcfbench.belief.jumps import watched
from vcfbench.instructions import routines
from vcfbench.instructions.procedure import Procedure, Watched, roles
from vcfbench.instructions.scale_factor import LevelSettings, rates_by, scale_factor_used
from vcfbench.records.schema import Point
from vcfbench.reports.document import Axis, Figure, Report, Series, Table, Text, heads
from vcfbench.station.bounds import ranged
from vcfbench.station.invalid_value import InvalidValue
from vcfbench.steps.measured import Measured
from vcfbench.uncertainty.measurand import divided, mean_of_records, quantity_table, titled
from vcfbench.uncertainty.window_sum import windows_without_times
from vcfbench.values.value import Measurand, Value

_AT_LEVELS, _AFTER_POWER_ON = 1, 2
"""Steps of the points: the chopped block when warm, the window just after the drive has locked."""


class RepeatabilitySettings(LevelSettings, frozen=True, kw_only=True):
    """Settings of the repeatability over switch-ons, in addition to those of all procedures."""

    checked_warm: ClassVar[bool] = False
    warm_up_s: Annotated[float, ranged(0.0, 86_400.0, "wait after each power-on")] = 1800.0
    power_cycles: Annotated[int, ranged(3, 100, "number of switch-ons", option=True)] = 7
    off_s: Annotated[float, ranged(1.0, 86_400.0, "time without power before each switch-on but the first")] = 1800.0
    cycles: Annotated[int, ranged(1, 100, "blocks 0, +, -, -, +, 0 after each power-on")] = 1

    def contradictions(self) -> Iterator[InvalidValue]:
        yield from super().contradictions()
        yield from windows_without_times(self)


class SwitchOn(Struct, frozen=True):
    """One switch-on: bias when warm, V and deg/s, slope at the level, output just after power-on less that when warm.

    `slope` is in V/(deg/s), of the table or of the rate that V_Vc stands for.
    """

    bias_v: float
    bias_deg_s: float
    slope: float
    transient_deg_s: float


class Spread(Value, frozen=True):
    """Standard deviation from switch-on to switch-on, with the limits that hold the true one with 95 %.

    `by_noise` is what readings and flicker alone would make.
    """

    by_noise: float = 0.0

    def in_results(self) -> dict[str, Any]:
        """Return the result in the form of ``result.json``."""
        ends = {"low": self.low, "high": self.high}
        return {"value": self.value, **ends, "by_noise": self.by_noise, "unit": self.unit}


class RepeatabilityResult(Struct, frozen=True):
    """Result of the repeatability over switch-ons."""

    switch_ons: tuple[SwitchOn, ...]
    bias: Spread
    scale_factor: Spread
    turn_on_transient: Measurand
    """Output just after power-on less that when warm, mean over the switch-ons."""
    scale_factor_v_per_deg_s: float
    scale_factor_from: str

    def stated(self) -> Iterator[Value]:
        """Yield its values."""
        yield self.bias
        yield self.scale_factor
        yield titled("turn-on transient", self.turn_on_transient)


@routines.framed(routines.off_afterwards, routines.held_at_rest)
def repeatability(settings: RepeatabilitySettings) -> steps.Plan:
    """Switch on, warm up, measure, switch off and cool; so many times."""
    yield from routines.source_off(settings)
    block: list[Point] = []
    for number in range(settings.power_cycles):
        if number:
            yield steps.DisableSupply()
            yield steps.Settle(settings.off_s, "gyroscope cools")
        yield steps.Note(f"Switch-on {number + 1} of {settings.power_cycles}")
        yield steps.ConfigureMeter(float(settings.meter_range_v), float(settings.nplc))
        yield from routines.rails_on(settings, settings.settle_s, look=None)
        seen = yield from routines.look_at_drive(settings)
        due_deg_s = table_due_deg_s(settings, 0.0)
        yield from routines.take(settings, _AFTER_POWER_ON, rate_deg_s=0.0, v_vc_v=0.0, table_deg_s=due_deg_s)
        yield from routines.look_early(settings, held=True)
        yield steps.Settle(settings.start_up_s, "warm-up")
        block = yield from watched(settings, chopped(settings, settings.cycles, block))
    yield from routines.require_answer(settings)
    yield from routines.look_again(settings, seen)


def results(settings: RepeatabilitySettings, measured: Measured) -> RepeatabilityResult:
    """Return the spread from switch-on to switch-on."""
    scale = scale_factor_used(settings)
    windows = [(step, each) for step, each in measured.found(steps.Window) if isinstance(step, steps.Acquire)]
    early = [each for step, each in windows if step.step == _AFTER_POWER_ON]
    warm = [each for step, each in windows if step.step == _AT_LEVELS]
    size = len(CHOPPED)
    blocks = [Block(tuple(each.mean_v for each in warm[at : at + size])) for at in range(0, len(warm), size)]
    own = [blocks[at : at + settings.cycles] for at in range(0, len(blocks), settings.cycles)]
    found = []
    for first, each in zip(early, own, strict=True):
        bias_v = fmean(block.zero_v for block in each)
        rise_v = fmean(block.differences_v[0] - block.differences_v[1] for block in each)
        transient_deg_s = (first.mean_v - bias_v) / scale.value
        found.append(
            SwitchOn(
                bias_v, (bias_v - settings.null_v) / scale.value, rise_v / (2.0 * settings.level_deg_s), transient_deg_s
            )
        )
    readings = math.sqrt(fmean(each.std_v**2 / each.point.n for each in warm)) / abs(scale.value)
    begins_s = [float(each.readings[0].t_s) for each in warm[:: size * settings.cycles]]
    # What flicker alone makes of a sample: the root of half the mean square of all pairs' differences, which flicker
    # has though its variance has no limit
    b_deg_s = (settings.station.sources.bias_instability_deg_h or 0.0) / 3600.0
    flicker = NoiseFit(Coefficients(bias_instability=b_deg_s))
    lasts_s, sampling = settings.samples * settings.sample_interval_s, Sampling.without_gaps(settings.sample_interval_s)
    pairs = [
        u_of_combination(flicker, sampling, [one, other], [one + lasts_s, other + lasts_s], [1.0, -1.0]).u
        for one, other in combinations(begins_s, 2)
    ]
    flicker_deg_s = math.sqrt(0.5 * fmean(each**2 for each in pairs))
    of_bias = math.hypot(readings / math.sqrt(2.0 * settings.cycles), flicker_deg_s)
    of_slope = 1e6 * readings / math.sqrt(4.0 * settings.cycles) / settings.level_deg_s
    slope = fmean(each.slope for each in found)
    return RepeatabilityResult(
        tuple(found),
        structs.replace(
            _spread("bias_repeatability", [each.bias_deg_s for each in found], of_bias, "deg/s"),
            missing=() if scale.u is not None else ("scale factor",),
        ),
        _spread("scale_factor_repeatability", [1e6 * each.slope / slope for each in found], of_slope, "ppm"),
        divided(mean_of_records([each.transient_deg_s for each in found], "deg/s"), scale.value, scale.u),
        scale.value,
        scale.source,
    )


def _spread(name: str, values: Sequence[float], by_noise: float, unit: str) -> Spread:
    """Return the standard deviation with its chi-square limits (95 %)."""
    from scipy.special import chdtri  # noqa: PLC0415  # SciPy takes longer to import than all else

    dof, found = len(values) - 1, stdev(values)
    low, high = (found * math.sqrt(dof / float(chdtri(dof, tail))) for tail in (0.025, 0.975))
    of = f"standard deviation from switch-on to switch-on; noise alone makes {by_noise:.2g} {unit}"
    return Spread(name, found, unit, form="interval", low=low, high=high, kind=name, of=of, by_noise=by_noise)


def report(settings: RepeatabilitySettings, _points: Sequence[Point], found: RepeatabilityResult) -> Report:
    """Report each switch-on, and the spread."""
    numbers = list(range(1, len(found.switch_ons) + 1))
    columns = heads("switch-on | bias [deg/s]:.5f | slope [mV/(deg/s)]:.6f | transient [deg/s]:.4f")
    rows = [
        (number, each.bias_deg_s, 1e3 * each.slope, each.transient_deg_s)
        for number, each in zip(numbers, found.switch_ons, strict=True)
    ]
    spreads = [("bias", found.bias), ("scale factor", found.scale_factor)]
    spread = heads("<repeatability | s:.3g | from, 95 %:.3g | to, 95 %:.3g | by noise alone:.2g | <unit")
    with_what = "the table" if settings.by.value == "table" else "V_Vc"
    said = (
        f"s is the standard deviation over {len(numbers)} switch-ons, each after {settings.off_s:g} s without power "
        f"and {settings.start_up_s:g} s of warm-up (JJF 1535, 3.2); slope by {with_what}; "
        f"{rates_by(found.scale_factor_v_per_deg_s, found.scale_factor_from)}"
    )
    biases = Series("bias", numbers, [each.bias_deg_s for each in found.switch_ons])
    return Report(
        [
            Table(spread, [(name, s.value, s.low, s.high, s.by_noise, s.unit) for name, s in spreads]),
            quantity_table({"turn-on transient": found.turn_on_transient}),
            Table(columns, rows, "Switch-ons"),
            Text(said),
            Figure("Bias from switch-on to switch-on", Axis("switch-on"), Axis("bias", "deg/s"), [biases]),
        ]
    )


REPEATABILITY = Procedure(
    name="repeatability",
    method=(
        "The gyroscope is switched on, warms up, and its output is taken at rest and at a rate of both signs, chopped "
        "against drift; then it is switched off and cools. The standard deviations of bias and scale factor from one "
        "switch-on to the next are their repeatability."
    ),
    settings=RepeatabilitySettings,
    watched=Watched(frozenset({_AT_LEVELS}), steps.EnableSupply),
    plan=repeatability,
    results=results,
    report=report,
    needs=roles("power", "multimeter"),
    either=roles("rate_source", "rate_table"),
    uses=roles("oscilloscope"),
    in_one_piece="a pause between its switch-ons would change their cooling",
)
