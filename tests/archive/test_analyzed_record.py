"""A stranger's record at rest: units by name, clear errors, and the noise that was put in."""

from __future__ import annotations

import json
import math
import re
import tracemalloc
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from typer.testing import CliRunner

from vcfbench.archive.analyzed_record import analyze_record
from vcfbench.cli.main import app
from vcfbench.errors import ConfigError

if TYPE_CHECKING:
    from pathlib import Path

NOISE = np.random.default_rng(7).standard_normal(5000) * 0.02
"""deg/s, 100 readings a second: N = 0.02 deg/s sqrt(0.01 s) = 0.12 deg/sqrt(h)."""


def written(path: Path, head: str, *columns: object) -> Path:
    rows = zip(*columns, strict=True)  # type: ignore[call-overload]
    path.write_text("\n".join([head, *(",".join(f"{each:.9g}" for each in row) for row in rows)]) + "\n")
    return path


@pytest.mark.parametrize(
    ("head", "factor", "scale"),
    [
        ("x / (deg/s)", 1.0, None),
        ("x [deg/h]", 3600.0, None),
        ("x_mv", -12.5, -12.5e-3),
        ("x_rad_s", np.pi / 180, None),
    ],
)
def test_angle_random_walk_is_the_one_that_was_put_in(
    tmp_path: Path, head: str, factor: float, scale: float | None
) -> None:
    file = written(tmp_path / "zero.csv", head, factor * NOISE)
    found = analyze_record(file, 100.0, scale_factor_per_deg_s=scale)
    walk = {each.words: each for each in found.noise}["angle random walk"]
    assert walk.unit == "deg/sqrt(h)"
    assert walk.u is not None
    assert walk.value == pytest.approx(0.12, abs=4.0 * walk.u)
    assert found.mean_deg_s == pytest.approx(float(NOISE.mean()), rel=1e-6)
    assert found.densities["N, deg/s/sqrt(Hz)"] == pytest.approx(walk.value / 60.0)
    assert found.densities["N, rad/s/sqrt(Hz)"] == pytest.approx(math.radians(walk.value / 60.0))


def test_mean_within_one_digit_is_told(tmp_path: Path) -> None:
    few = np.random.default_rng(4).normal(0.005, 0.00175, 4000).round(2)
    found = analyze_record(written(tmp_path / "zero.csv", "gyro_z (rad/s)", few), 100.0)
    assert found.u_digit_deg_s == pytest.approx(math.degrees(0.01) / math.sqrt(12.0))
    assert any("the last digit is 0.573 deg/s" in each for each in found.notices)
    assert [each.u for each in found.noise] == [None]
    assert "u of the digit" in str(found.report())
    same = analyze_record(written(tmp_path / "zero.csv", "gyro_z (rad/s)", 0.0 * few), 100.0)
    assert same.notices == ("all readings are the same: the noise is below the last digit, or no sensor was read",)


def test_curve_is_that_of_another_program(tmp_path: Path) -> None:
    allantools = pytest.importorskip("allantools")
    found = analyze_record(written(tmp_path / "zero.csv", "rate_deg_s", NOISE), 100.0)
    taus = [each.tau_s for each in found.allan_deg_h]
    _, expected, _, _ = allantools.oadev(NOISE, rate=100.0, data_type="freq", taus=taus)
    assert [each.observed for each in found.allan_deg_h] == pytest.approx(3600.0 * expected, rel=1e-6)


