"""K_Vc of the four steps from matches at both signs: closed forms of the modulator, drawn generators, the plan."""

from __future__ import annotations

import math
from types import MappingProxyType, SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from msgspec import structs
from simrack_tests.cells import few

import vcfbench
from tests.procedures.fakes import make_settings
from tests.procedures.test_kvc import read_v, still, warm
from vcfbench.analysis.chopped import CHOPPED
from vcfbench.instructions.schedule import KvcBy
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.virtual_coriolis.null_matching import NullMatching, null_matching
from vcfbench.procedures.virtual_coriolis.results import NullVirtualCoriolisResult, virtual_coriolis_results
from vcfbench.records.schema import Point
from vcfbench.reports.text import text_of
from vcfbench.sim.simulation import physical_parameters
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.station.settings import PAPER_RATES_DEG_S, Match, Sources, Station
from vcfbench.steps import Acquire
from vcfbench.steps.dry_run import walk

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from vcfbench.procedures.virtual_coriolis.settings import VirtualCoriolisSettings

QUICK: dict[str, Any] = {
    "samples": 3,
    "match_windows": 2,
    "rates_deg_s": [200.0, 50.0, 0.0, -50.0, -200.0],
    "match_rates_deg_s": [20.0, 100.0, 200.0],
}


# --- on the simulated bench, without noise and errors ---


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Return the three ways of the paper's bench to K_Vc, warm."""
    path, bench = tmp_path_factory.mktemp("runs"), still(vcfbench.load_bench())
    settings = {**QUICK, "warm_up_s": 3600.0}
    return {
        by: vcfbench.run("virtual-coriolis", bench, settings={**settings, "k_vc_by": by}, runs=path)
        for by in ("one-point", "plus-minus", "curve")
    }


def equal_v(rate_deg_s: float) -> float:
    """Return the V_Vc with the output of the table at `rate_deg_s`, zeros subtracted, by the closed forms."""
    parameters = warm(physical_parameters(still(vcfbench.load_bench())))
    path = parameters.virtual_path

    def multiplied(level_v: float) -> float:
        return path.offset_v + level_v * (
            1.0 + path.second_order_per_v * level_v + path.third_order_per_v2 * level_v**2
        )

    on = multiplied(0.0)
    wanted = read_v(parameters, rate_deg_s) - read_v(parameters, 0.0) + read_v(parameters, 0.0, on)
    levels = [rate_deg_s / 150.0, rate_deg_s / 152.0]
    for _ in range(8):  # secant
        off = [read_v(parameters, 0.0, multiplied(level)) - wanted for level in levels]
        if off[1] == off[0]:
            break
        levels = [levels[1], levels[1] - off[1] * (levels[1] - levels[0]) / (off[1] - off[0])]
    return levels[1]


@pytest.mark.exhaustive
def test_half_difference_removes_even_order_of_modulator(runs: dict[str, Any]) -> None:
    """One point at +10 deg/s has 0.09 % of it; so says the closed form, and so do the runs."""
    loaded = 1.0 + 50.0 / physical_parameters(still(vcfbench.load_bench())).virtual_path.pull_down_ohm
    plus, minus = loaded * equal_v(10.0), loaded * equal_v(-10.0)  # the generator's 50 ohm divide
    one_point, pair = (runs[by].results.k_vc.value for by in ("one-point", "plus-minus"))
    assert one_point == pytest.approx(10.0 / plus, rel=2e-6)
    assert pair == pytest.approx(20.0 / (plus - minus), rel=2e-6)
    assert one_point / pair - 1.0 == pytest.approx(8.7e-4, abs=1e-5)


@pytest.mark.exhaustive
def test_a_curve_brings_the_methods_together(runs: dict[str, Any]) -> None:
    """The odd order of the modulator is 2 % at 200 deg/s, which one point cannot know."""
    off = {by: abs(run.results.scale_factor_error_percent) for by, run in runs.items()}
    assert off["one-point"] > 1.5
    assert off["plus-minus"] > 1.5
    assert off["curve"] < 0.01
    curve = runs["curve"].results
    assert curve.coefficients[1] / curve.coefficients[0] == pytest.approx(0.013, rel=0.05)
    assert curve.coefficients[2] / curve.coefficients[0] == pytest.approx(0.0145, rel=0.05)
    assert len(curve.pairs) == 6


@pytest.mark.exhaustive
def test_record_reproduces_result_and_report_has_matches(runs: dict[str, Any]) -> None:
    for by in ("plus-minus", "curve"):
        again = vcfbench.load_run(runs[by].directory)
        assert isinstance(again.results, NullVirtualCoriolisResult)
        assert again.results == runs[by].results
        assert f"({by})" in text_of(again.report())


