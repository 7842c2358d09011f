"""Which column of a table is the applied rate, which the output: by their names and numbers, else a question."""

from __future__ import annotations

import re
from itertools import cycle, permutations, product
from shlex import quote, split
from typing import TYPE_CHECKING

import numpy as np
import pytest
from typer.testing import CliRunner

import vcfbench
from tests.cells import few
from vcfbench.analysis.csv_table import Layout
from vcfbench.archive.analyzed import analyze
from vcfbench.cli.main import app
from vcfbench.errors import ConfigError

if TYPE_CHECKING:
    from pathlib import Path

SIZE = 1000
OTHERS = (
    *(
        "temp",
        "temp [degC]",
        "temperature",
        "temp_raw",
        "T_die [mV]",
        "ptat [mV]",
        "acc_x",
        "acc_z [m/s2]",
        "accel [LSB]",
    ),
    *("supply_v", "vbat [V]", "battery", "idx", "sample", "tick", "ts", "pressure", "mag_x", "foo", "x1", "humidity"),
)
"""Columns beside the output of a gyroscope, which is no applied rate for any of them."""
TIMES = ("Timestamp_us", "time_ms", "ts_ms", "t_s", "ms", "hour", "elapsed [s]", "sys_time_us")
APPLIED = ("rate_deg_s", "omega_rad_s", "stage [dps]", "Drehrate [\u00b0/s]", "table_rate [rpm]")
OUTPUTS = ("out", "out [mV]", "gyro [deg/s]", "adc [LSB]", "U_aus [V]", "u_mV", "u [mV]")
EITHER = {(rate, "gyro [deg/s]") for rate in ("omega_rad_s", "Drehrate [\u00b0/s]")}
"""Of two rates either may be the applied one."""
TOLD_APART = [each for each in product(APPLIED, OUTPUTS) if each not in EITHER]
RATES = ("gyro_z [mdps]", "GyroX (deg/s)", "rate / (deg/s)", "wz_rad_s", "z [dps]")


def written(path: Path, columns: dict[str, object]) -> Path:
    np.savetxt(path, np.column_stack(list(columns.values())), "%.9g", ",", header=",".join(columns), comments="")  # type: ignore[arg-type]
    return path


@pytest.mark.parametrize(("rate", "drift"), few(product(RATES, (0.0, 1.0)), (RATES[0], 0.0)))
def test_output_of_a_gyroscope_is_no_applied_rate(tmp_path: Path, rate: str, drift: float) -> None:
    random = np.random.default_rng(5)
    for other in OTHERS:
        warm = 25.0 + 20.0 * np.linspace(0.0, 1.0, SIZE) ** random.uniform(0.5, 2.0)
        columns = {rate: 0.3 + 0.01 * drift * warm + 1e-4 * random.standard_normal(SIZE), other: 0.1 * warm}
        for order in permutations(columns):
            file = written(tmp_path / "log.csv", {name: columns[name] for name in order})
            done = CliRunner().invoke(app, ["analyze", str(file)])
            assert done.exit_code == 2, (order, done.output)
            assert "scale factor, mV" not in done.output, order
            assert "--" in done.stderr, order


@pytest.mark.parametrize(("time", "rate"), few(product(TIMES, RATES), *zip(TIMES[::3], RATES, strict=False)))
def test_log_with_times_is_a_record_in_any_order(tmp_path: Path, time: str, rate: str) -> None:
    noise = np.random.default_rng(6).standard_normal(SIZE)
    columns = {time: 20.0 * np.arange(SIZE), rate: 0.3 + 0.01 * noise, "temp": np.ones(SIZE)}
    for order in permutations(columns):
        file = written(tmp_path / "log.csv", {name: columns[name] for name in order})
        done = CliRunner().invoke(app, ["analyze", str(file)])
        assert done.exit_code == 0, (order, done.output)
        assert f"{SIZE}, one every" in done.output, order


