"""The message exchange of IEEE 488.2: input buffer, parser, busy time, output queue, status, error queue.

An engine is handed a command table, a dialect (what differs between models) and an interface (what differs between
the connectors of one model), and talks to the model through :class:`ScpiModel`.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any, Protocol

from simrack.clock import Clock
from simrack.scpi.dialect import Dialect, Interface
from simrack.scpi.errors import ErrorQueue, ScpiError, esr_bit
from simrack.scpi.formats import Parts, joined
from simrack.scpi.lexer import find_message_end
from simrack.scpi.pending import Pending
from simrack.scpi.status import Register, Status
from simrack.scpi.table import CommandTable, CompiledUnit, Program

_CACHED_MESSAGES = 2048
_CACHED_LENGTH = 512
_SMALLEST_BUFFER = 64
"""No instrument's input buffer is smaller: what is shorter than this never fills one."""


class ScpiModel(Protocol):
    """The part of a model that the engine calls."""

    engine: ScpiEngine

    def identity(self) -> str:
        """Return the answer to *IDN?."""

    def reset(self) -> None:
        """Take the *RST state."""

    def service(self) -> None:
        """Bring everything that happens by itself (ramps, triggered sequences) up to `clock.now()`; called first."""

    def next_event_s(self) -> float | None:
        """Return when :meth:`service` next has something to do, None for never."""

    def abort(self) -> None:
        """Device clear: end the running measurement; settings stay."""

    def operations_end_s(self) -> float:
        """Return the end of pending operations, for *OPC, *OPC? and *WAI: -inf without any, inf if unknown."""


