"""The noise that the paper's gyroscope is simulated with, found again from readings of its output."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace

from tests.sim.gyro.bench import mean_v, powered
from vcfbench.analysis.allan import Sampling, Term, allan_deviation, block_means
from vcfbench.analysis.noise_fit import NoiseFit, fit_noise
from vcfbench.sim.gyro.design import paper_bench

pytestmark = pytest.mark.exhaustive

PAPER = paper_bench()
STILL = replace(PAPER, thermal=replace(PAPER.thermal, self_heating_k=0.0))
SCALE_FACTOR = 12.5527e-3
N_DEG_RTH = 60.0 * PAPER.noise.angle_random_walk_deg_sqrt_s
WHITE, FLICKER, FAST = Term.ANGLE_RANDOM_WALK, Term.BIAS_INSTABILITY, Term.QUANTISATION


def fitted(record: np.ndarray, sampling: Sampling, terms: list[Term]) -> NoiseFit:
    return fit_noise(allan_deviation(record, sampling.interval_s), record.size, sampling, terms)


def found_deg_rth(fit: NoiseFit) -> tuple[float, float]:
    walk = fit.terms[WHITE]
    assert walk.u is not None
    return 60.0 * walk.value, 60.0 * walk.u


def test_a_reading_a_second_of_a_fifth_of_it() -> None:
    """2.6 times the noise as it stands; right with aperture and the 3.4 Hz of a reading declared."""
    clock, world = powered(STILL, seed=4)
    volts = []
    for _ in range(3000):
        volts.append(mean_v(clock, world, 0.2))
        clock.sleep_until(clock.now() + 0.8)
    record = np.array(volts) / SCALE_FACTOR
    raw, _ = found_deg_rth(fitted(record, Sampling.without_gaps(1.0), [WHITE, FLICKER]))
    assert raw / N_DEG_RTH == pytest.approx(2.6, abs=0.1)
    fit = fitted(record, Sampling(1.0, 0.2, 3.4), [WHITE, FLICKER])
    value, u = found_deg_rth(fit)
    assert abs(value - N_DEG_RTH) < 3.5 * u < 0.02
    unstable = fit.terms[FLICKER]
    assert unstable.u is not None
    assert abs(3600.0 * unstable.value - 5.57) < 3.5 * 3600.0 * unstable.u


def test_five_readings_a_second_without_gaps() -> None:
    """What passes at the split falls as 1/tau: with that term N is right, without it several u too large."""
    clock, world = powered(STILL, seed=14)
    fine = np.array([mean_v(clock, world, 0.2) for _ in range(15_000)]) / SCALE_FACTOR
    seconds = block_means(fine, 5)
    value, u = found_deg_rth(fitted(seconds, Sampling.without_gaps(1.0), [FAST, WHITE, FLICKER]))
    assert abs(value - N_DEG_RTH) < 3.5 * u < 0.045
    without, u = found_deg_rth(fitted(fine, Sampling.without_gaps(0.2), [WHITE, FLICKER]))
    assert without - N_DEG_RTH > 10.0 * u
