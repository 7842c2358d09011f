"""Resonances of a simulated gyroscope, by ring-down and by sweep, against its parameters."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from msgspec import structs

import vcfbench
from vcfbench.analysis.decays import RingingMode
from vcfbench.archive.unseen import unseen_of
from vcfbench.belief.in_turn import require_alike
from vcfbench.errors import LimitError, MeasurementError
from vcfbench.interfaces import Waveform
from vcfbench.procedures.resonance import (
    DriveDecay,
    ReleaseDrive,
    ResonanceSettings,
    SenseDecay,
    _s_per_div,
    combined,
    in_turn,
    resonance_characteristics,
)
from vcfbench.testing import simulated
from vcfbench.uncertainty.measurand import as_kept


@pytest.mark.parametrize(
    ("q", "split_hz", "settle_s", "s_per_div"),
    [
        (11_000.0, 25.0, 100.0, 0.5),  # four time constants of a second
        (1100.0, 25.0, 100.0, 0.05),  # of a tenth
        (1100.0, 6.0, 100.0, 0.1),  # four beats of a sixth of a second
        (1100.0, 1.0, 100.0, 0.1),  # of a second: no more than eight time constants
        (11_000.0, 25.0, 2.0, 0.1),  # what settles sooner is noise
    ],
)
def test_ring_down_record_is_as_long_as_visible_decay(
    q: float, split_hz: float, settle_s: float, s_per_div: float
) -> None:
    mode = RingingMode(3475.0, q, 1.0)
    assert _s_per_div(SenseDecay(3475.0 + split_hz, (mode,)), 4.0, settle_s) == pytest.approx(s_per_div)
    assert _s_per_div(SenseDecay(3475.0, ()), 4.0, settle_s) is None


OVERRIDES = {
    "thermal": {"self_heating_k": 0.0},
    "drive_mode": {"frequency_hz": 3485.0, "quality": 1500.0},
    "sense_anti_phase": {"frequency_hz": 3463.0, "quality": 1100.0},
    "sense_in_phase": {"frequency_hz": 3340.0, "quality": 1300.0},
}
QUICK = {
    "warm_up_s": 0.0,
    "frequencies_hz": [2.0, 12.0, 18.0, 30.0, 40.0],
    "around_split": [0.75, 0.97, 1.0, 1.03, 1.2, 1.5],
    "record_samples": 256,
    "sense_ring_downs": 4,
    "drive_ring_downs": 3,
}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> vcfbench.Run:
    bench = simulated("paper", errors="drawn", overrides=OVERRIDES)
    return vcfbench.run("resonance", bench, seed=6, settings=QUICK, runs=tmp_path_factory.mktemp("resonance"))


@pytest.mark.parametrize(
    ("name", "true", "largest_u"),
    [
        ("drive_hz", 3485.0, 0.06),
        ("drive_ring_down_hz", 3485.0, 0.06),
        ("drive_q", 1500.0, 5.0),
        ("sense_hz", 3463.0, 0.06),
        ("sense_q_ring_down", 1100.0, 5.0),
        ("sense_q_sweep", 1100.0, 2.0),
        ("split_ring_down_hz", 22.0, 0.01),
        ("split_sweep_hz", 22.0, 0.01),
        ("in_phase_hz", 3340.0, 0.08),
        ("in_phase_q", 1300.0, 40.0),
    ],
)
def test_a_resonance_is_that_of_the_parameters(run: vcfbench.Run, name: str, true: float, largest_u: float) -> None:
    assert run.error is None
    found = getattr(run.results, name)
    assert abs(found.value - true) < 2.0 * found.u95
    assert 0.0 < found.u < largest_u


def test_both_ways_agree(run: vcfbench.Run) -> None:
    found = run.results
    assert max(found.e_n_drive_hz, found.e_n_sense_q, found.e_n_split) < 1.5
    assert found.sweep.split_hz == found.split_sweep_hz
    assert found.why_no_drive == ""


def test_common_time_base_does_not_make_drive_frequencies_agree(run: vcfbench.Run) -> None:
    found = run.results
    off_hz = abs(found.drive_hz.value - found.drive_ring_down_hz.value)
    assert found.e_n_drive_hz > 3.0 * off_hz / (found.drive_hz.u95 + found.drive_ring_down_hz.u95)


@pytest.mark.exhaustive
def test_a_record_shows_what_the_run_showed(run: vcfbench.Run) -> None:
    assert run.directory is not None
    assert vcfbench.load_run(run.directory).results == run.results


def test_drive_without_visible_ring_down_has_no_q(run: vcfbench.Run) -> None:
    decays = [
        SenseDecay(3485.0 + shift, (RingingMode(3463.0 - shift, 1100.0 + 100.0 * shift, 1.0),))
        for shift in (-0.01, 0.0, 0.01)
    ]
    released = [DriveDecay(3485.0, 1500.0), DriveDecay(0.0, 0.0, "gone at once"), DriveDecay(3485.0, 1501.0)]
    found = combined(run.results.sweep, decays, released)
    assert (found.drive_ring_down_hz, found.drive_q, found.e_n_drive_hz) == (None, None, None)
    assert (found.in_phase_hz, found.in_phase_q) == (None, None)
    assert found.why_no_drive == "gone at once"
    assert found.split_ring_down_hz.value == pytest.approx(22.0)
    assert found.split_ring_down_hz.parts[0].u == pytest.approx(0.02 / 3**0.5)
    assert found.sense_q_ring_down.u == pytest.approx(1.0 / 3**0.5, rel=1e-5)


def test_measuring_mode_is_nearest_to_drive_despite_noise(run: vcfbench.Run) -> None:
    near, far = (RingingMode(3463.0, 1100.0, 1.0), RingingMode(3338.0, 900.0, 0.2))
    weak = (structs.replace(far, amplitude_v=1.2, q=901.0), near)
    decays = [SenseDecay(3485.0, modes) for modes in ((near, far), weak, (near, far))]
    found = combined(run.results.sweep, decays, [DriveDecay(0.0, 0.0, "gone at once")])
    assert found.sense_hz.value == pytest.approx(3463.0)
    assert found.in_phase_hz is not None
    assert found.in_phase_hz.value == pytest.approx(3338.0)


def test_a_board_that_is_dead_at_once_is_an_answer() -> None:
    """Supply off, and the drive is steady until it is gone: nothing rings down."""

    class Scope:
        def configure_channel(self, channel: int, scale_v_per_div: float) -> None:
            assert (channel, scale_v_per_div) == (1, pytest.approx(0.4))

        def acquire(self, channel: int) -> None:
            assert channel == 1
            assert not power.on

        def waveform(self, channel: int, points: int) -> Waveform:
            assert channel == 1
            time_s = 4e-6 * np.arange(points)
            noise_v = 7e-3 * np.random.default_rng(1).standard_normal(points)
            return Waveform(time_s, np.where(time_s < 0.05, np.cos(2.0 * np.pi * 3488.9 * time_s), 0.0) + noise_v)

    class Power:
        on = True

        def disable_outputs(self) -> None:
            self.on = False

    power = Power()
    context: Any = SimpleNamespace(bench=SimpleNamespace(oscilloscope=Scope(), power=power))
    found = ReleaseDrive(1, 1.2, 50_000, 3488.9).perform(context)
    assert "does not decay freely" in found.trouble
    assert found.describe() == found.trouble


def test_rails_are_on_between_ring_downs() -> None:
    words = [each.step for each in vcfbench.dry_run("resonance").steps]
    places = [place for place, step in enumerate(words) if isinstance(step, ReleaseDrive)]
    assert len(places) == 6
    between = [step.describe() for step in words[places[0] : places[1]]]
    assert "supply outputs on" in between
    assert any("read back the rails" in each for each in between)
    after = [step.describe() for step in words[places[-1] + 1 :]]
    assert "supply outputs on" not in after
    assert "supply outputs off" in after


def test_v_vc_of_ring_down_is_checked_against_limit() -> None:
    paper = vcfbench.load_bench()
    assert paper.limits is not None
    tight = structs.replace(paper, limits=structs.replace(paper.limits, max_v_vc_v=0.5))
    with pytest.raises(LimitError, match=r"0\.7 V"):
        vcfbench.dry_run("resonance", tight)


def test_what_is_kept_of_a_device_is_what_rang_down(run: vcfbench.Run) -> None:
    kept = resonance_characteristics(ResonanceSettings(), run.results)
    assert (kept.q_in_phase, kept.drive_hz) == (as_kept(run.results.in_phase_q), as_kept(run.results.drive_hz))
    unseen = structs.replace(run.results, in_phase_q=None, in_phase_hz=None)
    without = resonance_characteristics(ResonanceSettings(), unseen)
    assert (without.q_in_phase, without.in_phase_split_hz) == (None, None)


@pytest.mark.exhaustive
def test_ring_downs_state_what_they_cannot_have_seen(run: vcfbench.Run) -> None:
    told = {row.what for row in unseen_of(run)}
    assert {"the split of the anti-phase mode", "the Q of the anti-phase mode", "the Q of the drive"} <= told


@pytest.mark.parametrize("what", ["the split of the in-phase mode", "the Q of the anti-phase mode"])
def test_ring_downs_of_another_mode_are_refused(what: str) -> None:
    rng, modes = np.random.default_rng(1), (RingingMode(3464.0, 1200.0, 1.0), RingingMode(3342.0, 1230.0, 0.2))
    decays = [
        SenseDecay(
            3489.0,
            tuple(
                structs.replace(mode, q=mode.q * (1.0 + each), frequency_hz=mode.frequency_hz * (1.0 + 1e-5 * each))
                for mode, each in zip(modes, 3e-3 * rng.standard_normal(2), strict=True)
            ),
        )
        for _ in range(8)
    ]
    require_alike(in_turn(decays, []))
    (series,) = (each for each in in_turn(decays, []) if each.what == what)
    spoilt = [series.spoilt(each, 0.3 * (at > 4)) for at, each in enumerate(decays)]
    with pytest.raises(MeasurementError, match=f"{what} is another by .* in the records of visits"):
        require_alike(in_turn(spoilt, []))
