"""Budgets of the two calibrations against closed forms, and against errors drawn with NumPy."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from msgspec import structs
from simrack_tests.cells import few

import vcfbench
from tests.procedures.fakes import make_settings
from vcfbench.analysis.budget import Source
from vcfbench.procedures.turntable import turntable_statement
from vcfbench.procedures.virtual_coriolis import budget as budget_module
from vcfbench.procedures.virtual_coriolis.budget import four_step_statement
from vcfbench.procedures.virtual_coriolis.matching import Matching
from vcfbench.records.plain import plain
from vcfbench.records.schema import Point
from vcfbench.sim.gyro.warm_output import warm_output
from vcfbench.sim.simulation import physical_parameters
from vcfbench.station.settings import Match, ProcedureSettings, Sources, Station
from vcfbench.uncertainty.nonlinearity import line_statement
from vcfbench.uncertainty.phases import PhaseErrors
from vcfbench.uncertainty.statement import budget_of
from vcfbench.uncertainty.windows import window_times

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Any

    from vcfbench.uncertainty.statement import Statement

RATES = [200.0, 100.0, 50.0, 20.0, 10.0, 5.0, 2.0, 1.0, 0.0, -1.0, -2.0, -5.0, -10.0, -20.0, -50.0, -100.0, -200.0]
SXX = 106_060.0
K, BIAS, K_VC, NOISE, READINGS = -0.0125, -0.042, 150.0, 1e-4, 10
METER = Sources(meter_gain=35e-6, meter_offset_v=50e-6, meter_sigmas=4.0)
GENERATOR = Sources(generator_gain=0.02, generator_offset_v=4e-3, generator_ranges_v=(0.32, 1.0, 3.2, 10.0))
FLICKER = Sources(bias_instability_deg_h=5.57, horizon_h=24.0)


def settings(sources: Sources) -> ProcedureSettings:
    return make_settings(station=Station(meter_resolution_v=1e-15, sources=sources))


def table_points(step: int = 1, std_v: float = NOISE) -> list[Point]:
    return [Point(step, rate, 0.0, K * rate + BIAS, std_v, READINGS) for rate in RATES]


def four_steps(std_v: float = 0.0) -> list[Point]:
    turns = [0.0, 10.0, 10.0, 0.0] * 2
    points = [Point(1, rate, 0.0, K * rate, std_v, READINGS) for rate in turns]
    points += [Point(2, 0.0, rate / K_VC, K * rate, std_v, READINGS) for rate in turns]
    points += table_points(3, std_v)
    return points + [Point(4, rate, rate / K_VC, K * rate, std_v, READINGS) for rate in RATES]


def four(sources: Sources, match: Match = Match.ZERO, std_v: float = 0.0) -> Statement:
    points = four_steps(std_v)
    return four_step_statement(settings(sources), points, Matching.of(points, match, 10.0))


def test_readings_go_through_the_least_squares_sums() -> None:
    stated = turntable_statement(settings(Sources()), table_points())
    slope, bias = stated.value("scale_factor"), stated.value("bias")
    assert slope.u == pytest.approx(NOISE / math.sqrt(READINGS * SXX))
    assert bias.u == pytest.approx(NOISE / math.sqrt(READINGS * 17))
    assert slope.dof == pytest.approx(17 * 9)
    assert slope.coverage_factor == pytest.approx(1.9756, abs=1e-3)  # Student's t with 153 degrees of freedom


def test_equal_readings_have_u_of_last_digit() -> None:
    """A rectangle of 10 uV, whose mean of ten is no better; readings that scatter average it out."""
    digit_v = 1e-5
    known = make_settings(station=Station(meter_resolution_v=digit_v, sources=Sources()))
    alike = turntable_statement(known, table_points(std_v=0.0)).value("scale_factor")
    assert alike.u == pytest.approx(digit_v / math.sqrt(12.0 * SXX))
    scattered = turntable_statement(known, table_points(std_v=NOISE)).value("scale_factor")
    assert scattered.u == pytest.approx(NOISE / math.sqrt(READINGS * SXX))


def test_meter_gain_and_offset_enter_scale_factor_and_bias() -> None:
    stated = turntable_statement(settings(METER), table_points(std_v=0.0))
    assert stated.value("scale_factor").u == pytest.approx(abs(K) * 35e-6 / 4)
    assert stated.value("bias").u == pytest.approx(math.hypot(50e-6 / 4, BIAS * 35e-6 / 4))


def test_table_known_by_limit_has_rectangular_factor() -> None:
    stated = turntable_statement(settings(Sources(table_rate=1e-5)), table_points(std_v=0.0))
    slope = stated.value("scale_factor")
    assert slope.u == pytest.approx(abs(K) * 1e-5 / math.sqrt(3))
    assert slope.u95 == pytest.approx(abs(K) * 0.95e-5, rel=5e-3)


@pytest.mark.exhaustive
def test_flicker_of_the_bias_is_the_integral_of_its_density() -> None:
    """Numerically, in frequency: B^2/(pi f), one-sided, times the square of what the weights make of it."""
    known, points = settings(FLICKER), table_points(std_v=0.0)
    stated = turntable_statement(known, points)
    begin, end = window_times(known, points)
    horizon = 24 * 3600.0
    frequency = np.logspace(-8, 1, 200_001)
    centres, lasts = 0.5 * (begin + end), end - begin
    seen = np.exp(-2j * math.pi * frequency[:, None] * (centres - 0.5 * (begin[0] + end[-1])))
    for name, weights, long in (("bias", np.full(17, 1 / 17), 1.0), ("scale_factor", np.array(RATES) / SXX, 0.0)):
        gain = (seen * np.sinc(frequency[:, None] * lasts)) @ weights - long * np.sinc(frequency * horizon)
        integral = np.trapezoid(np.abs(gain) ** 2, np.log(frequency))
        expected = abs(K) * 5.57 / 3600.0 * math.sqrt(integral / math.pi)
        assert stated.value(name).u == pytest.approx(expected, rel=2e-3)


def test_generator_offset_cancels_with_own_zeros() -> None:
    level_v = 10.0 / K_VC
    zero, absolute = (four(GENERATOR, match).value("k_vc") for match in (Match.ZERO, Match.ABSOLUTE))
    assert zero.u / zero.value == pytest.approx(0.02 / math.sqrt(3))
    assert zero.u95 / zero.value == pytest.approx(0.019, rel=5e-3)
    assert absolute.u / absolute.value == pytest.approx(math.hypot(0.02, 4e-3 / level_v) / math.sqrt(3))


def test_what_the_columns_share_cancels_in_their_difference() -> None:
    shared = Sources(meter_gain=1e-3, meter_offset_v=1e-3, table_rate=1e-2)
    stated = four(shared)
    assert stated.value("turntable.scale_factor").u > 5e-3 * abs(K)
    assert stated.value("scale_factor_error_percent").u < 1e-9
    assert stated.value("bias_difference_v").u < 1e-4
    assert stated.correlation[1][4] == pytest.approx(1.0)


def test_difference_of_methods_scatters_as_stated_with_drawn_generators() -> None:
    """A straight gyroscope with drawn ranges: NumPy's scatter of 4000 is known to 1.1 %."""
    rng = np.random.default_rng(5)
    rates = np.array(RATES)
    level = rates / K_VC
    own = np.searchsorted([0.32, 1.0, 3.2], np.abs(level))
    gain = rng.uniform(-0.02, 0.02, (4000, 4))
    offset = rng.uniform(-1.0, 1.0, (4000, 4)) * (4e-3 + (0.02 - np.abs(gain)) * np.array([0.0, 0.32, 1.0, 3.2]))
    output = K * K_VC * (level * (1.0 + gain[:, own]) + offset[:, own])
    matched = level[4] / (1.0 + gain[:, 0])  # its setting, zeros taken off
    slope = (output @ rates) / SXX * (matched / level[4])
    drawn = 100.0 * (slope / K - 1.0)
    stated = four(GENERATOR).value("scale_factor_error_percent")
    assert stated.u == pytest.approx(drawn.std(), rel=0.04)
    assert 0.94 < np.mean(np.abs(drawn - drawn.mean()) <= stated.u95) < 0.96
    assert output.mean(axis=1).std() == pytest.approx(four(GENERATOR).value("virtual.bias").u, rel=0.04)


