"""Conversation with one instrument of an open bench in its own words: questions, raw commands on demand."""

import re
from contextlib import suppress

from msgspec import Struct

from vcfbench.drivers.plain import PlainLine, plain
from vcfbench.errors import ConfigError, InstrumentError, LimitError, TransportError
from vcfbench.interfaces import Instrument
from vcfbench.records.raw import RawRecord
from vcfbench.safety.signals import StopSignals

_SHOWN_BYTES = 16

_ACTING_QUESTION = re.compile(r":?(\*?(TST|CAL)|MEAS\w*:(SCAL\w*:)?(F?RES|CONT|DIOD))", re.IGNORECASE)
"""Questions that do something: self-tests, calibrations, and measurements that send a current into the PCB."""


class ConsoleReply(Struct, frozen=True):
    """Reply to a message: the answer (None: not a query), and the entries of the error queue (None: no queue)."""

    answer: bytes | None
    refusal: str | None


class Console:
    """One open instrument, spoken to in its own words.

    Args:
        instrument: its driver, which reads the error queue.
        raw: record of raw commands; None lets questions pass alone.
        signals: what stops it.
        timeout_s: what an exchange may take.
    """

    def __init__(
        self,
        instrument: Instrument,
        *,
        raw: RawRecord | None,
        signals: StopSignals,
        timeout_s: float,
    ) -> None:
        self._instrument = instrument
        self._plain = plain(instrument, timeout_s)
        self._raw = raw
        self._signals = signals

    def say(self, message: str) -> ConsoleReply:
        """Send `message`, take the answer if it asks something, and read the error queue.

        Raises:
            LimitError: it is a command, and raw commands were not asked for.
            TransportError: the answer did not come, or the connection is gone.
        """
        self._signals.safe_point()
        if not (message.isascii() and message.isprintable()):
            raise ConfigError(f"{message!r} has characters beyond ASCII; nothing was sent")
        # the header of a question ends in '?'; in the tables' own languages that tells nothing
        header = "".join(message.split(maxsplit=1)[:1])
        asks = header.endswith("?") and ";" not in message and not isinstance(self._plain, PlainLine)
        if not asks or _ACTING_QUESTION.match(header):
            if self._raw is None:
                raise LimitError(
                    "the limits of the bench are not checked for a raw command",
                    instrument=self._instrument.name,
                    resource=self._instrument.resource,
                    command=message,
                    hint="nothing was sent; a question ends in '?', the words of `vcfbench talk` keep the limits, "
                    "--raw sends it and writes it down",
                )
            self._raw.add(self._instrument.name, self._instrument.resource, message)
        if not (isinstance(self._plain, PlainLine) or _asks(message)):
            try:
                self._plain.tell(message)
            except InstrumentError as error:
                return ConsoleReply(None, error.what)
            return ConsoleReply(None, self._errors())
        try:
            answer = self._plain.ask(message)
        except TransportError as error:
            if not self._plain.closed:
                with suppress(TransportError):  # the instrument may say why, if it can still be asked
                    refusal = self._errors()
                    error.hint = error.hint or refusal
            raise
        return ConsoleReply(answer, self._errors())

    def _errors(self) -> str | None:
        """Read the error queue to its end; return its entries in words, None when there was none."""
        try:
            self._instrument.check_errors()
        except InstrumentError as error:
            return error.what
        return None


def _asks(message: str) -> bool:
    """Return True if a message has a question mark outside quotes, or is one of ACL's readings without one."""
    bare = "".join(piece for index, piece in enumerate(message.replace("'", '"').split('"')) if index % 2 == 0)
    return "?" in bare or bare.strip().lstrip(":").upper().startswith("READ:")


def summary(answer: bytes) -> str:
    """Return an answer in readable form: text unchanged, a block by its size and its first bytes."""
    if answer[:1] == b"#" and answer[1:2] in b"123456789" and answer[1:2] != b"":
        data = answer[2 + int(answer[1:2]) :]
        return f"block of {len(data)} bytes: {_hexadecimal(data)}"
    if answer.isascii() and answer.decode("ascii").isprintable():
        return answer.decode("ascii")
    return f"{len(answer)} bytes that are no text: {_hexadecimal(answer)}"


def _hexadecimal(data: bytes) -> str:
    return data[:_SHOWN_BYTES].hex(" ") + (" ..." if len(data) > _SHOWN_BYTES else "")
