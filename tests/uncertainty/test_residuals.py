"""What can move the largest residual of a line, against errors drawn with NumPy."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from msgspec import structs
from scipy.special import ndtr
from simrack_tests.cells import few

from tests.procedures.test_uncertainty import GENERATOR, K_VC, NOISE, RATES, READINGS, four_steps, settings
from vcfbench.analysis.nonlinearity import nonlinearity_ppm
from vcfbench.analysis.regression import fit_line
from vcfbench.procedures.turntable import turntable_statement
from vcfbench.procedures.virtual_coriolis.budget import four_step_statement
from vcfbench.procedures.virtual_coriolis.matching import Matching
from vcfbench.records.schema import Point
from vcfbench.station.settings import Match, Sources
from vcfbench.uncertainty.line import Line
from vcfbench.uncertainty.nonlinearity import CurvedLine, ResidualSpread, u95_beyond
from vcfbench.uncertainty.windows import window_times

if TYPE_CHECKING:
    from vcfbench.uncertainty.statement import StatedValue

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


def test_value_follows_definition_and_u_its_scatter() -> None:
    true = curved(5e-3, 1e-3)
    stated = turntable_statement(settings(Sources()), points_of(true)).value("nonlinearity")
    assert stated.value == pytest.approx(nonlinearity_ppm(RATES, true, fit_line(RATES, true))["max_span"], rel=1e-9)
    assert (stated.unit, stated.coverage_factor) == ("ppm", pytest.approx(1.976, abs=1e-3))
    drawn = true + U_V * np.random.default_rng(1).standard_normal((1000, true.size))
    assert stated.u == pytest.approx(largest_ppm(drawn).std(), rel=0.08)


def test_gain_offset_and_rate_of_the_table_cancel() -> None:
    known = Sources(meter_gain=1e-3, meter_offset_v=1e-3, table_rate=1e-2)
    silent, stated = (turntable_statement(settings(each), points_of(curved(5e-3, 1e-3))) for each in (Sources(), known))
    assert stated.value("nonlinearity").u == pytest.approx(silent.value("nonlinearity").u, rel=1e-9)


def test_derivatives_of_the_residuals_are_those_of_differences() -> None:
    true, step = curved(5e-3, 4e-3), 1e-6
    of_outputs = CurvedLine.of("it", line_of(RATES, true))
    for place in (0, 5, 16):
        moved = true.copy()
        moved[place] += step
        found = (CurvedLine.of("it", line_of(RATES, moved)).ppm - of_outputs.ppm) / step
        assert found == pytest.approx(of_outputs.of_outputs[:, place], rel=1e-4, abs=1.0)


def test_largest_of_equal_residuals_is_biased_high() -> None:
    """Odd curvature: +100 and -100 deg/s."""
    true = curved(0.0, 3e-3)
    drawn = true + U_V * np.random.default_rng(2).standard_normal((1000, true.size))
    errors = largest_ppm(drawn) - largest_ppm(true)
    stated = turntable_statement(settings(Sources()), points_of(true)).value("nonlinearity")
    assert "at one of +100, -100 deg/s" in stated.of
    assert 0.2 < errors.mean() / stated.u < 0.8
    whole = turntable_statement(settings(Sources()), points_of(true))
    assert np.shape(whole.correlation) == (len(whole.values), len(whole.values))


def test_value_below_its_u95_is_bound() -> None:
    rng = np.random.default_rng(3)
    outputs = curved(0.0, 0.0) + 0.3 * U_V * rng.standard_normal(len(RATES))
    stated = turntable_statement(settings(Sources()), points_of(outputs))
    with pytest.raises(KeyError):
        stated.value("nonlinearity")
    assert [(each.name, each.form, each.u95) for each in stated.bounds] == [("nonlinearity", "below", None)]
    assert [each.name for each in stated.values] == ["scale_factor", "bias", "bias_deg_s", "asymmetry"]
    assert len(stated.correlation) == 4


@pytest.mark.exhaustive
def test_asymmetry_has_u_of_its_outputs() -> None:
    """Its u by readings alone is the scatter of 4000 draws through the definition itself."""
    true = curved(5e-3, 1e-3)
    stated = turntable_statement(settings(Sources()), points_of(true)).value("asymmetry")

    def asym(outputs: np.ndarray) -> float:
        found = nonlinearity_ppm(RATES, outputs, fit_line(RATES, outputs))["asym"]
        assert found is not None
        return found

    assert stated.value == pytest.approx(asym(true), rel=1e-9)
    assert abs(stated.value) > 10.0 * stated.u
    drawn = true + U_V * np.random.default_rng(11).standard_normal((4000, true.size))
    assert stated.u == pytest.approx(np.std([asym(each) for each in drawn]), rel=0.04)  # 3.6 of its own u


def test_asymmetry_has_the_warm_up_of_the_run() -> None:
    known = Sources(scale_factor_ppm_k=50.0, bias_deg_h_k=0.0, warm_up_k=10.0, warm_up_time_s=300.0)
    asked, rate = settings(known), np.array(RATES)
    window_s = asked.samples * asked.sample_interval_s + asked.settle_s
    ramp_s = np.abs(np.diff(rate, prepend=rate[0])) / asked.acceleration_deg_s2
    away_k = 10.0 * np.exp(-(asked.start_up_s + np.cumsum(window_s + ramp_s)) / 300.0)
    cold = K * rate * (1.0 + 50e-6 * away_k)
    shown = nonlinearity_ppm(rate, cold, fit_line(rate, cold))["asym"]
    stated = turntable_statement(asked, points_of(cold)).value("asymmetry")
    (warm_up,) = (each for each in stated.parts if each.source == "warm-up")
    assert shown is not None
    assert warm_up.u == pytest.approx(abs(shown), rel=1e-3)


def test_asymmetry_needs_two_rates_on_either_side() -> None:
    one_sided = [each for each in points_of(curved(0.0, 0.0)) if each.rate_deg_s >= 0.0]
    stated = turntable_statement(settings(Sources()), one_sided)
    assert "asymmetry" not in [each.name for each in stated.values]


def test_two_points_have_no_non_linearity() -> None:
    ends = [each for each in points_of(curved(0.0, 0.0)) if abs(each.rate_deg_s) == 200.0]
    stated = turntable_statement(settings(Sources()), ends)
    assert [each.name for each in stated.values] == ["scale_factor", "bias", "bias_deg_s"]
    assert stated.bounds == ()


def spread(found: list[float], normal: np.ndarray, common: np.ndarray | None = None) -> ResidualSpread:
    size = len(found)
    through = np.zeros((0, size)) if common is None else common
    flat = np.ones(len(through), dtype=bool)
    return ResidualSpread(np.array(found), np.zeros((size, size)), 100.0, normal, through, flat)


def test_only_what_lies_near_the_largest_may_be_it() -> None:
    found, opposite = [-100.0, 90.0, 10.0], np.outer([1.0, -1.0, 0.0], [1.0, -1.0, 0.0])
    assert spread(found, 9.0 * np.eye(3)).near_largest().tolist() == [0, 1]
    assert spread(found, 100.0 * opposite).near_largest().tolist() == [0]  # both grow alike


def test_common_source_moves_the_largest_residual_by_its_share() -> None:
    """One limit of a rectangular distribution: u is half width over root three, U95 95 % of the half width."""
    half = np.array([[30.0, -20.0, 10.0]]) / np.sqrt(3.0)
    moved = spread([200.0, 0.0, 0.0], np.zeros((3, 3)), half).largest()
    assert moved.u == pytest.approx(30.0 / np.sqrt(3.0), rel=0.03)
    assert moved.u95 == pytest.approx(0.95 * 30.0, rel=0.02)
    assert moved.by_errors == pytest.approx(0.95 * 30.0, rel=0.02)


def test_signs_of_eigenvectors_change_no_uncertainty(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found, covariance = [200.0, -190.0, 180.0], np.array([[90.0, 20.0, -10.0], [20.0, 80.0, 5.0], [-10.0, 5.0, 70.0]])
    here, eigh = spread(found, covariance).largest(), np.linalg.eigh
    monkeypatch.setattr(np.linalg, "eigh", lambda of: (eigh(of)[0], eigh(of)[1] * np.array([1.0, -1.0, 1.0])))
    there = spread(found, covariance).largest()
    assert structs.astuple(there) == pytest.approx(structs.astuple(here), rel=1e-12)


def test_windows_at_one_rate_share_residual_of_mean() -> None:
    true = curved(5e-3, 1e-3)
    off = np.full(true.size, 2e-4)
    twice = points_of(np.round(true + off, 12)) + points_of(np.round(true - off, 12))
    once, again = (turntable_statement(settings(Sources()), each) for each in (points_of(true), twice))
    assert again.value("nonlinearity").value == pytest.approx(once.value("nonlinearity").value, rel=1e-6)
    assert again.value("nonlinearity").u == pytest.approx(once.value("nonlinearity").u / np.sqrt(2.0), rel=1e-6)


def driven(level_v: np.ndarray, cubic: float = 0.03) -> np.ndarray:
    """Return the output of a modulator with a third order, V."""
    return np.asarray(K * K_VC * (level_v + 4e-3 * level_v**2 + cubic * level_v**3))


def four_steps_of(outputs: np.ndarray, std_v: float = 0.0) -> list[Point]:
    points = [point for point in four_steps(std_v) if point.step != 4]
    made = zip(RATES, outputs.tolist(), strict=True)
    return points + [Point(4, rate, rate / K_VC, out, std_v, READINGS) for rate, out in made]


def of_virtual_line(sources: Sources, outputs: np.ndarray, v_vc_std_v: float | None = None) -> StatedValue:
    points = four_steps_of(outputs)
    if v_vc_std_v is not None:
        points = [structs.replace(p, v_vc_measured_v=p.v_vc_v, v_vc_std_v=v_vc_std_v) for p in points]
    stated = four_step_statement(settings(sources), points, Matching.of(points, Match.ZERO, 10.0))
    return stated.value("virtual.nonlinearity")


def test_virtual_non_linearity_scatters_as_stated_for_drawn_generators() -> None:
    """Range jumps of 0.3 % make another residual the largest: NumPy's scatter of 4000 sets of ranges."""
    rng, level = np.random.default_rng(5), np.array(RATES) / K_VC
    own = np.searchsorted([0.32, 1.0, 3.2], np.abs(level))
    gain, share = rng.uniform(-3e-3, 3e-3, (4000, 4)), rng.uniform(-1.0, 1.0, (4000, 4))
    offset = share * (6e-4 + (3e-3 - np.abs(gain)) * np.array([0.0, 0.32, 1.0, 3.2]))
    drawn = largest_ppm(driven(level * (1.0 + gain[:, own]) + offset[:, own]))
    better = structs.replace(GENERATOR, generator_gain=3e-3, generator_offset_v=6e-4)
    stated = of_virtual_line(better, driven(level))
    assert stated.value == pytest.approx(largest_ppm(driven(level)), rel=1e-9)
    assert "u by trials" in stated.of
    assert stated.coverage_factor == pytest.approx(stated.u95 / stated.u)
    assert stated.u == pytest.approx(np.sqrt(np.mean((drawn - stated.value) ** 2)), rel=0.06)
    assert 0.93 < np.mean(np.abs(drawn - stated.value) <= stated.u95) < 0.97


