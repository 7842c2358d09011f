"""Gyroscopes that speak numbers: from a bench file to a statement, and what happens when their frames are spoilt."""

from __future__ import annotations

import re
import tomllib
from typing import TYPE_CHECKING, Any

import msgspec
import pytest
from msgspec import structs
from scipy.io import loadmat
from simrack_tests.cells import few

import vcfbench
from tests.test_resume import cut
from vcfbench.archive.batch_sheet import device_rows
from vcfbench.archive.reported import full_report
from vcfbench.archive.verified import verify_run
from vcfbench.bench.bench import open_bench
from vcfbench.drivers.streams.reader import StreamReader
from vcfbench.errors import BenchError, ConfigError
from vcfbench.procedures.bench_file import checked_bench
from vcfbench.procedures.layers import asked_in_python
from vcfbench.records.schema import Status
from vcfbench.runs.conduct import conduct
from vcfbench.runs.request import Request
from vcfbench.safety.signals import StopSignals
from vcfbench.sim.builder import SimulatedBench
from vcfbench.station.stream_profiles import stream_profiles
from vcfbench.station.writing import bench_text
from vcfbench.steps.stream import StreamSeen
from vcfbench.steps.stream_latency import LatencySeen
from vcfbench.studies.truth import truth_of
from vcfbench.testing import serve_simulated
from vcfbench.values.printing import in_unit

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench.clock import Clock
    from vcfbench.station.description import BenchDescription

PAPER = vcfbench.load_bench()
TABLE = msgspec.to_builtins(
    structs.replace(PAPER, name="stream-1", power=None, multimeter=None, rate_source=None, oscilloscope=None)
)
QUICK = {"rates_deg_s": [100.0, 0.0, -100.0], "samples": 5}
PROFILES = stream_profiles()
FAULTS: dict[str, dict[str, float]] = {
    "few dropped": {"dropped": 0.01},
    "half dropped": {"dropped": 0.5},
    "few bits": {"flipped": 0.01},
    "many bits": {"flipped": 0.5},
    "repeated": {"repeated": 0.05},
    "garbage": {"garbage": 0.05},
    "silent": {"silent": 1.0},
    "stuck": {"stuck": 1.0},
    "frozen": {"frozen": 1.0},
    "saturated": {"saturated": 1.0},
    "not well": {"status": 1.0},
    "clock": {"clock_ppm": 5000.0},
    "late": {"latency_s": 0.02},
}
LEFT_ALONE = {"few dropped", "few bits", "repeated", "garbage", "late"}


def stream_bench(stream: dict[str, Any] | str, **errors: float) -> BenchDescription:
    stated = {"profile": stream} if isinstance(stream, str) else stream
    values = {
        **TABLE,
        "limits": {"max_rate_deg_s": 300.0, "max_acceleration_deg_s2": 200.0},
        "gyro": {"stream": {"resource": "/dev/ttyUSB0", **stated}},
    }
    values["simulation"] = {**TABLE["simulation"], "errors": {"multimeter": errors or "drawn"}}
    text = bench_text(checked_bench({k: v for k, v in values.items() if v is not None}, "stream.toml"))
    return checked_bench(tomllib.loads(text), "stream.toml")


@pytest.mark.parametrize("profile", few(PROFILES, "adis16495"))
def test_a_stream_is_calibrated_in_its_own_unit(profile: str, tmp_path: Path) -> None:
    run = vcfbench.run("turntable", stream_bench(profile), seed=1, settings=QUICK, runs=tmp_path)
    assert run.status is Status.COMPLETE
    k = run.values["scale_factor"]
    assert k.unit == "(deg/s)/(deg/s)"
    assert abs((k.value or 0.0) - 1.004) < 0.001  # the simulated gyroscope's -12.55 over -12.5 mV/(deg/s)
    assert run.values["bias"].unit == "deg/s"
    text = vcfbench.text_of(run.report())
    assert " mV" not in text
    assert "frames, 0 missing" in text
    assert run.directory is not None
    assert verify_run(run.directory).wrong is None


FIELD = {"at": 6, "type": "int32"}
FRAME = {"header": "A5 5A", "length": 12, "sample_rate_hz": 100.0, "counter": {"at": 2, "type": "uint8"}}
NUMBERS: dict[str, dict[str, Any]] = {
    "deg/s": {"unit": "deg/s", "value": {**FIELD, "scale": 1e-5}},
    "rad/s": {"unit": "rad/s", "value": {**FIELD, "scale": 1e-7}},
    "LSB": {"unit": "LSB", "value": FIELD},
    "deg": {"unit": "deg", "kind": "increment", "value": {**FIELD, "scale": 1e-7}},
}


