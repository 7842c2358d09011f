"""Recalibration without a table, against the gyroscope's parameters; drifts that are seen, and those that cannot be."""

from __future__ import annotations

import json
import math
import re
from datetime import date, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from msgspec import structs
from simrack_tests.cells import few
from typer.testing import CliRunner

import vcfbench
from tests.procedures import test_kvc
from tests.procedures.test_kvc import CONDITIONS, read_v, still, truth, warm
from vcfbench.cli.main import app
from vcfbench.clock import utc_now
from vcfbench.devices.certificate import Here, drift_of
from vcfbench.devices.device import CUSUM_ACTION, E_N_ACTION, KnownDevice, Reference, level_for
from vcfbench.errors import ConfigError, MeasurementError
from vcfbench.page.station import StationDirectories
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.layers import asked_in_python, recorded_settings, settings_of
from vcfbench.procedures.self_calibration.results import SelfCalibrationResult
from vcfbench.records.device_values import Characteristics, Measured
from vcfbench.records.devices import Certificate, DeviceStore, KvcCurve, SelfCalibration
from vcfbench.sim.simulation import physical_parameters
from vcfbench.station.parts import AcceptanceLimits
from vcfbench.station.settings import Limit, PlacedInstrument
from vcfbench.testing import serve_simulated
from vcfbench.uncertainty.measurand import measurand
from vcfbench.values.value import UncertaintyPart

if TYPE_CHECKING:
    from vcfbench.station.description import BenchDescription


def looked_after(bench: BenchDescription) -> BenchDescription:
    """Return a bench on which what is not measured of K_Vc's causes has not changed."""
    same = {
        "k_vc_not_measured_ppm": 0.0,
        "k_vc_on_the_way_ppm": 0.0,
        "carrier_phase_deg": 0.0,
        "demodulator_phase_deg": 0.0,
    }
    return structs.replace(bench, uncertainty=structs.replace(bench.uncertainty, **same))


LAB = looked_after(test_kvc.LAB)
FIELD_FILE = Path("examples/field-bench.toml")
FIELD = looked_after(vcfbench.load_bench(FIELD_FILE))
QUICK: dict[str, Any] = {"health": False, "cycles": 1, "samples": 5}
RATES = [20.0, 100.0, 200.0]
WARM = {"warm_up_s": 3600.0}
CERTIFICATES: dict[str, Any] = {}


def aged(bench: BenchDescription, **override: Any) -> BenchDescription:
    """Return `bench` with other parameters of the gyroscope."""
    assert bench.simulation is not None
    both = {**bench.simulation.override}
    for group, values in override.items():
        both[group] = {**both.get(group, {}), **values}
    return structs.replace(bench, simulation=structs.replace(bench.simulation, override=both))


def calibrated(where: Path, bench: BenchDescription, seed: int = 1, **settings: Any) -> dict[str, Any]:
    """Calibrate K_Vc on the table, once for all who ask alike; return what self-calibrations of the device are told."""
    asked_settings = {"dut": "G-1", "devices": str(where / "devices"), **QUICK, **settings}
    asked = repr((bench, seed, settings))
    if asked in CERTIFICATES:
        DeviceStore(where / "devices").add(CERTIFICATES[asked])
    else:
        vcfbench.run("kvc", bench, seed=seed, settings={"match_rates_deg_s": RATES, **asked_settings}, runs=where)
        CERTIFICATES[asked] = DeviceStore(where / "devices").certificate("G-1").record
    return {"virtual_rates_deg_s": RATES, **asked_settings}


def run(where: Path, bench: BenchDescription, settings: dict[str, Any], seed: int = 2) -> Any:
    return vcfbench.run("self-calibration", bench, seed=seed, settings=settings, runs=where).results


def nonlinearity_on_the_table() -> float:
    """Return what the table would find at the same rates, ppm, by the closed forms."""
    gyro = warm(physical_parameters(still(LAB)))
    rates = np.array([0.0, *RATES, *(-rate for rate in RATES)])
    outputs = np.array([read_v(gyro, rate) for rate in rates])
    slope, start = np.polyfit(rates, outputs, 1)
    return float(1e6 * np.abs(outputs - slope * rates - start).max() / abs(slope * np.ptp(rates)))


