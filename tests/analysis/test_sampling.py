from __future__ import annotations

import math

import numpy as np
import pytest

from tests.analysis.noise import OVERSAMPLED
from vcfbench.analysis.allan import Sampling, Term, allan_deviation, block_means, deviation_factor
from vcfbench.errors import ConfigError

ONE_A_SECOND = Sampling(1.0, 0.2)


def test_readings_with_dead_time_see_too_much_white_noise() -> None:
    """Root five of white noise; 2.6 times with the 3.4 Hz that this gyroscope's force noise has after 0.2 s."""
    assert deviation_factor(ONE_A_SECOND, Term.ANGLE_RANDOM_WALK) == pytest.approx(math.sqrt(5.0))
    assert deviation_factor(Sampling(1.0, 0.2, 3.4), Term.ANGLE_RANDOM_WALK) == pytest.approx(2.6, abs=0.01)
    assert deviation_factor(ONE_A_SECOND, Term.ANGLE_RANDOM_WALK, 400) == pytest.approx(math.sqrt(5.0))


@pytest.mark.parametrize("ratio", [1.25, 2.0, 5.0, 50.0])
def test_bias_function_of_barnes(ratio: float) -> None:
    """B2 for two samples (NBS Technical Note 375), of flicker and of random walk; the latter per interval."""
    sampling = Sampling(ratio, 1.0)
    b2 = (
        -2.0 * ratio**2 * math.log(ratio)
        + (ratio + 1.0) ** 2 * math.log(ratio + 1.0)
        + (ratio - 1.0) ** 2 * math.log(ratio - 1.0)
    ) / (4.0 * math.log(2.0))
    assert deviation_factor(sampling, Term.BIAS_INSTABILITY) ** 2 == pytest.approx(b2, rel=1e-9)
    assert deviation_factor(sampling, Term.RATE_RANDOM_WALK) ** 2 == pytest.approx((3.0 - 1.0 / ratio) / 2.0, rel=1e-9)


@pytest.mark.parametrize("noise", [Term.BIAS_INSTABILITY, Term.RATE_RANDOM_WALK])
@pytest.mark.parametrize("factor", [1, 3, 30])
def test_against_the_variance_of_the_phases_themselves(noise: Term, factor: int) -> None:
    """Every reading as a difference of two phases, all of them paired: no lag is summed in closed form."""
    aperture, times, weights = 0.3, [], []
    for place in range(2 * factor):
        share = (1.0 if place >= factor else -1.0) / (factor * aperture)
        times += [place + aperture, float(place)]
        weights += [share, -share]
    apart = np.abs(np.subtract.outer(times, times))
    if noise is Term.BIAS_INSTABILITY:
        phases = apart**2 * np.log(np.maximum(apart, 1e-300)) / (2.0 * math.pi)
        gapless = 2.0 * math.log(2.0) / math.pi
    else:
        phases, gapless = apart**3 / 12.0, factor / 3.0
    variance = float(np.array(weights) @ phases @ np.array(weights)) / 2.0
    assert deviation_factor(Sampling(1.0, aperture), noise, factor) ** 2 == pytest.approx(variance / gapless, rel=1e-9)


@pytest.mark.parametrize("noise", [Term.BIAS_INSTABILITY, Term.RATE_RANDOM_WALK])
def test_factors_beyond_the_summed_ones_go_on_smoothly_to_one(noise: Term) -> None:
    below, at, above, far = (deviation_factor(ONE_A_SECOND, noise, m) - 1.0 for m in (512, 1024, 2048, 10**7))
    assert below > at > above > far >= 0.0
    assert above / at == pytest.approx(at / below, rel=0.1)  # a half, or a quarter


def test_white_noise_read_with_dead_time_and_without() -> None:
    """Eight values of white noise a second: one of them alone, and the mean of all; 4 sigma of 1e5 readings."""
    white = np.random.default_rng(5).standard_normal(OVERSAMPLED * 100_000)
    (gapless,) = allan_deviation(block_means(white, OVERSAMPLED), 1.0, [4])
    (gapped,) = allan_deviation(white[::OVERSAMPLED], 1.0, [4])
    expected = deviation_factor(Sampling(1.0, 1.0 / OVERSAMPLED), Term.ANGLE_RANDOM_WALK)
    assert gapped.deviation / gapless.deviation == pytest.approx(expected, rel=4 * 0.006)


@pytest.mark.parametrize("noise", list(Term))
def test_without_gaps_nothing_is_corrected(noise: Term) -> None:
    assert deviation_factor(Sampling.without_gaps(0.2), noise, 7) == 1.0


def test_quantised_readings_with_dead_time_are_white() -> None:
    """Both ends of every reading are new: 2 Q^2 / aperture^2 each, instead of 3 Q^2 / tau^2."""
    for factor in (1, 10):
        gapless = 3.0 / factor**2
        assert deviation_factor(ONE_A_SECOND, Term.QUANTISATION, factor) ** 2 * gapless == pytest.approx(
            2.0 / 0.2**2 / factor
        )


def test_blocks() -> None:
    assert block_means([1.0, 3.0, 5.0, 7.0, 100.0], 2).tolist() == [2.0, 6.0]
    with pytest.raises(ConfigError, match="do not fill"):
        block_means([1.0], 2)


@pytest.mark.parametrize(
    ("interval", "aperture", "bandwidth"), [(1.0, 1.1, None), (1.0, 0.0, None), (1.0, 1.0, 3.4), (1.0, 0.2, -1.0)]
)
def test_what_cannot_be_is_refused(interval: float, aperture: float, bandwidth: float | None) -> None:
    with pytest.raises(ConfigError, match=r"aperture|bandwidth"):
        Sampling(interval, aperture, bandwidth)


def test_a_cluster_has_a_reading() -> None:
    with pytest.raises(ConfigError, match="at least one"):
        deviation_factor(ONE_A_SECOND, Term.BIAS_INSTABILITY, 0)
