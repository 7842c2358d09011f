"""Which tests are quick, and that the slow ones come first: all processors are then busy to the end."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
SLOW = (
    "bench/test_holding.py",
    "bench/test_open_simulated.py",
    "cli/test_main.py",
    "cli/test_paper_figures.py",
    "cli/test_run_dialects.py",
    "cli/test_run_served.py",
    "cli/test_run_meters.py",
    "cli/test_run_simulated.py",
    "cli/test_streams.py",
    "faults/test_matrix.py",
    "faults/test_owners.py",
    "faults/test_scripts.py",
    "sim/gyro/test_bridge.py",
    "sim/gyro/test_carrier.py",
    "sim/gyro/test_noise.py",
    "sim/gyro/test_played.py",
    "sim/instruments/agilent33220a/test_modulation.py",
    "sim/instruments/agilent33220a/test_playing.py",
    "sim/instruments/hp34401a/test_ac.py",
    "sim/instruments/hp34401a/test_counter.py",
    "sim/rate_tables/test_host_gone.py",
    "sim/serve/test_server.py",
    "sim/serve/test_tables.py",
    "testing/test_plugin.py",
    "test_docs.py",
    "test_examples.py",
)
"""Modules that take more than some seconds: fresh interpreters, long records, every wire."""


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int | None:
    """Start half as many workers again as there are processors: some tests wait for timeouts and other processes."""
    if "PYTEST_XDIST_AUTO_NUM_WORKERS" in os.environ:
        return None
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return processors + processors // 2


def pytest_configure(config: pytest.Config) -> None:
    """Let the interpreters that tests start load bytecode, also where none may be written beside the sources."""
    if sys.dont_write_bytecode and hasattr(config, "cache"):
        os.environ["PYTHONPYCACHEPREFIX"] = str(config.cache.mkdir("bytecode"))
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark every test slow or quick, put the slow ones first, and leave out what is only done when it is asked for."""
    if "exhaustive" not in config.option.markexpr:
        left_out = [item for item in items if item.get_closest_marker("exhaustive") is not None]
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if item.get_closest_marker("exhaustive") is None]
    for item in items:
        if item.path.is_relative_to(HERE) and item.path.relative_to(HERE).as_posix() in SLOW:
            item.add_marker(pytest.mark.slow)
        elif item.get_closest_marker("slow") is None:
            item.add_marker(pytest.mark.quick)
    items.sort(key=lambda item: item.get_closest_marker("slow") is None)
