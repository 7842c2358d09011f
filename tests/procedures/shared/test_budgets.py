"""How values with an uncertainty are told."""

from __future__ import annotations

import pytest

from vcfbench.procedures.shared.measurand import UncertaintyPart, budget_table, mean_of_records, measurand, said_of
from vcfbench.reports.text import table_text


def test_a_value_has_the_digits_of_its_uncertainty() -> None:
    found = measurand(-0.012552127123, "V/(deg/s)", [UncertaintyPart("readings", 2.04e-7)])
    assert said_of("scale factor", found) == (
        "scale factor: -0.01255213 V/(deg/s), u 2.0e-07, 16 ppm, U95 4.0e-07 (k = 1.96)"
    )
    assert "741.5 ppm, u 7.5, U95 15" in said_of(
        "non-linearity", measurand(741.47741, "ppm", [UncertaintyPart("readings", 7.5)])
    )
    assert said_of("exact", measurand(1.5, "V", [])).startswith("exact: 1.5 V, u 0,")


@pytest.mark.parametrize("unit", ["V", "deg/s", "ppm"])
def test_no_share_is_told_of_what_has_its_zero_anywhere(unit: str) -> None:
    assert said_of("it", measurand(40.0, unit, [UncertaintyPart("readings", 4.0)])).count("ppm") == (unit == "ppm")


def test_what_rounding_leaves_of_a_part_that_cancels_is_shown_as_none() -> None:
    parts = [
        UncertaintyPart("readings", 1.8e-3),
        UncertaintyPart("small", 5e-8),
        UncertaintyPart("the Earth's rate", 4.7e-21),
    ]
    table = budget_table("K_Vc", measurand(150.0, "(deg/s)/V", parts))
    assert [row[1] for row in table.rows] == [1.8e-3, 5e-8, 0.0]
    shown = table_text(table)
    assert "e-21" not in shown
    assert "5e-08" in shown


def test_each_part_is_told_with_its_share_of_the_variance() -> None:
    parts = [UncertaintyPart("readings", 0.4), UncertaintyPart("table", -0.3)]
    table = budget_table("K_Vc", measurand(200.0, "(deg/s)/V", parts))
    assert [row[:4] for row in table.rows] == [
        ("readings", 0.4, pytest.approx(2000.0), pytest.approx(64.0)),
        ("table", 0.3, pytest.approx(1500.0), pytest.approx(36.0)),
    ]


def test_the_mean_of_records_has_their_scatter_and_what_they_share() -> None:
    found = mean_of_records([1.0, 2.0, 3.0, 4.0], "V", UncertaintyPart("meter", 0.5))
    scatter = (5.0 / 3.0) ** 0.5 / 2.0
    assert found.value == 2.5
    assert found.u == pytest.approx((scatter**2 + 0.25) ** 0.5)
    records = next(part for part in found.parts if part.source == "records")
    assert (records.u, records.dof) == (pytest.approx(scatter), 3)
