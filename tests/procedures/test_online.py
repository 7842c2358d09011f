"""Calibration while the gyroscope measures, against closed forms of the gyroscope's parameters."""

from __future__ import annotations

import itertools
import json
import math
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from msgspec import structs
from typer.testing import CliRunner

import vcfbench
from tests.procedures.test_kvc import LAB, read_v, still, truth, warm
from tests.procedures.test_self_calibration import looked_after
from vcfbench.cli.main import app
from vcfbench.errors import ConfigError, MeasurementError
from vcfbench.procedures.layers import asked_in_python, settings_of
from vcfbench.procedures.online.plan import ONLINE
from vcfbench.procedures.online.results import UNKNOWN_SIGN, online_results
from vcfbench.records.device_values import Conditions, Measured
from vcfbench.records.devices import Certificate, CurveShare, DeviceStore, KvcCurve
from vcfbench.records.stated import values_of
from vcfbench.reports.document import Figure, Table
from vcfbench.sim.simulation import physical_parameters
from vcfbench.steps import (
    AskOperator,
    CheckRails,
    EnableTable,
    ModulatedRecord,
    SampleModulated,
    SetRate,
    SetSine,
)

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench.procedures.online.settings import OnlineSettings
    from vcfbench.station.description import BenchDescription

FIELD = vcfbench.load_bench("examples/field-bench.toml")
QUIET = still(LAB)
SCALE_FACTOR, K_VC = truth(warm(physical_parameters(LAB)))
WARM = {"warm_up_s": 7200.0, "duration_s": 300.0}
FAST: dict[str, Any] = {"warm_up_s": 7200.0, "nplc": 1, "modulation_hz": 2.0, "window_s": 2.0, "duration_s": 30.0}
"""Records of 10 s; the response at 2 Hz is 0.56 % above that at rest, and known to 6 % of that."""


def run(bench: BenchDescription, where: Path, seed: int = 1, **settings: Any) -> Any:
    done = vcfbench.run("online", looked_after(bench), seed=seed, settings={"k_vc": repr(K_VC), **settings}, runs=where)
    assert done.error is None
    return done