class ScpiEngine:
    """The device side of a message exchange; it is the body of a :class:`~simrack.device.Device`.

    Args:
        model: the instrument, first argument of every handler in the table.
        table: its commands.
        clock: bench time.
        dialect: parser's peculiarities.
        interface: the connector in use.
        status: status registers; by default a QUEStionable register on bit 3.
    """

    def __init__(
        self,
        model: ScpiModel,
        table: CommandTable,
        clock: Clock,
        *,
        dialect: Dialect,
        interface: Interface,
        status: Status | None = None,
    ) -> None:
        self.model = model
        self.table = table
        self.clock = clock
        self.dialect = dialect
        self.interface = interface
        self.status = Status({3: Register()}) if status is None else status
        self.errors = ErrorQueue(dialect.queue_depth, dialect.words, dialect.error_suffix)
        self.remembered: dict[tuple[Any, ...], Any] = {}
        """Settings that change nothing on this bench, since ``*RST``."""
        self.clears_masks_at_power_on = True
        self.hand_over: Callable[[], None] | None = None
        """Called where something long is to be worked out, then to call :meth:`work` slice by slice."""
        self._programs: dict[bytes, Program] = {}
        self._questions: dict[bytes, CompiledUnit] = {}
        """Of the programs, those that are one question answered at once."""
        self._drop_everything()

    def _drop_everything(self) -> None:
        self._partial = bytearray()
        self._overflowed = False
        self._queue: deque[Program] = deque()
        self._steps: Program = ()
        self._next = 0
        self._pending: Pending | None = None
        self._pending_step: CompiledUnit | None = None
        self._replies: list[str | bytes | Parts] = []
        self._output: deque[bytes] = deque()
        self._offset = 0
        self._begun = bytearray()
        self._unterminated = False
        self._deadlocked = False
        self._announce_completion = False
        self._labour: Iterator[object] | None = None

    # --- the seam: simrack.device.Device -------------------------------------------------------------

    def write(self, data: bytes, *, end: bool = False) -> None:
        """Take bytes from the controller."""
        if end and data[-1:] != b"\n" and b"#" not in data:
            data += b"\n"  # so that both spellings of a message are one in the cache
        if data in self._questions and (whole := self.answer(data)) is not None:
            if whole:
                self._output.append(whole)
            return
        self.model.service()
        self._unterminated = False
        program = self._programs.get(data) if not self._partial else None
        if program is None:
            self._receive(data, end=end)
        elif self._pending is None and not self._queue:
            self._begin(program)
        else:
            self._queue.append(program)
        self._advance()

    def read(self, limit: int) -> tuple[bytes, bool]:
        """Hand out the next response message, at most `limit` bytes of it."""
        if self._pending is not None or not self._output:
            self.model.service()
            self._advance()
        if not self._output:
            part = self._read_stream(limit)
            if not part:
                self._complain_unterminated()
            return part, False
        message = self._output[0]
        if not self._offset and len(message) <= limit:
            return self._output.popleft(), True
        part = message[self._offset : self._offset + limit]
        self._offset += len(part)
        if self._offset < len(message):
            return part, False
        self._output.popleft()
        self._offset = 0
        return part, True

    def answer(self, message: bytes) -> bytes | None:
        """Return the response to a query without delay: :meth:`write` and :meth:`read` in one.

        None, and nothing has happened, where it takes both; empty where the response is still to be read.
        """
        step = self._questions.get(message)
        if step is None or self._pending is not None or self._output or self._partial:
            return None
        if self._announce_completion or self.status.sre:
            return None
        self.model.service()
        self._unterminated = self._deadlocked = False
        try:
            result = step.handler(self.model, *step.arguments)
            if result.__class__ is Pending:
                self._take(step, result)
            elif isinstance(reply := step.reply(result), str):
                return reply.encode("latin-1") + self.interface.terminator
            else:
                self._replies.append(reply)
        except ScpiError as error:
            self._refuse(error)
        self._advance()
        return b""

    def wake_at(self) -> float | None:
        """Return when something happens by itself."""
        model = self.model
        model.service()
        if self._pending is not None or self._queue or self._announce_completion or self.status.sre:
            self._advance()
        own = model.next_event_s()
        if self._pending is None and not self._announce_completion:
            return own
        ready = None if self._pending is None else self._pending.ready_at()
        if self._announce_completion and (end := self._operations_end()) is not None:
            ready = end if ready is None else min(ready, end)
        return min(own, ready) if own is not None and ready is not None else own if ready is None else ready

    def clear(self) -> None:
        """Device clear: buffers emptied, the running command ended; status and settings stay."""
        self.model.service()
        self._drop_everything()
        self.model.abort()

    def status_byte(self) -> int:
        """Return the status byte, as a serial poll does."""
        self.model.service()
        self._advance()
        return self.status.poll(self.status_now())

    def requests_service(self) -> bool:
        """True if the SRQ line is pulled; unlike a serial poll this changes nothing."""
        self.model.service()
        self._advance()
        return self.status.note(self.status_now())

    def trigger(self) -> None:
        """Group execute trigger: the same as *TRG, at once."""
        self.model.service()
        if self._partial:
            self.report(ScpiError(-105))
            return
        for step in self.table.compile("*TRG"):
            self._call(step)
        self._advance()

    # --- for models ---------------------------------------------------------------------------------------

    def report(self, error: ScpiError) -> None:
        """Put `error` in the queue and its class in the standard event status register."""
        self.errors.push(error, self.clock.now())
        self.status.esr |= esr_bit(error.number)

    @property
    def busy(self) -> bool:
        """True if a message is under way or waits for its turn; actions of the model by itself do not count."""
        return self._pending is not None or bool(self._queue)

    @property
    def working(self) -> bool:
        """True if there is something to work out by :meth:`work`."""
        return self._labour is not None or (self._pending is not None and self._pending.labour is not None)

    def work_out(self, labour: Iterator[object]) -> None:
        """Start a computation that the model does by itself, in slices if :meth:`work` is called."""
        if self.hand_over is None:
            deque(labour, maxlen=0)
        else:
            self._labour = labour
            self.hand_over()

    def work(self) -> None:
        """Work out a slice of the pending work; the parser goes on after the last."""
        pending, own = self._pending, self._labour
        labour = own if own is not None or pending is None else pending.labour
        try:
            next(labour or iter(()))
        except StopIteration:
            self._labour = None if self._labour is own else self._labour  # its end may have begun the next
            if own is None and pending is not None:
                pending.labour = None
            self._advance()
        except ScpiError as error:
            self._pending = None
            self._refuse(error)
            self._advance()

    def status_now(self) -> int:
        """Return the status byte without bit 6."""
        available = bool(self._output or self._replies or self._begun)
        if not available and self._pending is not None and self._pending.stream is not None:
            available = self._pending.stream.waiting()
        return self.status.byte(message_available=available)

    def announce_completion(self) -> None:
        """*OPC: set the operation complete bit once nothing is pending."""
        self._announce_completion = True
        self._settle_completion()

    def clear_status(self) -> None:
        """*CLS."""
        self._announce_completion = False
        self.status.clear()
        self.errors.clear()

    def when_operations_end(self, finish: Callable[[], Any]) -> Pending | Any:
        """Return `finish()` if nothing is pending, else the Pending that waits for it (*OPC?, *WAI)."""
        if self.model.operations_end_s() <= self.clock.now():
            return finish()
        return Pending(self._operations_end, finish)

    def _operations_end(self) -> float | None:
        return None if (end := self.model.operations_end_s()) == math.inf else end

    def _settle_completion(self) -> None:
        if self._announce_completion and self.model.operations_end_s() <= self.clock.now():
            self._announce_completion = False
            self.status.esr |= 1

    # --- input --------------------------------------------------------------------------------------------

    def _receive(self, data: bytes, *, end: bool) -> None:
        break_byte = self.interface.break_byte
        if break_byte and break_byte in data:
            self.clear()
            data = data.rpartition(break_byte)[2]
        self._partial += data
        blocks, partial = self.dialect.takes_blocks, self._partial
        while (index := find_message_end(partial) if blocks else partial.find(b"\n")) >= 0:
            message = bytes(self._partial[: index + 1])
            del self._partial[: index + 1]
            self._accept(message)
        if end and self._partial:
            message = bytes(self._partial)
            self._partial.clear()
            self._accept(message)
        elif len(self._partial) > self.dialect.input_limit:
            self._partial.clear()
            self._overflow()

    def _accept(self, message: bytes) -> None:
        """Queue a message; the tail of one that was too long is dropped with its terminator."""
        if self._overflowed:
            self._overflowed = False
            return
        if len(message) > self.dialect.input_limit + 2:
            self._overflow()
            self._overflowed = False
            return
        self._queue.append(self._compiled(message))

    def _overflow(self) -> None:
        if not self._overflowed:
            self.report(ScpiError(self.dialect.input_overflow))
        self._overflowed = True

    def _compiled(self, message: bytes) -> Program:
        program = self._programs.get(message)
        if program is not None:
            return program
        text = message.decode("latin-1").removesuffix("\n")
        program = self.table.compile(text, self.dialect.number_not_allowed)
        if message.endswith(b"\n") and len(message) <= _CACHED_LENGTH and b"#" not in message:
            if len(self._programs) >= _CACHED_MESSAGES:
                self._programs.clear()
                self._questions.clear()
            self._programs[message] = program
            if len(program) == 1 and program[0].is_query and program[0].at_once and not program[0].settling:
                self._questions[message] = program[0]
        return program

    # --- parser -------------------------------------------------------------------------------------------

    def _begin(self, program: Program) -> None:
        if self._output and self.interface.message_exchange and program:
            self._output.clear()
            self._offset = 0
            self.report(ScpiError(-410))
        self._steps = program
        self._next = 0
        self._deadlocked = False

    def _advance(self) -> None:
        """Execute all units that can be executed now."""
        if self._announce_completion:
            self._settle_completion()
        while True:
            if self._pending is not None and not self._complete():
                if self._queue or self._next < len(self._steps):
                    self._execute_urgent()
                break
            if self._next < len(self._steps):
                step = self._steps[self._next]
                self._next += 1
                (self._call if step.at_once else self._execute)(step)
                continue
            if self._replies:
                self._respond()
            if not self._queue:
                break
            self._begin(self._queue.popleft())
        if self._announce_completion:
            self._settle_completion()
        if self.status.sre:
            self.status.note(self.status_now())

    def _complete(self) -> bool:
        """Finish the pending unit if it is due, and its consequences; False while something takes its time."""
        step = self._pending_step
        assert step is not None  # noqa: S101  (for the type checker)
        while (pending := self._pending) is not None:
            if pending.labour is not None and self.hand_over is not None:
                return False
            ready = pending.ready_at()
            if ready is None or ready > self.clock.now():
                return False
            self._pending = None
            try:
                if pending.labour is not None:
                    deque(pending.labour, maxlen=0)
                self._take(step, pending.finish())
            except ScpiError as error:
                self._refuse(error)
        return True

    def _execute(self, step: CompiledUnit) -> None:
        if step.error is not None:
            self._refuse(step.error)
        elif step.takes_s > 0.0:
            self._pending_step = step
            self._pending = Pending.at(
                self.clock.now() + step.takes_s,
                lambda: step.handler(self.model, *(step.resolve(self.model) if step.settling else step.arguments)),
            )
        else:
            self._call(step)

    def _call(self, step: CompiledUnit) -> None:
        try:
            if step.settling:
                result = step.handler(self.model, *step.resolve(self.model))
            else:
                result = step.handler(self.model, *step.arguments)
            if step.is_query or result is not None:
                self._take(step, result)
        except ScpiError as error:
            self._refuse(error)

    def _take(self, step: CompiledUnit, result: Any) -> None:
        if result.__class__ is Pending:
            self._pending = result
            self._pending_step = step
            if result.labour is not None and self.hand_over is not None:
                self.hand_over()
        elif step.is_query:
            self._replies.append(step.reply(result))
            if step.rest > _SMALLEST_BUFFER:
                self._look_for_deadlock(step.rest)

    def _look_for_deadlock(self, rest: int) -> None:
        """-430: the output queue is full, and so is the input buffer, with more of the message still to come.

        The answers so far are lost, and those to the rest of the message too (IEEE 488.2, 6.3.1.7). Who takes the
        answers of a stream while it sends never gets there.
        """
        if rest <= self.dialect.input_buffer or not self.interface.message_exchange:
            return
        if self._deadlocked or sum(map(len, self._replies)) + len(self._replies) > self.dialect.output_queue:
            self._replies.clear()
            if not self._deadlocked:
                self.report(ScpiError(-430))
            self._deadlocked = True

    def _refuse(self, error: ScpiError) -> None:
        """Report; a command error or a query error also ends the message, an execution error does not."""
        self.report(error)
        if not -299 <= error.number <= -200 and error.number < 0:
            self._steps = ()
            self._next = 0

    def _execute_urgent(self) -> None:
        """Let a trigger through to a sequence that waits for one."""
        while self._pending is not None:
            if self._next == len(self._steps) and self._queue and not self._replies:
                if not self._queue[0] or not self._queue[0][0].urgent:
                    return
                self._begin(self._queue.popleft())
            if self._next == len(self._steps) or not self._steps[self._next].urgent:
                return
            self._next += 1
            self._call(self._steps[self._next - 1])
            if self._pending.ready_at() is not None:
                return

    # --- output -------------------------------------------------------------------------------------------

    def _respond(self) -> None:
        replies = self._replies
        if self._deadlocked:
            replies.clear()
            return
        self._output.append(bytes(self._begun) + joined(replies, self.interface.terminator))
        self._begun.clear()
        replies.clear()

    def _read_stream(self, limit: int) -> bytes:
        """Return at most `limit` bytes of an answer that is sent while it comes about, after the replies before it."""
        if self._pending is None or self._pending.stream is None:
            return b""
        if self._replies:
            self._begun += joined(self._replies, b";")
            self._replies.clear()
        self._begun += self._pending.stream.take()
        part = bytes(self._begun[:limit])
        del self._begun[:limit]
        return part

    def _complain_unterminated(self) -> None:
        """-420 once: addressed to talk with nothing to say and nothing under way."""
        busy = self._pending is not None or self._queue
        if self._unterminated or busy or not self.interface.message_exchange:
            return
        self._unterminated = True
        self._partial.clear()
        self.report(ScpiError(-420))
