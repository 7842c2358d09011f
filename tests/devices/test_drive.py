"""The drive's frequency, first and last: at which temperature values hold, and how far that moved."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import pytest
from msgspec import to_builtins
from msgspec.structs import replace
from simrack.faults import Fault
from simrack.faulty_device import FaultInjector
from simrack_tests.cells import few

import vcfbench
from tests.golden.cases import BENCHES, SETTINGS
from vcfbench.devices.drive import beyond_bearing, drive_of
from vcfbench.errors import BenchError
from vcfbench.instructions.titles import BUILT_IN
from vcfbench.procedures.bench_file import load_bench
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.layers import asked_in_python
from vcfbench.records.device_values import Characteristics
from vcfbench.records.device_values import Measured as Kept
from vcfbench.records.schema import Status
from vcfbench.runs.conduct import conduct
from vcfbench.runs.request import Request
from vcfbench.safety.signals import StopSignals
from vcfbench.sim.builder import SimulatedBench
from vcfbench.station.settings import ProcedureSettings, Sources, Station
from vcfbench.steps import DriveFrequency, DriveReading, MeasureDrive, MeasureDriveAgain
from vcfbench.steps.measured import Measured
from vcfbench.values.definition import Conditions, Drive

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench.clock import Clock
    from vcfbench.station.description import BenchDescription

KNOWN = Characteristics(
    temperature_c=Kept(value=20.0, u=0.5), drive_hz=Kept(value=3500.0, u=0.05), drive_ppm_k=Kept(value=-25.0, u=0.5)
)


def measured(first_hz: float, last_hz: float | None, u_hz: float = 0.01) -> Measured:
    """Return what a run found of the drive alone."""
    check, again = MeasureDrive(1, 2, 1.0, 1.0, (3500.0, 1.0, 0.0)), MeasureDriveAgain(1, 1.0, 3500.0)
    found: list[Any] = [(check, DriveReading(3492.1, 1.0, 0.0, 1.0, fitted=DriveFrequency(first_hz, u_hz)))]
    found += [] if last_hz is None else [(again, DriveFrequency(last_hz, u_hz))]
    lines = [
        {"type": "step", "n": n, "step_kind": type(step).__name__, "step": to_builtins(step)}
        | {"result_kind": type(result).__name__, "result": result.as_json()}
        for n, (step, result) in enumerate(found, 1)
    ]
    return Measured((), lambda: lines)


def settings(known: Characteristics | None = None, **sources: float) -> ProcedureSettings:
    characteristics = {} if known is None else to_builtins(known)
    return ProcedureSettings(station=Station(sources=Sources(**sources), characteristics=characteristics))


@pytest.mark.parametrize("name", few([each for each in BUILT_IN if each not in {"electrical", "temperature"}], every=4))
def test_every_plan_measures_the_drive_first_and_last(name: str) -> None:
    """`temperature` does at each temperature; `electrical` switches nothing on."""
    asked, bench = SETTINGS.get(name, {}), BENCHES.get(name, ("ideal",))[0]
    steps = [each.step for each in vcfbench.dry_run(name, bench, settings=asked).steps]
    looks = [type(each) for each in steps if isinstance(each, MeasureDrive | MeasureDriveAgain)]
    assert looks[0] is MeasureDrive
    assert MeasureDriveAgain in looks


SHORT = {"zero": {"duration_s": 200.0}, "kvc": {"health": False}}
LATE_S = {"turntable": 100.0, "kvc": 100.0, "zero": 1900.0}
"""After the first looks at the drive, before the last."""
FAULTS = ("disconnect", "silent", "error", "garbled", "truncated")


@pytest.mark.parametrize("kind", few(FAULTS, "disconnect"))
@pytest.mark.parametrize("procedure", few(["turntable", "kvc", "zero"], "turntable"))
def test_last_look_at_the_drive_costs_no_run_its_results(procedure: str, kind: str, tmp_path: Path) -> None:
    def build(description: BenchDescription, seed: int, clock: Clock) -> SimulatedBench:
        built = SimulatedBench.build(description, seed, clock)
        faults = FaultInjector(built.devices, built.clock, seed)
        faults.add(Fault("oscilloscope", kind, at_s=LATE_S[procedure]))
        attended: Any = built.clock
        attended.attend(*faults.devices.values())
        return replace(built, devices=faults.devices)

    asked = asked_in_python(SHORT.get(procedure, {}))
    request = Request(PROCEDURES[procedure], load_bench("lab"), 1, asked, tmp_path, build=build)
    with suppress(BenchError):  # of a link that is still down, at the end
        conduct(request, StopSignals())
    (record,) = (each for each in tmp_path.iterdir() if procedure in each.name)
    run = vcfbench.load_run(record)
    assert (run.status, run.no_results) == (Status.COMPLETE, None)
    ((_, seen),) = run.measured.found(DriveFrequency)
    assert f"the drive once more: {seen.trouble}"[:40] in vcfbench.text_of(run.report())
    assert run.values


def test_what_moves_is_told_by_the_device_s_own_coefficient() -> None:
    drive = drive_of(settings(KNOWN), measured(3500.0, 3500.0 * (1.0 - 100e-6)))
    assert drive is not None
    assert drive.moved_k == pytest.approx(4.0)
    u_k = 1e6 * math.sqrt(2.0) * 0.01 / 3500.0 / 25.0
    assert drive.u_moved_k == pytest.approx(math.hypot(u_k, 4.0 * 0.5 / 25.0), rel=1e-3)
    assert drive.temperature_c == pytest.approx(22.0, abs=1e-3)
    assert drive.u_temperature_k == pytest.approx(math.hypot(0.5, 14.4 / 25.0, 14.3 / 25.0, 2.0 * 0.5 / 25.0), rel=0.02)
    assert not drive.assumed


def test_that_of_its_class_is_said_to_be_assumed() -> None:
    drive = drive_of(settings(), measured(3500.0, 3499.79))
    assert drive is not None
    assert drive.moved_k == pytest.approx(2.0)
    assert (drive.temperature_c, drive.assumed) == (None, "-30 ppm/K assumed")
    for moved_k, words in (
        (-2.0, "cooled by 2.0 K (U95 1.2 K, by"),
        (-0.04, "changed its temperature by less than 1.2 K ("),
    ):
        assert words in replace(drive, moved_k=moved_k).words
    said = Conditions((10.0, -10.0), None, drive).words
    assert "drive 3499.89 Hz; during the run the device warmed by 2.0 K (U95 1.2 K, by -30 ppm/K assumed)" in said


def test_run_without_last_record_has_frequency_without_change() -> None:
    drive = drive_of(settings(), measured(3500.0, None))
    assert drive is not None
    assert (drive.frequency_hz, drive.moved_k) == (3500.0, None)
    assert drive_of(settings(), Measured(())) is None


@pytest.mark.parametrize(("moved_k", "said"), [(4.0, False), (6.5, True), (-6.5, True)])
def test_what_is_further_than_the_uncertainties_hold_is_said(moved_k: float, *, said: bool) -> None:
    drive = Drive(3500.0, 0.05, moved_k, 0.2)
    assert bool(beyond_bearing(settings(temperature_k=4.0, warm_up_k=1.0), drive)) is said


def test_a_run_states_both(tmp_path: Any) -> None:
    """Truth: 20 degC all the while, and a drive whose time base is off by 25 ppm at most."""
    run = vcfbench.run("turntable", "paper", seed=3, runs=tmp_path, settings={"rates_deg_s": (50.0, 0.0, -50.0)})
    drive = run.values["scale_factor"].conditions.drive
    assert drive is not None
    assert drive.moved_k is not None
    assert drive.u_moved_k is not None
    assert abs(drive.frequency_hz - 3488.9) < 2.0 * drive.u_hz + 0.1
    assert abs(drive.moved_k) < 3.0 * drive.u_moved_k < 1.0
    assert run.as_json()["values"][0]["conditions"]["drive"]["moved_k"] == drive.moved_k
    assert vcfbench.load_run(run.directory).values["scale_factor"].conditions.drive == drive
