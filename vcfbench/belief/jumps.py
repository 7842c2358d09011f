"""Steps, pulses and walks of the output in a series of windows, found from references, repeats and smoothness.

What the output should be is a cubic in the rate (or in V_Vc) with free coefficients, and terms of higher order that are
small beside those two orders below; windows of one setting share it. What noise, flicker, warm-up, temperature, the
table's rate and the generator's levels may add has a covariance. A fault is a pattern in time (:mod:`patterns`); the
largest, in standard uncertainties, decides.
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any, TypeVar

import numpy as np
from msgspec import Struct

from vcfbench.analysis.arrays import Floats
from vcfbench.belief.patterns import ONE_SIDED, Pattern, Patterns, patterns_of
from vcfbench.belief.walk import Limits, Seen, Walk, sigmas
from vcfbench.errors import MeasurementError
from vcfbench.instructions.schedule import SEARCH, ZERO_DRIVEN, ZERO_TABLE, Order, SweepSettings
from vcfbench.instructions.v_vc import has_v_vc_meter, mean_levels_v
from vcfbench.station.settings import ProcedureSettings
from vcfbench.steps import NotChecked
from vcfbench.steps.step import Routine, Step, StepResult
from vcfbench.uncertainty.known_levels import known_levels

T = TypeVar("T")

_ORDERS = 3
"""The curve's orders that are as large as they like."""
_NEXT = 0.03
"""Largest ratio of a term to that two orders below, at the largest rate: an output stage that is off by 1 % there
leaves 0.4 % of its cubic term to the next one (the series of tanh)."""
_MOST_BENT = 0.01
"""Largest curvature, relative to the span: a curve that bends more does so by a fault."""
_HIGHEST = 9
OFFSET, GAIN, V_VC_OFFSET, V_VC_GAIN = "V", "of the output", "V of V_Vc", "of V_Vc"
"""Units of faults: volts of the output, shares of it, and the same of V_Vc as it is measured."""
_HALF = 0.5
"""Patterns are fewer than comparisons: 5.5 is a chance of some 5e-5 a run, as that of 200 to 800 independent ones (the
largest of 400 runs of 60 and of 56 of 105 windows of `kvc`, drawn from their covariances)."""
_CREEPS, _CREEP_TIMES = 3.0, 5
"""Longest time constant of a warm-up, in lengths of the run, and how many make any other between it and a window."""
_EQUAL = 1e-9
"""Patterns that are equal but for rounding: the first of them counts."""
_ANSWERS = 8.0
"""Standard uncertainties that the slope must be away from zero."""
_ROUNDING_V = 1e-12
"""Readings that are all the same scatter by less."""
_NEAR = 0.5
"""Share of a rail from which on an output may be at its end, with its noise."""
_NO_SWEEP = frozenset({ZERO_TABLE, ZERO_DRIVEN, SEARCH})
_NO_LOOK = (MemoryError, np.linalg.LinAlgError)
_CURVED = 0.2
"""Largest residual of a line, relative to the span: beyond, the output answers to something else than the rate."""


class Jump(Struct, frozen=True):
    """A fault that was found: `size` is its offset, or how far it walks from first to last window, in `unit`.

    `sigmas` is its size over its standard uncertainty.
    """

    pattern: Pattern
    size: float
    sigmas: float
    unit: str


def require_no_jump(walk: Walk) -> None:
    """See that the output moves by settings alone: of all windows on the same rails, generator on, or off.

    MeasurementError: it stepped, read too much for a while, walked away, or does not answer to what is set.
    """
    for windows in groups(walk):
        if len({each.setting for each in windows}) > 1 and walk.settings.smooth:
            _require_answer(walk, windows)
        if found := _significant(walk, windows):
            raise MeasurementError(
                f"{_what(found, windows)}: no smooth curve goes through all windows",
                instrument="multimeter",
                step=str(windows[found.pattern.last].point.step),
                hint=f"check leads and contacts, and events at that time{_near_its_end(windows)}; "
                "all points are in the record. expected.zero_drift_v of the bench file allows a drift",
            )


def _near_its_end(windows: Sequence[Seen]) -> str:
    """Return how near the output comes to a rail, where that is half way or more, in words."""
    most_v = max((each.point.output_v for each in windows), key=abs)
    rail_v = min(map(abs, windows[0].rails_v), default=math.inf)
    return (
        "" if abs(most_v) < _NEAR * rail_v else f", and whether it clips, at {most_v:+.4g} V on rails of {rail_v:g} V"
    )


