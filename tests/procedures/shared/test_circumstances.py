"""What temperature, mounting and phases do to values, as far as a bench file knows them."""

from __future__ import annotations

import math

import pytest
from msgspec.structs import replace

from tests.procedures.fakes import make_settings
from vcfbench.procedures.shared.budget.phases import CARRIER_PHASE, DEMODULATOR_PHASE, PhaseErrors
from vcfbench.procedures.shared.budget.statement import Circumstances
from vcfbench.station.settings import Sources

KNOWN = Sources(
    carrier_phase_deg=2.0,
    demodulator_phase_deg=1.0,
    k_vc_ppm_carrier_deg=-300.0,
    k_vc_ppm_demodulator_deg=20.0,
    scale_factor_ppm_demodulator_deg=150.0,
    bias_deg_s_demodulator_deg=0.5,
    scale_factor_ppm_k=-100.0,
    bias_deg_h_k=36.0,
    temperature_k=1.0,
    warm_up_k=4.0,
    warm_up_time_s=100.0,
    misalignment_deg=2.0,
)


def test_at_its_limit_a_phase_has_its_largest_effect_that_of_the_cosine_included() -> None:
    phases = PhaseErrors.of(KNOWN)
    carrier = -(2.0 * 300e-6 + 1.0 - math.cos(math.radians(2.0)))
    demodulator = 150e-6 + 1.0 - math.cos(math.radians(1.0))
    assert phases.k_vc({CARRIER_PHASE: 2.0}) - 1.0 == pytest.approx(carrier)
    assert phases.k_vc({DEMODULATOR_PHASE: 1.0}) - 1.0 == pytest.approx(20e-6)
    assert phases.scale_factor({DEMODULATOR_PHASE: 1.0}) - 1.0 == pytest.approx(demodulator)
    assert phases.bias_deg_s({DEMODULATOR_PHASE: 1.0}) == 0.5
    u_carrier, u_demodulator = (limit_deg / math.sqrt(3.0) for limit_deg in (2.0, 1.0))
    by_carrier = abs(carrier) / 2.0
    assert phases.u_k_vc == pytest.approx(
        {CARRIER_PHASE: by_carrier * u_carrier, DEMODULATOR_PHASE: 20e-6 * u_demodulator}
    )
    assert phases.u_scale_factor == pytest.approx({DEMODULATOR_PHASE: demodulator * u_demodulator})
    assert phases.u_self_calibrated == pytest.approx(
        {CARRIER_PHASE: by_carrier * u_carrier, DEMODULATOR_PHASE: (demodulator + 20e-6) * u_demodulator}
    )
    assert phases.u_bias_deg_s == pytest.approx({DEMODULATOR_PHASE: 0.5 * u_demodulator})
    assert PhaseErrors.of(Sources()).sources == ()


def circumstances(known: Sources) -> Circumstances:
    settings = make_settings(warm_up_s=200.0)
    return Circumstances.of(replace(settings, station=replace(settings.station, sources=known)))


def test_the_warm_up_counts_as_far_as_it_is_to_go_when_the_first_window_begins() -> None:
    sources = {source.name: source.u * math.sqrt(3.0) for source in circumstances(KNOWN).sources}
    start_up_s = make_settings(warm_up_s=200.0).start_up_s
    assert sources == pytest.approx(
        {
            "temperature": 1.0,
            "warm-up": 4.0 * math.exp(-start_up_s / 100.0),
            "misalignment": 1.0 - math.cos(math.radians(2.0)),
            CARRIER_PHASE: 2.0,
            DEMODULATOR_PHASE: 1.0,
        }
    )
    assert circumstances(Sources()).sources == ()


VALUES = {
    "virtual.k_vc": 150.0,
    "turntable.scale_factor": -0.0125,
    "virtual.scale_factor": -0.0127,
    "turntable.bias": -0.042,
    "virtual.bias": 0.001,
    "virtual.bias_deg_s": -0.08,
    "bias_difference_v": 0.043,
}


def test_each_value_is_that_of_the_stated_temperature_mounting_and_phases() -> None:
    """A kelvin, a tilt of 1e-3 and a degree of the demodulator's phase, by hand."""
    around = circumstances(KNOWN)
    q = {"temperature": 0.6, "warm-up": 0.4, "misalignment": 1e-3, DEMODULATOR_PHASE: 1.0}
    found = around.applied(VALUES, q)
    scale, k_vc = around.phases.scale_factor(q), around.phases.k_vc(q)
    moved = 0.043 * (k_vc * scale / (1.0 - 100e-6 * 0.6) - 1.0)
    drifted = 0.01 * 1.0 + 0.5
    assert found == pytest.approx(
        {
            "virtual.k_vc": 150.0 / 1.001 * k_vc,
            "turntable.scale_factor": -0.0125 * 1.001 / (1.0 - 100e-6) * scale,
            "virtual.scale_factor": -0.0127 * 1.001 / (1.0 - 100e-6) * scale,
            "turntable.bias": -0.042 + drifted * 0.0125,
            "virtual.bias": 0.001 + drifted * 0.0127 + moved,
            "virtual.bias_deg_s": (-0.08 - drifted) / 1.001 + moved / -0.0127,
            "bias_difference_v": 0.043 + moved,
        }
    )
    one = {"scale_factor": -0.0125, "bias": -0.042}
    assert around.applied(one, q)["bias"] == pytest.approx(-0.042 + drifted * 0.0125)


def test_what_changes_no_volt_of_v_vc_leaves_the_difference_of_the_zeros() -> None:
    tilted = circumstances(Sources(misalignment_deg=2.0))
    assert tilted.applied(VALUES, {"misalignment": 1e-3})["bias_difference_v"] == 0.043
    assert circumstances(Sources()).applied(VALUES, {}) is VALUES
