"""Scale factor and bias over temperature from a file: the coefficients that were put in, within U95; hysteresis."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from simrack_tests.cells import few
from typer.testing import CliRunner

from vcfbench.archive.analyzed_temperature import analyze_temperature
from vcfbench.cli.main import app
from vcfbench.errors import ConfigError

if TYPE_CHECKING:
    from pathlib import Path

UP = (-40.0, -20.0, 0.0, 25.0, 50.0, 70.0, 85.0)
LOOP = (*UP, *UP[-2::-1])
TRUTH = {
    "scale factor of out_v": (-12.5e-3, 60.0, 0.1),
    "bias of out_v": (0.01, 2e-4, 0.0),
}
"""At 25 degC: V/(deg/s), ppm/K, ppm/K^2; deg/s, (deg/s)/K."""


def table(path: Path, seed: int, hysteresis_deg_s: float = 0.0, head: str = "temp_c,rate_deg_s,out_v") -> Path:
    """Five rates at each temperature of a loop, noise of 10 uV."""
    draw, rows = np.random.default_rng(seed), [head]
    for place, at_c in enumerate(LOOP):
        apart = at_c - 25.0
        factor = -12.5e-3 * (1.0 + 60e-6 * apart + 0.1e-6 * apart**2)
        bias = 0.01 + 2e-4 * apart + (hysteresis_deg_s * (1.0 - ((at_c - 22.5) / 62.5) ** 2) if place > 6 else 0.0)
        for rate in (-100.0, -50.0, 0.0, 50.0, 100.0):
            output = factor * rate - 12.5e-3 * bias + 1e-5 * draw.standard_normal()
            rows.append(f"{at_c + 0.01 * draw.standard_normal():.3f},{rate},{output:.8f}")
    path.write_text("\n".join(rows) + "\n")
    return path


def test_coefficients_are_those_that_were_put_in(tmp_path: Path) -> None:
    within, seen = [], 0
    for seed in range(20):
        found = analyze_temperature(table(tmp_path / "t.csv", seed), "temp_c")
        assert (found.reference_c, found.notes) == (25.0, ())
        for each in found.found:
            values = {one.name: one for one in each.stated}
            for truth, name in zip(TRUTH[each.name], ("value", "tc", "tc2"), strict=True):
                within.append(abs((values[name].value or 0.0) - truth) <= (values[name].u95 or 0.0))
            seen += values["hysteresis"].form == "plus-minus"
            assert each.rows == (5,) * 13
            assert each.rising == (True,) * 7 + (False,) * 6
    assert np.mean(within) >= 0.9  # 120 of them
    assert seen <= 4


@pytest.mark.parametrize("ppm_k", few([-1000.0, -120.0, 500.0], every=3))
def test_coefficient_of_one_sided_temperatures_holds_truth(tmp_path: Path, ppm_k: float) -> None:
    """From 25 degC up: the mean of the scale factors is not the one that is stated."""
    within = []
    for seed in range(20):
        draw, rows = np.random.default_rng(seed), ["temp_c,rate_deg_s,out_v"]
        for at_c in (25.0, 40.0, 55.0, 70.0, 85.0, 70.0, 55.0, 40.0, 25.0):
            factor = 8e-3 * (1.0 + 1e-6 * ppm_k * (at_c - 25.0))
            noise = 1e-5 * draw.standard_normal(3)
            rows += [f"{at_c},{rate},{factor * rate + noise[place]:.8f}" for place, rate in enumerate((-300, 0, 300))]
        (tmp_path / "t.csv").write_text("\n".join(rows) + "\n")
        tc = analyze_temperature(tmp_path / "t.csv", "temp_c").found[0].stated[1]
        within.append(abs((tc.value or 0.0) - ppm_k) <= (tc.u95 or 0.0))
    assert np.mean(within) >= 0.8


def test_hysteresis_that_is_there_is_seen(tmp_path: Path) -> None:
    found = analyze_temperature(table(tmp_path / "t.csv", 1, 0.01), "temp_c").found[1].stated[-1]
    assert found.form == "plus-minus"
    assert found.value == pytest.approx(0.01, abs=0.003)


def ramp(path: Path, head: str) -> Path:
    """A log at rest, 25 to 85 degC: bias 0.05 deg/s and 1e-3 (deg/s)/K, in counts of 1 / 100 deg/s."""
    draw, at_c = np.random.default_rng(3), np.linspace(25.0, 85.0, 6000)
    rates = 0.05 + 1e-3 * (at_c - 25.0) + 0.05 * draw.standard_normal(at_c.size)
    rows = [f"{0.1 * k:.1f},{t:.3f},{100.0 * x:.4f}" for k, (t, x) in enumerate(zip(at_c, rates, strict=True))]
    path.write_text("\n".join([head, *rows]) + "\n")
    return path


def test_log_at_rest_gives_its_bias(tmp_path: Path) -> None:
    file = ramp(tmp_path / "t.csv", "t_s,imu [degC],gz [LSB]")
    found = analyze_temperature(file, "imu [degC]", scale_factor_per_deg_s=100.0)
    (bias,) = found.found
    value, slope = bias.stated[:2]
    truth = 0.05 + 1e-3 * (found.reference_c - 25.0)
    assert abs((value.value or 0.0) - truth) <= (value.u95 or 0.0) < 0.01
    assert abs((slope.value or 0.0) - 1e-3) <= (slope.u95 or 0.0) < 2e-4
    assert [each.name for each in bias.stated] == ["value", "tc", "tc2"]


UNITS = {"degC": 0.0, "K": -273.15, "degF": -160.0 / 9.0, "mK": -273.15, "m\u00b0C": 0.0, "0.1 \u00b0C": 0.0}
SIZES = {"degF": 5.0 / 9.0, "mK": 1e-3, "m\u00b0C": 1e-3, "0.1 \u00b0C": 0.1}


@pytest.mark.parametrize("unit", UNITS)
def test_temperatures_are_converted_from_their_unit(tmp_path: Path, unit: str) -> None:
    at_c, rate = np.repeat([-20.0, 0.0, 25.0, 50.0, 70.0], 3), np.tile([-10.0, 0.0, 10.0], 5)
    written = (at_c - UNITS[unit]) / SIZES.get(unit, 1.0)
    rows = [f"{t:.6f},{x},{2 * x + 0.1 * c:.6f}" for t, c, x in zip(written, at_c, rate, strict=True)]
    (tmp_path / "t.csv").write_text("\n".join([f"temp [{unit}],rate [dps],out [dps]", *rows]), "utf-8")
    found = analyze_temperature(tmp_path / "t.csv", f"temp [{unit}]")
    assert found.found[1].temperature_c == pytest.approx((-20.0, 0.0, 25.0, 50.0, 70.0), abs=1e-5)
    assert found.found[1].stated[1].value == pytest.approx(0.05)


def test_bias_is_over_the_scale_factor_at_its_temperature(tmp_path: Path) -> None:
    """Where the scale factor changes by a third, the rate that is read at rest does not follow its mean."""
    at_c, rate = np.repeat([-40.0, -10.0, 25.0, 55.0, 85.0], 3), np.tile([-10.0, 0.0, 10.0], 5)
    size = 1.0 + 4e-3 * (at_c - 25.0)
    rows = [f"{t},{x},{k * (x + 0.5 + 0.01 * t):.6f}" for t, x, k in zip(at_c, rate, size, strict=True)]
    (tmp_path / "t.csv").write_text("\n".join(["temp_c,rate [dps],out [dps]", *rows]))
    bias = analyze_temperature(tmp_path / "t.csv", "temp_c").found[1]
    assert bias.value == pytest.approx([0.1, 0.4, 0.75, 1.05, 1.35], abs=1e-5)


def test_ramp_up_and_down_without_hysteresis_shows_none(tmp_path: Path) -> None:
    """Temperatures up and down are not the same ones: a coefficient of 1 (deg/s)/K is no hysteresis."""
    at_c = np.concatenate([np.linspace(0.0, 50.0, 1000), np.linspace(49.3, 0.7, 1000)])
    rates = at_c + 0.01 * np.random.default_rng(4).standard_normal(at_c.size)
    rows = [f"{0.1 * k:.1f},{t:.3f},{x:.4f}" for k, (t, x) in enumerate(zip(at_c, rates, strict=True))]
    (tmp_path / "t.csv").write_text("\n".join(["t_s,imu [degC],gz [dps]", *rows]))
    found = analyze_temperature(tmp_path / "t.csv", "imu [degC]").found[0].stated[-1]
    assert (found.form, found.unit) == ("size-below", "deg/s")
    assert (found.high or 1.0) < 0.02


@pytest.mark.parametrize(
    ("head", "column", "words"),
    [
        ("temp,rate_deg_s,out_v", "temp", "of degC, K, degF, got none"),
        ("temp_v,rate_deg_s,out_v", "temp_v", "of degC, K, degF, got v"),
        ("temp [MC],rate_deg_s,out_v", "temp [MC]", "of degC, K, degF, got MC"),
        ("temp_k,rate_deg_s,out_v", "temp_k", "expected temperatures from -200 to 300 degC, got -313"),
        ("temp_c,rate_deg_s,out_v", "t", "has no column 't'"),
    ],
)
def test_what_is_no_temperature_is_refused(tmp_path: Path, head: str, column: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        analyze_temperature(table(tmp_path / "t.csv", 1, head=head), column)


def test_too_few_temperatures_are_refused(tmp_path: Path) -> None:
    file = table(tmp_path / "t.csv", 1)
    file.write_text("\n".join(file.read_text().splitlines()[:21]))
    with pytest.raises(ConfigError, match="expected 5 temperatures at least, got 4, from -40"):
        analyze_temperature(file, "temp_c")


def test_one_rate_at_a_temperature_is_refused_with_its_line(tmp_path: Path) -> None:
    file = table(tmp_path / "t.csv", 1)
    lines = file.read_text().splitlines()
    same = [f"{at_c},50,{out}" for at_c, _, out in (line.split(",") for line in lines[11:16])]
    file.write_text("\n".join([*lines[:11], *same, *lines[16:]]))
    with pytest.raises(ConfigError, match="from line 12 on: expected two rates or more, got one"):
        analyze_temperature(file, "temp_c")


@pytest.mark.exhaustive
def test_command_prints_the_coefficients(tmp_path: Path) -> None:
    file = table(tmp_path / "t.csv", 1)
    report = tmp_path / "t.md"
    done = CliRunner().invoke(app, ["analyze", str(file), "--temperature", "temp_c", "-o", str(report)])
    assert done.exit_code == 0, done.output
    assert "temperature coefficient" in done.stdout
    assert "ppm/K" in report.read_text("utf-8")
    both = CliRunner().invoke(app, ["analyze", str(file), "--temperature", "temp_c", "--compare", "a,b"])
    assert both.exit_code != 0


@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize("head", ["Temperature (F)", "temp_c", "T [K]"])
def test_log_at_rest_over_temperature_needs_no_columns(tmp_path: Path, head: str, *, first: bool) -> None:
    temp = np.repeat([-20.0, 0.0, 25.0, 50.0, 70.0, 50.0, 25.0, 0.0, -20.0], 40) + 273.15 * (head == "T [K]")
    rest = 0.01 * temp + 0.001 * np.random.default_rng(3).standard_normal(temp.size)

    def file(column: str) -> Path:
        names, columns = (head, column), (temp, rest)
        order = slice(None) if first else slice(None, None, -1)
        rows = np.column_stack(columns[order])
        np.savetxt(tmp_path / "t.csv", rows, "%.9g", ",", header=",".join(names[order]), comments="")
        return tmp_path / "t.csv"

    for column in ("gyro (deg/s)", "rate / (deg/s)", "wz_rad_s"):
        assert [each.name for each in analyze_temperature(file(column), head).found] == [f"bias of {column}"]
    for column in ("bias_mV", "gyro [LSB]"):
        with pytest.raises(ConfigError, match="give the scale factor") as error:
            analyze_temperature(file(column), head)
        assert "--scale-factor" in (error.value.hint or "")
