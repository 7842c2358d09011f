from __future__ import annotations

import math

import numpy as np
import pytest

from vcfbench.analysis.allan import Sampling, allan_deviation, bias_stability, spreads_of_means
from vcfbench.errors import ConfigError


def test_every_definition_of_white_noise_on_a_line() -> None:
    """Five readings a second for an hour, sd 1, rising by 1e-3 a second: each within 4 sigma of what it must be."""
    sampling = Sampling.without_gaps(0.2)
    record = np.random.default_rng(1).standard_normal(18_000) + 0.001 * 0.2 * np.arange(18_000)
    found = bias_stability(spreads_of_means(record, sampling), allan_deviation(record, 0.2))
    line = 3.6 / math.sqrt(12.0)
    assert found.sd_1_s == pytest.approx(math.hypot(1.0 / math.sqrt(5.0), line), rel=0.04)
    assert found.sd_10_s == pytest.approx(math.hypot(1.0 / math.sqrt(50.0), line), rel=0.04)
    assert found.sd_100_s == pytest.approx(math.hypot(1.0 / math.sqrt(500.0), line), rel=0.05)
    assert found.sd_10_s_detrended == pytest.approx(1.0 / math.sqrt(50.0), rel=4.0 / math.sqrt(2.0 * 358))
    assert found.peak_to_peak_10_s == pytest.approx(3.6, rel=0.3)
    assert found.allan_minimum_low < found.allan_minimum < found.allan_minimum_high
    assert found.bias_instability_read_off == pytest.approx(found.allan_minimum / 0.66428, rel=1e-5)


def test_what_the_record_does_not_allow_is_none() -> None:
    """A reading every three seconds makes no 10-s mean; fifteen seconds make one of 10 s and none of 100 s."""
    every_three = [1.0, 2.0, 4.0, 3.0, 2.0]
    found = bias_stability(spreads_of_means(every_three, Sampling.without_gaps(3.0)), allan_deviation(every_three, 3.0))
    assert (found.sd_1_s, found.sd_10_s, found.sd_100_s) == (None, None, None)
    short = np.arange(15.0)
    found = bias_stability(spreads_of_means(short, Sampling(1.0, 0.2)), allan_deviation(short, 1.0))
    assert found.sd_1_s == pytest.approx(np.std(short, ddof=1))
    assert (found.sd_10_s, found.peak_to_peak_10_s, found.sd_100_s) == (None, None, None)
    with pytest.raises(ConfigError, match="three readings"):
        spreads_of_means([1.0, 2.0], Sampling.without_gaps(1.0))
