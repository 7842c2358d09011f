"""Lock-in of a sine in a record, against polynomials, computed noise and closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vcfbench.analysis.modulation import FLICKER_FLOOR, demodulated, flicker_share, static_response
from vcfbench.analysis.rate_band import split_response
from vcfbench.errors import ConfigError

COUNT, APERTURE_S, FREQUENCY_HZ = 500, 0.2, 0.25


def averaged(amplitude: float, order: int, phase: float) -> np.ndarray:
    """Return readings of a cosine, each the mean over its aperture."""
    steps = np.arange(COUNT)
    turns = order * FREQUENCY_HZ * APERTURE_S
    return amplitude * np.sinc(turns) * np.cos(2.0 * math.pi * turns * steps + order * phase)


@given(
    phase=st.floats(-3.0, 3.0), second=st.floats(-0.1, 0.1), third=st.floats(-0.1, 0.1), trend=st.floats(-1e-3, 1e-3)
)
def test_a_curve_of_third_order_comes_apart(phase: float, second: float, third: float, trend: float) -> None:
    """X cos t with 1 + s2 x^2 + s3 x^3: harmonics s2/2 and s3/4, mean s2/2, fundamental 1 + 3/4 s3."""
    readings = 0.3 + second / 2.0 + averaged(1.0 + 0.75 * third, 1, phase)
    readings = readings + averaged(second / 2.0, 2, phase) + averaged(third / 4.0, 3, phase)
    readings = readings + trend * (np.arange(COUNT) / COUNT - 0.5)
    found = demodulated(readings, APERTURE_S, FREQUENCY_HZ, 5)
    assert found.mean == pytest.approx(0.3 + second / 2.0, abs=1e-9)
    assert math.remainder(found.phase_rad - phase, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-6)
    assert found.phasors[0].real - 3.0 * found.phasors[2].real == pytest.approx(1.0, abs=1e-6)
    assert found.phasors[1].real == pytest.approx(second / 2.0, abs=1e-6)
    assert found.in_phase == pytest.approx([found.phasors[0].real] * 5, abs=1e-6)


def test_the_spacing_that_a_meter_really_has_is_found() -> None:
    """A tenth of a percent would turn the phase by half a radian over the record, and cost a percent."""
    steps = 1.001 * np.arange(COUNT)
    readings = np.cos(2.0 * math.pi * FREQUENCY_HZ * APERTURE_S * steps) * np.sinc(FREQUENCY_HZ * APERTURE_S)
    assert demodulated(readings, APERTURE_S, FREQUENCY_HZ, 5).phasors[0].real == pytest.approx(1.0, abs=1e-9)


@pytest.mark.exhaustive
def test_noise_about_sine_is_scatter_of_amplitude() -> None:
    random = np.random.default_rng(4)
    sine = averaged(1.0, 1, 0.4)
    found = [demodulated(sine + 1e-3 * random.standard_normal(COUNT), APERTURE_S, FREQUENCY_HZ, 5) for _ in range(150)]
    whole, parts = [each.phasors[0].real for each in found], [x for each in found for x in each.in_phase]
    for values, readings in ((whole, COUNT), (parts, COUNT // 5)):
        expected = math.sqrt(np.mean([each.variance(1, readings) for each in found]))
        assert expected == pytest.approx(1e-3 * math.sqrt(2.0 / readings), rel=0.05)
        assert np.std(values) == pytest.approx(expected, rel=4.0 / math.sqrt(2.0 * len(values)))
    assert np.std([each.phasors[2].real for each in found]) == pytest.approx(
        math.sqrt(np.mean([each.variance(3, COUNT) for each in found])), rel=0.25
    )


def test_another_frequency_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"0\.25 Hz was put in, the record shows one of 0\.253"):
        demodulated(np.cos(2.0 * math.pi * 0.253 * APERTURE_S * np.arange(COUNT)), APERTURE_S, FREQUENCY_HZ, 5)
    with pytest.raises(ConfigError, match="at least 8 are needed"):
        demodulated(np.cos(0.05 * np.arange(COUNT)), APERTURE_S, 0.05 / (2.0 * math.pi * APERTURE_S), 1)


def test_response_far_below_splits_is_response_of_modes() -> None:
    """`split_response` has both side bands, damping and the drive frequency; the share is what it makes of 0.8."""
    drive, split, far = 3488.9, 24.8, 146.9
    stiff = [1.0 / ((drive - each) ** 2 - drive**2) for each in (split, far)]
    share = 0.8 * stiff[1] / (stiff[0] + 0.8 * stiff[1])
    for hz in (0.1, 0.25, 1.0, 2.0):
        [exact] = split_response(hz, drive, np.array([split, 1224.0, 0.8, far, 0.0]))
        assert static_response(hz, split, far, share) - 1.0 == pytest.approx(exact - 1.0, rel=0.02)
    with pytest.raises(ConfigError, match="not far below"):
        static_response(9.0, split, far, share)


def test_flicker_between_neighbours_is_its_allan_variance() -> None:
    assert flicker_share([0.0, 100.0], 100.0, [1.0, -1.0]) == pytest.approx(2.0 * FLICKER_FLOOR)
    assert flicker_share([0.0, 7.0], 7.0, [0.5, -0.5]) == pytest.approx(0.5 * FLICKER_FLOOR)
