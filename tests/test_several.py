"""Several gyroscopes on one bench: one run, a record of each, and each that fails ends for itself."""

from __future__ import annotations

import math
import re
import tomllib
from shutil import copytree, rmtree
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any
from unittest.mock import Mock

import msgspec
import pytest
from simrack.faults import Fault
from simrack_tests.cells import few
from typer.testing import CliRunner

import vcfbench
from tests import warm
from tests.seals import sealed
from tests.test_resume import cut
from tests.test_streams import FAULTS, LEFT_ALONE, TABLE
from vcfbench.archive.lot import spreads_of
from vcfbench.archive.reported import full_report
from vcfbench.archive.verified import verify_run
from vcfbench.bench.check import check_bench
from vcfbench.cli.main import app
from vcfbench.drivers.streams.reader import StreamReader
from vcfbench.drivers.together import Outputs
from vcfbench.errors import BenchError, ConfigError, DeadlineExceeded, LinkLost, PlanError
from vcfbench.interfaces import Identity
from vcfbench.procedures.bench_file import checked_bench, parse_bench
from vcfbench.procedures.layers import asked_in_python
from vcfbench.records.metadata import metadata_of
from vcfbench.records.schema import Status
from vcfbench.reports.text import text_of
from vcfbench.runs.batch import read_batch
from vcfbench.runs.conduct import conduct
from vcfbench.runs.needs import what_can_run
from vcfbench.runs.request import Request, prepare
from vcfbench.safety.signals import StopSignals
from vcfbench.sim.builder import SimulatedBench
from vcfbench.sim.simulation import physical_parameters
from vcfbench.station.file import embedded_text
from vcfbench.station.writing import bench_text
from vcfbench.steps.each import EachResult
from vcfbench.studies.file import read_study
from vcfbench.testing import serve_simulated
from vcfbench.testing.benches import _Behind
from vcfbench.values.sources import TABLE_RATE

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench.archive.run import Run
    from vcfbench.clock import Clock
    from vcfbench.station.description import BenchDescription

LIMITS = {"max_rate_deg_s": 300.0, "max_acceleration_deg_s2": 200.0}
QUICK = {"rates_deg_s": [100.0, 0.0, -100.0], "samples": 4}
GAINS = (1.0, 1.1, 0.9)
METER_FAULTS = [
    *("silent", "late", "garbled", "garbage", "truncated", "disconnect", "unreachable", "half_open", "power_cycle"),
    *("error", "identity", "overload"),
]


def several(count: int = 3, profile: str = "vn100", **more: Any) -> BenchDescription:
    """Return a bench with a table and so many streams, each of a gyroscope of its own gain."""
    values: dict[str, Any] = {
        **{key: each for key, each in TABLE.items() if each is not None},
        "limits": LIMITS,
        "gyro": {"stream": {"profile": profile, "sample_rate_hz": 10.0, "aperture_s": 0.3}},
        "device": [
            {
                "name": f"G-{number}",
                "resource": f"/dev/ttyUSB{number}",
                "simulation": {"override": {"output_stage": {"gain": 9.5 * gain}}},
            }
            for number, gain in enumerate(GAINS[:count], 1)
        ],
    }
    return checked_bench(values | more, "several.toml")


def meters() -> BenchDescription:
    """Return the paper's bench with two gyroscopes, a multimeter on each."""
    gain = {"simulation": {"override": {"output_stage": {"gain": 9.0}}}}
    device = [{"name": "A", "resource": "GPIB0::22::INSTR"}, {"name": "B", "resource": "GPIB0::23::INSTR", **gain}]
    return checked_bench(tomllib.loads(embedded_text("paper")) | {"device": device}, "meters.toml")


def with_fault(device: int, fault: dict[str, float], at_s: float) -> Any:
    """Return what builds a bench of which one device has a fault from an instant on."""

    class Later:
        def __init__(self, bench: SimulatedBench) -> None:
            self._bench = bench

        def wake_at(self) -> float | None:
            if self._bench.clock.now() < at_s:
                return at_s
            own: Any = self._bench.devices["multimeter" if device == 1 else f"multimeter-{device}"]
            for each in own.adjustments():
                if (name := each.name.removeprefix("stream.")) in fault and each.read() == 0.0:
                    each.write(fault[name])
            return None

    def build(description: BenchDescription, seed: int, clock: Clock) -> SimulatedBench:
        bench = SimulatedBench.build(description, seed, clock)
        attended: Any = bench.clock
        attended.attend(Later(bench))
        return bench

    return build


