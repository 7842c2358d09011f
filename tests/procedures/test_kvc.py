"""The calibration of K_Vc on the simulated bench, against the modulator and scale factor that its parameters make."""

from __future__ import annotations

import json
import math
from datetime import UTC, datetime
from random import Random
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from msgspec import structs
from simrack_tests.cells import few
from typer.testing import CliRunner

import vcfbench
from tests.sim.gyro.plain import output_v, steady_output_v
from vcfbench.analysis.k_vc_curve import fit_k_vc_curve
from vcfbench.cli.main import app
from vcfbench.errors import ConfigError, MeasurementError
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.procedures.kvc import KVC, UNSEEN, _as_set
from vcfbench.records.device_values import Characteristics, Conditions, Measured
from vcfbench.records.devices import Certificate, Characterisation, DeviceStore
from vcfbench.sim.simulation import physical_parameters
from vcfbench.station.file import embedded_text
from vcfbench.station.settings import Sources
from vcfbench.values.sources import RESOLUTION, V_VC_GAIN, V_VC_OFFSET

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench.sim.parameters import BenchParameters
    from vcfbench.station.description import BenchDescription

LAB = vcfbench.load_bench("lab")
QUICK: dict[str, Any] = {"health": False, "cycles": 1, "samples": 5, "match_rates_deg_s": [20.0, 100.0, 200.0]}


def still(bench: BenchDescription, **errors: Any) -> BenchDescription:
    """Return `bench` with noise and pick-up off, and the errors of each instrument as told, else none."""
    off = dict.fromkeys(("power", "rate_source", "multimeter", "v_vc_meter", "rate_table"), "none")
    simulation = structs.replace(
        bench.simulation,
        errors=structs.replace(bench.simulation.errors, **{**off, **errors}),
        override={
            "noise": {"angle_random_walk_deg_sqrt_s": 0.0, "bias_instability_deg_s": 0.0},
            "table": {
                "rate_error": 0.0,
                "flutter_per_sqrt_hz": 0.0,
                "ripple_arcsec": [],
                "ripple_harmonic": [],
                "ripple_phase_rad": [],
            },
            "pick_up": {"meter_leads_v": 0.0, "v_vc_lead_v": 0.0},
        },
    )
    return structs.replace(bench, simulation=simulation)


def warm(parameters: BenchParameters) -> BenchParameters:
    """Return the gyroscope at the temperature that it comes to by its own heat."""
    heat = parameters.thermal.self_heating_k

    def at(mode: Any) -> Any:
        return structs.replace(
            mode,
            frequency_hz=mode.frequency_hz * (1.0 + mode.frequency_coefficient_per_k * heat),
            quality=mode.quality * (1.0 + mode.quality_coefficient_per_k * heat),
        )

    return structs.replace(
        parameters,
        drive_mode=at(parameters.drive_mode),
        sense_in_phase=at(parameters.sense_in_phase),
        sense_anti_phase=at(parameters.sense_anti_phase),
    )


def read_v(parameters: BenchParameters, rate_deg_s: float, multiplicand_v: float = 0.0) -> float:
    """Return what a multimeter reads, V, by the closed forms: more than 10 Gohm do not load the output."""
    earth_rad_s = math.radians(15.041067 / 3600.0) * math.sin(math.radians(parameters.site.latitude_deg))
    filtered_v = steady_output_v(parameters, earth_rad_s + math.radians(rate_deg_s), multiplicand_v)
    return output_v(parameters, filtered_v)


def truth(parameters: BenchParameters) -> tuple[float, float]:
    """Return scale factor at rest, V/(deg/s), and K_Vc of small signals, (deg/s)/V."""
    small, on = 0.01, parameters.virtual_path.offset_v
    scale_factor = (read_v(parameters, small) - read_v(parameters, -small)) / (2.0 * small)
    per_v = (read_v(parameters, 0.0, on + 1e-4) - read_v(parameters, 0.0, on - 1e-4)) / 2e-4
    return scale_factor, per_v / scale_factor


def test_without_noise_and_errors_the_parameters_come_out(tmp_path: Path) -> None:
    bench = still(LAB)
    found = vcfbench.run("kvc", bench, settings={"warm_up_s": 3600.0, **QUICK}, runs=tmp_path).results
    scale_factor, k_vc = truth(warm(physical_parameters(bench)))
    assert found.scale_factor.value == pytest.approx(scale_factor, rel=1e-6)
    assert found.k_vc.value == pytest.approx(k_vc, rel=1e-6)
    assert found.curvature.second_per_v == pytest.approx(0.013, rel=0.01)
    assert found.curvature.third_per_v2 == pytest.approx(0.0145, rel=0.01)


