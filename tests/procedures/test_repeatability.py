"""Repeatability over switch-ons: its numbers by other code, and its plan."""

from __future__ import annotations

import random
from statistics import fmean, stdev
from typing import TYPE_CHECKING, Any

import pytest
from scipy.special import chdtri
from simrack_tests.cells import few

import vcfbench
from vcfbench.errors import ConfigError
from vcfbench.procedures.repeatability import _spread
from vcfbench.sim.gyro import course
from vcfbench.sim.simulation import true_output
from vcfbench.steps import DisableSupply, EnableSupply, Settle
from vcfbench.testing import simulated

if TYPE_CHECKING:
    from pathlib import Path

QUICK: dict[str, Any] = {"power_cycles": 4, "off_s": 600.0, "warm_up_s": 900.0, "samples": 4}


@pytest.fixture(scope="module", params=["v-vc", "table"])
def run(request: pytest.FixtureRequest) -> Any:
    return vcfbench.run("repeatability", "lab", seed=5, settings={**QUICK, "by": request.param}, runs=None)


def test_spread_is_that_of_the_means(run: Any) -> None:
    """Means, standard deviations and chi-square limits from the points, by hand."""
    found, scale = run.results, run.results.scale_factor_v_per_deg_s
    warm = [each for each in run.points if each.step == 1]
    blocks = [warm[at : at + 6] for at in range(0, len(warm), 6)]
    biases = [fmean(each.output_v for each in block if each.rate_deg_s == 0.0) / scale for block in blocks]
    rises = [
        fmean(each.output_v for each in block if each.rate_deg_s > 0.0)
        - fmean(each.output_v for each in block if each.rate_deg_s < 0.0)
        for block in blocks
    ]
    assert len(blocks) == 4
    assert found.bias.value == pytest.approx(stdev(biases), rel=1e-9)
    assert found.scale_factor.value == pytest.approx(1e6 * stdev(rises) / abs(fmean(rises)), rel=1e-9)
    low, high = ((3 / chdtri(3, tail)) ** 0.5 for tail in (0.025, 0.975))
    assert (found.bias.low, found.bias.high) == pytest.approx((low * stdev(biases), high * stdev(biases)))
    early = [each.output_v / scale for each in run.points if each.step == 2]
    transients = [one - other for one, other in zip(early, biases, strict=True)]
    assert found.turn_on_transient.value == pytest.approx(fmean(transients), rel=1e-9)


def test_noise_alone_is_expected_as_it_comes(run: Any) -> None:
    """The simulated gyroscope comes back as it was: its spread is noise, here of 3 degrees of freedom."""
    for found in (run.results.bias, run.results.scale_factor):
        assert (found.value / found.by_noise) ** 2 * 3 < chdtri(3, 0.0001)
        assert (found.value / found.by_noise) ** 2 * 3 > chdtri(3, 0.9999)


@pytest.mark.parametrize("by", few(["v-vc", "table"], every=2))
def test_switch_ons_have_drawn_bias_and_gain(by: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without noise and errors of instruments what was drawn is all that differs."""
    drawn: list[course.SwitchOn] = []

    def recorded(*arguments: Any) -> course.SwitchOn:
        drawn.append(course.switch_on(*arguments))
        return drawn[-1]

    monkeypatch.setattr("vcfbench.sim.gyro.gyro.switch_on", recorded)
    noise = {"switch_on_bias_deg_s": 0.02, "switch_on_scale_factor": 1e-4}
    bench = simulated("ideal", overrides={"noise": noise})
    found = vcfbench.run("repeatability", bench, seed=4, runs=None, settings={**QUICK, "by": by}).results
    assert len(drawn) == 4
    scale = physical_output(bench) / found.scale_factor_v_per_deg_s
    assert found.bias.value == pytest.approx(scale * stdev(each.gain * each.bias_deg_s for each in drawn), rel=1e-3)
    assert found.scale_factor.value == pytest.approx(1e6 * stdev(each.gain for each in drawn), rel=1e-3)


def physical_output(bench: vcfbench.BenchDescription) -> float:
    output = true_output(bench)
    return (output(1.0, None) - output(-1.0, None)) / 2.0


def test_true_spread_lies_between_the_limits() -> None:
    """Of 400 samples of seven, drawn here: 95 %, and five standard deviations of that more or less."""
    draw = random.Random(8)  # noqa: S311  # no secret
    spreads = [
        _spread("bias_repeatability", [draw.gauss(0.0, 2.0) for _ in range(7)], 0.0, "deg/s") for _ in range(400)
    ]
    assert 358 <= sum(each.low <= 2.0 <= each.high for each in spreads) <= 400


def test_gyroscope_cools_before_each_later_switch_on() -> None:
    steps = [each.step for each in vcfbench.dry_run("repeatability", "lab", settings=QUICK).steps]
    kinds = [type(each) for each in steps if isinstance(each, EnableSupply | DisableSupply)]
    assert kinds == [EnableSupply, DisableSupply] * 4
    assert [each.seconds for each in steps if isinstance(each, Settle) and "cools" in each.describe()] == [600.0] * 3


def test_broken_off_it_cannot_be_resumed(tmp_path: Path) -> None:
    class Stop:
        def handle(self, event: object) -> None:
            if isinstance(event, vcfbench.StepFinished) and event.t_s > 1000.0:
                raise KeyboardInterrupt

    with pytest.raises(vcfbench.Aborted):
        vcfbench.run("repeatability", seed=1, settings=QUICK, observers=[Stop()], runs=tmp_path)
    with pytest.raises(ConfigError, match="a pause between its switch-ons would change their cooling"):
        vcfbench.resume("last", runs=tmp_path)


def test_report_has_each_switch_on(run: Any) -> None:
    text = vcfbench.text_of(run.report())
    assert "s is the standard deviation over 4 switch-ons, each after 600 s without power and 900 s of warm-up" in text


@pytest.mark.parametrize("procedure", ["repeatability", "rate-limits", "g-sensitivity"])
def test_windows_that_keep_no_times_are_refused_before_the_run(procedure: str) -> None:
    with pytest.raises(ConfigError, match=r"procedure\.samples: expected windows of 60 s and 1000 readings at most"):
        vcfbench.dry_run(procedure, "lab", settings={"samples": 61})