@pytest.fixture(scope="module")
def turning(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A run with everything drawn, the table at 20 deg/s."""
    return run(LAB, tmp_path_factory.mktemp("turning"), 5, rate_deg_s=20.0, **WARM)


def slope_at(rate_deg_s: float) -> float:
    """Return the output per rate of small signals about a rate, V/(deg/s): by V_Vc, whose K_Vc is known."""
    gyro, on = warm(physical_parameters(LAB)), physical_parameters(LAB).virtual_path.offset_v
    per_v = (read_v(gyro, rate_deg_s, on + 1e-4) - read_v(gyro, rate_deg_s, on - 1e-4)) / 2e-4
    return per_v / K_VC


def test_without_noise_and_errors_the_scale_factor_comes_out(tmp_path: Path) -> None:
    found = run(QUIET, tmp_path, warm_up_s=7200.0, window_s=52.0, duration_s=156.0).results
    assert found.scale_factor.value == pytest.approx(SCALE_FACTOR, rel=2e-6)
    assert [each.scale_factor_v_per_deg_s for each in found.windows] == pytest.approx([SCALE_FACTOR] * 3, rel=2e-6)
    assert abs(found.disturbance.value) < 2e-4
    # the modulator's square makes 150 * 0.013 * V^2 / 2 of it, its cube 3/4 * 0.0145 * V^2
    assert found.rectified_deg_s == pytest.approx(150.0 * 0.013 * found.v_vc_amplitude_v**2 / 2.0, rel=0.15)
    assert found.compression_ppm == pytest.approx(0.75e6 * 0.0145 * found.v_vc_amplitude_v**2, rel=0.05)
    assert found.virtual_rate_deg_s == pytest.approx(50.0, rel=1e-4)
    assert found.response_ppm == pytest.approx(87.0, abs=2.0)


@pytest.mark.exhaustive
def test_what_nobody_looked_at_widens(tmp_path: Path) -> None:
    """`online` measures none of K_Vc's causes, so it states no more than a self-calibration without health."""
    asked = {**FAST, "k_vc": repr(K_VC), "warm_up_s": 0.0, "duration_s": 10.0}
    found = vcfbench.run("online", LAB, settings=asked, runs=tmp_path).results
    parts = {part.source: part.u for part in found.scale_factor.parts}
    assert parts["not measured: Q (by 50 %, assumed)"] > 1e-4 * abs(SCALE_FACTOR)
    assert parts["not measured: ratio of carrier to drive amplitude (by 0.5 %, assumed)"] > 2e-3 * abs(SCALE_FACTOR)
    assert found.scale_factor.missing == ("K_Vc",)  # a number without its u


@pytest.mark.exhaustive
def test_what_is_measured_while_it_turns_is_within_its_uncertainty(turning: Any) -> None:
    found = turning.results
    true = slope_at(20.0)
    assert abs(true / SCALE_FACTOR - 1.0) > 50e-6
    assert abs(found.scale_factor.value - true) <= 3.5 * found.scale_factor.u <= 150e-6 * abs(true)
    assert sum(part.u**2 for part in found.scale_factor.parts) == pytest.approx(found.scale_factor.u**2)
    assert len(found.windows) == 15
    assert all(abs(each.scale_factor_v_per_deg_s - true) <= 4.5 * each.u for each in found.windows)
    assert found.chi_square < 40.0
    assert abs(found.disturbance.value) <= 3.5 * found.disturbance.u
    assert found.disturbed_by_less_than_deg_s == pytest.approx(abs(found.disturbance.value) + found.disturbance.u95)
    assert found.disturbed_by_less_than_deg_s < 0.05
    assert found.noise_modulated_deg_s == pytest.approx(found.noise_at_rest_deg_s, rel=0.2)
    assert [each.tau_s for each in found.allan] == [20.0]


@pytest.mark.exhaustive
def test_the_record_gives_the_same_and_the_report_shows_it(turning: Any) -> None:
    assert vcfbench.load_run(turning.directory).results == turning.results
    parts = turning.report().parts
    titles = [each.title for each in parts if isinstance(each, Figure)]
    assert titles[:2] == ["Scale factor over time", "True rate, corrected for the modulation"]
    assert titles[2].startswith("Allan deviation of the scale factor")
    assert any(isinstance(each, Table) and each.title == "scale factor, window by window" for each in parts)
    where = [turning.directory.name, "--runs", str(turning.directory.parent)]
    shown = CliRunner().invoke(app, ["runs", "show", *where])
    assert shown.exit_code == 0, shown.output
    assert "disturbance below" in shown.stdout
    answer = json.loads(CliRunner().invoke(app, ["runs", "show", *where, "--json"]).stdout)
    assert len(answer["results"]["windows"]) == 15


@pytest.mark.exhaustive
def test_single_meter_is_moved_by_hand_with_expected_sign(tmp_path: Path) -> None:
    one = structs.replace(QUIET, v_vc_meter=None)
    found = run(one, tmp_path, **FAST).results
    assert found.scale_factor.value == pytest.approx(SCALE_FACTOR, rel=3e-4)
    assert abs(found.scale_factor.value - SCALE_FACTOR) < 2.0 * found.scale_factor.u
    assert found.v_vc_by == "34401A at GPIB0::22::INSTR"


@pytest.mark.exhaustive
def test_certificate_keeps_shares_and_meter_counts_once(tmp_path: Path) -> None:
    own, meter = 30e-6 * K_VC, 10e-6 * K_VC
    name = "34401A at GPIB0::23::INSTR of lab"
    curve = KvcCurve(
        coefficients=(0.0, K_VC),
        covariance=((0.0, 0.0), (0.0, own**2 + meter**2)),
        v_vc_min_v=-1.5,
        v_vc_max_v=1.5,
        shares=(
            CurveShare(source="table rate", covariance=((0.0, 0.0), (0.0, own**2))),
            CurveShare(source="the Earth's rate", covariance=((1e-6, 0.0), (0.0, -1e-20))),
            CurveShare(source="V_Vc gain", of=name, covariance=((0.0, 0.0), (0.0, meter**2))),
        ),
    )
    here = Conditions(bench="lab", run="r", simulated=True, positive_rail_v=10.0, negative_rail_v=-10.0)
    scale_factor = Measured(value=SCALE_FACTOR, u=2e-7)
    DeviceStore(tmp_path / "devices").add(
        Certificate(
            serial="G-1",
            issued=datetime(2020, 1, 1, tzinfo=UTC),
            procedure="kvc",
            k_vc=curve,
            conditions=here,
            scale_factor_v_per_deg_s=scale_factor,
        )
    )
    found = run(QUIET, tmp_path, k_vc=None, dut="G-1", devices=str(tmp_path / "devices"), **FAST).results
    sources = {part.source: part.u / abs(found.scale_factor.value) for part in found.scale_factor.parts}
    assert sources["certificate: table rate"] == pytest.approx(30e-6)
    assert not [each for each in sources if "V_Vc gain" in each]
    assert found.k_vc_from == "certificate 0001"
    assert found.drift.since == "certificate 0001 of 2020-01-01"
    assert values_of(found)["drift_ppm"].value == found.drift.change_ppm.value
    assert abs(found.drift.change_ppm.value) < 350.0


@pytest.mark.exhaustive
def test_set_v_vc_has_accuracy_of_generator(tmp_path: Path) -> None:
    found = run(QUIET, tmp_path, v_vc="set", **FAST).results
    assert found.scale_factor.u / abs(found.scale_factor.value) == pytest.approx(0.02 / 3**0.5, rel=0.05)
    assert found.scale_factor.parts[0].source == "V_Vc gain"
    assert any(part.source.startswith("offset of the generator") for part in found.disturbance.parts)


def test_bench_with_a_table_may_turn_and_needs_none() -> None:
    settings = {"k_vc": "150"}
    kinds = [type(each.step) for each in vcfbench.dry_run("online", FIELD, settings=settings).steps]
    assert EnableTable not in kinds
    assert kinds.count(SampleModulated) == 2 + 18
    assert {after for kind, after in itertools.pairwise(kinds) if kind is SampleModulated} == {CheckRails}
    turns = vcfbench.dry_run("online", LAB, settings={**settings, "rate_deg_s": -30.0}).steps
    assert [each.step.rate_deg_s for each in turns if isinstance(each.step, SetRate)] == [10.0, 0.0, 0.0, -30.0, 0.0]
    [sine] = [each.step for each in turns if isinstance(each.step, SetSine)]
    assert (sine.frequency_hz, sine.amplitude_v) == (0.25, pytest.approx(1.0 / 3.0))
    by_hand = vcfbench.dry_run("online", structs.replace(FIELD, v_vc_meter=None), settings=settings).steps
    assert sum(isinstance(each.step, AskOperator) for each in by_hand) == 2


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"modulation_hz": 1.0}, r"modulation_hz.*0.15 to 0.625 Hz"),
        ({"modulation_hz": 3.0, "nplc": 1, "window_s": 2.0}, "a tenth of split_hz"),
        ({"modulation_hz": 2.0, "window_s": 20.0, "nplc": 1}, "at most 512 readings of 0.02 s"),
        ({"rate_deg_s": 20.0}, "0 on a bench without a rate table"),
        ({"k_vc": None}, "K_Vc"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_opened(settings: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        vcfbench.dry_run("online", FIELD, settings={"k_vc": "150", **settings})


def test_a_sine_beyond_the_limit_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"virtual_rate_deg_s: 50 deg/s needs 12.5 V of V_Vc, the bench allows"):
        vcfbench.dry_run("online", FIELD, settings={"k_vc": "4", "k_vc_guess_deg_s_per_v": 4.0})


def test_the_command_has_a_dry_run() -> None:
    done = CliRunner().invoke(app, ["run", "online", "--dry-run", "--k-vc", "150", "--bench", "lab"])
    assert done.exit_code == 0, done.output
    assert "V_Vc = sine of 0.25 Hz, 0.333333 V peak" in done.stdout
    assert "The modulation, 18 times 100 s" in done.stdout


class Records:
    """What a run would have measured, in numbers: 0.25 Hz, 50 deg/s, a little noise."""

    def __init__(self) -> None:
        self.random = np.random.default_rng(3)
        bursts = [(0.0, 1.0), *((1.0 / 3.0, 1.0) for _ in range(5)), (0.0, 1.0)]
        self.pairs = [(self.step(amplitude_v), self.record(amplitude_v, way)) for amplitude_v, way in bursts]

    def step(self, amplitude_v: float) -> SampleModulated:
        return SampleModulated(0.25, amplitude_v, 500, 0.2, "both", None, 0.05)

    def record(self, amplitude_v: float, way: float = 1.0, noise_v: float = 1e-4) -> ModulatedRecord:
        v_vc_v = amplitude_v * np.cos(0.1 * np.pi * np.arange(500)) + 1e-6 * self.random.standard_normal(500)
        output_v = way * (-0.042 - 1.8825 * v_vc_v) + noise_v * self.random.standard_normal(500)
        return ModulatedRecord(0.2, 0.2, 0.0, tuple(output_v.tolist()), 0.0, tuple(v_vc_v.tolist()), None)

    def spoil(self, record: ModulatedRecord) -> Any:
        """Put `record` in place of the third burst."""
        self.pairs[3] = self.pairs[3][0], record
        return self

    def found(self, kind: type[Any]) -> list[Any]:
        assert kind is ModulatedRecord
        return self.pairs


@pytest.fixture(scope="module")
def chosen() -> OnlineSettings:
    settings = settings_of(ONLINE, LAB, asked_in_python({"k_vc": "150", "duration_s": 500.0})).recalled()
    return structs.replace(settings, station=structs.replace(settings.station, meter_resolution_v=1e-5))


def test_equal_bursts_give_planted_slope(chosen: OnlineSettings) -> None:
    found = online_results(chosen, Records())  # type: ignore[arg-type]
    assert found.scale_factor.value == pytest.approx(-1.8825 / 150.0 / (1.0 + 1e-6 * found.response_ppm), rel=1e-4)
    assert abs(found.disturbance.value) < 4.0 * found.disturbance.u


def test_levels_as_set_have_errors_of_the_generator() -> None:
    bench = structs.replace(LAB, v_vc_meter=None)
    asked = asked_in_python({"k_vc": "150", "duration_s": 500.0, "v_vc": "set"})
    settings, records = settings_of(ONLINE, bench, asked).recalled(), Records()
    settings = structs.replace(settings, station=structs.replace(settings.station, meter_resolution_v=1e-5))
    records.pairs = [(step, structs.replace(each, v_vc_v=())) for step, each in records.pairs]
    found, known = online_results(settings, records), settings.station.sources  # type: ignore[arg-type]
    u_gain = {part.source: part.u for part in found.scale_factor.parts}["V_Vc gain"]
    assert u_gain == pytest.approx(abs(found.scale_factor.value) * known.generator_gain / 3**0.5)
    u = {part.source: part.u for part in found.disturbance.parts}
    offset_v = math.hypot(known.generator_offset_v, known.generator_offset_v) / 3**0.5
    assert u["offset of the generator, sine against direct voltage"] == pytest.approx(150.0 * offset_v, rel=0.01)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"way": -1.0}, "burst 3 of 5: output and V_Vc differ by"),
        ({"noise_v": 1e-3}, r"burst 3 of 5 scatters by 0\.00\d+ V about its sine, the others by 0\.0001 V"),
        ({"way": 1e-9, "noise_v": 1e-6}, "burst 3 of 5: "),
        ({"way": 0.5}, r"burst 3 of 5 swings by 0\.315 V, the others by 0\.6301 V"),
    ],
    ids=["leads swapped", "disturbed", "lead off", "half"],
)
def test_a_burst_unlike_the_others_gives_no_result(change: dict[str, Any], said: str, chosen: OnlineSettings) -> None:
    records = Records()
    with pytest.raises(MeasurementError, match=said):
        online_results(chosen, records.spoil(records.record(1.0 / 3.0, **change)))


