"""Processes are told apart by number and mark, with ``/proc`` and without, and only the one that is meant is ended."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from vcfbench.safety.processes import KILL, end, mark_of

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals are different there")


@pytest.fixture
def other() -> Iterator[subprocess.Popen[bytes]]:
    """A process that waits."""
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        yield process
        process.kill()


@pytest.fixture
def no_proc(monkeypatch: pytest.MonkeyPatch) -> None:
    """A system that does not tell when processes started."""

    def missing(self: Path, *_: Any, **__: Any) -> str:
        raise FileNotFoundError(self)

    monkeypatch.setattr(Path, "read_text", missing)
    monkeypatch.setattr(Path, "exists", lambda _: False)


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="no process tells when it started")
def test_mark_lasts_until_its_process_ends(other: subprocess.Popen[bytes]) -> None:
    mark = mark_of(other.pid)
    assert mark
    assert mark_of(other.pid) == mark
    assert mark_of(os.getpid()) not in {None, "", mark}
    other.kill()
    os.waitid(os.P_PID, other.pid, os.WEXITED | os.WNOWAIT)
    assert mark_of(other.pid) is None  # nobody has asked for its exit code yet
    other.wait()
    assert mark_of(other.pid) is None


@pytest.mark.usefixtures("no_proc")
def test_without_proc_all_that_live_have_one_mark(other: subprocess.Popen[bytes]) -> None:
    assert mark_of(other.pid) == mark_of(os.getpid()) == ""
    other.kill()
    other.wait()
    assert mark_of(other.pid) is None


def test_only_the_process_that_is_meant_is_ended(other: subprocess.Popen[bytes]) -> None:
    mark = mark_of(other.pid)
    assert end(other.pid, "another", signal.SIGTERM) is False
    assert end(other.pid, None, signal.SIGTERM) is False
    assert other.poll() is None
    assert end(other.pid, mark, KILL)
    assert other.wait() == -KILL
    assert not end(other.pid, mark, KILL)
    assert not end(other.pid, None, KILL)


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="no process tells when it started")
def test_ended_unmarked_process_gets_no_signal(other: subprocess.Popen[bytes]) -> None:
    other.kill()
    os.waitid(os.P_PID, other.pid, os.WEXITED | os.WNOWAIT)
    assert end(other.pid, None, signal.SIGTERM) is False


def test_process_that_ends_before_signal_was_not_ended_by_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def gone(_pid: int, _number: int) -> None:
        raise ProcessLookupError

    mark = mark_of(os.getpid())
    monkeypatch.setattr(os, "kill", gone)
    assert end(os.getpid(), mark, signal.SIGTERM) is False
