"""The turntable calibration: the gyro's output at 17 rates of the table, generator off."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vcfbench.bench.settings import ProcedureSettings
from vcfbench.procedures.agreement import (
    SWEEP_DRIFT,
    require_agreement,
    require_expected_column,
    require_steady_slope,
)
from vcfbench.procedures.catalogue import BUILT_IN
from vcfbench.procedures.procedure import Procedure
from vcfbench.procedures.reports import turntable_report
from vcfbench.procedures.results import TurntableResult, turntable_results
from vcfbench.procedures.routines import go_to_rate, powered, ramp_to, take, take_zero_again
from vcfbench.procedures.steps import Note, Outcome, Plan, Settle

if TYPE_CHECKING:
    from collections.abc import Sequence

    from vcfbench.procedures.step import Routine
    from vcfbench.record.schema import Point

__all__ = ["STEP", "TURNTABLE", "table_sweep", "turntable"]

STEP = 1
"""The number that the points of this procedure carry: it has one step."""


def turntable(settings: ProcedureSettings) -> Plan:
    """Calibrate on the rate table, the PCB holding V_Vc at 0 V."""
    return (yield from powered(settings, _calibrate(settings)))


def _calibrate(settings: ProcedureSettings) -> Routine[Outcome]:
    yield Note("Step 1: the table turns at each rate, generator off")
    points = yield from table_sweep(settings, STEP)
    require_expected_column(points, settings.expected)
    yield Settle(settings.settle_s, "gyro settles after the rate step")
    points.append((yield from take_zero_again(settings, STEP)))
    require_agreement(points, settings, SWEEP_DRIFT)
    return Outcome(f"turntable calibration at {len(settings.rates_deg_s)} rates")


def table_sweep(settings: ProcedureSettings, step: int, earlier: Sequence[Point] = ()) -> Routine[list[Point]]:
    """Visit the rates in their order from rest, take a point at each, and go back to rest.

    Points must agree with each other, and with those that were measured `earlier` with the generator off: the zero and
    the output at the matching rate.
    """
    previous_deg_s, reference = 0.0, tuple(earlier[:2])
    points: list[Point] = []
    for rate_deg_s in settings.rates_deg_s:
        yield from go_to_rate(settings, rate_deg_s, previous_deg_s=previous_deg_s)
        points.append((yield from take(settings, step, rate_deg_s=rate_deg_s, v_vc_v=0.0, table_deg_s=rate_deg_s)))
        require_agreement([*earlier, *points], settings, SWEEP_DRIFT)
        if reference:
            require_steady_slope(points[-2:], reference)
        previous_deg_s = rate_deg_s
    require_steady_slope(points, reference)
    yield from ramp_to(settings, 0.0, previous_deg_s=previous_deg_s)
    return points


def _results(settings: ProcedureSettings, points: Sequence[Point]) -> TurntableResult:
    return turntable_results(points, settings.meter_resolution_v, settings)


TURNTABLE = Procedure(
    name="turntable",
    title=BUILT_IN["turntable"][1],
    settings=ProcedureSettings,
    plan=turntable,
    results=_results,
    report=turntable_report,
)
"""The turntable calibration."""