def test_v_vc_meter_gain_cancels_in_the_virtual_series() -> None:
    meter = Sources(v_vc_gain=35e-6, v_vc_offset_v=50e-6, v_vc_sigmas=4.0)
    points = [
        structs.replace(p, v_vc_measured_v=p.v_vc_v, v_vc_std_v=3e-6) if p.step in {2, 4} else p for p in four_steps()
    ]
    stated = four_step_statement(settings(meter), points, Matching.of(points, Match.ZERO, 10.0))
    scatter = 3e-6 * math.sqrt(2.0 / (4 * READINGS)) * K_VC / 10.0
    assert stated.value("k_vc").u == pytest.approx(K_VC * math.hypot(35e-6 / 4, scatter))
    own = 3e-6 / math.sqrt(READINGS * SXX) * K_VC
    assert stated.value("virtual.scale_factor").u == pytest.approx(abs(K) * math.hypot(scatter, own))
    assert stated.value("virtual.bias").u == pytest.approx(
        abs(K) * K_VC * math.hypot(50e-6 / 4, 3e-6 / math.sqrt(READINGS * 17))
    )


def test_temperature_and_warm_up_cancel_in_comparisons() -> None:
    known = Sources(temperature_k=1.0, scale_factor_ppm_k=104.0, bias_deg_h_k=36.0, warm_up_k=0.3, warm_up_time_s=300.0)
    stated, left_k = four(known), 0.3 * math.exp(-settings(known).start_up_s / 300.0)
    away_k = math.hypot(1.0, left_k) / math.sqrt(3.0)
    apart = abs(BIAS / K) * 104e-6  # between the zeros, deg/s a kelvin; which of both signs is not told
    driven_deg_s = math.hypot(0.01 + apart, 0.01 * left_k) / math.sqrt(3.0)
    for column, bias_deg_s in (("turntable", 0.01 * away_k), ("virtual", driven_deg_s)):
        assert stated.value(f"{column}.scale_factor").u == pytest.approx(abs(K) * 104e-6 * away_k)
        assert stated.value(f"{column}.bias").u == pytest.approx(abs(K) * bias_deg_s, rel=1e-6)
        assert stated.value(f"{column}.bias_deg_s").u == pytest.approx(bias_deg_s, rel=1e-6)
    for same in ("k_vc", "scale_factor_error_percent"):
        assert stated.value(same).u == pytest.approx(0.0, abs=1e-12)
    assert stated.value("bias_difference_v").u == pytest.approx(abs(BIAS) * 104e-6 / math.sqrt(3.0), rel=1e-3)
    assert not any("temperature" in each or "warm-up" in each for each in stated.not_in_u)
    warmed = make_settings(warm_up_s=1800.0, station=Station(meter_resolution_v=1e-15, sources=known))
    (warm_up,) = [
        each.u_source
        for each in turntable_statement(warmed, table_points(std_v=0.0)).value("scale_factor").parts
        if each.source == "warm-up"
    ]
    assert warm_up == pytest.approx(0.3 * math.exp(-6.0) / math.sqrt(3.0), rel=0.05)


