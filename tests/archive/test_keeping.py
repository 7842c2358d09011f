"""What a run found of its device is kept with that device, by the certificate that it went by, and no other."""

from __future__ import annotations

import shutil
from datetime import timedelta
from typing import TYPE_CHECKING, Any

import pytest

import vcfbench
from vcfbench.archive.amending import amend_run
from vcfbench.archive.keeping import keep_of_device
from vcfbench.clock import utc_now
from vcfbench.errors import ConfigError
from vcfbench.records.device_values import Conditions
from vcfbench.records.devices import Certificate, DeviceStore, KvcCurve, SelfCalibration
from vcfbench.uncertainty.measurand import made_of, measurand
from vcfbench.values.value import UncertaintyPart

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench import Run

CURVE = KvcCurve(coefficients=(0.0, 150.0), covariance=((0.0, 0.0), (0.0, 1e-6)), v_vc_min_v=-2.0, v_vc_max_v=2.0)
HERE = Conditions(bench="ideal", run="r", simulated=True, positive_rail_v=10.0, negative_rail_v=-10.0)
QUICK: dict[str, Any] = {"rates_deg_s": (100.0, 0.0, -100.0), "samples": 2, "cycles": 1, "v_vc": "set"}


def certificate(days_ago: float = 9.0) -> Certificate:
    issued = utc_now() - timedelta(days=days_ago)
    return Certificate(serial="G-1", issued=issued, procedure="kvc", k_vc=CURVE, conditions=HERE)


@pytest.fixture
def store(tmp_path: Path) -> DeviceStore:
    found = DeviceStore(tmp_path / "devices")
    found.add(certificate())
    return found


def calibrated(store: DeviceStore, **asked: Any) -> Run:
    settings = {**QUICK, "dut": "G-1", "devices": str(store.root), **asked}
    return vcfbench.run("self-calibration", "ideal", settings=settings, runs=store.root.parent / "runs")


def test_an_entry_that_was_withdrawn_can_be_added_again(store: DeviceStore) -> None:
    run = calibrated(store)
    with pytest.raises(ConfigError, match="has already been added"):
        keep_of_device(run.directory)
    store.withdraw("G-1", "0002", reason="why", by="who")
    assert keep_of_device(run.directory).name == "0004"
    assert [each.name for each in store.standing("G-1")] == ["0001", "0004"]


def test_record_of_another_device_is_not_kept(store: DeviceStore) -> None:
    run = calibrated(store)
    done = amend_run(run.directory, {"dut": "G-2"}, reason="misread", by="who")
    assert "vcfbench device G-1 --withdraw 0002" in "".join(done.stays)
    store.withdraw("G-1", "0002", reason="it was G-2", by="who")
    with pytest.raises(ConfigError, match="was amended to device G-2, but used the history of G-1"):
        keep_of_device(run.directory)


def test_store_with_another_certificate_at_the_number_is_refused(store: DeviceStore, tmp_path: Path) -> None:
    run = calibrated(store)
    other = DeviceStore(tmp_path / "other")
    with pytest.raises(ConfigError, match="0001 is not the certificate of"):
        keep_of_device(run.directory, devices=other.root)
    other.add(certificate(days_ago=3.0))
    with pytest.raises(ConfigError, match="0001 is not the certificate of"):
        keep_of_device(run.directory, devices=other.root)
    shutil.rmtree(other.root)
    other.add(store.certificate("G-1").record)
    assert isinstance(keep_of_device(run.directory, devices=other.root).record, SelfCalibration)


def test_a_withdrawn_certificate_is_none_as_a_file_either(store: DeviceStore, tmp_path: Path) -> None:
    store.withdraw("G-1", "0001", reason="the encoder was loose", by="A. Person")
    path = store.root / "G-1" / "0001.json"
    with pytest.raises(ConfigError, match=r"it was withdrawn by A\. Person, .*: the encoder was loose"):
        calibrated(store, k_vc=str(path))
    with pytest.raises(ConfigError, match="has no certificate"):
        calibrated(store)
    copy = tmp_path / "copy.json"
    shutil.copy(path, copy)  # of a place without a history nobody knows
    assert calibrated(store, k_vc=str(copy)).status == "complete"


def test_contributions_are_printed_with_their_size() -> None:
    found = measurand(1.0, "deg/s", [UncertaintyPart("gravity", -2.1e-7)])
    assert made_of(found) == "gravity 2.1e-07"


@pytest.mark.exhaustive
def test_run_without_entry_is_refused_with_the_cause(tmp_path: Path) -> None:
    for procedure, dut, said in (
        ("turntable", "G-1", "turntable makes none"),
        ("zero", None, "run it with --dut SERIAL"),
    ):
        settings = {"samples": 60} if procedure == "zero" else {"rates_deg_s": (100.0, 0.0, -100.0), "samples": 2}
        run = vcfbench.run(procedure, seed=1, settings=settings, metadata={"dut": dut}, runs=tmp_path)
        with pytest.raises(ConfigError) as refused:
            keep_of_device(str(run.directory), devices=tmp_path / "devices")
        assert str(refused.value).endswith(f"has no entry for the device history; {said}")
