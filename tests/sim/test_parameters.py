from __future__ import annotations

import pytest

from vcfbench.sim.parameters import BenchParameters


@pytest.mark.parametrize("bench", [BenchParameters.ideal(), BenchParameters.paper()])
def test_every_parameter_says_its_unit_meaning_and_source(bench: BenchParameters) -> None:
    rows = bench.rows()
    assert len(rows) > 70
    for row in rows:
        assert row.unit
        assert row.meaning
        assert row.source
    assert len({row.path for row in rows}) == len(rows)


def test_the_structure_is_the_papers() -> None:
    values = {row.path: row.value for row in BenchParameters.paper().rows()}
    assert values["drive_mode.frequency_hz"] == 3488.9
    assert values["drive_mode.quality"] == 1395.0
    assert values["sense_in_phase.frequency_hz"] == 3342.0
    assert values["sense_anti_phase.frequency_hz"] == 3464.1
    assert values["sense_anti_phase.quality"] == 1224.0
    assert values["site.latitude_deg"] == 38.0


def test_ideal_has_every_imperfection_off() -> None:
    values = {row.path: row.value for row in BenchParameters.ideal().rows()}
    ending = ("offset_v", "second_order_per_v", "third_order_per_v2", "quadrature_rad_s", "coefficient_per_k", "_error")
    noise = ("noise.angle_random_walk_deg_sqrt_s", "noise.bias_instability_deg_s", "site.latitude_deg")
    imperfect = [value for path, value in values.items() if path.endswith(ending) or path in noise]
    assert len(imperfect) >= 14
    assert not any(imperfect)
    assert values["virtual_path.left_comb_n_per_v2"] == values["virtual_path.right_comb_n_per_v2"]