def test_column_of_times_tells_the_interval(tmp_path: Path) -> None:
    times = np.arange(NOISE.size) * 10.0
    assert analyze_record(written(tmp_path / "a.csv", "t_ms,rate_deg_s", times, NOISE)).interval_s == pytest.approx(
        0.01
    )
    times[2000:] += 500.0
    found = analyze_record(written(tmp_path / "a.csv", "t_ms,rate_deg_s", times, NOISE))
    assert (found.samples, found.interval_s) == (3000, pytest.approx(0.01))
    assert "breaks in the times (a gap, or a clock that was set): 1, the first in line 2002" in found.notices[0]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "the file is empty"),
        ("1.0,2.0\n1.0,2.0\n", "expected the names of the columns, got numbers"),
        ("rate_deg_s\n1.0\n\n", "64 readings at least, got 1"),
        ("rate_deg_s\n1.0\nx\n", r"line 3, column rate_deg_s: 'x' is not a number"),
        ("rate_deg_s\n1,0\n", "1 columns expected, got 2, '1,0'; are there decimal commas"),
        ("rate_deg_s\n1.0\n\n2.0\n", "line 3: the line is empty"),
        ("a_deg_s,b_deg_s\n1,2\n", "has the columns a_deg_s, b_deg_s"),
        ("output\n" + "1.0\n" * 70, "expected a unit in its name"),
        ("output_v\n" + "1.0\n" * 70, "is in volts: give the scale factor"),
    ],
)
def test_file_that_is_no_record_is_refused_with_its_place(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "zero.csv"
    file.write_text(text)
    with pytest.raises(ConfigError, match=words):
        analyze_record(file, 100.0)


@pytest.mark.parametrize(
    "drift",
    [
        lambda k: k,
        lambda k: np.exp(-k / 20.0),
        lambda k: k**2,
        lambda k: np.sin(k / 40.0),
        lambda k: np.cumsum(np.cumsum(np.random.default_rng(4).standard_normal(k.size))),
    ],
)
@pytest.mark.parametrize("noise", [0.0, 1e-9, 1e-3])
def test_drift_that_outweighs_the_noise_ends_in_no_error(tmp_path: Path, drift: Any, noise: float) -> None:
    readings = drift(np.arange(128.0)) + noise * NOISE[:128]
    found = analyze_record(written(tmp_path / "zero.csv", "rate_deg_s", readings), 1.0)
    assert len(found.allan_deg_h) > 3
    found.report()


@pytest.mark.exhaustive
def test_a_long_record_takes_little_more_memory_than_its_numbers(tmp_path: Path) -> None:
    size, parts = 2_000_000, list[float]()
    rows = "\n".join(f"{each:.5f}" for each in np.random.default_rng(3).standard_normal(size).tolist())
    (tmp_path / "long.csv").write_text(f"rate [deg/s]\n{rows}\n")
    analyze_record(written(tmp_path / "zero.csv", "rate_deg_s", NOISE), 100.0)  # the libraries
    tracemalloc.start()
    try:
        analyze_record(tmp_path / "long.csv", 100.0, progress=parts.append)
        assert tracemalloc.get_traced_memory()[1] < 1.2 * 8 * size + 10e6  # sums of lags are kept, for any size
    finally:
        tracemalloc.stop()
    assert parts == sorted(parts)
    assert parts[-1] == 1.0


@pytest.mark.exhaustive
def test_command_prints_the_coefficients_and_writes_the_report(tmp_path: Path) -> None:
    file = written(tmp_path / "zero.csv", "rate_deg_s", NOISE)
    done = CliRunner().invoke(app, ["analyze", str(file), "--rate", "100", "-o", str(tmp_path / "zero.html")])
    assert done.exit_code == 0
    assert "angle random walk" in done.stdout
    assert "Allan deviation / (deg/h)" in done.stdout
    assert "without dead time" not in done.stdout  # of which a gapless record has none
    assert "Allan deviation of the output at rest" in (tmp_path / "zero.html").read_text()
    plain = CliRunner().invoke(app, ["analyze", str(file), "--rate", "100", "--json"])
    assert json.loads(plain.stdout)["interval_s"] == 0.01


@pytest.mark.parametrize("starts", [(0,), (0, 0), (0, -40, 7), (500, 0), (0, 0, 900)])
def test_clock_that_is_set_hides_no_time(tmp_path: Path, starts: tuple[int, ...]) -> None:
    size = NOISE.size // len(starts)
    times = np.concatenate([start + 0.01 * np.arange(size) for start in starts])
    found = analyze_record(written(tmp_path / "a.csv", "t_s,rate_deg_s", times, NOISE[: times.size]))
    if len(starts) > 1:
        gaps = 900.0 - 0.01 * size if 900 in starts else 7.0 + 40.0 - 0.01 * size if 7 in starts else 0.0
        whole = 0.01 * times.size + max(0.0, gaps)
        assert any(f"{0.01 * size:.4g} of {whole:.4g} s" in each for each in found.notices), found.notices
    assert not any(re.search(r" -\d", each) for each in found.notices)  # so many are missing