@pytest.mark.exhaustive
def test_the_levels_of_step_4_are_those_of_the_curve(runs: dict[str, Any]) -> None:
    results = runs["curve"].results
    for point in (p for p in runs["curve"].points if p.step == 4):
        assert point.rate_deg_s == pytest.approx(results.rate_of(point.v_vc_v), abs=1e-9)
    virtual = [p.rate_deg_s for p in runs["curve"].points if p.step == 4]
    assert virtual == pytest.approx(QUICK["rates_deg_s"], abs=0.02)


@pytest.mark.exhaustive
def test_a_second_meter_measures_the_levels(tmp_path: Path) -> None:
    bench = still(vcfbench.load_bench("lab"), rate_source="drawn")
    found = vcfbench.run("virtual-coriolis", bench, settings={**QUICK, "k_vc_by": "curve"}, runs=tmp_path).results
    assert abs(found.scale_factor_error_percent) < 0.01
    assert found.k_vc_u_generator == 0.0
    assert found.uncertainty.value("k_vc").u < 1e-4 * found.k_vc.value


# --- the statement, against generators that are drawn ---

K, K_VC, ZERO_V = -0.0125, 150.0, -0.04
RANGES, BITS = (0.32, 1.0, 3.2, 10.0), 14
SOURCES = Sources(generator_gain=0.02, generator_offset_v=4e-3, generator_ranges_v=RANGES, generator_bits=BITS)
TOLD: dict[str, Any] = {
    "k_vc_guess_deg_s_per_v": K_VC,
    "match_windows": 2,
    "station": Station(meter_resolution_v=1e-7, sources=SOURCES),
}


class Drawn:
    """A gyroscope with a curved modulator, a generator whose ranges have errors and steps, and noise on every mean."""

    def __init__(self, seed: int, noise_v: float) -> None:
        self.random = np.random.default_rng(seed)
        self.gains = self.random.uniform(-0.02, 0.02, 4) if seed else np.zeros(4)
        self.offsets = self.random.uniform(-4e-3, 4e-3, 4) if seed else np.zeros(4)
        self.noise_v = noise_v if seed else 0.0

    def level(self, set_v: float) -> float:
        place = int(np.searchsorted(RANGES, abs(set_v)))
        step_v = 2.0 * RANGES[place] / 2**BITS
        return float(round(set_v / step_v) * step_v * (1.0 + self.gains[place]) + self.offsets[place])

    def output(self, rate_deg_s: float, set_v: float | None) -> float:
        true_v = 0.0 if set_v is None else self.level(set_v)
        rate = rate_deg_s + K_VC * (true_v + 0.013 * true_v**2 + 0.0145 * true_v**3)
        return ZERO_V + K * rate + float(self.random.normal(0.0, self.noise_v))

    def setting(self, rate_deg_s: float) -> float:
        """Return a setting with nearly the output of the table; ends of ranges are not met."""
        set_v = rate_deg_s / K_VC
        for _ in range(20):
            off = self.output(0.0, set_v) - self.output(0.0, 0.0) - K * rate_deg_s
            set_v -= off / (K * K_VC)
        return set_v

    def points(
        self, settings: VirtualCoriolisSettings, held_v: Mapping[float, float] = MappingProxyType({})
    ) -> list[Point]:
        """Return the points of a run; at the rates of `held_v` V_Vc is set to that, whatever would match."""

        def point(step: int, rate: float, set_v: float | None, output_v: float) -> Point:
            return Point(step, rate, set_v or 0.0, output_v, self.noise_v * math.sqrt(10.0) + 1e-9, 10)

        found: list[Point] = []
        silent, self.noise_v = self.noise_v, 0.0
        levels = {s * r: self.setting(s * r) for r in settings.magnitudes_deg_s for s in (1.0, -1.0)}
        levels |= {0.0: 0.0, **held_v}
        self.noise_v = silent
        for _ in range(settings.null_cycles):
            for size in settings.magnitudes_deg_s:
                found += [point(1, s * size, None, self.output(s * size, None)) for s in CHOPPED]
                found += [point(2, s * size, levels[s * size], self.output(0.0, levels[s * size])) for s in CHOPPED]
        matching = null_matching(settings, found)
        found += [point(3, rate, None, self.output(rate, None)) for rate in PAPER_RATES_DEG_S]
        settings_v = [matching.level_for(rate) for rate in PAPER_RATES_DEG_S]
        return found + [point(4, matching.rate_of(v), v, self.output(0.0, v)) for v in settings_v]


