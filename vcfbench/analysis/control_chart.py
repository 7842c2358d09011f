"""Stability of repeated results of one quantity: recursive residuals, and their tabular CUSUM."""

import numpy as np

from vcfbench.analysis.arrays import Floats


def recursive_residuals(values: Floats, covariance: Floats) -> Floats:
    """Return the distance of each result after the first from its prediction by those before, in units of its u, (n,).

    The prediction is their best mean, and the unit holds its uncertainty, so that a common part cancels. While
    nothing changes they are independent with mean 0 and standard deviation 1 (Brown, Durbin and Evans 1975;
    Hawkins 1987).

    Args:
        values: the results, in order, (n + 1,).
        covariance: theirs, (n + 1, n + 1), in the square of their unit.
    """
    size = np.sqrt(np.diag(covariance))
    unit = size.max() or 1.0
    spared = covariance / unit**2 + 1e-12 * np.eye(values.size)  # without noise of their own two results are one
    white = np.linalg.solve(np.linalg.cholesky(spared), np.column_stack([values / unit, np.ones(values.size)]))
    y, a = white[:, 0], white[:, 1]
    known = np.cumsum(a * a)[:-1]
    mean = np.cumsum(a * y)[:-1] / known
    return np.asarray((y[1:] - a[1:] * mean) / np.sqrt(1.0 + a[1:] ** 2 / known))


def cusum(deviations: Floats, reference: float = 0.5) -> Floats:
    """Return the larger of the upper and the lower cumulative sum after each deviation, both in standard deviations.

    Tabular CUSUM, NIST/SEMATECH e-Handbook 6.3.2.3: S = max(0, S + z - k), and likewise of -z; `reference` is k, half
    of the shift that shall be seen soon.
    """
    sums, found = np.zeros(2), []
    for z in deviations:
        sums = np.maximum(0.0, sums + np.array([z, -z]) - reference)
        found.append(sums.max())
    return np.array(found)
