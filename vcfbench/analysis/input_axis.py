"""The input axis of a gyroscope by its sensitivities to rates about three axes."""

import math
from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np

from vcfbench.analysis.arrays import Floats

_OUTSIDE: Final = 0.05
_PARALLEL: Final = 3.0
"""Standard uncertainties up to which an angle may be that of parallel axes."""


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
        tangent = axis[other] / axis[along]
        by[other], by[along] = 1.0 / axis[along], -tangent / axis[along]
        yield other, float(np.arctan(tangent)), by / (1.0 + tangent**2)  # d arctan t = dt / (1 + t^2)


class Angle(NamedTuple):
    """Angle of two input axes, rad, from the nearest of 0, 90 and 180 degrees, and its change by each part of both.

    `words` say from which. Of axes that may be parallel the angle is noise, and only `below` holds with 95 %.
    """

    words: str
    rad: float
    by_one: Floats
    by_two: Floats
    below: float | None = None


def angle_of(one: Floats, two: Floats, covariance: Floats, dof: float = math.inf) -> Angle:
    """Return the angle of two directions; `covariance`, rad^2, with `dof`, is that of their difference.

    cos a = one two changes by -sin a da, so the angle changes by (cos a one - two) / sin a for each part of `one`.
    Across both directions the difference is of two parts: 95 % of a circle are within sqrt(2 F(2, dof)) times its u.
    """
    cosine, sine = float(one @ two), float(np.linalg.norm(np.cross(one, two)))
    over = 1.0 / sine if sine else 0.0
    by_one, by_two, angle = over * (cosine * one - two), over * (cosine * two - one), math.atan2(sine, cosine)
    if abs(cosine) <= math.sqrt(0.5):
        return Angle("above 90 deg", angle - math.pi / 2.0, by_one, by_two)
    words, rad, sign = ("apart", angle, 1.0) if cosine > 0.0 else ("from opposite", math.pi - angle, -1.0)
    across = np.eye(3) - np.outer(one, one)
    u = math.sqrt(max(float(np.linalg.eigvalsh(across @ covariance @ across)[-1]), 0.0))
    factor = math.sqrt(-2.0 * math.log(_OUTSIDE) if math.isinf(dof) else dof * (_OUTSIDE ** (-2.0 / dof) - 1.0))
    return Angle(words, rad, sign * by_one, sign * by_two, rad + factor * u if rad <= _PARALLEL * u else None)
