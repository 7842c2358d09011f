"""The carrier-level model, proved by an independent integrator, and the envelope, proved by the carrier level."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.sim.gyro.bench import locked_chain
from tests.sim.gyro.carrier import CarrierModel, CarrierRun
from tests.sim.gyro.plain import carrier_rhs, steady_output_v
from vcfbench.sim.gyro.chain import Forcing, Response
from vcfbench.sim.gyro.design import ideal_bench, paper_bench

if TYPE_CHECKING:
    from vcfbench.sim.parameters import BenchParameters

BENCHES = [ideal_bench(), paper_bench()]
FULL_SCALE_RAD_S = math.radians(200.0)


def runs(bench: BenchParameters) -> list[tuple[CarrierRun, Response]]:
    """Rest, a step to 200 deg/s, then a step to 50 deg/s with V_Vc at 2 V: both models side by side, 0.5 s each."""
    model, chain = CarrierModel(bench), locked_chain(bench)
    modal, state, done = np.zeros(8, complex), model.at_rest(), []
    for rate, virtual in ((FULL_SCALE_RAD_S, 0.0), (math.radians(50.0), 2.0)):
        run = model.run(state, 1744, rate_rad_s=rate, virtual_v=virtual)
        response = chain.respond(modal, Forcing(rate, 0j, [], virtual, []), 1)
        done.append((run, response))
        state, modal = run.state, response.modal(1744 * model.cycle_s)
    return done


@pytest.mark.parametrize("bench", BENCHES)
def test_envelope_meets_the_carrier_level_within_1e_6(
    bench: BenchParameters,
) -> None:
    full_scale = abs(steady_output_v(bench, FULL_SCALE_RAD_S))
    for run, response in runs(bench):
        difference = response.filtered.at(run.time_s).real - run.filtered
        assert np.max(np.abs(difference)) < 1e-6 * full_scale
        assert np.max(np.abs(difference)) < 1e-8 * full_scale  # what the step size of the carrier level leaves


@pytest.mark.parametrize("bench", BENCHES)
def test_v_s_meets_the_carrier_level_too(bench: BenchParameters) -> None:
    omega = 2 * math.pi * bench.drive_mode.frequency_hz
    for run, response in runs(bench):
        seen = (response.sense.at(run.time_s) * np.exp(1j * omega * run.time_s)).real
        assert np.max(np.abs(seen - run.sense)) < 1e-8 * np.max(np.abs(run.sense))


def test_ripple_at_twice_carrier_is_4e_8_of_signal() -> None:
    """(f_c/2f_d)^4 = 4.2e-8 behind the 100 Hz low-pass: what the 2 w_d product adds in the steady state."""
    bench = BENCHES[0]
    model, state = CarrierModel(bench), CarrierModel(bench).at_rest()
    state = model.run(state, 9000, rate_rad_s=FULL_SCALE_RAD_S, virtual_v=0.0).state
    run = model.run(state, 10, rate_rad_s=FULL_SCALE_RAD_S, virtual_v=0.0)
    mean = run.filtered.mean()
    ripple = (run.filtered.max() - run.filtered.min()) / 2
    assert ripple / abs(mean) == pytest.approx((100 / (2 * 3488.9)) ** 4, rel=0.02)
    assert mean == pytest.approx(steady_output_v(bench, FULL_SCALE_RAD_S), rel=1e-8)


@pytest.mark.exhaustive
def test_carrier_level_agrees_with_independent_integrator() -> None:
    bench = paper_bench()
    model = CarrierModel(bench)
    rate, virtual, cycles = 2.0, -1.5, 60
    run = model.run(model.at_rest(), cycles, rate_rad_s=rate, virtual_v=virtual)
    start = np.zeros(10)
    start[0] = -bench.drive_loop.amplitude_m * 1e6
    solved = solve_ivp(
        lambda t, s: carrier_rhs(bench, t, s, rate, virtual), (0.0, float(run.time_s[-1])), start, "DOP853",
        t_eval=run.time_s, rtol=1e-10, atol=1e-13,
    )  # fmt: skip
    gain = bench.sense_path.preamplifier_gain * bench.sense_path.amplifier_gain
    sense = gain * 1e-6 * bench.sense_anti_phase.pick_off_v_per_m * (solved.y[2] + solved.y[4])
    assert np.max(np.abs(run.drive - 0.2 * solved.y[0])) < 1e-8
    assert np.max(np.abs(run.sense - sense)) < 1e-7 * np.max(np.abs(sense))
    assert np.max(np.abs(run.filtered - solved.y[8])) < 1e-7 * np.max(np.abs(run.filtered))


def test_a_cycle_has_at_least_64_samples() -> None:
    run = CarrierModel(BENCHES[0]).run(CarrierModel(BENCHES[0]).at_rest(), 100, rate_rad_s=0.0, virtual_v=0.0)
    assert len(run.time_s) == 6400
    assert np.diff(run.time_s) == pytest.approx(1 / (64 * 3488.9))
