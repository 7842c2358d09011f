"""Conversation with one instrument of a bench: questions, raw commands on demand, the bench left safe."""

import re
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from typing import cast

from msgspec import Struct

from vcfbench.bench.ground import station
from vcfbench.bench.opening import open_role
from vcfbench.clock import Clock
from vcfbench.drivers.plain import PlainLine, PlainSession, plain
from vcfbench.errors import BenchError, ConfigError, InstrumentError, LimitError, NotSafe, TransportError
from vcfbench.interfaces import Identity, Instrument, RateTable
from vcfbench.records.raw import RawRecord
from vcfbench.safety.roles import ROLES, filled_roles, require_still, safe_action
from vcfbench.safety.signals import StopSignals
from vcfbench.safety.stack import LeaveNow, SafetyStack, Stage, not_safe
from vcfbench.safety.trust import Trust, require_library
from vcfbench.station.description import BenchDescription

_SHOWN_BYTES = 16

_ACTING_QUESTION = re.compile(r":?(\*?(TST|CAL)|MEAS\w*:(SCAL\w*:)?(F?RES|CONT|DIOD))", re.IGNORECASE)
"""Questions that do something: self-tests, calibrations, and measurements that send a current into the PCB."""


class ConsoleReply(Struct, frozen=True):
    """Reply to a message: the answer (None: nothing was asked), and the entries of the error queue (None: none)."""

    answer: bytes | None
    refusal: str | None


class Console:
    """One open instrument, spoken to in its own words.

    Args:
        instrument: its driver, which says who answers and reads the error queue.
        identity: who answered.
        raw: record of raw commands; None lets questions pass alone.
        clock: bench time.
        signals: what stops it.
        timeout_s: what an exchange may take.
    """

    def __init__(
        self,
        instrument: Instrument,
        identity: Identity,
        *,
        raw: RawRecord | None,
        clock: Clock,
        signals: StopSignals,
        timeout_s: float,
    ) -> None:
        self.identity = identity
        self.role = instrument.name
        self.resource = instrument.resource
        self._instrument = instrument
        self._plain = plain(instrument, timeout_s)
        self._raw = raw
        self._clock = clock
        self._signals = signals

    @property
    def closed(self) -> bool:
        """Tell whether the connection is gone."""
        return self._plain.closed

    def say(self, message: str) -> ConsoleReply:
        """Send `message`, take the answer if it asks something, and read the error queue.

        Raises:
            LimitError: it is a command, and raw commands were not asked for.
            TransportError: the answer did not come, or the connection is gone.
        """
        self._signals.safe_point()
        if not (message.isascii() and message.isprintable()):
            raise ConfigError(f"{message!r} has characters that instruments do not know; nothing was sent")
        # the header of a question ends in '?'; in the tables' own languages that tells nothing
        header = "".join(message.split(maxsplit=1)[:1])
        asks = header.endswith("?") and ";" not in message and not isinstance(self._plain, PlainLine)
        if not asks or _ACTING_QUESTION.match(header):
            if self._raw is None:
                raise LimitError(
                    "a raw command is compared with no limit of the bench",
                    instrument=self.role,
                    resource=self.resource,
                    command=message,
                    hint="nothing was sent; a question ends in '?', the words of `vcfbench talk` keep the limits, "
                    "--raw sends it and writes it down",
                )
            self._raw.add(self.role, self.resource, message)
        if not (isinstance(self._plain, PlainLine) or _asks(message)):
            try:
                self._plain.tell(message)
            except InstrumentError as error:
                return ConsoleReply(None, error.what)
            return ConsoleReply(None, self.errors())
        try:
            answer = self._plain.ask(message)
        except TransportError as error:
            if not self.closed:
                with suppress(TransportError):  # the instrument may say why, if it can still be asked
                    refusal = self.errors()
                    error.hint = error.hint or refusal
            raise
        return ConsoleReply(answer, self.errors())

    def errors(self) -> str | None:
        """Read the error queue to its end; return its entries in words, None when there was none."""
        try:
            self._instrument.check_errors()
        except InstrumentError as error:
            return error.what
        return None

    def wait(self, seconds: float) -> None:
        """Let bench time pass."""
        self._signals.wait(self._clock, self._clock.now() + seconds)

    def clear(self) -> None:
        """Do a device clear."""
        self._plain.clear()

    def interruptible(self) -> AbstractContextManager[None]:
        """Let Ctrl-C break off (Interrupted) a question; at a table it still means: leave, and stop it."""
        return self._signals.interruptible() if isinstance(self._plain, PlainSession) else nullcontext()

    def read_line(self, read: Callable[[], str]) -> str:
        """Wait for a person's line; a signal meanwhile ends the conversation (Aborted)."""
        return self._signals.attend(read)


