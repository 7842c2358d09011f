"""The turntable calibration: the gyro's output at 17 rates of the table, generator off."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vcfbench.plans.steps import Note, Outcome, Plan, Settle
from vcfbench.procedures.catalogue import BUILT_IN
from vcfbench.procedures.procedure import Procedure
from vcfbench.procedures.routines import go_to_rate, powered, ramp_to, take, take_zero_again
from vcfbench.procedures.sweep.agreement import (
    require_agreement,
    require_expected_column,
    require_steady_slope,
)
from vcfbench.procedures.sweep.schedule import (
    ZERO_TABLE,
    SweepSettings,
    no_whole_turn,
    sweep_drift,
    sweep_words,
    window_grid,
)
from vcfbench.procedures.virtual_coriolis.report import turntable_report
from vcfbench.procedures.virtual_coriolis.results import TurntableResult, turntable_results

if TYPE_CHECKING:
    from collections.abc import Sequence

    from vcfbench.plans.step import Routine
    from vcfbench.record.schema import Point

__all__ = ["STEP", "TURNTABLE", "table_sweep", "turntable"]

STEP = 1
"""The number that the points of this procedure carry: it has one step."""


def turntable(settings: SweepSettings) -> Plan:
    """Calibrate on the rate table, the PCB holding V_Vc at 0 V."""
    return (yield from powered(settings, _calibrate(settings)))


def _calibrate(settings: SweepSettings) -> Routine[Outcome]:
    yield Note("Step 1: the table turns at each rate, generator off")
    points = yield from table_sweep(settings, STEP)
    require_expected_column(points, settings.expected)
    yield Settle(settings.settle_s, "gyro settles after the rate step")
    points.append((yield from take_zero_again(settings, STEP)))
    require_agreement(points, settings, sweep_drift(settings))
    return Outcome(f"turntable calibration at {len(settings.rates_deg_s)} rates{sweep_words(settings)}")


def table_sweep(settings: SweepSettings, step: int, earlier: Sequence[Point] = ()) -> Routine[list[Point]]:
    """Visit the rates in their order from rest, take a point at each, and go back to rest.

    Points must agree with each other, and with those that were measured `earlier` with the generator off: the zero and
    the output at the matching rate. Returns the points, those of zeros between apart.
    """
    previous_deg_s, reference = 0.0, tuple(earlier[:2])
    points: list[Point] = []
    zeros: list[Point] = []
    yield from _announced(settings)
    for visit in settings.visits_deg_s:
        rate_deg_s = visit or 0.0
        yield from go_to_rate(settings, rate_deg_s, previous_deg_s=previous_deg_s)
        own, number = (points, step) if visit is not None else (zeros, ZERO_TABLE)
        own.append((yield from take(settings, number, rate_deg_s=rate_deg_s, v_vc_v=0.0, table_deg_s=rate_deg_s)))
        others = (each for each in (*points, *zeros) if each is not own[-1])
        require_agreement([*earlier, *others, own[-1]], settings, sweep_drift(settings))
        if reference:
            require_steady_slope(points[-2:], reference)
        previous_deg_s = rate_deg_s
    require_steady_slope(points, reference)
    yield from ramp_to(settings, 0.0, previous_deg_s=previous_deg_s)
    return points


def _announced(settings: SweepSettings) -> Routine[None]:
    """Say in what order, and at which rates windows of whole turns cannot be."""
    if words := sweep_words(settings):
        yield Note(f"The rates{words}")
    if settings.whole_turns:
        for rate_deg_s in sorted({abs(rate) for rate in settings.rates_deg_s}):
            if not window_grid(settings, rate_deg_s).turns:
                yield Note(no_whole_turn(settings, rate_deg_s))


def _results(settings: SweepSettings, points: Sequence[Point]) -> TurntableResult:
    return turntable_results(points, settings.meter_resolution_v, settings)


TURNTABLE = Procedure(
    name="turntable",
    title=BUILT_IN["turntable"][1],
    method=(
        "The rate table turns the gyroscope at each rate in turn, the generator off. At each rate the table's read- "
        "back is checked and the output is the mean of repeated readings of the multimeter. A least-squares line "
        "through the means gives scale factor (slope) and bias (value at rest); what it leaves over gives the non- "
        "linearity. Uncertainties are combined after the GUM (JCGM 100)."
    ),
    settings=SweepSettings,
    plan=turntable,
    results=_results,
    report=turntable_report,
)
"""The turntable calibration."""
