"""Devices that feed themselves, on a bench without a supply: what can be measured is, and no rail is spoken of."""

from __future__ import annotations

import re
import tomllib
from typing import TYPE_CHECKING

import pytest
from msgspec import structs
from simrack_tests.cells import few

import vcfbench
from vcfbench.archive.reported import full_report
from vcfbench.archive.verified import verify_run
from vcfbench.errors import ConfigError
from vcfbench.procedures.bench_file import checked_bench
from vcfbench.records.schema import Status
from vcfbench.station.parts import Limits
from vcfbench.station.writing import bench_text

if TYPE_CHECKING:
    from pathlib import Path

PAPER = vcfbench.load_bench()
FED = structs.replace(
    PAPER, name="fed", power=None, limits=Limits(max_rate_deg_s=300.0, max_acceleration_deg_s2=200.0, max_v_vc_v=10.0)
)
"""Table, meter, generator and oscilloscope."""
TABLE_AND_METER = structs.replace(
    FED,
    name="table-and-meter",
    rate_source=None,
    oscilloscope=None,
    limits=Limits(max_rate_deg_s=300.0, max_acceleration_deg_s2=200.0),
)
BY_TABLE = {
    "turntable": {"rates_deg_s": [100.0, 0.0, -100.0]},
    "zero": {"duration_s": 200.0, "powered_s": 10.0},
    "temperature": {"by": "table", "cycles": 1},
    "rate-limits": {"by": "table", "warm_up_s": 10.0},
    "threshold": {"by": "table", "cycles": 1, "rate_tolerance_deg_s": 0.01},
    "g-sensitivity": {"warm_up_s": 10.0},
}
BY_V_VC = {
    "virtual-coriolis": {"rates_deg_s": [100.0, 0.0, -100.0]},
    "kvc": {"health": False, "match_rates_deg_s": [20.0, 80.0, 200.0]},
    "polarity": {},
    "bandwidth": {},
    "phase": {"warm_up_s": 10.0},
}
SEE_IT_COME = ("warmup", "power", "repeatability", "resonance")


def spoken_of(run: vcfbench.Run) -> list[str]:
    return re.findall(r".*\brails?\b.*", vcfbench.text_of(run.report()))


@pytest.mark.parametrize("procedure", few(BY_TABLE, "turntable", "zero"))
def test_a_table_and_a_meter_calibrate_what_feeds_itself(procedure: str, tmp_path: Path) -> None:
    run = vcfbench.run(procedure, TABLE_AND_METER, seed=1, settings=BY_TABLE[procedure], runs=tmp_path)
    assert run.status is Status.COMPLETE
    assert spoken_of(run) == []
    text = vcfbench.text_of(full_report(run))
    assert "not checked: power and when it came on" in text
    assert "wait before the first reading" in text
    assert "wait after power-on" not in text
    assert run.directory is not None
    assert verify_run(run.directory).wrong is None


@pytest.mark.parametrize("procedure", few(BY_V_VC, "polarity"))
def test_v_vc_calibrates_what_feeds_itself(procedure: str, tmp_path: Path) -> None:
    run = vcfbench.run(procedure, FED, seed=1, settings=BY_V_VC[procedure], runs=tmp_path)
    assert run.status is Status.COMPLETE
    assert spoken_of(run) == []


@pytest.mark.parametrize("null_v", [None, 0.5])
def test_bias_of_a_self_fed_device_names_the_null_it_counts_from(null_v: float | None, tmp_path: Path) -> None:
    """No rail tells it: 0 V is assumed, and it is said."""
    declared = structs.replace(TABLE_AND_METER.gyro, **({} if null_v is None else {"null_v": null_v}))
    bench = structs.replace(TABLE_AND_METER, gyro=declared)
    run = vcfbench.run("turntable", bench, seed=1, settings=BY_TABLE["turntable"], runs=tmp_path)
    text = " ".join(vcfbench.text_of(run.report()).split())
    assert ("from 0 V at no rate (assumed: no gyro.null_v)" in text) == (null_v is None)
    assert ("from 0.5 V at no rate" in text) == (null_v is not None)


def test_self_fed_scale_factor_is_that_with_supply(tmp_path: Path) -> None:
    settings = BY_TABLE["turntable"]
    own, ours = (vcfbench.run("turntable", bench, seed=1, settings=settings, runs=tmp_path) for bench in (FED, PAPER))
    (k, k_ours) = (run.results.scale_factor for run in (own, ours))
    assert abs(k.value - k_ours.value) < 2.0 * (k.u + k_ours.u)


@pytest.mark.parametrize("procedure", SEE_IT_COME)
def test_power_on_procedure_is_refused_with_hint(procedure: str) -> None:
    with pytest.raises(ConfigError, match=rf'{procedure} needs power.*how the device comes on.*by = "hand"'):
        vcfbench.dry_run(procedure, FED)


def test_v_vc_levels_are_refused_without_generator() -> None:
    with pytest.raises(ConfigError, match="by: expected table: the bench has no generator on V_Vc, got 'v-vc'"):
        vcfbench.dry_run("temperature", TABLE_AND_METER)


def test_settings_of_impossible_procedure_do_not_hinder_others() -> None:
    text = bench_text(TABLE_AND_METER) + "\n[procedure.threshold]\nat_rate_deg_s = 20.0\n"
    description = checked_bench(tomllib.loads(text), "table-and-meter.toml")
    assert vcfbench.dry_run("turntable", description).steps
    with pytest.raises(ConfigError, match="by: expected table"):
        vcfbench.dry_run("threshold", description)