def test_a_record_at_rest_that_was_disturbed_gives_no_result(chosen: OnlineSettings) -> None:
    """The supply was short for 20 s of it: the true rate seemed disturbed by 0.08 deg/s."""
    records = Records()
    records.pairs[0] = records.pairs[0][0], records.record(0.0, noise_v=2e-3)
    with pytest.raises(MeasurementError, match=r"record 1 of 2 at rest scatters by 0\.0\d+ V, those with the sine"):
        online_results(chosen, records)  # type: ignore[arg-type]


def spoilt(records: Records, output: Any = None, v_vc: Any = None) -> Any:
    """Return `records` with what a meter that is wrong from first to last makes of all its readings."""
    kept = [(step, each, np.array(each.output_v), np.array(each.v_vc_v)) for step, each in records.pairs]
    records.pairs = [
        (
            step,
            structs.replace(
                each,
                output_v=tuple((output_v if output is None else output(output_v)).tolist()),
                v_vc_v=tuple((v_vc_v if v_vc is None else v_vc(v_vc_v)).tolist()),
            ),
        )
        for step, each, output_v, v_vc_v in kept
    ]
    return records


def stands_still(readings_v: Any) -> Any:
    return np.concatenate((readings_v[:100], np.full(50, readings_v[99]), readings_v[150:]))


