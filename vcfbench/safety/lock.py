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

from msgspec import Struct, to_builtins
from msgspec.structs import replace

from vcfbench.clock import WallClock, sleep, utc_now
from vcfbench.errors import BenchError
from vcfbench.files import holder_of, kept_from_forks, try_lock, unlock
from vcfbench.safety.processes import dying, mark_of
from vcfbench.station.resources import resource_key
from vcfbench.typed import typed

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

_VARIABLE: Final = "VCFBENCH_LOCKS"
_SHARED: Final = ("/run/lock", "/var/lock", "/tmp")  # noqa: S108  # made for this; what others lay there is refused
_OF_SOCKET: Final = re.compile(r"vcfbench-socket-localhost-([0-9]+)-[0-9a-f]{8}\.lock")
_DYING_S: Final = 5.0
"""Longest wait for a process that is dying, s."""
_BY_HAND: Final = "end it by hand, it makes its bench safe; or safe --force speaks beside it"
_FLAGS: Final = os.O_RDWR | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)


class Owner(Struct, frozen=True):
    """Process that has signed the file of a lock; `mark` distinguishes it from a later one of its number."""

    pid: int
    user: str
    host: str
    start: str
    station: str
    resource: str
    mark: str | None = None

    def __str__(self) -> str:
        who = f"process {self.pid} of {self.user} on {self.host}"
        return f"{who} for station {self.station} since {self.start}"

    def alive(self) -> bool:
        """Return True unless the process is known to have ended."""
        return self.host != socket.gethostname() or (self.mark is not None and mark_of(self.pid) == self.mark)

    def ended_within(self, wall_s: float) -> bool:
        """Wait for its end, if it is just dying; return True if it has come."""
        clock = WallClock()
        while (
            (alive := self.alive()) and self.host == socket.gethostname() and dying(self.pid) and clock.now() < wall_s
        ):
            sleep(clock, 0.02)
        return not alive


class InUse(BenchError):
    """Another process has an instrument of the bench: `owner`, None where it has not signed."""

    owner: Owner | None = None


class LockUnusable(BenchError):
    """A lock cannot be taken: no file can be made, or something else lies there."""


@contextmanager
def instrument_locks(station: str, resources: Mapping[str, str]) -> Iterator[Mapping[str, str]]:
    """Hold the locks of `resources`, role to resource name: all of them, or none.

    They are taken in one order, whoever takes them, and nobody waits for one: two runs cannot wait for each other.
    Yields by role who died with an instrument and left it as it was: who makes it safe takes the signed file away. Who
    is still dying may have its wire, and is waited for.

    Raises:
        InUse: another process has one of them; says which, who, where and since when.
        LockUnusable: a lock file cannot be used, and nobody is known to have one of the others.
    """
    keys: dict[str, list[str]] = {}
    for role, resource in resources.items():
        keys.setdefault(resource_key(resource), []).append(role)  # several behind one adapter
    # Take away the files that dead programs have left of sockets of this computer at which nobody listens any more. A
    # simulated bench was served there, and is gone. Of any other instrument the next owner is told who died with it
    with suppress(OSError):
        for path in lock_directory().iterdir():
            found = _OF_SOCKET.fullmatch(path.name)
            owner = None if found is None else _signed(path)
            if found is None or owner is None or owner.alive() or _is_served(int(found[1])):
                continue
            with suppress(BenchError, OSError), _lock(path, "", "", owner.resource):
                pass  # who gives a lock back takes its file away
    unusable: LockUnusable | None = None
    left: dict[str, str] = {}
    with ExitStack() as stack:
        for key in sorted(keys):
            role, resource = keys[key][-1], resources[keys[key][-1]]
            try:
                before = stack.enter_context(_lock(lock_path(resource), station, role, resource))
                left |= {} if before is None else dict.fromkeys(keys[key], str(before))
            except LockUnusable as error:
                unusable = unusable or error
        if unusable is not None:
            raise unusable
        yield left


def _is_served(port: int) -> bool:
    """Return True if somebody listens; without a connection, for many instruments take one only."""
    with socket.socket() as free:
        if sys.platform != "win32":
            free.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # there it would take what others have
        try:
            free.bind(("127.0.0.1", port))
        except (OSError, OverflowError):
            return True
    return False


