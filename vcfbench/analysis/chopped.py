"""Outputs chopped against drift (zero, plus, minus, minus, plus, zero): their differences and the uncertainty of these.

In such a block a linear drift adds the same to the mean of each pair and cancels in their differences. What is left
beside levels and drift, two combinations a block, is noise: it tells the flicker that the scatter within a window does
not show. Flicker (1/f) noise has no variance, but every difference has: E[(y1 - y2)^2]/2 grows with the logarithm of
the time between, with one coefficient, which is found from those combinations.
"""

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike

from vcfbench.analysis.arrays import Floats
from vcfbench.errors import ConfigError

CHOPPED = (0, 1, -1, -1, 1, 0)
"""The order of a block: signs of the level of each window."""

_AT = np.array(CHOPPED)
_LEVELS: Floats = np.stack([_AT == 0, _AT == 1, _AT == -1], axis=1).astype(np.float64)
DIFFERENCES: Floats = np.array([[-0.5 if s == 0 else 0.5 if s == sign else 0.0 for s in CHOPPED] for sign in (1, -1)])
"""Plus less zero and minus less zero, of the six windows."""
_NOT_CONTRADICTED = 1.645
"""Standard uncertainties above an estimate that 95 % of the true values lie below."""


class Block(Struct, frozen=True):
    """The mean outputs (V) of six windows in the order of :data:`CHOPPED`."""

    outputs_v: tuple[float, ...]

    def __post_init__(self) -> None:
        """Refuse another number of windows."""
        if len(self.outputs_v) != len(CHOPPED):
            raise ConfigError(f"a chopped block has {len(CHOPPED)} windows, not {len(self.outputs_v)}")

    @property
    def zero_v(self) -> float:
        """Mean of the two zeros, V."""
        return 0.5 * (self.outputs_v[0] + self.outputs_v[5])

    @property
    def differences_v(self) -> tuple[float, float]:
        """Plus less zero and minus less zero, V."""
        plus, minus = DIFFERENCES @ np.array(self.outputs_v)
        return float(plus), float(minus)


class BlockNoise(Struct, frozen=True):
    """The noise of the windows of a run; independent of the fit of a line.

    `white_v` is the standard deviation of one window's mean that the scatter of its readings explains. `flicker_v2` is
    the coefficient h of the one-sided density h/f of the output's flicker, V^2; the Allan deviation's floor is
    sqrt(2 ln2 h). `covariance_v2` is that of the two differences of one block, `dof` its effective degrees of freedom.
    """

    white_v: float
    flicker_v2: float
    u_flicker_v2: float
    """Its standard uncertainty: a few blocks do not see a flicker below the white noise, and give 0 as often as not."""
    covariance_v2: tuple[tuple[float, float], tuple[float, float]]
    dof: float


def block_noise(
    blocks: Sequence[Block],
    std_v: float,
    readings: int,
    window_s: float,
    slot_s: float,
    *,
    known_flicker_v2: float = 0.0,
    known_dof: float = math.inf,
) -> BlockNoise:
    """Return the noise of a run.

    A few blocks show a flicker of 0 as often as not: one that is known counts where they show less, up to what they
    do not contradict (one-sided, 95 %).

    Args:
        blocks: all of it.
        std_v: standard deviation of one reading within its window, V, pooled.
        readings: of each window.
        window_s: length of a window, s.
        slot_s: from the beginning of one window to that of the next, s, about.
        known_flicker_v2: coefficient h of the flicker as it is known apart from the blocks, V^2.
        known_dof: its degrees of freedom.

    Raises:
        ConfigError: no block, or windows that tell no scatter.
    """
    if not blocks or readings < 2:
        raise ConfigError("the noise needs a block at least, and two readings a window")
    white = std_v**2 / readings
    flicker = _flicker(window_s, slot_s)
    # An orthonormal basis of the space free of levels and linear drift, a column each
    drift = np.arange(len(CHOPPED), dtype=np.float64)
    basis = np.linalg.svd(np.column_stack([_LEVELS, drift]))[0]
    left = np.asarray(basis[:, _LEVELS.shape[1] + 1 :], dtype=np.float64)
    seen = np.array([left.T @ np.array(block.outputs_v) for block in blocks])
    per_degree = float((seen**2).mean())
    unit = float(np.trace(left.T @ flicker @ left)) / left.shape[1]
    coefficient = max(0.0, (per_degree - white) / unit)  # a density is not negative
    of_white, of_flicker = DIFFERENCES @ DIFFERENCES.T, DIFFERENCES @ flicker @ DIFFERENCES.T
    within, between = len(blocks) * len(CHOPPED) * (readings - 1), seen.size
    most = max(per_degree, white)
    u_flicker = math.sqrt(2.0 / between) * most / unit
    counted = max(coefficient, min(known_flicker_v2, coefficient + _NOT_CONTRADICTED * u_flicker))
    covariance = white * of_white + counted * of_flicker
    if counted > coefficient:
        share, by_flicker = 0.0, (float(of_flicker[0, 0]) * counted) ** 2 / known_dof
    else:
        share = float(of_flicker[0, 0]) / unit
        by_flicker = (share * most) ** 2 / between
    spread = 2.0 * ((float(of_white[0, 0]) - share) * white) ** 2 / within + 2.0 * by_flicker
    return BlockNoise(
        math.sqrt(white),
        coefficient,
        u_flicker,
        ((float(covariance[0, 0]), float(covariance[0, 1])), (float(covariance[1, 0]), float(covariance[1, 1]))),
        2.0 * float(covariance[0, 0]) ** 2 / spread if spread > 0.0 else math.inf,
    )


def _flicker(window_s: float, slot_s: float) -> Floats:
    """Return the generalised covariance of window means under the density 1/f: minus the mean logarithm of the lag."""
    apart = slot_s * np.abs(np.subtract.outer(np.arange(len(CHOPPED)), np.arange(len(CHOPPED))))

    def twice(lag: Floats) -> Floats:  # the second integral of the logarithm
        size = np.maximum(np.abs(lag), 1e-300)
        return np.asarray(lag**2 * (0.5 * np.log(size) - 0.75))

    means = (twice(apart + window_s) + twice(apart - window_s) - 2.0 * twice(apart)) / window_s**2
    return np.asarray(-means)


def polynomial_through_zero(
    x: ArrayLike, y: ArrayLike, covariance: ArrayLike, order: int
) -> tuple[Floats, Floats, Floats]:
    """Fit ``c1 x + c2 x^2 + ...`` by generalised least squares.

    Returns the coefficients from c1 on, their covariance, and the matrix that makes them of `y`.

    Raises:
        ConfigError: the points do not determine it.
    """
    at, of = np.asarray(x, dtype=np.float64), np.asarray(covariance, dtype=np.float64)
    scale = float(np.abs(at).max())
    powers = np.vander(at / scale, order + 1, increasing=True)[:, 1:]
    try:
        weighted = powers.T @ np.linalg.inv(of)
        found = np.linalg.inv(weighted @ powers)
    except np.linalg.LinAlgError as error:
        raise ConfigError(f"{at.size} points do not determine a polynomial of order {order}") from error
    units = scale ** np.arange(1, order + 1)
    making = (found @ weighted) / units[:, None]
    return making @ np.asarray(y, dtype=np.float64), found / np.outer(units, units), making
