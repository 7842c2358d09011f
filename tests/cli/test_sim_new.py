"""``vcfbench sim new``: figures in, a bench file out."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from simrack_tests.cells import few
from typer.testing import CliRunner

from vcfbench import dry_run
from vcfbench.cli.main import app
from vcfbench.errors import ConfigError
from vcfbench.instructions.titles import BUILT_IN
from vcfbench.procedures.bench_file import load_bench
from vcfbench.sim.own_gyro import LEFT_OUT
from vcfbench.sim.simulation import physical_parameters, true_output
from vcfbench.station.discovery import Discovery

if TYPE_CHECKING:
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


def test_dry_run_expects_the_noise_of_the_data_sheet(tmp_path: Path) -> None:
    said = {}
    for noise in ("0", "0.2"):
        assert new("--noise", noise).exit_code == 0
        said[noise] = dry_run("turntable", tmp_path / "own.toml").expected.noise
        (tmp_path / "own.toml").unlink()
    assert said["0"].startswith("a perfect gyroscope, without noise")
    assert said["0.2"].startswith("white noise of 0.2 deg/sqrt(h) ([simulation])")


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


FIELDS = {  # scale factor in the unit of the output by kind, unit and step of a number; the largest rate that it tells
    ("rate", "deg/s", 1e-2): (1.0, 327.67),
    ("rate", "rad/s", 1e-4): (1.0, 187.74),
    ("rate", "LSB", 1.0): (131.0, 32767.0 / 131.0),
    ("increment", "deg", 1e-4): (1.0, 327.67),
    ("increment", "LSB", 1.0): (13100.0, 32767.0 / 131.0),
}


def profile(kind: str, unit: str, scale: float) -> None:
    keys = f'kind = "{kind}"\nunit = "{unit}"\nsample_rate_hz = 100.0\nheader = "A5"\nlength = 8\n'
    numbers = f'value = {{ at = 2, type = "int16", scale = {scale} }}\ncounter = {{ at = 1, type = "uint8" }}\n'
    Path("imu.toml").write_text(keys + numbers, "utf-8")


@pytest.mark.parametrize("stream", FIELDS, ids=str)
def test_a_stream_has_the_scale_and_the_range_of_its_own_unit(stream: tuple[str, str, float], tmp_path: Path) -> None:
    profile(*stream)
    scale_factor, most_deg_s = FIELDS[stream]
    figures = [
        "--stream",
        "imu.toml",
        "--bias",
        "-7",
        *(["--scale-factor", str(scale_factor)] if scale_factor > 1.0 else []),
    ]
    refused = new(*figures, "--range", str(most_deg_s - 6.0))
    assert refused.exit_code == 2
    assert f"--range: expected at most {most_deg_s - 7.0:.4g} deg/s" in refused.stderr
    assert new(*figures, "--range", str(most_deg_s - 8.0)).exit_code == 0
    bench = load_bench(tmp_path / "own.toml")
    output = true_output(bench)
    k = (output(100.0, None) - output(0.0, None)) / 100.0
    assert k == pytest.approx(scale_factor, rel=1e-6)
    assert output(0.0, None) / k == pytest.approx(-7.0, rel=1e-6)
    low, high = bench.expected.scale_factor_v_per_deg_s or (0.0, 0.0)
    assert low < k < high
    assert "_rail" not in (tmp_path / "own.toml").read_text("utf-8")
    dry_run("turntable", bench)
    with pytest.raises(ConfigError, match=r"rates_deg_s\[0\]: expected a rate of at most"):
        dry_run("turntable", bench, settings={"rates_deg_s": [1.02 * most_deg_s, 0.0, -1.0]})


@pytest.mark.parametrize("command", ["sim", "bench"])
def test_profile_is_found_from_the_folder_of_the_bench_file(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vcfbench.station.discovery.discover", lambda *_, **__: Discovery("@py", (), (), ()))
    profile("rate", "deg/s", 1e-2)
    of_bench = ("--yes", "--set", "site.latitude_deg=48", "--set", "gyro.stream.resource=COM3")
    more = ("--stream", "imu.toml") if command == "sim" else (*of_bench, "--set", "gyro.stream.profile=imu.toml")
    (tmp_path / "lab").mkdir()
    assert CliRunner().invoke(app, [command, "new", "lab/own.toml", *more]).exit_code == 2
    Path("imu.toml").rename("lab/imu.toml")
    assert CliRunner().invoke(app, [command, "new", "lab/own.toml", *more]).exit_code == 0
    stream = load_bench(tmp_path / "lab" / "own.toml").stream
    assert stream is not None
    assert stream.name == "imu"


def test_figures_that_a_stream_has_not_are_refused() -> None:
    profile("rate", "LSB", 1.0)
    for figures, said in {
        "--stream imu.toml": r"--scale-factor: expected the LSB/\(deg/s\) of its data sheet: imu speaks LSB",
        "--stream imu.toml --scale-factor 300": "--range: expected at most 109.2 deg/s.*got 200, the default",
        "--stream vn100 --rails 1": "--rails: not with --stream",
        "--stream vn100 --k-vc 100": "--k-vc: not with --stream",
        "--without multimeter": "--without multimeter: expected one of chamber, ",
    }.items():
        done = new(*figures.split())
        assert done.exit_code == 2
        assert re.search(said, done.stderr)


@pytest.mark.parametrize("rails", ["1", "2"])
@pytest.mark.parametrize("role", few(sorted(LEFT_OUT), "power"))
def test_bench_without_an_instrument_has_nothing_of_it(role: str, rails: str, tmp_path: Path) -> None:
    assert new("--without", role, "--rails", rails, "--rail", "8" if rails == "2" else "12").exit_code == 0
    bench, text = load_bench(tmp_path / "own.toml"), (tmp_path / "own.toml").read_text("utf-8")
    assert getattr(bench, role) is None
    assert ("rail_v = " in text.partition("[site]")[2]) == (role != "power")
    assert ("negative_rail_v" in text) == (role != "power" and rails == "2")
    rest = {"power": (), "rate_table": ("max_rate_deg_s",), "chamber": ("max_ramp_k_min",)}
    assert not any(getattr(bench.limits, key) for key in rest.get(role, ()))
    if role == "power":
        assert bench.limits.max_rail_v is None
    dry_run("zero", bench)


def test_range_beyond_the_simulated_table_has_one_limit() -> None:
    """A part of 2000 deg/s: the number would bear 1998, the table does not."""
    profile("rate", "LSB", 1.0)
    part = ("--stream", "imu.toml", "--scale-factor", "16.4")
    refused = new(*part, "--range", "2000")
    assert refused.exit_code == 2
    assert "--range: expected at most 900 deg/s, as fast as the simulated table turns, got 2000" in refused.stderr
    assert new(*part, "--range", "900").exit_code == 0
