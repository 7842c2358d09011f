"""The supply: currents, valid output, and what the rails do are those that are simulated."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from msgspec import structs

import vcfbench
from vcfbench.analysis.chopped import CHOPPED, Block, BlockNoise
from vcfbench.errors import ConfigError
from vcfbench.instructions.scale_factor import ScaleFactorBy
from vcfbench.procedures.power.plan import POWER, RailOnAndLog, SuppliedAndLogged, power_characteristics
from vcfbench.procedures.power.results import PowerSettings, _moved, _three, valid_output
from vcfbench.records.device_values import Characteristics
from vcfbench.station.parts import Limits
from vcfbench.station.settings import Station
from vcfbench.steps import ConfigureRail, DisableSupply, SetRate, SetVvc
from vcfbench.steps.dry_run import walk
from vcfbench.testing import simulated
from vcfbench.uncertainty.measurand import as_kept
from vcfbench.values.value import UncertaintyPart

if TYPE_CHECKING:
    from vcfbench.steps.step import Step

ON_STATION = Limits(
    max_rate_deg_s=300.0,
    max_acceleration_deg_s2=200.0,
    max_v_vc_v=10.0,
    min_rail_v=9.5,
    max_rail_v=10.5,
    max_rail_current_a=0.2,
)
QUIESCENT_A, START_UP_A = 0.028, 0.012
"""`sim show`: supply.quiescent_a, supply.start_up_a."""
BY_AMPLITUDE_PPM_V = 2.0 * 2e-4 * 1e6
"""`sim show`: drive_loop.amplitude_supply_coefficient_per_v; amplitude and reference (V_dac) both go by it."""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Any:
    settings = {"warm_up_s": 900.0, "cycles": 1, "orders": ["together", "positive"]}
    return vcfbench.run("power", "lab", seed=5, settings=settings, runs=tmp_path_factory.mktemp("runs"))


@pytest.mark.exhaustive
def test_the_steady_currents_are_found(run: Any) -> None:
    for rail in run.results.rails:
        assert abs(rail.current.value - QUIESCENT_A) < rail.current.u95 < 4e-3
        assert rail.inrush.value <= QUIESCENT_A + START_UP_A + 3.0 * rail.inrush.u
        assert rail.inrush.value >= rail.current.value - 3e-4
    power = run.results.power
    assert abs(power.value - 20.0 * QUIESCENT_A) < 3.0 * power.u < 0.1  # 4 mA of each rail, at 10 V


@pytest.mark.exhaustive
def test_the_weaker_rail_alone_decides(run: Any) -> None:
    """The drive amplitude goes by the weaker rail: lowered, one rail does all that both do; raised, nothing."""
    assert [effect.rails for effect in run.results.effects] == ["positive", "negative", "both"]
    truths = {"positive": (1.0, 0.0), "negative": (1.0, 0.0), "both": (1.0, 1.0)}
    for effect in run.results.effects:
        lowered, raised = (BY_AMPLITUDE_PPM_V * share for share in truths[effect.rails])
        half = 0.5 * (lowered + raised)
        found = (effect.scale_factor, effect.scale_factor_lowered, effect.scale_factor_raised)
        for value, truth in zip(found, (half, lowered, raised), strict=True):
            assert abs(value.value - truth) < 3.5 * value.u < 400.0
        assert abs(effect.bias.value) < 4.0 * effect.bias.u < 0.05
        assert effect.step_v == pytest.approx(0.2, abs=3e-3)


@pytest.mark.exhaustive
def test_effect_of_both_rails_is_kept_of_the_device(run: Any) -> None:
    both = as_kept(run.results.effects[2].scale_factor)
    assert power_characteristics(PowerSettings(), run.results) == Characteristics(v_vc_slope_ppm_v=both)
    by_table = power_characteristics(PowerSettings(by=ScaleFactorBy.TABLE), run.results)
    assert by_table == Characteristics(table_slope_ppm_v=both)


def test_each_power_on_is_told(run: Any) -> None:
    together, positive = run.results.power_on
    assert (together.order, positive.order) == ("together", "positive")
    for on in (together, positive):
        assert on.valid_output is not None
        assert 0.0 < on.valid_output.value < 1.0
        assert set(on.current_a) == {"positive", "negative"}
    assert min(positive.t_s) < -0.5


def test_the_record_tells_the_same(run: Any) -> None:
    again = vcfbench.load_run(run.directory)
    assert again.results == run.results
    said = vcfbench.text_of(again.report())
    assert said == vcfbench.text_of(run.report())
    assert "peaks are missed" in said
    assert "scale factor by both rails" in said


def test_valid_is_from_when_it_stays() -> None:
    times = [0.1 * n for n in range(40)]
    found = valid_output(times, [9.0, 0.0, 9.0, 3.0, *[0.1] * 36], 1.0)
    assert found is not None
    assert found.value == pytest.approx(0.35)
    assert found.u == pytest.approx(0.1 / 12**0.5)
    assert valid_output(times, [9.0] * 35 + [0.0] * 5, 1.0) is None


def planned(**changes: Any) -> list[Step]:
    settings = PowerSettings(station=Station(meter_resolution_v=1e-5, limits=ON_STATION), **changes)
    return [each.step for each in walk(POWER.plan(settings), settings.expected_gyro())]


def test_second_rail_waits_at_0_v_and_orders_start_off() -> None:
    steps = planned(orders=("negative", "together"), cycles=1, rails_varied=("both",))
    on = next(n for n, step in enumerate(steps) if isinstance(step, SuppliedAndLogged))
    levels = {step.rail: step.voltage_v for step in steps[:on] if isinstance(step, ConfigureRail)}
    assert levels == {"positive": 0.0, "negative": -10.0}
    assert isinstance(steps[on + 1], RailOnAndLog)
    assert isinstance(steps[on + 2], DisableSupply)
    assert sum(isinstance(step, SuppliedAndLogged) for step in steps) == 2
    assert isinstance(steps[-1], DisableSupply) or any(isinstance(step, DisableSupply) for step in steps[-4:])


def test_rails_return_and_stay_within_step() -> None:
    for by in ScaleFactorBy:
        steps = planned(by=by, cycles=1)
        rails = [step for step in steps if isinstance(step, ConfigureRail)]
        assert [step.voltage_v for step in rails[-2:]] == [10.0, -10.0]
        assert {abs(step.voltage_v) for step in rails} == {9.8, 10.0, 10.2}
        turned = {step.rate_deg_s for step in steps if isinstance(step, SetRate)}
        assert turned == ({0.0, 10.0} if by is ScaleFactorBy.V_VC else {0.0, 10.0, 200.0, -200.0})
        assert any(type(step) is SetVvc for step in steps) is (by is ScaleFactorBy.V_VC)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"rail_step_v": 0.6}, "rail_step_v: expected at most 0.5 V"),
        ({"by": "table", "level_deg_s": 400.0}, "level_deg_s: expected a rate of at most 300 deg/s either way"),
    ],
)
def test_what_the_limits_do_not_bear_is_refused(settings: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        vcfbench.dry_run("power", "lab", settings=settings)


@pytest.mark.parametrize(("low_v", "high_v", "most_v"), [(9.5, 10.3, 0.3), (9.6, 12.0, 0.4), (9.85, 10.1, 0.1)])
def test_step_of_rails_is_held_by_the_nearer_limit(low_v: float, high_v: float, most_v: float) -> None:
    limits = structs.replace(ON_STATION, min_rail_v=low_v, max_rail_v=high_v)
    said = [
        list(PowerSettings(station=Station(limits=limits), rail_step_v=step_v).contradictions())
        for step_v in (0.99 * most_v, 1.01 * most_v)
    ]
    assert said[0] == []
    assert {each.expected.split(",")[0] for each in said[1]} == {f"at most {most_v:g} V"}


@pytest.mark.exhaustive
def test_imbalance_of_rails_is_corrected_in_both_halves() -> None:
    """Of a drive that follows the weaker rail, on a supply whose outputs are 30 mV apart; the closed form, balanced."""
    bench = simulated("lab", overrides={"drive_loop": {"amplitude_supply_coefficient_per_v": 5e-3}})
    assert bench.simulation is not None
    errors = structs.replace(bench.simulation.errors, power={"p25v": {"programming_offset_v": 0.03}})
    bench = structs.replace(bench, simulation=structs.replace(bench.simulation, errors=errors))
    found = vcfbench.run("power", bench, seed=5, settings={"rails_varied": ["positive", "negative"]}).results
    for effect, apart_v in zip(found.effects, (0.03, -0.03), strict=True):
        assert effect.imbalance_v == pytest.approx(apart_v, abs=3e-3)
        truth = {"lowered": 1e4 * (1.0 - 0.001), "raised": 0.0}
        for half, true in truth.items():
            value = getattr(effect, f"scale_factor_{half}")
            assert abs(value.value - true) < 3.0 * value.u
            assert any(part.source == "imbalance of the rails" for part in value.parts)
            assert value.u < 500.0  # what 30 mV of 200 mV would do is 1500; 9 mV of the read-backs is 460


@pytest.mark.parametrize("imbalance_v", [-0.09, -0.03, 0.0, 0.03, 0.09])
def test_halves_are_those_of_rails_of_one_size(imbalance_v: float) -> None:
    """Of an output that follows a rail by 0.3, and the weaker of both by 0.7; u by what each window does, counted."""

    def output_v(moved_v: float) -> float:
        own_v, other_v = 10.0 + imbalance_v + moved_v, 10.0
        return 0.3 * own_v + 0.7 * min(own_v, other_v)

    def found(errors_v: Any = (0.0,) * 6, u_imbalance_v: float = 0.0) -> Any:
        blocks = [Block(tuple(output_v(0.2 * sign) + e for sign, e in zip(CHOPPED, errors_v, strict=True)))] * 2
        of_step = 0.2, [UncertaintyPart("step", 0.01)]
        return _three(blocks, noise, of_step, (imbalance_v, u_imbalance_v), ("ppm/V", -1e6))

    window_v2 = np.diag([1e-10] * 6)
    by = np.array([[-0.5, 0.5, 0.0, 0.0, 0.5, -0.5], [-0.5, 0.0, 0.5, 0.5, 0.0, -0.5]])
    noise = BlockNoise(1e-5, 0.0, 0.0, tuple(map(tuple, by @ window_v2 @ by.T)), 10.0)
    both, lowered, raised = found()
    assert [each.value / -1e6 for each in (both, lowered, raised)] == pytest.approx([0.65, 1.0, 0.3])
    for place, each in enumerate((both, lowered, raised)):
        moves = [(found(1e-5 * row)[place].value - each.value) / 1e-5 for row in np.eye(6)]
        u = {part.source: part.u for part in each.parts}
        assert u["readings and flicker"] == pytest.approx(1e-5 * float(np.linalg.norm(moves)) / math.sqrt(2.0))
        assert u["step"] == pytest.approx(0.01 * abs(each.value))
    unsure = {part.source: part.u for part in found(u_imbalance_v=1e-3)[0].parts}
    assert unsure["imbalance of the rails"] == pytest.approx(0.5 * 0.7e6 * 1e-3 / 0.2)


def test_slope_is_relative_to_used_scale_factor() -> None:
    rails = [SimpleNamespace(rail="positive", voltage_v=10.0)]
    windows: Any = [
        (SimpleNamespace(rate_deg_s=rate), SimpleNamespace(mean_v=mean_v, rails=rails))
        for rate, mean_v in ((0.0, -0.125), (50.0, -0.6), (-50.0, 0.6))
    ]
    bias, slope, _ = _moved(6 * windows, -0.0125)
    assert bias.outputs_v == pytest.approx([10.0] * 6)
    assert slope.outputs_v == pytest.approx([0.96] * 6)
