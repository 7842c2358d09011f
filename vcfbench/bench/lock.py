"""One owner an instrument: a lock file for each resource, for all users of the computer.

The operating system holds the lock and drops it when the process dies, however it dies; so a file left behind by a dead
process locks nobody out, nor does a process number that was given again. The file's text is only for people. Files lie
where every user may make some and nobody may take away another's; links that somebody has laid there are refused.
"""

from __future__ import annotations

import getpass
import hashlib
import json
import os
import re
import socket
import stat
import sys
import tempfile
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Final

from vcfbench.bench.resources import resource_key
from vcfbench.clock import utc_now
from vcfbench.errors import BenchError
from vcfbench.files import try_lock, unlock

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

_VARIABLE: Final = "VCFBENCH_LOCKS"
_SHARED: Final = ("/run/lock", "/var/lock", "/tmp")  # noqa: S108  # made for this; what others lay there is refused
_FLAGS: Final = os.O_RDWR | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)


class InUse(BenchError):
    """Another process has an instrument of the bench."""


class LockUnusable(BenchError):
    """A lock cannot be taken, whoever has the instrument: no file can be made, or something else lies there."""


@contextmanager
def instrument_locks(station: str, resources: Mapping[str, str]) -> Iterator[Mapping[str, str]]:
    """Hold the locks of `resources`, role to resource name: all of them, or none.

    They are taken in one order, whoever takes them, and nobody waits for one: two runs cannot wait for each other.
    Yields by role who died with an instrument and left it as it was: who makes it safe takes the signed file away.

    Raises:
        InUse: another process has one of them; says which, who, where and since when.
        LockUnusable: a lock file cannot be used, and nobody is known to have one of the others.
    """
    keys = {resource_key(resource): (role, resource) for role, resource in resources.items()}
    unusable: LockUnusable | None = None
    left: dict[str, str] = {}
    with ExitStack() as stack:
        for key in sorted(keys):
            role, resource = keys[key]
            try:
                before = stack.enter_context(_lock(lock_path(resource), station, role, resource))
                left |= {} if before is None else {role: before}
            except LockUnusable as error:
                unusable = unusable or error
        if unusable is not None:
            raise unusable
        yield left


def lock_path(resource: str) -> Path:
    """Return the lock file of a resource: the same for all its names."""
    key = resource_key(resource)
    readable = re.sub(r"[^A-Za-z0-9.]+", "-", key)[:80].strip("-")
    return lock_directory() / f"vcfbench-{readable}-{hashlib.sha256(key.encode()).hexdigest()[:8]}.lock"


def lock_directory() -> Path:
    """Return where the locks lie: a directory that all users share, or the one that `VCFBENCH_LOCKS` names."""
    if chosen := os.environ.get(_VARIABLE):
        return Path(chosen)
    if sys.platform == "win32":
        return Path(os.environ.get("PROGRAMDATA", "C:\\ProgramData")) / "vcfbench" / "locks"
    return next((Path(name) for name in _SHARED if _is_shared(name)), Path(tempfile.gettempdir()))


def _is_shared(name: str) -> bool:
    """Tell whether everybody may make files there and nobody take away another's; the same for whoever asks."""
    with suppress(OSError):
        mode = os.stat(name).st_mode  # noqa: PTH116  # Path.stat would do no more
        return stat.S_ISDIR(mode) and bool(mode & stat.S_ISVTX) and bool(mode & stat.S_IWOTH)
    return False


@contextmanager
def _lock(path: Path, station: str, role: str, resource: str) -> Iterator[str | None]:
    file = _locked(path, role, resource)
    try:
        before = _signed(path)
        _sign(file, station, resource)
        yield before
    finally:
        with suppress(OSError):  # another user's file stays, empty
            os.ftruncate(file, 0)
            path.unlink()
        with suppress(OSError):
            unlock(file)  # a forked process may have the file too
        os.close(file)


def _locked(path: Path, role: str, resource: str) -> int:
    """Return the open and locked file at `path`; what was taken away meanwhile is opened anew."""
    while True:
        file = _opened(path)
        try:
            taken = try_lock(file)
        except OSError as error:  # a file system without locks
            os.close(file)
            raise LockUnusable(f"lock file {path} cannot be locked: {error.strerror}") from None
        if taken and _is_at(file, path):
            return file
        os.close(file)
        if not taken:
            raise InUse(f"in use by {_owner(path)}", instrument=role, resource=resource, hint=f"lock file {path}")


def _is_at(file: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(file), path.stat(follow_symlinks=False))
    except FileNotFoundError:
        return False


def _opened(path: Path) -> int:
    try:
        if not path.parent.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
        file = _opened_or_made(path)
    except OSError as error:
        raise LockUnusable(f"lock file {path} cannot be opened: {error.strerror}") from None
    found = os.fstat(file)
    if not stat.S_ISREG(found.st_mode) or found.st_nlink > 1:
        os.close(file)
        raise LockUnusable(f"lock file {path} is no plain file; somebody has laid it there")
    return file


def _opened_or_made(path: Path) -> int:
    """Open the file or make it: never both at once, which Linux refuses for other users' files in shared places."""
    while True:
        with suppress(FileNotFoundError):
            try:
                return os.open(path, _FLAGS)
            except PermissionError:
                return os.open(path, _FLAGS & ~os.O_RDWR | os.O_RDONLY)  # it can be locked, though not signed
        with suppress(FileExistsError):
            file = os.open(path, _FLAGS | os.O_CREAT | os.O_EXCL, 0o666)
            if sys.platform != "win32":
                os.fchmod(file, 0o666)  # whatever the umask
            return file


def _sign(file: int, station: str, resource: str) -> None:
    owner = {
        "pid": os.getpid(),
        "user": _user(),
        "host": socket.gethostname(),
        "start": utc_now().isoformat(timespec="seconds"),
        "station": station,
        "resource": resource,
    }
    with suppress(OSError):  # the lock holds without it
        os.ftruncate(file, 0)
        os.lseek(file, 0, os.SEEK_SET)
        os.write(file, json.dumps(owner).encode())


def _user() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):  # a number without a name
        return str(getattr(os, "getuid", lambda: "somebody")())


def _owner(path: Path) -> str:
    return _signed(path) or "another process"  # it has locked the file and not signed it yet


def _signed(path: Path) -> str | None:
    """Return who has signed the file of a lock; None where nobody has."""
    try:
        owner = json.loads(path.read_text("utf-8"))
        who = f"process {owner['pid']} of {owner['user']} on {owner['host']}"
        return f"{who} for station {owner['station']} since {owner['start']}"
    except (OSError, ValueError, TypeError, KeyError):
        return None
