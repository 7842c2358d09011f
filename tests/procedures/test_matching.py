from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.procedures.fakes import make_settings
from vcfbench.errors import MeasurementError
from vcfbench.procedures.virtual_coriolis.matching import Matching
from vcfbench.records.schema import Point
from vcfbench.station.settings import Match

K, K_VC = -0.0125, 40.0


def output(v_vc: float, *, k_vc: float = K_VC, curvature: float = 0.0, zero: float = 0.0097) -> float:
    return zero + K * k_vc * v_vc * (1.0 + curvature * v_vc)


def point(step: int, rate: float, v_vc: float, output_v: float, std_v: float = 0.0) -> Point:
    return Point(step, rate, v_vc, output_v, std_v, 10)


def begun(*tries: tuple[float, float, float]) -> Matching:
    """Zeros at 0 V, -125 mV on the table, and tries of V_Vc, output and scatter."""
    means = [point(1, 0.0, 0.0, 0.0), point(1, 10.0, 0.0, -0.125), point(2, 0.0, 0.0, 0.0)]
    return Matching.of([*means, *(point(2, 0.0, *attempt) for attempt in tries)], Match.ZERO, 10.0)


def match(mode: Match, guess_v: float, times: int, *, curvature: float = 0.0, k_vc: float = K_VC) -> Matching:
    points = [point(1, 0.0, 0.0, -0.042), point(1, 10.0, 0.0, -0.042 + 10.0 * K), point(2, 0.0, 0.0, 0.0097)]
    v_vc = guess_v
    for _ in range(times):
        points.append(point(2, 0.0, v_vc, output(v_vc, curvature=curvature, k_vc=k_vc)))
        matching = Matching.of(points, mode, 10.0)
        v_vc = matching.v_vc_equal_v
    return matching


@given(st.floats(0.02, 2.0), st.sampled_from([1.0, -1.0]), st.floats(5.0, 200.0))
def test_straight_gyro_is_matched_from_any_guess(guess_v: float, sign: float, k_vc: float) -> None:
    assert match(Match.ZERO, guess_v, 1, k_vc=sign * k_vc).k_vc == pytest.approx(sign * k_vc, rel=1e-9)


def test_curvature_is_met_by_further_settings() -> None:
    once, twice, thrice = (match(Match.ZERO, 0.4, times, curvature=0.05) for times in (1, 2, 3))
    exact = 10.0 / ((math.sqrt(1.0 + 4.0 * 0.05 * 0.25) - 1.0) / (2.0 * 0.05))  # V (1 + 0.05 V) = 0.25
    assert abs(once.k_vc / exact - 1.0) > 5e-3
    assert twice.k_vc == pytest.approx(exact, rel=1.5e-4)
    assert not twice.equal()
    assert thrice.k_vc == pytest.approx(exact, rel=1e-5)
    assert thrice.equal()


def test_absolute_takes_the_offset_of_the_zeros_into_k_vc() -> None:
    """51.7 mV between the zeros, 125 mV for 10 deg/s: K_Vc is 29 % low, V_Vc 41 % high (gyro-metrology 6.2)."""
    trapped = match(Match.ABSOLUTE, 0.25, 3)
    assert trapped.v_vc_equal_v / 0.25 == pytest.approx(1.0 + 0.0517 / 0.125, rel=1e-6)
    assert match(Match.ZERO, 0.25, 3).v_vc_equal_v == pytest.approx(0.25, rel=1e-6)


def test_equal_within_the_noise_or_nearly_so() -> None:
    assert begun((0.25, -0.12495, 0.0)).equal()
    assert not begun((0.25, -0.1249, 0.0)).equal()
    assert begun((0.25, -0.1249, 2e-4)).equal()
    assert not begun((0.25, -0.1247, 2e-4)).equal()  # 5 standard uncertainties
    assert not begun((0.25, -0.120, 2e-4)).usable()
    assert not begun((0.25, -0.1220, 2e-3)).usable()
    assert begun((0.25, -0.1233, 2e-3)).usable()