@pytest.mark.exhaustive
@pytest.mark.parametrize("by", few(["v_vc_meter", "hand"], "v_vc_meter"))
def test_what_is_measured_with_drawn_instruments_is_within_its_uncertainty(by: str, tmp_path: Path) -> None:
    errors = structs.replace(LAB.simulation.errors, rate_source="drawn")
    bench = structs.replace(LAB, simulation=structs.replace(LAB.simulation, errors=errors))
    if by == "hand":
        bench = structs.replace(bench, v_vc_meter=None)
    run = vcfbench.run("kvc", bench, seed=7, settings=QUICK, runs=tmp_path)
    scale_factor, k_vc = truth(warm(physical_parameters(bench)))
    for found, true in ((run.results.scale_factor, scale_factor), (run.results.k_vc, k_vc)):
        assert abs(found.value - true) <= 4.0 * found.u
        assert found.u <= 100e-6 * abs(true)
        assert sum(part.u**2 for part in found.parts) == pytest.approx(found.u**2)
    again = vcfbench.load_run(run.directory)
    assert again.results == run.results
    assert ("its leads moved by hand" in run.results.v_vc_by) == (by == "hand")


def between_ranges(seed: int) -> tuple[BenchDescription, float]:
    """Return a bench and a rate whose level, about 20 mV, lies between the ends of two ranges of its generator."""
    chance = Random(seed)  # noqa: S311  # no secret
    jump_v, rate_deg_s = chance.uniform(4e-3, 4.9e-3), chance.uniform(3.0, 3.3)
    first = "{ upper_v = 0.1, gain_error = 0.0, offset_error_v = "
    two = f"{{ upper_v = 0.02, gain_error = 0.0, offset_error_v = -{jump_v} }},\n    {first}{jump_v}"
    return parse_bench(embedded_text("lab").replace(f"{first}0.0", two), "lab.toml"), rate_deg_s


def test_one_match_between_ranges_is_refused_with_what_cures_it() -> None:
    bench, rate_deg_s = between_ranges(0)
    with pytest.raises(MeasurementError, match=r"does not reach the output of step 1.*choose another match_rate_deg_s"):
        vcfbench.run("virtual-coriolis", bench, settings={"match_rate_deg_s": rate_deg_s}, seed=0, runs=None)


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", few(range(6), 0))
def test_a_rate_whose_level_no_range_of_the_generator_has_is_matched(seed: int) -> None:
    bench, rate_deg_s = between_ranges(seed)
    settings = {**QUICK, "match_rates_deg_s": (rate_deg_s, 20.0, 50.0, 100.0, 200.0), "health": False}
    found = vcfbench.run("kvc", bench, settings=settings, seed=seed, runs=None).results
    _, k_vc = truth(warm(physical_parameters(bench)))
    assert abs(found.k_vc.value - k_vc) < 3.0 * found.k_vc.u
    assert found.curve.lack_of_fit_p > 1e-3


@pytest.mark.parametrize("seed", few([7, 8, 9]))
def test_trusted_setting_has_accuracy_of_the_generator_ranges(seed: int, tmp_path: Path) -> None:
    errors = structs.replace(LAB.simulation.errors, rate_source="drawn")
    bench = structs.replace(LAB, v_vc_meter=None, simulation=structs.replace(LAB.simulation, errors=errors))
    unknown = structs.replace(bench, uncertainty=structs.replace(bench.uncertainty, generator_ranges_v=None))
    settings = {"v_vc": "set", **QUICK}
    told, found = (
        vcfbench.run("kvc", each, seed=seed, settings=settings, runs=tmp_path).results for each in (bench, unknown)
    )
    ranges = {part.source for part in told.k_vc.parts if part.rectangular}
    assert "V_Vc gain, 3.16 V range" in ranges
    assert len(ranges) == 6
    true = truth(warm(physical_parameters(bench)))[1]  # at the input: 50 ohm take 5e-4 or less of the open level
    for k_vc in (told.k_vc, found.k_vc):
        assert abs(k_vc.value - true) <= k_vc.u95
        assert sum(part.u**2 for part in k_vc.parts) == pytest.approx(k_vc.u**2)
    assert 0.005 * true < told.k_vc.u <= found.k_vc.u
    assert math.sqrt(told.curve.covariance[1][1]) == pytest.approx(told.k_vc.u)
    assert "setting" in told.v_vc_by


