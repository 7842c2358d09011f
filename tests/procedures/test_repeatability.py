"""Repeatability over switch-ons: its numbers by other code, and its plan."""

from __future__ import annotations

from statistics import fmean, stdev
from typing import TYPE_CHECKING, Any

import pytest
from scipy.stats import chi2

import vcfbench
from vcfbench.errors import ConfigError
from vcfbench.steps import DisableSupply, EnableSupply, Settle

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
    low, high = ((3 / chi2.ppf(tail, 3)) ** 0.5 for tail in (0.975, 0.025))
    assert (found.bias.low, found.bias.high) == pytest.approx((low * stdev(biases), high * stdev(biases)))
    early = [each.output_v / scale for each in run.points if each.step == 2]
    transients = [one - other for one, other in zip(early, biases, strict=True)]
    assert found.turn_on_transient.value == pytest.approx(fmean(transients), rel=1e-9)


def test_noise_alone_is_expected_as_it_comes(run: Any) -> None:
    """The simulated gyroscope comes back as it was: its spread is noise, here of 3 degrees of freedom."""
    for found in (run.results.bias, run.results.scale_factor):
        assert (found.value / found.by_noise) ** 2 * 3 < chi2.ppf(0.9999, 3)
        assert (found.value / found.by_noise) ** 2 * 3 > chi2.ppf(0.0001, 3)


def test_gyroscope_cools_without_power_before_each_switch_on_but_the_first() -> None:
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
    with pytest.raises(ConfigError, match="its switch-ons are alike only where nothing comes between"):
        vcfbench.resume("last", runs=tmp_path)


def test_report_has_each_switch_on(run: Any) -> None:
    text = vcfbench.text_of(run.report())
    assert "s is the standard deviation over 4 switch-ons, each after 600 s without power and 900 s of warm-up" in text
