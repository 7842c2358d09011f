"""Input rate limits: closed forms of a clipped and of a bent output, bounds, and an output that does not come back."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from msgspec import structs
from simrack_tests.cells import few

import vcfbench
from vcfbench import steps
from vcfbench.analysis.input_limits import Limit, Line, limit_of
from vcfbench.errors import MeasurementError
from vcfbench.procedures.rate_limits import RATE_LIMITS
from vcfbench.sim.simulation import true_output
from vcfbench.testing import simulated

if TYPE_CHECKING:
    from collections.abc import Mapping

QUICK: dict[str, Any] = {"warm_up_s": 60.0, "samples": 4}
SHARE = 0.01


def ideal(stage: Mapping[str, float], base: str = "ideal") -> vcfbench.BenchDescription:
    return simulated(base, overrides={"output_stage": stage})


def run(bench: vcfbench.BenchDescription | str, **settings: Any) -> Any:
    return vcfbench.run("rate-limits", bench, seed=2, settings={**QUICK, **settings}, runs=None)


@pytest.mark.parametrize(("by", "headroom_v"), few([("v-vc", 1.5), ("table", 7.5)], every=2))
def test_limit_of_a_clipped_output_lies_where_the_line_exceeds(by: str, headroom_v: float) -> None:
    """The line's output at the limit times 1 - share is the clipped one; both ends of the interval hold it."""
    bench = ideal({"headroom_v": headroom_v})
    output = true_output(bench)
    slope, zero_v = output(0.5, None) - output(-0.5, None), output(0.0, None)
    found = run(bench, by=by, scale_factor_v_per_deg_s=slope, resolution_deg_s=0.25, short_share=SHARE).results
    for side, clipped_v in ((found.positive, headroom_v - 10.0), (found.negative, 10.0 - headroom_v)):
        expected = (clipped_v - zero_v) / slope / (1.0 - SHARE)
        assert side.limit.value == pytest.approx(expected, abs=0.126)
        assert 0.125 / math.sqrt(12.0) <= side.limit.u <= 0.26 / math.sqrt(12.0)
        assert side.clipped.value == pytest.approx(clipped_v, abs=1e-4)
        assert side.rises_beyond == pytest.approx(0.0, abs=1e-3)
        assert abs(side.comes_back.value) <= side.comes_back.u95
    assert abs(found.positive.limit.value) < 800.0


@pytest.mark.exhaustive
def test_bending_output_has_limit_of_its_cubic() -> None:
    """Of u - c u^3 a share c u^2 lacks; the line through 50 deg/s lacks a little itself."""
    cube = 2e-3
    bench = ideal({"third_order_per_v2": -cube})
    output = true_output(bench)
    small_v, per = output(50.0, None) - output(0.0, None), output(0.5, None) - output(-0.5, None)
    side = run(bench, by="table", resolution_deg_s=0.1).results.negative
    at_small = cube * (per * 50.0) ** 2
    expected = math.sqrt((SHARE * (1.0 - at_small) + at_small) / cube) / abs(per)
    assert small_v / per / 50.0 == pytest.approx(1.0 - at_small, abs=1e-5)
    assert -side.limit.value == pytest.approx(expected, abs=0.06)
    assert side.rises_beyond == pytest.approx(1.0 - 3.0 * SHARE, abs=0.01)


@pytest.mark.exhaustive
def test_bench_that_ends_first_has_bounds_and_goes_nowhere_beyond() -> None:
    done = run("lab", by="table")
    found = done.results
    assert (found.positive.limit, found.negative.limit) == (None, None)
    assert (found.positive.at_least_deg_s, found.negative.at_least_deg_s) == pytest.approx((300.0, -300.0), rel=2e-4)
    assert {each.step for each in done.points} == {1, 2, 5}
    assert [(each.name, each.form, each.low) for each in found.stated()] == [
        ("positive_input_rate_limit", "at-least", pytest.approx(300.0, rel=2e-4)),
        ("negative_input_rate_limit", "at-least", pytest.approx(300.0, rel=2e-4)),
    ]
    assert "limit not reached: it is beyond +299.96 deg/s, where the bench ends" in vcfbench.text_of(done.report())


