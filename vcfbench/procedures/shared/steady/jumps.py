"""Steps, pulses and walks of the output in a series of windows, found from references, repeats and smoothness.

What the output should be is a cubic in the rate (or in V_Vc) with free coefficients, and terms of higher order that are
small beside those two orders below; windows of one setting share it. What noise, flicker, warm-up, temperature, the
table's rate and the generator's levels may add has a covariance. A fault is a pattern in time: an offset from one
window to another, or a slope from one on. Its size by generalised least squares over its standard uncertainty is a test
for each pattern (Willsky and Jones 1976, *A generalized likelihood ratio approach to detection and estimation of jumps
in linear systems*); the largest decides.
"""

import math
from collections.abc import Sequence
from contextlib import suppress
from typing import TypeVar

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from vcfbench.analysis.arrays import Floats
from vcfbench.errors import MeasurementError
from vcfbench.procedures.shared.budget.known_levels import known_levels
from vcfbench.procedures.shared.known.v_vc import has_v_vc_meter, mean_levels_v
from vcfbench.procedures.shared.steady.walk import Limits, Seen, Walk, sigmas
from vcfbench.procedures.shared.sweep.schedule import SEARCH, ZERO_DRIVEN, ZERO_TABLE, Order, SweepSettings
from vcfbench.station.settings import ProcedureSettings
from vcfbench.steps import NotChecked
from vcfbench.steps.step import Routine, Step, StepResult

T = TypeVar("T")

_ORDERS = 3
"""The curve's orders that are as large as they like."""
_NEXT = 0.03
"""Largest ratio of a term to that two orders below, at the largest rate: an output stage that is off by 1 % there
leaves 0.4 % of its cubic term to the next one (the series of tanh)."""
_MOST_BENT = 0.01
"""Largest curvature, relative to the span: a curve that bends more does so by a fault."""
_HIGHEST = 9
_UNSEEN = 1e-4
"""A pattern of which the free terms leave less than this share (of its square) is not asked for."""
_HALF = 0.5
"""Patterns are fewer than comparisons, and each has the noise of many windows: 5.5 is a chance of 2e-6 a run."""
_ANSWERS = 8.0
"""Standard uncertainties that the slope must be away from zero."""
_NO_SWEEP = frozenset({ZERO_TABLE, ZERO_DRIVEN, SEARCH})
_NO_LOOK = (MemoryError, np.linalg.LinAlgError)
_CURVED = 0.2
"""Largest residual of a line, relative to the span: beyond, the output answers to something else than the rate."""


class Jump(Struct, frozen=True):
    """A pattern in time: from window `first` to `last`, both included; `size_v` its offset, or the size of its walk.

    `sigmas` is its size over its standard uncertainty.
    """

    first: int
    last: int
    size_v: float
    sigmas: float
    walks: bool = False


def require_no_jump(walk: Walk) -> None:
    """See that the output moves by settings alone: of all windows on the same rails, generator on, or off.

    MeasurementError: it stepped, read too much for a while, walked away, or does not answer to what is set.
    """
    for driven, rails_v in dict.fromkeys((each.driven, each.rails_v) for each in walk.windows):
        windows = [each for each in walk.windows if (each.driven, each.rails_v) == (driven, rails_v)]
        if len({each.setting for each in windows}) < 2:
            continue
        _require_answer(walk, windows)
        if found := _significant(walk, windows):
            raise MeasurementError(
                f"{_what(found, windows)}: no smooth curve goes through all windows",
                instrument="multimeter",
                step=str(windows[found.last].point.step),
                hint="look at leads and contacts, and at what else happened then; all points are in the record. "
                "expected.zero_drift_v of the bench file is what may drift",
            )


