"""Sensitivities about three axes: planted directions are found, of one device and of three axes of one stream."""

from __future__ import annotations

import math
from typing import Any

import pytest

import vcfbench
from tests.test_several import several
from vcfbench.archive.lot import lot_report
from vcfbench.procedures.axes import AxesResult, between_axes
from vcfbench.uncertainty.measurand import measurand

SETTINGS = {"samples": 4, "mounting_deg": 0.01, "mount_s": 10.0}
PLANTED = {"x": (1.0, 0.002, -0.003), "y": (0.004, 1.0, 0.001), "z": (0.0, -0.005, 1.0)}


@pytest.fixture(scope="module")
def three() -> vcfbench.Run:
    device = []
    for column, (axis, along) in enumerate(PLANTED.items(), 2):
        size = math.hypot(*along)
        override: dict[str, Any] = {"site": {"input_axis": [each / size for each in along]}}
        own = {"name": f"I-{axis}", "resource": "COM3", "stream": {"value": {"column": column}}}
        device.append({**own, "simulation": {"override": override}})
    return vcfbench.run("axes", several(device=device), seed=1, settings=SETTINGS, runs=None)


@pytest.mark.exhaustive
def test_three_axes_of_one_stream_have_their_planted_directions(three: vcfbench.Run) -> None:
    for run, (axis, along) in zip(three.devices, PLANTED.items(), strict=True):
        found: AxesResult = run.results
        main = "xyz".index(axis)
        for name, value in found.towards.items():
            planted = 1e3 * math.atan(along["xyz".index(name)] / along[main])
            assert abs((value.value or 0.0) - planted) < value.u95
            assert value.u95 < 0.6
        assert found.scale_factor.value == pytest.approx(math.hypot(*found.sensitivity))


@pytest.mark.exhaustive
def test_sheet_of_three_axes_has_matrix_and_angles(three: vcfbench.Run) -> None:
    text = vcfbench.text_of(lot_report(three))
    assert "Output for the rate about each axis" in text
    rows = [line.split() for line in text.splitlines() if "above 90 deg" in line]
    angles = {(row[0], row[2].rstrip(",")): float(row[6]) for row in rows}
    assert angles[("I-y", "I-x")] == pytest.approx(-6.0, abs=0.5)  # 2 mrad of x towards y, 4 mrad of y towards x
    assert angles[("I-z", "I-y")] == pytest.approx(4.0, abs=0.5)


def test_one_gyroscope_has_its_scale_factor_about_its_input_axis() -> None:
    bench = vcfbench.load_bench("ideal")
    run = vcfbench.run("axes", bench, seed=1, settings=SETTINGS, runs=None)
    assert run.values["scale_factor"].value == pytest.approx(run.results.sensitivity[2], rel=1e-6)
    assert all(abs(each.value or 0.0) < each.u95 for each in run.results.towards.values())


def test_a_mounting_that_is_askew_is_in_the_angles() -> None:
    runs = [vcfbench.dry_run("axes", settings={"mounting_deg": deg}).expected for deg in (0.1, 0.5)]
    u95 = [next(each.u95 for each in run.values if each.name == "input_axis_towards_x") for run in runs]
    assert u95[1] == pytest.approx(5.0 * u95[0], rel=0.05)


def test_angle_of_two_axes_includes_readings_and_worse_mounting() -> None:
    """X of the one and y of the other: each is turned by the other's small component alone, and by the mounting."""
    common: dict[str, Any] = {"scale_factor": measurand(1.0, "V/(deg/s)", []), "towards": {}, "outputs_v": {}}
    one = AxesResult(sensitivity=(1.0, 0.0, 0.0), u_sensitivity=(0.5, 0.003, 0.5), mounting_deg=0.1, **common)
    two = AxesResult(sensitivity=(0.0, 1.0, 0.0), u_sensitivity=(0.004, 0.5, 0.5), mounting_deg=0.5, **common)
    u = {part.source: part.u for part in between_axes(("x", one), ("y", two)).parts}
    assert u.pop("readings") == pytest.approx(5.0)
    assert [*u.values()] == [pytest.approx(1e3 * math.sqrt(2.0) * math.radians(0.5) / math.sqrt(3.0))]
