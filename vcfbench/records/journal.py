"""The journal of a run: JSON lines, one a step, on the disk before the next step begins.

The first line (`header`) says who ran what on which bench; each further one (`step`) holds one step with its result,
every raw reading included, or (`error`) the step that failed; the last (`footer`) says how the run ended. A run that
was cut has no footer. Each line ends with a seal over all that stands before it (`vcfbench.records.seal`). Readings of
a long step come before it, chunk by chunk (`readings`), so that a run that is cut in the middle of it loses the last
chunk at most. In that of a run that was resumed the lines of the one before come first, then what brought the bench to
where it was (`restored`). Bench time is in `t_s` and `end_s`, the time of day in `utc`. Every line and field is in
docs/records.md.

A reader ignores keys and types of lines that it does not know, so that a later version can add some.
"""

import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

import msgspec
from msgspec import Struct
from msgspec.structs import replace

from vcfbench.clock import WallClock, sleep, utc_now
from vcfbench.errors import BenchError, ConfigError
from vcfbench.files import failing_as, opened, shown, synchronise_names, try_lock, unlock
from vcfbench.records.damage import first_damage
from vcfbench.records.schema import FORMAT, LineKind, Point, Status
from vcfbench.records.seal import Sealer
from vcfbench.records.signing import SigningKey

_EXPECTED = "the journal of a run"
_LONGEST_LINE = 1 << 24  # Bytes: a file without line ends is not read into memory whole
_INSTANT_S = 0.2

_FLAGS = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)


class Journal:
    """An append-only file; never opens one that is there already.

    Raises:
        BenchError: the file cannot be made, or a line not be written whole (disk full, file system gone).
    """

    __slots__ = ("_descriptor", "_sealer", "_size", "path")

    def __init__(self, path: Path) -> None:
        self.path = path
        self._size = 0
        self._sealer = Sealer()
        with failing_as(BenchError, f"the record {path} cannot be written"):
            self._descriptor = os.open(path, _FLAGS, 0o644)
        _locked(self._descriptor)  # without locks nobody is kept from anything

    def header(self, values: Mapping[str, Any]) -> None:
        """Write the first line, and see that the record is found after a power cut: the names above it may be new."""
        self._append({"type": "header", "format": FORMAT, "utc": _stamp(), **values})
        self._see_names_to_disk()

    def write(self, kind: LineKind, values: Mapping[str, Any]) -> None:
        """Write a line of a `kind` between header and footer: `step`, `readings`, `error`, ..."""
        self._append({"type": kind, "utc": _stamp(), **values})

    def footer(self, values: Mapping[str, Any]) -> None:
        """Write the last line."""
        self.write("footer", values)

    def signature(self, key: SigningKey) -> None:
        """Sign all lines until now."""
        if self._sealer.seal is not None:
            self.write("signature", key.signature(self._sealer.seal))

    def lines(self) -> Iterator[dict[str, Any]]:
        """Yield all lines until now, in order."""
        return lines_of(self.path)

    def close(self) -> None:
        """Give the file back."""
        os.close(self._descriptor)

    def _see_to_disk(self) -> None:
        """Have all lines on the disk before anything else happens."""
        _sync(self._descriptor)

    def _see_names_to_disk(self) -> None:
        """Have the name of the record on the disk, and those of the directories that it lies in."""
        with failing_as(BenchError, f"the record {self.path} may be lost by a power cut"):
            for directory in self.path.absolute().parents[:3]:
                synchronise_names(directory)

    def _append(self, line: Mapping[str, Any]) -> None:
        """Write one line with one system call, so that no other can come between, and see it to the disk.

        One that the disk does not take whole is taken back: what is written later shall not be joined to its rest.
        """
        data = self._sealer.sealed(msgspec.json.encode(line))
        try:
            written = os.write(self._descriptor, data)
            if written == len(data):
                self._see_to_disk()
        except OSError as error:
            self._take_back()
            raise self._refused(str(error.strerror)) from error
        if written != len(data):
            self._take_back()
            raise self._refused(f"the disk took {written} of {len(data)} bytes")
        self._sealer.keep()
        self._size += len(data)

    def _refused(self, why: str) -> BenchError:
        on = f"vcfbench resume {shown(self.path.parent)}" if self._size else "run it again"
        return BenchError(f"the record {self.path} cannot be written: {why}", hint=f"free space on its disk, then {on}")

    def _take_back(self) -> None:
        """Truncate the file to the lines before one that failed."""
        with suppress(OSError):  # what is left of it is found when the record is read
            os.ftruncate(self._descriptor, self._size)


