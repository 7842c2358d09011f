"""Data sheets against figures that stand elsewhere than in the data sheet."""

from __future__ import annotations

import pytest

from vcfbench.models import MODELS, driver_of, resolve
from vcfbench.specifications import (
    AGILENT_33220A,
    HP_34401A,
    KEITHLEY_2000,
    KEITHLEY_DMM6500,
    KEYSIGHT_34461A,
    KEYSIGHT_34465A,
    KEYSIGHT_E3631A,
    KEYSIGHT_E36312A,
    TEMPERATURE_COEFFICIENTS,
    SupplySpecification,
    VoltmeterSpecification,
    accuracy_at,
)
from vcfbench.uncertainty import tones

METERS = (HP_34401A, KEYSIGHT_34461A, KEYSIGHT_34465A)


@pytest.mark.parametrize(
    ("range_v", "limits_uv"),
    [
        (0.1, (6.0, 7.5, 8.5)),
        (1.0, (26.0, 37.0, 47.0)),
        (10.0, (190.0, 250.0, 400.0)),
        (100.0, (2_600.0, 4_100.0, 5_100.0)),
        (1000.0, (26_000.0, 45_000.0, 55_000.0)),
    ],
)
def test_errors_at_full_scale_are_service_guides_limits(range_v: float, limits_uv: tuple[float, ...]) -> None:
    """34401A Service Guide p. 69: 24 hours, 90 days, 1 year."""
    seen = [HP_34401A.accuracy_of(range_v, age).limit_v(-range_v, range_v) * 1e6 for age in (1, 90, 365)]
    assert seen == pytest.approx(limits_uv)


def test_age_between_intervals_has_longer_accuracy() -> None:
    assert HP_34401A.accuracy_of(10.0, 30) == HP_34401A.accuracy_of(10.0, 90)


def test_what_a_sheet_does_not_say_is_not_made_up() -> None:
    with pytest.raises(ValueError, match=r"34401A has the ranges 0\.1, 1, 10, 100, 1000 V, not 5 V"):
        HP_34401A.accuracy_of(5.0, 1)
    with pytest.raises(ValueError, match="at most 365 days after calibration: a 34401A has no limits beyond"):
        HP_34401A.accuracy_of(10.0, 400)
    with pytest.raises(ValueError, match=r"34461A integrates over 0\.02, 0\.2, 1, 10, 100 cycles, not 0\.06"):
        KEYSIGHT_34461A.resolution_v(10.0, 0.06)


def test_resolutions_are_those_of_the_guides_tables() -> None:
    """Truevolt guide p. 452: 10 V and 10 uV are 10 PLC of a 34461A."""
    assert KEYSIGHT_34461A.resolution_v(10.0, 10.0) == pytest.approx(10e-6)
    assert KEYSIGHT_34465A.resolution_v(10.0, 10.0) == pytest.approx(1e-6)


@pytest.mark.parametrize("sheet", METERS, ids=lambda sheet: sheet.model)
def test_longer_integration_is_finer_and_older_is_coarser(sheet: VoltmeterSpecification) -> None:
    assert list(sheet.resolution) == sorted(sheet.resolution)
    assert list(sheet.resolution.values()) == sorted(sheet.resolution.values(), reverse=True)
    for range_v, ages in sheet.accuracy.items():
        limits = [ages[age].limit_v(range_v, range_v) for age in sorted(ages)]
        assert limits == sorted(limits)


def test_a_level_is_promised_as_a_part_and_a_voltage() -> None:
    assert AGILENT_33220A.limit_v(-0.1) == pytest.approx(0.02 * 0.1 + 4e-3)


@pytest.mark.parametrize("row", [row for row in MODELS if "multimeter" in row.roles], ids=lambda row: row.name)
def test_every_meter_that_comes_along_has_its_own_sheet(row) -> None:  # type: ignore[no-untyped-def]  # noqa: ANN001
    assert resolve(row.specifications).model == row.name
    assert set(resolve(row.specifications).resolution) == set(driver_of(row).integration_times_nplc)


@pytest.mark.parametrize("row", [row for row in MODELS if "multimeter" in row.roles], ids=lambda row: row.name)
def test_built_in_meters_integrate_briefly_enough_for_sines(row) -> None:  # type: ignore[no-untyped-def]  # noqa: ANN001
    assert {tones.NPLC, 1.0} <= set(driver_of(row).integration_times_nplc)


