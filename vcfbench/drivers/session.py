"""The client side of SCPI: one instrument, one connection, one question at a time.

A deadline covers every exchange. After an exchange that failed the session is *dirty*: before anything else is
asked it is cleared, drained and proved to be in step by queries whose answers are known; when that fails it is
closed. A late answer is thus never taken for the answer to the next question.

The safe words alone need none of that: they are sent on whatever is left of the wire, and nothing is waited for.
"""

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from itertools import groupby
from types import MappingProxyType, TracebackType
from typing import Any, Self, TypeVar

from vcfbench import errors
from vcfbench.clock import Deadline, WallClock, sleep
from vcfbench.drivers import replies
from vcfbench.drivers.conversation import Conversation, shown
from vcfbench.drivers.replies import ANY_NUMBER, NumberForm
from vcfbench.drivers.trace import Connect
from vcfbench.drivers.wire import Interface, SerialLine, Wire, behind

_T = TypeVar("_T")
_W = TypeVar("_W", str, bytes)

_LONGEST_LINE = 4_194_304
_DEEPEST_QUEUE = 64
"""More entries than any of the instruments' error queues hold (20 or 30)."""
_ECHO_S = 0.1
"""Longest wait for the last of doubled answers, s."""
_QUIET_S = 0.1
"""Silence after which a stream is believed that had something to say when it was opened, s."""
_OPENING_S = 1.0
"""Wall time after connecting within which a stream may say something by itself, s."""
_STREAMS = ("socket", "asrl")
_KINDS_SHOWN = 4
"""Different entries of an error queue that a message shows."""
_QUERY_ERRORS = range(-499, -399)
"""-410, -420, -430, -440: queue entries of an interrupted exchange; the session has dealt with it."""
_STATUS_ERRORS = MappingProxyType({4: "query error", 8: "device error", 16: "execution error", 32: "command error"})


def visa_resource(resource: str, library: str, serial: SerialLine | None = None) -> Connect:
    """Return a function that opens `resource` through the VISA `library`, ``"@py"`` or a path.

    `serial` is the line of an ASRL resource. What it returns raises ConnectFailed: nobody answers there, or the library
    cannot open it.
    """

    def connect(deadline: Deadline) -> Wire:
        adapter, real = behind(resource, library)
        if adapter is not None:
            from vcfbench.drivers.gpib_adapter import open_behind  # noqa: PLC0415 - it loads PyVISA too

            return open_behind(adapter, resource, deadline)
        from vcfbench.drivers.visa_wire import open_wire  # noqa: PLC0415 - PyVISA is loaded when first needed

        return open_wire(resource, real, deadline, serial)

    return connect


