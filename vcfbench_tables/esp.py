"""Newport ESP300/301: rotary stages on a motion controller with endless jog.

Commands after pages of the ESP300 manual and two public clients: axis number, two letters, value, carriage return;
semicolons chain; replies end in CR LF. Commands are not answered: what is refused stands in the error queue, read
after each by ``TB?``. Unverified: 19 200 Bd, ``TV``, the resolution of velocities, whether ``MV`` reverses a turning
stage (hence it is stopped first).
"""

import math
import re
from collections.abc import Mapping
from types import MappingProxyType

from vcfbench.clock import Deadline, sleep
from vcfbench.drivers import replies
from vcfbench.drivers.rate_table.dialect import TableDialect, TableSettings, decimal
from vcfbench.drivers.rate_table.line import TableLine
from vcfbench.errors import DeadlineExceeded, FramingError, InstrumentError
from vcfbench.interfaces import Identity
from vcfbench_tables.readings import SteadyRate, require_rest

_ERROR = re.compile(r"(\d+), *(\d+), *(.+)")
_DEEPEST_QUEUE = 16
_POLL_S = 0.05
_STOPPED: Mapping[int, str] = MappingProxyType({4: "emergency stop", 8: "cable interlock", 29: "interlock"})
"""Errors of the whole controller that shut it down; two lists disagree whether 29 is one or belongs to an axis."""
_FAULTS: Mapping[int, str] = MappingProxyType(
    {2: "amplifier fault", 3: "following error", 10: "overspeed", 29: "interlock"}
)
"""Last two digits of an axis' errors that shut it down; the hundreds are the axis."""
_TOO_FAST = 10
"""The same number refuses a ``VA`` above the stage's ``VU`` (general knowledge of its page, unverified)."""
_UNIT_DEG: Mapping[str, float] = MappingProxyType(
    {"7": 1.0, "8": 0.9, "9": 180.0 / math.pi, "10": 0.18 / math.pi, "11": 0.18e-3 / math.pi}
)
"""Degrees of a unit of ``SN``: degree, gradian, radian, its thousandth and millionth; the others are of lengths."""


