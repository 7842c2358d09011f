"""The report of a procedure that has none of its own."""

from __future__ import annotations

from dataclasses import dataclass

from vcfbench.records.schema import Point
from vcfbench.reports.document import Cell, Report
from vcfbench.reports.generic import generic_report, points_table, results_table, verdict_table
from vcfbench.reports.text import table_text, text_of
from vcfbench.station.acceptance import Acceptance, Verdict, judged
from vcfbench.station.settings import Limit
from vcfbench.values.value import Value

POINTS = (Point(1, 10.0, 0.0, -0.125, 1e-4, 10),)


@dataclass(frozen=True, slots=True)
class Branch:
    direction: str
    outputs_v: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Hysteresis:
    width: Value
    closed: bool
    loops: int
    branches: tuple[Branch, ...]
    note: str | None = None


RESULTS = Hysteresis(
    Value("width", 0.123456789, "deg/s", 0.001234),
    closed=True,
    loops=3,
    branches=(Branch("up", (0.5, 0.25)), Branch("down", tuple(range(10)))),
)


def test_points_and_every_field_are_shown_by_their_names() -> None:
    text = text_of(generic_report(None, POINTS, RESULTS))
    points, results = text.split("\n\n")
    assert points == table_text(points_table(POINTS))
    assert results.splitlines() == [
        "result                  value                         u        unit",
        "-------------------------------------------------------------------",
        "width                   0.123457                      0.0012   deg/s",
        "closed                  yes",
        "loops                   3",
        "branches[0].direction   up",
        "branches[0].outputs_v   0.5, 0.25",
        "branches[1].direction   down",
        "branches[1].outputs_v   0, 1, 2, 3, ... (10 in all)",
        "note                    -",
    ]


def test_what_has_no_quantities_has_no_columns_for_them() -> None:
    (table,) = results_table({"samples": 3, "rails": [{"voltage_v": 10.0}]}, "settings", "setting")
    assert table_text(table).splitlines() == [
        "settings",
        "setting              value",
        "--------------------------",
        "samples              3",
        "rails[0].voltage_v   10",
    ]


def test_what_was_measured_of_v_vc_stands_beside_its_setting() -> None:
    points = (*POINTS, Point(1, 0.0, 0.5, -0.25, 1e-4, 10, 0.501234, 2e-6))
    assert table_text(points_table(points)).splitlines() == [
        "step   rate / (deg/s)   V_Vc / V   output / V     s / V    n   V_Vc measured / V   its s / V",
        "--------------------------------------------------------------------------------------------",
        "   1               10          0     -0.12500   1.0e-04   10                   -           -",
        "   1                0        0.5     -0.25000   1.0e-04   10            0.501234     2.0e-06",
    ]


def test_numbers_keep_all_their_digits_in_the_document() -> None:
    (table,) = results_table(RESULTS)
    assert table.rows[0] == ("width", Cell(0.123456789, ".6g"), Cell(0.001234, ".2g"), "deg/s")


def test_lookalike_of_quantity_is_shown_by_names() -> None:
    (table,) = results_table({"a": {"value": [1, 2], "unit": "V"}, "b": {"value": 1.0, "u": None}, "c": {"value": 2}})
    assert [row[0] for row in table.rows] == ["a.value", "a.unit", "b.value", "b.u", "c"]


def test_run_without_points_or_results_has_no_tables() -> None:
    assert generic_report(None, (), {}) == Report()
    assert results_table(None) == ()
    assert len(generic_report(None, (), RESULTS).parts) == 1


def test_results_of_one_number_have_no_name_of_their_own() -> None:
    for results, name in ((0.5, "result"), (RESULTS.width, "result"), ((RESULTS.width,), "result[0]")):
        (table,) = results_table(results)
        assert table.rows[0][0] == name


def test_a_verdict_has_every_limit_with_its_value() -> None:
    found = Value("bias", 0.2512, "V", u95=0.012)
    limits = (
        Verdict.of(Limit("bias_v", 0.0, 0.26, guarded=True), found),
        Verdict.of(Limit("bias_deg_s", 0.0, 1.0), None),
    )
    assert table_text(verdict_table(Acceptance(limits))).splitlines() == [
        "FAIL",
        "value judged    value   U95   low   high   unit                        verdict   rule",
        "-------------------------------------------------------------------------------------",
        "bias (output)     251    12     0    260   mV      MARGINAL (conditional pass)   guarded, w = U95",
        "bias                -     -     0      1   deg/s                          FAIL   not found",
    ]
    assert verdict_table(Acceptance(limits[:1])).title == "MARGINAL"


def test_a_verdict_names_the_value_that_was_judged_and_what_a_bound_leaves_of_it() -> None:
    slope = Value("scale_factor", -0.0125, "V/(deg/s)", 1e-5, kind="scale_factor_small")
    bend = Value("nonlinearity", 812.4, "ppm", form="below", high=2613.0, kind="nonlinearity_by_v_vc")
    limits = [
        Limit("scale_factor_v_per_deg_s", -0.013, -0.012),
        Limit("nonlinearity_ppm", 0.0, 800.0, guarded=True),
        Limit("e_n", 0.0, 1.0),
    ]
    acceptance = judged(limits, (slope, bend, Value("e_n", 0.0043987, kind="e_n")), ())
    assert acceptance is not None
    rows = [row[:3] for row in verdict_table(acceptance).printed()]
    assert rows == [
        ("scale factor of small signals", "-12.500(10)", "0.020"),
        ("non-linearity, of the span, by V_Vc", "below 2600 (found: 812.4)", "-"),
        ("E_n", "0.00", "-"),
    ]