def test_no_rate_is_beyond_the_limits_of_the_bench() -> None:
    bench = ideal({"headroom_v": 1.5}, "lab")
    limits = structs.replace(bench.limits, max_v_vc_v=5.0)
    points = run(structs.replace(bench, limits=limits)).points
    assert max(abs(each.v_vc_v) for each in points) <= 5.0
    assert max(abs(each.v_vc_v) for each in points) > 4.5


@pytest.mark.exhaustive
def test_v_vc_error_is_no_limit_of_gyroscope() -> None:
    """Ranges of the generator that are 2 % and 4 mV off are no limit of the gyroscope."""
    found = run("paper").results
    assert found.short_share == pytest.approx(2.0 * math.hypot(0.02, 0.02, 4e-3 * 150.0 / 50.0), rel=1e-6)
    zero_v, slope = found.line.zero_v, found.scale_factor_v_per_deg_s
    for side in (found.positive, found.negative):
        expected = (side.clipped.value - zero_v) / slope / (1.0 - found.short_share)
        assert side.limit.value == pytest.approx(expected, abs=0.26)
        assert side.limit.missing == ("scale factor",)


@pytest.mark.exhaustive
def test_bound_by_levels_as_set_lacks_their_errors() -> None:
    """A bench that ends at 2 V: within 2 % of the lowest level and of the highest, and 4 mV of the lowest."""
    lab = vcfbench.load_bench("lab")
    bench = structs.replace(lab, v_vc_meter=None, limits=structs.replace(lab.limits, max_v_vc_v=2.0))
    found = run(bench).results
    off = math.hypot(0.02, 0.02, 4e-3 * 150.0 / 50.0)
    reached_deg_s = 2.0 * found.line.slope / found.scale_factor_v_per_deg_s
    assert found.positive.limit is None
    assert found.positive.at_least_deg_s == pytest.approx(reached_deg_s * (1.0 - 0.95 * off), rel=1e-3)


class Latched:
    """What was measured, but for the output at the small rate afterwards, which is another."""

    def __init__(self, measured: Any, by_v: float) -> None:
        self.measured, self.by_v = measured, by_v

    def found(self, kind: Any) -> Any:
        for step, window in self.measured.found(kind):
            point = window.point
            moved = structs.replace(point, output_v=point.output_v + self.by_v) if point.step == 4 else point
            yield step, structs.replace(window, point=moved)


@pytest.mark.exhaustive
def test_output_that_does_not_recover_is_reported_with_size() -> None:
    def results(settings: Any, measured: Any) -> Any:
        return RATE_LIMITS.results(settings, Latched(measured, 0.05))  # type: ignore[arg-type]

    latched = structs.replace(RATE_LIMITS, name="latched", results=results)
    done = vcfbench.run(latched, "lab", seed=2, settings=QUICK, runs=None)
    for side in (done.results.positive, done.results.negative):
        assert side.comes_back.value == pytest.approx(0.05 / -0.0125, abs=0.05)
        assert abs(side.comes_back.value) > side.comes_back.u95


@pytest.mark.exhaustive
def test_clipped_window_is_not_held_against_the_noise_of_others() -> None:
    """A lead that is off in the windows of the line is refused all the same: those are watched as ever."""
    kinds = {type(each.step) for each in vcfbench.dry_run("rate-limits", "lab", settings=QUICK).steps}
    assert {steps.AcquireWithVvc, steps.AcquireClippedWithVvc} <= kinds
    assert all(each.std_v < 2e-5 for each in run("lab").points if each.step == 3)