class EspDialect(TableDialect):
    """One axis of an ESP controller. It listens to front panel and computer alike; its own limits stay as they are."""

    rate_quantum_deg_s = 1e-4
    typed_line_end = b"\r"

    def __init__(self, settings: TableSettings) -> None:
        self.axis = settings.axis
        self._steady = SteadyRate()
        self._faults: list[str] = []
        self._refused: list[tuple[int, str]] = []
        self._version = ""
        self._unit_deg = 1.0
        self._sets_velocity = False

    def identify(self, line: TableLine, deadline: Deadline) -> Identity:
        """Ask for the controller's version, ``ESP301 Version 3.0.1 6/1/99``, and the unit of the stage."""
        version = self._ask(line, "VE?", deadline)
        model, _, firmware = version.partition(" ")
        if not model.upper().startswith("ESP"):
            raise FramingError(f"expected the version of an ESP controller, got {version[:60]!r}")
        self._version = version
        unit = str(replies.integer(self._ask(line, f"{self.axis}SN?", deadline)))
        if unit not in _UNIT_DEG:
            what = f"its stage counts in unit {unit}, which is no angle"
            raise InstrumentError(what, hint=f"set degrees at it: {self.axis}SN7", **line.where)
        self._unit_deg = _UNIT_DEG[unit]
        self._collect(line, deadline)
        self._refused.clear()  # to whoever asked before, as who looks for a table of another language
        return Identity("Newport", model, "", firmware.removeprefix("Version").strip())

    def resync(self, line: TableLine, deadline: Deadline) -> None:
        """Drop late answers up to the known one of ``VE?``, then up to a number; all, where none is known."""
        if not self._version:
            line.drain(deadline)
            return
        line.take_unasked()
        line.send(b"VE?\r", deadline)
        line.take_through(self._version.encode("ascii"), deadline)
        line.send(f"{self.axis}MO?\r".encode("ascii"), deadline)
        while line.take_text(deadline) not in ("0", "1"):
            pass
        line.take_unasked()

    def stop_words(self, acceleration_deg_s2: float | None) -> tuple[bytes, ...]:
        """Send ``ST``; the carriage return before it ends a torn command."""
        stop = f"{self.axis}ST\r".encode("ascii")
        if acceleration_deg_s2 is None or not math.isfinite(acceleration_deg_s2):
            return (b"\r" + stop,)
        return b"\r" + stop, f"{self.axis}AG{self._in_its_unit(acceleration_deg_s2)}\r".encode("ascii"), stop

    def close_servo(self, line: TableLine, deadline: Deadline) -> None:
        """Stop, then switch the motor on."""
        self._steady.demand(0.0)
        self._command(line, f"{self.axis}ST", deadline)
        self._command(line, f"{self.axis}MO", deadline)

    def hold(self, line: TableLine, deadline: Deadline) -> None:
        """Stop; there is no other mode."""
        self._command(line, f"{self.axis}ST", deadline)

    def open_servo(self, line: TableLine, deadline: Deadline) -> None:
        """Switch the motor off; refused (InterlockError) while the stage turns."""
        require_rest(line, self.rate_deg_s(line, deadline))
        self._command(line, f"{self.axis}MF", deadline)

    def demand_rate(self, line: TableLine, rate_deg_s: float, acceleration_deg_s2: float, deadline: Deadline) -> None:
        """Set acceleration, deceleration and velocity, then jog; rate 0 is ``ST``."""
        acceleration = self._in_its_unit(acceleration_deg_s2)
        ramp = f"{self.axis}AC{acceleration};{self.axis}AG{acceleration};"
        ramps = ramp if math.isfinite(acceleration_deg_s2) else ""
        if rate_deg_s * self._steady.demanded_deg_s < 0.0:
            # Come to rest before the direction is changed. It takes the time of the ramp, beyond `deadline`.
            self._command(line, f"{ramps}{self.axis}ST", deadline)
            self._steady.demand(0.0)
            braking_deg_s2 = self._number(line, f"{self.axis}AG?", deadline)
            turning_deg_s = abs(self.rate_deg_s(line, deadline))
            within = line.deadline(2.0 * turning_deg_s / max(braking_deg_s2, 1e-3) + line.timeout_s)
            while not replies.boolean(self._ask(line, f"{self.axis}MD?", within)):
                if within.expired():
                    raise line.locate(DeadlineExceeded("the stage did not stop"), f"{self.axis}ST", within)
                sleep(line.clock, _POLL_S)
            deadline = line.deadline()
        self._steady.demand(rate_deg_s)
        if rate_deg_s == 0.0:
            self._command(line, f"{ramps}{self.axis}ST", deadline)
            return
        # One that is refused would leave the stage to start at the velocity before
        velocity, question = self._in_its_unit(abs(rate_deg_s)), f"{self.axis}VA?"
        self._sets_velocity = True
        try:
            self._command(line, f"{ramps}{self.axis}VA{velocity}", deadline)
        finally:
            self._sets_velocity = False
        found = replies.number(self._ask(line, question, deadline))
        if not abs(found - float(velocity)) <= self.rate_quantum_deg_s:
            what = f"was set to a velocity of {velocity} but reads back {found:g}"
            raise InstrumentError(what, command=question, **line.where)
        self._command(line, f"{self.axis}MV{'+' if rate_deg_s > 0.0 else '-'}", deadline)

    def _in_its_unit(self, degrees: float) -> str:
        """Return a rate or acceleration as the stage is told it, in its own unit."""
        return decimal(degrees / self._unit_deg)

    def servo_closed(self, line: TableLine, deadline: Deadline) -> bool:
        """Query if the motor is on."""
        return replies.boolean(self._ask(line, f"{self.axis}MO?", deadline))

    def at_rate(self, line: TableLine, deadline: Deadline) -> bool:
        """Return True by readings of the velocity, because ``MD?`` and ``TS`` only report motion."""
        return self._steady.reached(self.rate_deg_s(line, deadline))

    def rate_deg_s(self, line: TableLine, deadline: Deadline) -> float:
        """Read the velocity, ``TV`` (unverified)."""
        return self._number(line, f"{self.axis}TV", deadline)

    def angle_deg(self, line: TableLine, deadline: Deadline) -> float:
        """Read the position."""
        return self._number(line, f"{self.axis}TP", deadline)

    def fault(self, line: TableLine, deadline: Deadline) -> str | None:
        """Read the error queue; an error that shuts the axis down is a fault until it is cleared."""
        self._collect(line, deadline)
        return ", ".join(self._faults) or None

    def clear_fault(self, line: TableLine, deadline: Deadline) -> None:
        """Forget the faults that were read; the controller latches none but by switching the motor off."""
        self._collect(line, deadline)
        self._faults.clear()

    def check_errors(self, line: TableLine, deadline: Deadline) -> None:
        """Read the error queue and raise its refusals."""
        self._collect(line, deadline)
        refused, self._refused = self._refused, []
        if refused:
            words = "; then ".join(f"{number} {text}" for number, text in refused)
            raise InstrumentError(f"refused with {words}", number=refused[0][0], words=refused[0][1], **line.where)

    def _collect(self, line: TableLine, deadline: Deadline) -> None:
        for _ in range(_DEEPEST_QUEUE):
            answer = self._ask(line, "TB?", deadline)
            found = _ERROR.fullmatch(answer)
            if found is None:
                raise FramingError(f"expected number, time and words of an error, got {answer[:60]!r}")
            number, words = int(found[1]), found[3]
            if number == 0:
                return
            axis, kind = divmod(number, 100)
            fault = _STOPPED.get(number) if number < 100 else _FAULTS.get(kind) if axis == self.axis else None
            fault = None if self._sets_velocity and kind == _TOO_FAST else fault
            if fault is not None:
                text = f"{fault} ({number} {words})"
                self._faults += [] if text in self._faults else [text]
            else:
                self._refused.append((number, words))

    # Exchanges

    def _number(self, line: TableLine, question: str, deadline: Deadline) -> float:
        return replies.number(self._ask(line, question, deadline)) * self._unit_deg

    def _ask(self, line: TableLine, question: str, deadline: Deadline) -> str:
        return line.ask(self, question.encode("ascii") + b"\r", deadline)

    def _command(self, line: TableLine, command: str, deadline: Deadline) -> None:
        with line.exchange(command, deadline):
            line.command(self, command.encode("ascii") + b"\r", deadline)
            self.check_errors(line, deadline)
