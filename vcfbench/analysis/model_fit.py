"""Least squares with any model, and the goodness of the fit."""

from collections.abc import Callable

import numpy as np
from msgspec import Struct

from vcfbench.analysis.arrays import Floats
from vcfbench.errors import ConfigError

_DETERMINED = 1e-12
_STEP = 1e-6
"""Of a difference, over the scale of its parameter."""
_STEPS = 4000


class ModelFit(Struct, frozen=True):
    """Parameters, their covariance, and the chi-square of the residuals."""

    parameters: Floats
    covariance: Floats
    """As the uncertainties of the points give it: not scaled by the residuals."""
    chi_square: float
    dof: int


def fit_model(residuals: Callable[[Floats], Floats], start: Floats, what: str) -> ModelFit:
    """Minimise the sum of squares of `residuals`, each already divided by its standard uncertainty.

    Args:
        residuals: from parameters, (parameters,) or (sets, parameters), to residuals, (points,) or (sets, points).
        start: first guess; its magnitudes are the scales of the parameters.
        what: the thing that is fitted, for messages.

    Raises:
        ConfigError: fewer points than parameters, or no minimum with a finite covariance.
    """
    from scipy.optimize import least_squares  # noqa: PLC0415 - SciPy costs more to import than all the rest

    count = residuals(start).size
    if count < start.size:
        raise ConfigError(f"{what}: {count} points do not determine {start.size} parameters")
    scale = np.where(start == 0.0, 1.0, np.abs(start))

    def scaled(parameters: Floats) -> Floats:
        return residuals(parameters * scale)

    def slopes(at: Floats) -> Floats:
        moved = np.diag(_STEP * np.maximum(1.0, np.abs(at)))
        up, down = np.split(scaled(at + np.concatenate([moved, -moved])), 2)
        return np.ascontiguousarray((up - down).T / (2.0 * moved.diagonal()))

    found = least_squares(
        scaled, start / scale, slopes, x_scale="jac", xtol=1e-13, ftol=1e-15, gtol=None, max_nfev=_STEPS
    )
    _, sizes, directions = np.linalg.svd(np.asarray(found.jac), full_matrices=False)
    if not (found.success and sizes[-1] > _DETERMINED * sizes[0]):
        raise ConfigError(f"{what}: the points do not determine the model")
    spread = directions.T / sizes
    covariance = spread @ spread.T * np.outer(scale, scale)
    return ModelFit(found.x * scale, covariance, float(found.fun @ found.fun), count - start.size)


def not_negative(design: Floats, values: Floats) -> Floats:
    """Return the least-squares solution that has no part below zero (Lawson and Hanson 1974, chapter 23)."""
    found, free = np.zeros(design.shape[1]), np.zeros(design.shape[1], dtype=bool)
    no_gain = _DETERMINED * float(np.linalg.norm(values)) * np.linalg.norm(design, axis=0)
    for _ in range(3 * found.size):  # columns that nearly depend on each other may come and go for ever
        gain = design.T @ (values - design @ found)
        gain[free | (gain <= no_gain)] = -np.inf  # rounding is no gain
        if not (gain > 0.0).any():
            break
        free[int(gain.argmax())] = True
        while True:
            tried = np.zeros_like(found)
            tried[free] = np.linalg.lstsq(design[:, free], values, rcond=None)[0]
            out = free & (tried <= 0.0)
            if not out.any():
                break
            share = float(np.min(found[out] / np.maximum(found[out] - tried[out], np.finfo(float).tiny)))
            found = found + share * (tried - found)
            free &= found > _DETERMINED * float(np.abs(found).max())
            found[~free] = 0.0
        found = tried
    return found


def propagated(values: Callable[[Floats], Floats], fit: ModelFit) -> Floats:
    """Return the standard uncertainties of functions of the parameters, by central differences of a tenth of theirs."""
    gradients = derivatives(values, fit.parameters, 0.1 * np.sqrt(np.diag(fit.covariance)))
    return np.sqrt([each @ fit.covariance @ each for each in gradients])


def derivatives(of: Callable[[Floats], Floats | float], at: Floats, steps: Floats) -> Floats:
    """Return the derivatives of values by inputs, (values, inputs), or (inputs,) of one value: central differences.

    An input whose step is 0 counts as a constant.
    """
    moved = np.diag(steps)
    ends = [(of(at + step), of(at - step)) for step in moved]
    return np.stack([(up - down) / (2.0 * size or 1.0) for (up, down), size in zip(ends, steps, strict=True)], axis=-1)