@pytest.fixture(scope="module")
def quiet(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """A device with a certificate, made without noise and errors."""
    where = tmp_path_factory.mktemp("quiet")
    return where, calibrated(where, still(LAB), **WARM)


def test_without_noise_and_errors_the_scale_factor_comes_out(quiet: tuple[Path, dict[str, Any]]) -> None:
    where, settings = quiet
    found = run(where, still(LAB), settings)
    scale_factor, _ = truth(warm(physical_parameters(still(LAB))))
    assert found.scale_factor.value == pytest.approx(scale_factor, rel=1e-6)
    assert found.nonlinearity.value == pytest.approx(nonlinearity_on_the_table(), abs=15.0)
    assert abs(found.drift.change_ppm.value) < 1.0


@pytest.mark.exhaustive
def test_cold_gyroscope_errs_by_stated_warm_up(tmp_path: Path) -> None:
    """The drift of the gyroscope while it warms up: 104 ppm a kelvin, 0.3 K exp(-t / 300 s), mean of the run."""
    cold = calibrated(tmp_path, still(LAB))
    found = run(tmp_path, still(LAB), cold)
    true, _ = truth(warm(physical_parameters(still(LAB))))
    (left,) = [part.u for part in found.scale_factor.parts if part.source == "warm-up"]
    assert 3e-6 < abs(found.scale_factor.value / true - 1.0) <= 1.5 * math.sqrt(3.0) * left / abs(true) < 50e-6


@pytest.mark.parametrize(
    "change",
    few(
        [
            {"output_stage": {"gain": 1.002}},
            {"sense_anti_phase": {"frequency_hz": 3464.1 - 0.05}},
            {"drive_loop": {"amplitude_m": 5.02e-6}, "sense_path": {"reference_amplitude_v": 2.008}},
        ],
        every=3,
    ),
    ids=["output stage", "split", "drive amplitude"],
)
def test_what_ages_is_seen(quiet: tuple[Path, dict[str, Any]], change: dict[str, Any]) -> None:
    where, settings = quiet
    fresh = still(LAB)
    gain = physical_parameters(fresh).output_stage.gain
    if "output_stage" in change:
        change = {"output_stage": {"gain": gain * change["output_stage"]["gain"]}}
    old = aged(fresh, **change)
    before, _ = truth(warm(physical_parameters(fresh)))
    after, _ = truth(warm(physical_parameters(old)))
    here = {**settings, "devices": str(where / "aged" / change.__repr__()[2:8])}
    certificate = DeviceStore(where / "devices").certificate("G-1").record
    DeviceStore(where / "aged" / change.__repr__()[2:8]).add(certificate)
    drift = run(where, old, here).drift
    assert abs(after / before - 1.0) > 500e-6
    assert drift.change_ppm.value == pytest.approx(1e6 * (after / before - 1.0), abs=5.0)
    assert drift.verdict == "fail"


@pytest.mark.exhaustive
def test_changed_combs_look_like_changed_gyroscope(quiet: tuple[Path, dict[str, Any]]) -> None:
    where, settings = quiet
    fresh = still(LAB)
    combs = physical_parameters(fresh).virtual_path
    more = {
        "left_comb_n_per_v2": 1.001 * combs.left_comb_n_per_v2,
        "right_comb_n_per_v2": 1.001 * combs.right_comb_n_per_v2,
    }
    old = aged(fresh, virtual_path=more)
    before, _ = truth(warm(physical_parameters(fresh)))
    after, _ = truth(warm(physical_parameters(old)))
    assert after == pytest.approx(before, rel=1e-9)
    found = run(
        where, old, {**settings, "dut": None, "k_vc": str(DeviceStore(where / "devices").certificate("G-1").path)}
    )
    assert found.scale_factor.value / before - 1.0 == pytest.approx(1e-3, abs=30e-6)
    assert any("combs" in each for each in found.unseen)


@pytest.mark.exhaustive
def test_drawn_instruments_lie_within_u95_and_shared_errors_cancel(tmp_path: Path) -> None:
    settings = calibrated(tmp_path, LAB, seed=5)
    first, second = (run(tmp_path, LAB, settings, seed=5) for _ in range(2))
    scale_factor, _ = truth(warm(physical_parameters(LAB)))
    assert abs(first.scale_factor.value - scale_factor) <= 4.0 * first.scale_factor.u
    assert first.scale_factor.u < 100e-6 * abs(scale_factor)
    assert second.drift.since.startswith("certificate 0001")
    assert second.drift.change_ppm.value == first.drift.change_ppm.value
    assert second.drift.last.since.startswith("self-calibration 0002")
    assert second.drift.last.change_ppm.value == 0.0
    only = {part.source for part in second.drift.last.change_ppm.parts if abs(part.u) > 1e-9}
    assert only == {f"{when}{each}" for when in ("", "then: ") for each in ("readings", "V_Vc readings", "warm-up")}
    assert first.drift.change_ppm.u < first.scale_factor.u / abs(scale_factor) * 1e6
    kept = DeviceStore(tmp_path / "devices").device("G-1").self_calibrations[-1]
    assert isinstance(kept, SelfCalibration)
    assert (kept.certificate, kept.since_last_ppm.value, kept.verdict) == ("0001", 0.0, "pass")  # type: ignore[union-attr]


@pytest.mark.exhaustive
def test_the_field_needs_no_table_and_no_oscilloscope(tmp_path: Path) -> None:
    settings = calibrated(tmp_path, LAB)
    done = vcfbench.run("self-calibration", FIELD, settings=settings, runs=tmp_path)
    assert done.not_checked
    assert vcfbench.load_run(done.directory).results == done.results
    one = structs.replace(FIELD, v_vc_meter=None)
    by_hand = run(tmp_path, one, settings)
    assert by_hand.v_vc_by == "34401A at GPIB0::22::INSTR"
    gain = next(part for part in by_hand.scale_factor.parts if part.source == "V_Vc gain")
    assert gain.u / abs(by_hand.scale_factor.value) == pytest.approx(35e-6 / 4.0, rel=0.01)


def numbered(bench: BenchDescription, **more: Any) -> BenchDescription:
    """Return `bench` with a multimeter whose inventory number is known."""
    return structs.replace(bench, multimeter=structs.replace(bench.multimeter, inventory_number="K-7", **more))  # type: ignore[type-var]


@pytest.mark.exhaustive
def test_same_meter_has_same_number_and_calibration(tmp_path: Path) -> None:
    """At the same address of another bench is another; its gain then counts twice."""
    settings = calibrated(tmp_path, numbered(LAB))
    cancelled, u_ppm = {}, {}
    for name, bench in {
        "same": numbered(FIELD),
        "other": FIELD,
        "calibrated since": numbered(FIELD, calibrated=date(2026, 1, 5)),
    }.items():
        drift = run(tmp_path, bench, settings).drift
        cancelled[name] = {each for each in drift.cancelled if "meter gain" in each}
        u_ppm[name] = drift.change_ppm.u
    assert cancelled == {
        "same": {"meter gain (34401A inventory no. K-7)"},
        "other": set(),
        "calibrated since": set(),
    }
    assert u_ppm["other"] == u_ppm["calibrated since"] > 1.02 * u_ppm["same"]


@pytest.mark.exhaustive
def test_simulated_meters_of_one_seed_are_the_same(tmp_path: Path) -> None:
    """Another seed draws other specimens, at the same address of the same bench."""
    settings = calibrated(tmp_path, LAB)
    same, other = (run(tmp_path, LAB, settings, seed).drift.cancelled for seed in (1, 2))
    assert "meter gain (34401A at GPIB0::22::INSTR of lab, seed 1)" in same
    assert not [each for each in other if "meter gain" in each]


@pytest.mark.exhaustive
def test_trusted_setting_has_accuracy_of_the_generator_ranges(tmp_path: Path) -> None:
    errors = structs.replace(LAB.simulation.errors, rate_source="drawn")
    bench = structs.replace(LAB, simulation=structs.replace(LAB.simulation, errors=errors))
    unknown = structs.replace(bench, uncertainty=structs.replace(bench.uncertainty, generator_ranges_v=None))
    settings = {**calibrated(tmp_path, bench), "v_vc": "set"}
    told, found = (run(tmp_path, each, settings) for each in (bench, unknown))
    ranges = {part.source for part in told.scale_factor.parts if part.rectangular and "V range" in part.source}
    assert len(ranges) == 8  # gain and offset of those that three levels and their zero are on
    assert "V_Vc gain, 3.16 V range" in ranges
    for each in (told, found):
        assert abs(each.drift.change_ppm.value) <= each.drift.change_ppm.u95
    assert (
        0.005
        < told.scale_factor.u / abs(told.scale_factor.value)
        <= found.scale_factor.u / abs(found.scale_factor.value)
    )


@pytest.mark.exhaustive
def test_a_served_bench_tells_its_instruments_apart_by_its_seed(tmp_path: Path) -> None:
    """A server does not say which of its instruments are drawn: all of another seed are others."""
    cancelled = []
    with serve_simulated(LAB, seed=1) as served:
        settings = {**QUICK, "match_rates_deg_s": RATES, "dut": "G-1", "devices": str(tmp_path / "devices")}
        vcfbench.run("kvc", served.on_wires(), settings=settings, runs=tmp_path)
        del settings["match_rates_deg_s"]
        for seed in (1, 2):
            served.reset(seed)
            found = vcfbench.run("self-calibration", served.on_wires(), settings=settings, runs=tmp_path).results
            cancelled.append([each for each in found.drift.cancelled if "seed" in each])
    assert any("meter gain" in each for each in cancelled[0])
    assert not cancelled[1]


def test_serial_number_is_read_if_bench_file_has_none() -> None:
    unknown = PlacedInstrument(
        model="34461A", where="at TCPIP::meter", station="lab", calibrated="calibrated 2026-01-05"
    )
    assert unknown.owner == "34461A at TCPIP::meter of lab, calibrated 2026-01-05"
    assert unknown.answering("MY5320").owner == "34461A no. MY5320, calibrated 2026-01-05"
    assert unknown.answering("0") == unknown.answering("") == unknown
    stated = PlacedInstrument(model="34401A", where="inventory no. K-7")
    assert stated.answering("MY5320") == stated


def test_a_number_will_do(tmp_path: Path) -> None:
    found = run(tmp_path, FIELD, {"k_vc": "150", "k_vc_u_deg_s_per_v": 0.15, **QUICK})
    assert found.drift is None
    assert found.k_vc_from == "K_Vc = 150 (deg/s)/V, as given"
    assert found.scale_factor.u / abs(found.scale_factor.value) == pytest.approx(1e-3, rel=0.05)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({}, "K_Vc is not known: --dut SERIAL"),
        ({"dut": "G-404"}, "has no certificate"),
        ({"k_vc": "0"}, "other than 0"),
        ({"k_vc": "nowhere.json"}, "nowhere.json"),
        ({"k_vc": "150", "virtual_rates_deg_s": [0.0, 10.0]}, "without 0"),
        (
            {"k_vc": "15"},
            r"virtual_rates_deg_s: .* V of V_Vc, the bench allows .* \(limits.max_v_vc_v\)",
        ),
        ({"k_vc": "150", "v_vc_range_v": 1}, "v_vc_range_v: expected a range for 1.333 V, the V_Vc of 200 deg/s"),
    ],
)
def test_without_k_vc_nothing_is_opened(settings: dict[str, Any], said: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=said):
        vcfbench.run("self-calibration", FIELD, settings={"devices": str(tmp_path / "d"), **settings}, runs=tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_certificate_that_is_out_of_date_is_refused(tmp_path: Path) -> None:
    settings = calibrated(tmp_path, LAB)
    store = DeviceStore(tmp_path / "devices")
    known = store.certificate("G-1").record
    store.add(structs.replace(known, valid_until=known.issued))  # type: ignore[union-attr]
    with pytest.raises(ConfigError, match=r"0002\.json: the certificate is valid from .* not now"):
        vcfbench.dry_run("self-calibration", FIELD, settings=settings)
    assert vcfbench.dry_run("self-calibration", FIELD, settings={**settings, "outdated": True}).steps
    with pytest.raises(ConfigError, match=r"K_Vc is known from -2.* deg/s, not at 400"):
        vcfbench.dry_run(
            "self-calibration", FIELD, settings={**settings, "outdated": True, "virtual_rates_deg_s": [10.0, 400.0]}
        )


@pytest.mark.exhaustive
def test_a_limit_of_the_drift_has_a_guard_band(quiet: tuple[Path, dict[str, Any]]) -> None:
    where, settings = quiet
    settings = {**settings, "devices": str(fresh_store(where, "limited").root)}
    found = run(where, still(LAB), {**settings, "max_drift_ppm": 500.0}).drift
    assert [each.key for each in found.limits] == ["drift_ppm", "failed_before"]
    assert found.verdict == "pass"
    assert run(where, still(LAB), {**settings, "max_drift_ppm": 1.0}).drift.verdict == "marginal"


def test_a_limit_of_a_drift_says_what_its_u95_lacks() -> None:
    then = Reference(
        name="0001", kind="certificate", done="2026-05-04", scale_factor_v_per_deg_s=Measured(value=-0.0125, u=1e-6)
    )
    curve = KvcCurve(coefficients=(0.0, 150.0), covariance=((0.0, 0.0), (0.0, 0.0)), v_vc_min_v=-1.0, v_vc_max_v=1.0)
    known = KnownDevice(k_vc=curve, source="certificate 0001", certificate="0001", reference=then)
    now = measurand(-0.0125, "V/(deg/s)", [UncertaintyPart("readings", 1e-6)], ["temperature"])
    limits = [Limit("drift_ppm", -500.0, 500.0, guarded=True), Limit("bias_v", 0.0, 1.0), Limit("cusum", 0.0, 5.0)]
    drift = drift_of(now, known, limits)
    assert drift is not None
    seen = [(each.key, each.u95, each.missing) for each in drift.limits]
    assert seen == [("drift_ppm", drift.change_ppm.u95, ("temperature",)), ("cusum", None, ())]
    assert drift.verdict == "pass"


def test_a_drift_has_other_temperatures_and_rails_taken_off() -> None:
    slope = Measured(value=-0.0125, u=1e-7)
    then = [
        Reference(name=name, kind=kind, done="2026-05-04", scale_factor_v_per_deg_s=slope, **under)
        for name, kind, under in (
            ("0001", "certificate", {"temperature_c": 20.0, "rails_v": (10.0, -10.0)}),
            ("0002", "self-calibration", {"temperature_c": 20.0, "rails_v": (10.0, -10.0)}),
        )
    ]
    curve = KvcCurve(coefficients=(0.0, 150.0), covariance=((0.0, 0.0), (0.0, 0.0)), v_vc_min_v=-1.0, v_vc_max_v=1.0)
    slopes = {"table_slope_ppm_k": Measured(value=-104.0, u=1.0), "table_slope_ppm_v": Measured(value=375.0, u=10.0)}
    known = KnownDevice(k_vc=curve, source="c", certificate="0001", reference=then[0], history=(then[1],))
    now = measurand(-0.0125 * (1.0 - 520e-6 + 150e-6), "V/(deg/s)", [UncertaintyPart("readings", 1e-7)])
    here = Here(25.0, (10.4, -10.4), 500.0)
    ignored, unknown = drift_of(now, known, []), drift_of(now, known, [], here)
    taken = drift_of(now, structs.replace(known, characteristics=Characteristics(**slopes)), [], here)
    assert ignored is not None
    assert unknown is not None
    assert taken is not None
    assert ignored.e_n > 10.0
    assert ignored.cusum > 5.0
    assert taken.change_ppm.value == pytest.approx(0.0, abs=0.1)
    assert (taken.e_n, taken.cusum) == pytest.approx((0.0, 0.0), abs=0.1)
    assert taken.since.endswith("(corrected for +5 K: -520 ppm; +0.4 V of both rails: +150 ppm)")
    assert unknown.e_n < 1.0  # of which 500 ppm/K are the limit
    assert "no temperature coefficient of the device is known" in unknown.since


def fresh_store(where: Path, name: str) -> DeviceStore:
    """Return a store with the certificate alone."""
    store = DeviceStore(where / name)
    store.add(DeviceStore(where / "devices").certificate("G-1").record)
    return store


@pytest.mark.exhaustive
def test_drift_limit_of_the_bench_file_fails_the_run(quiet: tuple[Path, dict[str, Any]]) -> None:
    where, settings = quiet
    limits = AcceptanceLimits(guard_band="U95", drift_ppm=(-200.0, 200.0), e_n=(0.0, 1.0))
    fresh = structs.replace(still(LAB), acceptance=limits)
    old = aged(fresh, output_stage={"gain": 1.002 * physical_parameters(fresh).output_stage.gain})
    settings = {**settings, "devices": str(fresh_store(where, "judged").root)}
    passed, failed = (vcfbench.run("self-calibration", bench, settings=settings, runs=where) for bench in (fresh, old))
    assert passed.verdict.as_json()["verdict"] == "pass"
    judged = {each.key: each.word for each in failed.verdict.limits}
    assert judged == {"drift_ppm": "fail", "e_n": "fail", "failed_before": "pass"}
    assert not failed.verdict.passed


@pytest.mark.exhaustive
def test_a_drift_that_failed_stays_until_a_new_certificate(quiet: tuple[Path, dict[str, Any]]) -> None:
    """It is counted from the certificate, so that the same run again does not pass; nor does one that is back there."""
    where, settings = quiet
    store = fresh_store(where, "failed")
    old = aged(still(LAB), output_stage={"gain": 0.999 * physical_parameters(still(LAB)).output_stage.gain})
    told = {**settings, "devices": str(store.root)}
    runs = where / "failed-runs"

    def done(bench: BenchDescription) -> Any:
        return vcfbench.run("self-calibration", bench, settings=told, runs=runs)

    first, again, back = done(old), done(old), done(still(LAB))
    for each in (first, again):
        assert each.results.drift.since.startswith("certificate 0001")
        assert each.results.drift.change_ppm.value == pytest.approx(-1000.0, abs=5.0)
        assert each.verdict.word == "fail"
    assert again.results.drift.last is None  # a second look, made without the first
    assert {each.key for each in back.verdict.limits if each.word == "fail"} == {
        "e_n_since_last",
        "cusum",
        "failed_before",
    }
    assert back.results.drift.e_n < 1.0
    assert back.results.drift.failed_before == ("0002", "0003")
    assert "until a rate table gives it a new certificate" in vcfbench.text_of(back.report())
    assert store.device("G-1").failed_since.name == "0002"  # type: ignore[union-attr]
    assert [each.verdict for each in vcfbench.run_summaries(runs)] == ["fail"] * 3
    listed = StationDirectories(runs, store.root).listed()
    assert [each["verdict"] for each in listed["runs"]] == ["fail"] * 3
    assert listed["devices"] == [{"serial": "G-1", "entries": 4, "failed_since": "0002"}]
    shown = CliRunner().invoke(app, ["device", "--devices", str(store.root)], color=True).stdout
    assert shown.startswith("G-1  \x1b[31m\x1b[1mFAILED\x1b[0m since entry 0002")
    shown = CliRunner().invoke(app, ["runs", "list", "--runs", str(runs)], color=True).stdout
    assert shown.count("\x1b[31m\x1b[1mFAIL\x1b[0m") == 3
    store.add(DeviceStore(where / "devices").certificate("G-1").record)
    assert done(still(LAB)).verdict.word == "pass"
    assert store.device("G-1").failed_since is None


def test_unchanged_gyroscope_rarely_fails_in_100_years() -> None:
    """By E_n since the certificate and since the last entry, and by the creep, all as they are computed."""
    years = 4000
    for of_certificate in (0.3, 1.0, 2.0):  # its u, in that of a morning
        rng = np.random.default_rng(1)
        off = of_certificate * rng.standard_normal(years)
        last, kept, sums, failed = np.zeros(years), np.zeros(years), np.zeros((2, years)), np.zeros(years, dtype=bool)
        for day in range(365):
            now = off + rng.standard_normal(years)
            e_n = np.abs(now) / math.hypot(of_certificate, 1.0) / 1.96
            since_last = np.abs(now - last) / math.sqrt(2.0) / 1.96 * (day > 0)
            known = 1.0 / (1.0 / of_certificate**2 + day)
            moved = (now - known * kept) / math.sqrt(1.0 + known)
            sums = np.maximum(0.0, sums + np.array([moved, -moved]) - 0.5)
            failed |= (np.maximum(e_n, since_last) > E_N_ACTION) | (sums.max(axis=0) > CUSUM_ACTION)
            last, kept = now, kept + now
        assert 0.0 < failed.mean() < 0.02


def test_failed_drift_without_confirmation_was_chance(quiet: tuple[Path, dict[str, Any]]) -> None:
    where, settings = quiet
    store = fresh_store(where, "second-look")
    old = aged(still(LAB), output_stage={"gain": 0.999 * physical_parameters(still(LAB)).output_stage.gain})
    told = {**settings, "devices": str(store.root)}

    def done(bench: BenchDescription) -> Any:
        return vcfbench.run("self-calibration", bench, settings=told, runs=where / "second-look-runs")

    failed = done(old)
    assert failed.verdict.word == "fail"
    assert "repeat the run: it does not use this result" in vcfbench.text_of(failed.report())
    assert store.device("G-1").failed_since.name == "0002"  # type: ignore[union-attr]  # until somebody looks again
    second, third = done(still(LAB)), done(still(LAB))
    assert (second.verdict.word, third.verdict.word) == ("pass", "pass")
    assert store.device("G-1").failed_since is None
    assert third.results.drift.last.since.startswith("self-calibration 0003")


@pytest.mark.exhaustive
def test_daily_runs_without_oscilloscope_find_step(tmp_path: Path) -> None:
    """What nobody measures of K_Vc is the same in all of them: it hides a change since the certificate alone."""
    settings = calibrated(tmp_path, test_kvc.LAB, **WARM)
    blind = structs.replace(test_kvc.LAB, oscilloscope=None)
    gain = 0.9995 * physical_parameters(blind).output_stage.gain
    benches = (blind, blind, aged(blind, output_stage={"gain": gain}))
    mornings = [run(tmp_path, bench, settings, seed).drift for seed, bench in enumerate(benches, 2)]
    assert [each.verdict for each in mornings] == ["pass", "pass", "fail"]
    assert all(each.change_ppm.u > 500.0 for each in mornings)
    assert all(each.last.change_ppm.u < 60.0 for each in mornings[1:])
    assert mornings[2].e_n < 1.0 < E_N_ACTION < mornings[2].last.e_n
    assert mornings[2].last.change_ppm.value == pytest.approx(-500.0, abs=150.0)


def test_levels_are_where_the_curve_has_the_rates(quiet: tuple[Path, dict[str, Any]]) -> None:
    where, _ = quiet
    curve = DeviceStore(where / "devices").certificate("G-1").record.k_vc  # type: ignore[union-attr]
    for rate_deg_s in (-200.0, -1.0, 35.0, 200.0):
        assert curve.rate_deg_s(level_for(curve, rate_deg_s, "rates")) == pytest.approx(rate_deg_s, abs=0.01)
    assert level_for(curve, 0.0, "rates") == 0.0


@pytest.mark.parametrize("bent", [6.0, -6.0])
def test_a_level_beyond_the_bench_s_limit_is_refused_on_either_side(
    bent: float, quiet: tuple[Path, dict[str, Any]]
) -> None:
    """150 V + 6 V^2 = -200 has its root at -1.413 V; for +200 deg/s 1.27 V do."""
    where, settings = quiet
    curve = KvcCurve(coefficients=(0.0, 150.0, bent), covariance=((0.0,) * 3,) * 3, v_vc_min_v=-2.0, v_vc_max_v=2.0)
    known = {
        **dated_back(where, settings, f"bent {bent}", 0.0, k_vc=curve),
        "virtual_rates_deg_s": [50.0, 100.0, 200.0],
    }
    bench = structs.replace(still(LAB), limits=structs.replace(LAB.limits, max_v_vc_v=1.35))
    side = math.copysign(200.0, -bent)
    with pytest.raises(ConfigError, match=rf"virtual_rates_deg_s: {side:g} deg/s needs 1.413 V of V_Vc"):
        vcfbench.dry_run("self-calibration", bench, settings=known)


@pytest.mark.parametrize(("name", "key"), [("kvc", "match_rates_deg_s"), ("self-calibration", "virtual_rates_deg_s")])
def test_rates_of_either_sign_are_one_magnitude(name: str, key: str) -> None:
    told = {key: [-200.0, 20.0, -20.0, 80.0, 200.0], **({"k_vc": "150"} if name == "self-calibration" else {})}
    settings: Any = settings_of(PROCEDURES[name], LAB, asked_in_python(told))
    assert settings.magnitudes_deg_s == (20.0, 80.0, 200.0)


def test_levels_may_be_beyond_the_curve_by_a_twentieth_of_its_half(quiet: tuple[Path, dict[str, Any]]) -> None:
    where, settings = quiet
    done = vcfbench.run("self-calibration", still(LAB), seed=2, settings=settings, runs=where)
    procedure: Any = PROCEDURES["self-calibration"]
    chosen: Any = recorded_settings(procedure, done.header["settings"])
    largest_v = max(each.v_vc_v for each in done.results.levels)

    def evaluated(low_v: float, half_v: float) -> None:
        known = chosen.station.known
        curve = structs.replace(known.k_vc, v_vc_min_v=low_v, v_vc_max_v=low_v + 2.0 * half_v)
        station = structs.replace(chosen.station, known=structs.replace(known, k_vc=curve))
        procedure.results(structs.replace(chosen, station=station), done.measured)

    for low_v in (-1.1 * largest_v, -2.0 * largest_v):
        just_v = (largest_v - low_v) / 2.05
        evaluated(low_v, 1.001 * just_v)
        with pytest.raises(ConfigError, match="K_Vc is known from"):
            evaluated(low_v, 0.999 * just_v)


@pytest.mark.exhaustive
def test_failed_drift_ends_with_1_each_time(tmp_path: Path) -> None:
    settings = calibrated(tmp_path, LAB)
    gain = 0.97 * physical_parameters(FIELD).output_stage.gain
    old = tmp_path / "old.toml"
    text = FIELD_FILE.read_text(encoding="utf-8")
    old.write_text(f"{text}\n[simulation.override.output_stage]\ngain = {gain}\n", encoding="utf-8")
    where = ["--runs", str(tmp_path / "runs"), "--devices", settings["devices"], "--dut", "G-1", "--quiet"]
    sets = ["--set", "cycles=1", "--set", "samples=5", "--set", "virtual_rates_deg_s=[20,100,200]"]
    command = ["run", "self-calibration", "--bench", str(old), *where, *sets]
    for seed in ("3", "4"):
        done = CliRunner().invoke(app, [*command, "--seed", seed])
        assert done.exit_code == 1, done.output
        assert "FAIL" in done.stdout


def test_the_command_answers_in_text_and_json(tmp_path: Path) -> None:
    settings = calibrated(tmp_path, LAB)
    where = ["--runs", str(tmp_path / "runs"), "--devices", settings["devices"], "--dut", "G-1", "--quiet"]
    sets = ["--set", "cycles=1", "--set", "samples=5", "--set", "virtual_rates_deg_s=[20,100,200]"]
    command = ["run", "self-calibration", "--bench", "examples/field-bench.toml", "--seed", "3", *where, *sets]
    text = CliRunner().invoke(app, [*command, "-v"])
    assert text.exit_code == 0, text.output
    assert "drift since certificate 0001" in text.stdout
    assert "0002.json" in text.stdout
    numbers = ["--dut", "0042", "--k-vc", "150", *sets]
    dry = CliRunner().invoke(
        app, ["run", "self-calibration", "--bench", "examples/field-bench.toml", "--dry-run", *numbers]
    )
    assert dry.exit_code == 0, dry.output
    answer = json.loads(CliRunner().invoke(app, [*command, "--json"]).stdout)
    assert answer["results"]["drift"]["last"]["since"].startswith("self-calibration 0002")
    assert answer["device_entry"].endswith("0003.json")
    assert set(answer["results"]["scale_factor"]) >= {"value", "u", "dof", "coverage_factor", "expanded_u", "parts"}
    assert isinstance(vcfbench.load_run(tmp_path / "runs" / answer["run"]).results, SelfCalibrationResult)


def test_numeric_k_vc_lists_its_unknown_parts(tmp_path: Path) -> None:
    few = {"k_vc": "150", "samples": 3, "virtual_rates_deg_s": [50.0, 100.0], "cycles": 1}
    found = vcfbench.run("self-calibration", "lab", seed=1, settings=few, runs=tmp_path).results
    assert any("k_vc_u_deg_s_per_v" in each for each in found.holds_not)
    assert any("combs" in each for each in found.unseen)


def dated_back(where: Path, settings: dict[str, Any], name: str, days: float, **change: Any) -> dict[str, Any]:
    """Return the settings with another store, in which the certificate is older, and otherwise changed."""
    record = DeviceStore(where / "devices").certificate("G-1").record
    assert isinstance(record, Certificate)
    past = timedelta(days=days)
    until = record.valid_until + timedelta(days=3650) if record.valid_until else None
    DeviceStore(where / name).add(structs.replace(record, issued=record.issued - past, valid_until=until, **change))
    return {**settings, "devices": str(where / name)}


@pytest.mark.exhaustive
def test_unseen_drift_widens_u95_with_time(quiet: tuple[Path, dict[str, Any]]) -> None:
    """Rectangular: 500 ppm a year are assumed, 0.95 of that is what U95 has of it alone."""
    where, settings = quiet
    bench = structs.replace(still(LAB), uncertainty=structs.replace(LAB.uncertainty, k_vc_drift_ppm_per_year=100.0))
    size = truth(warm(physical_parameters(still(LAB))))[0]
    today = run(where, still(LAB), dated_back(where, settings, "today", 0.0)).scale_factor
    assert not any("drift" in part.source for part in today.parts)
    later = run(where, still(LAB), dated_back(where, settings, "year", 365.25))
    (part,) = [part for part in later.scale_factor.parts if "drift" in part.source]
    assert 1e6 * part.u / abs(size) == pytest.approx(500.0 / math.sqrt(3.0), rel=0.01)
    assert 1e6 * later.scale_factor.u95 / abs(size) == pytest.approx(475.0, rel=0.03)
    assert any("500 ppm per year, assumed" in each for each in later.since)
    told = run(where, bench, dated_back(where, settings, "told", 2 * 365.25))
    assert 1e6 * told.scale_factor.u95 / abs(size) == pytest.approx(195.0, rel=0.05)
    assert any("uncertainty.k_vc_drift_ppm_per_year" in each for each in told.since)
    (of_drift,) = [part for part in later.drift.change_ppm.parts if "drift" in part.source]
    assert of_drift.u == pytest.approx(500.0 / math.sqrt(3.0), rel=0.01)


@pytest.mark.exhaustive
def test_shift_on_the_way_is_in_u95_from_first_day(tmp_path: Path) -> None:
    """A shift within the key's limit, any as likely: a pick-off by 0.2 % was 8 to 11 U95."""
    settings = calibrated(tmp_path, still(LAB), **WARM)
    bench = structs.replace(LAB, uncertainty=structs.replace(LAB.uncertainty, k_vc_on_the_way_ppm=300.0))
    first, second = (run(tmp_path, still(bench), settings) for _ in range(2))
    size, rng = abs(first.scale_factor.value), np.random.default_rng(1)
    shifts_ppm = rng.uniform(-300.0, 300.0, 2000)
    within = np.abs(shifts_ppm) <= 1e6 * first.scale_factor.u95 / size
    assert 0.93 < within.mean() < 0.975
    assert any("in transport" in each for each in second.drift.last.cancelled)  # the same in both
    assert second.drift.last.change_ppm.u < 30.0


@pytest.mark.exhaustive
def test_temperatures_that_were_told_are_compared_and_k_vc_corrected(quiet: tuple[Path, dict[str, Any]]) -> None:
    """By the coefficient that was measured, or else by that of silicon; without either nothing is known."""
    where, settings = quiet
    hot = aged(still(LAB), thermal={"ambient_c": 35.0})
    gyro = physical_parameters(still(LAB))
    size = abs(warm_k(hot))
    at_20 = {"temperature_c": Measured(value=20.3, u=0.0), "k_vc_ppm_k": Measured(value=29.6, u=0.3)}
    known = dated_back(where, settings, "measured", 0.0, characteristics=Characteristics(**at_20))
    blind = run(where, hot, known).scale_factor
    done = vcfbench.run("self-calibration", hot, seed=2, settings={**known, "temperature_c": 35.3}, runs=where)
    told, procedure = done.results, PROCEDURES["self-calibration"]
    seen = structs.replace(told, characteristics=Characteristics(temperature_c=Measured(value=35.3, u=0.0)))
    report = procedure.report(recorded_settings(procedure, done.header["settings"]), done.measured, seen)
    (said,) = re.findall(r"scale factor has changed by ([-+]\d+) ppm", vcfbench.text_of(report))
    assert float(said) == pytest.approx(1e6 * (warm_k(hot) / warm_k(still(LAB)) - 1.0), abs=10.0)
    assert gyro.thermal.ambient_c == 20.0
    assert 1e6 * (abs(blind.value) / size - 1.0) == pytest.approx(445.0, abs=10.0)
    assert 1e6 * (abs(told.scale_factor.value) / size - 1.0) == pytest.approx(0.0, abs=5.0)
    assert any("+444" in each and "measured" in each for each in told.since)
    (part,) = [part for part in told.scale_factor.parts if "temperature since" in part.source]
    assert 1e6 * part.u / size == pytest.approx(0.3 * 15.0, rel=0.01)
    alone = Characteristics(temperature_c=at_20["temperature_c"])
    silicon = dated_back(where, settings, "silicon", 0.0, characteristics=alone)
    assumed = run(where, hot, {**silicon, "temperature_c": 35.3}).scale_factor
    assert assumed.u / size == pytest.approx(15.0 / math.sqrt(3.0) * 15e-6, rel=0.1)
    assert abs(abs(assumed.value) - size) < assumed.u
    with pytest.raises(ConfigError, match=r"0.3 to 40.3 degC.*not at 45"):
        run(where, hot, {**silicon, "temperature_c": 45.0})
    ranged = Characteristics(**at_20, least_temperature_c=10.0, most_temperature_c=30.0)
    with pytest.raises(ConfigError, match=r"10 to 30 degC .where its coefficients were measured., not at 35.3"):
        run(where, hot, {**dated_back(where, settings, "ranged", 0.0, characteristics=ranged), "temperature_c": 35.3})


def warm_k(bench: BenchDescription) -> float:
    """Return the scale factor at rest of the gyroscope at the ambient of `bench`, by the closed forms."""
    parameters = physical_parameters(bench)
    rise = parameters.thermal.ambient_c - parameters.thermal.reference_c
    hotter = structs.replace(parameters.thermal, self_heating_k=parameters.thermal.self_heating_k + rise)
    return truth(warm(structs.replace(parameters, thermal=hotter)))[0]


@pytest.mark.exhaustive
def test_zero_of_another_generator_leaves_scale_factor(quiet: tuple[Path, dict[str, Any]]) -> None:
    """The output is curved, 17 ppm a deg/s: the slope is stated at rate 0 of the certificate's curve."""
    where, settings = quiet
    other = still(LAB, rate_source={"ranges": [{"upper_v": 10.0, "gain_error": 0.0, "offset_error_v": 4.5e-3}]})
    found = run(where, other, dated_back(where, settings, "other", 0.0))
    true, _ = truth(warm(physical_parameters(still(LAB))))
    assert found.scale_factor.value == pytest.approx(true, rel=2e-6)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_number_unlike_the_known_k_vc_is_refused(sign: float, tmp_path: Path) -> None:
    """By the guess of the bench file, or the certificate of the device, whatever K_Vc of the two has."""
    guessed = {**QUICK, "k_vc_guess_deg_s_per_v": sign * 150.0, "devices": str(tmp_path / "devices")}
    with pytest.raises(ConfigError, match=r"--k-vc .*150.0: expected -?15.* about -?150 .*k_vc_guess_deg_s_per_v"):
        run(tmp_path, LAB, {**guessed, "k_vc": str(-150.0 * sign)})
    curve = KvcCurve(
        coefficients=(0.0, -sign * 150.0), covariance=((0.0, 0.0), (0.0, 1.0)), v_vc_min_v=-1.5, v_vc_max_v=1.5
    )
    when = utc_now()
    DeviceStore(tmp_path / "devices").add(
        Certificate(serial="G-1", issued=when, procedure="kvc", k_vc=curve, conditions=CONDITIONS)
    )
    with pytest.raises(ConfigError, match=r"expected .* about -?150 .*certificate 0001"):
        run(tmp_path, LAB, {**guessed, "dut": "G-1", "k_vc": str(150.0 * sign)})
    with pytest.raises(ConfigError, match=r"expected .* about -?150 .*certificate 0001"):
        run(tmp_path, LAB, {**guessed, "dut": "G-1", "k_vc": str(-300.0 * sign)})


@pytest.mark.parametrize("procedure", few(["self-calibration", "online"], "self-calibration"))
def test_scale_factor_of_the_wrong_sign_is_refused(procedure: str, tmp_path: Path) -> None:
    expected = structs.replace(LAB.expected, scale_factor_v_per_deg_s=(0.012, 0.013))
    own = {"self-calibration": QUICK, "online": {"warm_up_s": 60.0, "duration_s": 10.0}}[procedure]
    with pytest.raises(MeasurementError, match=r"sign of the scale factor is wrong: expected 0\.0125 V/\(deg/s\)"):
        vcfbench.run(
            procedure, structs.replace(LAB, expected=expected), seed=2, settings={**own, "k_vc": "150"}, runs=tmp_path
        )
