"""Matrices of tests: every run of the tests has a few of their cells, ``pytest -m exhaustive`` has the others."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any
from zlib import crc32

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterable

_PARAM = type(pytest.param())


def few(cells: Iterable[Any], *kept: Any, every: int | None = None) -> list[Any]:
    """Return the parameters of a test, all but those `kept` marked ``exhaustive``; cells of several are tuples.

    With ``every=4`` the first cell is kept too, and each fourth after it.
    """
    rows = [cell if isinstance(cell, _PARAM) else pytest.param(*_values(cell)) for cell in cells]
    wanted = [_values(cell) for cell in kept]
    missing = [cell for cell in wanted if cell not in [row.values for row in rows]]
    if missing:
        raise ValueError(f"expected cells of the matrix, got {missing}")
    spaced = range(0, len(rows), every) if every is not None else ()
    return [row if row.values in wanted or place in spaced else _exhaustive(row) for place, row in enumerate(rows)]


def _values(cell: Any) -> tuple[Any, ...]:
    return cell if isinstance(cell, tuple) else (cell,)


def _exhaustive(row: Any) -> Any:
    return pytest.param(*row.values, marks=[*row.marks, pytest.mark.exhaustive], id=row.id)


def of_other_sixths(items: Iterable[pytest.Item]) -> list[pytest.Item]:
    """Return the exhaustive tests that are not drawn: ``EXHAUSTIVE_SIXTH=2`` draws a sixth of them by their names.

    By it a gate of a quarter of an hour sees all of them within some changes; without it none is left out.
    """
    sixth = os.environ.get("EXHAUSTIVE_SIXTH")
    if sixth is None:
        return []
    exhaustive = [item for item in items if item.get_closest_marker("exhaustive") is not None]
    return [item for item in exhaustive if crc32(item.name.encode()) % 6 != int(sixth) % 6]