class SimulatedJournal(Journal):
    """The journal of a run on a simulated bench: on the disk at its end, before that when the system brings it there.

    A program that is killed loses nothing. What a power cut takes was not measured: the seed gives it again.
    """

    __slots__ = ()

    def footer(self, values: Mapping[str, Any]) -> None:
        """Write the last line, and see all of them to the disk."""
        super().footer(values)
        with failing_as(BenchError, f"the record {self.path} may be lost by a power cut"):
            _sync(self._descriptor)

    def _see_to_disk(self) -> None:
        """Leave it to the system: steps follow each other faster than a disk takes them."""

    _see_names_to_disk = _see_to_disk


class MemoryJournal(Journal):
    """The journal of a run without a record: it has no file, and ends with the run."""

    __slots__ = ("_written",)

    def __init__(self) -> None:
        self._written: list[bytes] = []

    def signature(self, key: SigningKey) -> None:
        """Sign nothing: it is gone with the run."""

    def lines(self) -> Iterator[dict[str, Any]]:
        """Yield all lines until now, in order."""
        return map(msgspec.json.Decoder(dict[str, Any]).decode, self._written)

    def close(self) -> None:
        """Do nothing: the lines can still be read."""

    def _see_names_to_disk(self) -> None:
        """Nothing has a name."""

    def _append(self, line: Mapping[str, Any]) -> None:
        self._written.append(msgspec.json.encode(line))


def _sync(descriptor: int) -> None:
    if sys.platform in {"darwin", "win32"}:
        os.fsync(descriptor)
    else:
        os.fdatasync(descriptor)


def _stamp() -> str:
    return utc_now().isoformat(timespec="microseconds")


def append_line(path: Path, values: Mapping[str, Any], key: SigningKey | None = None) -> None:
    """Add a line to a finished journal, in place of a torn last line.

    With a `key` a further line signs it.

    Raises:
        BenchError: a run goes on that writes it, or it cannot be written.
    """
    with failing_as(BenchError, f"the record {shown(path)} cannot be written"):
        descriptor = os.open(path, os.O_RDWR | os.O_APPEND | getattr(os, "O_BINARY", 0))
        try:
            if not _locked(descriptor):
                raise BenchError(f"the record {shown(path)} is being written: its run goes on")
            with os.fdopen(descriptor, "rb", closefd=False) as file:
                data = file.read()
            kept = data[: data.rfind(b"\n") + 1]
            sealer = Sealer(kept.replace(b"\r\n", b"\n"))
            lines = sealer.sealed(msgspec.json.encode({**values, "utc": _stamp()}))
            sealer.keep()
            if key is not None and sealer.seal is not None:
                signature = {"type": "signature", "utc": _stamp(), **key.signature(sealer.seal)}
                lines += sealer.sealed(msgspec.json.encode(signature))
            if len(kept) < len(data):
                os.ftruncate(descriptor, len(kept))
            written = 0
            try:
                written = os.write(descriptor, lines)
                _sync(descriptor)
            except OSError:
                written = 0
                raise
            finally:
                if written != len(lines):
                    os.ftruncate(descriptor, len(kept))
        finally:
            os.close(descriptor)
    if written != len(lines):
        raise BenchError(f"the record {shown(path)} cannot be written: the disk took {written} of {len(lines)} bytes")


def _locked(descriptor: int) -> bool:
    """Lock a journal until it is closed; True as well where the file system has no locks.

    Who asks whether a run goes on has the lock for an instant: that is no run.
    """
    clock = WallClock()
    try:
        while not (locked := try_lock(descriptor)) and clock.now() < _INSTANT_S:
            sleep(clock, _INSTANT_S / 10)
    except OSError:
        return True
    return locked


class JournalRecord(Struct, frozen=True):
    """Contents of a journal.

    `torn` tells that it ends in the middle of a line, as that of a run that was cut does; `damage` says in words what a
    journal cannot have by itself, however the run ended: somebody, or a disk, has changed it since.
    """

    header: Mapping[str, Any]
    steps: tuple[Mapping[str, Any], ...]
    errors: tuple[Mapping[str, Any], ...]
    footer: Mapping[str, Any] | None
    torn: bool
    damage: str | None = None
    chunks: tuple[Mapping[str, Any], ...] = ()
    restored: tuple[Mapping[str, Any], ...] = ()
    lines: tuple[Mapping[str, Any], ...] = ()  # All of them, in the order of the file, without their seals
    running: bool = False  # True while its run goes on
    seals: tuple[str | None, ...] = ()  # Seal of each line; None where one has none, which is damage

    @property
    def seal(self) -> str | None:
        """Seal of the last whole line, which vouches for all of them."""
        return self.seals[-1] if self.seals else None

    @property
    def status(self) -> Status:
        """Status of the run; a record without a readable last line is incomplete, or of a run that goes on."""
        if self.damage is not None:
            return Status.DAMAGED
        if self.footer is None or self.torn:
            return Status.RUNNING if self.running else Status.INCOMPLETE
        return Status(self.footer["status"])

    @property
    def points(self) -> tuple[Point, ...]:
        """Every averaged point that is on the disk."""
        return tuple(Point.from_json(step["point"]) for step in self.steps if "point" in step)


