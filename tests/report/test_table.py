from __future__ import annotations

from tests.procedures.fakes import FakeBench, MemoryJournal, make_settings
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.executor import Executor
from vcfbench.record.schema import Point
from vcfbench.report.table import columns, summary

VIRTUAL = """\
Omega_z / (deg/s)   turntable / V   virtual Coriolis / V   V_Vc / V
-------------------------------------------------------------------
              200        -2.54200               -2.49030    5.00000
              100        -1.29200               -1.24030    2.50000
               50        -0.66700               -0.61530    1.25000
               20        -0.29200               -0.24030    0.50000
               10        -0.16700               -0.11530    0.25000
                5        -0.10450               -0.05280    0.12500
                2        -0.06700               -0.01530    0.05000
                1        -0.05450               -0.00280    0.02500
                0        -0.04200                0.00970    0.00000
               -1        -0.02950                0.02220   -0.02500
               -2        -0.01700                0.03470   -0.05000
               -5         0.02050                0.07220   -0.12500
              -10         0.08300                0.13470   -0.25000
              -20         0.20800                0.25970   -0.50000
              -50         0.58300                0.63470   -1.25000
             -100         1.20800                1.25970   -2.50000
             -200         2.45800                2.50970   -5.00000

K_Vc = 40 (deg/s)/V,"""


def told(name: str) -> str:
    settings = make_settings(k_vc_guess=40.0)
    procedure = PROCEDURES[name]
    execution = Executor(FakeBench(), MemoryJournal()).execute(procedure.plan(settings))
    return summary(name, execution.points, procedure.results(settings, execution.points))


def test_virtual_coriolis_ends_with_table_1() -> None:
    text = told("virtual-coriolis")
    assert text.startswith(VIRTUAL)
    assert "turntable: V = -0.01250000 Omega_z -0.042000" in text
    assert "virtual Coriolis: V = -0.01250000 Omega_z +0.009700" in text
    assert "scale factor error" in text


def test_turntable_ends_with_one_column_and_its_fit() -> None:
    lines = told("turntable").splitlines()
    assert lines[0] == "Omega_z / (deg/s)   output / V     s / V"
    assert lines[2].split()[:2] == ["200", "-2.54200"]
    assert len(lines) == 2 + 17 + 1 + 3


def test_a_run_without_results_shows_the_points_it_kept() -> None:
    text = summary("virtual-coriolis", [Point(1, 0.0, 0.0, -0.042, 1e-5, 10)], {})
    assert text.splitlines()[-1].split() == ["1", "0", "0", "-0.04200", "1.0e-05", "10"]


def test_columns_are_as_wide_as_their_widest_cell() -> None:
    assert columns(("a", "bb"), [("1", "2"), ("333", "4")]) == "  a   bb\n--------\n  1    2\n333    4"


def test_columns_of_texts_are_aligned_to_the_left_and_end_with_their_text() -> None:
    assert columns(("a", "bb"), [("333", "4")], str.ljust) == "a     bb\n--------\n333   4"


def test_a_procedure_of_ones_own_has_its_points_and_results_by_name() -> None:
    points = (Point(1, 10.0, 0.0, -0.125, 1e-4, 10),)
    text = summary("hysteresis", points, {"width": {"value": 0.5, "unit": "deg/s"}, "loops": 3})
    assert "-0.12500" in text
    assert text.endswith("width.value = 0.5\nwidth.unit = deg/s\nloops = 3")
