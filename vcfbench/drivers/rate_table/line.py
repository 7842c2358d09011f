"""The line to a rate table: exchanges on what pyserial opens, with deadlines."""

import math
import re
from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar

from vcfbench import errors
from vcfbench.clock import Deadline, sleep
from vcfbench.drivers import replies
from vcfbench.drivers.conversation import Conversation

_T = TypeVar("_T")

_LINE_END = re.compile(rb"\r\n|\r|\n")
_QUIET_S = 0.2
"""Silence after which a line counts as drained, s."""
_LONGEST_LINE = 32_768
"""The longest message of any table's language known so far (ACL manual, section 2)."""


class Language(Protocol):
    """Properties of a language that a line needs."""

    @property
    def gap_s(self) -> float:
        """Gap that the table needs between two messages, s."""

    def resync(self, line: "TableLine", deadline: Deadline) -> None:
        """Get answers and questions into step again after a failed exchange."""

    def may_come_unasked(self, data: bytes) -> bool:
        """Return True if bytes that came between two exchanges leave them in step."""


class TableLine(Conversation):
    """Exchanges that dialects are built on: questions, commands, and readers of replies.

    `ask` and `command` are all that most languages need. They keep the line in step: what came unasked, what an
    exchange that failed has left, and what answers the words that were sent blind never becomes a later answer.
    """

    commands_are_answered = True
    _cr_taken = False
    """Whether the line end taken last was a CR whose LF may still come."""
    _awaited = False
    """Whether what was waited for last did not come: it may come yet."""
    _resyncing = False
    _sent_s = -math.inf

    # Exchanges

    def ask(self, language: Language, question: bytes, deadline: Deadline) -> str:
        """Send one query unchanged; return the line that answers it, skipping empty lines."""
        return self.exchanged(language, question, deadline, self.take_text)

    def command(self, language: Language, message: bytes, deadline: Deadline) -> None:
        """Send one command unchanged that the table does not answer."""
        self.exchanged(language, message, deadline, lambda _: None)

    def exchanged(
        self,
        language: Language,
        message: bytes,
        deadline: Deadline,
        take: Callable[[Deadline], _T],
        *,
        shown: str | None = None,
        at_once: bool = False,
    ) -> _T:
        """Send a message and return the reply as `take` reads it.

        The line is out of step after an error of `take` but a refusal, and after a DeadlineExceeded that it puts up
        with. `shown` is the message for errors; with `at_once` the message goes whatever has come before.
        """
        with self.exchange(message.decode("latin-1").strip() if shown is None else shown, deadline):
            out_of_step = self._find_place(language, deadline, at_once=at_once)
            self.dirty, self._awaited = True, False  # until the exchange is whole, whatever ends it
            if language.gap_s:
                self.clock.sleep_until(self._sent_s + language.gap_s)
            self._put(message, deadline)
            self._sent_s = self.clock.now()
            try:
                answer = take(deadline)
            except errors.InstrumentError:  # a whole answer, though a refusal
                self.dirty = out_of_step
                raise
            self.dirty = out_of_step or self._awaited
            return answer

    def _find_place(self, language: Language, deadline: Deadline, *, at_once: bool) -> bool:
        """Get into step, unless it must go on `at_once`; return True if it is still out of step."""
        unasked = self.take_unasked()
        if not (self.dirty or self._awaited or (unasked and not language.may_come_unasked(unasked))):
            return False
        if at_once:
            return True
        self.dirty = True
        if deadline.expired():  # no time to find the place in is no reason to give the connection up
            raise errors.DeadlineExceeded("the time was up before anything was sent")
        self._resyncing = True
        try:
            with self.resynchronising(None, deadline):
                language.resync(self, deadline)
        finally:
            self._resyncing = False
        return False

    def drain(self, deadline: Deadline) -> None:
        """Discard all bytes until 0.2 s of silence."""
        self.take_unasked()
        while not deadline.expired():
            sleep(self.clock, min(_QUIET_S, deadline.remaining()))
            if not self.take_unasked():
                return

    # Bytes

    def send(self, data: bytes, deadline: Deadline) -> None:
        """Send all of `data`; where an answer may still come, or one to words sent blind, it is waited for first."""
        self._require_open()
        if (self.dirty or self._awaited) and not self._resyncing:
            self.drain(deadline)
            self.dirty = self._awaited = False
        self._put(data, deadline)

    def _put(self, data: bytes, deadline: Deadline) -> None:
        self._said = data.decode("latin-1").strip()
        self._wire.send(data, deadline)

    def take_text(self, deadline: Deadline) -> str:
        """Return the next line that is not empty, without blanks at its ends."""
        while not (line := self.take_line(deadline).strip()):
            pass
        return replies.text(line)

    def take_line(self, deadline: Deadline) -> bytes:
        """Return the bytes up to the next line end (CR, LF or both), without it; empty lines are lines."""
        searched = 0  # what never ends comes byte by byte, and shall not take ever longer
        while (found := _LINE_END.search(self._received, searched)) is None:
            searched = len(self._received)
            self._fill(deadline)
        line, self._received = self._received[: found.start()], self._received[found.end() :]
        self._cr_taken, self._came = not self._received and found[0] == b"\r", line
        return line

    def take(self, count: int, deadline: Deadline) -> bytes:
        """Return exactly `count` bytes."""
        while len(self._received) < count:
            self._fill(deadline)
        data, self._received = self._received[:count], self._received[count:]
        return data

    def put_back(self, data: bytes) -> None:
        """Put `data` back, so that it is read next."""
        self._received = data + self._received

    def take_through(self, known: bytes, deadline: Deadline) -> bytes:
        """Return everything before `known`, which is taken too."""
        searched = 0
        while (found := self._received.find(known, searched)) < 0:
            searched = max(0, len(self._received) - len(known) + 1)
            self._fill(deadline)
        data, self._received = self._received[:found], self._received[found + len(known) :]
        return data

    def take_unasked(self) -> bytes:
        """Return the unasked bytes, and forget them."""
        self._require_open()
        self._arrived(self._wire.pending())
        data, self._received = self._received, b""
        return data

    def _fill(self, deadline: Deadline) -> None:
        if len(self._received) > _LONGEST_LINE:
            raise errors.FramingError(f"{len(self._received)} bytes came without an end")
        self._awaited = True
        try:
            self._arrived(self._wire.receive(deadline)[0])
        except errors.DeadlineExceeded as error:
            raise self._with_what_came(error, self._received) from error.__cause__
        self._awaited = False

    def _arrived(self, data: bytes) -> None:
        """Take received bytes in; a LF that follows a CR belongs to it, however late it comes."""
        if data and self._cr_taken:
            data, self._cr_taken = data.removeprefix(b"\n"), False
        self._received += data

    def locate(self, error: errors.TransportError, command: str | None, deadline: Deadline) -> errors.TransportError:
        """Add instrument and place to `error`; the line is out of step then."""
        self.dirty = True
        return super().locate(error, command, deadline)

    def revive(self, deadline: Deadline, words: Sequence[bytes] = (), gap_s: float = 0.0) -> None:
        """Reconnect if the connection is closed, and send `words` first."""
        with self._lock:
            if self.closed and self._reconnect is not None:
                self._renew(deadline, words, gap_s)
