"""Three axes from a table's file: matrix, misalignment and orthogonality are those that were put in, within U95."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from typer.testing import CliRunner

from vcfbench.analysis.csv_table import Layout
from vcfbench.archive.analyzed_axes import analyze_axes
from vcfbench.cli.main import app
from vcfbench.errors import ConfigError

if TYPE_CHECKING:
    from pathlib import Path

MATRIX = np.array([[1.01, 0.004, -0.002], [0.003, 0.99, 0.001], [-0.001, 0.006, -1.002]])
BIASES = np.array([0.1, -0.2, 0.05])
AXES = ("rate_x [deg/s]", "rate_y [deg/s]", "rate_z [deg/s]")


def table(path: Path, seed: int, head: str = "gx_dps,gy_dps,gz_dps") -> Path:
    """Rates about one axis at a time, noise of 0.01 deg/s."""
    draw, rows = np.random.default_rng(seed), [",".join([*AXES, head, "temp_c"])]
    for rates in np.kron(np.eye(3), np.array([-200.0, -100.0, 0.0, 100.0, 200.0])[:, None]):
        outputs = MATRIX @ rates + BIASES + 0.01 * draw.standard_normal(3)
        rows.append(",".join(f"{each:.5f}" for each in [*rates, *outputs, 25.0]))
    path.write_text("\n".join(rows) + "\n")
    return path


def test_matrix_and_angles_are_those_that_were_put_in(tmp_path: Path) -> None:
    truths = []
    for row, along in zip(MATRIX, range(3), strict=True):
        size = math.copysign(float(np.linalg.norm(row)), row[along])
        angles = [1e3 * math.atan(row[other] / row[along]) for other in range(3) if other != along]
        truths.append([size, BIASES[along] / size, *angles])
    one, two, three = (row / truth[0] for row, truth in zip(MATRIX, truths, strict=True))
    between = [-1e3 * math.asin(float(a @ b)) for a, b in ((one, two), (one, three), (two, three))]
    within = []
    for seed in range(20):
        found = analyze_axes(table(tmp_path / "axes.csv", seed), AXES)
        assert np.array([each.sensitivity for each in found.outputs]) == pytest.approx(MATRIX, abs=2e-4)
        stated = [value for each in found.outputs for value in each.stated] + list(found.orthogonality)
        truth = [each for of in truths for each in of] + between
        within += [abs(v.value - t) <= v.u95 for v, t in zip(stated, truth, strict=True) if v.value and v.u95]
        assert found.notices == ()
    assert 0.92 <= np.mean(within) <= 0.98  # 300 of them


def test_outputs_in_volts_and_a_row_that_is_off(tmp_path: Path) -> None:
    file = table(tmp_path / "axes.csv", 1, "a_mv,b_mv,c_mv")
    lines = file.read_text().splitlines()
    lines[4] = lines[4].replace("100.00000,0", "130.00000,0", 1)
    file.write_text("\n".join(lines))
    found = analyze_axes(file, AXES, layout=Layout(columns=("a_mv",)))
    assert [each.column for each in found.outputs] == ["a_mv"]
    assert found.outputs[0].unit == "V/(deg/s)"
    assert found.notices[0].startswith("a_mv, row 4: ")
    assert found.orthogonality == ()


def test_rates_about_two_axes_are_refused(tmp_path: Path) -> None:
    file = table(tmp_path / "axes.csv", 1)
    with pytest.raises(ConfigError, match="three columns of rates"):
        analyze_axes(file, AXES[:2])
    file.write_text("\n".join(file.read_text().splitlines()[:11]))
    with pytest.raises(ConfigError, match="rates about each of the three axes"):
        analyze_axes(file, AXES)
    with pytest.raises(ConfigError, match="temp_c: expected the unit of an output"):
        analyze_axes(file, AXES, layout=Layout(columns=("temp_c",)))


def test_command_prints_the_matrix(tmp_path: Path) -> None:
    file = table(tmp_path / "axes.csv", 1)
    done = CliRunner().invoke(app, ["analyze", str(file), "--axes", ",".join(AXES), "--strict"])
    assert done.exit_code == 0, done.output
    assert "input axis towards rate_y" in done.stdout
    assert max(map(len, done.stdout.splitlines())) <= 80
