"""Reads the files that a user names, with limits of kind, size and depth.

A pipe can keep a program waiting for ever, a device has no end, opening a terminal moves its handshake lines. So only
regular files are opened, no more is read than a file of its kind can need, and TOML may be nested no deeper than
anybody writes it. Whatever is wrong is one sentence with the file, what was expected and what came (ConfigError).
"""

import errno
import math
import os
import re
import stat
import sys
import tomllib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, Final

from vcfbench.errors import BenchError, ConfigError

MOST_SETTINGS = 1 << 20
"""Bytes of a bench file, a profile or a fault script: the longest that come along have 10 kB."""
MOST_TABLE = 1 << 28
"""Bytes of a table of numbers: a record of a million points has some 120 MB."""
DEEPEST = 32
"""Tables within tables, and parts of a key: a bench file has five."""

_WHOLE = 1 << 63
_NOT_BLOCKING = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0) | getattr(os, "O_BINARY", 0)
_PART = r"""(?:[\w-]+|"[^"\n]*"|'[^'\n]*')"""
_LONG_KEY = re.compile(rf"(?<![\w-])(?:{_PART}[ \t]*\.[ \t]*){{{DEEPEST}}}{_PART}")
"""A key of more parts; found before it is parsed, which takes a time that grows with the square of the parts."""

Keys = tuple[str | int, ...]


@contextmanager
def failing_as(kind: type[BenchError], words: str) -> Iterator[None]:
    """Turn an OSError into a `kind` with `words` and the system's reason."""
    try:
        yield
    except OSError as error:
        raise kind(f"{words}: {error.strerror or error}") from error