def note(walk: Walk, step: Step, result: StepResult) -> None:
    """Add a performed step to `walk`.

    MeasurementError: a setting did not give what it gave before; where the windows in between show it, with the place.
    """
    try:
        walk.note(step, result)
    except MeasurementError as error:
        last = walk.windows[-1]
        windows = [each for each in walk.windows if (each.driven, each.rails_v) == (last.driven, last.rails_v)]
        with suppress(*_NO_LOOK):
            if len({each.setting for each in windows}) > 1 and (found := _significant(walk, windows)):
                error.what += f"; by all windows {_what(found, windows)}"
        raise


def groups(walk: Walk) -> Iterator[list[Seen]]:
    """Yield the windows that are held against each other: on the same rails, generator on, or off."""
    for driven, rails_v in dict.fromkeys((each.driven, each.rails_v) for each in walk.windows):
        windows = [each for each in walk.windows if (each.driven, each.rails_v) == (driven, rails_v)]
        if len(windows) > 1:
            yield windows


def refused_from(walk: Walk) -> float:
    """Return the size, in standard uncertainties, of a fault that is refused with 95 %."""
    return _most(walk) + ONE_SIDED


def _most(walk: Walk) -> float:
    """Return how many the largest pattern may have: without a curve levels are visited very often."""
    return sigmas(walk.dof) + (-_HALF if walk.settings.smooth else _HALF)


def _significant(walk: Walk, windows: Sequence[Seen]) -> Jump | None:
    found = largest_jump(walk, windows)
    return found if found is not None and abs(found.sigmas) > _most(walk) else None


def largest_jump(walk: Walk, windows: Sequence[Seen]) -> Jump | None:
    """Return the fault that fits best, or None if no window can show one."""
    found = None
    for each in patterns(walk, windows):
        sizes = np.abs(each.sigmas)
        most = float(sizes.max())
        if each.shows.any() and (found is None or most > (1.0 + _EQUAL) * abs(found.sigmas)):
            place = int(np.argmax(sizes >= (1.0 - _EQUAL) * most))  # the first of equals
            found = Jump(each.pattern(place), float(each.sizes[place]), float(each.sigmas[place]), each.unit)
    return found


def patterns(walk: Walk, windows: Sequence[Seen], unit: str | None = None) -> Iterator[Patterns]:
    """Yield all faults that are looked for in the outputs of windows on the same rails: in volts, and of a gain.

    Nothing where the free terms leave no window; with `unit` those of this one alone.
    """
    count = len(windows)
    x, at_s = _abscissa(windows), np.array([each.middle_s for each in windows])
    output = np.array([each.point.output_v for each in windows])
    by_v_vc = _by_v_vc(windows)
    free = _free_terms(walk, windows, x, at_s)
    if free.shape[1] >= count:
        return
    covariance = _covariance(walk, windows, x, free)
    # A gain acts on what the curve has: the noise of outputs would explain itself
    scales = {OFFSET: np.ones(count), GAIN: free @ np.linalg.lstsq(free, output, rcond=None)[0]}
    if by_v_vc is not None:
        output = output - by_v_vc.apart_v
        covariance += np.diag(np.square(by_v_vc.u_v))
        scales[V_VC_OFFSET], scales[V_VC_GAIN] = by_v_vc.per_v, by_v_vc.per_v * by_v_vc.v_vc
    asked = scales if unit is None else {each: scale for each, scale in scales.items() if each == unit}
    yield from patterns_of(output, free, covariance, at_s, asked)