@pytest.mark.parametrize("by", few([KvcBy.PLUS_MINUS, KvcBy.CURVE]))
def test_values_scatter_as_stated_when_generators_are_drawn(by: KvcBy) -> None:
    """60 draws know a scatter to 9 %; what lack of fit the jumps between ranges leave is in no uncertainty.

    The bias is stated wider: of a range the sheet limits gain and offset together, the budget takes each at its own
    limit, and plus-minus has nothing else in it.
    """
    settings = make_settings(k_vc_by=by, **TOLD)
    drawn: dict[str, list[float]] = {}
    for seed in range(1, 61):
        points = Drawn(seed, 20e-6).points(settings)
        matching: NullMatching = null_matching(settings, points)
        slopes = []
        for step in (3, 4):
            own = [(p.rate_deg_s, p.output_v) for p in points if p.step == step]
            slopes.append(np.polyfit(*np.array(own).T, 1))
        values = (matching.k_vc, slopes[1][0], slopes[1][1], 100.0 * (slopes[1][0] / slopes[0][0] - 1.0))
        names = ("k_vc", "virtual.scale_factor", "virtual.bias", "scale_factor_error_percent")
        for name, value in zip(names, values, strict=True):
            drawn.setdefault(name, []).append(float(value))
    noisy = virtual_coriolis_results(settings, Drawn(61, 20e-6).points(settings)).uncertainty
    for name, values in drawn.items():
        widest = 1.5 if name == "virtual.bias" and by is KvcBy.PLUS_MINUS else 1.25
        assert 0.75 < noisy.value(name).u / np.std(values) < widest, name
    bounds = [each for each in noisy.bounds if "the curve corrects the modulator" in each.of]
    assert len(bounds) == (1 if by is KvcBy.CURVE else 0)


@pytest.mark.parametrize("by", [KvcBy.PLUS_MINUS, KvcBy.CURVE])
def test_perfect_generator_gives_small_signal_k_vc(by: KvcBy) -> None:
    """But for the cubic that half the difference at 10 deg/s leaves."""
    settings = make_settings(k_vc_by=by, **TOLD)
    found = virtual_coriolis_results(settings, Drawn(0, 0.0).points(settings))
    assert found.k_vc.value == pytest.approx(K_VC, rel=1e-3)


@pytest.mark.parametrize("by", [KvcBy.PLUS_MINUS, KvcBy.CURVE])
def test_noise_of_a_window_moves_coefficients(by: KvcBy) -> None:
    settings = make_settings(k_vc_by=by, **TOLD)
    quiet = Drawn(0, 0.0).points(settings)
    points = [structs.replace(each, std_v=1e-3) for each in quiet if each.step in {1, 2}]
    found = null_matching(settings, points)
    for place in range(0, len(points), 5):
        output_v = points[place].output_v + 1e-6
        moved = [*points[:place], structs.replace(points[place], output_v=output_v), *points[place + 1 :]]
        by_v = (np.array(null_matching(settings, moved).coefficients) - found.coefficients) / 1e-6
        expected = found.noise_weights[:, place]
        assert by_v == pytest.approx(expected, rel=0.02, abs=5e-3 * float(np.abs(found.noise_weights).max()))


def test_match_next_to_a_range_end_has_its_range() -> None:
    """At 50 deg/s the levels that would match lie between the ends of two ranges, where none can be set."""
    settings = make_settings(k_vc_by=KvcBy.CURVE, **TOLD)
    u = []
    for held_v in (0.319, 0.322):  # where 0.333 V would match
        stated = virtual_coriolis_results(settings, Drawn(0, 0.0).points(settings, {50.0: held_v})).uncertainty
        shares = stated.value("virtual.scale_factor").parts
        u.append(next(each.u for each in shares if each.source == "generator gain, 0.32 V range"))
    assert u[0] > 5.0 * u[1]


# --- the plan, and what is refused ---


@pytest.mark.parametrize(("by", "blocks"), [("plus-minus", 2), ("curve", 10)])
def test_dry_run_has_blocks_of_both_signs(by: str, blocks: int) -> None:
    settings = make_settings(k_vc_by=KvcBy(by), k_vc_guess_deg_s_per_v=40.0)
    steps = [each.step for each in walk(PROCEDURES["virtual-coriolis"].plan(settings), LinearGyro(40.0))]
    windows = [step.step for step in steps if isinstance(step, Acquire)]
    assert windows.count(1) == windows.count(2) == 6 * blocks
    assert windows.count(3) == 17 + 2  # the zero before and after
    first = [step.rate_deg_s for step in steps if isinstance(step, Acquire) and step.step == 1][:6]
    assert first == [0.0, 10.0, -10.0, -10.0, 10.0, 0.0]


def test_what_cannot_be_is_refused() -> None:
    absolute = make_settings(k_vc_by=KvcBy.PLUS_MINUS, match=Match.ABSOLUTE)
    assert [invalid_value.path for invalid_value in absolute.contradictions()] == ["match"]
    short = make_settings(k_vc_by=KvcBy.CURVE, match_rates_deg_s=(10.0, 20.0, 100.0))
    assert [invalid_value.path for invalid_value in short.contradictions()] == ["match_rates_deg_s"]
    assert not list(make_settings(k_vc_by=KvcBy.CURVE).contradictions())


def test_rate_of_a_v_vc_is_the_curve_s() -> None:
    curve: Any = SimpleNamespace(coefficients=(150.0, -2.0, 0.5))
    assert NullVirtualCoriolisResult.rate_of(curve, 2.0) == pytest.approx(300.0 - 8.0 + 4.0)
