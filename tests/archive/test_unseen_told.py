"""A scale factor, and a K_Vc, that were told and that the run cannot see stand in its list with their size."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from msgspec import structs
from simrack_tests.cells import few

import vcfbench
from vcfbench.archive.unseen import K_VC, SCALE_FACTOR, unseen_of
from vcfbench.errors import MeasurementError

if TYPE_CHECKING:
    from pathlib import Path

TRUE = -0.0125527
SHORT: dict[str, dict[str, Any]] = {
    "zero": {"duration_s": 200.0, "powered_s": 10.0},
    "g-sensitivity": {"warm_up_s": 0.0, "samples": 4, "cycles": 1},
}


def ran(name: str, off: float, tmp_path: Path, k_vc: tuple[float, float] | None = None) -> vcfbench.Run:
    bench = vcfbench.load_bench("lab")
    bench = structs.replace(bench, expected=structs.replace(bench.expected, k_vc_deg_s_per_v=k_vc))
    return vcfbench.run(
        name, bench, seed=1, settings={**SHORT[name], "scale_factor_v_per_deg_s": off * TRUE}, runs=tmp_path
    )


@pytest.mark.parametrize(
    ("name", "k_vc", "least", "most"),
    few(
        [
            ("zero", None, 0.0999, 0.1001),
            ("g-sensitivity", (145.0, 155.0), 0.1, 0.2),
            ("g-sensitivity", None, 9.9, 10.1),
        ],
        ("zero", None, 0.0999, 0.1001),
        ("g-sensitivity", None, 9.9, 10.1),
    ),
)
def test_told_scale_factor_has_the_size_from_which_it_is_refused(
    name: str, k_vc: tuple[float, float] | None, least: float, most: float, tmp_path: Path
) -> None:
    (row,) = (each for each in unseen_of(ran(name, 1.0, tmp_path, k_vc)) if each.unit == SCALE_FACTOR)
    assert row.size is not None
    assert least <= row.size <= most
    with pytest.raises(MeasurementError, match="cannot be"):
        ran(name, 1.0 + 1.5 * row.size, tmp_path, k_vc)


@pytest.mark.exhaustive
def test_told_k_vc_of_a_threshold_is_in_its_list(tmp_path: Path) -> None:
    few = {"k_vc_deg_s_per_v": 150.0, "samples": 4, "steps_deg_s": [2.0, 1.0, 0.5], "at_most_s": 60.0, "cycles": 1}
    run = vcfbench.run("threshold", "lab", seed=1, settings=few, runs=tmp_path)
    (row,) = (each for each in unseen_of(run) if each.unit == K_VC)
    assert row.size == pytest.approx(9.0)
    assert set(row.effects) >= {"dead_band", "threshold"}