def read_journal(path: Path) -> JournalRecord:
    """Read a journal, whole or cut at any byte.

    Raises:
        ConfigError: the file is not there, is no journal of a known format, or was not written by a Journal.
    """
    with opened(path, _EXPECTED) as file:
        running = being_written(path)  # asked for before it is read: it may end meanwhile, and then has its last line
        lines, torn, unreadable = _whole_lines(file)
    seals = [line.pop("seal", None) for line in lines]
    header = lines[0] if lines and lines[0].get("type") == "header" else {}
    number = header.get("format", FORMAT)
    if type(number) is not int or number != FORMAT:
        raise ConfigError(f"{shown(path)}: a record of format {number!r}; this version reads format {FORMAT}")
    footers = _of_type(lines, "footer")
    record = JournalRecord(
        header,
        _of_type(lines, "step"),
        _of_type(lines, "error"),
        footers[-1] if footers else None,
        torn=torn,
        chunks=_of_type(lines, "readings"),
        restored=_of_type(lines, "restored"),
        lines=tuple(lines),
        running=running,
        seals=tuple(seal if isinstance(seal, str) else None for seal in seals),
    )
    try:
        _ = record.status, record.points, record.header.get("bench", {}).get("name")
        _ = None if (error := (record.footer or {}).get("error")) is None else error.get("what")
        return replace(record, damage=unreadable or first_damage(lines))
    except (ArithmeticError, AttributeError, KeyError, TypeError, ValueError, ConfigError) as error:
        raise ConfigError(f"{shown(path)}: {unreadable or f'no record of this program: {error!r}'}") from error


def being_written(path: Path) -> bool:
    """Return True if a run goes on that writes this journal; the system drops its lock when the process dies."""
    try:
        descriptor = os.open(path, os.O_RDWR)
    except OSError:
        return False
    try:
        if os.fstat(descriptor).st_size == 0:  # it may be about to be locked, and nobody is to come in between
            return False
        if not try_lock(descriptor):
            return True
        unlock(descriptor)
    except OSError:  # a file system without locks tells nothing
        return False
    else:
        return False
    finally:
        os.close(descriptor)


def read_header(path: Path) -> Mapping[str, Any]:
    """Return the first line of a journal, empty when it is none; ConfigError when it is no file that can be read."""
    with opened(path, _EXPECTED) as file:
        line = file.readline(_LONGEST_LINE)
    header = _decoded(line) if line.endswith(b"\n") else None
    return header if header is not None and header.get("type") == "header" else {}


def lines_of(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the lines of a journal, one at a time, up to the first that is not whole: a long one needs no memory.

    Raises:
        ConfigError: it is no file that can be read.
    """
    with opened(path, _EXPECTED) as file:
        while (line := file.readline(_LONGEST_LINE)).endswith(b"\n") and (values := _decoded(line)) is not None:
            yield values


def _whole_lines(file: IO[bytes]) -> tuple[list[dict[str, Any]], bool, str | None]:
    """Return the lines up to the first that is not a whole JSON object, True if it is torn, and any other damage.

    What comes after such a line proves nothing.
    """
    lines: list[dict[str, Any]] = []
    sealer, wrong = Sealer(), None
    while line := file.readline(_LONGEST_LINE):
        number = len(lines) + 1
        if not line.endswith(b"\n"):
            if len(line) == _LONGEST_LINE:
                wrong = wrong or f"line {number} has more than {_LONGEST_LINE} bytes"
            elif lines and sealer.holds(line[:-1] + b"\n"):
                wrong = wrong or f"line {number} was changed: its end differs"
            return lines, True, wrong
        if (values := _decoded(line)) is None:
            return lines, False, wrong or f"line {number} is no JSON object"
        lines.append(values)
        plain = line[:-2] + b"\n" if line.endswith(b"\r\n") else line  # a copy may have made that of it
        if wrong is None and not sealer.holds(plain):
            wrong = f"line {number} was changed: its seal differs"
    return lines, not lines, wrong


def _decoded(line: bytes) -> dict[str, Any] | None:
    try:
        return msgspec.json.decode(line, type=dict[str, Any])
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None


def _of_type(lines: Sequence[Mapping[str, Any]], kind: str) -> tuple[Mapping[str, Any], ...]:
    return tuple(line for line in lines if line.get("type") == kind)