def _free_terms(walk: Walk, windows: Sequence[Seen], x: Floats, at_s: Floats) -> Floats:
    """Return the terms that the output may have of any size, a column each."""
    count = len(windows)
    terms = [x**order for order in range(_free_orders(windows) + 1)]
    if ups := sorted({each.up for each in windows if each.up}):  # what gravity does in each position
        terms = [np.array([float(each.up == up) for each in windows]) for up in ups]
    at_zero = np.array([each.driven and not each.point.v_vc_v for each in windows])
    if not walk.settings.smooth:  # what each level gives
        levels = dict.fromkeys(each.setting for each in windows)
        terms = [np.array([float(each.setting == level) for each in windows]) for level in levels]
    elif walk.settings.creeps:  # whatever dies away with any time constant
        since_s = at_s - at_s[0]
        times_s = np.geomspace(windows[0].end_s - windows[0].begin_s, max(_CREEPS * since_s[-1], 1e-3), _CREEP_TIMES)
        terms += [*np.exp(-since_s / times_s[:, None])]
    elif 0 < at_zero.sum() < count - len(terms):  # a generator's 0 V is on no range of its levels
        terms.append(at_zero.astype(float))
    if isinstance(walk.settings, SweepSettings) and walk.settings.order is Order.LOOP:
        way, before = np.zeros(count), 0.0
        for at in range(count):
            if not windows[at].reference and windows[at].point.step in {1, 3, 4}:
                way[at] = np.sign(x[at] - before) or (way[at - 1] if at else 0.0)
                before = x[at]
        if len(set(way.tolist())) > 1:
            terms += [way, way * x, way * x**2]
    return np.column_stack(terms)


def _abscissa(windows: Sequence[Seen]) -> Floats:
    """Return the output's abscissa, largest 1: V_Vc as it was measured or set, or the table's rate."""
    if windows[0].driven:
        x = np.array(mean_levels_v([each.point.v_vc_v for each in windows], [each.point for each in windows]))
    else:
        x = np.array([each.table_deg_s for each in windows])
    return np.asarray(x / max(float(np.abs(x).max()), 1e-12))


class _ByVvc(Struct, frozen=True):
    """Effect of V_Vc, as it was measured, on the outputs of windows, V."""

    apart_v: Floats
    """By being apart from its mean at each setting: what the generator does goes out with it."""
    u_v: Floats
    """By its noise."""
    per_v: Floats
    """(n, n), by a volt more read in each window: not measured, a level is the mean of the others at its setting."""
    v_vc: Floats
    """As it was measured, the mean at each setting; 0 where it was not."""


def _by_v_vc(windows: Sequence[Seen]) -> _ByVvc | None:
    """Return the effect of V_Vc on the outputs; None without a meter on it."""
    points = [each.point for each in windows]
    measured = np.array([each.v_vc_measured_v is not None for each in points])
    if not measured.any():
        return None
    set_v = np.array([each.v_vc_v for each in points])
    v_vc = np.array([each.v_vc_measured_v or 0.0 for each in points])
    levels_v = np.array(mean_levels_v(set_v.tolist(), points))
    output = np.array([each.output_v for each in points])
    off_v = levels_v - levels_v.mean()
    per_v = float(off_v @ output) / max(float(off_v @ off_v), 1e-12)
    alike = ((set_v[:, None] == set_v) & measured).astype(float)
    alike /= np.maximum(alike.sum(axis=1, keepdims=True), 1.0)
    return _ByVvc(
        apart_v=per_v * np.where(measured, v_vc - levels_v, 0.0),
        u_v=per_v * np.array([(each.v_vc_std_v or 0.0) / math.sqrt(each.n) for each in points]),
        per_v=per_v * np.where(measured[:, None], np.eye(len(points)), alike),
        v_vc=np.where(measured, levels_v, 0.0),
    )


def _free_orders(windows: Sequence[Seen]) -> int:
    """Return the highest order of the curve that is free: of one setting a constant, through two a line."""
    settings = len({each.setting for each in windows})
    return max(min(1, settings - 1), min(_ORDERS, settings - 2))