def test_misaligned_axis_acts_as_the_tables_rate() -> None:
    stated = four(Sources(misalignment_deg=1.0))
    tilted = (1.0 - math.cos(math.radians(1.0))) / math.sqrt(3.0)
    assert stated.value("k_vc").u == pytest.approx(K_VC * tilted)
    assert stated.value("turntable.scale_factor").u == pytest.approx(abs(K) * tilted)
    assert stated.value("scale_factor_error_percent").u == pytest.approx(0.0, abs=1e-12)
    assert not any("angle" in each for each in stated.not_in_u)


PHASES = Sources(
    carrier_phase_deg=0.5,
    demodulator_phase_deg=0.5,
    k_vc_ppm_carrier_deg=-1e6 * math.radians(math.tan(0.06)),
    k_vc_ppm_demodulator_deg=1e6 * math.radians(math.tan(0.06) - math.tan(0.055)),
    scale_factor_ppm_demodulator_deg=1e6 * math.radians(math.tan(0.055)),
    bias_deg_s_demodulator_deg=0.3,
)
"""Virtual and Coriolis signal are 0.06 and 0.055 rad from the demodulator's reference; 17 deg/s of quadrature."""


def test_phases_enter_values_by_scatter_of_cosines() -> None:
    rng = np.random.default_rng(7)
    carrier, demodulator = np.radians(rng.uniform(-0.5, 0.5, (2, 200_000)))
    by_rate, by_v_vc = (
        np.cos(at) / math.cos(angle)
        for at, angle in ((0.055 - demodulator, 0.055), (0.06 + carrier - demodulator, 0.06))
    )
    stated = four(PHASES)
    k_vc = stated.value("k_vc")
    drawn = K_VC * by_v_vc / by_rate
    assert k_vc.u == pytest.approx(drawn.std(), rel=0.08)  # what the cosine bends counts in full
    assert 0.95 < np.mean(np.abs(drawn - K_VC) <= k_vc.u95) < 0.98
    assert stated.value("turntable.scale_factor").u == pytest.approx(abs(K) * by_rate.std(), rel=0.08)
    of_bias = math.radians(0.3 / math.radians(1.0)) * demodulator
    assert stated.value("turntable.bias_deg_s").u == pytest.approx(np.degrees(of_bias).std(), rel=0.01)


