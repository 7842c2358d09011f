"""Results of a test of the supply: inrush, valid output, steady currents, sensitivity to each rail."""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from statistics import NormalDist, fmean, stdev
from typing import Annotated, Literal, Self, TypeAlias

from msgspec import Struct, structs
from msgspec.structs import replace

from vcfbench.analysis.chopped import CHOPPED, Block, BlockNoise, block_noise
from vcfbench.errors import ConfigError
from vcfbench.instructions import routines
from vcfbench.instructions.scale_factor import LevelSettings, LookedAtSettings, ScaleFactor, rates_by
from vcfbench.reports.document import Axis, Figure, Report, Series, Table, Text, heads
from vcfbench.specifications import SupplySpecification
from vcfbench.station.bounds import ranged, several
from vcfbench.station.invalid_value import InvalidValue
from vcfbench.station.settings import Sources
from vcfbench.steps import Acquire, Window
from vcfbench.steps.measured import Measured
from vcfbench.steps.step import Reading, Step, StepResult
from vcfbench.uncertainty.measurand import divided, measurand, titled, value_table
from vcfbench.values.value import Measurand, UncertaintyPart, Value

Order = Literal["together", "positive", "negative"]
Varied = Literal["positive", "negative", "both"]


class PowerSettings(LookedAtSettings, LevelSettings, frozen=True, kw_only=True):
    """Settings of the test of the supply, in addition to those of all procedures."""

    warm_up_s: Annotated[float, ranged(0.0, 86_400.0, "wait after power-on")] = 1800.0
    orders: Annotated[
        tuple[Order, ...],
        several(1, 6, "power-on: both rails together, or this one first; only orders that the PCB allows"),
    ] = ("together",)
    order_delay_s: Annotated[float, ranged(0.1, 600.0, "delay from the first rail to the second")] = 1.0
    log_s: Annotated[float, ranged(1.0, 600.0, "time recorded after a power-on")] = 10.0
    off_s: Annotated[float, ranged(1.0, 3600.0, "time without power between two power-ons")] = 10.0
    valid_tolerance_deg_s: Annotated[
        float, ranged(1e-3, 1e3, "the output is valid once it stays this close to its final value")
    ] = 1.0
    rails_varied: Annotated[tuple[Varied, ...], several(1, 3, "which rails are moved, alone or together")] = (
        *("positive", "negative", "both"),
    )
    rail_step_v: Annotated[float, ranged(0.05, 5.0, "how far a rail is moved either way, within the limits")] = 0.2
    cycles: Annotated[int, ranged(1, 100, "times that each rail is moved up and down")] = 2

    @property
    def varied(self) -> tuple[Varied, ...]:
        """Rails that are moved: of one supply the one that there is."""
        return ("positive",) if self.station.rails.single else self.rails_varied

    def moved(self, which: Varied, step_v: float) -> Self:
        """Return these settings with the rails `which` so much larger, V."""
        positive = step_v if which in {"positive", "both"} else 0.0
        negative = step_v if which in {"negative", "both"} else 0.0
        return structs.replace(
            self, positive_rail_v=self.positive_rail_v + positive, negative_rail_v=self.negative_rail_v - negative
        )

    def contradictions(self) -> Iterator[InvalidValue]:
        yield from super().contradictions()
        limits = self.station.limits
        low_v, high_v = limits.min_rail_v, limits.max_rail_v
        if low_v is not None and high_v is not None:
            for rail_v in (abs(rail.voltage_v) for rail in self.rails):
                if not low_v <= rail_v - self.rail_step_v <= rail_v + self.rail_step_v <= high_v:
                    most_v = min(rail_v - low_v, high_v - rail_v)
                    yield InvalidValue(
                        "rail_step_v", f"at most {most_v:g} V, for the limits of the rails", self.rail_step_v
                    )


_A_STATE = 3
"""Windows on one setting of the rails: at rest, at the rate, at the opposite rate."""
_STEP_V, _STEP_A = 1.5e-3, 1e-4
"""Resolution of the read-backs where the supply has no data sheet here: that of an E3631A (User's Guide p. 186)."""

_MOST_OFF = 0.5
"""Largest imbalance of the rails, relative to the step, that is taken as it is; the halves hold a part of it."""

NOT_HELD = (
    "The largest current at power-on is the largest reading: a supply reads about ten times per second, first 0.2 s "
    "after the command, so shorter peaks are missed. Its u and the u of the steady currents contain the accuracy of "
    "the supply's own ammeter. The sensitivities contain noise, flicker and the read-back of the step; a linear drift "
    "cancels. Sensitivities to a single rail hold for rails of equal size: if only the weaker rail matters, the "
    "supply's imbalance moves part of one half to the other; this is corrected by the read-back, and its u is "
    "contained."
)