def conducted(bench: BenchDescription, build: Any, runs: Path | None = None) -> Run:
    request = Request("turntable", bench, 1, asked_in_python(QUICK), runs, build=build, warn=lambda _: None)
    with StopSignals() as signals:
        return conduct(request, signals)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return vcfbench.run("turntable", several(2), seed=1, settings=QUICK, runs=tmp_path_factory.mktemp("whole"))


def test_devices_are_calibrated_together_each_as_alone(whole: Run, tmp_path: Path) -> None:
    bench, run = several(2), whole
    assert [each.metadata.dut for each in run.devices] == ["G-1", "G-2"]
    alone = vcfbench.run("turntable", bench.of_device("G-2"), seed=1, settings=QUICK, runs=tmp_path)
    assert run.bench_seconds == pytest.approx(alone.bench_seconds, rel=0.05)
    found = [each.values["scale_factor"] for each in run.devices]
    for each, gain in zip(found, GAINS, strict=False):
        assert (each.value or 0.0) / (found[0].value or 1.0) == pytest.approx(gain, abs=1e-3)
    k, k_alone = found[1], alone.values["scale_factor"]
    assert abs((k.value or 0.0) - (k_alone.value or 0.0)) < (k.u95 or 0.0) + (k_alone.u95 or 0.0)
    for each in (run, *run.devices):
        assert each.status is Status.COMPLETE
        assert each.directory is not None
        assert verify_run(each.directory).wrong is None
    assert all(verify_run(str(each.directory)).notes == verify_run(str(alone.directory)).notes for each in run.devices)


def test_unreadable_record_beside_them_is_passed_over(whole: Run, tmp_path: Path) -> None:
    assert whole.directory is not None
    folder = tmp_path / "runs"
    copytree(whole.directory.parent, folder)
    (folder / "odd" / "journal.jsonl").mkdir(parents=True)
    again = vcfbench.load_run(folder / whole.directory.name)
    assert [each.metadata.dut for each in again.devices] == ["G-1", "G-2"]


def test_record_of_each_says_what_that_of_all_says(whole: Run) -> None:
    own = {"run", "utc", "bench", "settings", "identities", "metadata", "equipment", "devices", "seal"}
    assert whole.header["simulated"] is True
    for each in whole.devices:
        assert {name: each.header[name] for name in whole.header if name not in own} == {
            name: said for name, said in whole.header.items() if name not in own
        }
        assert "SIMULATED" in text_of(full_report(each))


@pytest.mark.exhaustive
@pytest.mark.parametrize("procedure", few(["turntable", "zero"], "turntable"))
def test_readings_of_all_are_never_one_table(procedure: str, tmp_path: Path) -> None:
    settings: dict[str, Any] = QUICK if procedure == "turntable" else {"samples": 120}
    run = vcfbench.run(procedure, several(2), seed=1, settings=settings, runs=tmp_path)
    for raw in (True, False):
        with pytest.raises(ConfigError, match=r"not exported: it is of 2 devices, each of which has a record"):
            vcfbench.export_run(run, tmp_path / "all.csv", raw=raw)
    with pytest.raises(ConfigError, match="readings of its own"):
        _ = run.readings
    assert not (tmp_path / "all.csv").exists()
    for each in run.devices:
        times = [reading.t_s for reading in each.readings]
        assert len(times) == len(set(times)) == vcfbench.export_run(each, tmp_path / "own.csv", raw=True).rows
    listed = CliRunner().invoke(app, ["device", "--runs", str(tmp_path), "--devices", str(tmp_path / "devices")])
    assert listed.stdout == "G-1  no entry, complete runs: 1\nG-2  no entry, complete runs: 1\n"


