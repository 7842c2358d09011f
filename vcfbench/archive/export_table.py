"""Table of an export, for every kind of file: columns of the same length, with units and meanings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class ExportColumn:
    """One quantity: its name, which ends in its unit, the unit, its meaning, and its values, shape (n,).

    Counts are whole numbers; in a quantity nan is a missing value.
    """

    name: str
    unit: str
    meaning: str
    values: NDArray[np.float64] | NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class ExportTable:
    """Columns of the same length; `name` is ``points`` or ``readings``, `about` the facts of the run by its record."""

    name: str
    columns: tuple[ExportColumn, ...]
    about: Mapping[str, str | float]
    progress: Callable[[int, int], None] | None = None
    """Callback with the numbers of rows written and of all rows, called by formats that take their time."""

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.columns[0].values)
