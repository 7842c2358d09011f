"""The input axis of a gyroscope by its sensitivities to rates about three axes."""

from collections.abc import Iterator

import numpy as np

from vcfbench.analysis.arrays import Floats


def direction(sensitivity: Floats, covariance: Floats) -> tuple[float, Floats, Floats]:
    """Return the length, with the sign of the largest component, and direction and covariance over it."""
    largest = sensitivity[np.abs(sensitivity).argmax()]
    size = float(np.copysign(np.linalg.norm(sensitivity), largest))
    return size, sensitivity / size, covariance / size**2


def tilts(axis: Floats) -> Iterator[tuple[int, float, Floats]]:
    """Yield for each axis across the input axis its number, the angle towards it, rad, and the change by each part."""
    along = int(np.abs(axis).argmax())
    for other in (place for place in range(3) if place != along):
        by = np.zeros(3)
        by[other], by[along] = 1.0 / axis[along], -axis[other] / axis[along] ** 2
        yield other, float(np.arctan(axis[other] / axis[along])), by


def beyond_right_angle(one: Floats, two: Floats) -> tuple[float, Floats, Floats]:
    """Return the angle of two directions beyond 90 degrees, rad, and its change by each part of both."""
    cosine = float(one @ two)
    return -float(np.arcsin(cosine)), two - cosine * one, one - cosine * two
