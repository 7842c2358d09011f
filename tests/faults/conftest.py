"""The whole matrix takes minutes: it runs when it is asked for, ``pytest -m fault_matrix``."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pytest


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what is marked, unless the mark is asked for."""
    if "fault_matrix" in config.option.markexpr:
        return
    left_out = [item for item in items if item.get_closest_marker("fault_matrix") is not None]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if item not in left_out]
