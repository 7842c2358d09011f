"""The output at a level of both signs, chopped against drift, the level being a rate of the table or a V_Vc."""

from collections.abc import Iterable, Sequence

from vcfbench import steps
from vcfbench.analysis.chopped import CHOPPED
from vcfbench.belief.agreement import require_steady_slope
from vcfbench.belief.walk import require_answer
from vcfbench.instructions import routines
from vcfbench.instructions.scale_factor import (
    LevelSettings,
    ScaleFactorBy,
    require_as_used,
    tells_scale_factor,
)
from vcfbench.records.schema import Point
from vcfbench.steps.step import Routine


def to_level(settings: LevelSettings, sign: float, previous: float = 0.0) -> Routine[float]:
    """Apply the level with this sign; at 0 V_Vc is off. Return V_Vc as it reads back, V."""
    if settings.by is ScaleFactorBy.TABLE:
        rate, before = sign * settings.level_deg_s, previous * settings.level_deg_s
        yield from routines.go_to_rate(settings, rate, previous_deg_s=before)
        return 0.0
    if sign == 0.0:
        yield steps.DisableVvc()
        yield steps.Settle(settings.settle_s, "gyro settles, generator off")
        return 0.0
    if previous == 0.0:
        yield from routines.v_vc_on()
    return (yield from routines.set_v_vc(settings, sign * settings.level_v))


def table_due_deg_s(settings: LevelSettings, sign: float) -> float | None:
    """Return the due read-back of the table, or None."""
    if settings.station.limits.max_rate_deg_s is None:
        return None
    return sign * settings.level_deg_s if settings.by is ScaleFactorBy.TABLE else 0.0


def at_signs(settings: LevelSettings, signs: Iterable[float]) -> Routine[list[Point]]:
    """Take a window at the level with each sign in turn, the first from rest, and see that the output answered."""
    previous, v_vc_v = 0.0, 0.0
    points: list[Point] = []
    for sign in signs:
        if sign != previous:
            v_vc_v = yield from to_level(settings, sign, previous)
        rate_deg_s, table_deg_s = sign * settings.level_deg_s, table_due_deg_s(settings, sign)
        points.append(
            (yield from routines.take(settings, 1, rate_deg_s=rate_deg_s, v_vc_v=v_vc_v, table_deg_s=table_deg_s))
        )
        previous = sign
    require_answer(settings, points)
    return points


def chopped(settings: LevelSettings, cycles: int, before: Sequence[Point] = ()) -> Routine[list[Point]]:
    """Take the six windows 0, +, -, -, +, 0 at the level, `cycles` times; return those of the last time.

    MeasurementError: the output answers otherwise than in the windows `before`, or the other way than is told.
    """
    points = list(before)
    for _ in range(cycles):
        same = points[1:3]  # + and -
        points = yield from at_signs(settings, map(float, CHOPPED))
        require_steady_slope(points, same)
        slope = (points[1].output_v - points[2].output_v) / (points[1].rate_deg_s - points[2].rate_deg_s)
        by_v_vc = settings.by is ScaleFactorBy.V_VC
        if by_v_vc or tells_scale_factor(settings):
            require_as_used(settings, slope, by_v_vc=by_v_vc)
    return points