@pytest.mark.exhaustive
@pytest.mark.parametrize("lost", few([1, 2], 2))
def test_stream_lost_in_the_ramps_costs_its_latency_alone(
    lost: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames = StreamReader.frames

    def broken(reader: StreamReader, within_s: float) -> Any:
        if reader.resource.endswith(f"USB{lost}"):
            raise LinkLost("the connection broke")
        return frames(reader, within_s)

    monkeypatch.setattr(StreamReader, "frames", broken)
    run = vcfbench.run("turntable", several(2, "adis16495"), seed=1, settings=QUICK, runs=tmp_path)
    ((_, seen),) = [found for found in run.measured.found(EachResult) if found[1].kind == "LatencySeen"]
    assert [name for name, each in seen.results.items() if each.trouble] == [f"G-{lost}"]
    assert [name for name, each in seen.results.items() if each.latency_s] == [f"G-{3 - lost}"]
    assert len([each for each in tmp_path.iterdir() if each.is_dir()]) == 3


@pytest.mark.exhaustive
def test_one_pair_of_ramps_measures_the_latency_of_each(whole: Run, tmp_path: Path) -> None:
    counted = vcfbench.run("turntable", several(2, "adis16495"), seed=1, settings=QUICK, runs=tmp_path)
    ((_, seen),) = [found for found in counted.measured.found(EachResult) if found[1].kind == "LatencySeen"]
    for (
        each
    ) in seen.results.values():  # a span of 100 ms, 6.5 ms of the gyroscope, 1 to 10 ms drawn; 11 ms of the table
        assert each.latency_s == pytest.approx(50e-3 + 6.5e-3 + 5.5e-3 + 14e-3, abs=6e-3)
    assert counted.bench_seconds is not None
    assert whole.bench_seconds is not None
    assert counted.bench_seconds - whole.bench_seconds < 5.0


def test_record_of_another_run_is_found(whole: Run, tmp_path: Path) -> None:
    records = [each.directory for each in (whole, *whole.devices[:2])]
    for each in records:
        assert each is not None
        copytree(each, tmp_path / each.name)
    of_all, one, other = (tmp_path / each.name for each in records if each is not None)
    journal = (of_all / "journal.jsonl").read_bytes().splitlines(keepends=True)
    (of_all / "journal.jsonl").write_bytes(sealed(b"".join(journal[:-2] + journal[-1:])))
    assert "is another: it has not the seal" in str(verify_run(one).wrong)
    rmtree(of_all)
    assert verify_run(other).wrong is None
    assert any("is missing: its lines" in each for each in verify_run(other).notes)


@pytest.mark.parametrize(
    ("device", "fault", "at_s"),
    few(
        [(device, fault, at_s) for device in (1, 2) for fault in FAULTS for at_s in (0.0, 20.0)],
        (1, "silent", 20.0),
    ),
)
def test_a_device_with_a_fault_ends_for_itself(whole: Run, device: int, fault: str, at_s: float) -> None:
    bench, good = several(2), whole
    run = conducted(bench, with_fault(device, FAULTS[fault], at_s))
    for number, (each, as_ever) in enumerate(zip(run.devices, good.devices, strict=True), 1):
        if each.error is not None:
            assert number == device
            assert each.status is Status.ABORTED
            continue
        k, k_good = (of.values["scale_factor"] for of in (each, as_ever))
        assert abs((k.value or 0.0) - (k_good.value or 0.0)) < max(k.u95 or 0.0, k_good.u95 or 0.0)
        if number != device and at_s:
            assert k.value == pytest.approx(k_good.value, rel=1e-6)
    assert run.devices[device - 1].error is not None or fault in {*LEFT_ALONE, "not well", "clock", "few dropped"}


@pytest.mark.exhaustive
@pytest.mark.parametrize(("at_s", "said"), few([(20.0, "off the others"), (24.0, "apart")], (24.0, "apart")))
def test_a_device_that_jumps_ends_while_the_other_finishes(at_s: float, said: str, tmp_path: Path) -> None:
    bench = several(2)

    class Jump:
        def __init__(self, of: SimulatedBench) -> None:
            self._of, self._done = of, False

        def wake_at(self) -> float | None:
            if self._of.clock.now() < at_s:
                return at_s
            if not self._done:
                self._done = True
                own: Any = self._of.devices["multimeter-2"]
                frame = own._frame_of  # nobody can adjust it: it is the fault
                own._frame_of = {**frame, "value": {**frame["value"], "offset": -0.1}}
            return None

    def build(description: BenchDescription, seed: int, clock: Clock) -> SimulatedBench:
        made = SimulatedBench.build(description, seed, clock)
        attended: Any = made.clock
        attended.attend(Jump(made))
        return made

    run = conducted(bench, build, tmp_path)
    assert [each.status for each in run.devices] == [Status.COMPLETE, Status.ABORTED]
    assert run.devices[1].error is not None
    assert said in str(run.devices[1].error)
    assert " V" not in str(run.devices[1].error)
    for each in (run, *run.devices):
        assert each.directory is not None
        assert verify_run(each.directory).wrong is None
    with pytest.raises(ConfigError, match=r"one of several devices.*cannot be resumed by itself"):
        vcfbench.resume(run.devices[1])


@pytest.mark.exhaustive
@pytest.mark.parametrize("at_s", few([20.0, 0.0], 0.0))
def test_where_all_have_failed_the_error_of_each_is_told(at_s: float, tmp_path: Path) -> None:
    with pytest.raises(BenchError, match=r"G-1: .*ttyUSB1: .*silent.*G-2: .*ttyUSB2: .*silent") as caught:
        conducted(several(2), _both(with_fault(1, FAULTS["silent"], at_s), at_s), tmp_path)
    for number, each in enumerate(caught.value.run.devices, 1):
        assert each.status is Status.ABORTED
        assert re.fullmatch(f"stream at /dev/ttyUSB{number}: .*", str(each.error))


@pytest.mark.parametrize(
    ("device", "kind", "at_s"),
    few(
        [(device, kind, at_s) for device in (1, 2) for kind in METER_FAULTS for at_s in (0.0, 3.0, 15.0, 22.0)],
        (1, "disconnect", 15.0),
        (2, "late", 15.0),
    ),
)
def test_a_meter_with_a_fault_costs_its_device_alone(device: int, kind: Any, at_s: float, tmp_path: Path) -> None:
    def build(description: BenchDescription, seed: int, clock: Clock) -> SimulatedBench:
        behind = _Behind()
        made = behind(description, seed, clock)
        behind.faults.add(Fault("multimeter" if device == 1 else "multimeter-2", kind, at_s=at_s))
        return made

    run = conducted(meters(), build, tmp_path)
    other = run.devices[2 - device]
    assert other.status is Status.COMPLETE
    assert other.values["scale_factor"].value
    assert verify_run(str(other.directory)).wrong is None


@pytest.mark.exhaustive
def test_a_device_that_is_gone_when_a_run_is_resumed_ends_for_itself(
    whole: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    identify = StreamReader.identify

    def gone(reader: StreamReader) -> Any:
        if reader.resource.endswith("USB1"):
            raise DeadlineExceeded("the stream is silent")
        return identify(reader)

    monkeypatch.setattr(StreamReader, "identify", gone)
    with pytest.warns(UserWarning, match="G-1 cannot be read: its measurement ends"):
        again = vcfbench.resume(cut(whole, tmp_path, 2, mark=b'"points":'), runs=tmp_path)
    assert [each.status for each in again.devices] == [Status.ABORTED, Status.COMPLETE]
    assert [len(each.points) for each in again.devices] == [2, 3]
    assert all(verify_run(str(each.directory)).wrong is None for each in (again, *again.devices))


def _both(build: Any, at_s: float) -> Any:
    """Return what builds a bench whose second device is silent as well."""

    def built(description: BenchDescription, seed: int, clock: Clock) -> SimulatedBench:
        made: SimulatedBench = build(description, seed, clock)

        class Silent:
            def wake_at(self) -> float | None:
                if made.clock.now() < at_s:
                    return at_s
                own: Any = made.devices["multimeter-2"]
                next(each for each in own.adjustments() if each.name == "stream.silent").write(1.0)
                return None

        attended: Any = made.clock
        attended.attend(Silent())
        return made

    return built


def test_broken_run_resumes_with_all_devices(whole: Run, tmp_path: Path) -> None:
    again = vcfbench.resume(cut(whole, tmp_path, 2, mark=b'"points":'), runs=tmp_path)
    assert again.status is Status.COMPLETE
    for each, before in zip(again.devices, whole.devices, strict=True):
        k, k_before = (of.values["scale_factor"] for of in (each, before))
        assert abs((k.value or 0.0) - (k_before.value or 0.0)) < (k.u95 or 0.0) + (k_before.u95 or 0.0)
    assert all("of 3 points 2 were measured before the break" in each.resumed[0] for each in again.devices)
    for one in (again, *again.devices):
        assert one.directory is not None
        assert verify_run(one.directory).wrong is None


@pytest.mark.exhaustive
def test_long_windows_of_each_are_kept_in_chunks(tmp_path: Path) -> None:
    settings = {"duration_s": 400.0, "powered_s": 10.0, "devices": str(tmp_path / "devices")}
    run = vcfbench.run("zero", several(2), seed=1, settings=settings, runs=tmp_path)
    for each in (run, *run.devices):
        assert each.status is Status.COMPLETE
        assert each.directory is not None
        assert verify_run(each.directory).wrong is None
    assert [len(each.readings) for each in run.devices] == [400, 400]


def test_bench_file_of_several_is_read_as_written() -> None:
    bench = several()
    assert parse_bench(bench_text(bench), "again.toml") == bench


def test_serial_numbers_of_a_run_are_in_bench_order() -> None:
    metadata = {"dut": "A,B"}
    prepared = prepare(Request("turntable", several(2), metadata=metadata_of(metadata)))
    assert [(each.name, each.metadata.dut) for each in prepared.devices] == [("A", "A"), ("B", "B")]
    with pytest.raises(ConfigError, match="dut: expected 2 serial numbers"):
        vcfbench.dry_run("turntable", several(2), metadata={"dut": "A"})
    with pytest.raises(ConfigError, match="dut: expected one serial number"):
        vcfbench.dry_run("turntable", several(2).of_device("G-1"), metadata=metadata)


def test_batch_and_study_refuse_a_bench_of_several_gyroscopes(tmp_path: Path) -> None:
    (tmp_path / "lot.toml").write_text(bench_text(several(2)), "utf-8")
    told = 'bench = "lot.toml"\n'
    (tmp_path / "batch.toml").write_text(f'name = "b"\n{told}[[runs]]\nprocedure = "turntable"\n', "utf-8")
    (tmp_path / "study.toml").write_text(f'title = "s"\nprocedure = "turntable"\n{told}[seeds]\ncount = 2\n', "utf-8")
    with pytest.raises(ConfigError, match=r"batch\.toml: bench: .* has several"):
        read_batch(tmp_path / "batch.toml")
    with pytest.raises(ConfigError, match=r"study\.toml: bench: .* has several"):
        read_study(tmp_path / "study.toml")


def test_a_procedure_whose_plans_part_is_refused() -> None:
    with pytest.raises(ConfigError, match="g-sensitivity needs an output that is a voltage"):
        vcfbench.dry_run("g-sensitivity", several(2))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ([], "device: expected two or more tables"),
        ([{"name": "A", "resource": "COM1"}] * 2, "device 2.name: expected its serial number, each once"),
        (
            [{"name": "A", "resource": "COM1"}, {"name": "B", "resuorce": "COM2"}],
            r"device 2.resuorce: expected a known key",
        ),
        ([{"name": "A", "resource": "COM1"}, {"name": "B/C", "resource": "COM2"}], "serial number 'B/C'"),
        (
            [{"name": "A", "resource": "COM1"}, {"name": "B", "resource": "COM1", "stream": {"baud_rate": 9600}}],
            "device 2.stream: expected frames as those of A",
        ),
    ],
    ids=str,
)
def test_tables_of_devices_that_cannot_be_are_refused(change: list[dict[str, str]], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        several(device=change)


def test_the_record_of_one_device_says_nothing_of_several() -> None:
    bench = several(2).of_device("G-1")
    assert "devices" not in msgspec.to_builtins(bench)
    assert prepare(Request("turntable", bench)).header_entries() == {}


def test_shared_error_is_in_mean_not_in_differences(whole: Run) -> None:
    run = whole
    (spread,) = spreads_of(run.devices)
    rate = [
        next(part.u for part in each.values["scale_factor"].parts if part.source == TABLE_RATE) for each in run.devices
    ]
    assert spread.owners == ("acl at sim://paper of stream-1, seed 1",)
    assert spread.u_common == pytest.approx(rate[0], rel=0.15)
    assert spread.u_mean > spread.u_common
    assert spread.spread == pytest.approx(0.1 / 2.1 * math.sqrt(2.0) * spread.mean, rel=0.01)
    difference = vcfbench.compare_runs(*run.devices[:2])
    assert difference.instruments == spread.owners
    text = vcfbench.text_of(vcfbench.load_run(str(run.directory)).report())
    assert "Common to all: acl at sim://paper" in text
    assert all(f"G-{number}" in text for number in (1, 2))


@pytest.mark.exhaustive
@pytest.mark.parametrize("counts", few([((1, 0, 0),), ((0, 1, 1),), ((1, 0, 1, 0),)], ((1, 0, 0),)))
def test_spread_is_of_devices_with_one_unit(counts: tuple[int, ...], tmp_path: Path) -> None:
    count = {"stream": {"unit": "LSB"}, "simulation": {"errors": {"multimeter": {"lsb_per_deg_s": 5000.0}}}}
    device = [{"name": f"G-{n}", "resource": f"ASRL{n}", **(count if each else {})} for n, each in enumerate(counts)]
    run = vcfbench.run("turntable", several(device=device), seed=1, settings=QUICK, runs=tmp_path)
    alike = [sum(counts), len(counts) - sum(counts)]
    spreads = spreads_of(run.devices)
    assert sorted(each.devices for each in spreads) == sorted(each for each in alike if each > 1)
    for each in spreads:
        found = [run.values["scale_factor"] for run in run.devices]
        own = [value.value or 0.0 for value in found if value.named.unit == each.unit]
        assert min(own) <= each.mean <= max(own)


@pytest.mark.exhaustive
def test_the_command_shows_a_sheet_and_the_record_of_each(tmp_path: Path) -> None:
    new = ["vcfbench", "sim", "new", "lot.toml", "--stream", "vn100", "--devices", "3", "--noise", "0.2"]
    assert warm.run(new, tmp_path).returncode == 0
    words = ["--bench", "lot.toml", "--quiet", "--samples", "3", "--rates", "50,0,-50", "--dut", "A,B,C"]
    found = warm.run(["vcfbench", "run", "turntable", *words], tmp_path)
    assert found.returncode == 0
    assert "Scale factor of 3 devices" in found.stdout
    assert len([line for line in found.stdout.splitlines() if line.startswith(("A: ", "B: ", "C: "))]) == 3
    refused = warm.run(["vcfbench", "sim", "new", "x.toml", "--devices", "3"], tmp_path)
    assert "--stream PROFILE too" in refused.stderr


@pytest.mark.exhaustive
@pytest.mark.parametrize("of", ["streams", "meters"])
def test_served_devices_give_the_same_scale_factors(of: str, tmp_path: Path) -> None:
    bench = several(2) if of == "streams" else meters()
    here = vcfbench.run("turntable", bench, seed=1, settings=QUICK, runs=tmp_path)
    with serve_simulated(bench, seed=1) as lab:
        there = vcfbench.run("turntable", lab.on_wires(), settings=QUICK, runs=tmp_path)
    for one, other in zip(here.devices, there.devices, strict=True):
        k, k_there = (each.values["scale_factor"] for each in (one, other))
        assert abs((k.value or 0.0) - (k_there.value or 0.0)) < (k.u95 or 0.0)


@pytest.mark.exhaustive
def test_multimeters_of_each_device_read_at_the_same_time(tmp_path: Path) -> None:
    bench = meters()
    run = vcfbench.run("turntable", bench, seed=1, settings=QUICK, runs=tmp_path)
    assert (run.bench_seconds or 0.0) < 40.0
    one, other = (each.values["scale_factor"].value or 0.0 for each in run.devices)
    assert other / one == pytest.approx(9.0 / physical_parameters(bench).output_stage.gain, rel=2e-3)
    assert all(verify_run(str(each.directory)).wrong is None for each in run.devices)
    with pytest.raises(PlanError, match="without gaps is taken of one device"):
        vcfbench.dry_run("zero", bench, settings={"mode": "gapless"})
    with pytest.raises(ConfigError, match="kvc needs separate steps for each device"):
        vcfbench.dry_run("kvc", bench)


def test_each_devices_meter_is_told_by_the_serial_number_that_it_answered() -> None:
    """What one meter is off by is common to all that it reads, and to no other."""
    prepared = prepare(Request("turntable", msgspec.structs.replace(meters(), simulation=None)))
    answered = {name: Identity("KEYSIGHT", "34465A", serial, "1.0") for name, serial in zip("AB", "12", strict=True)}
    outputs = Outputs(dict.fromkeys("AB", Mock(resource="GPIB")), answered, {})
    meter = {"identities": {"multimeter": answered["A"]}, "instruments": {"multimeter": outputs}}
    bench = SimpleNamespace(seed=None, simulated_roles=(), **meter)
    prepared.take_bench(bench)  # type: ignore[arg-type]
    owners = [each.settings.station.instruments["multimeter"].owner for each in prepared.devices]
    assert ["no. 1" in owners[0], "no. 2" in owners[1]] == [True, True]


def test_a_check_of_the_bench_tries_the_output_of_each() -> None:
    found = check_bench(several(2))
    assert [each.role for each in found.instruments] == ["multimeter of G-1", "multimeter of G-2", "rate_table"]
    assert [each.problem for each in found.instruments] == [None] * 3
    assert (
        what_can_run(several(2), ["multimeter of G-2"])["turntable"] == "turntable opens multimeter of G-2, not ready"
    )