class Session(Conversation):
    """A conversation with one SCPI instrument.

    Every method raises a :class:`~vcfbench.errors.TransportError` that names instrument, resource and command when
    the wire fails, and none returns an answer to anything but its own question.
    """

    def __init__(self, wire: Wire, *, write_pause_s: float = 0.0, **of_conversation: Any) -> None:
        super().__init__(wire, **of_conversation)
        self._write_pause_s = write_pause_s
        self._identity: str | None = None
        self._put_off: list[tuple[int, str]] = []
        self._safe_words: tuple[bytes, ...] = ()
        self._error_question: tuple[str, Callable[[str], tuple[int, str]]] = "SYST:ERR?", replies.error_entry
        """Question for the next error, and the reader of number and words in its answer; number 0 is none."""

    @property
    def interface(self) -> Interface:
        """Kind of the connection."""
        return self._wire.interface

    # Questions

    def query(self, command: str, deadline: Deadline | None = None) -> str:
        """Ask `command` and return the answer, without its terminator."""
        return self.query_as(command, str, deadline)

    def query_as(self, command: str, read: Callable[[str], _T], deadline: Deadline | None = None) -> _T:
        """Query `command`; `read` makes a value of the text of the reply, or raises."""
        return self._exchange(command, self._read_line, replies.text, read, deadline)

    def query_reading(self, command: str, deadline: Deadline | None = None, form: NumberForm = ANY_NUMBER) -> float:
        """Ask for a measured value in the `form` that the model promises; raises MeasurementError for 9.9E37."""
        return self.query_as(command, partial(replies.reading, form=form), deadline)

    def query_number(self, command: str, deadline: Deadline | None = None, form: NumberForm = ANY_NUMBER) -> float:
        """Ask for a number in the `form` that the model promises; 9.9E37 is none."""
        return self.query_as(command, partial(replies.number, form=form), deadline)

    def query_ohms(self, command: str, deadline: Deadline | None = None, form: NumberForm = ANY_NUMBER) -> float:
        """Ask for a resistance in the `form` that the model promises; 9.9E37 is inf, an open circuit."""
        return self.query_as(command, partial(replies.ohms, form=form), deadline)

    def query_numbers(self, command: str, deadline: Deadline | None = None) -> tuple[float, ...]:
        """Ask for comma-separated numbers."""
        return self.query_as(command, replies.numbers, deadline)

    def query_readings(
        self, command: str, deadline: Deadline | None = None, form: NumberForm = ANY_NUMBER
    ) -> tuple[float, ...]:
        """Ask for comma-separated measured values, each in the `form`; raises MeasurementError for a 9.9E37."""
        return self.query_as(
            command, lambda text: tuple(replies.reading(field, form) for field in text.split(",")), deadline
        )

    def query_int(self, command: str, deadline: Deadline | None = None) -> int:
        """Ask for a whole number."""
        return self.query_as(command, replies.integer, deadline)

    def query_bool(self, command: str, deadline: Deadline | None = None) -> bool:
        """Ask for a switch, ``0`` or ``1``."""
        return self.query_as(command, replies.boolean, deadline)

    def query_block(self, command: str, deadline: Deadline | None = None) -> bytes:
        """Ask for a definite-length block and return its data."""
        return self._exchange(command, self._read_block, bytes, bytes, deadline)

    def query_raw(self, command: str, deadline: Deadline | None = None) -> bytes:
        """Ask `command` and return the answer as it came, a line or a block with its header, without its terminator."""

        def take(limit: Deadline) -> bytes:
            answer, self._received = bytearray(self._received), b""
            ended = False
            while not replies.is_whole(answer, ended=ended):
                more, ended = self._more(answer, limit)
                answer += more
            return bytes(answer).removesuffix(b"\n").removesuffix(b"\r")

        return self._exchange(command, take, bytes, bytes, deadline)

    # Commands

    def write(self, *commands: str, deadline: Deadline | None = None) -> None:
        """Send `commands`, then read the error queue; raises InstrumentError with the refusal."""
        limit = deadline or self.deadline()
        with self._lock:
            self.send(*commands, deadline=limit)
            self._raise_errors(limit, "; ".join(commands))

    def send(self, *commands: str, deadline: Deadline | None = None) -> None:
        """Send `commands` without asking for refusals; for those before the error queue can be read."""
        limit = deadline or self.deadline()
        with self._lock:
            self._in_step(limit)
            for command in commands:
                self.dirty = True
                try:
                    self._say(command, limit)
                except errors.TransportError as error:
                    raise self.locate(error, command, limit)  # noqa: B904 - the same error, now knowing where
                self.dirty = False
                if self._write_pause_s:
                    sleep(self.clock, min(self._write_pause_s, limit.remaining()))

    def check_errors(self, deadline: Deadline | None = None) -> None:
        """Read the error queue to its end; raises InstrumentError with the first entry, naming the others."""
        with self._lock:
            self._raise_errors(deadline or self.deadline(), None)

    def _raise_errors(self, deadline: Deadline, command: str | None) -> None:
        queued: list[tuple[int, str]] = []
        while len(queued) < _DEEPEST_QUEUE:
            entry = self.query_as(*self._error_question, deadline)
            if entry[0] == 0:
                break
            queued.append(entry)
        entries, self._put_off = self._put_off + queued, []
        if not entries:
            return
        number, words = entries[0]
        kinds = [(entry, len(list(same))) for entry, same in groupby(entries)]
        said = [f'{n} "{w}"' + (f" {times} times" if times > 1 else "") for (n, w), times in kinds[:_KINDS_SHOWN]]
        said += [f"{len(kinds) - _KINDS_SHOWN} others"] if len(kinds) > _KINDS_SHOWN else []
        endless = "; its error queue does not end" if len(queued) == _DEEPEST_QUEUE else ""
        raise errors.InstrumentError(
            f"{'refused with' if command else 'reports'} {', then '.join(said)}{endless}",
            number=number,
            words=words,
            command=shown(command or self._error_question[0]),
            **self.where,
        )

    def use_event_status(self) -> None:
        """Read refusals from ``*ESR?``: the instrument has no error queue."""
        self._error_question = "*ESR?", _event_status

    # The safe words

    def declare_safe(self, *words: str) -> None:
        """Learn the commands that make the instrument safe; every new connection begins with these words."""
        # The newline that goes first ends what is left of a torn command: else it would swallow the first word.
        self._safe_words = (b"".join(b"\n" + word.encode("ascii") for word in words) + b"\n",) if words else ()

    def command_safe(self) -> bool:
        """Send the safe commands at once, without waiting or raising; return True if the wire took them.

        The lock is not: another thread may hang in an exchange. Commands have no answers, so the session stays in step.
        """
        return self.say_blind(self._safe_words) if self._safe_words else True

    # Identity, synchronisation, life and death

    def identify(self, deadline: Deadline | None = None) -> tuple[str, str, str, str]:
        """Ask for the identity: maker, model, serial number, firmware. The answer also serves to resynchronise."""
        self._identity, fields = self.query_as("*IDN?", _identity, deadline)
        return fields

    def clear(self, deadline: Deadline | None = None) -> None:
        """Do a device clear: the instrument aborts its operation and forgets its answers."""
        limit = deadline or self.deadline()
        with self._lock:
            self._require_open()
            self._received = b""
            with self.exchange("device clear", limit):
                self._wire.clear(limit)

    def resync(self, deadline: Deadline | None = None) -> None:
        """Get into step again, or close.

        Whatever came late is read and dropped up to the answer of a ``*IDN?``, which is known; then ``*OPC?`` must
        be answered by 1, for the failed question may itself have been ``*IDN?``.

        Raises:
            OutOfSync: no known answer came in time; the session is closed.
            LinkLost: the connection is gone.
        """
        limit = deadline or self.deadline()
        with self._lock:
            self._require_open()
            with self.resynchronising("*IDN?", limit):
                self._find_the_place(limit)

    def _find_the_place(self, deadline: Deadline) -> None:
        self._received = self._came = b""
        self._wire.clear(deadline)
        if self._identity is None:  # all that can be done is to let a stream fall silent
            if self._wire.interface not in _STREAMS:
                raise errors.FramingError("no reply was received yet, so the form of replies is unknown")
            while True:
                try:
                    self._wire.receive(deadline.within(_QUIET_S))
                except errors.DeadlineExceeded:
                    break
            return
        identity = self._identity.encode()
        self._wire.send(b"*IDN?\n", deadline)
        # The end of the line suffices: what is left of a message that broke off may stand before it.
        while not self._next_line(deadline).endswith(identity):
            pass
        self._wire.send(b"*OPC?\n", deadline)
        doubled = False
        while not (line := self._next_line(deadline)).endswith(b"1") or line.endswith(identity):
            doubled = doubled or line.endswith(identity)
        self._put_off += [entry for entry in self._drained_errors(deadline) if entry[0] not in _QUERY_ERRORS]
        if doubled:  # the last answer has a second one too
            with suppress(errors.DeadlineExceeded):
                self._read_line(Deadline.after(self.clock, min(_ECHO_S, deadline.remaining())))

    def _next_line(self, deadline: Deadline) -> bytes:
        return self._read_line(deadline).rstrip(b"\r\n")

    def _drained_errors(self, deadline: Deadline) -> list[tuple[int, str]]:
        """Read the error queue amid resynchronising, which must not begin again; other lines are passed over."""
        entries: list[tuple[int, str]] = []
        while len(entries) < _DEEPEST_QUEUE:
            question, parse = self._error_question
            self._wire.send(question.encode() + b"\n", deadline)
            entry: tuple[int, str] | None = None
            while entry is None:
                line = self._next_line(deadline)
                with suppress(errors.FramingError):
                    entry = parse(replies.text(line))
            if entry[0] == 0:
                break
            entries.append(entry)
        return entries

    def revive(self, deadline: Deadline | None = None) -> None:
        """Make the session usable for making safe: resynchronise it, or reconnect to the same instrument.

        On a serial line that the instrument needs pauses on it is left in peace after its safe words first.
        """
        limit = deadline or self.deadline()
        with self._lock:
            if self._safe_words and self._write_pause_s:
                sleep(self.clock, min(self._write_pause_s, limit.remaining()))
            if self.closed:
                self._connect_anew(limit)
            elif self.dirty:
                try:
                    self.resync(Deadline.after(limit.clock, limit.remaining() / 2.0))
                except errors.TransportError:
                    self._connect_anew(limit)

    def _connect_anew(self, deadline: Deadline) -> None:
        with self.exchange(None, deadline):
            self._renew(deadline, self._safe_words)
        self.resync(deadline)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    # One exchange

    def _exchange(
        self,
        command: str,
        take: Callable[[Deadline], bytes],
        words: Callable[[bytes], _W],
        read: Callable[[_W], _T],
        deadline: Deadline | None,
        *,
        again: bool = False,
    ) -> _T:
        """Send `command`; `take` takes the answer from the wire, `words` makes a text of it, `read` a value of that.

        A stream that was just opened may say something by itself, as terminal servers do, amid any exchange: what is no
        answer then is asked for again. Nothing that is asked at an opening does anything.
        """
        limit = deadline or Deadline.after(self.clock, self.timeout_s)
        with self._lock:
            if self.dirty or self._closed_because is not None or self._received or self._wire.interface in _STREAMS:
                self._in_step(limit)
            self.dirty = True  # until the exchange is whole, whatever ends it: an error, a signal, an interrupt
            try:
                self._say(command, limit)
                value = read(words(take(limit)))
            except errors.TransportError as error:
                self.locate(error, command, limit)
                if again or not isinstance(error, errors.FramingError) or not self._just_opened():
                    raise
                return self._exchange(command, take, words, read, limit, again=True)
            except errors.MeasurementError as error:  # a whole answer, though no value
                self.dirty = False
                error.instrument, error.resource, error.command = self.name, self.resource, command
                raise
            self.dirty = False
            return value

    def _just_opened(self) -> bool:
        wall_s = WallClock().now()
        return self._wire.interface in _STREAMS and wall_s - self._connected_s < _OPENING_S

    def _in_step(self, deadline: Deadline) -> None:
        """Resynchronise if the last exchange failed, or if something has been said that nobody asked for."""
        if self._closed_because is not None:
            self._require_open()
        if not self.dirty:
            try:
                unasked = self._received or (self._wire.interface in _STREAMS and self._wire.pending())
                self.dirty = bool(unasked)
            except errors.TransportError as error:
                raise self.locate(error, None, deadline)  # noqa: B904 - the same error, now knowing where
        if self.dirty:
            if deadline.expired():  # no time to find the place in is no reason to give the connection up
                raise self.locate(errors.DeadlineExceeded("the time was up before anything was sent"), None, deadline)
            self.resync(deadline)
            # Bytes that are there although every question has been answered are second answers, or noise
            self._received = b""
            with self.exchange(None, deadline):
                self._wire.pending()

    def _say(self, command: str, deadline: Deadline) -> None:
        if deadline.clock.now() >= deadline.expires_s:
            raise errors.DeadlineExceeded("the time was up before anything was sent")
        self._said = command
        self._wire.send(command.encode("ascii") + b"\n", deadline)

    def _more(self, received: bytes | bytearray, deadline: Deadline) -> tuple[bytes, bool]:
        """Take the next bytes of an answer, of which `received` has come, from the wire."""
        if received and deadline.expired():  # what drips in for ever is late too
            raise self._with_what_came(errors.DeadlineExceeded("no answer"), bytes(received))
        try:
            return self._wire.receive(deadline)
        except errors.DeadlineExceeded as error:
            raise self._with_what_came(error, bytes(received)) from error.__cause__

    def _read_line(self, deadline: Deadline) -> bytes:
        received, end = (self._received, False) if self._received else self._wire.receive(deadline)
        while not end and b"\n" not in received:
            more, end = self._more(received, deadline)
            if len(received) > _LONGEST_LINE:
                raise errors.FramingError(f"{len(received)} bytes came without an end of line")
            received += more
        cut = received.find(b"\n") + 1 or len(received)
        self._received = received[cut:]
        self._came = line = received[:cut]
        return line

    def _read_block(self, deadline: Deadline) -> bytes:
        received, self._received, end = self._received, b"", False
        while (lengths := replies.block_length(received)) is None:
            more, end = self._more(received, deadline)
            received += more
        header, count = lengths
        parts, excess = [received[header:]], len(received) - header - count
        while excess < 0 or (excess == 0 and not end):  # the newline after the data belongs to the message
            more, end = self._more(received, deadline)
            parts.append(more)  # joined once at the end: a waveform has megabytes
            excess += len(more)
        last = parts.pop()
        cut = len(last) - excess  # up to the last part there was no more than the data
        rest = last[cut:]
        if rest[:1] not in (b"", b"\n", b"\r"):
            raise errors.FramingError(f"a block is longer than it says, {rest[:20]!r} follows it")
        self._received = rest.lstrip(b"\r").removeprefix(b"\n")
        return b"".join([*parts, last[:cut]])

    def locate(self, error: errors.TransportError, command: str | None, deadline: Deadline) -> errors.TransportError:
        """Add instrument and place to `error`; the session is dirty then, and a lost connection is closed."""
        self.dirty, self._received = True, b""
        return super().locate(error, command, deadline)


def _identity(text: str) -> tuple[str, tuple[str, str, str, str]]:
    return text, replies.identity_fields(text)


def _event_status(text: str) -> tuple[int, str]:
    """Return the errors in a standard event status register; reading it has cleared it (IEEE 488.2, 11.5.1)."""
    bits = replies.integer(text) & sum(_STATUS_ERRORS)
    return bits, ", ".join(words for bit, words in _STATUS_ERRORS.items() if bits & bit)
