"""Which tests of the rack are quick, and which are only done when they are asked for."""

from __future__ import annotations

from pathlib import Path

import pytest

from simrack_tests.cells import of_other_sixths

HERE = Path(__file__).parent
QUICK = ("rate_tables/", "scpi/")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark what is quick, and leave out what is only done when it is asked for."""
    ours = [item for item in items if item.path.is_relative_to(HERE)]
    for item in ours:
        if item.path.relative_to(HERE).as_posix().startswith(QUICK) and item.get_closest_marker("slow") is None:
            item.add_marker(pytest.mark.quick)
    left_out = set(of_other_sixths(ours))
    if "exhaustive" not in config.option.markexpr:
        left_out = {item for item in ours if item.get_closest_marker("exhaustive") is not None}
    config.hook.pytest_deselected(items=list(left_out))
    items[:] = [item for item in items if item not in left_out]