def test_phases_that_both_columns_share_are_not_in_their_comparison() -> None:
    stated = four(PHASES)
    assert stated.value("scale_factor_error_percent").u == pytest.approx(0.0, abs=1e-12)
    slope, bias = stated.value("turntable.scale_factor"), stated.value("turntable.bias")
    parts = [each for each in (*slope.parts, *bias.parts) if each.share > 1e-9]
    assert [each.source for each in parts] == ["demodulator phase"] * 2


def test_phases_change_what_sets_the_zeros_of_the_columns_apart() -> None:
    """The modulator's offset, 51.7 mV at the output, goes with the carrier's angle: closed form of the gyroscope."""
    lab = vcfbench.load_bench("lab")
    parameters, limit_deg = physical_parameters(lab), 0.5

    def difference_v(carrier_deg: float, demodulator_deg: float) -> float:
        virtual, sense = parameters.virtual_path, parameters.sense_path
        carrier = virtual.carrier_phase_rad + math.radians(carrier_deg)
        demodulator = sense.demodulator_phase_rad + math.radians(demodulator_deg)
        moved = structs.replace(
            parameters,
            virtual_path=structs.replace(virtual, carrier_phase_rad=carrier),
            sense_path=structs.replace(sense, demodulator_phase_rad=demodulator),
        )
        output = warm_output(moved, 0.0)
        return output(0.0, 0.0) - output(0.0, None)

    known = Sources(
        carrier_phase_deg=limit_deg,
        demodulator_phase_deg=limit_deg,
        k_vc_ppm_carrier_deg=-1107.0,
        k_vc_ppm_demodulator_deg=90.0,
        scale_factor_ppm_demodulator_deg=1022.0,
        bias_deg_s_demodulator_deg=-0.3134,
    )
    stated = four(known)
    scale = abs(BIAS / difference_v(0.0, 0.0))  # that of the computed points is 42 mV
    half = [
        0.5 * scale * abs(difference_v(*off) - difference_v(*(-each for each in off)))
        for off in ((limit_deg, 0.0), (0.0, limit_deg))
    ]
    parts = {each.source: each.u * math.sqrt(3.0) for each in stated.value("bias_difference_v").parts}
    assert parts["carrier phase"] == pytest.approx(half[0], rel=0.08)  # what the cosine bends counts in full
    assert parts["demodulator phase"] == pytest.approx(half[1], rel=0.08)
    of_virtual = {each.source: each.u * math.sqrt(3.0) for each in stated.value("virtual.bias").parts}
    assert of_virtual["carrier phase"] == pytest.approx(half[0], rel=0.08)


