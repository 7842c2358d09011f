"""Matrices of tests: every run of the tests has a few of their cells, ``pytest -m exhaustive`` has the others."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterable

_PARAM = type(pytest.param())


def few(cells: Iterable[Any], *kept: Any) -> list[Any]:
    """Return the parameters of a test, all but those `kept` marked ``exhaustive``; cells of several are tuples."""
    rows = [cell if isinstance(cell, _PARAM) else pytest.param(*_values(cell)) for cell in cells]
    wanted = [_values(cell) for cell in kept]
    missing = [cell for cell in wanted if cell not in [row.values for row in rows]]
    if missing:
        raise ValueError(f"expected cells of the matrix, came {missing}")
    return [row if row.values in wanted else _exhaustive(row) for row in rows]


def _values(cell: Any) -> tuple[Any, ...]:
    return cell if isinstance(cell, tuple) else (cell,)


def _exhaustive(row: Any) -> Any:
    return pytest.param(*row.values, marks=[*row.marks, pytest.mark.exhaustive], id=row.id)
