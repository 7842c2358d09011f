"""Slopes of one device's runs over the same rates, whichever rates each run visited: one curve that all share.

The outputs of run i are b_i + g_i (rate + h(rate)): Legendre polynomials of second to ninth order, and |rate| less its
parts in lower orders, since asymmetry is a figure of gyroscopes. Second and third order and |rate| may be anything of
the class, the others are as much smaller than those found as an output stage's are, by an unknown factor. Levels may
scatter by more than their readings do, as real ones did by five times and more, and with a chance of one in ten the
curve has changed between runs. The answer is the mean over all of these, each by its likelihood.
"""

import math
from collections.abc import Sequence
from itertools import product
from typing import Final

import numpy as np
from msgspec import Struct

from vcfbench.analysis.arrays import Floats

_ORDERS: Final = np.arange(2, 10)
_SMALLER: Final = (2.0 / _ORDERS) ** 2
_CLASS_PPM: Final = 3000.0
"""Non-linearity of the class, of the span: the curve is sought within it."""
_LEAST_DEG_S: Final = 1e-4
_FACTORS: Final = (0.03, 0.1, 0.3, 1.0)
"""Fourth and higher orders, in parts of what second and third order were found to be."""
_CHANGED: Final = ((0.0, 0.9), (0.3, 0.1))
"""Change of a curve in parts of what it was found to be, and the chance of that."""
_SCATTER: Final = ((0.0, 0.85), (2.0, 0.05), (5.0, 0.05), (15.0, 0.05))
"""Scatter of a level beyond its readings', in parts of it, and the chance of that."""


class Windows(Struct, frozen=True):
    """The windows of one run: rates and outputs, (n,), and the covariance of the outputs' noise, (n, n).

    Outputs are over the slope of the run's own line, so that all of it is in deg/s and that slope is 1.

    `white_deg_s` is the scatter of a window's mean by its readings alone.
    """

    rate_deg_s: Floats
    output_deg_s: Floats
    covariance: Floats
    white_deg_s: float

    def at(self, rates_deg_s: Sequence[float], within: float, within_deg_s: float) -> "Windows":
        """Return the means of the windows at each of these rates, `within` relative, or `within_deg_s`."""
        at = np.isclose(self.rate_deg_s, np.array(rates_deg_s)[:, None], within, within_deg_s)
        mean = at / at.sum(axis=1, keepdims=True)
        rate, output = mean @ self.rate_deg_s, mean @ self.output_deg_s
        return Windows(rate, output, mean @ self.covariance @ mean.T, self.white_deg_s)

    @property
    def slope(self) -> tuple[float, float]:
        """Slope of the least-squares line, and its standard uncertainty by the noise."""
        weights = _slope_weights(self.rate_deg_s)
        return float(weights @ self.output_deg_s), math.sqrt(float(weights @ self.covariance @ weights))


class Slopes(Struct, frozen=True):
    """Slopes of the runs over the same rates, (n,), their covariance, (n, n), and the chance that the curve is one."""

    values: Floats
    covariance: Floats
    same_curve: float


