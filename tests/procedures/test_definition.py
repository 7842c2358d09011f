"""What values are of, and under what they hold: every setting either defines, is a condition or a circumstance."""

from __future__ import annotations

from typing import Annotated, Any

import pytest
from msgspec import Meta

from vcfbench.instructions.titles import BUILT_IN
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.characterize.plan import CharacterizeSettings
from vcfbench.procedures.definition import CIRCUMSTANCES, CONDITIONS, DEFINING, defined
from vcfbench.records.metadata import RunMetadata
from vcfbench.station.settings import ProcedureSettings
from vcfbench.typed import typed
from vcfbench.values.definition import Definition
from vcfbench.values.value import Value

OF_PARTS = {each for each in CharacterizeSettings.__struct_fields__ if each not in ProcedureSettings.__struct_fields__}
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