MODULATOR_PPM = [
    *(-10442, 2551, 3193, 2373, 1955, 1724, 1579, 1530, 1480),
    *(1430, 1379, 1225, 958, 398, -1417, -4332, -5585),
]
"""Residuals of the modulator of the bench `paper` at K_Vc times 200 to -200 deg/s, at levels as they are told."""


def of_generators() -> ResidualSpread:
    """Return these residuals, and what 2 % and 4 mV of each range of a generator put into them."""
    level = np.array(RATES) / K_VC
    own = np.searchsorted([0.32, 1.0, 3.2], np.abs(level))
    span = np.ptp(RATES)
    residuals = CurvedLine.of("it", line_of(RATES, K * (np.array(RATES) - 1e-6 * span * np.array(MODULATOR_PPM))))
    through = residuals.of_outputs * K * K_VC
    moved = [
        (through * effect)[:, own == place].sum(axis=1)
        for effect in (0.02 * level, np.full(level.size, 4e-3))
        for place in range(3)
    ]
    return spread(residuals.ppm.tolist(), np.zeros((level.size, level.size)), np.array(moved) / np.sqrt(3.0))


def held(true: ResidualSpread, count: int) -> tuple[float, float]:
    """Return how often U95 of what is found holds the truth, and the standard deviation of the error over its u.

    Where errors alone may make as much there is a bound, which must hold it each time.
    """
    rng, size = np.random.default_rng(8), float(np.abs(true.residuals).max())
    z, within = [], []
    for _ in range(count):
        moved = rng.uniform(-1.0, 1.0, len(true.common)) * np.sqrt(3.0) @ true.common
        moved += rng.multivariate_normal(np.zeros(true.residuals.size), true.normal, method="eigh")
        found = structs.replace(true, residuals=true.residuals + moved)
        value, stated = float(np.abs(found.residuals).max()), found.largest()
        if value <= stated.by_errors:
            assert size <= value + stated.by_errors
            continue
        off = value - size
        z.append(off / stated.u)
        within.append(abs(off) <= stated.u95)
    return float(np.mean(within)), float(np.std(z))


