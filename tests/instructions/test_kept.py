"""The flicker of a device: kept by a static record, used by later runs, refused when it is out of date."""

from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

import numpy as np
import pytest
from msgspec import structs

import vcfbench
from vcfbench.analysis.allan import Sampling
from vcfbench.analysis.noise_fit import Coefficients, NoiseFit, u_of_combination
from vcfbench.devices.drive import characteristics_of
from vcfbench.errors import ConfigError
from vcfbench.instructions import kept
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.kvc import KVcSettings
from vcfbench.records.device_values import Characteristics, Conditions, Measured
from vcfbench.records.devices import Certificate, Characterisation, DeviceStore, KvcCurve, StaticNoise
from vcfbench.station.settings import Sources
from vcfbench.uncertainty.at_rest import about_horizon, flicker_counted
from vcfbench.uncertainty.windows import Flicker

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

DAY = datetime(2026, 5, 4, 9, 30, tzinfo=UTC)
FOUND = StaticNoise(
    serial="G-1",
    done=DAY,
    valid_until=DAY + timedelta(days=365),
    procedure="zero",
    bias_instability_deg_h=Measured(value=4.0, u=0.4, dof=50.0),
    duration_s=3600.0,
    conditions=Conditions(bench="lab", run="r", simulated=True, positive_rail_v=10.0, negative_rail_v=-10.0),
)


@pytest.fixture
def store(tmp_path: Path) -> DeviceStore:
    found = DeviceStore(tmp_path / "devices")
    found.add(structs.replace(FOUND, done=DAY - timedelta(days=9), bias_instability_deg_h=Measured(value=9.0, u=1.0)))
    found.add(FOUND)
    return found


@pytest.fixture
def known(store: DeviceStore, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Sources]:
    def of(serial: str, now: datetime, *, outdated: bool = False) -> Sources:
        monkeypatch.setattr(kept, "utc_now", lambda: now)
        assumed = Sources(bias_instability_deg_h=5.6, assumed={"bias_instability_deg_h": "5.6", "warm_up_k": "1"})
        settings = KVcSettings(dut=serial, devices=str(store.root))
        settings = structs.replace(settings, station=structs.replace(settings.station, sources=assumed))
        return kept.with_flicker(settings, outdated=outdated).station.sources

    return of


def test_last_static_record_gives_flicker_with_age_and_u(known: Callable[..., Sources]) -> None:
    told = known("G-1", DAY + timedelta(days=12))
    assert (told.bias_instability_deg_h, told.bias_instability_dof) == (4.0, 50.0)
    assert told.bias_instability_from == "static record 0002 of G-1, 2026-05-04, 12 days old, u 0.4 deg/h"
    assert told.assumed == {"warm_up_k": "1"}
    other = known("G-2", DAY)
    assert (other.bias_instability_deg_h, list(other.assumed)) == (5.6, ["bias_instability_deg_h", "warm_up_k"])


@pytest.mark.parametrize("name", ["turntable", "virtual-coriolis", "kvc", "zero", "rate-limits", "threshold", "phase"])
def test_drive_is_recalled_by_every_run_of_device(name: str, store: DeviceStore) -> None:
    seen = Characteristics(drive_ppm_k=Measured(value=-29.5, u=0.2))
    kept_of = {"done": DAY, "procedure": "temperature", "conditions": FOUND.conditions}
    store.add(Characterisation(serial="G-1", characteristics=seen, **kept_of))
    settings = PROCEDURES[name].settings(dut="G-1", devices=str(store.root))
    assert characteristics_of(settings.recalled()) == seen


def test_outdated_entry_is_refused_unless_allowed(known: Callable[..., Sources]) -> None:
    late = DAY + timedelta(days=366)
    with pytest.raises(ConfigError, match=r"0002\.json: the static record is valid from .* to .*, not now") as refused:
        known("G-1", late)
    assert "vcfbench run zero --dut G-1" in (refused.value.hint or "")
    assert known("G-1", late, outdated=True).bias_instability_deg_h == 4.0


def test_that_of_another_device_is_refused(store: DeviceStore, known: Callable[..., Sources]) -> None:
    other = store.root / "G-2"
    other.mkdir()
    (store.root / "G-1" / "0002.json").rename(other / "0001.json")
    with pytest.raises(ConfigError, match="expected device 'G-2', got 'G-1'"):
        known("G-2", DAY)