class RailDraw(Struct, frozen=True):
    """Reading of one rail: bench time (s), the supply's output, voltage (V, None if it was not read), current (A)."""

    t_s: float
    output: str
    voltage_v: float | None
    current_a: float


class RailsLogged(StepResult, Struct, frozen=True):
    """Currents and output from the bench time `t_s`, s, at which a rail was commanded on."""

    t_s: float
    drawn: tuple[RailDraw, ...]
    outputs: tuple[Reading, ...]

    def corrected(self, step: Step, known: Sources) -> Self:
        return replace(self, outputs=tuple(each.corrected(known) for each in self.outputs))

    def describe(self) -> str:
        return f"{len(self.drawn)} currents, at most {max((each.current_a for each in self.drawn), default=0.0):.4g} A"


class RailsDrawn(StepResult, Struct, frozen=True):
    """Voltages and currents of the rails, read in turn."""

    drawn: tuple[RailDraw, ...]

    def describe(self) -> str:
        outputs = dict.fromkeys(each.output for each in self.drawn)
        means = {output: fmean(each.current_a for each in self.drawn if each.output == output) for output in outputs}
        return ", ".join(f"{output} {current_a:.4f} A" for output, current_a in means.items())


class RailCurrent(Struct, frozen=True):
    """Current of one rail: volts read back, steady current and the largest at power-on, each with its uncertainty."""

    rail: str
    output: str
    voltage_v: float
    current: Measurand
    inrush: Measurand


class PowerOn(Struct, frozen=True):
    """One power-on: which rail came first (`together`: none), and when the output was valid.

    Times count from the last rail's command; `valid_output` is None where the output had not come to that when the log
    ended. `t_s`, `current_a` are the log of each rail, `output_deg_s` that of the output, from what it comes to.
    """

    order: str
    valid_output: Measurand | None
    t_s: tuple[float, ...]
    current_a: Mapping[str, tuple[float, ...]]
    output_t_s: tuple[float, ...]
    output_deg_s: tuple[float, ...]


class RailEffect(Struct, frozen=True):
    """Effect of moving rails: `rails` by `step_v` either way (read back, positive is larger in size).

    The slope is that from the lower to the higher level; `lowered` and `raised` are those of either half, which differ
    where the weaker rail alone decides. They hold for rails of one size: by `imbalance_v` the rail that is moved is the
    larger one, as read back, and what that does to the halves is taken out. Of both rails together it is 0.
    """

    rails: str
    step_v: float
    imbalance_v: float
    scale_factor: Measurand
    scale_factor_lowered: Measurand
    scale_factor_raised: Measurand
    bias: Measurand
    bias_lowered: Measurand
    bias_raised: Measurand


class PowerResult(Struct, frozen=True):
    """Result of the test of the supply."""

    power_on: tuple[PowerOn, ...]
    rails: tuple[RailCurrent, ...]
    power: Measurand
    effects: tuple[RailEffect, ...]
    by: str
    scale_factor_v_per_deg_s: ScaleFactor

    def stated(self) -> Iterator[Value]:
        """Yield its values."""
        single = len(self.rails) == 1
        for rail in self.rails:
            yield titled(f"supply current, {rail.rail} rail", rail.current)
            yield titled(f"largest current at power-on, {rail.rail} rail", rail.inrush)
        yield titled("power", self.power)
        for on in self.power_on:
            if on.valid_output is not None:
                yield titled(f"time to valid output, {_words_of(on.order, single)}", on.valid_output)
        for effect in self.effects:
            yield titled(f"scale factor by {_rails_words(effect.rails, single)}", effect.scale_factor)
            yield titled(f"bias by {_rails_words(effect.rails, single)}", effect.bias)