@pytest.mark.exhaustive
def test_the_certificate_is_written_when_the_run_is_over(tmp_path: Path) -> None:
    store = DeviceStore(tmp_path / "devices")
    settings = {"dut": "G-0042", "devices": str(store.root), "temperature_c": 21.5, **QUICK}
    run = vcfbench.run("kvc", LAB, seed=1, settings=settings, runs=tmp_path)
    entry = store.certificate("G-0042")
    assert run.device_entry == entry.path
    known = entry.record
    assert isinstance(known, Certificate)
    assert known.k_vc.coefficients == run.results.curve.coefficients
    assert known.unseen == UNSEEN
    assert (known.valid_until - known.issued).days == 365  # type: ignore[operator]
    assert known.conditions.temperature_c == 21.5
    assert set(known.conditions.instruments) >= {"multimeter", "v_vc_meter", "rate_table", "rate_source", "power"}
    summed = [[math.fsum(each.covariance[i][j] for each in known.k_vc.shares) for j in range(4)] for i in range(4)]
    assert [summed[i][i] for i in range(4)] == pytest.approx([known.k_vc.covariance[i][i] for i in range(4)], rel=1e-3)
    assert "device_entry" not in json.loads((run.directory / "result.json").read_text())  # type: ignore[operator]


def test_no_certificate_of_a_run_that_failed(tmp_path: Path) -> None:
    store = DeviceStore(tmp_path / "devices")
    settings = {"dut": "G-1", "devices": str(store.root), "k_vc_guess_deg_s_per_v": -150.0, **QUICK}
    with pytest.raises(MeasurementError, match="check the leads of the output and of V_Vc"):
        vcfbench.run("kvc", LAB, settings=settings, runs=tmp_path)
    assert store.entries("G-1") == ()