@contextmanager
def replaced(path: Path) -> Iterator[Path]:
    """Yield a draft that takes name and mode of `path` at the end of the block; after an error that file is as it was.

    ConfigError: it cannot be written, is write-protected, or no regular file.
    """
    if path.exists() and not path.is_file():  # replacing it would take a device away
        raise ConfigError(f"{shown(path)}: expected a regular file to replace, got something else")
    target = path.resolve()
    draft = target.with_name(f".{path.name}.draft")
    with failing_as(ConfigError, f"{shown(path)}: cannot be written"):
        if target.exists() and not os.access(target, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        try:
            yield draft
            with suppress(FileNotFoundError):  # a report that only its owner reads stays so
                draft.chmod(stat.S_IMODE(target.stat().st_mode))
            draft.replace(target)
        finally:
            with suppress(OSError):
                draft.unlink()


def read_file(path: Path | str, expected: str, most_bytes: int) -> bytes:
    """Return the bytes of a file that a user named.

    Args:
        path: the file.
        expected: what it should be, for errors: ``a bench file``.
        most_bytes: the size beyond which it cannot be one.

    Raises:
        ConfigError: it is not there, no regular file, too large, or cannot be read.
    """
    with _descriptor_of(path, expected) as descriptor:  # a list reads thousands: a file object takes twice the time
        size = os.fstat(descriptor).st_size  # room is made for what is asked for, however short the file is
        data = _read(descriptor, min(size, most_bytes) + 1)
        if len(data) > size:  # it has grown, or does not tell its size
            data += _read(descriptor, max(0, most_bytes + 1 - len(data)))
    if len(data) > most_bytes:
        raise ConfigError(f"{shown(path)}: expected {expected} of at most {most_bytes} bytes, this file has more")
    return data


def read_text(path: Path | str, expected: str, most_bytes: int = MOST_SETTINGS) -> str:
    """Return the text of a UTF-8 file, with or without byte order mark; arguments and errors as `read_file`."""
    data = read_file(path, expected, most_bytes)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        came = f"byte 0x{data[error.start]:02x}"
        raise ConfigError(f"{shown(path)}: expected UTF-8 text, got {came}") from None


def _read(descriptor: int, count: int) -> bytes:
    """Return so many bytes, fewer only where the file ends."""
    data = os.read(descriptor, count)
    while len(data) < count and (more := os.read(descriptor, count - len(data))):
        data += more
    return data


@contextmanager
def opened(path: Path | str, expected: str) -> Iterator[IO[bytes]]:
    """Open a regular file for reading; arguments and errors as :func:`read_file`."""
    with _descriptor_of(path, expected) as descriptor, os.fdopen(descriptor, "rb", closefd=False) as file:
        yield file


@contextmanager
def _descriptor_of(path: Path | str, expected: str) -> Iterator[int]:
    try:
        _require_regular(os.stat(path), path, expected)  # noqa: PTH116  # opening a device may do something already
        descriptor = os.open(path, os.O_RDONLY | _NOT_BLOCKING)
        try:
            _require_regular(os.fstat(descriptor), path, expected)  # what was looked at may have been exchanged
            yield descriptor
        finally:
            os.close(descriptor)
    except FileNotFoundError:
        raise _no_such(path, expected, "there is no such file") from None
    except (OSError, ValueError) as error:  # a name with NUL in it is a ValueError
        reason = error.strerror if isinstance(error, OSError) else error
        raise _no_such(path, expected, f"which cannot be read: {reason}") from None


def _no_such(path: Path | str, expected: str, why: str) -> ConfigError:
    return ConfigError(f"{shown(path)}: expected {expected}, {why}")


def _require_regular(found: os.stat_result, path: Path | str, expected: str) -> None:
    if not stat.S_ISREG(found.st_mode):
        raise _no_such(path, expected, f"this is {_KINDS.get(stat.S_IFMT(found.st_mode), 'no regular file')}")


_KINDS = {
    stat.S_IFDIR: "a directory",
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}


if sys.platform == "win32":
    import msvcrt

    _FAR = 1 << 30
    """Past the end of any file that is locked: a locked byte cannot be read by others on Windows."""

    def try_lock(descriptor: int) -> bool:
        """Lock a file that is open for writing until it is closed, or its process ends; False if it is locked.

        Raises:
            OSError: the file system has no locks (elsewhere than on Windows, which does not say).
        """
        os.lseek(descriptor, _FAR, os.SEEK_SET)
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        return True

    def unlock(descriptor: int) -> None:
        """Release a file before it is closed."""
        os.lseek(descriptor, _FAR, os.SEEK_SET)
        msvcrt.locking(descriptor, msvcrt.LK_UNLCK, 1)

    def holder_of(descriptor: int) -> int | None:
        """Raise OSError: this system reports no holder of a lock."""
        raise OSError(errno.ENOSYS, "who holds a lock", descriptor)
else:
    import fcntl

    def try_lock(descriptor: int) -> bool:
        """Lock a file that is open for writing until it is closed, or its process ends; False if it is locked.

        Raises:
            OSError: the file system has no locks.
        """
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True

    def holder_of(descriptor: int) -> int | None:
        """Return the number of the process that has locked a file, or None.

        Raises:
            OSError: the system does not tell.
        """
        found = os.fstat(descriptor)
        place = f"{os.major(found.st_dev):02x}:{os.minor(found.st_dev):02x}:{found.st_ino}"
        for line in Path("/proc/locks").read_text("ascii").splitlines():
            fields = line.split()  # 1: FLOCK ADVISORY WRITE 4711 fe:00:2162737 0 EOF (proc_locks(5))
            if fields[1:2] == ["FLOCK"] and fields[5:6] == [place] and int(fields[4]) > 0:
                return int(fields[4])
        try:  # locks of other containers, and on some file systems, are not in that list: whose it is, nobody tells
            fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise OSError(errno.ENOSYS, "who holds a lock", descriptor) from error
        unlock(descriptor)
        return None

    def unlock(descriptor: int) -> None:
        """Release a file before it is closed."""
        fcntl.flock(descriptor, fcntl.LOCK_UN)


def synchronise_names(directory: Path | str) -> None:
    """Write the names in a directory to the disk too, if the system can; subdirectories are not included.

    Raises:
        OSError: the disk failed, or is full.
    """
    try:
        descriptor = os.open(directory, os.O_RDONLY)
    except OSError:  # Windows opens no directories, and not every directory above may be read
        return
    try:
        os.fsync(descriptor)
    except OSError as error:  # network drives know no such thing
        if error.errno in {errno.EIO, errno.ENOSPC}:
            raise
    finally:
        os.close(descriptor)


_NOT_FOR_FORKS: Final[list[int]] = []
"""Descriptors of this process that a forked one must not keep open; of one who forgot, a number may stand twice."""


@contextmanager
def kept_from_forks(descriptor: int) -> Iterator[None]:
    """Keep `descriptor` from processes forked in the meantime.

    In a forked process the number stands for the null device.
    """
    _NOT_FOR_FORKS.append(descriptor)
    try:
        yield
    finally:
        with suppress(ValueError):  # in a forked process none stands there
            _NOT_FOR_FORKS.remove(descriptor)


def _let_go() -> None:
    if _NOT_FOR_FORKS:
        null = os.open(os.devnull, os.O_RDWR)
        for descriptor in _NOT_FOR_FORKS:
            os.dup2(null, descriptor)
        os.close(null)
        _NOT_FOR_FORKS.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_let_go)


def shown(path: Path | str) -> str:
    """Return the name of a file as it can be printed: quoted where it holds unprintable characters."""
    name = str(path)
    return name if name.isprintable() and name else ascii(name)


def is_utf8(text: str) -> bool:
    """Return True if a text can be written down; bytes of another encoding on a command line cannot."""
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