def owners_of(resources: Iterable[str]) -> dict[int, Owner]:
    """Return by number the processes that hold the locks of any of `resources`, without taking a lock.

    What a file says is believed of the process alone that holds its lock, and is the file's user.

    Raises:
        BenchError: it cannot be told who holds one, or not be believed: the directory's rights, another user's file.
    """
    found: dict[int, Owner] = {}
    for path in map(lock_path, resources):
        try:
            file = os.open(path, _FLAGS & ~os.O_RDWR | os.O_RDONLY)
        except OSError:  # nobody has made one, or something else lies there
            continue
        try:
            holder, of_file = holder_of(file), os.fstat(file)
        except OSError:
            raise BenchError(f"this system does not report which process holds {path}", hint=_BY_HAND) from None
        finally:
            os.close(file)
        if holder is None:
            continue
        if why := _unbelievable(path.parent, holder, of_file):
            raise BenchError(f"process {holder} holds {path}, but {why}: nothing was ended", hint=_BY_HAND)
        signed = _signed(path)
        if signed is None or signed.pid != holder:
            signed = Owner(holder, f"user {of_file.st_uid}", "", "an unknown time", "an unknown station", str(path))
        found[holder] = replace(signed, host=socket.gethostname(), mark=mark_of(holder))
    return found


def _unbelievable(folder: Path, holder: int, of_file: os.stat_result) -> str:
    """Return the reason not to end the holder of a lock (anyone may have laid the file), or None."""
    if sys.platform == "win32":
        return ""
    rights = folder.stat()
    if rights.st_mode & (stat.S_IWGRP | stat.S_IWOTH) and not rights.st_mode & stat.S_ISVTX:
        return f"others than their owners may lay and take away files in {folder}"
    if rights.st_uid not in {0, os.geteuid()}:
        return f"{folder} is user {rights.st_uid}'s"
    with suppress(OSError):
        user = Path(f"/proc/{holder}").stat().st_uid
        return "" if user == of_file.st_uid else f"the file is user {of_file.st_uid}'s and the process user {user}'s"
    return "" if of_file.st_uid == os.geteuid() else f"the file is user {of_file.st_uid}'s"


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
    """Return True if everybody may make files there and nobody take away another's."""
    with suppress(OSError):
        mode = os.stat(name).st_mode  # noqa: PTH116  # Path.stat would do no more
        return stat.S_ISDIR(mode) and bool(mode & stat.S_ISVTX) and bool(mode & stat.S_IWOTH)
    return False


@contextmanager
def _lock(path: Path, station: str, role: str, resource: str) -> Iterator[Owner | None]:
    file = _locked(path, role, resource)
    try:
        with kept_from_forks(file):
            before = _signed(path)
            if before is not None:
                before.ended_within(_DYING_S)  # the system may still have to close its wires
            _sign(file, station, resource)
            yield before
    finally:
        with suppress(OSError):  # another user's stays, empty; of a forked process it is the null device, that stays
            os.ftruncate(file, 0)
            path.unlink()
        with suppress(OSError):
            unlock(file)  # what a library has forked may have the file too
        os.close(file)


def _locked(path: Path, role: str, resource: str) -> int:
    """Return the open and locked file at `path`; one taken away meanwhile is opened anew."""
    while True:
        file = _opened(path)
        try:
            taken = try_lock(file)
        except OSError as error:  # a file system without locks
            os.close(file)
            raise LockUnusable(f"lock file {path} cannot be locked: {error.strerror}") from None
        if taken:
            with suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(file), path.stat(follow_symlinks=False)):
                    return file
        os.close(file)
        if not taken:
            owner = _signed(path)
            who = owner or "another process"  # it has locked the file and not signed it yet
            in_use = InUse(f"in use by {who}", instrument=role, resource=resource, hint=f"lock file {path}")
            in_use.owner = owner
            raise in_use


def _opened(path: Path) -> int:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = _opened_or_made(path)
    except OSError as error:
        raise LockUnusable(f"lock file {path} cannot be opened: {error.strerror}") from None
    found = os.fstat(file)
    if not stat.S_ISREG(found.st_mode) or found.st_nlink > 1:
        os.close(file)
        raise LockUnusable(f"lock file {path} is not a regular file; remove it")
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
            file = os.open(path, _FLAGS | os.O_CREAT | os.O_EXCL)
            if sys.platform != "win32":
                os.fchmod(file, 0o666)  # whatever the umask
            return file


def _sign(file: int, station: str, resource: str) -> None:
    pid, now = os.getpid(), utc_now().isoformat(timespec="seconds")
    try:
        user = getpass.getuser()
    except (OSError, KeyError, ImportError):  # a number without a name
        user = str(getattr(os, "getuid", lambda: "somebody")())
    owner = Owner(pid, user, socket.gethostname(), now, station, resource, mark_of(pid))
    with suppress(OSError):  # the lock holds without it
        os.ftruncate(file, 0)
        os.lseek(file, 0, os.SEEK_SET)
        os.write(file, json.dumps(to_builtins(owner)).encode())


def _signed(path: Path) -> Owner | None:
    """Return the owner that has signed the file of a lock; None where nobody has."""
    try:
        return typed(json.loads(path.read_text("utf-8")), Owner)
    except (OSError, ValueError):
        return None