def _covariance(walk: Walk, windows: Sequence[Seen], x: Floats, free: Floats) -> Floats:
    """Return the covariance of the outputs about the free terms, V^2."""
    limits, count = walk.limits, len(windows)
    output = np.array([each.point.output_v for each in windows])
    at_s = np.array([each.middle_s for each in windows])
    coefficients = np.linalg.lstsq(free, output, rcond=None)[0]
    span_v = float(np.ptp(output))
    slope_v = abs(float(coefficients[1])) if free.shape[1] > 1 else 0.5 * span_v
    # The variance of each window's mean by its readings, the meter's digit and the table
    by_rate: dict[float, list[float]] = {}
    for each in windows:
        by_rate.setdefault(abs(each.table_deg_s), []).append(each.point.std_v**2)
    scatter = [
        max(walk.variance_v2, walk.correlation.growth * math.fsum(v := by_rate[abs(each.table_deg_s)]) / len(v))
        for each in windows
    ]
    own = np.array([variance / each.point.n for variance, each in zip(scatter, windows, strict=True)])
    if not walk.settings.smooth:
        own = np.maximum(own, _between_v2(windows))
    at_rate = np.array([float(each.table_deg_s != 0.0) for each in windows])
    of_table = (at_rate * limits.table_rate * (slope_v * np.abs(x))) ** 2 / 3.0
    placed_v = [limits.of_placing_v(output.tolist()) if each.up else 0.0 for each in windows]
    total = np.diag(own + walk.settings.meter_resolution_v**2 / 12.0 + of_table + np.square(placed_v) / 3.0)
    orders = _free_orders(windows)
    sizes = [min(abs(float(each)), _MOST_BENT * span_v) for each in coefficients[: orders + 1]]
    for order in range(orders + 1, _HIGHEST + 1):
        below = sizes[order - 2] if order >= 2 and order - 2 > 1 else _MOST_BENT * span_v
        sizes.append(max(_NEXT * below, 1e-6 * span_v))
        total += sizes[order] ** 2 * np.outer(x**order, x**order)
    apart = np.abs(at_s[:, None] - at_s)
    length_s = max(1e-3, float(np.mean([each.end_s - each.begin_s for each in windows])))
    whole = 3.0 + math.log(max(1.0, float(apart.max()) / length_s))
    lagged = np.where(apart > 0.0, 1.5 + np.log(np.maximum(1.0, apart / length_s)), 0.0)
    total += limits.flicker_v**2 / math.pi * (whole - lagged)
    cooled = np.exp(-(at_s - walk.windows[0].begin_s) / limits.warm_up_s)
    moved_v = slope_v * x
    for by_v in (limits.warm_up_v * cooled, limits.warm_up_share * cooled * moved_v):
        total += np.outer(by_v, by_v)
    wandered = np.minimum.outer(at_s - at_s[0], at_s - at_s[0]) / max(float(at_s[-1] - at_s[0]), 1e-9)
    total += wandered * (limits.wander_v**2 + limits.wander_share**2 * np.outer(moved_v, moved_v))
    if windows[0].driven:
        # By errors of V_Vc: of each setting its own, and of a range in common
        points, settings = [each.point for each in windows], walk.settings
        level_v = np.array([point.v_vc_v for point in points])
        if has_v_vc_meter(settings) and any(point.v_vc_measured_v is not None for point in points):
            total += (level_v[:, None] == level_v) * (1e-5 * slope_v) ** 2
        else:
            per_v = slope_v / max(1e-9, float(np.abs(level_v).max()))
            total += per_v**2 * known_levels(points, settings.station.sources).covariance_v2(level_v)
    return np.asarray(total + np.eye(count) * 1e-18)


def _between_v2(windows: Sequence[Seen]) -> float:
    """Return the variance of means by the differences of successive ones at one level, V^2: a step moves one of them.

    Readings that are not independent scatter less than their means do.
    """
    levels: dict[Any, list[float]] = {}
    for each in windows:
        levels.setdefault(each.setting, []).append(each.point.output_v)
    apart = np.concatenate([np.diff(own) for own in levels.values()])
    return 0.5 * float(np.mean(apart**2)) if apart.size else 0.0


def _require_answer(walk: Walk, windows: Sequence[Seen]) -> None:
    """Raise MeasurementError unless the output moves with the setting, about along a line."""
    x, output = _abscissa(windows), np.array([each.point.output_v for each in windows])
    off = x - x.mean()
    square = float(off @ off)
    if not square:
        return
    slope_v = float(off @ output) / square
    digit_v2 = walk.settings.meter_resolution_v**2 / 12.0
    u_v = math.sqrt(walk.variance_v2 / min(each.point.n for each in windows) + digit_v2)
    u_v = math.hypot(u_v, walk.limits.flicker_v)
    left_v = float(np.abs(output - output.mean() - slope_v * off).max())
    span_v = float(np.ptp(output))
    what, lead = "the table's rate", ""
    if windows[0].driven:
        what, lead = "V_Vc", "the generator's lead to V_Vc, the carrier, "
    if abs(slope_v) < _ANSWERS * u_v / math.sqrt(square) or span_v < _ANSWERS * u_v:
        seen = (
            f"from {output.min():+.6g} to {output.max():+.6g} V in all windows, where one mean is known to {u_v:.1g} V"
        )
        wrong = f"respond to {what}: {seen}"
    else:
        _require_straight(windows, walk.settings.expected.nonlinearity_ppm)
        if left_v <= _CURVED * span_v:
            return
        seen = f"a line through {len(windows)} windows leaves {left_v:.3g} V over, of a span of {span_v:.3g} V"
        wrong = f"follow {what}: {seen}"
    raise MeasurementError(
        f"the output does not {wrong}",
        instrument="multimeter",
        step=str(windows[-1].point.step),
        hint=f"check the lead of the output, {lead}the PCB's supply, and the drive signal",
    )