def slopes_over(rates_deg_s: Sequence[float], runs: Sequence[Windows]) -> Slopes:
    """Return the slope of each run's least-squares line over `rates_deg_s`; in every run but one the curve may change.

    It takes 4 ms for two runs of 17 rates.
    """
    standard = np.array(rates_deg_s, dtype=float)
    reach = float(max(np.abs(standard).max(), *(np.abs(run.rate_deg_s).max() for run in runs)))
    largest = 2e-6 * _CLASS_PPM * reach
    of_curve = _slope_weights(standard) @ _basis(standard / reach)
    found: list[tuple[Floats, Floats, float, bool]] = []
    for scatter, chance in _SCATTER:
        noise = [run.covariance + (scatter * run.white_deg_s) ** 2 * np.eye(run.rate_deg_s.size) for run in runs]
        factors = [np.asarray(np.linalg.cholesky(each)) for each in noise]
        given = -sum(float(np.log(np.diag(each)).sum()) for each in factors) + math.log(chance)
        alike, changing = (_Normal.of(runs, factors, reach, changing=changing) for changing in (False, True))
        coefficients, covariance, _ = alike.given(_widths(0.3 * largest, largest))
        at = slice(2 * len(runs), 2 * len(runs) + 2)
        size = math.sqrt(float(np.mean(coefficients[at] ** 2 + np.diag(covariance)[at])))
        size = min(size, largest)
        for factor, (change, of_change) in product(_FACTORS, _CHANGED):
            widths = _widths(max(factor * size, _LEAST_DEG_S), largest)
            if change:
                moved = np.append(np.where(_ORDERS <= 3, 1.0, _SMALLER), 0.5)
                own = np.maximum(change * size * moved, 1e-9)
                widths = np.concatenate([widths, np.tile(own, len(runs) - 1)])
            coefficients, covariance, fits = (changing if change else alike).given(widths)
            slopes = np.zeros((len(runs), coefficients.size))
            for place in range(len(runs)):
                slopes[place, 2 * place + 1] = 1.0 / reach
                slopes[place, 2 * len(runs) : 2 * len(runs) + of_curve.size] = of_curve
                if change and place:
                    begin = 2 * len(runs) + place * of_curve.size
                    slopes[place, begin : begin + of_curve.size] = of_curve
            values, variances = slopes @ coefficients, slopes @ covariance @ slopes.T
            found.append((values, variances, given + fits + math.log(of_change), not change))
    weights = np.exp(np.array([each[2] for each in found]) - max(each[2] for each in found))
    weights /= weights.sum()
    mean = np.asarray(sum(w * each[0] for w, each in zip(weights, found, strict=True)))
    spread = [each[1] + np.outer(each[0] - mean, each[0] - mean) for each in found]
    covariance = np.asarray(sum(w * each for w, each in zip(weights, spread, strict=True)))
    return Slopes(mean, covariance, float(sum(w for w, each in zip(weights, found, strict=True) if each[3])))


class _Normal(Struct, frozen=True):
    """Normal equations of the runs: offset and slope of each, the common curve, its changes in all others."""

    matrix: Floats
    vector: Floats
    squares: float
    free: int
    """Number of offsets and slopes, which may be anything."""

    @classmethod
    def of(cls, runs: Sequence[Windows], factors: Sequence[Floats], reach: float, *, changing: bool) -> "_Normal":
        free, terms = 2 * len(runs), _ORDERS.size + 1
        size = free + terms * (len(runs) if changing else 1)
        rows, outputs = [], []
        for place, (run, factor) in enumerate(zip(runs, factors, strict=True)):
            curve = _basis(run.rate_deg_s / reach)
            design = np.zeros((run.rate_deg_s.size, size))
            design[:, 2 * place], design[:, 2 * place + 1] = 1.0, run.rate_deg_s / reach
            design[:, free : free + terms] = curve
            if changing and place:
                design[:, free + place * terms : free + (place + 1) * terms] = curve
            rows.append(np.linalg.solve(factor, design))
            outputs.append(np.linalg.solve(factor, run.output_deg_s))
        matrix, output = np.vstack(rows), np.concatenate(outputs)
        return cls(matrix.T @ matrix, matrix.T @ output, float(output @ output), free)

    def given(self, widths: Floats) -> tuple[Floats, Floats, float]:
        """Return coefficients, their covariance and the log likelihood where the curve's have these widths about 0."""
        known = np.concatenate([np.zeros(self.free), 1.0 / widths**2])
        information = self.matrix + np.diag(known)
        covariance = np.asarray(np.linalg.inv(information))
        found = covariance @ self.vector
        determinant = float(np.linalg.slogdet(information)[1]) + 2.0 * float(np.log(widths).sum())
        return found, covariance, -0.5 * (self.squares - float(found @ self.vector) + determinant)


def _widths(higher: float, largest: float) -> Floats:
    return np.append(np.where(_ORDERS <= 3, largest, higher * _SMALLER), largest)


def _basis(x: Floats) -> Floats:
    """Return the terms of the curve at `x` within -1 to 1, (n, 9)."""
    legendre = np.polynomial.legendre.legvander(x, int(_ORDERS[-1]))
    return np.column_stack([legendre[:, 2:], np.abs(x) - 0.5 - 0.625 * legendre[:, 2]])


def _slope_weights(rates: Floats) -> Floats:
    off = rates - rates.mean()
    return np.asarray(off / float(off @ off))