def power_results(settings: PowerSettings, measured: Measured) -> PowerResult:
    """Return the result of the test."""
    scale = routines.scale_factor_seen(settings, measured)
    logged = measured.found(RailsLogged)
    ((_, steady),) = measured.found(RailsDrawn)
    rails = []
    for rail, output in [(each.rail, each.output) for each in settings.rails]:
        of = [each for each in steady.drawn if each.output == output]
        currents = [each.current_a for each in of]
        current_a, scatter = fmean(currents), stdev(currents) / math.sqrt(len(currents))
        peak_a = max(each.current_a for _, log in logged for each in log.drawn if each.output == output)
        voltage_v = fmean(each.voltage_v for each in of if each.voltage_v is not None)
        readings = UncertaintyPart("readings", max(scatter, _STEP_A / math.sqrt(12.0)), len(currents) - 1)
        resolution = UncertaintyPart("resolution", _STEP_A / math.sqrt(12.0))
        current = measurand(current_a, "A", [readings, *_ammeter(settings, output, current_a)])
        inrush = measurand(peak_a, "A", [resolution, *_ammeter(settings, output, peak_a)])
        rails.append(RailCurrent(rail, output, voltage_v, current, inrush))
    parts = [
        UncertaintyPart(f"{part.source}, {each.rail} rail", abs(each.voltage_v) * part.u, part.dof, part.of)
        for each in rails
        for part in each.current.parts
    ]
    power_w = sum(abs(each.voltage_v) * each.current.value for each in rails)
    return PowerResult(
        power_on=tuple(_power_ons(settings, logged, scale)),
        rails=tuple(rails),
        power=measurand(power_w, "W", parts),
        effects=tuple(_effects(settings, measured, scale)),
        by=settings.by.value,
        scale_factor_v_per_deg_s=scale,
    )


def _ammeter(settings: PowerSettings, output: str, current_a: float) -> list[UncertaintyPart]:
    """Return the errors of the supply's ammeter; nothing where no data sheet tells them."""
    sheet: SupplySpecification | None = settings.station.sheet_of("power")
    if sheet is None or output not in sheet.current:
        return []
    gain, offset_a = sheet.current[output]
    of = f"{settings.station.instruments['power'].owner}, {output}"
    divisor, within = sheet.limit_sigmas or math.sqrt(3.0), sheet.limit_sigmas is None
    return [
        UncertaintyPart("ammeter's gain", gain * abs(current_a) / divisor, None, of, rectangular=within),
        UncertaintyPart("ammeter's offset", offset_a / divisor, None, of, rectangular=within),
    ]


