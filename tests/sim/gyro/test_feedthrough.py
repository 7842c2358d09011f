"""Carrier and V_Vc that come into the sense path without any motion."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.integrate import solve_ivp
from simrack.sources import Drive

from tests.sim.gyro.bench import powered
from tests.sim.gyro.carrier import CarrierModel
from vcfbench.sim.gyro.design import ideal_bench

if TYPE_CHECKING:
    from vcfbench.sim.parameters import BenchParameters

IDEAL = ideal_bench()
LEAKING = replace(
    IDEAL,
    sense_path=replace(
        IDEAL.sense_path,
        carrier_feedthrough=3e-3,
        v_vc_feedthrough=5e-3,
        demodulator_phase_rad=math.pi - 0.02,
    ),
    virtual_path=replace(IDEAL.virtual_path, carrier_phase_rad=math.pi + 0.01),
)
SEALED = replace(LEAKING, sense_path=replace(LEAKING.sense_path, carrier_feedthrough=0.0, v_vc_feedthrough=0.0))


def settled(bench: BenchParameters, volts: float) -> tuple[float, np.ndarray, np.ndarray]:
    """Output, V_s and carrier of two carrier cycles, V_Vc having stood long."""
    clock, world = powered(bench)
    world.drive("v_vc", Drive(volts, source_ohm=0.0))
    clock.sleep_until(9.0)
    capture = world.capture(9.0, 9.0 + 2 / 3488.9)
    clock.sleep_until(10.0)
    times = 9.0 + np.arange(200) / 100 / 3488.9
    sense, carrier = (capture.samples(node, times) for node in ("sense", "carrier"))
    return world.value_v("output"), sense, carrier


@pytest.mark.parametrize("volts", [0.0, 0.7, -1.3])
def test_feed_through_is_in_v_s_and_demodulated_in_phase(volts: float) -> None:
    """(k_c V_dac + k_v V_Vc) sin(th + phi_c) in V_s, hence half of it times cos(phi_c - phi) at the filter."""
    (with_it, sense, carrier), (without, still, _) = settled(LEAKING, volts), settled(SEALED, volts)
    sense_path, path = LEAKING.sense_path, LEAKING.virtual_path
    through = 3e-3 * sense_path.reference_amplitude_v + 5e-3 * volts
    assert sense - still == pytest.approx(through * carrier / sense_path.reference_amplitude_v, abs=1e-9)
    turned = math.cos(path.carrier_phase_rad - sense_path.demodulator_phase_rad)
    down = 0.5 * sense_path.multiplier_per_v * sense_path.reference_amplitude_v * through * turned
    assert with_it - without == pytest.approx(LEAKING.output_stage.gain * down, abs=1e-6 * abs(down) + 1e-7)


def test_step_passes_filter_as_integration_at_carrier_level() -> None:
    """V_Vc steps to 0.5 V with nothing else on the modes: the filtered signal over 12 ms, against solve_ivp."""
    bench = replace(
        LEAKING,
        virtual_path=replace(LEAKING.virtual_path, left_comb_n_per_v2=0.0, right_comb_n_per_v2=0.0),
        sense_path=replace(LEAKING.sense_path, carrier_feedthrough=0.0),
    )
    clock, world = powered(bench)
    world.drive("v_vc", Drive(0.5, source_ohm=0.0))
    start = clock.now()
    capture = world.capture(start, start + 0.012)
    clock.sleep_until(start + 0.012)
    times = start + np.linspace(0.001, 0.0119, 40)
    drive = capture.samples("drive", start + np.arange(400) / 100 / 3488.9)
    phasor = 2 * np.mean(drive * np.exp(-2j * math.pi * np.arange(400) / 100))
    first = float(np.angle(-phasor))  # the drive is -cos(th)
    omega, path = 2 * math.pi * 3488.9, bench.sense_path

    def slope(t: float, state: np.ndarray) -> list[float]:
        th = first + omega * t
        v_s = 5e-3 * 0.5 * math.sin(th + bench.virtual_path.carrier_phase_rad)
        source = path.multiplier_per_v * path.reference_amplitude_v * math.sin(th + path.demodulator_phase_rad) * v_s
        w = 2 * math.pi * path.low_pass_hz
        out = []
        for row, damping in ((0, 2 * math.sin(math.pi / 8)), (2, 2 * math.sin(3 * math.pi / 8))):
            out += [w * state[row + 1], w * (source - state[row] - damping * state[row + 1])]
            source = state[row]
        return out

    run = solve_ivp(slope, (0.0, 0.012), np.zeros(4), method="DOP853", rtol=1e-10, atol=1e-13, t_eval=times - start)
    seen = (capture.samples("output", times) - bench.output_stage.offset_v) / bench.output_stage.gain
    assert np.max(np.abs(seen - run.y[2])) < 1e-7 * np.max(np.abs(run.y[2]))


@pytest.mark.exhaustive
def test_the_carrier_model_has_it_too() -> None:
    model, sealed = CarrierModel(LEAKING), CarrierModel(SEALED)
    runs = [each.run(each.at_rest(), 400, rate_rad_s=0.0, virtual_v=0.6) for each in (model, sealed)]
    through = 3e-3 * LEAKING.sense_path.reference_amplitude_v + 5e-3 * 0.6
    phases = 2 * math.pi * 3488.9 * runs[0].time_s + LEAKING.virtual_path.carrier_phase_rad
    assert runs[0].sense - runs[1].sense == pytest.approx(through * np.sin(phases), abs=1e-9)
    turned = math.cos(LEAKING.virtual_path.carrier_phase_rad - LEAKING.sense_path.demodulator_phase_rad)
    scale = 0.5 * LEAKING.sense_path.multiplier_per_v * LEAKING.sense_path.reference_amplitude_v
    assert (runs[0].filtered - runs[1].filtered)[-64:].mean() == pytest.approx(scale * through * turned, rel=1e-5)
