"""Phases of simulated gyroscopes against the closed form of their parameters."""

from __future__ import annotations

import cmath
import math
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from msgspec import structs

import vcfbench
from vcfbench.archive.unseen import refusable, unseen_of
from vcfbench.clock import VirtualClock
from vcfbench.errors import ConfigError, MeasurementError
from vcfbench.interfaces import Waveform
from vcfbench.procedures.phase import CaptureSense, PhaseSettings, in_turn
from vcfbench.sim.simulation import true_output
from vcfbench.steps import CaptureSines, ConfigureScope, SineRecord
from vcfbench.testing import simulated

if TYPE_CHECKING:
    from pathlib import Path

OVERRIDES = {
    "thermal": {"self_heating_k": 0.0},
    "drive_mode": {"frequency_hz": 3485.0},
    "sense_path": {"demodulator_phase_rad": math.pi + 0.02},
    "virtual_path": {"carrier_phase_rad": math.pi - 0.03},
}
BUTTERWORTH = 2.0 * math.cos(math.pi / 8.0), 2.0 * math.cos(3.0 * math.pi / 8.0)
"""Damping of the two stages of the filter of 100 Hz, which the records see at 8 Hz."""
QUICK = {"warm_up_s": 0.0, "records": 2, "rotation_records": 1, "most_cycles": 3}


def truth() -> dict[str, float]:
    """Return the phases of `OVERRIDES`, deg; modes, shares and combs are those of `sim show`, docs/theory.md."""
    driven = 3485.0
    by_rate = by_v_vc = 0j
    for mode_hz, left, right in ((3342.0, 0.8, 0.2), (3464.1, 0.5, 0.5)):
        passed = 1.0 / complex(mode_hz**2 - driven**2, mode_hz * driven / 1224.0)
        by_rate += (left + right) * passed
        by_v_vc += (left * 1.01 + right * 0.99) * passed
    coriolis = math.degrees(cmath.phase(by_rate)) - 90.0
    virtual = math.degrees(cmath.phase(by_v_vc) - 0.03) - 90.0
    demodulator = math.degrees(0.02) + 90.0
    seen, aside = (math.cos(math.radians(each - demodulator)) for each in (virtual, coriolis))
    return {
        "carrier_deg": -90.0 - math.degrees(0.03),
        "coriolis_deg": coriolis + 360.0,
        "virtual_deg": virtual + 360.0,
        "demodulator_deg": demodulator - 180.0,
        "carrier_from_velocity_deg": -math.degrees(0.03),
        "virtual_from_coriolis_deg": virtual - coriolis,
        "k_vc_error_ppm": 1e6 * (seen / aside - 1.0),
        "filter_delay_ms": 1e3 * sum(math.atan2(a * 0.08, 1.0 - 0.08**2) for a in BUTTERWORTH) / (16.0 * math.pi),
    }


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> vcfbench.Run:
    runs = tmp_path_factory.mktemp("phase")
    bench = simulated("paper", errors="drawn", overrides=OVERRIDES)
    return vcfbench.run("phase", bench, seed=7, settings=QUICK, runs=runs)


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", list(truth()))
def test_a_phase_is_that_of_the_parameters(run: vcfbench.Run, name: str) -> None:
    assert run.error is None
    found = getattr(run.results, name)
    assert abs(found.value - truth()[name]) < 2.0 * found.u95  # a few records: u has few degrees of freedom


def test_every_phase_is_known_to_the_target(run: vcfbench.Run) -> None:
    found = run.results
    phases = found.carrier_deg, found.coriolis_deg, found.virtual_deg, found.demodulator_deg
    assert all(0.0 < each.u < each.u95 < 0.1 for each in phases)
    assert found.target_met == all(each.u95 <= found.target_deg for each in phases)
    assert found.k_vc_error_ppm.u < 60.0
    assert found.drive_hz == pytest.approx(3485.0, abs=0.3)
    assert found.records == 3 * (4 * 2 + 2) + 1  # the first sine is set again: time bases differ


def test_carrier_phase_moves_k_vc_by_the_closed_form(run: vcfbench.Run) -> None:
    """880 ppm a degree near 0 of a common phase, with which the demodulator turns as well: the rest is the cosines'."""
    true = truth()
    angle = math.radians(true["virtual_deg"] - true["demodulator_deg"] - 180.0)
    assert run.results.k_vc_ppm_per_carrier_deg == pytest.approx(-math.tan(angle) * 1e6 * math.pi / 180.0, abs=30.0)


