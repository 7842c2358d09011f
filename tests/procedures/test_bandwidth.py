"""The rate response of simulated gyroscopes against the closed form of their parameters."""

from __future__ import annotations

import cmath
import math
from itertools import pairwise
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
from msgspec import structs

import vcfbench
from vcfbench.errors import LimitError, MeasurementError
from vcfbench.procedures.bandwidth import BANDWIDTH, measured_phases, phase_channels
from vcfbench.procedures.layers import settings_of
from vcfbench.sim.simulation import physical_parameters
from vcfbench.station.parts import Limits
from vcfbench.steps import CaptureSines, SetSine, SineRecord, SineRecords
from vcfbench.testing import simulated

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench.sim.parameters import BenchParameters
    from vcfbench.station.description import BenchDescription

COLD = {"thermal": {"self_heating_k": 0.0}}
"""A gyroscope that needs no warming up."""
QUICK: dict[str, Any] = {
    "warm_up_s": 0.0,
    "frequencies_hz": [2.0, 6.0, 12.0, 18.0, 30.0, 40.0, 55.0],
    "around_split": [0.54, 0.75, 0.92, 0.97, 1.0, 1.03, 1.08, 1.2, 1.5],
}
SPLIT_HZ, Q = 3488.9 - 3464.1, 1224.0


@pytest.mark.exhaustive
def test_split_and_q_come_back_from_readings_alone(tmp_path: Path) -> None:
    """+3 dB, peak and -3 dB with the in-phase mode at equal sign are 14.24, 24.73 and 35.0 Hz (docs/theory.md)."""
    run = vcfbench.run("bandwidth", simulated(overrides=COLD), seed=4, settings=QUICK, runs=tmp_path)
    assert run.error is None
    found = run.results
    assert abs(found.split_hz.value - SPLIT_HZ) < 4.0 * found.split_hz.u < 0.01
    assert abs(found.q.value - Q) < 4.0 * found.q.u < 5.0
    assert found.plus_3_db_hz.value == pytest.approx(14.25, abs=0.02)
    assert found.peak_hz.value == pytest.approx(24.73, abs=0.01)
    assert found.minus_3_db_hz.value == pytest.approx(34.98, abs=0.04)
    assert found.drive_hz == pytest.approx(3488.9, abs=5.0 * found.u_drive_hz)
    assert found.split_hz.u95 == pytest.approx(found.split_hz.coverage_factor * found.split_hz.u)
    assert run.directory is not None
    again = vcfbench.load_run(run.directory)
    assert again.results == found


def seen_on_the_oscilloscope() -> BenchDescription:
    """Return the bench with V_Vc in place of the sense signal on the oscilloscope."""
    bench = simulated(overrides=COLD)
    scope = structs.replace(bench.wiring.oscilloscope, channel_3="v_vc")
    return structs.replace(bench, wiring=structs.replace(bench.wiring, oscilloscope=scope))


def true_phase_deg(parameters: BenchParameters, at_hz: float) -> float:
    """Return the phase of the demodulated response with its filter in P and R (docs/theory.md), that at rest off."""
    path = parameters.virtual_path
    angle = path.carrier_phase_rad - parameters.sense_path.demodulator_phase_rad
    driven = 2.0 * math.pi * parameters.drive_mode.frequency_hz
    by_hz = []
    for frequency_hz in (at_hz, 0.0):
        s, total = 2j * math.pi * frequency_hz, 0j
        for mode in (parameters.sense_in_phase, parameters.sense_anti_phase):
            own, q = 2.0 * math.pi * mode.frequency_hz, mode.quality
            p, r = s**2 + own / q * s + own**2 - driven**2, 2.0 * s * driven + own * driven / q
            combs = (
                mode.left_participation * path.left_comb_n_per_v2 + mode.right_participation * path.right_comb_n_per_v2
            )
            total += mode.pick_off_v_per_m * combs * (p * math.cos(angle) + r * math.sin(angle)) / (p**2 + r**2)
        by_hz.append(total)
    u = 1j * at_hz / 100.0
    low_pass = 1.0 / ((u**2 + 0.765366865 * u + 1.0) * (u**2 + 1.847759065 * u + 1.0))  # Butterworth, fourth order
    return math.degrees(cmath.phase(by_hz[0] / by_hz[1] * low_pass))


@pytest.mark.exhaustive
def test_phases_come_back_where_the_oscilloscope_sees_v_vc(tmp_path: Path) -> None:
    bench = seen_on_the_oscilloscope()
    settings = {**QUICK, "frequencies_hz": [0.3, *QUICK["frequencies_hz"]]}
    run = vcfbench.run("bandwidth", bench, seed=4, settings=settings, runs=tmp_path)
    assert run.error is None
    found, parameters = run.results.phase, physical_parameters(bench)
    assert len(found) == len(QUICK["frequencies_hz"]) + len(QUICK["around_split"]) + 1
    off = [
        math.remainder(each.phase_deg.value - true_phase_deg(parameters, each.frequency_hz), 360.0) for each in found
    ]
    held = [abs(each) <= point.phase_deg.u95 for each, point in zip(off, found, strict=True)]
    assert sum(held) >= len(held) - 3
    assert max(map(abs, off)) < 1.0  # at 55 Hz the output is a tenth of that at rest
    assert abs(off[0]) < 0.5
    assert all(one.phase_deg.value > following.phase_deg.value for one, following in pairwise(found))
    assert found[0].phase_deg.value == pytest.approx(0.0, abs=1.5)
    again = vcfbench.load_run(run.directory)
    assert again.results == run.results
    assert "Phase of the output against V_Vc" in vcfbench.text_of(run.report())