ANGLES: dict[str, Any] = {**FRAME, "unit": "deg", "kind": "angle", "value": {**FIELD, "scale": 1e-6}}


@pytest.mark.exhaustive
@pytest.mark.parametrize("stream", few(["adis16495", "dsp1760", ANGLES], "adis16495"), ids=str)
def test_age_of_the_numbers_is_measured_by_ramps_of_the_table(stream: Any, tmp_path: Path) -> None:
    told = {"table_readback_s": 0.022}  # 1 ms of delay and half of 20 ms of the simulated estimate
    base: dict[str, Any] = {"profile": stream} if isinstance(stream, str) else stream
    ages = []
    for latency_s in (0.0, 0.03):
        bench = stream_bench({**base, **told}, latency_s=latency_s)
        run = vcfbench.run("turntable", bench, seed=1, settings=QUICK, runs=tmp_path)
        ((_, seen),) = run.measured.found(LatencySeen)
        assert seen.latency_s is not None
        assert seen.u_latency_s is not None
        # half of a span of 10 ms, 6.5 ms of the gyroscope and its low-pass, and at most 2 ms of the wire
        assert 11.5e-3 - 2.0 * seen.u_latency_s < seen.latency_s - latency_s < 13.5e-3 + 2.0 * seen.u_latency_s
        said = " ".join(vcfbench.text_of(run.report()).split())
        assert f"{1e3 * seen.latency_s:.1f} ms old as they come" in said
        ages.append(seen.latency_s)
    assert ages[1] - ages[0] == pytest.approx(0.03, abs=0.5e-3)


ABSENT = re.compile(r"multimeter|generator|(?<!without )V_Vc|oscilloscope|rail|volts?\b")
ALL_OF_A_STREAM: dict[str, dict[str, Any]] = {
    "turntable": QUICK,
    "zero": {"duration_s": 200.0, "powered_s": 10.0},
    "temperature": {"by": "table", "temperatures_c": [0.0, 20.0, 40.0], "soak_s": 60.0},
    "axes": {},
}


@pytest.mark.parametrize("procedure", few(ALL_OF_A_STREAM, "turntable"))
def test_report_of_stream_names_present_instruments_only(procedure: str, tmp_path: Path) -> None:
    run = vcfbench.run(procedure, stream_bench("vn100"), settings=ALL_OF_A_STREAM[procedure], runs=tmp_path)
    text = vcfbench.text_of(full_report(run))
    found = [line for line in text.splitlines() if ABSENT.search(line) and not line.startswith("not checked: ")]
    assert found == []


@pytest.mark.exhaustive
@pytest.mark.parametrize("unit", few(NUMBERS, "LSB"))
def test_study_has_truth_in_unit_of_stream(unit: str) -> None:
    bench = stream_bench({**FRAME, **NUMBERS[unit]}, lsb_per_deg_s=5000.0)
    run = vcfbench.run("turntable", bench, seed=1, settings=QUICK, runs=None)
    assert run.values["scale_factor"].value == pytest.approx(truth_of(run, bench)["scale_factor"], rel=1e-4)


@pytest.mark.exhaustive
@pytest.mark.parametrize("unit", few(NUMBERS, "LSB"))
def test_exports_and_comparisons_keep_the_unit_of_the_output(unit: str, tmp_path: Path) -> None:
    benches = stream_bench({**FRAME, **NUMBERS[unit]}), PAPER
    runs = [vcfbench.run("turntable", bench, seed=1, settings=QUICK, runs=tmp_path) for bench in benches]
    for run in runs:
        for raw in (False, True):
            vcfbench.export_run(run, tmp_path / "out.mat", raw=raw)
            units = loadmat(tmp_path / "out.mat", simplify_cells=True)["units"]
            of_output = {units[key] for key in ("voltage_v", "output_v", "std_v") if key in units}
            assert of_output == {run.values["bias"].unit}
            assert {each for key, each in units.items() if key.startswith("v_vc")} == {"V"}
    assert vcfbench.compare_runs(*runs).points == ()
    assert vcfbench.compare_runs(runs[0], runs[0]).points


