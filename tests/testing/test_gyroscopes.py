"""Drawn gyroscopes: all of the kind, each the same for its seed, each with a bench for all procedures."""

from __future__ import annotations

import math
import tomllib

import numpy as np
import pytest
from msgspec import structs
from simrack_tests.cells import few

from tests.sim.gyro.bench import mean_v
from vcfbench.clock import VirtualClock
from vcfbench.instructions.titles import BUILT_IN
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.layers import settings_of
from vcfbench.sim.gyro.data_sheet import OUTPUT_SHARE
from vcfbench.sim.simulation import physical_parameters, true_output
from vcfbench.sim.world import World
from vcfbench.testing.gyroscopes import drawn_bench, drawn_sheet

SEEDS = range(400)


def test_a_seed_is_one_gyroscope() -> None:
    assert drawn_sheet(7) == drawn_sheet(7) != drawn_sheet(8)
    assert drawn_bench(7) == drawn_bench(7)


def test_the_draws_reach_the_ends_of_their_ranges() -> None:
    sheets = [drawn_sheet(seed) for seed in SEEDS]

    def reached(key: str) -> tuple[float, float]:
        sizes = [abs(getattr(sheet, key)) for sheet in sheets]
        return min(sizes), max(sizes)

    wanted = {
        "drive_hz": (1500.0, 45_000.0),
        "split_hz": (6.0, 75.0),
        "q_drive": (120.0, 8e4),
        "q_sense": (300.0, 5e4),
        "quadrature_deg_s": (5.0, 290.0),
        "angle_random_walk_deg_sqrt_h": (0.012, 1.7),
        "rail_v": (5.0, 15.0),
    }
    for key, (low, high) in wanted.items():
        least, most = reached(key)
        assert least <= low, key
        assert most >= high, key
    least, most = reached("scale_factor_v_per_deg_s")
    assert math.log10(most / least) > 2.5
    for key in ("k_vc_deg_s_per_v", "split_hz", "scale_factor_v_per_deg_s"):
        assert {math.copysign(1.0, getattr(sheet, key)) for sheet in sheets} == {-1.0, 1.0}, key


@pytest.mark.parametrize("seed", few([0, 1], every=2))
@pytest.mark.parametrize("imperfections", [False, True])
def test_bench_of_drawn_gyroscope_suits_all_procedures(seed: int, *, imperfections: bool) -> None:
    for noise in (False, True):
        bench = parse_bench(drawn_bench(seed, imperfections=imperfections, noise=noise), f"gyroscope-{seed}")
        assert bench.simulation is not None
        drawn = bench.simulation.override["noise"]["angle_random_walk_deg_sqrt_s"] if noise else 0.0
        assert drawn * 60.0 == pytest.approx(noise * drawn_sheet(seed).angle_random_walk_deg_sqrt_h)
        assert structs.asdict(bench.limits)["max_rail_v"] == pytest.approx(1.05 * drawn_sheet(seed).rail_v)


@pytest.mark.parametrize("seed", few(range(0, 240, 4), 0, 204))
def test_drawn_settings_give_independent_readings(seed: int) -> None:
    """What a narrow mode makes of white noise falls with its time constant; readings nearer than it are alike."""
    bench, sheet = parse_bench(drawn_bench(seed), f"gyroscope-{seed}"), drawn_sheet(seed)
    for procedure in (PROCEDURES[name] for name in BUILT_IN):
        settings = settings_of(procedure, bench, recalled=False)
        assert math.exp(-settings.sample_interval_s * math.pi * sheet.drive_hz / sheet.q_sense) < 0.06, procedure.name


@pytest.mark.parametrize("seed", few(range(100, 180), 125, 131, 162))
def test_output_is_constant_after_settle_s(seed: int) -> None:
    """A drive mode of 1 ms was locked by the simulation after 3 s only; a start pushes sense modes at resonance."""
    text, sheet, clock = drawn_bench(seed, noise=False), drawn_sheet(seed), VirtualClock()
    world = World(clock, physical_parameters(parse_bench(text, f"gyroscope-{seed}")), 1)
    for rail, sign in (("positive", 1.0), ("negative", -1.0)):
        world.set_rail(rail, sign * sheet.rail_v)
    clock.sleep_until(tomllib.loads(text)["procedure"]["repeatability"]["settle_s"])
    means_v = [mean_v(clock, world, 0.02) for _ in range(10)]
    assert np.ptp(means_v) < 5e-5 * sheet.range_deg_s * abs(sheet.scale_factor_v_per_deg_s)


@pytest.mark.parametrize("seed", few(range(60), *range(2)))
def test_largest_v_vc_does_not_clip_the_output(seed: int) -> None:
    text, sheet = drawn_bench(seed, noise=False), drawn_sheet(seed)
    level_deg_s = tomllib.loads(text)["procedure"]["power"]["level_deg_s"]
    output, most_v = true_output(parse_bench(text, f"gyroscope-{seed}")), OUTPUT_SHARE * sheet.rail_v
    for sign in (-1.0, 1.0):
        v_vc_v = sign * level_deg_s / sheet.k_vc_deg_s_per_v
        assert abs(output(0.0, 1.05 * v_vc_v)) < 0.999 * most_v
        assert abs(output(0.0, v_vc_v)) > 0.7 * sheet.range_deg_s * abs(sheet.scale_factor_v_per_deg_s)


@pytest.mark.parametrize("seed", few(range(0, 400, 10), 40, 310))
def test_bias_moves_at_most_by_stated_coefficient(seed: int) -> None:
    """What quadrature leaks moves with the temperature as well, up to three times as much as all else."""
    text, sheet = drawn_bench(seed, noise=False), drawn_sheet(seed)
    known = tomllib.loads(text)["uncertainty"]
    heating = "\n[simulation.override.thermal]\nself_heating_k = "
    cold_v, warm_v = (true_output(parse_bench(f"{text}{heating}{by_k}\n", "g"))(0.0, None) for by_k in (0.0, 0.3))
    by_scale_deg_h = 1e-6 * known["scale_factor_ppm_k"] * 3600.0 * abs(sheet.bias_deg_s)
    moved_deg_h = 3600.0 * abs(warm_v - cold_v) / abs(sheet.scale_factor_v_per_deg_s)
    assert moved_deg_h < 0.3 * (known["bias_deg_h_k"] + by_scale_deg_h) + 1.0
