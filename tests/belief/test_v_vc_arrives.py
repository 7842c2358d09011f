"""V_Vc arrives as it is set, as far as a channel of the oscilloscope on it can tell."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

import vcfbench
from vcfbench.errors import MeasurementError
from vcfbench.station.file import embedded_text

if TYPE_CHECKING:
    from pathlib import Path

ON_V_VC = '\n[wiring.oscilloscope]\nchannel_4 = "v_vc"\n'
FEW = {"rates_deg_s": [100.0, 0.0, -100.0], "match_windows": 2, "samples": 3}


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("virtual_path]\npull_down_ohm = 50.0", r"set to \+1 V and shows up to 0\.5"),
        ("pick_up]\nv_vc_lead_v = 0.1", r"set to \+0 V and shows up to 0\.1"),
    ],
)
@pytest.mark.parametrize("bench", ["paper", pytest.param("lab", marks=pytest.mark.exhaustive)])
def test_a_terminator_and_the_mains_on_v_vc_are_refused(bench: str, fault: str, said: str, tmp_path: Path) -> None:
    file = tmp_path / "bench.toml"
    file.write_text(f"{embedded_text(bench)}{ON_V_VC}\n[simulation.override.{fault}\n", "utf-8")
    with pytest.raises(MeasurementError, match=said):
        vcfbench.run("virtual-coriolis", file, seed=1, settings=FEW, runs=None)


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.exhaustive) for seed in range(2, 10))])
def test_what_arrives_is_believed(seed: int, tmp_path: Path) -> None:
    file = tmp_path / "bench.toml"
    file.write_text(embedded_text("paper") + ON_V_VC, "utf-8")
    assert vcfbench.run("virtual-coriolis", file, seed=seed, settings=FEW, runs=None).status == "complete"
