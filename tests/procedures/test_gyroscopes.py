"""Gyroscopes other than the paper's, over drives, splits, quality factors, quadrature: the values as they are.

Benches without errors but for the oscilloscope's eight bits, and without noise: what is found is the data sheet's.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import pytest

import vcfbench
from tests.cells import few
from vcfbench.sim.gyro.data_sheet import DataSheet, in_phase_share
from vcfbench.sim.own_gyro import own_gyro_bench

if TYPE_CHECKING:
    from pathlib import Path

DRIVES_HZ = (1000.0, 2000.0, 3488.9, 4100.0, 5000.0, 8000.0, 12_000.0, 18_000.0, 25_000.0, 50_000.0)
SPLITS_HZ = (3.0, 8.0, 40.0, 80.0, -3.0, -8.0, -24.8, -40.0, -80.0)
QUADRATURES_DEG_S = (0.0, 60.0, 100.0, 150.0, 200.0, 300.0)


def sheet_of(
    drive_hz: float = 3488.9, split_hz: float = 24.8, quadrature_deg_s: float = 20.0, **more: Any
) -> DataSheet:
    """Return a data sheet whose quality factor gives the response a peak."""
    q = max(1224.0, math.ceil(3.0 * drive_hz / abs(split_hz)))
    return DataSheet(
        drive_hz=drive_hz, split_hz=split_hz, **{"q_sense": q, "quadrature_deg_s": quadrature_deg_s, **more}
    )


def named(sheet: DataSheet) -> str:
    return f"{sheet.drive_hz:g} {sheet.split_hz:g} {sheet.q_sense:g} {sheet.quadrature_deg_s:g} {sheet.rail_v:g}"


SHEETS = (
    *(sheet_of(drive_hz=each) for each in DRIVES_HZ),
    *(sheet_of(split_hz=each) for each in SPLITS_HZ),
    *(sheet_of(quadrature_deg_s=each) for each in QUADRATURES_DEG_S),
    *(sheet_of(split_hz=split, q_sense=q) for split, q in ((80.0, 100.0), (24.8, 300.0), (24.8, 10_000.0))),
    *(sheet_of(drive_hz, split_hz, q_sense=q) for drive_hz, split_hz, q in ((1e3, 3.0, 700.0), (1e3, 80.0, 100.0))),
    *(sheet_of(rail_v=rail_v, scale_factor_v_per_deg_s=1.2e-3 * rail_v) for rail_v in (5.0, 15.0)),
)
QUICK_SHEETS = (sheet_of(drive_hz=18_000.0), sheet_of(split_hz=-24.8))


def bench_of(sheet: DataSheet, folder: Path, **replaced: str) -> Path:
    """Write the bench of a gyroscope, the lines of windows replaced by key, or left out where by nothing."""
    lines = own_gyro_bench(sheet, "own").splitlines()
    found = [replaced.get(line.split(" = [")[0], line) for line in lines]
    path = folder / "own.toml"
    path.write_text("\n".join(found) + "\n", "utf-8")
    return path


def run(procedure: str, bench: Path, **settings: Any) -> Any:
    return vcfbench.run(procedure, bench, settings=settings, runs=bench.parent / "runs", seed=1).results


@pytest.mark.exhaustive
@pytest.mark.parametrize("sheet", few(dict.fromkeys((*SHEETS[::4], *QUICK_SHEETS)), QUICK_SHEETS[1]), ids=named)
def test_drawn_gyroscope_has_characteristics_of_data_sheet(sheet: DataSheet, tmp_path: Path) -> None:
    found = run("kvc", bench_of(sheet, tmp_path), samples=3)
    seen = found.characteristics
    assert found.k_vc.value == pytest.approx(sheet.k_vc_deg_s_per_v, rel=1e-4)
    assert seen.drive_hz.value == pytest.approx(sheet.drive_hz, rel=1e-6)
    assert seen.split_hz.value == pytest.approx(sheet.split_hz, rel=2e-4)
    assert seen.q_anti_phase.value == pytest.approx(sheet.q_sense, rel=2e-3)
    assert seen.in_phase_split_hz.value == pytest.approx(sheet.in_phase_split_hz, rel=1e-3)
    assert seen.q_in_phase.value == pytest.approx(sheet.q_sense, rel=0.03)
    assert seen.in_phase_share.value == pytest.approx(in_phase_share(sheet), rel=0.03, abs=4.0 * seen.in_phase_share.u)
    assert abs(seen.v_vc_feedthrough.value) < 2e-5 + 3.0 * seen.v_vc_feedthrough.u
    for phase in (seen.carrier_phase_deg, seen.demodulator_phase_deg, seen.sense_phase_deg):
        assert phase.value == pytest.approx(0.0, abs=0.12)


@pytest.mark.exhaustive
@pytest.mark.parametrize("sheet", few(SHEETS[:10:4], SHEETS[0]), ids=named)
def test_phases_are_those_of_the_data_sheet(sheet: DataSheet, tmp_path: Path) -> None:
    found = run("phase", bench_of(sheet, tmp_path), warm_up_s=10.0)
    lag_deg = math.degrees(math.atan2(sheet.drive_hz / sheet.q_sense, 2.0 * abs(sheet.split_hz)))  # of one mode alone
    assert found.coriolis_from_velocity_deg.value == pytest.approx(math.copysign(lag_deg, sheet.split_hz), rel=0.3)
    assert found.virtual_from_coriolis_deg.value == pytest.approx(0.0, abs=0.12)
    assert found.carrier_from_velocity_deg.value == pytest.approx(0.0, abs=0.12)


@pytest.mark.exhaustive
@pytest.mark.parametrize("sheet", few((*SHEETS[12:20:3], *QUICK_SHEETS[1:2]), *QUICK_SHEETS[1:2]), ids=named)
def test_the_vibration_of_a_healthy_device_is_the_closed_forms(sheet: DataSheet, tmp_path: Path) -> None:
    found = run("vibration", bench_of(sheet, tmp_path), warm_up_s=10.0)
    assert found.largest_e_n < 1.0
    for each in found.responses:
        assert each.response.value == pytest.approx(each.expected.value, rel=2e-3)


@pytest.mark.exhaustive
def test_windows_of_the_drive_are_no_values(tmp_path: Path) -> None:
    """Nothing but checks by the window of frequency and amplitude: wide ones give the same."""
    bench = bench_of(sheet_of(), tmp_path, frequency_hz="frequency_hz = [1000.0, 50000.0]", amplitude_v="")
    found = run("kvc", bench, samples=3)
    assert found.characteristics.drive_hz.value == pytest.approx(3488.9, rel=1e-6)
    assert found.characteristics.drive_amplitude_v.value == pytest.approx(1.0, rel=1e-3)