@pytest.mark.parametrize(("rate", "output"), few(TOLD_APART, *zip(cycle(APPLIED), OUTPUTS, strict=False)))
def test_applied_rate_of_few_levels_is_a_table(tmp_path: Path, rate: str, output: str) -> None:
    random = np.random.default_rng(7)
    for repeats, temp in ((1, "temp"), (40, "T [K]")):
        rates = np.tile(np.linspace(-100.0, 100.0, 11), repeats)
        y = -2.0 * rates + 0.01 * random.standard_normal(rates.size)
        columns = {rate: rates, output: y, temp: 300.0 + random.standard_normal(rates.size)}
        for order in permutations(columns):
            file = written(tmp_path / "table.csv", {name: columns[name] for name in order})
            assert list(analyze(file).series) == [output], order


def test_rate_and_outputs_that_a_person_names_are_taken(tmp_path: Path) -> None:
    random = np.random.default_rng(8)
    rates = random.uniform(-100.0, 100.0, SIZE)
    file = written(tmp_path / "t.csv", {"gyro [dps]": rates, "u_x": 0.02 * rates, "x": 1.0 + 0.0 * rates})
    with pytest.raises(ConfigError, match="no applied rate") as error:
        analyze(file)
    assert "--columns RATE,OUTPUT" in (error.value.hint or "")
    found = analyze(file, layout=Layout(columns=("gyro [dps]", "u_x")))
    assert found.series["u_x"].line.scale_factor == pytest.approx(0.02)


@pytest.mark.parametrize("marked", ["u_{}", "U_{}", "u {}", "std_{}", "{}_std"])
def test_uncertainty_stands_beside_its_column(tmp_path: Path, marked: str) -> None:
    rates, name = np.linspace(-100.0, 100.0, 11), marked.format("out [mV]") if marked[:2] != "{}" else "out_std [mV]"
    columns = {"rate [dps]": rates, "out [mV]": 2.0 * rates, name: 0.1 + 0.0 * rates, "n": 4.0 + 0.0 * rates}
    found = analyze(written(tmp_path / "t.csv", columns)).series
    assert list(found) == ["out [mV]"]
    assert found["out [mV]"].type_a is not None


@pytest.mark.parametrize("first", [0.0, -4.0, 0.5])
def test_a_scatter_of_no_readings_is_refused(tmp_path: Path, first: float) -> None:
    rates = np.linspace(-100.0, 100.0, 11)
    numbers = first + np.arange(11.0)  # as the row numbers of a table are
    columns = {"rate [dps]": rates, "out [mV]": 2.0 * rates, "std_out [mV]": 0.1 + 0.0 * rates, "n": numbers}
    with pytest.raises(ConfigError, match=r"column std_out \[mV\]: .*, or of less than 1 reading$"):
        analyze(written(tmp_path / "t.csv", columns))


def test_output_that_does_not_follow_is_asked_for(tmp_path: Path) -> None:
    random = np.random.default_rng(9)
    rates = np.linspace(-100.0, 100.0, 11)
    for rate, output in (("table [dps]", "foo"), ("x [dps]", "foo [V]"), ("x [dps]", "foo")):
        file = written(tmp_path / "t.csv", {rate: rates, output: random.standard_normal(rates.size)})
        with pytest.raises(ConfigError, match="does not follow") as error:
            analyze(file)
        assert f"--columns {quote(rate)}" in (error.value.hint or "")


@pytest.mark.parametrize("unit", ["LSB", "deg/s", "rad/s", "mdps", "mV", "V"])
def test_points_of_a_record_take_the_unit_of_the_option(unit: str, tmp_path: Path) -> None:
    rows = [f"1,{rate},0,{3.1 * rate + 0.1 * (rate % 3)},0.2,4" for rate in (-100.0, -20.0, 0.0, 50.0, 100.0)]
    file = tmp_path / "points.csv"
    file.write_text("\n".join(["step,rate_deg_s,v_vc_v,output_v,std_v,n", *rows, ""]), "utf-8")
    asked = ("rate_deg_s", "output_v")
    by_step = analyze(file, layout=Layout(units={"output_v": unit}))
    by_column = analyze(file, layout=Layout(columns=asked, units={"output_v": unit}))
    assert list(by_step.units.values()) == list(by_column.units.values())
    of_step, of_column = (next(iter(each.series.values())) for each in (by_step, by_column))
    assert of_step.line.scale_factor == pytest.approx(of_column.line.scale_factor)
    plain = next(iter(analyze(file).series.values()))  # readings scatter in proportion
    shares = [each.type_a.u_output_v / each.line.scale_factor for each in (plain, of_step) if each.type_a is not None]
    assert shares == pytest.approx([shares[0]] * 2)


