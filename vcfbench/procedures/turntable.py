"""The turntable calibration: the gyro's output at 17 rates of the table, generator off."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vcfbench.procedures.phrases import Phrase, go_to_rate, powered, ramp_to, take
from vcfbench.procedures.steps import Note, Outcome, Plan

if TYPE_CHECKING:
    from vcfbench.procedures.settings import CalibrationSettings

__all__ = ["STEP", "table_sweep", "turntable"]

STEP = 1
"""The number that the points of this procedure carry: it has one step."""


def turntable(settings: CalibrationSettings) -> Plan:
    """Calibrate on the rate table, the PCB holding V_Vc at 0 V."""
    return (yield from powered(settings, _calibrate(settings)))


def _calibrate(settings: CalibrationSettings) -> Phrase[Outcome]:
    yield Note("Step 1: the table turns at each rate, generator off")
    yield from table_sweep(settings, STEP)
    return Outcome(f"turntable calibration at {len(settings.rates_deg_s)} rates")


def table_sweep(settings: CalibrationSettings, step: int) -> Phrase[None]:
    """Visit the rates in their order from rest, take a point at each, and go back to rest."""
    previous_deg_s = 0.0
    for rate_deg_s in settings.rates_deg_s:
        yield from go_to_rate(settings, rate_deg_s, previous_deg_s=previous_deg_s)
        yield from take(settings, step, rate_deg_s=rate_deg_s, v_vc_v=0.0, table_deg_s=rate_deg_s)
        previous_deg_s = rate_deg_s
    yield from ramp_to(settings, 0.0, previous_deg_s=previous_deg_s)