@pytest.mark.exhaustive
def test_u95_covers_truth_for_drawn_generator_ranges() -> None:
    """A share of 2000 scatters by 0.005, their standard deviation by 0.016. Others may become the largest: u has it."""
    share, sd = held(of_generators(), 2000)
    assert 0.93 <= share <= 0.985
    assert 0.85 <= sd <= 1.07


@pytest.mark.parametrize(
    ("apart", "least", "most"), few([(0.0, 0.90, 0.95), (1.0, 0.93, 0.97), (3.0, 0.92, 0.97)], (1.0, 0.93, 0.97))
)
def test_nonlinearity_has_u95_if_two_residuals_are_equal(apart: float, least: float, most: float) -> None:
    """`apart` are standard deviations of either: two that are just equal are held a little less often."""
    share, _ = held(spread([-100.0, 100.0 - apart], np.eye(2)), 300)
    assert least <= share <= most


def test_u95_does_not_jump_where_two_residuals_become_equal() -> None:
    apart = np.linspace(0.0, 5.0, 51)
    u95 = [spread([-100.0, 100.0 - each], np.eye(2)).largest().u95 for each in apart.tolist()]
    assert float(np.abs(np.diff(u95)).max()) < 0.06
    assert u95[-1] == pytest.approx(1.96, abs=0.06)  # one alone


