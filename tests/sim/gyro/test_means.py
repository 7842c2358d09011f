"""What a meter integrates: carriers over a part of a cycle, the curvature of noise, outputs that clip."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.linalg import expm
from simrack.oscillation import Oscillation
from simrack.sources import Drive

from tests.sim.gyro.bench import locked_chain, mean_v, powered
from tests.sim.gyro.test_bridge import FILTERED, STILL, deviation_v, stationary, white_only
from vcfbench.clock import VirtualClock
from vcfbench.procedures.bench_file import load_bench
from vcfbench.sim.builder import SimulatedBench
from vcfbench.sim.gyro.design import ideal_bench
from vcfbench.sim.gyro.electronics import OutputLimits
from vcfbench.sim.gyro.means import output_integral
from vcfbench.sim.gyro.noise import FlickerNoise, NoisyChain
from vcfbench.sim.gyro.signals import ExponentialSum
from vcfbench.sim.world import World

IDEAL = ideal_bench()
QUIET = replace(
    STILL,
    noise=replace(STILL.noise, angle_random_walk_deg_sqrt_s=0.0, bias_instability_deg_s=0.0),
    table=replace(STILL.table, flutter_per_sqrt_hz=0.0),
)


@pytest.mark.parametrize("node", ["drive", "carrier", "sense"])
@pytest.mark.parametrize("aperture_s", [0.4e-3, 3e-3, 0.02, 0.2])
def test_dc_voltage_of_carrier_is_mean_over_aperture(node: str, aperture_s: float) -> None:
    """Against the mean of points 1 us apart, good to (w h)^2/24 = 2e-5 of it; 1 V leaves up to 0.23 V in 0.4 ms."""
    clock, world = powered(QUIET)
    world.table.demand_rate(150.0, 100.0)
    world.drive("v_vc", Drive(0.3, 0.2, 30.0))
    clock.sleep_until(7.0)
    start = clock.now() + 1.234e-4
    window, capture = world.window(node, start, start + aperture_s), world.capture(start, start + aperture_s)
    clock.sleep_until(start + aperture_s)
    count = round(aperture_s / 1e-6)
    volts = capture.samples(node, start + (np.arange(count) + 0.5) * 1e-6)
    assert window.mean_v() == pytest.approx(volts.mean(), rel=3e-5, abs=1e-7)


def test_mean_of_a_starting_drive_matches_its_waveform() -> None:
    clock = VirtualClock()
    world = World(clock, IDEAL, 0)
    world.set_rail("positive", 10.0)
    world.set_rail("negative", -10.0)
    clock.sleep_until(0.05)
    window, capture = world.window("drive", 0.0501, 0.0605), world.capture(0.0501, 0.0605)
    clock.sleep_until(0.0605)
    times = 0.0501 + (np.arange(200_000) + 0.5) * (0.0104 / 200_000)
    assert window.mean_v() == pytest.approx(capture.samples("drive", times).mean(), abs=2e-6)


def test_the_meter_reads_a_carrier_at_its_shortest_aperture() -> None:
    """1 V: sin(pi f T)/(pi f T) = -0.216 at 0.4 ms; twenty readings at chance phases scatter by a 1/sqrt(2) of it."""
    bench = SimulatedBench.build(load_bench("ideal"), 0, VirtualClock())
    for rail, volts in (("positive", 10.0), ("negative", -10.0)):
        bench.world.set_rail(rail, volts)
    bench.world.leads["multimeter"].connect("input", "drive")
    bench.clock.sleep_until(4.0)
    meter = bench.devices["multimeter"]
    meter.write(b"CONF:VOLT:DC 10;:VOLT:DC:NPLC 0.02;:SAMP:COUN 20;:READ?\n")
    reply, end = meter.read(4096)
    while not end:
        wake = meter.wake_at()
        assert wake is not None
        bench.clock.sleep_until(wake)
        reply, end = meter.read(4096)
    readings = np.array([float(each) for each in reply.split(b",")])
    most = abs(np.sinc(3488.9 * 0.4e-3))
    assert 0.4 * most < readings.std() < most
    assert np.abs(readings).max() <= 1.001 * most


@pytest.mark.parametrize("duration_s", [0.4e-3, 0.02, 0.2, 2.0])
def test_variance_within_aperture_complements_its_mean(duration_s: float) -> None:
    """C(0) less 2/T^2 int (T - t) C(t) dt, C = row exp(A t) S of the plainly written system."""
    a, _, s = stationary(white_only())
    points = 4001
    lags = np.linspace(0.0, duration_s, points)
    once, state, covariances = expm(a * lags[1]), s, []
    for _ in lags:
        covariances.append(state[FILTERED, FILTERED])
        state = once @ state
    weighed = (duration_s - lags) * np.array(covariances)
    wanted = covariances[0] - 2 * np.trapezoid(weighed, lags) / duration_s**2
    white = math.radians(STILL.noise.angle_random_walk_deg_sqrt_s)
    chain = NoisyChain(locked_chain(STILL), FlickerNoise(np.array([1.0]), 0.0), white)
    assert chain.variance_v2(duration_s) == pytest.approx(wanted, rel=1e-3, abs=1e-8 * covariances[0])


@pytest.mark.exhaustive
@pytest.mark.parametrize(("aperture_s", "readings"), [(0.4e-3, 600), (0.02, 600), (0.2, 300), (2.0, 40)])
def test_curved_noise_shifts_every_aperture_alike(aperture_s: float, readings: int) -> None:
    """1 deg/sqrt(s) into a curvature of -0.05/V: c2 var = -8.2 mV with every aperture, against the same noise."""
    loud = replace(white_only().noise, angle_random_walk_deg_sqrt_s=1.0)
    seen = {}
    for second_order in (-0.05, 0.0):
        stage = replace(IDEAL.output_stage, second_order_per_v=second_order)
        clock, world = powered(replace(IDEAL, noise=loud, output_stage=stage), 17)
        means = []
        for _ in range(readings):
            clock.sleep_until(clock.now() + 0.1)
            means.append(mean_v(clock, world, aperture_s))
        seen[second_order] = np.array(means)
    shifts = seen[-0.05] - seen[0.0]
    wanted = -0.05 * deviation_v(replace(IDEAL, noise=loud)) ** 2
    assert wanted == pytest.approx(-8.2e-3, rel=0.01)
    assert shifts.mean() == pytest.approx(wanted, abs=5 * shifts.std() * 1.5 / math.sqrt(readings) + 1e-6)


def sine(mean_v: float, amplitude_v: float, frequency_hz: float) -> ExponentialSum:
    return ExponentialSum(mean_v + 0j, 0j, np.array([-1j * amplitude_v]), np.array([2j * math.pi * frequency_hz]))


@pytest.mark.parametrize(("mean", "amplitude"), [(6.0, 5.0), (0.0, 20.0), (8.4, 0.2), (12.0, 2.0), (-7.0, 1.6)])
def test_the_mean_of_a_clipped_sine_is_the_closed_form(mean: float, amplitude: float) -> None:
    """Between limits +-8.5 V: each half of a period adds (a cos x0 - (limit - mean)(pi/2 - x0)) / pi beyond it."""
    seen = output_integral(LIMITS, sine(mean, amplitude, 25.0), 0.2, 0.0, 0.0) / 0.2
    wanted = mean
    for sign in (1.0, -1.0):
        beyond = (8.5 - sign * mean) / amplitude
        x = math.asin(min(max(beyond, -1.0), 1.0))
        wanted -= sign * amplitude * (math.cos(x) - beyond * (math.pi / 2 - x)) / math.pi
    assert seen == pytest.approx(wanted, abs=1e-6)


LIMITS = OutputLimits(
    replace(IDEAL.output_stage, gain=1.0, headroom_v=1.5), Oscillation(10.0, []), Oscillation(-10.0, [])
)


@pytest.mark.parametrize("level", [8.5, 8.4985, 8.503, -8.5012])
def test_noise_about_a_limit_is_averaged_between_the_limits(level: float) -> None:
    """1.4 mV rms about a limit: the mean of a million clipped draws, known to 1.4 uV."""
    draws = np.random.default_rng(1).standard_normal(1_000_000) * 1.4e-3
    still = ExponentialSum(level + 0j, 0j, np.zeros(0, complex), np.zeros(0, complex))
    seen = output_integral(LIMITS, still, 0.5, 0.0, 1.4e-3**2) / 0.5
    assert seen == pytest.approx(np.clip(level + draws, -8.5, 8.5).mean(), abs=7e-6)