@pytest.mark.exhaustive
def test_history_of_a_device_mixes_no_units(tmp_path: Path) -> None:
    benches = {"LSB": stream_bench({**FRAME, **NUMBERS["LSB"]}), "V": PAPER}
    for seed, unit in enumerate(("LSB", "V", "LSB", "V")):
        asked = {"rates_deg_s": [100.0, 0.0, -100.0], "samples": 3}
        vcfbench.run("turntable", benches[unit], seed=seed, settings=asked, metadata={"dut": "S"}, runs=tmp_path)
    counts, volts, counts_again, volts_again = device_rows("S", tmp_path, tmp_path)
    assert (counts.drift_ppm, counts.since_first_ppm, volts.drift_ppm, volts.since_first_ppm) == (None, 0.0, None, 0.0)
    assert volts.drift_note == "in LSB/(deg/s), now in mV/(deg/s)"
    for first, again in ((counts, counts_again), (volts, volts_again)):
        assert first.scale_factor is not None
        assert again.scale_factor is not None
        ppm = 1e6 * ((again.scale_factor.value or 0.0) / (first.scale_factor.value or 1.0) - 1.0)
        assert again.drift_ppm == again.since_first_ppm == pytest.approx(ppm)


@pytest.mark.exhaustive
def test_a_stream_is_recorded_at_rest(tmp_path: Path) -> None:
    settings = {"duration_s": 200.0, "powered_s": 10.0}
    run = vcfbench.run("zero", stream_bench("vn100"), seed=1, settings=settings, runs=tmp_path)
    assert run.status is Status.COMPLETE
    assert run.values["output_v"].unit == "deg/s"


@pytest.mark.exhaustive
@pytest.mark.parametrize("dropped", [0.0, 0.02])
@pytest.mark.parametrize("counted", [True, False])
def test_white_noise_behind_missing_frames_has_a_bound_alone(dropped: float, *, counted: bool) -> None:
    settings = {"duration_s": 300.0, "powered_s": 10.0, "noise_bandwidth_hz": 1.17, "scale_factor_v_per_deg_s": 5000.0}
    bench = stream_bench({**FRAME, **NUMBERS["LSB"]}, lsb_per_deg_s=5000.0, dropped=dropped)
    if not counted:
        settings.pop("scale_factor_v_per_deg_s")
        bench = stream_bench("vn100", dropped=dropped)
    run = vcfbench.run("zero", bench, seed=1, settings=settings, runs=None)
    n = run.results.coefficient("angle random walk")
    assert (n.u is None) is bool(dropped)
    assert n.upper_95 > 0.21
    assert ("of the frames are missing" in vcfbench.text_of(run.report())) is bool(dropped)


def test_counts_at_rest_need_their_scale_factor() -> None:
    with pytest.raises(ConfigError, match=r"scale_factor_v_per_deg_s: expected LSB/\(deg/s\) of this gyroscope"):
        vcfbench.dry_run("zero", stream_bench({**FRAME, **NUMBERS["LSB"]}))


@pytest.mark.exhaustive
def test_device_clock_is_in_budget_of_increments(tmp_path: Path) -> None:
    runs = {
        ppm: vcfbench.run("turntable", stream_bench("dsp1760", clock_ppm=ppm), seed=1, settings=QUICK, runs=tmp_path)
        for ppm in (0.0, 150.0)
    }
    at, fast = (runs[ppm].values["scale_factor"] for ppm in (0.0, 150.0))
    assert (fast.value or 0.0) / (at.value or 1.0) - 1.0 == pytest.approx(-150e-6, abs=30e-6)
    assert "device clock" in {part.source for part in fast.parts}
    assert abs((fast.value or 0.0) - (at.value or 0.0)) < (fast.u95 or 0.0)
    (seen,) = [each for _, each in runs[150.0].measured.found(StreamSeen)]
    assert seen.clock_ppm == pytest.approx(150.0, abs=2.0 * (seen.u_clock_ppm or 0.0))


class Later:
    """A fault that comes in the middle of a run."""

    def __init__(self, bench: SimulatedBench, at_s: float, errors: dict[str, float]) -> None:
        self._bench, self._at_s, self._errors = bench, at_s, errors

    def wake_at(self) -> float | None:
        if self._bench.clock.now() < self._at_s:
            return self._at_s
        own: Any = self._bench.devices["multimeter"]
        for each in own.adjustments():
            if each.name.removeprefix("stream.") in self._errors and each.read() == 0.0:
                each.write(self._errors[each.name.removeprefix("stream.")])
        return None