@pytest.mark.exhaustive
def test_v_vc_meter_scatter_enters_non_linearity() -> None:
    rng, level = np.random.default_rng(6), np.array(RATES) / K_VC
    stated = of_virtual_line(Sources(), driven(level), 3e-5)
    seen = level + 3e-5 / np.sqrt(READINGS) * rng.standard_normal((2000, level.size))
    off = [largest_ppm(driven(level), K_VC * v) - largest_ppm(driven(v), K_VC * v) for v in seen]
    assert stated.u == pytest.approx(float(np.std(off)), rel=0.06)


def test_non_linearity_is_at_stated_levels() -> None:
    """Levels that are larger by a part in ten thousand are on more of the curve."""
    level, g = np.array(RATES) / K_VC, 1e-4
    stated = of_virtual_line(Sources(v_vc_gain=g, v_vc_sigmas=1.0), driven(level), 1e-9)
    more = float(largest_ppm(driven(level * (1.0 + g)), K_VC * level) - largest_ppm(driven(level)))
    assert stated.u == pytest.approx(abs(more), rel=0.02)


def test_a_straight_modulator_has_a_bound_and_no_value() -> None:
    points = four_steps_of(driven(np.array(RATES) / K_VC, 0.0), NOISE)
    stated = four_step_statement(settings(GENERATOR), points, Matching.of(points, Match.ZERO, 10.0))
    assert "virtual.nonlinearity" not in [each.name for each in stated.values]
    (bound,) = (each for each in stated.bounds if each.name == "virtual.nonlinearity")
    assert bound.kind == "nonlinearity_by_v_vc"
    assert "within the errors of the measurement" in bound.of


