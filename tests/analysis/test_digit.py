"""Readings of few digits: N is right, or a bound that holds, wherever in its digit the mean stands."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from vcfbench.analysis.allan import Sampling, Term
from vcfbench.analysis.digit import COARSE, digit_of
from vcfbench.procedures.zero.noise import NoiseCoefficient, record_noise

if TYPE_CHECKING:
    from collections.abc import Callable

    from vcfbench.analysis.arrays import Floats

SIZE = 4000
KINDS: dict[str, tuple[float, Callable[[np.random.Generator], Floats]]] = {
    "white": (1.0, lambda r: r.standard_normal(SIZE)),
    "held": (0.5, lambda r: np.repeat(r.standard_normal(SIZE // 4), 4) / 2.0),
    "mean of twenty": (20**-0.5, lambda r: np.convolve(r.standard_normal(SIZE + 19), np.ones(20) / 20.0, "valid")),
    "walk": (1.0, lambda r: r.standard_normal(SIZE) + np.cumsum(0.02 * r.standard_normal(SIZE))),
}
"""Each with N of one, in deg/sqrt(s), and the standard deviation of its readings."""


def walk_of(readings: Floats) -> tuple[float, NoiseCoefficient]:
    digit = digit_of(readings)
    found = record_noise(
        readings,
        Sampling.without_gaps(1.0),
        corrected=False,
        u_bandwidth_hz=0.0,
        meter_deg_s=0.0,
        digit=digit,
    )
    (walk,) = [each for each in found.coefficients if each.words == Term.ANGLE_RANDOM_WALK.value]
    return digit.in_sd(round(found.fitted_from_s)), walk


REST = [pytest.param(kind, sds, marks=pytest.mark.exhaustive) for kind in KINDS for sds in (0.3, 1.0, 1.8, 4.0, 5.7)]


@pytest.mark.parametrize(("kind", "sds"), [("white", 1.8), ("white", 5.7), ("held", 1.0), *REST])
def test_n_of_a_coarse_record_is_right_or_a_bound(kind: str, sds: float) -> None:
    scatter, noise = KINDS[kind]
    step = sds * scatter
    for seed, place in enumerate((0.0, 0.3, 0.5)):
        readings = np.round(noise(np.random.default_rng(seed)) / step + place) * step
        seen, walk = walk_of(readings)
        assert walk.upper_95 > 0.95 * 60.0
        assert (walk.u is None) == (seen > COARSE)
        assert walk.u is not None or sds > 1.0
        if walk.u is not None:
            assert abs(walk.value or 0.0) == pytest.approx(60.0, abs=3.0 * walk.u)


def test_digit_of_a_mean_is_that_of_its_text() -> None:
    readings = np.random.default_rng(1).integers(-9, 9, 3000) / 3.0 * (1.0 + 1e-15 * np.arange(3000))
    assert digit_of(readings).step == pytest.approx(1 / 3)
    assert digit_of(np.ones(100)).step == 0.0
