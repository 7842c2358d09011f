from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest
from msgspec.structs import replace

from vcfbench.errors import ConfigError
from vcfbench.sim.gyro.design import ideal_bench, paper_bench

if TYPE_CHECKING:
    from vcfbench.sim.parameters import BenchParameters


@pytest.mark.parametrize("bench", [ideal_bench(), paper_bench()])
def test_every_parameter_says_its_unit_meaning_and_source(bench: BenchParameters) -> None:
    rows = bench.rows()
    assert len(rows) > 70
    for row in rows:
        assert row.unit
        assert row.meaning
        assert row.source
    assert len({row.path for row in rows}) == len(rows)


def test_the_structure_is_the_papers() -> None:
    values = {row.path: row.value for row in paper_bench().rows()}
    assert values["drive_mode.frequency_hz"] == 3488.9
    assert values["drive_mode.quality"] == 1395.0
    assert values["sense_in_phase.frequency_hz"] == 3342.0
    assert values["sense_anti_phase.frequency_hz"] == 3464.1
    assert values["sense_anti_phase.quality"] == 1224.0
    assert values["site.latitude_deg"] == 37.9


def test_ideal_has_every_imperfection_off() -> None:
    values = {row.path: row.value for row in ideal_bench().rows()}
    ending = (
        "offset_v",
        "second_order_per_v",
        "third_order_per_v2",
        "quadrature_rad_s",
        "coefficient_per_k",
        "_error",
        "misalignment_deg",
    )
    noise = ("noise.angle_random_walk_deg_sqrt_s", "noise.bias_instability_deg_s", "site.latitude_deg")
    imperfect = [value for path, value in values.items() if path.endswith(ending) or path in noise]
    assert len(imperfect) >= 14
    assert not any(imperfect)
    assert values["virtual_path.left_comb_n_per_v2"] == values["virtual_path.right_comb_n_per_v2"]


@pytest.mark.parametrize(
    ("group", "name", "value", "expected"),
    [
        ("sense_anti_phase", "quality", 0.5, "a number above 0.5"),
        ("sense_path", "low_pass_order", 0, "a number at least 1 and at most 10"),
        ("table", "loop_damping", 1.0, "a number at least 0.1 and at most 0.99"),
        ("table", "misalignment_deg", 46.0, "a number at least 0 and at most 45"),
        ("table", "ripple_harmonic", (1, 0), "a number at least 1"),
        ("thermal", "refresh_k", 0.0, "a number at least 0.0001"),
        ("noise", "flicker_processes", -1, "a number at least 0 and at most 30"),
        ("virtual_path", "mass_kg", math.nan, "a number above 0"),
    ],
)
def test_a_value_without_a_meaning_is_refused(group: str, name: str, value: object, expected: str) -> None:
    with pytest.raises(ValueError, match=f"^{expected}$"):
        replace(getattr(paper_bench(), group), **{name: value})


@pytest.mark.parametrize(
    ("group", "change", "expected"),
    [
        ("table", {"ripple_arcsec": (1.0,)}, "of one length"),
        ("supply", {"brown_out_v": 9.0}, "brown_out_v, and that at most start_v"),
        ("thermal", {"self_heating_k": 100.0, "ambient_c": 200.0}, None),
        ("drive_mode", {"quality_coefficient_per_k": -4.0}, "drive_mode.quality above 0.5 at every temperature"),
    ],
)
def test_values_that_contradict_each_other_are_refused(
    group: str, change: dict[str, object], expected: str | None
) -> None:
    paper = paper_bench()
    changed = {group: replace(getattr(paper, group), **change)}
    if expected is None:
        assert replace(paper, **changed) != paper
        return
    with pytest.raises(ConfigError, match=expected):
        replace(paper, **changed)


def test_every_group_checks_its_ranges() -> None:
    paper = paper_bench()
    for name in paper.__struct_fields__:
        limited = [each for each in getattr(paper, name).quantities().values() if str(each.allowed) != "a number "]
        assert limited, name