@pytest.mark.exhaustive
def test_static_record_is_kept_for_budget_of_next_run(tmp_path: Path) -> None:
    devices = tmp_path / "devices"
    settings = {"devices": str(devices)}
    named = {"runs": tmp_path, "metadata": {"dut": "G-1"}}
    before = vcfbench.run("turntable", "paper", seed=4, settings=settings, **named)
    zero = vcfbench.run("zero", "paper", seed=3, settings=settings, **named)
    (entry,) = vcfbench.load_device("G-1", devices).entries
    assert zero.device_entry == entry.path
    assert isinstance(entry.record, StaticNoise)
    kept = entry.record.bias_instability_deg_h
    (found,) = [each for each in zero.results.noise if each.words == "bias instability"]
    assert (kept.value, kept.u) == (found.value, found.u)
    assert kept.dof == pytest.approx(0.5 * (found.value / found.u) ** 2)
    assert entry.record.valid_until == entry.record.done + timedelta(days=365)

    after = vcfbench.run("turntable", "paper", seed=4, settings=settings, **named)
    plain = vcfbench.run("turntable", "paper", seed=4, runs=tmp_path)
    assert before.results == plain.results  # no entry, no change
    said = next(each for each in after.results.uncertainty.known_from if each.startswith("flicker"))
    assert said.startswith(f"flicker: B {kept.value:.3g} deg/h (static record 0001 of G-1, ")
    of_bias = [
        next(each for each in run.results.uncertainty.value("bias").parts if each.source.startswith("flicker"))
        for run in (plain, after)
    ]
    assert of_bias[1].u / of_bias[0].u == pytest.approx(kept.value / 5.57)
    assert (of_bias[0].dof, of_bias[1].dof) == (None, kept.dof)
    assert vcfbench.load_run(after.directory).results == after.results
    of_k_vc = KVcSettings(dut="G-1", devices=str(devices)).recalled().station.sources
    assert (of_k_vc.bias_instability_deg_h, of_k_vc.bias_instability_dof) == (kept.value, kept.dof)


def test_stated_flicker_counts_unless_run_shows_more() -> None:
    told = Flicker(5.0, math.inf, "told")
    assert flicker_counted(told, 0.0, 40.0, "run") == told
    assert flicker_counted(told, 60.0, 25.0, "run") == told
    more = flicker_counted(told, 100.0, 20.0, "run")
    assert (more.deg_h, more.dof) == (pytest.approx(10.0, rel=1e-3), pytest.approx(50.0, rel=1e-2))


def test_square_found_as_0_is_not_known_as_0() -> None:
    """Half of a normal distribution: mean 0.80 of its sigma, sd 0.60 of it; 3.5 degrees of freedom."""
    found = flicker_counted(None, 0.0, 10.0, "blocks of this run")
    assert found.deg_h**2 == pytest.approx(10.0 * math.sqrt(2.0 / math.pi))
    assert found.dof == pytest.approx(2.0 / (math.pi / 2.0 - 1.0))
    assert found.said == "blocks of this run, dof 3.5"


def test_a_mean_is_one_over_the_horizon() -> None:
    fit = NoiseFit(Coefficients(bias_instability=1.0), {}, np.zeros((5, 5)))
    begin_s, end_s = [42_900.0, 0.0], [43_500.0, 86_400.0]
    usual = u_of_combination(fit, Sampling.without_gaps(1.0), begin_s, end_s, [1.0, -1.0])
    assert about_horizon([0.0], [600.0], 24.0) == pytest.approx(usual.u)
    assert about_horizon([0.0], [600.0], 24.0) / about_horizon([0.0, 300.0, 590.0], [10.0, 310.0, 600.0], 0.25) > 1.5


def test_run_uses_entries_of_its_kind_of_bench(store: DeviceStore) -> None:
    def known_on(*, simulated: bool) -> str:
        settings = KVcSettings(dut="G-1", devices=str(store.root))
        settings = structs.replace(settings, station=structs.replace(settings.station, simulated=simulated))
        return kept.with_flicker(settings, outdated=True).station.sources.bias_instability_from

    assert known_on(simulated=True).startswith("static record 0002")
    assert "static record" not in known_on(simulated=False)
    store.add(structs.replace(FOUND, conditions=structs.replace(FOUND.conditions, simulated=False)))
    assert known_on(simulated=False).startswith("static record 0003")


def test_what_is_left_out_is_said_as_the_run_begins(store: DeviceStore, tmp_path: Path) -> None:
    real = structs.replace(FOUND.conditions, simulated=False)
    store.add(structs.replace(FOUND, conditions=real))
    asked = {"devices": str(store.root), "outdated": True, "samples": 2, "rates_deg_s": [-10, 0, 10]}
    with pytest.warns(UserWarning, match="device G-1: left out, from a real bench: 0003"):
        run = vcfbench.run("turntable", "ideal", settings=asked, metadata={"dut": "G-1"}, runs=tmp_path / "runs")
    assert run.header["settings"]["station"]["simulated"] is True
    assert "static record 0002" in run.header["settings"]["station"]["sources"]["bias_instability_from"]


def test_certificate_file_of_the_other_kind_is_refused(tmp_path: Path) -> None:
    curve = KvcCurve(coefficients=(0.0, 150.0), covariance=((0.0, 0.0), (0.0, 1e-6)), v_vc_min_v=-2.0, v_vc_max_v=2.0)
    real = structs.replace(FOUND.conditions, simulated=False)
    found = Certificate(serial="G-1", issued=DAY, procedure="kvc", k_vc=curve, conditions=real)
    path = DeviceStore(tmp_path).add(found).path
    with pytest.raises(ConfigError, match="the certificate is from a real bench, this is a simulated bench"):
        vcfbench.dry_run("self-calibration", "lab", settings={"k_vc": str(path)})
