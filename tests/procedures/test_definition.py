"""What values are of, and under what they hold: every setting either defines, is a condition or a circumstance."""

from __future__ import annotations

from typing import Annotated, Any

import pytest
from msgspec import Meta

from vcfbench.instructions.titles import BUILT_IN
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.characterize.plan import CharacterizeSettings
from vcfbench.procedures.definition import DEFINING, defined
from vcfbench.records.metadata import RunMetadata
from vcfbench.station.settings import ProcedureSettings
from vcfbench.typed import typed
from vcfbench.values.definition import Definition
from vcfbench.values.value import Value

OF_PARTS = {each for each in CharacterizeSettings.__struct_fields__ if each not in ProcedureSettings.__struct_fields__}
CONDITIONS = frozenset(("positive_rail_v", "negative_rail_v", "temperature_c"))
"""Settings that are conditions of all values."""

CIRCUMSTANCES = frozenset(
    (
        *("station", "dut", "devices", "outdated", "validity_days", "wanted_u95_ppm", "max_drift_ppm", "health"),
        *("acceleration_deg_s2", "rate_deadline_s", "rate_tolerance_deg_s", "rail_current_limit_a", "rail_tolerance_v"),
        *("drive", "k_vc_guess_deg_s_per_v", "meter_range_v", "samples", "settle_s", "warm_up_s", "v_vc_range_v"),
        *("order", "zeros", "repeat", "axis_tilt_deg", "cycles", "match_iterations", "match_windows"),
        *("match_rates_deg_s", "curve_order", "exchange", "k_vc", "k_vc_u_deg_s_per_v", "k_vc_deg_s_per_v"),
        *("scale_factor_u_v_per_deg_s", "powered_s", "noise_bandwidth_hz", "u_noise_bandwidth_hz"),
        *("noise_bandwidth_nplc", "burst_readings", "shortest_s", "longest_s", "window_s", "bias_instability_deg_h"),
        *("sine_amplitude_v", "record_samples", "frequencies_hz", "around_split", "split_guess_hz"),
        *("in_phase_split_hz", "low_pass_hz", "low_pass_order", "closed_form_ppm", "ring_down_v_vc_v"),
        *("sense_ring_downs", "drive_ring_downs", "v_vc_v", "difference_hz", "records", "rotation_records"),
        *("target_deg", "most_cycles", "orders", "log_s", "rails_varied", "rail_step_v", "power_cycles", "growth"),
        *("resolution_deg_s", "room_c", "window_k", "chamber_takes_s", "longest_soak_s", "steady_ppm_min"),
        *("soak_window_s", "split", "u_temperature_k", "u_each_temperature_k", "positive_rail_ohm"),
        *("negative_rail_ohm", "v_vc_ohm", "output_ohm", "lead_ohm", "ohm_readings", "polarity_rate_deg_s"),
        *(
            "polarity_v_vc_v",
            "at_most_s",
            "axes",
            "turn_s",
            "tilt_deg",
            "heading_deg",
            "mounting_deg",
            "mount_s",
            "vibration_hz",
        ),
        *("vibration_amplitude_v", "split_hz", "u_split_hz", "q", "u_q", "in_phase_share", "u_in_phase_share"),
        *("modulation_hz", "virtual_rate_deg_s"),
    )
)
"""Settings whose effects are in u, or are missing in it; those that only choose which values there are; all else."""

SLOPE = Value("scale_factor", -0.0125, "V/(deg/s)", 1e-7, kind="scale_factor")
K_VC = Value("k_vc", 150.0, "(deg/s)/V", 0.1, kind="k_vc")
BIAS = Value("bias", 3.3, "deg/s", 1e-3, kind="bias_at_rest_deg_s")
N = Value("angle_random_walk", 0.2, "deg/sqrt(h)", 4e-3)


@pytest.mark.parametrize("procedure", BUILT_IN)
def test_every_setting_of_a_procedure_stands_in_one_list(procedure: str) -> None:
    keys = set(PROCEDURES[procedure].settings.__struct_fields__) - (OF_PARTS if procedure == "characterize" else set())
    lists = (set(DEFINING), set(CONDITIONS), set(CIRCUMSTANCES))
    assert {key: sum(key in each for each in lists) for key in keys} == dict.fromkeys(keys, 1)


def test_no_list_has_a_setting_of_no_procedure() -> None:
    known = {key for name in BUILT_IN for key in PROCEDURES[name].settings.__struct_fields__}
    assert {*DEFINING, *CONDITIONS, *CIRCUMSTANCES} <= known


@pytest.mark.parametrize(
    ("procedure", "value", "asked", "unlike"),
    [
        ("turntable", SLOPE, {"rates_deg_s": (50.0, 0.0, -50.0)}, "rates: 17 rates, 200 to -200 deg/s and 50, 0, -50"),
        ("turntable", SLOPE, {"repeat": 3, "samples": 20, "nplc": 100, "earth": "rate"}, ""),
        ("virtual-coriolis", K_VC, {"match_rate_deg_s": 20.0}, "match rate: 10 and 20 deg/s"),
        ("virtual-coriolis", SLOPE, {"match_rate_deg_s": 20.0}, ""),
        ("zero", N, {"mode": "dead-time"}, "mode: corrected and dead-time"),
        ("zero", N, {"duration_s": 900.0}, ""),
        ("zero", BIAS, {"scale_factor_v_per_deg_s": -0.013}, "divided by"),
        ("temperature", Value("scale_factor_tc", -100.0, "ppm/K"), {"level_deg_s": 50.0}, "level: 200 and 50 deg/s"),
    ],
)
def test_a_choice_that_moves_a_value_is_in_its_definition(
    procedure: str, value: Value, asked: dict[str, Any], unlike: str
) -> None:
    kind = PROCEDURES[procedure].settings
    other = typed(asked, kind)
    usual, found = (next(iter(defined([value], each, RunMetadata()))).definition for each in (kind(), other))
    said = usual.unlike(found)
    assert said.startswith(unlike) if unlike else said == ""


def test_custom_settings_define_all_values_and_custom_definition_stays() -> None:
    class Own(ProcedureSettings, frozen=True):
        loops: Annotated[int, Meta(ge=1, le=100, description="times up and down")] = 1

    (usual,), (more,) = (defined([Value("width", 1.0)], Own(loops=loops), RunMetadata()) for loops in (1, 2))
    assert usual.definition.unlike(more.definition) == "loops: 1 and 2"
    own = Value("width", 1.0, definition=Definition.of(choices={"edge": "rising"}))
    assert next(iter(defined([own], Own(), RunMetadata()))).definition == own.definition


def test_conditions_are_rails_and_temperature_nearest_to_device() -> None:
    told = RunMetadata(ambient_temperature_c=21.5)
    (room,) = defined([K_VC], PROCEDURES["kvc"].settings(), told)
    (device,) = defined([K_VC], PROCEDURES["kvc"].settings(temperature_c=24.0), told)
    assert room.conditions.words == "21.5 degC, rails +10, -10 V"
    assert device.conditions.temperature_c == 24.0