@pytest.mark.parametrize("output", [lambda v: np.clip(v, -0.5, 0.5), stands_still], ids=["at its limit", "frozen"])
def test_bursts_that_are_all_no_sine_give_no_result(output: Any, chosen: OnlineSettings) -> None:
    with pytest.raises(MeasurementError, match=r"scatters by 0\.\d+ V about its sine, at rest by 0\.0001 V"):
        online_results(chosen, spoilt(Records(), output))


@pytest.mark.parametrize("v_vc", [lambda v: 1e-3 * v, lambda v: v + 0.05], ids=["millivolts", "offset"])
def test_v_vc_sine_unlike_its_setting_gives_no_result(v_vc: Any, chosen: OnlineSettings) -> None:
    with pytest.raises(MeasurementError, match=r"in burst 1 of 5 V_Vc reads .*, set to 0\.333333 V about 0") as caught:
        online_results(chosen, spoilt(Records(), v_vc=v_vc))
    assert caught.value.instrument == "v_vc_meter"


def test_a_sign_that_the_gyroscope_has_not_gives_no_result(chosen: OnlineSettings) -> None:
    assert online_results(chosen, spoilt(Records(), v_vc=np.negative)).scale_factor.value > 0.0
    expected = structs.replace(chosen.station.expected, scale_factor_v_per_deg_s=(-0.013, -0.012))
    told = structs.replace(chosen, station=structs.replace(chosen.station, expected=expected))
    with pytest.raises(MeasurementError, match=r"sign of the scale factor is wrong: expected -0\.0125 V/\(deg/s\)"):
        online_results(told, spoilt(Records(), v_vc=np.negative))


@pytest.mark.exhaustive
def test_a_sign_that_nothing_tells_is_missing(tmp_path: Path) -> None:
    """V_Vc as it is set has no phase against the output; the bench file, or a meter on V_Vc, tells the sign."""
    unmeasured = run(LAB, tmp_path, **FAST, v_vc="set").results
    assert UNKNOWN_SIGN in unmeasured.scale_factor.missing
    ends = (-0.013, -0.012)
    told = structs.replace(LAB, expected=structs.replace(LAB.expected, scale_factor_v_per_deg_s=ends))
    turned = run(told, tmp_path, **FAST, v_vc="set").results
    assert turned.scale_factor.value < 0.0
    assert UNKNOWN_SIGN not in turned.scale_factor.missing
    wrong = structs.replace(LAB, expected=structs.replace(LAB.expected, scale_factor_v_per_deg_s=(0.012, 0.013)))
    with pytest.raises(MeasurementError, match="the sign of the scale factor is wrong"):
        run(wrong, tmp_path, **FAST, v_vc="set")
    assert UNKNOWN_SIGN not in run(LAB, tmp_path, **FAST).results.scale_factor.missing
