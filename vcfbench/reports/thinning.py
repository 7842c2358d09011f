"""So many values that a picture cannot show each: the least and the greatest of each of its columns stand for them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

Floats: TypeAlias = "NDArray[np.float64]"

COLUMNS: Final = 800
"""About as many as a drawing is wide in points of a screen: values closer together show as one line upright."""

DRAWN: Final = f"drawn are the least and the greatest in each of {COLUMNS} columns."
"""Words of a caption for a series that is drawn so."""

_FEW: Final = 4 * COLUMNS
"""So many values are drawn one by one."""


def thinned(x: Sequence[float] | Floats, y: Sequence[float] | Floats) -> tuple[list[float], list[float]] | None:
    """Return least and greatest `y` of each of `COLUMNS` equal columns along `x`, where it begins; None for few values.

    No spike is lost; an empty column gives nothing. Values are a record only where `x` does not fall; where it does,
    they are drawn one by one.
    """
    if len(x) <= _FEW:
        return None
    import numpy as np  # noqa: PLC0415 - it is needed for long records alone

    along, values = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    if along[-1] <= along[0] or np.any(along[1:] < along[:-1]):
        return None
    edges = np.linspace(along[0], along[-1], COLUMNS, endpoint=False)
    begins = np.unique(np.searchsorted(along, edges))
    extremes = np.column_stack([np.minimum.reduceat(values, begins), np.maximum.reduceat(values, begins)])
    return np.repeat(along[begins], 2).tolist(), extremes.ravel().tolist()