def test_what_is_not_known_of_phases_is_said() -> None:
    said = " ".join(four(Sources()).not_in_u)
    assert "uncertainty.carrier_phase_deg" in said
    assert "uncertainty.demodulator_phase_deg" in said
    without_quadrature = " ".join(four(structs.replace(PHASES, bias_deg_s_demodulator_deg=None)).not_in_u)
    assert "uncertainty.bias_deg_s_demodulator_deg" in without_quadrature
    assert "phase" not in " ".join(four(PHASES).not_in_u)


def test_self_calibration_has_own_and_certificates_phases() -> None:
    phases = PhaseErrors.of(PHASES)
    of_k_vc, of_own = phases.u("k_vc"), phases.u("self_calibrated")
    assert of_k_vc["carrier phase"] == of_own["carrier phase"]
    assert 1e6 * of_k_vc["carrier phase"] == pytest.approx((524.2 + 38.1) / math.sqrt(3.0), rel=1e-3)
    assert of_own["demodulator phase"] == pytest.approx(
        phases.u("scale_factor")["demodulator phase"] + of_k_vc["demodulator phase"]
    )


def test_e_n_is_the_difference_over_its_expanded_uncertainty() -> None:
    stated = four(GENERATOR)
    difference = stated.value("scale_factor_error_percent")
    assert stated.e_n == pytest.approx(abs(difference.value) / difference.u95)
    assert turntable_statement(settings(METER), table_points()).e_n is None


def test_what_is_not_known_is_said() -> None:
    said = " ".join(four(Sources()).not_in_u)
    for word in (
        "multimeter",
        "table_rate_error",
        "deviation from the line",
        "warm-up",
        "Earth",
        "remounting",
        "magnetic",
    ):
        assert word in said
    known = " ".join(four(Sources(meter_gain=1e-5, table_rate=1e-5, bias_instability_deg_h=1.0)).not_in_u)
    assert "table_rate_error" not in known


def test_where_what_is_known_is_from_is_said() -> None:
    sources = Sources(meter_age_days=96.0, meter_age_from="calibrated 2026-08-18", bias_instability_deg_h=5.57)
    assert four(sources).known_from == (
        "multimeter: 96 days after calibration (calibrated 2026-08-18)",
        "flicker: B 5.57 deg/h (uncertainty.bias_instability_deg_h)",
    )


def test_a_statement_is_written_by_the_names_of_its_fields() -> None:
    written = plain(four(GENERATOR, std_v=NOISE))
    assert list(written) == ["values", "correlation", "e_n", "not_in_u", "known_from", "complete", "missing", "bounds"]
    value, same = written["values"][0], ["complete", "missing"]
    assert list(value) == ["name", "value", "unit", "u", "dof", "coverage_factor", "u95", "of", "contributions", *same]
    shares = [sum(each["share"] for each in v["contributions"]) for v in written["values"]]
    assert shares == pytest.approx([1.0] * len(shares))


def test_impossible_source_removes_dependent_values() -> None:
    sources = [Source("gain", 1.0, 0.1), Source("noise", 0.0, math.nan, "V"), Source("offset", 0.0, 0.2, "V")]
    budget, cannot_be = budget_of(
        sources, lambda q: {"slope": q["gain"] + q["noise"], "bias": q["offset"]}, {("gain", "noise"): 0.5}
    )
    assert budget.result("bias").u == pytest.approx(0.2)
    assert cannot_be == {"slope": ("noise, which cannot be (u nan)",), "bias": ()}