def _power_ons(
    settings: PowerSettings, logged: Sequence[tuple[Step, RailsLogged]], scale: ScaleFactor
) -> Iterator[PowerOn]:
    """Yield each power-on; one in two steps has two logs, of which the second tells of the output."""
    logs = iter(log for _, log in logged)
    for order in settings.orders:
        first = next(logs)
        last = first if order == "together" else next(logs)
        drawn = first.drawn if last is first else (*first.drawn, *last.drawn)
        times = tuple(each.t_s - last.t_s for each in last.outputs)
        rates = [each.voltage_v / scale.value for each in last.outputs]
        end = fmean(rates[-max(1, len(rates) // 4) :])
        away = tuple(rate - end for rate in rates)
        yield PowerOn(
            order,
            valid_output(times, away, settings.valid_tolerance_deg_s),
            tuple(each.t_s - last.t_s for each in drawn if each.output == settings.rails[0].output),
            {of.rail: tuple(each.current_a for each in drawn if each.output == of.output) for of in settings.rails},
            times,
            away,
        )


def valid_output(times_s: Sequence[float], away_deg_s: Sequence[float], tolerance_deg_s: float) -> Measurand | None:
    """Return from when on the output stays within the tolerance, s; None where that is not before the last quarter.

    It is somewhere between the last reading that is off and the next, with equal chance anywhere.
    """
    off = [number for number, each in enumerate(away_deg_s) if abs(each) > tolerance_deg_s]
    good = off[-1] + 1 if off else 0
    if good >= len(times_s) - max(1, len(times_s) // 4):
        return None
    before_s = times_s[good - 1] if good else 0.0
    width_s = times_s[good] - before_s
    between = UncertaintyPart("time between readings", width_s / math.sqrt(12.0))
    return measurand(before_s + 0.5 * width_s, "s", [between])


def _effects(settings: PowerSettings, measured: Measured, scale: ScaleFactor) -> Iterator[RailEffect]:
    """Yield the effect of each of the rails; the windows came in the order of the plan."""
    windows = [(step, window) for step, window in measured.found(Window) if isinstance(step, Acquire)]
    a_block = _A_STATE * len(CHOPPED)
    expected = a_block * settings.cycles * len(settings.varied)
    if len(windows) != expected:
        raise ConfigError(f"expected {expected} windows for {len(settings.varied)} rails, got {len(windows)}")
    blocks = [_moved(windows[at : at + a_block], scale.value) for at in range(0, len(windows), a_block)]
    biases, taken, seen = map(list, zip(*blocks, strict=True))
    std = math.sqrt(fmean(window.std_v**2 for _, window in windows)) / abs(scale.value)
    window_s = settings.samples * settings.sample_interval_s
    begins = [float(window.t_s[0]) for window in measured.readings.windows]
    slot_s = (begins[-1] - begins[0]) / (len(begins) - 1) * _A_STATE
    bias_noise = block_noise(biases, std, settings.samples, window_s, slot_s)
    size = fmean(each.zero_v for each in taken)
    slope_std = std / (math.sqrt(2.0) * settings.level_deg_s * abs(size))
    slopes = [Block(tuple(each / size for each in block.outputs_v)) for block in taken]
    slope_noise = block_noise(slopes, slope_std, settings.samples, window_s, slot_s)
    for number, rails in enumerate(settings.varied):
        of = slice(number * settings.cycles, (number + 1) * settings.cycles)
        step = _step_v(settings, rails, seen[of])
        beside = _imbalance_v(settings, rails, seen[of])
        bias = _three(biases[of], bias_noise, step, beside, ("(deg/s)/V", 1.0))
        slope = _three(slopes[of], slope_noise, step, beside, ("ppm/V", 1e6))
        yield RailEffect(*(rails, step[0], beside[0], *slope), *(divided(each, scale.value, scale.u) for each in bias))


def _moved(windows: Sequence[tuple[Acquire, Window]], scale: float) -> tuple[Block, Block, list[Mapping[str, float]]]:
    """Return of one block bias (deg/s), slope (relative to the scale factor used) and rails (V) of each state."""
    bias, slope, rails = [], [], list[Mapping[str, float]]()
    for place in range(0, len(windows), _A_STATE):
        (_, rest), (at, plus), (_, minus) = windows[place : place + _A_STATE]
        bias.append(rest.mean_v / scale)
        slope.append((plus.mean_v - minus.mean_v) / (2.0 * at.rate_deg_s * scale))
        seen = [{each.rail: each.voltage_v for each in window.rails} for window in (rest, plus, minus)]
        rails.append({output: fmean(each[output] for each in seen) for output in seen[0]})
    return Block(tuple(bias)), Block(tuple(slope)), rails


_Seen: TypeAlias = Sequence[Sequence[Mapping[str, float]]]
"""Rail voltages as read back, V, of each state of some blocks."""


def _step_v(settings: PowerSettings, rails: str, seen: _Seen) -> tuple[float, list[UncertaintyPart]]:
    """Return the step of the rails either way, V, as read back, and its relative errors."""
    outputs = [each.output for each in settings.rails if rails in {each.rail, "both"}]
    half = [
        0.5 * (abs(states[CHOPPED.index(1)][output]) - abs(states[CHOPPED.index(-1)][output]))
        for states in seen
        for output in outputs
    ]
    step_v = fmean(half)
    if step_v <= 0.0:
        raise ConfigError(f"{rails}: the rails did not move, by their read-backs")
    parts = [UncertaintyPart("step: resolution of the read-back", _STEP_V / math.sqrt(12.0 * 2.0) / step_v)]
    sheet: SupplySpecification | None = settings.station.sheet_of("power")
    if sheet is not None:
        gain = max(sheet.voltage[output][0] for output in outputs if output in sheet.voltage)
        parts.append(UncertaintyPart("step: gain of the read-back", gain / (sheet.limit_sigmas or math.sqrt(3.0))))
    return step_v, parts


def _imbalance_v(settings: PowerSettings, rails: str, seen: _Seen) -> tuple[float, float]:
    """Return by how much the rail that is moved is the larger one, V, as read back, and the standard uncertainty."""
    if rails == "both" or settings.station.rails.single:
        return 0.0, 0.0
    of = {each.rail: each.output for each in settings.rails}
    own, other = of[rails], of["negative" if rails == "positive" else "positive"]
    rest = [states[place] for states in seen for place, sign in enumerate(CHOPPED) if sign == 0]
    beside_v = fmean(abs(each[own]) - abs(each[other]) for each in rest)
    variance = 2.0 * _STEP_V**2 / 12.0
    sheet: SupplySpecification | None = settings.station.sheet_of("power")
    if sheet is not None:
        for output in (own, other):
            gain, offset_v = sheet.voltage.get(output, (0.0, 0.0))
            limits_v = gain * fmean(abs(each[output]) for each in rest), offset_v
            variance += sum(limit_v**2 for limit_v in limits_v) / (sheet.limit_sigmas or math.sqrt(3.0)) ** 2
    return beside_v, math.sqrt(variance)


def _balanced(half: float, other: float, share: float) -> float:
    """Return the slope of a half on rails of one size, where the weaker decides.

    Of this half the part `share` next to the middle has the slope of the other half, since there the rail that is moved
    is not yet, or no longer, the weaker one.
    """
    return half if share <= 0.0 else (half - share * other) / (1.0 - share)


def _three(
    blocks: Sequence[Block],
    noise: BlockNoise,
    step: tuple[float, list[UncertaintyPart]],
    imbalance_v: tuple[float, float],
    unit_and_factor: tuple[str, float],
) -> tuple[Measurand, Measurand, Measurand]:
    """Return the slope over both halves, over the lower, over the upper, of rails of one size."""
    unit, factor = unit_and_factor
    step_v, step_parts = step
    plus = fmean(block.differences_v[0] for block in blocks) / step_v
    minus = -fmean(block.differences_v[1] for block in blocks) / step_v
    share = max(-_MOST_OFF, min(_MOST_OFF, imbalance_v[0] / step_v))
    (of_plus, both), (_, of_minus) = (tuple(each / step_v**2 for each in row) for row in noise.covariance_v2)
    covariance = ((of_minus, -both), (-both, of_plus))
    lowered, raised = _balanced(minus, plus, share), _balanced(plus, minus, -share)
    stretched = 1.0 / (1.0 - abs(share))
    on_lowered = (stretched, 1.0 - stretched) if share > 0.0 else (1.0, 0.0)
    on_raised = (1.0 - stretched, stretched) if share < 0.0 else (0.0, 1.0)
    on_both = tuple(0.5 * (one + other) for one, other in zip(on_lowered, on_raised, strict=True))
    found = ((0.5 * (lowered + raised), on_both), (lowered, on_lowered), (raised, on_raised))
    kinked = abs(lowered - raised) * imbalance_v[1] / step_v
    below = NormalDist().cdf(imbalance_v[0] / imbalance_v[1]) if imbalance_v[1] else 0.0
    kept = 0.5, math.sqrt(below), math.sqrt(1.0 - below)  # the corner is in the lower half, or else in the upper
    made = []
    for (value, weights), share_of_it in zip(found, kept, strict=True):
        pairs = product(enumerate(weights), enumerate(weights))
        variance = sum(one * other * covariance[row][column] for (row, one), (column, other) in pairs)
        readings = UncertaintyPart("readings and flicker", abs(factor) * math.sqrt(variance / len(blocks)), noise.dof)
        of_step = [UncertaintyPart(each.source, abs(factor * value) * each.u, each.dof, each.of) for each in step_parts]
        of_imbalance = UncertaintyPart("imbalance of the rails", abs(factor) * share_of_it * kinked)
        held = [readings, *of_step, *([of_imbalance] if imbalance_v[1] else [])]
        made.append(measurand(factor * value, unit, held))
    return made[0], made[1], made[2]


def _words_of(order: str, single: bool) -> str:  # noqa: FBT001
    return (
        f"{_rails_words('both', single)}{' together' * (not single)}" if order == "together" else f"{order} rail first"
    )


def _rails_words(rails: str, single: bool) -> str:  # noqa: FBT001
    return "the rail" if single else "both rails" if rails == "both" else f"the {rails} rail"


def power_report(settings: PowerSettings, _measured: Measured, results: PowerResult) -> Report:
    """Report power-on, currents and sensitivities."""
    single = len(results.rails) == 1
    halves = Table(
        heads("<rails | step [V]:.4f | imbalance [V]:+.4f | < | lowered:.4g | u:.2g | raised:.4g | u:.2g | <unit"),
        [
            (effect.rails, effect.step_v, effect.imbalance_v, name, low.value, low.u, high.value, high.u, low.unit)
            for effect in results.effects
            for name, low, high in (
                ("scale factor", effect.scale_factor_lowered, effect.scale_factor_raised),
                ("bias", effect.bias_lowered, effect.bias_raised),
            )
        ],
        "rails lowered and raised, each alone: they differ if only the weaker rail matters",
    )
    figures = [
        Figure(
            f"Power-on, {_words_of(on.order, single)}",
            *(Axis("time", "s"), Axis("current", "A")),
            [Series(f"{rail} rail", on.t_s, currents) for rail, currents in on.current_a.items()],
        )
        for on in results.power_on
    ]
    late = [_words_of(each.order, single) for each in results.power_on if each.valid_output is None]
    scale = results.scale_factor_v_per_deg_s
    said = f"scale factor by {'V_Vc' if results.by == 'v-vc' else 'the table'}; "
    said += rates_by(scale.value, scale.source)
    if late:
        said += f"\nno valid output within {settings.log_s:g} s: {', '.join(late)}"
    return Report([value_table(results.stated()), halves, Text(f"{said}\n{NOT_HELD}"), *figures])