def test_v_vc_between_ranges_takes_nearer_end() -> None:
    below, above = (0.24, -0.122, 1e-5), (0.25, -0.129, 1e-5)
    assert not begun(below).usable()
    between = begun(below, above)
    assert between.usable()
    assert between.best.v_vc_v == 0.24
    assert between.v_vc_equal_v == pytest.approx(0.24 * 0.125 / 0.122)
    assert not begun((0.2, -0.1, 1e-5), (0.3, -0.15, 1e-5)).usable()


def test_a_dead_v_vc_lead_is_said_to_be_one() -> None:
    dead = begun((0.25, 1e-6, 1e-5))
    with pytest.raises(MeasurementError, match="does not respond to V_Vc"):
        dead.v_vc_equal_v  # noqa: B018  # the property raises


@pytest.mark.parametrize("rate_deg_s", [10.0, -10.0])
@pytest.mark.parametrize(("std_v", "least_v"), [(0.0, 1.25e-4), (1e-3, 3e-3 / 10.0**0.5)])
def test_answer_to_v_vc_is_beyond_noise(rate_deg_s: float, std_v: float, least_v: float) -> None:
    def answered(answer_v: float) -> float:
        means = [point(1, 0.0, 0.0, 0.0), point(1, rate_deg_s, 0.0, K * rate_deg_s), point(2, 0.0, 0.0, 0.0)]
        return Matching.of([*means, point(2, 0.0, 0.25, answer_v, std_v)], Match.ZERO, rate_deg_s).slope

    for sign in (1.0, -1.0):
        assert answered(1.05 * sign * least_v) == pytest.approx(4.2 * sign * least_v)
        with pytest.raises(MeasurementError, match="does not respond to V_Vc"):
            answered(0.95 * sign * least_v)


def test_windows_in_a_row_are_one_mean() -> None:
    matching = begun((0.3, -0.15, 1e-4), (0.25, -0.1248, 1e-4), (0.25, -0.1252, 3e-4))
    assert len(matching.tries) == 2
    best = matching.best
    assert (best.v_vc_v, best.n) == (0.25, 20)
    assert best.output_v == pytest.approx(-0.125)
    assert best.std_v == pytest.approx(1e-4 * 5.0**0.5)
    assert matching.k_vc == pytest.approx(40.0, rel=1e-9)


def test_uncertainty_of_k_vc_counts_every_mean() -> None:
    matched, std_v = match(Match.ZERO, 0.25, 1), 1e-4
    assert matched.u_k_vc(std_v, 0.0) / matched.k_vc == pytest.approx(2.0 * std_v / 10.0**0.5 / 0.125, rel=1e-6)
    assert matched.u_k_vc(0.0, 3e-6) / matched.k_vc == pytest.approx(2.0 * 3e-6 / 0.125, rel=1e-6)
    absolute = match(Match.ABSOLUTE, 0.25, 2)
    relative = 2.0**0.5 * 3e-6 / (0.125 + 0.0517)
    assert absolute.u_k_vc(0.0, 3e-6) / absolute.k_vc == pytest.approx(relative, rel=1e-6)


def test_output_that_ignores_table_gives_no_k_vc() -> None:
    means = [point(1, 0.0, 0.0, 0.0), point(1, 10.0, 0.0, 0.0), point(2, 0.0, 0.0, 0.0), point(2, 0.0, 0.0, 0.0)]
    matching = Matching.of([*means, point(2, 0.0, 0.25, -0.125), point(2, 0.0, 0.0, 0.0)], Match.ZERO, 10.0)
    assert matching.level_v == 0.0
    with pytest.raises(MeasurementError, match="does not respond to the table's rate"):
        _ = matching.k_vc


@pytest.mark.parametrize("match_rate_deg_s", [-150.0, 150.0])
def test_the_table_is_given_time_for_the_match_rate_of_either_sign(match_rate_deg_s: float) -> None:
    asked = make_settings(rates_deg_s=(10.0, 0.0, -10.0), match_rate_deg_s=match_rate_deg_s, match_rates_deg_s=(5.0,))
    assert asked.fastest_deg_s == 150.0