def test_demodulator_degree_moves_values_as_the_closed_form(run: vcfbench.Run) -> None:
    """Against the true outputs of gyroscopes whose demodulator is half a degree off either way."""
    warm = [
        true_output(simulated("paper", overrides={**OVERRIDES, "sense_path": {"demodulator_phase_rad": at}}))
        for at in (math.pi + 0.02 + sign * math.radians(0.5) for sign in (1.0, -1.0))
    ]
    slopes = [(each(50.0, None) - each(-50.0, None)) / 100.0 for each in warm]
    let_in_deg_s = (warm[0](0.0, None) - warm[1](0.0, None)) / (sum(slopes) / 2.0)
    ppm = 1e6 * (slopes[0] / slopes[1] - 1.0)
    assert run.results.scale_factor_ppm_per_demodulator_deg == pytest.approx(ppm, abs=30.0)
    assert run.results.bias_deg_s_per_demodulator_deg == pytest.approx(let_in_deg_s, abs=0.01)
    k_vc = [slope / ((each(0.0, 0.05) - each(0.0, -0.05)) / 0.1) for slope, each in zip(slopes, warm, strict=True)]
    by_demodulator_ppm = 1e6 * (k_vc[1] / k_vc[0] - 1.0)
    assert abs(by_demodulator_ppm) > 30.0
    assert run.results.k_vc_ppm_per_demodulator_deg == pytest.approx(by_demodulator_ppm, abs=8.0)


def test_the_report_has_what_budgets_may_know(run: vcfbench.Run) -> None:
    said = vcfbench.text_of(run.report()).replace("\n  ", " ")
    for key in ("k_vc_ppm_carrier_deg", "scale_factor_ppm_demodulator_deg", "bias_deg_s_demodulator_deg"):
        assert f"{key} = " in said


def test_a_record_shows_what_the_run_showed(run: vcfbench.Run) -> None:
    assert run.directory is not None
    assert vcfbench.load_run(run.directory).results == run.results


def test_the_report_says_which_way_k_vc_is_wrong(run: vcfbench.Run) -> None:
    way = "small" if truth()["k_vc_error_ppm"] < 0.0 else "large"
    text = vcfbench.text_of(run.report())
    assert f"K_Vc by equal outputs: {abs(run.results.k_vc_error_ppm.value):.0f} ppm too {way}, U95 " in text
    assert "too large by" not in text


def test_the_report_draws_the_sense_signal_of_each_state(run: vcfbench.Run) -> None:
    (figure,) = [part for part in run.report().parts if isinstance(part, vcfbench.Figure)]
    assert [each.label for each in figure.series] == ["rate +", "rate -", "V_Vc +", "V_Vc -"]
    plus, minus = (
        complex(sum(each.x) / len(each.x), sum(each.y) / len(each.y)) for each in (figure.series[0], figure.series[1])
    )
    coriolis_deg = math.degrees(math.atan2((plus - minus).imag, (plus - minus).real))
    assert coriolis_deg == pytest.approx(run.results.coriolis_deg.value, abs=0.01)


def test_a_dry_run_ends_after_three_cycles() -> None:
    words = [each.step.describe() for each in vcfbench.dry_run("phase").steps]
    assert sum("records of drive, sense, output" in each for each in words) == 6
    assert "Cycle 3" in " ".join(words)
    assert "Cycle 4" not in " ".join(words)


def test_records_begin_anywhere_in_the_drives_period() -> None:
    """Triggered at the same phase, 8 bit would leave the same error in each, which no scatter shows."""
    before = None
    for step in (each.step for each in vcfbench.dry_run("phase").steps):
        if isinstance(step, ConfigureScope):
            before = step
        elif isinstance(step, CaptureSense):
            assert before is not None
            assert step.amplitudes_v[0] < before.level_v < 2.0 * step.amplitudes_v[0]


def test_unwired_channel_is_refused_before_opening() -> None:
    paper = vcfbench.load_bench()
    wiring = structs.replace(paper.wiring, oscilloscope=structs.replace(paper.wiring.oscilloscope, channel_4=None))
    with pytest.raises(ConfigError, match="a channel on 'output'"):
        vcfbench.dry_run("phase", structs.replace(paper, wiring=wiring))


