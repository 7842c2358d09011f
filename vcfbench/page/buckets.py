"""Many readings as few points that look the same when they are drawn."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

Floats: TypeAlias = "NDArray[np.float64]"


def drawn(t_s: Floats, value: Floats, most: int) -> tuple[Floats, Floats]:
    """Return at most about `most` of the points, those that an eye would miss: least and largest of each stretch.

    Args:
        t_s: instants, rising.
        value: as many values.
        most: how many points are drawn; half as many stretches, all with as many readings.
    """
    count = t_s.size
    if count <= most:
        return t_s, value
    starts = np.linspace(0, count, most // 2, endpoint=False).astype(np.intp)
    lengths = np.diff(np.append(starts, count))
    least, largest = np.minimum.reduceat(value, starts), np.maximum.reduceat(value, starts)
    middle = t_s[starts + lengths // 2]
    both = np.empty(2 * starts.size)
    both[0::2], both[1::2] = least, largest
    return np.repeat(middle, 2), both
