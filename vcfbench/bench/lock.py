"""One owner a station: a lock file that tells a second run who has the bench.

The operating system holds the lock and drops it when the process dies, however it dies; so a file left behind by a dead
process locks nobody out, nor does a process number that was given again. The file's text is only for people.
"""

from __future__ import annotations

import json
import os
import socket
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from vcfbench.clock import utc_now
from vcfbench.errors import BenchError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from typing import BinaryIO

__all__ = ["lock_path", "station_lock"]

if sys.platform == "win32":
    import msvcrt

    _FAR = 1 << 30  # a locked byte cannot be read by others on Windows: lock one beyond the text

    def _try_lock(file: BinaryIO) -> bool:
        file.seek(_FAR)
        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        return True
else:
    import fcntl

    def _try_lock(file: BinaryIO) -> bool:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True


@contextmanager
def station_lock(name: str) -> Iterator[Path]:
    """Hold the lock of station `name`; yield the lock file.

    Raises:
        BenchError: another process has the station; says which, where and since when.
    """
    path = lock_path(name)
    with _open(path) as file:
        if not _locked(file, path):
            raise BenchError(f"station {name} is in use by {_owner(path)}", hint=f"lock file {path}")
        _sign(file)
        try:
            yield path
        finally:
            file.truncate(0)  # the file itself stays: removing it would let two runs lock two files of one name


def lock_path(name: str) -> Path:
    """Return the lock file of station `name`: in the user's state directory, or a temporary one without a home."""
    return _state_directory() / "vcfbench" / "locks" / f"{name}.lock"


def _state_directory() -> Path:
    told = os.environ.get("LOCALAPPDATA" if sys.platform == "win32" else "XDG_STATE_HOME")
    if told:
        return Path(told)
    try:
        return Path.home() / ".local" / "state"
    except RuntimeError:
        return Path(tempfile.gettempdir())


def _open(path: Path) -> BinaryIO:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        return path.open("a+b")
    except OSError as error:
        raise BenchError(f"lock file {path} cannot be opened: {error.strerror}") from None


def _locked(file: BinaryIO, path: Path) -> bool:
    try:
        return _try_lock(file)
    except OSError as error:  # a file system without locks
        raise BenchError(f"lock file {path} cannot be locked: {error.strerror}") from None


def _sign(file: BinaryIO) -> None:
    owner = {"pid": os.getpid(), "host": socket.gethostname(), "start": utc_now().isoformat(timespec="seconds")}
    file.truncate(0)
    file.write(json.dumps(owner).encode())
    file.flush()


def _owner(path: Path) -> str:
    try:
        owner = json.loads(path.read_text("utf-8"))
        return f"process {owner['pid']} on {owner['host']} since {owner['start']}"
    except (OSError, ValueError, TypeError, KeyError):
        return "another process"  # it has locked the file and not signed it yet