def test_phase_is_as_uncertain_as_the_mean_of_its_records() -> None:
    settings = settings_of(BANDWIDTH, seen_on_the_oscilloscope())
    channels = phase_channels(settings)
    assert channels is not None
    records = tuple(SineRecord(9.0, (1.0, 0.5), (0.0, phase_deg)) for phase_deg in (-10.0, -10.3, -9.7, -10.4))
    step = CaptureSines(channels, (1.0, 1.0), len(records), records[0])
    measured: Any = SimpleNamespace(found=lambda _: [(step, SineRecords(channels, records))])
    (point,) = measured_phases(settings, measured, lambda _: -10.0)
    assert point.phase_deg.value == pytest.approx(-10.1)
    assert point.phase_deg.u == pytest.approx(math.sqrt((0.1**2 + 0.2**2 + 0.4**2 + 0.3**2) / 3.0 / 4.0))


def test_phases_need_v_vc_and_output_on_oscilloscope() -> None:
    def captures(bench: BenchDescription) -> list[tuple[int, ...]]:
        taken = [each.step for each in vcfbench.dry_run("bandwidth", bench).steps]
        return [each.channels for each in taken if isinstance(each, CaptureSines)]

    assert captures(simulated(overrides=COLD)) == [(1,)]
    seen = captures(seen_on_the_oscilloscope())
    assert seen == [(1,), *[(3, 4)] * 35]


def test_without_an_oscilloscope_the_drive_is_anywhere_in_its_window() -> None:
    """3475 to 3503 Hz, of which Q, in proportion to it, has 14 Hz over the root of 3."""
    small = structs.replace(simulated(overrides=COLD), oscilloscope=None)
    asked = {"frequencies_hz": [1.0, 4.5, 9.0, 16.0, 31.0, 48.0], "around_split": [0.7, 0.9, 0.97, 1.03, 1.1]}
    (q,) = (each for each in vcfbench.dry_run("bandwidth", small, settings=asked).expected.values if each.name == "q")
    assert dict(q.causes)["drive frequency"] == pytest.approx(Q * 14.0 / 3**0.5 / 3489.0, rel=0.01)


@pytest.mark.exhaustive
def test_without_an_oscilloscope_q_knows_less(tmp_path: Path) -> None:
    """It is in proportion to the drive frequency, of which only the window is known then."""
    limits = Limits(max_v_vc_v=10.0, min_rail_v=9.5, max_rail_v=10.5, max_rail_current_a=0.2)
    small = structs.replace(simulated(overrides=COLD), oscilloscope=None, rate_table=None, limits=limits)
    run = vcfbench.run("bandwidth", small, seed=5, settings=QUICK, runs=tmp_path)
    assert run.error is None
    assert run.results.q.u == pytest.approx(Q * 14.0 / 3**0.5 / 3489.0, rel=0.1)
    assert abs(run.results.q.value - Q) < 3.0 * run.results.q.u
    assert run.not_checked


def test_a_dry_run_goes_closely_about_the_expected_split() -> None:
    steps = vcfbench.dry_run("bandwidth").steps
    words = [each.step.describe() for each in steps]
    assert any("near 24.8" in each for each in words)
    assert sum("sample the output" in each for each in words) == 35


def test_mains_pick_up_is_not_taken_for_response() -> None:
    asked = {"frequencies_hz": [4.0, 9.0, 16.0, 49.5, 50.0, 51.5], "around_split": [1.0, 2.01]}
    steps = vcfbench.dry_run("bandwidth", settings=asked).steps
    sines = [each.step.frequency_hz for each in steps if isinstance(each.step, SetSine)]
    assert sines == pytest.approx([4.0, 9.0, 16.0, 51.5, 24.8], rel=0.01)


def test_sine_beyond_v_vc_limit_is_refused_before_opening() -> None:
    paper = vcfbench.load_bench()
    assert paper.limits is not None
    tight = structs.replace(paper, limits=structs.replace(paper.limits, max_v_vc_v=2.0))
    with pytest.raises(LimitError, match="peak voltage 3 V"):
        vcfbench.dry_run("bandwidth", tight, settings={"sine_amplitude_v": 3.0})


@pytest.mark.exhaustive
def test_an_output_at_its_limit_gives_no_result(tmp_path: Path) -> None:
    """The fit would give Q 943 for 1224, with an uncertainty of 0.6."""
    bench = simulated(overrides={**COLD, "output_stage": {"headroom_v": 9.4}})
    with pytest.raises(MeasurementError, match="times as far from the closed form as their u explains"):
        vcfbench.run("bandwidth", bench, settings=QUICK, runs=tmp_path)