def test_line_and_limit_by_hand() -> None:
    line = Line.of([0.0, 1.0, -1.0, -1.0, 1.0, 0.0], [0.5, 2.5, -1.5, -1.5, 2.5, 0.5])
    assert (line.zero_v, line.slope) == pytest.approx((0.5, 2.0))
    assert sum(line.weights(7.0, SHARE)) == pytest.approx(1.0)
    found = limit_of(line, SHARE, [3.0, 4.0, 3.5], [6.5, 6.6, 6.6], 0)
    assert found is not None
    assert (found.at, found.half_width, found.first, found.rises) == pytest.approx((3.25, 0.25, 2, 0.0))
    assert limit_of(line, SHARE, [3.0, 4.0], [6.5, 8.5], 0) is None
    found = limit_of(line, SHARE, [1.0, 2.0, 3.0, 5.0, 4.0], [2.5, 4.4, 6.5, 6.6, 6.6], 1)
    assert found is not None  # at 2 it was noise
    assert (found.at, found.first) == (3.5, 4)


@pytest.mark.parametrize("seed", range(20))
def test_noise_makes_no_slope_where_an_output_bends(seed: int) -> None:
    """A cube that lacks 1 % at 50 leaves the line by 2 % of its slope there; a hundredth further on noise is larger."""
    noise_v, line = 6e-4, Line(0.0, 0.013, 32.0)
    inputs = [16.0, 24.0, 36.0, 54.0, 45.0, 49.5, 51.75, 50.6, 50.1, 49.8, 52.6, 56.7]
    drawn = np.random.default_rng(seed).normal(0.0, noise_v, len(inputs)).tolist()
    outputs_v = [
        line.slope * x * (1.0 - SHARE * (x / 50.0) ** 2) + off_v for x, off_v in zip(inputs, drawn, strict=True)
    ]
    found = limit_of(line, SHARE, inputs, outputs_v, 1, noise_v=noise_v)
    assert found is not None
    assert 0.01 <= found.leaves < 0.08


@pytest.mark.parametrize("of_input", [True, False])
@pytest.mark.parametrize("rises", [0.9, 0.0, -3.0, -60.0])
def test_noise_of_the_line_moves_its_limit_by_its_weights(rises: float, *, of_input: bool) -> None:
    """Against lines through outputs that are off one by one; an output that comes back fixes the input, not the line's.

    One that is clipped does it the other way round.
    """
    inputs, outputs_v, at, off_v = [0.0, 1.0, -1.0, -1.0, 1.0, 0.0], [0.5, 2.5, -1.5, -1.5, 2.5, 0.5], 7.0, 1e-6
    line, follows = Line.of(inputs, outputs_v), 1.0 - SHARE

    def size_v(off: int) -> float:
        moved = Line.of(inputs, [each + off_v * (place == off) for place, each in enumerate(outputs_v)])
        stays_v = line.zero_v + line.slope * at * (follows - rises) - moved.zero_v
        return (line if of_input else moved).slope * stays_v / (follows * moved.slope - rises * line.slope)

    found = Limit(at, 0.0, 0, rises, follows - rises)
    moves = [(size_v(each) - line.slope * at) / off_v for each in range(6)]
    assert found.weights(line, SHARE, of_input=of_input) == pytest.approx(moves, rel=1e-3, abs=1e-5)


@pytest.mark.exhaustive
@pytest.mark.parametrize("second_order_per_v", [0.03, -0.03])
def test_output_bending_at_line_has_limits_beyond_line(second_order_per_v: float) -> None:
    """The line goes through both small rates; a square leaves one of them above it by 2 %, its opposite below."""
    found = run(ideal({"second_order_per_v": second_order_per_v}), by="table").results
    limits = [side.limit for side in (found.positive, found.negative)]
    assert all(limit is None or abs(limit.value) > 50.0 for limit in limits)
    assert sum(limit is not None and abs(limit.value) < 51.0 for limit in limits) == 1


@pytest.mark.parametrize(
    ("turned", "by"),
    [
        ({"k_vc_guess_deg_s_per_v": -150.0}, r"-1\.8\d* V a volt of V_Vc"),
        ({"scale_factor_v_per_deg_s": 0.0125}, r"-0\.0125\d* V/\(deg/s\)"),
    ],
)
def test_wrong_sign_of_the_output_is_refused_first(turned: dict[str, Any], by: str) -> None:
    with pytest.raises(MeasurementError, match=f"the output changes by {by}") as ended:  # as it was measured
        run("ideal", **turned)
    assert "polarity" in str(ended.value)