_AT_LINE: Final = re.compile(r"\(at line (\d+),")
_SHOWN: Final = 80
_CURES: Final = {
    r"Cannot overwrite": "the key stands above already: keep one of the two",
    r"Cannot declare|already": "the table stands above already: put its keys there",
    r"Unclosed|Expected ']'": "close the bracket: a list, or the name of a table, ends with ]",
    r"Expected '='": "write KEY = VALUE, or # before a remark",
    r"[\u2018-\u201e\u00ab\u00bb]": 'write straight quotes: "..."',
    r"=\s*[-+]?\d+,\d+": "write a decimal point, not a comma; numbers of a list stand in brackets",
    r"=\s*(\d{1,4}[-./]){2}\d{1,4}": "write a day as 2026-01-15: year, month, day, and without quotes",
    r"=\s*(True|False|TRUE|FALSE)": "write true or false, in small letters",
    r"=\s*[-+]?\.\d|=\s*[-+]?\d+\.(\s|$)": "write digits on both sides of the decimal point: 0.5, 1.0",
    r"=\s*[-+]?\d[\d.eE+-]*\s*[^\W\d]": "write the number alone: the unit is in the name of the key",
    r'"[^"]*\\': "write / for \\ in a path, or '...' around it",
    r"=\s*(\"[^\"]*|'[^']*)$": "write a quote at the end of the text too",
    r"=\s*[^\W\d]": 'write a text in quotes: "..."',
    r"=\s*(#|$)": "write a value behind =, or # before the key",
}
"""How to mend what people write for TOML, by a pattern of the reason and the line: the first that fits."""


def parse_toml(text: str, source: str) -> dict[str, Any]:
    """Return the table that TOML `text` describes, its numbers such as can be a setting; `source` names it in errors.

    Raises:
        ConfigError: it is not TOML, nested too deeply, or holds a number that is infinite, not one, too large for 64
            bits, or so close to zero that it has lost digits (below 2.2e-308).
    """
    if _LONG_KEY.search(text):
        raise ConfigError(f"{source}: expected TOML with keys of at most {DEEPEST} parts, got a longer one")
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        reason = "nested too deeply" if isinstance(error, RecursionError) else " ".join(str(error).split())
        found, lines = _AT_LINE.search(reason), text.rstrip().split("\n")
        line = lines[min(int(found[1]) if found else len(lines), len(lines)) - 1].strip()[:_SHOWN]
        cures = (cure for mistake, cure in _CURES.items() if re.search(mistake, line) or re.match(mistake, reason))
        said = f"{reason}: {shown(line)}" if line else reason
        raise ConfigError(f"{source}: expected TOML: {said}", hint=next(cures, None)) from None
    require_numbers(table, source)
    return table


def require_numbers(table: dict[str, Any], source: str) -> None:
    """Raise ConfigError if a number of `table` cannot be a setting, or if it is nested too deeply; see `parse_toml`."""
    for keys, expected, came in unfit_numbers(table):
        raise ConfigError(f"{source}: {dotted(keys)}: expected {expected}, got {came}")


def unfit_numbers(table: dict[str, Any]) -> Iterator[tuple[Keys, str, str]]:
    """Yield the keys of every number that cannot be a setting, the expected and the given one; as `parse_toml`.

    A table that is nested too deeply is told at its first keys.
    """
    waiting: list[tuple[Keys, Any]] = [((key,), value) for key, value in reversed(table.items())]
    while waiting:  # without recursion
        keys, value = waiting.pop()
        if len(keys) > DEEPEST:
            yield keys[:3], f"TOML: nested too deeply, {DEEPEST} at most", "more"
            return
        if (expected := _number_expected(value)) is not None:
            yield keys, expected, repr(value) if isinstance(value, float) else "a longer one"
        if isinstance(value, dict):
            waiting += [((*keys, key), below) for key, below in reversed(value.items())]
        elif isinstance(value, list):
            waiting += [((*keys, index), below) for index, below in reversed(list(enumerate(value)))]


def _number_expected(value: object) -> str | None:
    if isinstance(value, float) and not math.isfinite(value):
        return "a finite number"
    if isinstance(value, float) and 0.0 < abs(value) < sys.float_info.min:
        return f"zero or a number of at least {sys.float_info.min:.2g} either sign"
    if type(value) is int and not -_WHOLE <= value < _WHOLE:
        return "a whole number of 64 bits"
    return None


def dotted(keys: Iterable[str | int]) -> str:
    """Return keys in the notation of TOML."""
    bare = re.compile(r"[A-Za-z0-9_-]+")
    parts = (f"[{key}]" if isinstance(key, int) else f".{key if bare.fullmatch(key) else ascii(key)}" for key in keys)
    return "".join(parts).removeprefix(".")