@contextmanager
def open_console(
    role: str,
    description: BenchDescription,
    *,
    seed: int | None = None,
    timeout_s: float | None = None,
    raw: RawRecord | None = None,
    trust: Trust = False,
) -> Iterator[Console]:
    """Open the instrument of `role` alone; make it safe when left, however it is left.

    Raises:
        ConfigError: the bench has no such role, or names a program that nobody trusts.
        BenchError: the bench is in use, or the instrument did not open.
        InterlockError: the table was found turning.
        NotSafe: on leaving, it could not be made safe.
    """
    known = {each.name: each for each in filled_roles(description)}
    if role not in known:
        also = " on this bench" if role in {each.name for each in ROLES} else ""
        raise ConfigError(f"there is no {role!r}{also}; there are {', '.join(known)}")
    require_library(description, trust)
    with StopSignals() as signals, station(description, seed, None, roles=[role]) as stand:
        safety = SafetyStack(stand.clock, patience=stand.patience)
        under_way: BaseException | None = None
        try:
            instrument, identity = open_role(role, description, stand)
            safety.register(safe_action(known[role], instrument, description))
            if known[role].stage is Stage.MOTION:
                require_still(cast("RateTable", instrument))
            allowed_s = getattr(description, role).timeout_s if timeout_s is None else timeout_s
            yield Console(instrument, identity, raw=raw, clock=stand.clock, signals=signals, timeout_s=allowed_s)
        except BaseException as error:
            under_way = error
            raise
        finally:
            signals.unwind()
            try:
                unsafe = not_safe(safety.make_safe())
            except LeaveNow:
                safety.command_safe()  # it came just before or after: nothing may have been told yet
                unsafe = NotSafe("NOT SAFE: making safe was ended by a third signal", hint="look at the instrument")
            signals.close()
            safety.close()
            if unsafe is not None:
                if isinstance(under_way, BenchError):
                    unsafe.hint = f"{unsafe.hint}; before that: {under_way}"
                raise unsafe from under_way


def _asks(message: str) -> bool:
    """Tell whether a message has a question mark outside quotes, or is one of ACL's readings without one."""
    bare = "".join(piece for index, piece in enumerate(message.replace("'", '"').split('"')) if index % 2 == 0)
    return "?" in bare or bare.strip().lstrip(":").upper().startswith("READ:")


def data_of(answer: bytes) -> bytes:
    """Return the data of an answer that is a block, else all of it."""
    return answer[2 + int(answer[1:2]) :] if _is_block(answer) else answer


def _is_block(answer: bytes) -> bool:
    return answer[:1] == b"#" and answer[1:2] in b"123456789" and answer[1:2] != b""


def summary(answer: bytes) -> str:
    """Return an answer as a person can read it: text as it is, a block by its size and its first bytes."""
    if _is_block(answer):
        data = data_of(answer)
        return f"block of {len(data)} bytes: {_hexadecimal(data)}"
    if answer.isascii() and answer.decode("ascii").isprintable():
        return answer.decode("ascii")
    return f"{len(answer)} bytes that are no text: {_hexadecimal(answer)}"


def _hexadecimal(data: bytes) -> str:
    return data[:_SHOWN_BYTES].hex(" ") + (" ..." if len(data) > _SHOWN_BYTES else "")
