"""V_Vc measured beside the output, where the bench has a meter on it, and points at the V_Vc that was measured.

A generator reads back its setting to the last digit, however far its level is off; a second meter sees the level.
"""

import math
from collections.abc import Callable, Sequence

from msgspec.structs import replace

from vcfbench.models import data_sheet_of
from vcfbench.procedures.shared.routines import set_v_vc, take, window_of
from vcfbench.procedures.shared.sweep.schedule import ABBA_SIGNS
from vcfbench.records.schema import Point
from vcfbench.specifications import AGILENT_33220A, LevelSpecification
from vcfbench.station.settings import ProcedureSettings
from vcfbench.steps import AcquireWithVvc, ConfigureVvcMeter, Window
from vcfbench.steps.step import Routine, answer

K_VC_UNIT = "(deg/s)/V"
"""Unit of the rate that a volt of V_Vc stands for."""


def has_v_vc_meter(settings: ProcedureSettings) -> bool:
    """Tell whether the bench has a meter of its own on V_Vc."""
    return "v_vc_meter" in settings.station.instruments


def ready_v_vc_meter(settings: ProcedureSettings, range_v: float) -> Routine[None]:
    """Set up the meter on V_Vc, where the bench has one."""
    if has_v_vc_meter(settings):
        yield ConfigureVvcMeter(range_v, float(settings.nplc))


def take_driven(
    settings: ProcedureSettings,
    step: int,
    *,
    rate_deg_s: float,
    v_vc_v: float,
    table_deg_s: float | None,
    tolerance_v: float | None = None,
) -> Routine[Point]:
    """Average one window with V_Vc on; V_Vc is measured beside it where the bench has a meter for that.

    It must be within `tolerance_v` of its setting; by default that of :func:`v_vc_tolerance_v`.
    """
    if not has_v_vc_meter(settings):
        return (yield from take(settings, step, rate_deg_s=rate_deg_s, v_vc_v=v_vc_v, table_deg_s=table_deg_s))
    within_v = v_vc_tolerance_v(settings, v_vc_v) if tolerance_v is None else tolerance_v
    common = window_of(settings)
    acquire = AcquireWithVvc(step, rate_deg_s, v_vc_v, table_deg_s, v_vc_tolerance_v=within_v, **common)
    return answer((yield acquire), Window).point


def both_signs(
    settings: ProcedureSettings, step: int, level_v: float, *, tolerance_v: float | None = None
) -> Routine[list[Point]]:
    """Average a window at V_Vc of both signs, +, -, -, +, with the table at rest; `tolerance_v` as `take_driven`."""
    points: list[Point] = []
    asked_v = set_v = 0.0
    for sign in ABBA_SIGNS:
        if asked_v != sign * level_v:
            asked_v = sign * level_v
            set_v = yield from set_v_vc(settings, asked_v)
        taken = take_driven(settings, step, rate_deg_s=0.0, v_vc_v=set_v, table_deg_s=None, tolerance_v=tolerance_v)
        points.append((yield from taken))
    return points


def generator_sheet(settings: ProcedureSettings) -> LevelSpecification:
    """Return the data sheet of the bench's generator, that of a 33220A where it has none."""
    placed = settings.station.instruments.get("rate_source")
    sheet = None if placed is None else data_sheet_of(placed.model)
    return sheet if isinstance(sheet, LevelSpecification) else AGILENT_33220A


def v_vc_tolerance_v(settings: ProcedureSettings, v_vc_v: float) -> float:
    """Return the tolerance of V_Vc about its setting: the generator's accuracy and a quarter more, V."""
    return 1.25 * generator_sheet(settings).limit_v(v_vc_v)


def at_measured_levels(points: Sequence[Point]) -> Sequence[Point]:
    """Return the points at the V_Vc that was measured; those at which it was not stay as they are.

    All windows of one step at one setting have one level, the mean of what was measured at them.
    """
    seen: dict[tuple[int, float], list[float]] = {}
    for point in points:
        if point.v_vc_measured_v is not None:
            seen.setdefault((point.step, point.v_vc_v), []).append(point.v_vc_measured_v)
    if not seen:
        return points
    levels_v = {key: math.fsum(volts) / len(volts) for key, volts in seen.items()}
    return [replace(point, v_vc_v=levels_v.get((point.step, point.v_vc_v), point.v_vc_v)) for point in points]


def standing_for(points: Sequence[Point], step: int, rate_of: Callable[[float], float]) -> Sequence[Point]:
    """Return the points, those of `step` at the rates that their measured V_Vc stands for."""
    return [
        replace(point, rate_deg_s=rate_of(point.v_vc_v))
        if point.step == step and point.v_vc_measured_v is not None
        else point
        for point in points
    ]
