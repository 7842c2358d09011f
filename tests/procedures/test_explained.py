"""What explains a change of the scale factor since the certificate, and what is left of it."""

from __future__ import annotations

from vcfbench.procedures.health.explained import explained_parts, rise_since
from vcfbench.records.device_values import Characteristics, Measured
from vcfbench.reports.document import Report
from vcfbench.reports.text import text_of
from vcfbench.uncertainty.measurand import measurand
from vcfbench.values.value import UncertaintyPart

CHANGE = measurand(-2950.0, "ppm", [UncertaintyPart("all", 30.0)])
HZ, COLD = Measured(value=3488.93, u=0.02), Measured(value=3485.961, u=0.02)
SLOPE = Measured(value=-104.0, u=0.5)


def said(then: Characteristics, now: Characteristics) -> str:
    return " ".join(text_of(Report(explained_parts(CHANGE, then, now))).split())


def test_temperature_by_the_drive_and_rails_explain_what_they_do() -> None:
    rails = {"positive_rail_v": Measured(value=10.0, u=1e-3), "negative_rail_v": Measured(value=-10.0, u=1e-3)}
    wide = {"positive_rail_v": Measured(value=10.1, u=1e-3), "negative_rail_v": Measured(value=-10.1, u=1e-3)}
    by = {"drive_ppm_k": Measured(value=-30.0, u=0.1), "table_slope_ppm_k": SLOPE}
    volts = Measured(value=375.0, u=10.0)
    words = said(
        Characteristics(drive_hz=HZ, **rails, **by, table_slope_ppm_v=volts), Characteristics(drive_hz=COLD, **wide)
    )
    assert "Explained by: -2950±66 ppm by +28.4 K (U95 0.6, by the drive's frequency)" in words
    assert "; +37±2.1 ppm by +0.100 V of both rails. Unexplained: -37±88 ppm, within its U95." in words


def test_missing_coefficient_is_named_and_explains_no_change() -> None:
    words = said(Characteristics(drive_hz=HZ), Characteristics(drive_hz=COLD))
    assert "effect on this device not known (vcfbench run temperature --by table)" in words
    assert "Unexplained: -2950±59 ppm, more than its U95." in words
    same = said(Characteristics(drive_hz=HZ), Characteristics(drive_hz=HZ))
    assert "Explained by: nothing (the temperature, unchanged within 0.5 K (U95))." in same
    assert "nothing (temperature and rails were not compared)" in said(Characteristics(), Characteristics())


def test_without_a_thermometer_nothing_is_said_of_temperature() -> None:
    assert rise_since(Characteristics(), Characteristics()) is None
    assert explained_parts(CHANGE, None, None) == []
