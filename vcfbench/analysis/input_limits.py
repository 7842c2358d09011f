"""Limits of the input: the dead band, in which the output shows nothing, and where it stops to follow a line."""

import math
from collections.abc import Mapping, Sequence
from typing import Self

import numpy as np
from msgspec import Struct

from vcfbench.analysis.arrays import Floats
from vcfbench.errors import ConfigError

_NEAR = 1.01
"""Ratio of two inputs between which the slope at a limit is taken: nearer, the steps of their source are seen."""
_LEAST = 1e-3
"""Least slope, over the line's, at which an output is taken to leave what the line allows."""


class DeadBand(Struct, frozen=True):
    """Slope beyond a dead band, its half width in the unit of the input, and the uncertainty of that by source."""

    slope: float
    half_width: float
    u: Mapping[str, float]


def fit_dead_band(x: Floats, y: Floats, covariances: Mapping[str, Floats]) -> DeadBand:
    """Fit steps of both signs: generalised least squares of one slope, and an edge of its own on either side.

    Inputs within the edges show nothing, hence say no more, and are left out. Where there is no dead band its half
    width comes out as noise of either sign: it is no less likely to be below 0 than above.

    Args:
        x: steps of the input.
        y: what the output did.
        covariances: of `y`, by source.

    Raises:
        ConfigError: too few steps lie beyond the edges.
    """
    total, seen = np.sum(list(covariances.values()), axis=0), np.ones(x.size, dtype=bool)
    sides = np.stack([x > 0.0, x < 0.0], axis=1).astype(np.float64)
    while True:
        if min(np.unique(x[seen & (sign * x > 0.0)]).size for sign in (1.0, -1.0)) < 2:
            raise ConfigError("fewer than two steps to either side lie beyond the dead band: larger steps are needed")
        terms = np.column_stack([x, -sides])[seen]
        weighted = np.linalg.solve(total[np.ix_(seen, seen)], terms).T
        making = np.linalg.solve(weighted @ terms, weighted)
        slope, plus, minus = (making @ y[seen]).tolist()
        beyond = seen & (np.sign(x) * (x - sides @ np.array([plus, minus]) / slope) > 0.0)
        if (beyond == seen).all():
            break
        seen = beyond
    half = 0.5 * (plus - minus) / slope
    per = np.array([-half, 0.5, -0.5]) / slope @ making
    u = {name: math.sqrt(float(per @ each[np.ix_(seen, seen)] @ per)) for name, each in covariances.items()}
    return DeadBand(slope, half, u)


class Line(Struct, frozen=True):
    """Straight line through small inputs of both signs: output at no input (V), slope, the inputs' distance."""

    zero_v: float
    slope: float
    apart: float

    @classmethod
    def of(cls, inputs: Sequence[float], outputs_v: Sequence[float]) -> Self:
        """Return it by the six windows 0, +, -, -, +, 0."""
        (zero, high, low), (zero_v, high_v, low_v) = (
            [0.5 * (each[first] + each[second]) for first, second in ((0, 5), (1, 4), (2, 3))]
            for each in (inputs, outputs_v)
        )
        slope = (high_v - low_v) / (high - low)
        return cls(zero_v - slope * zero, slope, high - low)

    def lacks(self, at: float, output_v: float) -> float:
        """Return the part of its output that lacks where the input is `at`; negative where there is more."""
        return 1.0 - (output_v - self.zero_v) / (self.slope * at)

    def weights(self, at: float, may_lack: float) -> tuple[float, ...]:
        """Return the weights of its windows in the output at `at`."""
        lever = 0.5 * (1.0 - may_lack) * at / self.apart
        return (0.5, lever, -lever, -lever, lever, 0.5)


class Limit(Struct, frozen=True):
    """Input at which the output lacks more than it may: between two that were taken, with equal chance anywhere.

    `first` is the place of the nearer one that falls short. `rises` is the output's slope from there on over the
    line's. `leaves` is how fast it leaves what the line allows, over the line's slope: an error of the output moves the
    limit by itself over both slopes.
    """

    at: float
    half_width: float
    first: int
    rises: float
    leaves: float


def limit_of(
    line: Line, may_lack: float, inputs: Sequence[float], outputs_v: Sequence[float], of_line: int
) -> Limit | None:
    """Return the limit of inputs of one sign; None where the output followed all of them.

    The first `of_line` inputs are those that the line goes through: where the output curves, one of them lies above it
    and its opposite below, and neither is a limit.
    """
    order = np.argsort(np.abs(inputs))
    short = [int(i) for i in order if i >= of_line and line.lacks(inputs[i], outputs_v[i]) > may_lack]
    if not short:
        return None
    first, last = short[0], next(int(i) for i in order[::-1] if abs(inputs[i]) < abs(inputs[short[0]]))
    beyond = next((each for each in short if abs(inputs[each]) >= _NEAR * abs(inputs[first])), last)
    rise_v, apart = outputs_v[beyond] - outputs_v[first], inputs[beyond] - inputs[first]
    rises = rise_v / apart / line.slope if apart else 0.0
    at, half = 0.5 * (inputs[first] + inputs[last]), 0.5 * abs(inputs[first] - inputs[last])
    return Limit(at, half, first, rises, max(abs(1.0 - may_lack - rises), _LEAST))
