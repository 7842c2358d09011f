"""Limits of the input: the dead band without response, and the rate from which on the output leaves its line."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Self

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.chopped import CHOPPED
from vcfbench.errors import ConfigError

_PARAMETERS = 3
_DOUBTED = 4.0
"""Chi-square so many of its standard deviations above its mean is held against other models; twice as many is refused.
"""
_BENT = 2e-3
"""Part of an output by which modulator and output stage may leave a line within the steps."""
_NEAR = 1.01
"""Ratio of two inputs between which the slope at a limit is taken: nearer, the steps of their source are seen."""
_STANDS_OUT = 6.0
"""Standard deviations of a window by which two of them have to leave the line differently: four of the difference."""


class DeadBand(Struct, frozen=True):
    """Slope beyond a dead band, its half width in the unit of the input, and the uncertainty of that by source."""

    slope: float
    half_width: float
    u: Mapping[str, float]


class _Fit(Struct, frozen=True):
    """A response to steps that was fitted: the band, and what is left of the outputs, squared over their variance."""

    band: DeadBand
    chi_square: float


def fit_dead_band(x: Floats, y: Floats, covariances: Mapping[str, Floats]) -> DeadBand:
    """Fit steps of both signs: generalised least squares of one slope, and an edge of its own on either side.

    Inputs within the edges show nothing, hence say no more, and are left out. Where there is no dead band its half
    width comes out as noise of either sign: it is no less likely to be below 0 than above. Where the steps do not begin
    within the band, they cross all of it on one side: that is fitted if nothing else describes them.

    Args:
        x: steps of the input.
        y: what the output did.
        covariances: of `y`, by source.

    Raises:
        ConfigError: too few steps lie beyond the edges, or no dead band answers them so.
    """
    found = _from_within(x, y, covariances)
    dof = x.size - _PARAMETERS
    if found.chi_square <= dof + _DOUBTED * math.sqrt(2.0 * dof):
        return found.band
    across = min(_from_outside(x, y, covariances), key=lambda each: each.chi_square, default=found)
    if across.chi_square < found.chi_square - _DOUBTED**2:
        found = across
    if found.chi_square > dof + 2.0 * _DOUBTED * math.sqrt(2.0 * dof):
        raise ConfigError(
            f"the steps do not fit a dead band: the residuals of {x.size} outputs are "
            f"{math.sqrt(found.chi_square / dof):.2g} times their noise"
        )
    return found.band


def _from_within(x: Floats, y: Floats, covariances: Mapping[str, Floats]) -> _Fit:
    """Return the fit of steps that begin within the band."""
    seen = np.ones(x.size, dtype=bool)
    sides = np.stack([x > 0.0, x < 0.0], axis=1).astype(np.float64)
    while True:
        if min(np.unique(x[seen & (sign * x > 0.0)]).size for sign in (1.0, -1.0)) < 2:
            raise ConfigError("fewer than two steps to either side lie beyond the dead band: larger steps are needed")
        terms = np.column_stack([x, -sides]) * seen[:, None]
        found, (slope, plus, minus) = _fitted(terms, y, covariances, seen, (0.0, 0.5, -0.5))
        beyond = seen & (np.sign(x) * (x - sides @ np.array([plus, minus]) / slope) > 0.0)
        if (beyond == seen).all():
            return found
        seen = beyond


def _from_outside(x: Floats, y: Floats, covariances: Mapping[str, Floats]) -> Iterator[_Fit]:
    """Yield the fits of steps that begin beyond the band: those to one side reach it, rest in it, and leave it."""
    for sign in (1.0, -1.0):
        order = np.flatnonzero(sign * x < 0.0)
        order = order[np.argsort(np.abs(x[order]))]
        for reaches in range(1, order.size):
            for leaves in range(reaches, order.size):
                within, after = np.zeros(x.size), np.zeros(x.size)
                within[order[reaches:leaves]], after[order[leaves:]] = -sign, sign
                terms = np.column_stack([x * (within == 0.0), within, after])
                columns = [0, 1, 2] if within.any() else [0, 2]  # a step may end on either side of the band alone
                half = [0.0, 0.0, 0.5] if within.any() else [0.0, 0.5]
                yield _fitted(terms[:, columns], y, covariances, np.ones(x.size, dtype=bool), half)[0]


def _fitted(
    terms: Floats, y: Floats, covariances: Mapping[str, Floats], used: NDArray[np.bool_], half: Sequence[float]
) -> tuple[_Fit, list[float]]:
    """Return a fit, and its coefficients: the slope, and voltages of which `half` make the band's half width."""
    total = np.sum(list(covariances.values()), axis=0)
    weighted = np.linalg.solve(total[np.ix_(used, used)], terms[used]).T
    making = np.linalg.solve(weighted @ terms[used], weighted)
    coefficients = making @ y[used]
    slope = float(coefficients[0])
    width = float(np.dot(half, coefficients)) / slope
    per = (np.array(half) - width * np.eye(len(half))[0]) / slope @ making
    u = {name: math.sqrt(float(per @ each[np.ix_(used, used)] @ per)) for name, each in covariances.items()}
    left = y - terms @ coefficients
    chi_square = float(left @ np.linalg.solve(total + np.diag((_BENT * y) ** 2), left))
    return _Fit(DeadBand(slope, width, u), chi_square), coefficients.tolist()


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

    def weights(self, line: Line, may_lack: float, *, of_input: bool) -> list[float]:
        """Return the weights of the line's windows in the line's output at the limit.

        They move where the output leaves the line; with `of_input` the input there is meant, in outputs of this slope.
        Else an error of the slope is one of the line's output as well: none is left where the output beyond stands.
        """
        lever = 0.0 if of_input else 0.5 * self.at / line.apart
        pairs = zip(CHOPPED, line.weights(self.at, may_lack), strict=True)
        return [way * lever - weight / self.leaves for way, weight in pairs]


def limit_of(
    line: Line,
    may_lack: float,
    inputs: Sequence[float],
    outputs_v: Sequence[float],
    of_line: int,
    *,
    noise_v: float = 0.0,
) -> Limit | None:
    """Return the limit of inputs of one sign; None where the output followed all of them.

    The first `of_line` inputs are those that the line goes through: where the output curves, one of them lies above it
    and its opposite below, and neither is a limit. What falls short before one that follows does so by noise.
    The slope there is that to the nearest input beyond whose output leaves the line by more than noise, of a standard
    deviation of `noise_v`, makes of a difference: of nearer ones it would be noise, and of farther ones less local.
    It leaves the line there at least as fast as it has done on average since no input, where nothing lacks.
    """
    order = np.argsort(np.abs(inputs)).tolist()
    follows = [i < of_line or line.lacks(inputs[i], outputs_v[i]) <= may_lack for i in order]
    kept = len(order) - follows[::-1].index(True)
    short = order[kept:]
    if not short:
        return None
    first, last = short[0], order[kept - 1]
    rises = 0.0
    for each in [each for each in short if abs(inputs[each]) >= _NEAR * abs(inputs[first])] or [last]:
        apart_v = line.slope * (inputs[each] - inputs[first])
        rises = (outputs_v[each] - outputs_v[first]) / apart_v if apart_v else 0.0
        if abs((1.0 - may_lack - rises) * apart_v) > _STANDS_OUT * noise_v:
            break
    at, half = 0.5 * (inputs[first] + inputs[last]), 0.5 * abs(inputs[first] - inputs[last])
    return Limit(at, half, first, rises, max(abs(1.0 - may_lack - rises), may_lack))
