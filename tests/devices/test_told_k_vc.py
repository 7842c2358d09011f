"""A K_Vc that was told is held against what the device's history knows of its scale factor."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st
from simrack_tests.cells import few

import vcfbench
from vcfbench.devices.device import DeviceStation, KnownDevice, KnownDeviceSettings, Reference
from vcfbench.errors import ConfigError, MeasurementError
from vcfbench.records.device_values import Measured
from vcfbench.records.devices import KvcCurve

if TYPE_CHECKING:
    from pathlib import Path

TRUE = -0.0125527
CURVE = KvcCurve(coefficients=(0.0, 150.0), covariance=((0.0, 0.0), (0.0, 1.0)), v_vc_min_v=-2.0, v_vc_max_v=2.0)
EARLIER = Reference(
    name="0002", kind="self-calibration", done="2026-11-01", scale_factor_v_per_deg_s=Measured(value=TRUE, u=1e-6)
)


def settings(issued: str | None) -> KnownDeviceSettings:
    known = KnownDevice(k_vc=CURVE, source="K_Vc = 150", certificate=None, issued=issued, reference=EARLIER)
    return KnownDeviceSettings(station=DeviceStation(known=known))


@given(st.one_of(st.floats(-10.0, -0.1), st.floats(0.1, 0.85), st.floats(1.15, 10.0)))
def test_number_that_contradicts_the_history_is_refused(off: float) -> None:
    with pytest.raises(MeasurementError, match=r"self-calibration 0002 of the device|sign of the scale factor"):
        settings(None).require_known(off * TRUE)


@given(st.floats(0.91, 1.09))
def test_number_that_agrees_with_the_history_is_taken(off: float) -> None:
    settings(None).require_known(off * TRUE)


@given(st.floats(0.1, 10.0))
def test_change_by_a_certificate_is_a_result(off: float) -> None:
    settings("2026-10-01").require_known(off * TRUE)


@pytest.mark.parametrize(("u", "missing"), few([(0.0, True), (0.1, False)], every=2))
def test_number_without_uncertainty_is_incomplete(u: float, tmp_path: Path, *, missing: bool) -> None:
    asked = {"k_vc": "150", "k_vc_u_deg_s_per_v": u, "samples": 2, "cycles": 1, "health": False, "warm_up_s": 0.0}
    run = vcfbench.run("self-calibration", "ideal", settings=asked, runs=tmp_path)
    scale = next(each for each in run.values.values() if each.unit == "V/(deg/s)")
    assert ("K_Vc" in scale.missing) is missing


@pytest.mark.parametrize("off", few([-1.0, 0.1, 0.5, 2.0, 9.0], every=3))
@pytest.mark.parametrize(("name", "key"), [("online", "k_vc"), ("threshold", "k_vc_deg_s_per_v")])
def test_table_contradicts_a_number_before_the_wait(name: str, key: str, off: float, tmp_path: Path) -> None:
    number = off * 150.0
    asked = {key: f"{number:g}" if key == "k_vc" else number, "k_vc_guess_deg_s_per_v": math.copysign(150.0, off)}
    with pytest.raises(MeasurementError, match=r"by the table K_Vc is some 15\d? \(deg/s\)/V, told is "):
        vcfbench.run(name, "lab", settings={**asked, "warm_up_s": 1800.0}, runs=tmp_path)


@pytest.fixture(scope="module")
def certified(tmp_path_factory: pytest.TempPathFactory) -> Path:
    store = tmp_path_factory.mktemp("devices")
    asked = {"match_rates_deg_s": [20.0, 100.0, 200.0], "health": False, "dut": "G", "devices": str(store)}
    vcfbench.run("kvc", "lab", seed=1, settings={**asked, "samples": 4, "cycles": 1}, runs=store / "runs")
    return store


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["g-sensitivity", "temperature"])
@pytest.mark.parametrize("off", [0.5, 2.0, -1.0])
def test_certificate_contradicts_a_scale_factor(name: str, off: float, certified: Path) -> None:
    asked = {"scale_factor_v_per_deg_s": off * TRUE, "dut": "G", "devices": str(certified)}
    with pytest.raises((ConfigError, MeasurementError), match=r"about that of certificate|cannot be"):
        vcfbench.run(name, "lab", seed=1, settings=asked, runs=certified / "runs")
