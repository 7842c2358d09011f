r"""Traces: every byte between programs and instruments, with its time, in a file of lines.

A trace is asked for around whatever opens instruments (:func:`traced`); sessions and lines that are opened in there put
their wire behind one that writes down what passes. Without a trace nothing stands in between.

A line has five fields with tabs between them: bench time in s, role, resource, mark, text. The text is ASCII, all else
escaped as ``\n``, ``\r``, ``\t``, ``\\`` and ``\xNN``; docs/console.md has the marks.
"""

import os
import re
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import TextIO

from msgspec import Struct

from vcfbench.clock import Clock, Deadline, WallClock, utc_now
from vcfbench.drivers.wire import Interface, Wire
from vcfbench.errors import BenchError, ConfigError, TransportError

Connect = Callable[[Deadline], Wire]
Behind = Callable[[str, str, Clock, Connect], Connect]
"""Puts the wires of an instrument, of that name, resource and clock, behind others."""

BEHIND: ContextVar[tuple[Behind, ...]] = ContextVar("vcfbench_behind", default=())
"""What stands before the wires that are opened here. It belongs to a context and not to the process: two threads may
have two."""

HEADER = "# vcfbench trace 1"
_ESCAPED = re.compile(r"(?:[ -\[\]-~]|\\(?:[nrt\\]|x[0-9a-f]{2}))*")


class TraceLine(Struct, frozen=True):
    """One line of a trace: time (bench time, s), role, resource, direction, and its text or bytes."""

    t_s: float
    role: str
    resource: str
    mark: str
    data: bytes = b""

    def __str__(self) -> str:
        return "\t".join((f"{self.t_s:.6f}", self.role, self.resource, self.mark, escaped(self.data)))


def escaped(data: bytes) -> str:
    """Return bytes as printable ASCII without tabs."""
    return data.decode("latin-1").encode("unicode_escape").decode("ascii")


def unescaped(text: str) -> bytes:
    """Return the bytes of an escaped `text`; ValueError if :func:`escaped` cannot have made it."""
    if not _ESCAPED.fullmatch(text):  # of others the codec warns
        raise ValueError(f"{text!r} has an escape sequence that a trace does not use")
    return text.encode("ascii").decode("unicode_escape").encode("latin-1")


class _Trace:
    """An open trace. An error of its file ends the trace and nothing else; it is told at the end."""

    def __init__(self, file: TextIO) -> None:
        self.failure: OSError | None = None
        self._file = file
        self._lock = threading.Lock()

    def write(self, line: TraceLine | str) -> None:
        """Write a line, whole, whichever thread it comes from."""
        with self._lock:
            if self.failure is not None:
                return
            try:
                self._file.write(f"{line}\n")
            except (OSError, ValueError) as error:  # ValueError: a thread that was left behind, after the end
                self.failure = error if isinstance(error, OSError) else None


@contextmanager
def traced(path: Path | str | None) -> Iterator[None]:
    """Write everything that passes between here and the instruments that are opened in here to the file at `path`.

    A file that is there is written anew. None writes nothing.

    Raises:
        ConfigError: the file cannot be written.
        BenchError: at the end, when all else went well: the trace is not whole.
    """
    if path is None:
        yield
        return
    try:
        # line by line: none of it is to be lost
        file = open(path, "w", encoding="ascii", buffering=1, opener=_opened)  # noqa: SIM115
    except (OSError, ValueError) as error:
        raise ConfigError(f"--trace {path}: cannot be written: {getattr(error, 'strerror', None) or error}") from None
    trace = _Trace(file)
    trace.write(HEADER)

    def tapped(name: str, resource: str, clock: Clock, connect: Connect) -> Connect:
        return lambda deadline: TracedWire(connect(deadline), trace, name, resource, clock)

    token = BEHIND.set((*BEHIND.get(), tapped))
    try:
        yield
    finally:
        BEHIND.reset(token)
        try:
            file.close()
        except OSError as error:
            trace.failure = error
    if trace.failure is not None:
        raise BenchError(f"the trace {path} is not whole: {trace.failure.strerror or trace.failure}")


def _opened(path: str, flags: int) -> int:
    """Open without waiting for who reads a pipe, and never to wait for its room: a run does not stop for its trace."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0), 0o666)


class TracedWire:
    """A wire that writes down the traffic over another."""

    def __init__(self, wire: Wire, trace: _Trace, name: str, resource: str, clock: Clock) -> None:
        self.interface: Interface = wire.interface
        self._wire = wire
        self._trace = trace
        self._name = name
        self._resource = resource
        self._clock = clock
        began = f" {utc_now().isoformat(timespec='milliseconds')}" if isinstance(clock, WallClock) else ""
        self._note("open", f"{wire.interface}{began}".encode("ascii"))

    def _note(self, mark: str, data: bytes = b"") -> None:
        self._trace.write(TraceLine(self._clock.now(), self._name, self._resource, mark, data))

    @contextmanager
    def _failures(self) -> Iterator[None]:
        try:
            yield
        except TransportError as error:
            self._note("!", f"{type(error).__name__} {error.what}".encode("latin-1", "replace"))
            raise

    def send(self, data: bytes, deadline: Deadline) -> None:
        """Send all of `data`."""
        self._note(">", data)
        with self._failures():
            self._wire.send(data, deadline)

    def receive(self, deadline: Deadline) -> tuple[bytes, bool]:
        """Return at least one byte, and True if the instrument marked the last one as the end of its message."""
        with self._failures():
            data, end = self._wire.receive(deadline)
        self._note("<|" if end else "<", data)
        return data, end

    def pending(self) -> bytes:
        """Take unasked bytes."""
        with self._failures():
            data = self._wire.pending()
        if data:
            self._note("<?", data)
        return data

    def clear(self, deadline: Deadline) -> None:
        """Do a device clear."""
        self._note("clear")
        with self._failures():
            self._wire.clear(deadline)

    def close(self) -> None:
        """Give the connection back."""
        self._note("close")
        self._wire.close()