def test_invalid_serial_number_is_refused_before_opening(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="serial number"):
        vcfbench.run("kvc", LAB, settings={"dut": "../G-1"}, runs=tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"match_rates_deg_s": [10.0, -10.0, 10.0]}, "at least 3 different magnitudes for a curve of order 3"),
        ({"match_rates_deg_s": [-40.0, -20.0, 20.0, 40.0]}, "at least 3 different magnitudes for a curve of order 3"),
        ({"match_rates_deg_s": [10.0, 100.0, 400.0]}, r"match_rates_deg_s\[2\]"),
        ({"k_vc_guess_deg_s_per_v": 15.0}, "at least 20"),
        ({"v_vc_range_v": 1}, "v_vc_range_v: expected a range for 1.333 V, the V_Vc of 200 deg/s, got 1"),
    ],
)
def test_settings_that_cannot_be_are_refused(settings: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        vcfbench.dry_run("kvc", LAB, settings=settings)


def test_the_plan_chops_and_brackets() -> None:
    words = [each.step.describe() for each in vcfbench.dry_run("kvc", LAB, settings={**QUICK, "cycles": 2}).steps]
    table = [
        word.split(": ")[1].split(",")[0] for word in words if word.startswith("average") and "measured" not in word
    ]
    assert table[:6] == ["+0 deg/s", "+20 deg/s", "-20 deg/s", "-20 deg/s", "+20 deg/s", "+0 deg/s"]
    assert len(table) == 2 * 3 * 6
    assert sum("V_Vc measured" in word for word in words) >= 2 * 3 * 6


def test_the_leads_are_moved_where_there_is_one_meter() -> None:
    bench = structs.replace(LAB, v_vc_meter=None)
    words = [each.step.describe() for each in vcfbench.dry_run("kvc", bench, settings=QUICK).steps]
    assert [word for word in words if word.startswith("by hand")] == [
        "by hand: move the leads of the multimeter to the V_Vc input",
        "by hand: move the leads of the multimeter to the output",
    ]
    assert sum(word.startswith("measure V_Vc") for word in words) == 7


def test_the_command_prints_where_the_certificate_is(tmp_path: Path) -> None:
    sets = [word for key, value in QUICK.items() for word in ("--set", f"{key}={json.dumps(value)}")]
    where = ["--runs", str(tmp_path / "runs"), "--devices", str(tmp_path / "devices"), "--dut", "G-7"]
    answer = CliRunner().invoke(app, ["run", "kvc", "-v", "--bench", "lab", "--seed", "2", "--quiet", *where, *sets])
    assert answer.exit_code == 0, answer.output
    assert f"device: {tmp_path / 'devices' / 'G-7' / '0001.json'}" in answer.stdout
    assert "uncertainty of K_Vc" in answer.stdout
    assert "only a rate table shows" in answer.stdout


def test_a_bench_without_a_table_is_refused() -> None:
    with pytest.raises(ConfigError, match="kvc needs rate_table"):
        vcfbench.dry_run(KVC, structs.replace(LAB, rate_table=None))


@pytest.mark.exhaustive
def test_the_age_of_a_calibration_is_told_in_one_place(tmp_path: Path) -> None:
    """[uncertainty] of the bench file: kvc and the calibrations go by the same."""

    def gain_part(days: float) -> float:
        bench = structs.replace(LAB, uncertainty=structs.replace(LAB.uncertainty, v_vc_meter_age_days=days))
        found = vcfbench.run("kvc", bench, settings={**QUICK, "cycles": 1}, seed=1, runs=tmp_path).results
        return next(part.u for part in found.k_vc.parts if part.source == "V_Vc gain")

    assert gain_part(80.0) == pytest.approx(20.0 / 35.0 * gain_part(365.0), rel=1e-3)  # 0.0020 and 0.0035 % of reading
    bench = structs.replace(LAB, uncertainty=structs.replace(LAB.uncertainty, v_vc_meter_age_days=900.0))
    with pytest.raises(ConfigError, match=r"uncertainty\.v_vc_meter_age_days: at most 365 days"):
        vcfbench.dry_run("kvc", bench)


def test_certificate_names_k_vc_dependences_and_validity(tmp_path: Path) -> None:
    """By what earlier runs found of the device, brought to the temperature of the day; what nobody found is assumed."""
    store = DeviceStore(tmp_path / "devices")
    seen = Characteristics(
        **{name: Measured(value=value, u=u) for name, (value, u) in SEEN.items()},
        least_temperature_c=0.0,
        most_temperature_c=40.0,
    )
    kept = {"done": datetime(2026, 8, 21, tzinfo=UTC), "procedure": "resonance", "conditions": CONDITIONS}
    store.add(Characterisation(serial="G-1", characteristics=seen, **kept))
    settings = {"dut": "G-1", "devices": str(store.root), "temperature_c": 25.0, "wanted_u95_ppm": 200.0, **QUICK}
    vcfbench.run("kvc", still(LAB), settings=settings, runs=tmp_path)
    known = store.certificate("G-1").record
    assert isinstance(known, Certificate)
    assert known.characteristics is not None
    split, second = known.characteristics.split_hz, known.characteristics.modulator_second_per_v
    assert split is not None
    assert second is not None
    assert split.value == pytest.approx(24.8 + 5 * 0.0027)
    assert second.value == pytest.approx(0.013, rel=0.01)
    found = {each.quantity: each for each in known.sensitivities}
    assert found["carrier_phase_deg"].ppm_per_unit == pytest.approx(-1121.0, abs=10.0)
    assert found["q_anti_phase"].ppm_per_unit == pytest.approx(0.205, abs=0.01)
    assert (found["q_anti_phase"].assumed, found["comb_mismatch"].assumed) == (False, True)
    assert found["temperature_c"].ppm_per_unit == pytest.approx(
        29.6, abs=0.2
    )  # -0.2 %/K of Q are assumed, and so they are
    assert found["temperature_c"].u_ppm_per_unit < 1.0
    assert found["split_hz"].u_ppm_per_unit > 20.0  # combs that nobody looked at
    assert known.u95_until is not None
    assert 100 < (known.u95_until - known.issued).days < 160
    said = CliRunner().invoke(app, ["device", "G-1", "--devices", str(store.root)]).stdout
    assert "carrier phase" in said
    assert "U95 of K_Vc reaches 200 ppm on" in said


SEEN = {
    "temperature_c": (20.0, 0.1),
    "drive_hz": (3488.9, 0.01),
    "split_hz": (24.8, 0.002),
    "split_hz_k": (0.0027, 1e-4),
    "drive_ppm_k": (-30.0, 0.1),
    "q_anti_phase": (1224.0, 2.0),
    "in_phase_split_hz": (146.9, 0.01),
    "q_in_phase": (1224.0, 20.0),
    "in_phase_share": (0.147, 0.002),
    "carrier_phase_deg": (0.3, 0.004),
    "demodulator_phase_deg": (-0.5, 0.01),
}
CONDITIONS = Conditions(bench="lab", run="r", simulated=True, positive_rail_v=10.0, negative_rail_v=-10.0)


@pytest.mark.exhaustive
def test_each_procedure_keeps_its_k_vc_characteristics_of_device(tmp_path: Path) -> None:
    """`phase` and `bandwidth` with --dut; the next certificate takes it from there."""
    store = DeviceStore(tmp_path / "devices")
    kept: dict[str, Any] = {"dut": "G-1", "devices": str(store.root), "warm_up_s": 1800.0}
    vcfbench.run("phase", LAB, seed=1, settings={**kept, "target_deg": 0.2}, runs=tmp_path)
    vcfbench.run(
        "bandwidth", LAB, seed=1, settings={**kept, "around_split": [0.8, 0.95, 1.0, 1.05, 1.2]}, runs=tmp_path
    )
    vcfbench.run("kvc", LAB, seed=1, settings={**kept, **QUICK}, runs=tmp_path)
    known = store.certificate("G-1").record
    assert isinstance(known, Certificate)
    assert [each.record.__struct_config__.tag for each in store.entries("G-1")] == [
        *("characterisation", "characterisation", "certificate")
    ]
    seen = known.characteristics
    assert seen is not None
    warm_split_hz = 24.8 + 0.3 * 0.0027
    for name, true in (("carrier_phase_deg", 0.3), ("demodulator_phase_deg", -0.5), ("split_size_hz", warm_split_hz)):
        found = getattr(seen, name)
        assert abs(found.value - true) < 4.0 * found.u < 0.1, name


@pytest.mark.parametrize("k_vc", [150.0, -40.0])
def test_errors_of_generator_ranges_are_moved_levels(k_vc: float) -> None:
    """Each coefficient's part is what the fit does where all levels of a range are off by its gain, or its offset."""
    sources = Sources(generator_gain=0.02, generator_offset_v=4e-3, generator_ranges_v=(0.4, 10.0), generator_bits=14)
    settings: Any = SimpleNamespace(station=SimpleNamespace(sources=sources))
    v_vc_v = np.array([0.1, -0.1, 0.3, -0.3, 0.7, -0.7, 1.3, -1.3])
    rates = np.polynomial.polynomial.polyval(v_vc_v, [0.05, k_vc, 1.5, -2.0])
    of_rate, of_v = np.diag(np.geomspace(1e-6, 1e-4, 8)), np.diag(np.geomspace(1e-10, 1e-9, 8))
    own, found = _as_set(settings, fitted(rates, v_vc_v, of_rate, of_v), v_vc_v, {"noise": of_rate}, {"none": of_v})

    def moved(by_v: Any) -> Any:
        then = fitted(rates, v_vc_v + 1e-6 * by_v, of_rate, of_v).coefficients
        return (np.array(then) - fitted(rates, v_vc_v, of_rate, of_v).coefficients) / 1e-6

    expected = {"noise": sum(np.outer(row, row) for row in (moved_rates(rates, v_vc_v, of_rate, of_v)))}
    for name, here, low_v in (("0.4 V range", np.abs(v_vc_v) < 0.4, 0.0), ("10 V range", np.abs(v_vc_v) > 0.4, 0.4)):
        offset_v2 = (4e-3**2 + 4e-3 * 0.02 * low_v + (0.02 * low_v) ** 2 / 3.0) / 3.0
        expected[f"{V_VC_GAIN}, {name}"] = 0.02**2 / 3.0 * np.outer(*[moved(v_vc_v * here)] * 2)
        expected[f"{V_VC_OFFSET}, {name}"] = offset_v2 * np.outer(*[moved(1.0 * here)] * 2)
    digits_v = np.where(np.abs(v_vc_v) < 0.4, 0.4, 10.0) * 2.0 / 2**14 / math.sqrt(12.0)
    expected[RESOLUTION] = sum(np.outer(*[moved(row)] * 2) for row in np.diag(digits_v))
    assert found.keys() == expected.keys()
    for name, part in expected.items():
        u = np.sqrt(np.diag(part))
        assert np.sqrt(np.diag(found[name])) == pytest.approx(u, rel=1e-3), name
        assert found[name] / np.outer(u, u) == pytest.approx(part / np.outer(u, u), abs=1e-3), name
    assert np.array(own.covariance) == pytest.approx(sum(expected.values()), rel=1e-3, abs=1e-9)


def fitted(*pairs: Any) -> Any:
    return fit_k_vc_curve(*pairs, order=3)


def moved_rates(rates: Any, v_vc_v: Any, of_rate: Any, of_v: Any) -> Any:
    """Return what a standard uncertainty more of each rate adds to the coefficients."""
    before = np.array(fitted(rates, v_vc_v, of_rate, of_v).coefficients)
    steps = np.diag(np.sqrt(np.diag(of_rate)))
    return [np.array(fitted(rates + row, v_vc_v, of_rate, of_v).coefficients) - before for row in steps]
