from __future__ import annotations

import os
import re
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from vcfbench.bench.lock import lock_path, station_lock
from vcfbench.errors import BenchError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

HOLD = """
import sys
from vcfbench.bench.lock import station_lock
with station_lock("lab-1"):
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.fixture(autouse=True)
def _state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LOCALAPPDATA" if sys.platform == "win32" else "XDG_STATE_HOME", str(tmp_path))


@pytest.fixture
def holder() -> Iterator[subprocess.Popen[str]]:
    """Another process that holds the lock."""
    command = [sys.executable, "-c", HOLD]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:  # noqa: S603
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        yield process
        process.kill()


def test_a_second_process_is_told_who_has_the_station(holder: subprocess.Popen[str]) -> None:
    with pytest.raises(BenchError, match=f"station lab-1 is in use by process {holder.pid} on ") as caught:
        station_lock("lab-1").__enter__()
    assert caught.value.exit_code == 3
    assert re.search(r"since 20\d\d-", str(caught.value))
    assert str(lock_path("lab-1")) in str(caught.value)


def test_another_station_is_free(holder: subprocess.Popen[str]) -> None:
    assert holder.poll() is None
    with station_lock("lab-2") as path:
        assert f'"pid": {os.getpid()}' in path.read_text("utf-8")


def test_a_killed_process_leaves_the_station_free(holder: subprocess.Popen[str]) -> None:
    holder.kill()
    holder.wait()
    with station_lock("lab-1"):
        assert lock_path("lab-1").exists()


def test_the_lock_is_given_back_and_can_be_taken_again() -> None:
    for _ in range(2):
        with station_lock("lab-1"), pytest.raises(BenchError):
            station_lock("lab-1").__enter__()


def test_a_lock_file_full_of_nonsense_locks_nobody_out() -> None:
    lock_path("lab-1").parent.mkdir(parents=True)
    lock_path("lab-1").write_bytes(b"\xff\x00{")
    with station_lock("lab-1"):
        pass


def test_a_state_directory_that_cannot_be_made_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    monkeypatch.setenv("LOCALAPPDATA" if sys.platform == "win32" else "XDG_STATE_HOME", str(blocked))
    with pytest.raises(BenchError, match=r"lock file .* cannot be opened"):
        station_lock("lab-1").__enter__()
