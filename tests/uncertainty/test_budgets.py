"""How values with an uncertainty are told."""

from __future__ import annotations

import pytest

from vcfbench.reports.text import table_text
from vcfbench.uncertainty.measurand import (
    as_kept,
    budget_table,
    mean_of_records,
    measurand,
    quantity_table,
    said_of,
)
from vcfbench.values.value import UncertaintyPart


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


def test_rounding_rest_of_cancelled_part_is_zero() -> None:
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


def test_mean_of_records_has_scatter_and_shared_error() -> None:
    found = mean_of_records([1.0, 2.0, 3.0, 4.0], "V", UncertaintyPart("meter", 0.5))
    scatter = (5.0 / 3.0) ** 0.5 / 2.0
    assert found.value == 2.5
    assert found.u == pytest.approx((scatter**2 + 0.25) ** 0.5)
    records = next(part for part in found.parts if part.source == "records")
    assert (records.u, records.dof) == (pytest.approx(scatter), 3)


@pytest.mark.parametrize(
    ("parts", "u", "dof", "factor"),
    [
        ([UncertaintyPart("a", 3.0), UncertaintyPart("b", -4.0)], 5.0, None, 1.95996),
        ([UncertaintyPart("a", 2.0, 4.0)], 2.0, 4.0, 2.77645),  # Student's t
        ([UncertaintyPart("a", 2.0, 4.0), UncertaintyPart("b", 2.0)], 8.0**0.5, 16.0, 2.11991),
        ([UncertaintyPart("a", 2.0, rectangular=True)], 2.0, None, 0.95 * 3.0**0.5),
        (  # a triangle
            *([UncertaintyPart(name, 2.0, rectangular=True) for name in "ab"], 8.0**0.5, None),
            6.0**0.5 * (1.0 - 0.05**0.5),
        ),
        ([UncertaintyPart("a", 1.0, rectangular=True), UncertaintyPart("b", 5.0)], 26.0**0.5, None, 1.95996),
        ([], 0.0, None, None),
    ],
)
def test_u95_is_that_of_the_distributions_that_prevail(
    parts: list[UncertaintyPart], u: float, dof: float | None, factor: float | None
) -> None:
    """A rectangle with up to a twentieth of the variance does not show."""
    found = measurand(7.0, "V", parts, ["flicker", "table", "flicker"])
    assert (found.u, found.dof) == (pytest.approx(u), dof if dof is None else pytest.approx(dof))
    assert found.coverage_factor == (None if factor is None else pytest.approx(factor, rel=2e-3))
    assert found.u95 == pytest.approx((factor or 0.0) * u, rel=2e-3)
    assert list(found.parts) == sorted(parts, key=lambda part: -abs(part.u))
    assert (found.value, found.missing) == (7.0, ("flicker", "table"))
    assert not measurand(7.0, "V", parts).missing


def test_a_twentieth_of_the_variance_is_where_a_rectangle_shows() -> None:
    def factor(share: float) -> float:
        parts = [UncertaintyPart("a", share**0.5, rectangular=True), UncertaintyPart("b", (1.0 - share) ** 0.5)]
        return measurand(0.0, "V", parts).coverage_factor

    assert factor(0.049) == measurand(0.0, "V", [UncertaintyPart("b", 1.0)]).coverage_factor != factor(0.051)


def test_a_value_is_kept_with_its_parts_as_shares() -> None:
    kept = as_kept(measurand(7.0, "V", [UncertaintyPart("meter", 3.0, 9.0, "M1")], ["flicker"]))
    assert (kept.value, kept.u, kept.dof, kept.missing) == (7.0, 3.0, 9.0, ("flicker",))
    assert [(each.source, each.u, each.of, each.dof) for each in kept.shares] == [("meter", 3.0, "M1", 9.0)]


def test_budget_has_a_row_for_each_part() -> None:
    found = measurand(0.0, "V", [UncertaintyPart("meter", 3.0, 9.0, "M1"), UncertaintyPart("readings", -4.0)], ["tilt"])
    table = budget_table("bias", found)
    assert [row[2:] for row in table.rows] == [
        (None, pytest.approx(64.0), None, ""),  # of nothing, no ppm
        (None, pytest.approx(36.0), 9.0, "M1"),
    ]
    assert table.title.startswith("uncertainty of bias: u 5.0 V, U95 ")
    assert "tilt" in table.title
    assert budget_table("exact", measurand(1.0, "V", [UncertaintyPart("none", 0.0)])).rows[0][1:4] == (0.0, 0.0, None)
    (row,) = quantity_table({"bias": found}).rows
    assert (row[0], row[4], row[5]) == ("bias", "V", "readings 4, meter 3")
