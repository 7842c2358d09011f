"""Traces as tests: a driver against the recorded answers of an instrument.

::

    with replay_trace("meter.trace", over_visa(Hp34401A), role="multimeter") as meter:
        assert meter.read_voltage_v() == 10.0

A trace is what ``--trace FILE`` writes. Each answer comes at its time, on a clock that nobody waits for.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn, TypeVar

from vcfbench import errors
from vcfbench.clock import Deadline, VirtualClock
from vcfbench.drivers.trace import HEADER, TraceLine, escaped, unescaped
from vcfbench.drivers.wire import Interface
from vcfbench.errors import ConfigError, LinkLost, TransportError
from vcfbench.files import MOST_TABLE, read_text

_T = TypeVar("_T")


def read_trace(path: Path | str) -> list[TraceLine]:
    """Return the lines of a trace, of all instruments, in their order.

    Raises:
        ConfigError: it is no trace, or a line of it is none.
    """
    first, *rest = read_text(path, "a trace", MOST_TABLE).split("\n")
    if first != HEADER:
        raise ConfigError(f"{path}: expected a trace, which begins with {HEADER!r}")
    lines = []
    for number, text in enumerate(rest, start=2):
        try:
            if text:
                seconds, role, resource, mark, data = text.split("\t")
                lines.append(TraceLine(float(seconds), role, resource, mark, unescaped(data)))
        except (ValueError, KeyError):
            expected = "seconds, role, resource, mark and text with tabs between them"
            raise ConfigError(f"{path}:{number}: expected {expected}") from None
    return lines


class ReplayWire:
    """A wire that answers as an instrument once did, and complains about everything that it was not asked then.

    `lines` are those of one connection. A complaint is kept, for drivers that swallow it.
    """

    def __init__(self, lines: Sequence[TraceLine], *, clock: VirtualClock) -> None:
        opened, *self._left = lines
        self.interface: Interface = opened.data.decode("ascii").partition(" ")[0]  # type: ignore[assignment]
        self._clock = clock
        self._complaint: AssertionError | None = None
        self._closed = False

    def _complain(self, what: str) -> NoReturn:
        __tracebackhide__ = True  # whoever reads the failure wants to see who asked
        then = f"{self._left[0].mark} {escaped(self._left[0].data)}" if self._left else "nothing more"
        when = f" at {self._left[0].t_s:.6f} s" if self._left else ""
        self._complaint = self._complaint or AssertionError(f"{what}; in the trace there is{when}: {then}")
        raise self._complaint

    def _next(self, *marks: str) -> TraceLine | None:
        """Return the next line if its mark is one of these; the clock is then as late as it was."""
        if not self._left or self._left[0].mark not in marks:
            return None
        line = self._left.pop(0)
        self._clock.sleep_until(line.t_s)
        return line

    def _fail_as_then(self) -> None:
        """Raise the recorded error at this place, if there was one."""
        line = self._next("!")
        if line is not None:
            kind, _, words = line.data.decode("latin-1").partition(" ")
            known = getattr(errors, kind, None)
            raise (known if isinstance(known, type) and issubclass(known, TransportError) else TransportError)(words)

    def send(self, data: bytes, deadline: Deadline) -> None:
        """Compare `data` with the recorded message."""
        __tracebackhide__ = True
        if self._closed:
            raise LinkLost("the connection is closed")
        if not (self._left and self._left[0].mark == ">" and self._left[0].data == data):
            self._complain(f"{escaped(data)} was sent")
        self._next(">")
        self._fail_as_then()

    def receive(self, deadline: Deadline) -> tuple[bytes, bool]:
        """Return the recorded answer, or fail as recorded."""
        __tracebackhide__ = True
        self._fail_as_then()
        line = self._next("<", "<|")
        if line is None:
            self._complain("an answer was waited for")
        return line.data, line.mark == "<|"

    def pending(self) -> bytes:
        """Return the recorded unasked bytes at this place."""
        line = self._next("<?")
        return b"" if line is None else line.data

    def clear(self, deadline: Deadline) -> None:
        """Do a device clear, as then."""
        __tracebackhide__ = True
        if self._next("clear") is None:
            self._complain("a device clear was done")
        self._fail_as_then()

    def close(self) -> None:
        """Note that the connection was given back."""
        self._closed = True
        self._next("close")

    def require_done(self, *, whole: bool = True) -> None:
        """Raise AssertionError when something else was asked than then, or, with `whole`, less."""
        __tracebackhide__ = True
        if self._complaint is not None:
            raise self._complaint
        missing = [escaped(line.data) for line in self._left if line.mark == ">"] if whole else []
        if missing:
            shown = ", ".join(missing[:5])
            raise AssertionError(f"{len(missing)} of the trace's messages were not sent: {shown}")


@contextmanager
def replay_trace(
    path: Path | str, opener: Callable[[ReplayWire, VirtualClock], _T], *, role: str | None = None, whole: bool = True
) -> Iterator[_T]:
    """Open a driver on a wire that answers from the trace at `path`.

    Args:
        path: what ``--trace`` wrote.
        opener: what makes a driver of wire and clock: `over_visa(...)`, `over_serial(...)`.
        role: whose lines, those of its first connection; needed where the trace has several instruments.
        whole: everything that was sent then must be sent; else only the beginning.

    Raises:
        ConfigError: the file is no trace, or has no such lines.
        AssertionError: something else was sent or waited for than then (at once, and at the end if the driver swallowed
            that); at the end, something was not sent.
    """
    __tracebackhide__ = True
    clock = VirtualClock()
    lines = read_trace(path)
    path = str(path)
    roles = list(dict.fromkeys(line.role for line in lines))
    wanted = roles[0] if role is None and len(roles) == 1 else role
    if wanted not in roles:
        raise ConfigError(f"{path}: role {role!r}: expected one of {', '.join(roles) or 'none, for it is empty'}")
    own = [line for line in lines if line.role == wanted]
    starts = [index for index, line in enumerate(own) if line.mark == "open"]
    if not starts:
        raise ConfigError(f"{path}: {wanted} was not connected in it")
    wire = ReplayWire(own[starts[0] : (starts[1:] or [len(own)])[0]], clock=clock)
    yield opener(wire, clock)
    wire.require_done(whole=whole)
