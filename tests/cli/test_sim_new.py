"""``vcfbench sim new``: figures in, a bench file out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from typer.testing import CliRunner

from vcfbench import dry_run
from vcfbench.cli.main import app
from vcfbench.instructions.titles import BUILT_IN
from vcfbench.procedures.bench_file import load_bench
from vcfbench.sim.simulation import physical_parameters

if TYPE_CHECKING:
    from pathlib import Path

    from typer.testing import Result


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def new(*arguments: str) -> Result:
    return CliRunner().invoke(app, ["sim", "new", "own.toml", *arguments])


def test_figures_become_parameters(tmp_path: Path) -> None:
    done = new("--scale-factor", "-5", "--range", "400", "--split", "30", "--q-sense", "2500", "--noise", "0.6")
    assert (done.exit_code, done.stderr) == (0, "")
    assert done.stdout == "own.toml is written; next: vcfbench run turntable --bench own.toml\n"
    bench = load_bench(tmp_path / "own.toml")
    parameters = physical_parameters(bench)
    assert parameters.drive_mode.frequency_hz - parameters.sense_anti_phase.frequency_hz == pytest.approx(30.0)
    assert parameters.sense_anti_phase.quality == 2500.0
    assert parameters.noise.angle_random_walk_deg_sqrt_s == pytest.approx(0.01)
    assert (bench.name, bench.limits.max_rate_deg_s) == ("own", 600.0)
    assert bench.procedure.k_vc_guess_deg_s_per_v == 300.0
    assert "# scale_factor_v_per_deg_s = -0.005\n" in (tmp_path / "own.toml").read_text("utf-8")


@pytest.mark.exhaustive
@pytest.mark.parametrize("figures", ["--split 76", "--k-vc -150", "--range 100", "--split -24.8"])
def test_extreme_data_sheets_give_bench_for_all_procedures(figures: str, tmp_path: Path) -> None:
    done = new(*figures.split())
    assert (done.exit_code, done.stderr) == (0, "")
    for procedure in BUILT_IN.keys() - {"self-calibration", "online"}:  # which need a certificate
        dry_run(procedure, tmp_path / "own.toml")


def test_with_the_papers_imperfections_comes_the_papers_noise(tmp_path: Path) -> None:
    assert new("--imperfections", "paper", "--bias-instability", "10").exit_code == 0
    noise = physical_parameters(load_bench(tmp_path / "own.toml")).noise
    assert noise.angle_random_walk_deg_sqrt_s == pytest.approx(0.21 / 60.0)
    assert noise.bias_instability_deg_s == pytest.approx(10.0 / 0.6642824702679 / 3600.0)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--scale-factor", "100"), "range_deg_s: expected outputs within 8.5 V, V_Vc up to 10 % off, got 22 V"),
        (("--noise", "-0.2"), "angle_random_walk_deg_sqrt_h: expected 0 to 100, got -0.2"),
        (("--noise", "nan"), "angle_random_walk_deg_sqrt_h: expected 0 to 100, got nan"),
        (("--bandwidth", "-5"), "bandwidth_hz: expected 0.5 to 40, got -5"),
        (("--q-sense", "-1224"), "q_sense: expected 100 to 100000, got -1224"),
        (("--q-drive", "inf"), "q_drive: expected 100 to 100000, got inf"),
        (("--k-vc", "nan"), "k_vc_deg_s_per_v: expected a size from 0.1 to 10000, either sign, got nan"),
        (("--rail", "-10"), "rail_v: expected 3 to 15, got -10"),
        (("--bandwidth", "20"), "bandwidth_hz: expected a quarter to half the split, else no peak is seen, got 20"),
        (("--name", "paper"), "--name paper: a bench of that name comes with the package"),
        (("--name", "my own"), "name: expected"),
    ],
)
def test_what_cannot_be_is_refused_and_nothing_is_written(
    arguments: tuple[str, ...], words: str, tmp_path: Path
) -> None:
    done = new(*arguments)
    assert done.exit_code == 2
    assert words in done.stderr
    assert not (tmp_path / "own.toml").exists()


def test_no_file_is_written_over(tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text("mine", "utf-8")
    assert new().exit_code == 2
    assert (tmp_path / "own.toml").read_text("utf-8") == "mine"
