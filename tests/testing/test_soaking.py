"""Faults drawn by seed: what is drawn holds, what is broken is found, made small, and repeated by one line."""

from __future__ import annotations

import math
from random import Random

import numpy as np
import pytest
from msgspec import Struct
from msgspec.structs import replace
from scipy.special import ndtri, stdtrit
from simrack.faults import Fault
from simrack.faulty_device import FaultyDevice
from simrack.wires.serial_backend import _Port
from typer.testing import CliRunner

from vcfbench.cli.main import app
from vcfbench.clock import VirtualClock
from vcfbench.testing.soaking import cleaned, shrunk, trial, tried
from vcfbench.testing.soaking.draw import Happening, drawn
from vcfbench.testing.soaking.judge import reaches_of
from vcfbench.uncertainty.measurand import measurand
from vcfbench.values.value import Measurand, UncertaintyPart

LATE = Happening(0, 0.5, "fault", fault=Fault("rate_table", "late", count=2, delay_s=3.64))


def test_a_seed_draws_the_same_again_and_another_seed_another() -> None:
    assert drawn(5) == drawn(5)
    assert drawn(5) != drawn(6)
    whats = {each.what for seed in range(200) for each in drawn(seed).happenings}
    assert whats == {"fault", "kill", "power cut", "signal", "starter", "clock", "disk full", "sync fails"}


def advance(self: FaultyDevice) -> None:
    """As it was once: what is said behind a late answer is left with the device, which wakes its reader for ever."""
    now_s = self._clock.now()
    while self._planned and self._planned[0].at_s <= now_s:
        self._begin(self._planned.pop(0))
    self._end([each for each in self._active if each.ends_s is not None and each.ends_s <= now_s])
    if self._spoiling():
        self._spoil_what_is_said()


def wait(self: _Port, deadline_s: float | None) -> bool:
    """As it was once: an instant that has passed is waited for, again and again."""
    wake_s = self.device.wake_at()
    assert deadline_s is not None
    if self.clock.now() >= deadline_s:
        return False
    self.clock.sleep_until(deadline_s if wake_s is None else min(wake_s, deadline_s))
    return True


@pytest.mark.exhaustive
def test_a_freeze_of_bench_time_is_found_and_made_small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trial, "_STILL", 1000)
    draw = replace(drawn(2), language="atl", wires="direct", happenings=(LATE, Happening(0, 0.2, "clock", size=5.0)))
    assert tried(draw).wrong == ()
    monkeypatch.setattr(FaultyDevice, "_advance", advance)
    monkeypatch.setattr(_Port, "wait", wait)
    found = tried(draw)
    assert "bench time stands still" in found.wrong[0]
    assert shrunk(found).draw.happenings == (LATE,)


@pytest.mark.exhaustive
def test_the_command_repeats_a_seed_and_says_what_it_draws() -> None:
    answer = CliRunner().invoke(app, ["sim", "soak", "--seeds", "11:12", "-v"])
    assert answer.exit_code == 0
    assert answer.stdout.startswith("seed 11: ")
    assert "1 seeds from 11 in" in answer.stdout
    assert CliRunner().invoke(app, ["sim", "soak", "--seeds", "3:3"]).exit_code != 0


class Speaks:
    """A device that has something to say since 1 s."""

    def wake_at(self) -> float:
        return 1.0

    def write(self, _data: bytes) -> None: ...


def test_dead_line_with_speaking_table_releases_bench_time() -> None:
    """A port waited for an instant that had passed, for ever."""
    clock, device = VirtualClock(), Speaks()
    clock.sleep_until(2.0)
    line = FaultyDevice(device, clock, Random(0))  # type: ignore[arg-type]  # noqa: S311
    line.add(Fault("rate_table", "late", at_s=9.0))
    assert _Port(Speaks(), clock).wait(3.0)  # type: ignore[arg-type]
    assert clock.now() == 3.0
    line.add(Fault("rate_table", "half_open", duration_s=2.0))
    assert line.wake_at() == 5.0


def test_seeds_in_a_row_share_work_and_differ_in_events() -> None:
    draws = [drawn(seed) for seed in range(20, 30)]
    assert {replace(each, seed=0, happenings=()).describe()[1] for each in draws} == {draws[0].describe()[1]}
    assert len({each.happenings for each in draws}) > 7
    assert drawn(30).describe()[:2] != draws[0].describe()[:2]


@pytest.mark.exhaustive
def test_early_offset_is_bias_and_later_offset_fault() -> None:
    draw = replace(drawn(404363), happenings=())
    clean = cleaned(draw)
    offset = Fault("multimeter", "offset", offset=0.1)
    for at, found in ((0.12, False), (0.5, True)):
        verdict = tried(replace(draw, happenings=(Happening(0, at, "fault", fault=offset),)), clean)
        assert verdict.wrong == ()
        assert verdict.ends[0].startswith("MeasurementError" if found else "complete")
    # nor does a start contradict it that takes over all windows and measures none
    before, cut = Happening(0, 0.12, "fault", fault=offset), Happening(0, 0.9, "kill", by_writes=True)
    verdict = tried(replace(draw, happenings=(before, cut)), clean)
    assert verdict.wrong == ()
    assert verdict.ends[1].startswith("complete")


class Stated(Struct):
    """Results with one value."""

    output: Measurand


def test_noise_of_few_readings_is_no_fault() -> None:
    draws = np.random.default_rng(8).standard_normal((20_000, 2, 5))
    values, u = draws.mean(axis=2), draws.std(axis=2, ddof=1) / math.sqrt(5.0)
    reach = {
        dof: reaches_of(Stated(measurand(0.0, "V", [UncertaintyPart("readings", 1.0, dof)])))["output"][1]
        for dof in (4, None)
    }
    apart = np.abs(values[:, 0] - values[:, 1]) / u.sum(axis=1)
    assert np.count_nonzero(apart > reach[4]) <= 2
    assert np.count_nonzero(apart > reach[None] * stdtrit(4, 0.975) / ndtri(0.975)) > 10
    assert reach[None] == pytest.approx(1.5 * 1.96, rel=1e-3)