@pytest.mark.parametrize(
    ("profile", "fault", "at_s"),
    few(
        [(profile, fault, at_s) for profile in PROFILES for fault in FAULTS for at_s in (0.0, 25.0)],
        ("adis16495", "stuck", 25.0),
        ("vn100", "few bits", 0.0),
    ),
)
def test_stream_fault_never_gives_wrong_number(profile: str, fault: str, at_s: float, tmp_path: Path) -> None:
    def build(description: BenchDescription, seed: int, clock: Clock) -> SimulatedBench:
        bench = SimulatedBench.build(description, seed, clock)
        attended: Any = bench.clock
        attended.attend(Later(bench, at_s, FAULTS[fault]))
        return bench

    bench = stream_bench(profile, lsb_per_deg_s=100.0)
    good = vcfbench.run("turntable", bench, seed=1, settings=QUICK, runs=tmp_path).values["scale_factor"]
    try:
        request = Request("turntable", bench, 1, asked_in_python(QUICK), build=build, warn=lambda _: None)
        with StopSignals() as signals:
            found = conduct(request, signals).values["scale_factor"]
    except BenchError:
        if fault in LEFT_ALONE:
            raise
    else:
        assert abs((found.value or 0.0) - (good.value or 0.0)) < max(found.u95 or 0.0, good.u95 or 0.0)


@pytest.mark.parametrize(
    ("errors", "said"),
    few(
        [
            ({"silent": 1.0}, "silent"),
            ({"stuck": 1.0}, "it is stuck; if"),
            ({"frozen": 1.0}, "stands still"),
            ({"saturated": 1.0}, "saturated"),
            ({"status": 1.0}, "status"),
            ({"dropped": 0.5}, "missing"),
            ({"clock_ppm": 50_000.0}, "clock_ppm = 200"),
        ],
        every=4,
    ),
    ids=str,
)
def test_frames_that_are_no_measurement_are_refused_with_the_reason(errors: dict[str, float], said: str) -> None:
    with open_bench(stream_bench("adis16495"), seed=1, needs=["multimeter"]) as bench:
        bench.multimeter.read_voltage_v()
        for name, value in errors.items():
            assert bench.adjust is not None
            bench.adjust(f"multimeter.stream.{name}", value)
        with pytest.raises(BenchError, match=said):
            [bench.multimeter.read_voltage_v() for _ in range(3)]


def test_reading_uses_frames_after_its_start() -> None:
    with open_bench(stream_bench("adis16495", latency_s=0.001), seed=1, needs=["multimeter"]) as bench:
        assert bench.adjust is not None
        before = bench.multimeter.read_voltage_v()
        bench.adjust("applied_rate_deg_s", 50.0)
        bench.clock.sleep_until(bench.clock.now() + 1.0)
        assert bench.multimeter.read_voltage_v() - before == pytest.approx(50.2, abs=0.2)


@pytest.mark.parametrize("latency_s", few([0.003, 0.05, 0.1, 0.2, 0.4], 0.003, 0.2))
@pytest.mark.parametrize("pause_s", few([0.02, 0.12, 0.17, 0.22, 0.5], 0.12, 0.5))
def test_none_of_late_numbers_is_missing(latency_s: float, pause_s: float) -> None:
    with open_bench(stream_bench("vn100", latency_s=latency_s), seed=1, needs=["multimeter"]) as bench:
        reader = bench.multimeter
        assert isinstance(reader, StreamReader)
        for _ in range(6):
            reader.read_voltage_v()
            bench.clock.sleep_until(bench.clock.now() + pause_s)
        assert reader.health()["dropped"] == 0


@pytest.mark.parametrize("latency_s", [0.2, 0.4])
def test_numbers_of_a_long_latency_are_old(latency_s: float) -> None:
    with open_bench(stream_bench("adis16495", latency_s=latency_s), seed=1, needs=["multimeter"]) as bench:
        assert bench.adjust is not None
        bench.clock.sleep_until(5.0)
        before = bench.multimeter.read_voltage_v()
        bench.clock.sleep_until(bench.clock.now() + 1.0)
        bench.adjust("applied_rate_deg_s", 50.0)
        new = 1.0 - latency_s / 0.5  # share of the aperture that is not from before
        assert bench.multimeter.read_voltage_v() - before == pytest.approx(50.2 * new, abs=1.5)


@pytest.mark.parametrize("procedure", ["virtual-coriolis", "warmup", "online", "g-sensitivity"])
def test_what_needs_a_voltage_is_refused_with_what_there_is(procedure: str) -> None:
    with pytest.raises(ConfigError, match=f"{procedure} needs an output that is a voltage.*turntable"):
        vcfbench.dry_run(procedure, stream_bench("vn100"))


def test_a_bench_without_an_output_is_told_of_streams() -> None:
    values = {key: each for key, each in TABLE.items() if each is not None}
    with pytest.raises(ConfigError, match=r"\[multimeter\], or \[gyro.stream\] of a digital output"):
        vcfbench.dry_run("turntable", checked_bench(values, "table.toml"))