def _require_straight(windows: Sequence[Seen], bound_ppm: float | None) -> None:
    """Raise MeasurementError unless the residuals of the last sweep's line are within the bench file's limits."""
    if bound_ppm is None:
        return
    last = max(each.point.step for each in windows if not each.reference and each.point.step not in _NO_SWEEP)
    swept = [each for each in windows if each.point.step == last and not each.reference]
    if len({each.setting for each in swept}) < 3:
        return
    x, output = _abscissa(swept), np.array([each.point.output_v for each in swept])
    line = np.polynomial.Polynomial.fit(x, output, 1)
    means_v = {level: float(np.mean((output - line(x))[x == level])) for level in set(x.tolist())}
    worst = max(means_v, key=lambda level: abs(means_v[level]))
    ends_v = line(np.array([x.min(), x.max()]))
    found_ppm = 1e6 * abs(means_v[worst]) / max(1e-12, abs(float(ends_v[1] - ends_v[0])))
    if found_ppm <= bound_ppm:
        return
    where = swept[int(np.argmax(x == worst))]
    raise MeasurementError(
        f"the non-linearity is {found_ppm:.4g} ppm of the span, the bench file expects at most {bound_ppm:g} ppm "
        f"(expected.nonlinearity_ppm): the output is {means_v[worst]:+.3g} V off the line at {where.describe()}",
        instrument="multimeter",
        step=str(where.point.step),
        hint="check the leads, the PCB's supply, and whether this is the right gyroscope",
    )


def _what(found: Jump, windows: Sequence[Seen]) -> str:
    """Name the time and size of the jump."""
    pattern = found.pattern
    first, last = windows[pattern.first], windows[pattern.last]
    measured = any(each.point.v_vc_measured_v is not None for each in windows)
    what = "the output, or V_Vc as it is read," if measured else "the output"
    size = f"{found.size:+.3g} {found.unit}"
    known = f" ({abs(found.sigmas):.0f} standard uncertainties)"
    if pattern.walks:
        return f"{what} walks by {size}{known} from {windows[pattern.first - 1].describe()} to the end"
    if pattern.last == len(windows) - 1 or pattern.first == 0:
        before = windows[pattern.first - 1] if pattern.first else last
        after = first if pattern.first else windows[pattern.last + 1]
        size = size if pattern.first else f"{-found.size:+.3g} {found.unit}"
        return f"{what} stepped by {size}{known} between {before.describe()} and {after.describe()}"
    where = first.describe() if first is last else f"the windows from {first.describe()} to {last.describe()}"
    return f"{what} was off by {size}{known} at {where}, and is not any more"


def watched(settings: ProcedureSettings, work: Routine[T], steps: frozenset[int] | None = None) -> Routine[T]:
    """Do `work`, see each of its windows, and see at its end that the output stood still and answered.

    Of `steps` alone, where they are told. MeasurementError: a setting did not give what it gave before, there was a
    step, a pulse or a walk of the output, or the output did not answer to what was set.
    """
    walk = Walk(settings, Limits.of(settings), steps=steps)
    try:
        step = next(work)
        while True:
            try:
                result = yield step
                note(walk, step, result)
            except BaseException as error:  # noqa: BLE001 - whatever it is, it is the work's to deal with
                step = work.throw(error)
            else:
                step = work.send(result)
    except StopIteration as ended:
        done: T = ended.value
    if any(each.point.std_v > _ROUNDING_V for each in walk.windows):  # a plan that is only looked at has no scatter
        try:
            require_no_jump(walk)
        except _NO_LOOK as error:  # everything is measured
            yield NotChecked("whether the output stepped or walked between windows", f"{type(error).__name__}: {error}")
    return done