COUNTS = 'unit = "LSB"\nsample_rate_hz = 100.0\nheader = "A5"\nlength = 8\nvalue = { at = 2 }\n'


@pytest.mark.parametrize(("profile", "unit"), [("vn100", "deg/s"), ("imu.toml", "LSB")])
def test_points_of_a_stream_have_its_unit(profile: str, unit: str, tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    (tmp_path / "imu.toml").write_text(COUNTS, "utf-8")
    scale = ["--scale-factor", "131"] if unit == "LSB" else []
    made = CliRunner().invoke(app, ["sim", "new", str(own), "--stream", profile, *scale])
    assert made.exit_code == 0, made.stderr
    settings = {"rates_deg_s": [100, 0, -100], "samples": 3, "settle_s": 0.5}
    run = vcfbench.run("turntable", own, settings=settings, runs=tmp_path / "runs")
    found = analyze(next((tmp_path / "runs").rglob("points.csv")))
    assert found.units["step_1"] == unit
    assert found.series["step_1"].line.scale_factor == pytest.approx(run.results.scale_factor.value)


CURED = {
    "times without unit": ("{},gz [deg/s]", "0.{k:03d},{x}"),
    "unknown unit": ("applied [deg/s],{}[furlong]", "{k},{k}"),
    "two meanings": ("t_s,{}[deg/s x100]", "0.{k:03d},{x}"),
    "directions": ("rate [deg/s],{},out [V]", "{k},{way},{x}"),
    "rate or output": ("{}[deg/s]", "{x}"),
}


@pytest.mark.parametrize("name", ["time", "time (here)", "time & date", "time's", "$time", "time of #2"])
@pytest.mark.parametrize("case", CURED)
def test_column_stands_in_a_cure_as_a_shell_reads_it(case: str, name: str, tmp_path: Path) -> None:
    head, row = CURED[case]
    rows = [row.format(k=k, x=0.01 * (k % 97), way=("cw", "ccw")[k % 2]) for k in range(100)]
    file = tmp_path / "log.csv"
    file.write_text("\n".join([head.format(name), *rows]))
    asked = ("--columns", f"{name}[deg/s x100]") if case == "two meanings" else ()
    done = CliRunner().invoke(app, ["analyze", str(file), *asked])
    assert done.exit_code == 2, done.output
    cure = re.search(r"--(unit|rows|columns) (?!says|RATE)(.*)", done.stderr)
    assert cure is not None, done.stderr
    assert split(cure[2])[0].startswith(name), done.stderr


@pytest.mark.parametrize("rate", ["rate", "rate [deg/sek]", "speed of table"])
def test_rate_without_a_unit_is_cured_by_its_option(rate: str, tmp_path: Path) -> None:
    file = tmp_path / "table.csv"
    file.write_text("\n".join([f"{rate},x [V],out [V]", *(f"{k},2.5,{0.01 * k}" for k in range(-3, 4))]))
    arguments = ["analyze", str(file)]
    for option, cure in (
        (("--unit", f"{rate}=deg/s"), "--unit RATE=deg/s"),
        (("--columns", f"{rate},out [V]"), "--columns RATE,OUTPUT leaves it out"),
    ):
        assert cure in CliRunner().invoke(app, arguments).stderr
        arguments += option
    assert CliRunner().invoke(app, arguments).exit_code == 0
    assert f"--unit {quote(f'{rate}=deg/s')}" in CliRunner().invoke(app, [*arguments[:2], *arguments[4:]]).stderr