def note(walk: Walk, step: Step, result: StepResult) -> None:
    """Let `walk` take notice of a performed step.

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


def _significant(walk: Walk, windows: Sequence[Seen]) -> Jump | None:
    found = largest_jump(walk, windows)
    return found if found is not None and abs(found.sigmas) > sigmas(walk.dof) - _HALF else None


def largest_jump(walk: Walk, windows: Sequence[Seen]) -> Jump | None:
    """Return the fault that fits best, None where there is nothing that would show one."""
    count = len(windows)
    output = np.array([each.point.output_v for each in windows])
    x, at_s = _abscissa(windows), np.array([each.middle_s for each in windows])
    # The terms that the output may have of any size, a column each
    terms = [x**order for order in range(_free_orders(windows) + 1)]
    at_zero = np.array([each.driven and not each.point.v_vc_v for each in windows])
    if 0 < at_zero.sum() < count - len(terms):  # a generator's 0 V is on no range of its levels
        terms.append(at_zero.astype(float))
    if isinstance(walk.settings, SweepSettings) and walk.settings.order is Order.LOOP:
        way, before = np.zeros(count), 0.0
        for at in range(count):
            if not windows[at].reference and windows[at].point.step in {1, 3, 4}:
                way[at] = np.sign(x[at] - before) or (way[at - 1] if at else 0.0)
                before = x[at]
        if len(set(way.tolist())) > 1:
            terms += [way, way * x, way * x**2]
    free = np.column_stack(terms)
    if free.shape[1] >= count:
        return None
    covariance = _covariance(walk, windows, x, free)
    root = np.linalg.cholesky(covariance)
    # The patterns: an offset for each stretch of windows, and a walk from each window but the first and last on. A
    # stretch is the difference of two steps, so that there are as many columns as windows
    steps = np.arange(count)[:, None] >= np.arange(count + 1)
    walks = np.maximum(0.0, at_s[:, None] - at_s[: count - 2]) / max(float(at_s[-1] - at_s[0]), 1e-9)
    whitened = np.linalg.solve(root, np.column_stack([free, output, steps, walks]))
    basis, _ = np.linalg.qr(whitened[:, : free.shape[1]])
    rest = whitened[:, free.shape[1] :]
    left = rest - basis @ (basis.T @ rest)
    begin, end = (np.delete(each, count - 1) for each in np.triu_indices(count + 1, 1))  # all together are the bias
    shows, of_all = _squares(left[:, 1:], begin, end), _squares(rest[:, 1:], begin, end)
    along = left[:, 0] @ left[:, 1:]
    along = np.concatenate([along[begin] - along[end], along[count + 1 :]])
    seen = shows > _UNSEEN * of_all
    if not seen.any():
        return None
    sizes = np.abs(np.where(seen, along / np.sqrt(np.where(seen, shows, 1.0)), 0.0))
    most = int(np.argmax(sizes >= (1.0 - 1e-9) * sizes.max()))  # the first of equals
    if walks_on := most >= len(begin):
        first, last = most - len(begin) + 1, count - 1
        pattern = left[:, count + 1 + first]
    else:
        first, last = int(begin[most]), int(end[most]) - 1
        pattern = left[:, 1 + first] - left[:, 2 + last]
    shown, size = float(pattern @ pattern), float(left[:, 0] @ pattern)
    return Jump(first, last, size / shown, size / math.sqrt(shown), walks=walks_on)


def _squares(columns: Floats, begin: NDArray[np.intp], end: NDArray[np.intp]) -> Floats:
    """Return the squares of all patterns, by the columns of the steps that they begin and end with, and of the walks.

    Of the differences of two columns: a column for each pair needs memory with the cube of the windows.
    """
    steps, walks = np.split(columns, [int(end.max()) + 1], axis=1)
    products, own = steps.T @ steps, np.square(steps).sum(axis=0)
    return np.concatenate([own[begin] + own[end] - 2.0 * products[begin, end], np.square(walks).sum(axis=0)])


def _abscissa(windows: Sequence[Seen]) -> Floats:
    """Return the output's abscissa, largest 1: V_Vc as it was measured or set, or the table's rate."""
    if windows[0].driven:
        x = np.array(mean_levels_v([each.point.v_vc_v for each in windows], [each.point for each in windows]))
    else:
        x = np.array([each.table_deg_s for each in windows])
    return np.asarray(x / max(float(np.abs(x).max()), 1e-12))


def _free_orders(windows: Sequence[Seen]) -> int:
    """Return the highest order of the curve that is free: through two settings a line."""
    return max(1, min(_ORDERS, len({each.setting for each in windows}) - 2))


def _covariance(walk: Walk, windows: Sequence[Seen], x: Floats, free: Floats) -> Floats:
    """Return how the outputs may be off the free terms, V^2."""
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
    scatter = [max(walk.variance_v2, math.fsum(v := by_rate[abs(each.table_deg_s)]) / len(v)) for each in windows]
    own = np.array([variance / each.point.n for variance, each in zip(scatter, windows, strict=True)])
    at_rate = np.array([float(each.table_deg_s != 0.0) for each in windows])
    of_table = (at_rate * limits.table_rate * (slope_v * np.abs(x))) ** 2 / 3.0
    total = np.diag(own + walk.settings.meter_resolution_v**2 / 12.0 + of_table)
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
        wrong = f"answer to {what}: {seen}"
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
        hint=f"look at the lead of the output, {lead}the rails at the PCB, and the drive signal",
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
        hint="look at the leads, at the rails at the PCB, and whether this is the gyroscope that is expected",
    )


def _what(found: Jump, windows: Sequence[Seen]) -> str:
    """Name the time and size of the jump."""
    first, last = windows[found.first], windows[found.last]
    size = f"{found.size_v:+.3g} V ({abs(found.sigmas):.0f} standard uncertainties)"
    if found.walks:
        return f"the output walks by {size} from {windows[found.first - 1].describe()} to the end"
    if found.last == len(windows) - 1 or found.first == 0:
        before = windows[found.first - 1] if found.first else last
        after = first if found.first else windows[found.last + 1]
        size = size if found.first else f"{-found.size_v:+.3g} V ({abs(found.sigmas):.0f} standard uncertainties)"
        return f"the output stepped by {size} between {before.describe()} and {after.describe()}"
    where = first.describe() if first is last else f"the windows from {first.describe()} to {last.describe()}"
    return f"the output was off by {size} at {where}, and is not any more"


def watched(settings: ProcedureSettings, work: Routine[T]) -> Routine[T]:
    """Do `work`, see each of its windows, and see at its end that the output stood still and answered.

    MeasurementError: a setting did not give what it gave before, there was a step, a pulse or a walk of the output, or
    the output did not answer to what was set.
    """
    walk = Walk(settings, Limits.of(settings))
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
    if any(each.point.std_v for each in walk.windows):  # a plan that is only looked at has no scatter at all
        try:
            require_no_jump(walk)
        except _NO_LOOK as error:  # everything is measured
            yield NotChecked("whether the output stepped or walked between windows", f"{type(error).__name__}: {error}")
    return done
