"""docs/theory.md, "The signal equation of the simulated bench", integrated as it stands there against the World."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.integrate import solve_ivp
from simrack.sources import Drive

from tests.sim.gyro.bench import powered
from vcfbench.sim.gyro.design import ideal_bench

if TYPE_CHECKING:
    from vcfbench.sim.parameters import BenchParameters

IDEAL = ideal_bench()
SKEWED = replace(
    IDEAL,
    sense_in_phase=replace(IDEAL.sense_in_phase, quadrature_rad_s=0.02),
    sense_anti_phase=replace(IDEAL.sense_anti_phase, quadrature_rad_s=-0.3),
    sense_path=replace(
        IDEAL.sense_path, demodulator_phase_rad=math.pi - 0.03, carrier_feedthrough=2e-3, v_vc_feedthrough=-4e-3
    ),
    virtual_path=replace(
        IDEAL.virtual_path,
        carrier_phase_rad=math.pi + 0.05,
        left_comb_n_per_v2=1.1 * IDEAL.virtual_path.left_comb_n_per_v2,
        offset_v=0.03,
        second_order_per_v=0.02,
        third_order_per_v2=0.01,
    ),
)


def cycle(bench: BenchParameters, first_rad: float, rate_rad_s: float, v_vc: float) -> np.ndarray:
    """What one carrier cycle from phase `first_rad` on does to (Y1, Y1'/w, Y2, Y2'/w, two biquads, 1), in V."""
    sense, path, loop = bench.sense_path, bench.virtual_path, bench.drive_loop
    w = 2 * math.pi * bench.drive_mode.frequency_hz
    m = path.offset_v + v_vc + path.second_order_per_v * v_vc**2 + path.third_order_per_v2 * v_vc**3
    v_dac, corner = sense.reference_amplitude_v, 2 * math.pi * sense.low_pass_hz / w
    through = (sense.carrier_feedthrough + sense.v_vc_feedthrough * m / v_dac) * v_dac
    dampings = (2 * math.sin(math.pi / 8), 2 * math.sin(3 * math.pi / 8))

    def slope(theta: float, columns: np.ndarray) -> np.ndarray:
        a = np.zeros((9, 9))
        x, dx = -loop.amplitude_m * math.cos(theta), loop.amplitude_m * w * math.sin(theta)
        carrier = v_dac * math.sin(theta + path.carrier_phase_rad)
        for row, mode in ((0, bench.sense_in_phase), (2, bench.sense_anti_phase)):
            own = 2 * math.pi * mode.frequency_hz
            combs = mode.left_participation * path.left_comb_n_per_v2
            combs += mode.right_participation * path.right_comb_n_per_v2
            force = -2 * rate_rad_s * (mode.left_participation + mode.right_participation) * dx
            force += -2 * w * mode.quadrature_rad_s * x + m * carrier * combs / path.mass_kg
            shown = sense.preamplifier_gain * sense.amplifier_gain * mode.pick_off_v_per_m
            a[row, row + 1] = 1.0
            a[row + 1, row], a[row + 1, row + 1] = -((own / w) ** 2), -own / (mode.quality * w)
            a[row + 1, 8] = shown * force / w**2
        product = sense.multiplier_per_v * v_dac * math.sin(theta + sense.demodulator_phase_rad)
        a[4, 5] = a[6, 7] = corner
        a[5, [0, 2, 4, 5]] = corner * np.array([product, product, -1.0, -dampings[0]])
        a[5, 8] = corner * product * through * math.sin(theta + path.carrier_phase_rad)
        a[7, [4, 6, 7]] = corner * np.array([1.0, -1.0, -dampings[1]])
        return np.asarray((a @ columns.reshape(9, 9)).ravel())

    span = (first_rad, first_rad + 2 * math.pi)
    run = solve_ivp(slope, span, np.eye(9).ravel(), method="DOP853", rtol=1e-12, atol=1e-14)
    return np.asarray(run.y[:, -1].reshape(9, 9))


@pytest.mark.parametrize("rate_deg_s", [0.0, -70.0])
def test_a_step_of_v_vc_through_the_whole_equation(rate_deg_s: float) -> None:
    """From 0.2 V to -0.7 V at a phase of chance, 0.57 s of it, each cycle: right to 1e-8 of what the step moves."""
    clock, world = powered(SKEWED)
    world.table.demand_rate(rate_deg_s, 1000.0)
    world.drive("v_vc", Drive(0.2, source_ohm=0.0))
    clock.sleep_until(9.0)
    world.drive("v_vc", Drive(-0.7, source_ohm=0.0))
    start, period = 9.0, 1 / 3488.9
    capture = world.capture(start, start + 0.6)
    clock.sleep_until(start + 0.6)
    drive = capture.samples("drive", start + np.arange(400) / 100 * period)
    first = float(np.angle(-np.mean(drive * np.exp(-2j * math.pi * np.arange(400) / 100))))
    before, after = (cycle(SKEWED, first, math.radians(rate_deg_s), volts) for volts in (0.2, -0.7))
    state = np.append(np.linalg.solve(np.eye(8) - before[:8, :8], before[:8, 8]), 1.0)
    wanted = []
    for _ in range(2000):
        wanted.append(state[6])
        state = after @ state
    stage = SKEWED.output_stage
    volts = capture.samples("output", start + np.arange(2000) * period)
    expected = stage.offset_v + stage.gain * np.array(wanted)
    assert np.max(np.abs(volts - expected)) < 1e-8 * np.ptp(expected)
