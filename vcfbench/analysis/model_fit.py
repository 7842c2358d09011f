"""Least squares with a model of one's own, and what the fit is worth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from vcfbench.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

Floats: TypeAlias = "NDArray[np.float64]"


@dataclass(frozen=True, slots=True)
class ModelFit:
    """Parameters, their covariance, and what is left."""

    parameters: Floats
    covariance: Floats
    """As the uncertainties of the points give it: not scaled by the residuals."""
    chi_square: float
    dof: int


def fit_model(residuals: Callable[[Floats], Floats], start: Floats, what: str) -> ModelFit:
    """Minimise the sum of squares of `residuals`, each already divided by its standard uncertainty.

    Args:
        residuals: from the parameters to the residuals.
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

    solved = least_squares(scaled, start / scale, method="lm", xtol=1e-14, ftol=1e-14, max_nfev=4000)
    _, sizes, directions = np.linalg.svd(np.asarray(solved.jac), full_matrices=False)
    if not solved.success or not sizes[-1] > 1e-12 * sizes[0]:
        raise ConfigError(f"{what}: the points do not determine the model")
    spread = directions.T / sizes
    covariance = spread @ spread.T * np.outer(scale, scale)
    return ModelFit(solved.x * scale, covariance, float(2.0 * solved.cost), count - start.size)


def propagated(value: Callable[[Floats], float], fit: ModelFit) -> float:
    """Return the standard uncertainty of a function of the parameters, by central differences of a tenth of theirs."""
    gradient = np.zeros(fit.parameters.size)
    for place, u in enumerate(np.sqrt(np.diag(fit.covariance))):
        step = np.zeros_like(gradient)
        step[place] = 0.1 * u
        if u > 0.0:
            gradient[place] = (value(fit.parameters + step) - value(fit.parameters - step)) / (0.2 * u)
    return float(np.sqrt(gradient @ fit.covariance @ gradient))
