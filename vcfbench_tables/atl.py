"""Ideal Aerosmith's table language, EXPERIMENTAL: the subset that independent users agree on.

No manual is public. JOG, STO, ACL, PPO and the framing stand in two or three independent user programs, PVE and SRV
in one each. Three letters and the value without a blank, carriage return; the reply is the data, if any, then a line
with the prompt ``>``; a refusal holds ``?``. Whether a command is echoed, and whether the prompt follows a motion
command at once, late or never, is disputed: both are put up with.
"""

import math
from contextlib import suppress

from vcfbench.clock import Deadline, sleep
from vcfbench.drivers import replies
from vcfbench.drivers.rate_table.dialect import TableDialect, TableSettings, decimal
from vcfbench.drivers.rate_table.line import TableLine
from vcfbench.errors import DeadlineExceeded, InstrumentError
from vcfbench.interfaces import Identity
from vcfbench_tables.readings import SteadyRate, require_rest, turned_deg_s

_PROMPT = ">"
_REFUSAL = "?"
_PATIENCE_S = 0.3
"""Longest wait for the prompt after a motion command; it may be late or absent (unverified)."""
_SPAN_S = 0.3
"""Over how long the angle is watched where the table does not tell its rate."""


class AtlDialect(TableDialect):
    """The one axis of such a table. Servo state and identity cannot be asked for: the servo is as set last.

    How remote control is taken, faults are read and cleared, and limits are set is unknown, and so is the effect of
    ``SRV0`` on a table that turns. A refusal comes at once.
    """

    rate_quantum_deg_s = 1e-4
    own_time_s = 4.0  # a dozen rates from angles, where the table does not tell its rate
    typed_line_end = b"\r"

    def __init__(self, _settings: TableSettings) -> None:
        self._servo = False
        self._tells_rate = True
        self._steady = SteadyRate()

    def identify(self, line: TableLine, deadline: Deadline) -> Identity:
        """Read the angle as a proof of presence, because the language has no query for the identity."""
        self.angle_deg(line, deadline)
        return Identity("Ideal Aerosmith (presumed)", "table language, experimental", "", "")

    def resync(self, line: TableLine, deadline: Deadline) -> None:
        """Drain, send the status question, and drop everything up to the prompt after its data."""
        line.take_unasked()
        line.send(b"\rSTA\r", deadline)
        self._data_then_prompt(line, "STA", deadline)
        line.drain(deadline)  # that data may have been a late answer, and the status still to come

    def may_come_unasked(self, data: bytes) -> bool:
        """Prompts may, of a motion command that was given up waiting for."""
        return not data.replace(_PROMPT.encode("ascii"), b"").strip()

    def stop_words(self, acceleration_deg_s2: float | None) -> tuple[bytes, ...]:
        """Send ``STO`` after a carriage return, which ends a half command before it."""
        if acceleration_deg_s2 is None or not math.isfinite(acceleration_deg_s2):
            return (b"\rSTO\r",)
        return b"\rSTO\r", f"ACL{decimal(acceleration_deg_s2, 4)}\r".encode("ascii"), b"STO\r"

    def close_servo(self, line: TableLine, deadline: Deadline) -> None:
        """Stop, then ``SRV1`` (one source)."""
        self.hold(line, deadline)
        self._command(line, "SRV1", deadline)
        self._servo = True

    def hold(self, line: TableLine, deadline: Deadline) -> None:
        """Send ``STO`` after a carriage return, which ends a half command before it."""
        self._steady.demand(0.0)
        self._command(line, "STO", deadline, b"\rSTO\r", at_once=True)

    def open_servo(self, line: TableLine, deadline: Deadline) -> None:
        """Send ``SRV0`` (one source); refused (InterlockError) while the table turns."""
        require_rest(line, self.rate_deg_s(line, deadline))
        self._command(line, "SRV0", deadline)
        self._servo = False

    def demand_rate(self, line: TableLine, rate_deg_s: float, acceleration_deg_s2: float, deadline: Deadline) -> None:
        """``ACL`` and ``JOG``; rate 0 is ``STO``, sent even when the acceleration is not taken."""
        try:
            if math.isfinite(acceleration_deg_s2):
                self._command(line, f"ACL{decimal(acceleration_deg_s2, 4)}", deadline)
        finally:
            if rate_deg_s == 0.0:
                self.hold(line, deadline)
        if rate_deg_s != 0.0:
            self._steady.demand(rate_deg_s)
            self._command(line, f"JOG{decimal(rate_deg_s, 4)}", deadline, patience_s=_PATIENCE_S)

    def servo_closed(self, line: TableLine, deadline: Deadline) -> bool:
        """Return the state last set: no question for it is known."""
        return self._servo

    def at_rate(self, line: TableLine, deadline: Deadline) -> bool:
        """Return True by readings of the rate, because users contradict each other about ``MCO``."""
        return self._steady.reached(self.rate_deg_s(line, deadline))

    def rate_deg_s(self, line: TableLine, deadline: Deadline) -> float:
        """Ask ``PVE`` (one source); where it is refused, watch the angle."""
        if self._tells_rate:
            try:
                return self._number(line, "PVE", deadline)
            except InstrumentError:
                self._tells_rate = False
        first_deg, started_s = self.angle_deg(line, deadline), line.clock.now()
        sleep(line.clock, _SPAN_S)
        return turned_deg_s(first_deg, self.angle_deg(line, deadline), line.clock.now() - started_s)

    def angle_deg(self, line: TableLine, deadline: Deadline) -> float:
        """Ask ``PPO``."""
        return self._number(line, "PPO", deadline)

    # Exchanges

    def _number(self, line: TableLine, question: str, deadline: Deadline) -> float:
        def take(limit: Deadline) -> float:
            answer = self._data_then_prompt(line, question, limit)
            self._require_accepted(line, answer)
            return replies.number(answer)

        return line.exchanged(self, f"{question}\r".encode("ascii"), deadline, take)

    def _command(
        self,
        line: TableLine,
        command: str,
        deadline: Deadline,
        message: bytes = b"",
        *,
        at_once: bool = False,
        patience_s: float | None = None,
    ) -> None:
        def take(limit: Deadline) -> None:
            if patience_s is None:
                self._acknowledged(line, command, limit)
                return
            with suppress(DeadlineExceeded):
                self._acknowledged(line, command, limit.within(patience_s))

        line.exchanged(self, message or f"{command}\r".encode("ascii"), deadline, take, at_once=at_once)

    def _acknowledged(self, line: TableLine, command: str, deadline: Deadline) -> None:
        """Wait for the prompt; raises InstrumentError if a refusal precedes it."""
        refused = ""
        while (text := self._line(line, command, deadline)) != _PROMPT:
            refused = text if _REFUSAL in text else refused
        self._require_accepted(line, refused)

    def _data_then_prompt(self, line: TableLine, command: str, deadline: Deadline) -> str:
        """Return the first data, which a prompt must follow; prompts before it are an earlier command's."""
        data = ""
        while not data or data == _PROMPT:
            data = self._line(line, command, deadline)
        while self._line(line, command, deadline) != _PROMPT:
            pass
        return data

    def _line(self, line: TableLine, command: str, deadline: Deadline) -> str:
        """Return the next line, without the echo that precedes or is it."""
        return replies.text(line.take_line(deadline)).strip().removeprefix(command).strip()

    def _require_accepted(self, line: TableLine, answer: str) -> None:
        if _REFUSAL in answer:
            raise InstrumentError(f"refused ({answer})", words=answer, **line.where)