@pytest.mark.exhaustive
@pytest.mark.parametrize("broken", [{"sense_path": {"multiplier_per_v": 0.0}}, {"output_stage": {"gain": 0.0}}])
def test_an_output_without_a_signal_has_no_demodulators_phase(broken: dict[str, Any], tmp_path: Path) -> None:
    bench = simulated("paper", overrides={**OVERRIDES, **broken})
    with pytest.raises(MeasurementError, match="the output does not respond to the sense signal"):
        vcfbench.run("phase", bench, seed=9, settings=QUICK, runs=tmp_path)


def test_the_table_turns_no_faster_than_it_is_told() -> None:
    assert PhaseSettings(rate_deg_s=30.0).fastest_deg_s == pytest.approx(30.0)


class Scope:
    """Shows cosines of one frequency on every channel: amplitude (V), phase (deg), offset (V)."""

    def __init__(self, shown: dict[int, tuple[float, float, float]]) -> None:
        self.shown, self.scales, self.taken = shown, dict[int, float](), list[tuple[int, ...]]()

    def configure_channel(self, channel: int, scale_v_per_div: float, offset_v: float = 0.0) -> None:
        assert offset_v == 0.0
        self.scales[channel] = scale_v_per_div

    def acquire(self, *channels: int) -> None:
        self.taken.append(channels)

    def waveform(self, channel: int, points: int = 1000) -> Waveform:
        amplitude_v, phase_deg, offset_v = self.shown[channel]
        time_s = 5e-6 * np.arange(points) - 2.5e-3
        start_rad = 0.7 * len(self.taken)
        turned_rad = 2.0 * math.pi * 3488.9 * time_s + start_rad + math.radians(phase_deg)
        return Waveform(time_s, offset_v + amplitude_v * np.cos(turned_rad))


def test_sines_of_several_channels_are_captured_together() -> None:
    scope = Scope({1: (1.0, 20.0, 0.01), 2: (2.0, -69.7, 0.0), 3: (0.03, 112.9, -0.2)})
    clock = VirtualClock()
    bench = SimpleNamespace(oscilloscope=scope, clock=clock)
    context: Any = SimpleNamespace(bench=bench, believable=lambda ask: ask())
    expected = SineRecord(3489.0, (1.0, 1.0, 1.0), (0.0, -90.0, 90.0))
    step = CaptureSines((1, 2, 3), (1.2, 2.4, 0.06), 3, expected, spacing_s=0.5)
    found = step.perform(context)
    assert scope.taken == [(1, 2, 3)] * 3
    assert clock.now() == pytest.approx(3 * 0.5)
    assert scope.scales == pytest.approx({1: 0.4, 2: 0.8, 3: 0.02})
    assert found.channels == (1, 2, 3)
    for record in found.records:
        assert record.frequency_hz == pytest.approx(3488.9, abs=1e-6)
        assert record.amplitudes_v == pytest.approx((1.0, 2.0, 0.03))
        assert record.phases_deg == pytest.approx((0.0, -89.7, 92.9), abs=1e-6)
    assert "3: 0.03 V +92.90 deg" in found.describe()


def test_rate_beyond_station_is_refused_setting() -> None:
    with pytest.raises(ConfigError, match="rate_deg_s: expected a rate of at most 300 deg/s either way"):
        vcfbench.dry_run("phase", settings={"rate_deg_s": 1000.0})


@pytest.mark.exhaustive
def test_records_that_changed_are_refused_from_the_size_that_is_told(run: vcfbench.Run) -> None:
    """What lies above the list is refused, or moves nothing; what is complete and moved has its size in it."""
    found, rng = refusable(run), np.random.default_rng(3)
    assert found is not None
    before, rows = found.evaluated(found.settings, found.measured), list(unseen_of(run))
    loose = [row for row in rows if row.size is None]
    assert {row.why for row in loose} <= {"the records are too few"}
    for each in in_turn(found.settings, found.measured):
        size = max(row.size for row in rows if row.what == each.what and row.kind == "change" and row.size)
        for larger in (0.3, 0.9, 1.5, 1.5, 3.0):
            begin, end = np.sort(rng.choice(len(each.visits) + 1, 2, replace=False))
            at = np.arange(len(each.visits))
            fault = larger * size * ((at >= begin) & (at < end) & (end - begin < len(at)))
            try:
                after = found.with_records(each, fault)
            except MeasurementError:
                continue
            off = max(abs(after[name] - before[name]) / u95 for name, u95 in found.u95.items())
            assert off < 1.0 / 3.0 or larger < 1.0
