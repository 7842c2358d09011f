"""What the calibrations report: the text that they always had, and the paper's figures as data."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from tests.procedures.fakes import FakeBench, MemoryJournal, make_settings
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.reports.document import Figure
from vcfbench.reports.text import text_of
from vcfbench.steps.executor import Executor
from vcfbench.steps.measured import Measured

if TYPE_CHECKING:
    from vcfbench.reports.document import Report

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

K_Vc = 40.000 00(90) (deg/s)/V, U95 0.0018,"""


def reported(name: str) -> Report:
    settings = make_settings(k_vc_guess_deg_s_per_v=40.0)
    procedure = PROCEDURES[name]
    points = Measured(Executor(FakeBench(), MemoryJournal()).execute(procedure.plan(settings)).points)
    return procedure.report(settings, points, procedure.results(settings, points))


def figures(name: str) -> list[Figure]:
    return [part for part in reported(name).parts if isinstance(part, Figure)]


def test_virtual_coriolis_ends_with_table_1() -> None:
    text = text_of(reported("virtual-coriolis"))
    assert text.startswith(VIRTUAL)
    assert "turntable: V = -0.01250000 Omega_z -0.042000" in text
    assert "virtual Coriolis: V = -0.01250000 Omega_z +0.009700" in text
    assert "scale factor error" in text


def test_turntable_ends_with_one_column_and_its_fit() -> None:
    lines = text_of(reported("turntable")).splitlines()
    assert lines[0] == "Omega_z / (deg/s)   output / V     s / V"
    assert lines[2].split()[:2] == ["200", "-2.54200"]
    assert lines[20].startswith("turntable: V = ")
    stated = next(
        n for n, line in enumerate(lines) if line.startswith("Values with their combined uncertainty (95 %); INC")
    )
    names = [line.split("   ")[0] for line in lines[stated + 3 :] if line and not line.startswith(" ")]
    assert names[:3] == ["scale factor", "bias (output)", "bias"]
    assert "Uncertainty budget (causes below 0.1 % are left out)" in lines
    assert lines[lines.index("not contained in any uncertainty:") + 1].startswith("  MISSING the multimeter's accuracy")


def test_turntable_figures_show_output_and_residuals_over_rate() -> None:
    outputs, residuals = figures("turntable")
    assert (outputs.x.title, outputs.y.title) == ("Omega_z / (deg/s)", "output / V")
    measured, line = outputs.series
    assert (measured.kind, line.kind, len(measured.x)) == ("points", "line", 17)
    assert measured.y[0] == pytest.approx(-2.542)
    assert measured.u_y is not None
    assert measured.u_y[0] == pytest.approx(10e-6 / 12**0.5)
    assert line.x == (-200.0, 200.0)
    assert line.y == pytest.approx((2.458, -2.542))
    assert residuals.y.title == "residual of the span / ppm"


def test_the_largest_residual_is_the_non_linearity() -> None:
    settings = make_settings()
    procedure = PROCEDURES["turntable"]
    points = list(Executor(FakeBench(), MemoryJournal()).execute(procedure.plan(settings)).points)
    points[0] = type(points[0])(1, 200.0, 0.0, points[0].output_v + 0.01, 0.0, 10)
    measured = Measured(points)
    results = procedure.results(settings, measured)
    drawn = [part for part in procedure.report(settings, measured, results).parts if isinstance(part, Figure)]
    assert max(map(abs, drawn[1].series[0].y)) == pytest.approx(results.nonlinearity_ppm.max_span)


def test_virtual_coriolis_has_both_columns_and_their_difference() -> None:
    outputs, residuals, difference = figures("virtual-coriolis")
    assert [each.label for each in outputs.series] == [
        *("turntable", "turntable, least-squares line"),
        *("virtual Coriolis", "virtual Coriolis, least-squares line"),
    ]
    assert [len(each.x) for each in residuals.series] == [17, 17]
    assert difference.y.title == "difference of the outputs / mV"
    assert difference.series[0].y == pytest.approx([51.7] * 17)
    u_mv = [
        1e3 * math.hypot(left.u_y[0], right.u_y[0]) for left, right in [outputs.series[::2]] if left.u_y and right.u_y
    ]
    assert difference.series[0].u_y == pytest.approx(u_mv * 17)