def test_missing_budget_leaves_k_vc_lines_and_biases(monkeypatch: pytest.MonkeyPatch) -> None:
    """A u below zero, of the levels of V_Vc in the virtual slope."""

    def below_zero(asked: Any, sources: Sequence[Source], *others: Any, **named: Any) -> Statement:
        turned = [structs.replace(each, u=-each.u) if each.name.endswith(wrong) else each for each in sources]
        return line_statement(asked, turned, *others, **named)

    wrong = "resolution: virtual slope"
    monkeypatch.setattr(budget_module, "line_statement", below_zero)
    stated = four(structs.replace(GENERATOR, generator_bits=14), std_v=NOISE)
    slope, k_vc = stated.value("virtual.scale_factor"), stated.value("k_vc")
    assert k_vc.value == pytest.approx(K_VC)
    assert k_vc.u > 0.0
    assert not any("cannot be" in each for each in (*k_vc.missing, *stated.value("turntable.bias").missing))
    assert slope.value == pytest.approx(K)
    assert any("generator resolution: virtual slope, which cannot be" in each for each in slope.missing)
    assert slope.missing


@pytest.mark.parametrize("apart", few([-0.9, -0.5, -0.1, 0.0, 0.1, 0.5, 3.0], every=5))
@pytest.mark.parametrize("k_vc", [K_VC, -K_VC])
def test_absolute_match_contains_the_difference_of_the_zeros(k_vc: float, apart: float) -> None:
    """A generator that adds a share of the match's output to all outputs: K_Vc by it is off by no more than 1.96 u."""
    added_v = apart / (1.0 + apart) * K * 10.0  # so that it is this share of the span that is left
    points = [
        structs.replace(each, output_v=each.output_v + added_v) if each.step in {2, 4} else each
        for each in four_steps(NOISE)
    ]
    equal_v = (K * 10.0 - added_v) / K / k_vc
    turned = [structs.replace(each, v_vc_v=each.v_vc_v * K_VC / k_vc, output_v=each.output_v) for each in points]
    tries = [
        structs.replace(each, v_vc_v=equal_v, output_v=K * 10.0) if each.step == 2 and each.v_vc_v else each
        for each in turned
    ]
    stated = four_step_statement(settings(METER), tries, Matching.of(tries, Match.ABSOLUTE, 10.0))
    found, slope = stated.value("k_vc"), stated.value("virtual.scale_factor")
    assert found.value == pytest.approx(10.0 / equal_v)
    by_zeros = sum(each.u for each in found.parts if each.source.startswith("difference of the zeros"))
    assert by_zeros >= abs(found.value - k_vc) * (1.0 - 1e-6)
    assert by_zeros <= 1.01 * max(abs(found.value - k_vc), abs(found.value * apart)) + 1e-9
    assert abs(found.value - k_vc) <= 1.01 * found.u + 1e-9
    of_slope = sum(each.u for each in slope.parts if each.source.startswith("difference of the zeros"))
    assert of_slope == pytest.approx(by_zeros / abs(found.value) * abs(slope.value), rel=1e-6)
    assert "the generator's shift of the zero" in found.of


def test_zeros_farther_apart_than_match_leave_k_vc_incomplete() -> None:
    points = [
        structs.replace(each, output_v=3.0 * K * 10.0) if each.step == 2 and not each.v_vc_v else each
        for each in four_steps(NOISE)
    ]
    stated = four_step_statement(settings(METER), points, Matching.of(points, Match.ABSOLUTE, 10.0))
    assert any("difference of the zeros" in each for each in stated.value("k_vc").missing)
    assert not any("cannot be" in each for each in stated.value("turntable.scale_factor").missing)
