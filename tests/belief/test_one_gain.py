"""Gains of a response that were not all measured by one gain are refused; noise, and a form that lacks, are not."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from vcfbench.analysis.model_fit import derivatives
from vcfbench.analysis.rate_band import RateBand, split_response
from vcfbench.belief.one_gain import require_one_gain
from vcfbench.errors import MeasurementError

DRIVE_HZ, U = 3490.0, 2e-4
SHAPE = np.array([24.8, 1224.0, 1.9, 0.15, 147.0, 0.01])
FAR = np.array([0.3, 1.0, 2.0, 4.5, 6.5, 9.0, 12.0, 16.0, 20.0, 25.0, 31.0, 38.0, 48.0, 60.0])
IN_TIME = np.concatenate([FAR, 24.8 * np.geomspace(0.5, 1.65, 21)])
Volts = NDArray[np.float64]


def log_gain(at: Volts) -> Volts:
    return np.asarray(np.log(at[2] * split_response(IN_TIME, DRIVE_HZ, np.delete(at, 2))))


FREE = derivatives(log_gain, SHAPE, 1e-4 * np.abs(SHAPE))


def swept(moved: Volts, seed: int) -> None:
    """Look at a sweep whose gains are moved, in the order of time; a fit leaves what its parameters do not explain."""
    residual = moved + U * np.random.default_rng(seed).standard_normal(IN_TIME.size)
    residual -= FREE @ np.linalg.lstsq(FREE, residual, rcond=None)[0]
    order, none = np.argsort(IN_TIME), (0.0, 0.0)
    gain = np.exp(log_gain(SHAPE))[order]
    chi_square, dof = float(np.square(residual / U).sum()), IN_TIME.size - FREE.shape[1]
    band = RateBand(
        *(none, none, 1.9, none, none, none, none, none),
        *(SHAPE, IN_TIME[order], gain, U * gain, residual[order], chi_square, dof, 100.0),
    )
    require_one_gain(band, DRIVE_HZ, order.astype(float), 1e-5)


@pytest.mark.parametrize(("lacks", "seeds"), [(0.0, 60), (5.0, 20)])
def test_sweeps_of_one_gain_are_believed(lacks: float, seeds: int) -> None:
    """Also where the closed form lacks something of every gain that is larger than their noise."""
    for seed in range(seeds):
        swept(lacks * U * np.random.default_rng(1000 + seed).standard_normal(IN_TIME.size), seed)


@pytest.mark.parametrize("begin", [10, 14, 20, 26])
@pytest.mark.parametrize("size", [3e-3, -3e-3])
def test_gain_that_steps_between_two_gains_is_refused(begin: int, size: float) -> None:
    with pytest.raises(MeasurementError, match=r"the gain steps by"):
        swept(size * (np.arange(IN_TIME.size) >= begin), begin)


def test_gain_that_creeps_is_refused() -> None:
    with pytest.raises(MeasurementError, match=r"the gain (creeps|steps) by"):
        swept(np.linspace(0.0, 6e-3, IN_TIME.size), 3)
