"""Common parts of a SCPI session and the line to a rate table: an open wire, its failures, and blind commands."""

import threading
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from typing import Any, ClassVar, Self, TypeVar

from vcfbench.clock import Clock, Deadline, WallClock, sleep, within
from vcfbench.drivers.replies import likely_cause
from vcfbench.drivers.trace import BEHIND, Connect
from vcfbench.drivers.wire import Wire
from vcfbench.errors import (
    BenchError,
    DeadlineExceeded,
    FramingError,
    InstrumentError,
    LinkLost,
    OutOfSync,
    TransportError,
)
from vcfbench.interfaces import UnprovedCommand

_E = TypeVar("_E", bound=BenchError)

_BLIND_S = 0.3
"""Wall time that sending words blind may take."""
_LONGEST_SHOWN = 200


class Conversation:
    """A wire to one instrument: one exchange at a time, each before a deadline."""

    commands_are_answered: ClassVar[bool] = False
    """Whether words that are sent blind leave answers behind."""

    def __init__(
        self,
        wire: Wire,
        *,
        name: str,
        resource: str,
        clock: Clock,
        timeout_s: float,
        reconnect: Connect | None = None,
    ) -> None:
        self.name = name
        self.resource = resource
        self.clock = clock
        self.timeout_s = timeout_s
        self.dirty = False
        """Whether an exchange broke off: the place must be found again before anything is asked."""
        self._wire = wire
        self._reconnect = reconnect
        self._lock = threading.RLock()
        self._received = b""
        self._connected_s = WallClock().now()
        self._said: str | None = None
        """What was said last."""
        self._came = b""
        """The line that came last."""
        self._closed_because: str | None = None
        self._given_back = False
        self._last_read: tuple[str, float] | None = None

    @classmethod
    def opened(
        cls,
        connect: Connect,
        *,
        name: str,
        resource: str,
        clock: Clock,
        timeout_s: float,
        open_timeout_s: float | None = None,
        **more: Any,
    ) -> Self:
        """Return a conversation on the wire that `connect` opens, now and at each reconnection.

        `name` is the role on the bench, for messages; an exchange may take `timeout_s` unless its caller says
        otherwise, and connecting `open_timeout_s`, by default the same.
        """
        for behind in BEHIND.get():
            connect = behind(name, resource, clock, connect)
        try:
            wire = connect(Deadline.after(clock, timeout_s if open_timeout_s is None else open_timeout_s))
        except TransportError as error:
            error.instrument, error.resource = name, resource
            raise
        return cls(wire, name=name, resource=resource, clock=clock, timeout_s=timeout_s, reconnect=connect, **more)

    @property
    def closed(self) -> bool:
        """Return True if the connection has been given back or given up."""
        return self._closed_because is not None

    @property
    def where(self) -> dict[str, Any]:
        """Names of instrument and resource, for errors."""
        return {"instrument": self.name, "resource": self.resource}

    def exclusive(self) -> AbstractContextManager[bool]:
        """Keep other threads out for several exchanges."""
        return self._lock

    def deadline(self, seconds: float | None = None) -> Deadline:
        """Return a deadline `seconds` from now, by default the connection's time-out."""
        return Deadline.after(self.clock, self.timeout_s if seconds is None else seconds)

    @contextmanager
    def exchange(self, command: str | None, deadline: Deadline) -> Iterator[None]:
        """Exclude other threads for one exchange; add instrument and place to an error or a refusal."""
        with self._lock:
            try:
                yield
            except TransportError as error:
                raise self.locate(error, command, deadline)  # noqa: B904 - the same error, now knowing where
            except InstrumentError as error:
                error.instrument, error.resource = error.instrument or self.name, error.resource or self.resource
                error.command = error.command or command or self._said
                raise

    @contextmanager
    def resynchronising(self, question: str | None, deadline: Deadline) -> Iterator[None]:
        """Find the place again by `question`; where that fails the error is OutOfSync, or LinkLost."""
        try:
            yield
        except LinkLost as error:
            raise self.locate(error, question, deadline)  # noqa: B904 - the same error, now knowing where
        except (TransportError, InstrumentError) as error:
            silent = isinstance(error, DeadlineExceeded) and " but " not in error.what
            came = f" but {self._came[:_LONGEST_SHOWN]!r}" if silent and self._came else ""
            what = f"the answers no longer belong to the questions ({error.what}{came}), the connection was closed"
            hint = self._cause() or "check the cable; --trace FILE shows what was sent and what came"
            lost = OutOfSync(what, hint=hint)
            raise self.locate(lost, question, deadline) from error
        self.dirty = False

    def locate(self, error: TransportError, command: str | None, deadline: Deadline) -> TransportError:
        """Add instrument and place to `error`; close a lost connection."""
        error.instrument = error.instrument or self.name
        error.resource = error.resource or self.resource
        # An answer that cannot be read is found out after its exchange, where a driver reads it
        command = command or (self._said if isinstance(error, FramingError) else None)
        error.command = error.command or (None if command is None else shown(command))
        error.elapsed_s = deadline.elapsed() if error.elapsed_s is None else error.elapsed_s
        if error.hint is None and isinstance(error, FramingError):
            error.hint = self._cause()
        if isinstance(error, (LinkLost, OutOfSync)):
            self._give_up(error.what)
        return error

    @property
    def on_port(self) -> bool:
        """True on a serial port, whose speed may differ from the instrument's."""
        return self._wire.interface in ("asrl", "serial") and "://" not in self.resource

    def _with_what_came(self, late: DeadlineExceeded, received: bytes) -> DeadlineExceeded:
        """Return `late` with the part of an answer that has come: it has no end, or is less than it was to be."""
        if received:
            self._came = received
            late.what += f" but {received[:60]!r}"
            late.hint = late.hint or self._cause()
        return late

    def _cause(self) -> str | None:
        return likely_cause(self._came, self._said, on_port=self.on_port)

    def note_read(self, what: str) -> None:
        """Remember a read-back, in words, for messages when the instrument no longer answers."""
        self._last_read = what, self.clock.now()

    def unproved(self, words: str, *, sent: bool) -> UnprovedCommand:
        """Return the last command without proof, with the last read-back."""
        if self._last_read is None:
            return UnprovedCommand(words, sent)
        what, at_s = self._last_read
        try:
            age_s = self.clock.now() - at_s
        except Exception:  # noqa: BLE001 - a bench's clock may be gone with the bench; what was read is still known
            return UnprovedCommand(words, sent, what)
        return UnprovedCommand(words, sent, what, age_s)

    def _require_open(self) -> None:
        if self._closed_because is not None:
            raise LinkLost(f"the connection is closed ({self._closed_because})", **self.where)

    def _give_up(self, because: str) -> None:
        if self._closed_because is None:
            self._closed_because, self.dirty = because, True
            self._wire.close()

    def close(self) -> None:
        """Close the connection for good, also if another thread is reconnecting."""
        self._given_back = True
        self._give_up("it was given back")

    def _renew(self, deadline: Deadline, words: Sequence[bytes], gap_s: float = 0.0) -> None:
        """Make a new connection, if that can be; `words` are the first that are said there."""
        if self._reconnect is None or self._given_back:
            self._require_open()
            return
        self._give_up("it was replaced by a new one")
        self._wire = self._reconnect(deadline)
        if self._given_back:
            self._wire.close()
            self._require_open()
        self._connected_s = WallClock().now()
        self._closed_because, self._received, self.dirty = None, b"", True
        self._send_blind(words, gap_s)

    def say_blind(self, words: Sequence[bytes], gap_s: float = 0.0) -> bool:
        """Send `words` at once, without waiting or raising; return True if the wire took them.

        Nor is the lock waited for: another thread may hang in an exchange. A connection that is gone is made anew.
        `gap_s` is left between the words if that is short.
        """
        taken: list[bool] = []  # the latest that is known when the time is up
        within(_BLIND_S, lambda: self._speak_blind(words, gap_s, taken))
        return bool(taken and taken[-1])

    def _speak_blind(self, words: Sequence[bytes], gap_s: float, taken: list[bool]) -> None:
        with suppress(Exception):  # a library is anyone's code, and the other instruments must hear their words
            try:
                self._require_open()
                self.dirty = self.dirty or self.commands_are_answered
                self._send_blind(words, gap_s)
                taken.append(True)
                if self._wire.pending():  # also finds out that the other end has gone, which sending did not
                    self.dirty = True
            except LinkLost:
                taken.append(False)
                # Whoever holds the lock meanwhile is connecting anew already
                if self._reconnect is None or not self._lock.acquire(blocking=False):
                    return
                try:
                    self._renew(Deadline.after(WallClock(), _BLIND_S), words, gap_s)
                    taken.append(True)
                finally:
                    self._lock.release()

    def _send_blind(self, words: Sequence[bytes], gap_s: float) -> None:
        wall = WallClock()
        deadline = Deadline.after(wall, _BLIND_S)  # the bench's clock may be what hangs
        for number, message in enumerate(words):
            if number:
                sleep(wall, min(gap_s, _BLIND_S / 2.0 / len(words)))
            self._wire.send(message, deadline)


class OverWire:
    """An instrument at the other end of a conversation."""

    def __init__(self, conversation: Conversation) -> None:
        self._conversation = conversation

    @property
    def name(self) -> str:
        """The role on this bench."""
        return self._conversation.name

    @property
    def resource(self) -> str:
        """The resource string or port it was opened with."""
        return self._conversation.resource

    @property
    def clock(self) -> Clock:
        """The clock that the conversation waits on."""
        return self._conversation.clock

    def _error(self, kind: type[_E], what: str, command: str | None = None, hint: str | None = None) -> _E:
        """Return an error that names this instrument."""
        return kind(what, instrument=self.name, resource=self.resource, command=command, hint=hint)


def shown(command: str) -> str:
    """Return `command` as it goes into messages: arbitrary waveforms are commands too."""
    return command if len(command) <= _LONGEST_SHOWN else f"{command[:_LONGEST_SHOWN]}..."
