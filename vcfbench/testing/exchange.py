"""Protocol tests: a driver against a list of messages on the wire, so that its test reads like its manual.

::

    reading = [("INIT", None), ("FETC?", "+1.00000000E+01"), ("FETC?", "+1.00000000E+01")]
    with expected_exchange(over_visa(Hp34401A), [*OPENING, *reading]) as meter:
        assert meter.read_voltage_v() == 10.0
"""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import NoReturn, TypeVar

from vcfbench.clock import Clock, Deadline, VirtualClock
from vcfbench.drivers.rate_table.line import TableLine
from vcfbench.drivers.session import Session
from vcfbench.drivers.wire import Interface, Wire
from vcfbench.errors import DeadlineExceeded, LinkLost

_T = TypeVar("_T")

Message = str | bytes
Exchange = tuple[Message, Message | None]
"""A message sent and its answer. Text is without its newline, bytes are literal; None is no answer."""


def _bytes(message: Message) -> bytes:
    return message if isinstance(message, bytes) else message.encode("ascii") + b"\n"


class ScriptedWire:
    """A wire with scripted answers, which reports every unexpected message.

    It fits under sessions and under lines of rate tables. Time-outs take the clock's time. A complaint is kept, for
    drivers that swallow it.
    """

    def __init__(self, exchanges: Sequence[Exchange], *, clock: Clock, interface: Interface = "gpib") -> None:
        self.interface: Interface = interface
        self.clears = 0
        self.closed = False
        self._clock = clock
        self._left = list(exchanges)
        self._sent = 0
        self._answers: deque[bytes] = deque()
        self._complaint: AssertionError | None = None

    def send(self, data: bytes, deadline: Deadline) -> None:
        """Compare `data` with the next message."""
        __tracebackhide__ = True  # whoever reads the failure wants to see who sent it
        if self.closed:
            raise LinkLost("the connection is closed")
        self._sent += 1
        if not self._left:
            self._complain(f"{data!r} was sent after the last of the expected messages")
        expected, answer = self._left.pop(0)
        if data != _bytes(expected):
            self._complain(f"{data!r} was sent where {_bytes(expected)!r} was expected")
        if answer is not None:
            self._answers += _bytes(answer).splitlines(keepends=True) if isinstance(answer, str) else [answer]

    def _complain(self, what: str) -> NoReturn:
        __tracebackhide__ = True
        self._complaint = self._complaint or AssertionError(f"unexpected: {what} (message {self._sent})")
        raise self._complaint

    def receive(self, deadline: Deadline) -> tuple[bytes, bool]:
        """Return the answer, or wait for the deadline in vain; when that is over nothing is received any more."""
        if not self._answers or deadline.expired():
            self._clock.sleep_until(deadline.expires_s)
            raise DeadlineExceeded("no answer")
        return self._answers.popleft(), True

    def pending(self) -> bytes:
        """Return nothing: a scripted instrument does not speak unasked."""
        return b""

    def clear(self, deadline: Deadline) -> None:
        """Count a device clear and forget the answer."""
        self.clears += 1
        self._answers.clear()

    def close(self) -> None:
        """Note that the connection was given back."""
        self.closed = True

    def require_done(self) -> None:
        """Raise AssertionError when a message was unexpected, has not been sent, or an answer has not been read."""
        __tracebackhide__ = True
        if self._complaint is not None:
            raise self._complaint
        if self._left:
            missing = ", ".join(repr(_bytes(sent)) for sent, _ in self._left)
            raise AssertionError(f"missing: {missing} never came")
        if self._answers:
            raise AssertionError(f"unread: {b''.join(self._answers)!r} was answered and not read")


Opener = Callable[["Wire", VirtualClock], _T]
"""Makes a driver of a wire and the clock that its time-outs take."""


@contextmanager
def expected_exchange(
    opener: Opener[_T], exchanges: Sequence[Exchange], *, interface: Interface = "gpib"
) -> Iterator[_T]:
    """Open a driver on a wire that expects exactly `exchanges`.

    Raises:
        AssertionError: a message was sent that was not expected (at once, and at the end if the driver swallowed that);
            at the end, one is missing, or an answer is unread.
    """
    __tracebackhide__ = True
    clock = VirtualClock()
    wire = ScriptedWire(exchanges, clock=clock, interface=interface)
    yield opener(wire, clock)
    wire.require_done()


def over_visa(
    make: Callable[[Session], _T], *, name: str = "instrument", timeout_s: float = 1.0, write_pause_s: float = 0.0
) -> Opener[_T]:
    """Return an opener of a driver that takes a :class:`~vcfbench.drivers.session.Session`."""

    def opener(wire: Wire, clock: VirtualClock) -> _T:
        return make(
            Session(wire, name=name, resource="SCRIPT", clock=clock, timeout_s=timeout_s, write_pause_s=write_pause_s)
        )

    return opener


def over_serial(make: Callable[[TableLine], _T], *, name: str = "rate_table", timeout_s: float = 1.0) -> Opener[_T]:
    """Return an opener of a driver that takes a :class:`~vcfbench.drivers.rate_table.line.TableLine`."""

    def opener(wire: Wire, clock: VirtualClock) -> _T:
        return make(TableLine(wire, name=name, resource="script://", clock=clock, timeout_s=timeout_s))

    return opener
