"""Data sheets against figures that stand elsewhere than in the data sheet."""

from __future__ import annotations

import pytest

from vcfbench.models import MODELS, resolve
from vcfbench.procedures import tones
from vcfbench.specifications import AGILENT_33220A, HP_34401A, KEYSIGHT_34461A, KEYSIGHT_34465A, VoltmeterSpecification

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
def test_errors_at_full_scale_are_the_test_limits_of_the_service_guide(
    range_v: float, limits_uv: tuple[float, ...]
) -> None:
    """34401A Service Guide p. 69: 24 hours, 90 days, 1 year."""
    seen = [HP_34401A.accuracy_of(range_v, age).limit_v(-range_v, range_v) * 1e6 for age in (1, 90, 365)]
    assert seen == pytest.approx(limits_uv)


def test_an_age_in_between_has_the_accuracy_of_the_longer_interval() -> None:
    assert HP_34401A.accuracy_of(10.0, 30) == HP_34401A.accuracy_of(10.0, 90)


def test_what_a_sheet_does_not_say_is_not_made_up() -> None:
    with pytest.raises(ValueError, match=r"34401A has the ranges 0\.1, 1, 10, 100, 1000 V, not 5 V"):
        HP_34401A.accuracy_of(5.0, 1)
    with pytest.raises(ValueError, match="at most 365 days after calibration: a 34401A promises nothing beyond"):
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
    assert set(resolve(row.specifications).resolution) == set(resolve(row.driver).integration_times_nplc)


@pytest.mark.parametrize("row", [row for row in MODELS if "multimeter" in row.roles], ids=lambda row: row.name)
def test_every_meter_that_comes_along_integrates_as_briefly_as_sines_ask(row) -> None:  # type: ignore[no-untyped-def]  # noqa: ANN001
    assert {tones.NPLC, 1.0} <= set(resolve(row.driver).integration_times_nplc)
