"""So many values that a picture cannot show each: the least and the greatest of each of its columns stand for them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["COLUMNS", "thinned"]

COLUMNS: Final = 800
"""About as many as a drawing is wide in points of a screen: what lies closer shows as one line upright."""

_FEW: Final = 4 * COLUMNS
"""So many values are drawn one by one."""


def thinned(x: Sequence[float], y: Sequence[float]) -> tuple[list[float], list[float]] | None:
    """Return least and greatest `y` of each of `COLUMNS` equal columns along `x`, in their order; None for few values.

    Extremes stay where they are, so that no spike is lost; an empty column gives nothing. Values keep their order only
    where `x` does not fall; where it does, they are none of a record and are drawn one by one.
    """
    if len(x) <= _FEW:
        return None
    import numpy as np  # noqa: PLC0415 - it is needed for long records alone

    along, values = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    if along[-1] <= along[0] or np.any(np.diff(along) < 0.0):
        return None
    columns = np.minimum((along - along[0]) * (COLUMNS / (along[-1] - along[0])), COLUMNS - 1).astype(np.intp)
    firsts = np.flatnonzero(np.diff(columns, prepend=-1))
    sorted_ = np.lexsort((values, columns))  # within each column from the least to the greatest
    lasts = np.append(firsts[1:], along.size) - 1
    kept = np.unique(np.concatenate([sorted_[firsts], sorted_[lasts]]))
    return along[kept].tolist(), values[kept].tolist()