@pytest.mark.parametrize("told", few(["its time", "nothing of its time"], every=3))
@pytest.mark.parametrize("signs", [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0)])
def test_warm_up_enters_non_linearity(told: str, signs: tuple[float, float]) -> None:
    """Coefficients, warm-up and its time are drawn; the bench file tells their sizes, not their signs."""
    for seed in range(8):
        rng = np.random.default_rng(seed)
        ppm_k, deg_h_k, warm_up_k, time_s = (10.0 ** rng.uniform(*ends) for ends in ((1, 3), (1, 3), (-1, 0.7), (1, 3)))
        known = Sources(
            scale_factor_ppm_k=ppm_k,
            bias_deg_h_k=deg_h_k,
            warm_up_k=warm_up_k,
            warm_up_time_s=time_s,
            assumed={} if told == "its time" else {"warm_up_time_s": "assumed"},
        )
        asked, true = settings(known), curved(5e-3, 1e-3)
        begin_s, end_s = window_times(asked, points_of(true))
        away_k = warm_up_k * np.exp(-(asked.start_up_s + 0.5 * (begin_s + end_s) - begin_s[0]) / time_s)
        by_rate = signs[0] * 1e-6 * ppm_k * np.array(RATES) + signs[1] * deg_h_k / 3600.0
        stated = turntable_statement(asked, points_of(true + K * by_rate * away_k))
        found = next(each for each in stated.stated() if each.name == "nonlinearity")
        cold_ppm, warm_ppm = (float(largest_ppm(each)) for each in (true + K * by_rate * away_k, true))
        if found.form == "plus-minus":
            assert abs(cold_ppm - warm_ppm) <= 1.1 * (found.u95 or 0.0), (seed, known)
        else:
            assert warm_ppm <= 1.1 * (found.high or 0.0), (seed, known)


def of_drawn_runs(rates: list[float], odd: int, size: float, runs: int) -> tuple[float, float]:
    """Return how often value or bound of drawn runs hold the truth, and how often stated values alone do.

    The non-linearity is of the 2nd or 3rd order and `size` times the scatter of a mean of three readings.
    """
    rng, rate = np.random.default_rng(len(rates) + odd), np.array(rates)
    order = (rate / np.abs(rate).max()) ** (3 if odd else 2)
    u_ppm = 1e6 * NOISE / np.sqrt(3.0) / (abs(K) * np.ptp(rate))
    true = K * rate + order * 1e-4 * size * u_ppm / largest_ppm(K * rate + 1e-4 * order, rate)
    largest, within, among = float(largest_ppm(true, rate)), [], []
    for _ in range(runs):
        read = true[:, None] + NOISE * rng.standard_normal((rate.size, 3))
        seen = zip(rates, read.mean(axis=1).tolist(), read.std(axis=1, ddof=1).tolist(), strict=True)
        stated = turntable_statement(settings(Sources()), [Point(1, at, 0.0, *each, 3) for at, *each in seen])
        value = next((each for each in stated.values if each.name == "nonlinearity"), None)
        if value is not None:
            among.append(abs(value.value - largest) <= value.u95)
            within.append(among[-1])
        else:
            within.append(largest <= next(each.high for each in stated.bounds))
    return float(np.mean(within)), float(np.mean(among or [True]))


FIVE, SEVEN = [100.0, 10.0, 0.0, -10.0, -100.0], [200.0, 100.0, 20.0, 0.0, -20.0, -100.0, -200.0]


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("rates", "odd", "size"),
    few(
        [(rates, odd, size) for rates in (FIVE, SEVEN, RATES) for odd in (0, 1) for size in (1, 2, 4, 10)], (FIVE, 0, 2)
    ),
)
def test_values_and_bounds_of_noisy_lines_hold_the_truth(rates: list[float], odd: int, size: float) -> None:
    """A share of 300 scatters by 0.013. A small one is stated by chance, in a run of twenty at most."""
    share, of_values = of_drawn_runs(rates, odd, size, 300)
    assert share >= 0.91
    assert size < 4 or of_values >= 0.9


def test_values_just_beyond_a_limit_have_wide_intervals() -> None:
    """Q(a) = 0.025 Q(a - d), with SciPy's Q."""
    for beyond in (0.5, 1.0, 2.0, 4.0, 30.0):
        a = u95_beyond(10.0, 10.0 + beyond, 1.959964)
        assert ndtr(-a) == pytest.approx(0.025 * ndtr(beyond - a), rel=1e-5)
    assert u95_beyond(10.0, 10.01, 1.96) == u95_beyond(10.0, 9.0, 1.96) == np.inf