PRINTED = {
    "34401A": """
        0.1   1: 30 30   90: 40 35   365: 50 35
        1     1: 20 6    90: 30 7    365: 40 7
        10    1: 15 4    90: 20 5    365: 35 5
        100   1: 20 6    90: 35 6    365: 45 6
        1000  1: 20 6    90: 35 10   365: 45 10
    """,
    "34461A": """
        0.1   1: 30 30   90: 40 35   365: 50 35   730: 65 35
        1     1: 20 6    90: 30 7    365: 40 7    730: 55 7
        10    1: 15 4    90: 20 5    365: 35 5    730: 50 5
        100   1: 20 6    90: 35 6    365: 45 6    730: 60 6
        1000  1: 20 6    90: 35 10   365: 45 10   730: 60 10
    """,
    "34465A": "10    365: 30 4",
    "2000": """
        0.1   1: 30 30   90: 40 35   365: 50 35
        1     1: 15 6    90: 25 7    365: 30 7
        10    1: 15 4    90: 20 5    365: 30 5
        100   1: 15 6    90: 30 6    365: 45 6
        1000  1: 20 6    90: 35 6    365: 45 6
    """,
    "DMM6500": "10    365: 25 5",
}
"""Volts of a range, then days: ppm of the reading and ppm of the range, typed once more from what `accuracy_source`
names."""


def printed(model: str) -> dict[float, dict[int, tuple[float, float]]]:
    ranges: dict[float, dict[int, tuple[float, float]]] = {}
    for line in PRINTED[model].split("\n"):
        if not (words := line.replace(":", "").split()):
            continue
        ages = range(1, len(words), 3)
        ranges[float(words[0])] = {int(words[k]): (float(words[k + 1]), float(words[k + 2])) for k in ages}
    return ranges


@pytest.mark.parametrize("sheet", [*METERS, KEITHLEY_2000, KEITHLEY_DMM6500], ids=lambda sheet: sheet.model)
def test_accuracies_are_those_printed(sheet: VoltmeterSpecification) -> None:
    stated = {
        range_v: {age: (of.reading * 1e6, of.range * 1e6) for age, of in ages.items()}
        for range_v, ages in sheet.accuracy.items()
    }
    assert {range_v: sorted(ages) for range_v, ages in stated.items()} == {
        range_v: sorted(ages) for range_v, ages in printed(sheet.model).items()
    }
    for range_v, ages in printed(sheet.model).items():
        for age, ppm in ages.items():
            assert stated[range_v][age] == pytest.approx(ppm, rel=1e-9), (range_v, age)


@pytest.mark.parametrize(
    ("sheet", "voltage", "current"),
    [
        (KEYSIGHT_E3631A, "0.1 5m, 0.05 10m, 0.05 10m", "0.2 10m, 0.15 4m, 0.15 4m"),
        (KEYSIGHT_E36312A, "0.03 3m, 0.03 5m, 0.03 5m", "0.1 5m, 0.1 2m, 0.1 2m"),
    ],
    ids=lambda value: getattr(value, "model", ""),
)
def test_read_backs_are_those_printed(sheet: SupplySpecification, voltage: str, current: str) -> None:
    """Percent of the reading and millivolts or milliamperes: P6V, P25V, N25V."""
    for stated, words in ((sheet.voltage, voltage), (sheet.current, current)):
        for output, line in zip(("P6V", "P25V", "N25V"), words.split(","), strict=True):
            percent, milli = line.replace("m", "").split()
            assert stated[output] == pytest.approx((float(percent) / 100.0, float(milli) / 1000.0), rel=1e-9)


def test_kelvin_outside_18_to_28_degrees_adds_the_printed_terms() -> None:
    """User's Guide p. 216, (ppm of the reading + ppm of the range) a kelvin."""
    assert (TEMPERATURE_COEFFICIENTS[0.1].reading, TEMPERATURE_COEFFICIENTS[0.1].range) == (5e-6, 5e-6)
    at_10_v = accuracy_at(HP_34401A, 10.0, 365, outside_k=1.0)[0]
    usual = HP_34401A.accuracy_of(10.0, 365)
    assert (at_10_v.reading - usual.reading, at_10_v.range - usual.range) == pytest.approx((5e-6, 1e-6))
