"""The procedure on the simulated bench of the paper, and on points that are known."""

from pathlib import Path

import pytest
import vcfbench as vb

FILE = Path(__file__).with_name("hysteresis.py")


def test_the_gyroscope_on_the_paper_bench_has_no_hysteresis(tmp_path: Path) -> None:
    settings = {"rates_deg_s": [100, 0, -100], "samples": 5, "loops": 2}
    run = vb.run(FILE, seed=1, settings=settings, runs=tmp_path)
    assert [(point.step, point.rate_deg_s) for point in run.points[:6]] == [
        *((1, -100.0), (1, 0.0), (1, 100.0)),
        *((2, 100.0), (2, 0.0), (2, -100.0)),
    ]
    assert run.results.width_v == pytest.approx([0.0, 0.0, 0.0], abs=1e-3)
    assert [type(part) for part in run.report().parts] == [vb.Table, vb.Figure]


def test_settings_are_checked_before_anything_is_opened(tmp_path: Path) -> None:
    with pytest.raises(vb.ConfigError, match="loops: expected a whole number at least 1"):
        vb.run(FILE, settings={"loops": 0}, runs=tmp_path)
    assert not list(tmp_path.iterdir())
