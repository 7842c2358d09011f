"""Which tests are quick and which are left out, what comes first, and how many workers there are."""

from __future__ import annotations

import gc
import os
import sys
from contextlib import suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import TYPE_CHECKING

import pytest
from serial.urlhandler import protocol_socket
from simrack_tests.cells import of_other_sixths
from simrack_tests.ports import PLENTY_S

if TYPE_CHECKING:
    from collections.abc import Iterator

HERE = Path(__file__).parent
_WORKER = "VCFBENCH_TESTED_BY"
SLOW = (
    "faults/test_matrix.py",
    "faults/test_scripts.py",
    "cli/test_run_served.py",
    "cli/test_run_made_safe.py",
    "bench/test_holding.py",
    "cli/test_run_meters.py",
    "cli/test_safe.py",
    "faults/test_owners.py",
    "faults/test_signals.py",
    "station/test_discovery.py",
    "sim/serve/test_tables.py",
    "test_docs.py",
    "cli/test_streams.py",
    "cli/test_main.py",
    "cli/test_run_simulated.py",
    "bench/test_open_simulated.py",
    "sim/serve/test_server.py",
    "sim/rate_tables/test_host_gone.py",
    "test_run.py",
    "test_examples.py",
    "testing/test_plugin.py",
    "steps/test_long_window.py",
    "steps/test_corrupted_replies.py",
    "steps/test_faults_in_mid_run.py",
    "sim/gyro/test_bridge.py",
    "sim/gyro/test_played.py",
    "sim/gyro/test_noise.py",
    "sim/test_world.py",
)
"""Modules that take more than some seconds, first of all those that wait: all processors are busy to the end then."""

QUICK = (
    "analysis/",
    "cli/test_paper_figures.py",
    "conformance/test_dialect.py",
    "conformance/test_errors.py",
    "conformance/test_exchanges.py",
    "conformance/test_walk.py",
    "drivers/",
    "records/",
    "reports/",
    "sim/rate_tables/",
    "sim/scpi/",
    "test_face.py",
    "test_files.py",
    "test_models.py",
    "test_specifications.py",
)
"""Half a minute of tests that tell most: drivers, command sets, analysis, records, and one whole calibration."""


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int | None:
    """Start two workers more than there are processors: some tests wait for time-outs and for other processes."""
    if "PYTEST_XDIST_AUTO_NUM_WORKERS" in os.environ:
        return None
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return processors + 2


@pytest.fixture(autouse=True, scope="session")
def _sockets_close_at_once() -> Iterator[None]:
    """Leave out the 0.3 s that pyserial waits after it has closed a socket, hundreds of times."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(protocol_socket, "time", SimpleNamespace(sleep=lambda _seconds: None))
        yield


@pytest.fixture
def unhurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Grant blind words more than tenths of a second, where what they do is asked and not how fast this machine is."""
    monkeypatch.setattr("vcfbench.drivers.conversation._BLIND_S", PLENTY_S)


@pytest.fixture(autouse=True, scope="module")
def no_watchdog_left() -> Iterator[None]:
    """End the watchdogs that a module has left behind: of benches that have gone they would try for ever."""
    yield
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            words = (process / "cmdline").read_bytes()  # the server that forks warm programs has loaded it too
            if b"vcfbench.cli.watchdog" in words and b"forkserver" not in words:
                ours = f"{_WORKER}={os.getpid()}".encode() in (process / "environ").read_bytes().split(b"\0")
                if ours:
                    os.kill(int(process.name), 9)


def pytest_configure(config: pytest.Config) -> None:
    """Let the interpreters that tests start load bytecode, and see no locks but those of this run.

    Bytecode is loaded also where none may be written beside the sources. Locks of programs that died bear ports that
    are given out again.
    """
    os.environ[_WORKER] = str(os.getpid())
    if "PYTEST_XDIST_WORKER" not in os.environ and "VCFBENCH_LOCKS" not in os.environ:
        locks = TemporaryDirectory(prefix="locks-")
        os.environ["VCFBENCH_LOCKS"] = locks.name
        config.add_cleanup(locks.cleanup)
    if sys.dont_write_bytecode and hasattr(config, "cache"):
        os.environ["PYTHONPYCACHEPREFIX"] = str(config.cache.mkdir("bytecode"))
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


@pytest.hookimpl(tryfirst=True)
def pytest_collection(session: pytest.Session) -> None:
    """Let each worker begin to import at another place: what must be compiled is compiled once, not by all of them."""
    worker = getattr(session.config, "workerinput", None)
    if worker is None or session.config.args_source is not pytest.Config.ArgsSource.TESTPATHS:
        return
    modules = [path for path in sorted(HERE.rglob("test_*.py")) if not pytest_ignore_collect(path, session.config)]
    begin = len(modules) * int(worker["workerid"].removeprefix("gw")) // worker["workercount"]
    for path in (*modules[begin:], *modules[:begin]):
        with suppress(Exception, pytest.skip.Exception):  # collection imports it again, and tells what is wrong
            import_module(".".join(path.relative_to(HERE.parent).with_suffix("").parts))


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Do not even import what has nothing quick, or nothing exhaustive, when nothing else is wanted."""
    wanted = {"quick": _is_quick, "exhaustive": _has_exhaustive}.get(config.option.markexpr)
    is_test = collection_path.suffix == ".py" and collection_path.is_relative_to(HERE)
    return True if wanted is not None and is_test and not wanted(collection_path) else None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark what is quick, put the slow modules first, and leave out what is only done when it is asked for."""
    if "exhaustive" not in config.option.markexpr:
        left_out = [item for item in items if item.get_closest_marker("exhaustive") is not None]
        config.hook.pytest_deselected(items=left_out)
        if unseen := {
            item.path for item in left_out if item.path.is_relative_to(HERE) and not _has_exhaustive(item.path)
        }:
            raise pytest.UsageError(f"say `exhaustive` in {unseen}, else `-m exhaustive` does not look there")
        items[:] = [item for item in items if item.get_closest_marker("exhaustive") is None]
    elif not_drawn := set(of_other_sixths(items)):
        config.hook.pytest_deselected(items=list(not_drawn))
        items[:] = [item for item in items if item not in not_drawn]
    for item in items:
        if _is_quick(item.path) and item.get_closest_marker("slow") is None:
            item.add_marker(pytest.mark.quick)
    order = {HERE / module: place for place, module in enumerate(SLOW)}
    items.sort(key=lambda item: order.get(item.path, len(SLOW)))


def pytest_collection_finish() -> None:
    """Let no collection of garbage look again and again at what was imported and collected: it stays to the end."""
    gc.collect()
    gc.freeze()


@cache
def _is_quick(path: Path) -> bool:
    place = path.relative_to(HERE).as_posix() if path.is_relative_to(HERE) else ""
    return place.startswith(QUICK) and place not in SLOW


@cache
def _has_exhaustive(path: Path) -> bool:
    text = path.read_text(encoding="utf-8")
    return "mark.exhaustive" in text or "few(" in text