def test_a_stream_without_gaps_is_refused() -> None:
    with pytest.raises(ConfigError, match="mode: expected corrected or dead-time"):
        vcfbench.dry_run("zero", stream_bench("vn100"), settings={"mode": "gapless", "sample_interval_s": 1.0})


MINIMAL = {"sample_rate_hz": 100.0, "header": "A5", "length": 8, "value": {"at": 2}}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"profile": "imu"}, r"gyro.stream.profile: expected one of adis16495, .*FILE.toml, got 'imu'"),
        ({"header": "xyz"}, r"gyro.stream.header: expected the bytes in hex .*got 'xyz'"),
        ({"value": {"at": 7}}, r"gyro.stream.value.at: expected at most 6, for the number to end by byte 8, got 7"),
        ({"value": {"at": 2, "type": "int12"}}, r"gyro.stream.value.type: expected.*got 'int12'"),
        ({"unit": "deg"}, r"gyro.stream.unit: expected of rate: one of deg/s, rad/s, LSB, got 'deg'"),
        ({"kind": "increment", "unit": "deg"}, r"gyro.stream.counter: expected a counter"),
        ({"checksum": {"name": "crc16"}}, r"gyro.stream.checksum.name: expected.*got 'crc16'"),
        ({"baud_rate": 4800}, r"gyro.stream.baud_rate: expected at least 8000"),
        ({"length": None}, r"gyro.stream.columns: expected how many"),
        ({"value": {"at": 2, "type": "float32"}}, r"gyro.stream.resolution: expected"),
        ({"sampel_rate": 3.0}, r"gyro.stream.sampel_rate"),
    ],
    ids=lambda each: next(iter(each)) if isinstance(each, dict) else "",
)
def test_invalid_description_names_key_value_and_expectation(change: dict[str, Any], said: str) -> None:
    stated = {key: value for key, value in {**MINIMAL, **change}.items() if value is not None}
    with pytest.raises(ConfigError, match=said):
        stream_bench(stated)


def test_a_meter_beside_a_stream_is_refused() -> None:
    values = {**TABLE, "gyro": {"stream": {"resource": "x", **MINIMAL}}, "multimeter": {"model": "34401A"}}
    with pytest.raises(ConfigError, match="multimeter: remove it"):
        checked_bench(values, "stream.toml")


def test_profile_is_read_beside_bench_file_that_overrides_it(tmp_path: Path) -> None:
    (tmp_path / "imu.toml").write_text('sample_rate_hz = 50.0\nheader = "A5"\nlength = 8\nvalue = { at = 2 }\n')
    text = bench_text(stream_bench("vn100")).partition("[gyro.stream]")[0]
    own = '[gyro.stream]\nprofile = "imu.toml"\nresource = "COM3"\nsample_rate_hz = 20.0\n'
    head = text[: text.index("[gyro]")] if "[gyro]" in text else text
    (tmp_path / "bench.toml").write_text(head + own)
    stream = vcfbench.load_bench(tmp_path / "bench.toml").stream
    assert stream is not None
    assert (stream.name, stream.length, stream.sample_rate_hz) == ("imu", 8, 20.0)


def test_words_about_the_output_have_its_unit() -> None:
    said = "rate +5 deg/s, V_Vc +0 V: +0.3 V off, 2e-05 V of V_Vc"
    assert in_unit(said, "V") == said
    assert in_unit(said, "LSB") == "rate +5 deg/s: +0.3 LSB off, 2e-05 LSB of V_Vc"


def test_broken_run_resumes_with_its_stream(tmp_path: Path) -> None:
    run = vcfbench.run("turntable", stream_bench("adis16495"), seed=1, settings=QUICK, runs=tmp_path / "whole")
    again = vcfbench.resume(cut(run, tmp_path, 2), runs=tmp_path)
    assert again.status is Status.COMPLETE
    k, k_again = (each.values["scale_factor"] for each in (run, again))
    assert abs((k.value or 0.0) - (k_again.value or 0.0)) < (k.u95 or 0.0) + (k_again.u95 or 0.0)


@pytest.mark.exhaustive
def test_a_served_stream_gives_the_same_scale_factor(tmp_path: Path) -> None:
    bench = stream_bench("vn100")
    here = vcfbench.run("turntable", bench, seed=1, settings=QUICK, runs=tmp_path)
    with serve_simulated(bench, seed=1) as lab:
        there = vcfbench.run("turntable", lab.on_wires(), settings=QUICK, runs=tmp_path)
    k, k_here = (each.values["scale_factor"] for each in (there, here))
    assert abs((k.value or 0.0) - (k_here.value or 0.0)) < (k.u95 or 0.0)
