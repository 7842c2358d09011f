"""What can move the largest residual of a line, against errors drawn with NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from tests.procedures.test_uncertainty import NOISE, RATES, READINGS, settings
from vcfbench.analysis.nonlinearity import nonlinearity_ppm
from vcfbench.analysis.regression import fit_line
from vcfbench.bench.settings import Sources
from vcfbench.procedures.uncertainty import Line, turntable_statement
from vcfbench.procedures.worst_residual import Residuals, Spread
from vcfbench.record.schema import Point

K = -0.0125
U_V = NOISE / np.sqrt(READINGS)


def line_of(rates: list[float], outputs: np.ndarray) -> Line:
    rate = np.array(rates)
    slope, bias = np.polyfit(rate, outputs, 1)
    return Line(rate, outputs, float(slope), float(bias), np.full(rate.size, slope), np.eye(rate.size))


def curved(even: float, odd: float) -> np.ndarray:
    share = np.array(RATES) / 200.0
    return np.asarray(K * np.array(RATES) - 0.042 + even * share**2 + odd * share**3)


def points_of(outputs: np.ndarray) -> list[Point]:
    return [Point(1, rate, 0.0, out, NOISE, READINGS) for rate, out in zip(RATES, outputs.tolist(), strict=True)]


def largest_ppm(outputs: np.ndarray, rates: np.ndarray | None = None) -> np.ndarray:
    """Return max_span of each row, ppm; the definition itself takes one at a time."""
    rate = np.array(RATES) if rates is None else rates
    design = np.stack([rate, np.ones_like(rate)], axis=1)
    found = outputs @ np.linalg.pinv(design).T
    return np.asarray(1e6 * np.abs(outputs - found @ design.T).max(axis=-1) / np.abs(found[..., 0] * np.ptp(rate)))


def test_the_value_is_the_definition_s_and_its_u_is_the_scatter_of_it() -> None:
    true = curved(5e-3, 1e-3)
    stated = turntable_statement(settings(Sources()), points_of(true)).value("nonlinearity")
    assert stated.value == pytest.approx(nonlinearity_ppm(RATES, true, fit_line(RATES, true))["max_span"], rel=1e-9)
    assert (stated.unit, stated.coverage_factor) == ("ppm", pytest.approx(1.976, abs=1e-3))
    drawn = true + U_V * np.random.default_rng(1).standard_normal((1000, true.size))
    assert stated.u == pytest.approx(largest_ppm(drawn).std(), rel=0.08)


def test_gain_offset_and_rate_of_the_table_cancel() -> None:
    known = Sources(meter_gain=1e-3, meter_offset_v=1e-3, table_rate=1e-2)
    silent, told = (turntable_statement(settings(each), points_of(curved(5e-3, 1e-3))) for each in (Sources(), known))
    assert told.value("nonlinearity").u == pytest.approx(silent.value("nonlinearity").u, rel=1e-9)


def test_derivatives_of_the_residuals_are_those_of_differences() -> None:
    true, step = curved(5e-3, 4e-3), 1e-6
    of_outputs = Residuals.of(line_of(RATES, true))
    for place in (0, 5, 16):
        moved = true.copy()
        moved[place] += step
        found = (Residuals.of(line_of(RATES, moved)).ppm - of_outputs.ppm) / step
        assert found == pytest.approx(of_outputs.of_outputs[:, place], rel=1e-4, abs=1.0)


def test_where_two_residuals_are_equal_u95_still_holds_the_largest() -> None:
    """Odd curvature: +100 and -100 deg/s. The largest that is found lies too high by half its u, U95 holds it."""
    true = curved(0.0, 3e-3)
    drawn = true + U_V * np.random.default_rng(2).standard_normal((1000, true.size))
    errors = largest_ppm(drawn) - largest_ppm(true)
    stated = turntable_statement(settings(Sources()), points_of(true)).value("nonlinearity")
    assert "at one of +100, -100 deg/s" in stated.of
    assert 2.0 < stated.coverage_factor < 2.5
    assert 0.2 < errors.mean() / stated.u < 0.8
    assert np.mean(np.abs(errors) <= stated.u95) > 0.94


def test_what_does_not_stand_above_its_u95_is_no_value_but_a_bound() -> None:
    rng = np.random.default_rng(3)
    outputs = curved(0.0, 0.0) + 0.3 * U_V * rng.standard_normal(len(RATES))
    stated = turntable_statement(settings(Sources()), points_of(outputs))
    with pytest.raises(KeyError):
        stated.value("nonlinearity")
    assert any(each.startswith("nonlinearity: ") and "below" in each for each in stated.not_in_u)
    assert len(stated.correlation) == len(stated.values) == 3


def test_two_points_have_no_non_linearity() -> None:
    ends = [each for each in points_of(curved(0.0, 0.0)) if abs(each.rate_deg_s) == 200.0]
    stated = turntable_statement(settings(Sources()), ends)
    assert [each.name for each in stated.values] == ["scale_factor", "bias", "bias_deg_s"]
    assert not any("nonlinearity" in each for each in stated.not_in_u)


def test_only_what_lies_near_the_largest_may_be_it() -> None:
    found, none = np.array([-100.0, 90.0, 10.0]), np.zeros((3, 3))
    assert Spread(found, 9.0 * np.eye(3), none, 100.0).may_be_largest().tolist() == [0, 1]
    opposite = np.outer([1.0, -1.0, 0.0], [1.0, -1.0, 0.0])
    assert Spread(found, none, 100.0 * opposite, 100.0).may_be_largest().tolist() == [0]  # both grow alike
    assert Spread(found, none, np.eye(3), 100.0).u95(np.array([0])) == pytest.approx(1.96, rel=0.04)
