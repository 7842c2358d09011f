"""The Acutronic control language (ACL) of the ACUTROL3000 and Act2000 controllers.

After the ACL manual TM-8004-C. There is no native serial port: a serial-to-TCP converter carries the byte stream of
the TCP interface. What the manual leaves open about that stream's framing is inferred from independent clients and
says so here. Full words are sent throughout, for ACL's short forms are not unique by prefix.
"""

import math
import re
import struct
from collections.abc import Mapping
from types import MappingProxyType

from vcfbench.clock import Deadline
from vcfbench.drivers import replies
from vcfbench.drivers.rate_table.dialect import Header, TableDialect, TableSettings, decimal
from vcfbench.drivers.rate_table.line import TableLine
from vcfbench.errors import FramingError, InstrumentError
from vcfbench.interfaces import Identity

# On every interface except GPIB each command is answered, error code and length before the data (manual section 2).
# That they are two 32-bit words is inferred from the reflective-memory layout and from a client that drops eight
# bytes; their byte order is unknown.
_HEADER_BYTES = 8
_FORMATS: Mapping[str, struct.Struct] = MappingProxyType(
    {"u32le2": struct.Struct("<II"), "u32be2": struct.Struct(">II")}
)
_LONGEST_MESSAGE = 32_768
_ACKNOWLEDGEMENTS = (b"", b"OK")
"""A command's answer without data: nothing, an empty line (release notes) or ``OK`` (a client's comparison)."""

_TRIP_MARGIN = 1.1
"""The over-rate trip shuts the axis down; a tenth above the highest rate leaves room for overshoot."""

_SERVOED = 1 << 4
_ABORTS = MappingProxyType({6: "software abort", 7: "hardware abort"})
_SOFTWARE_FAULTS = MappingProxyType(
    {
        1: "over-rate trip",
        2: "tracking error",
        3: "frame time exceeded",
        7: "transducer lost",
        8: "transducer lost",
        9: "self-test failed",
    }
)
_INTERLOCKS = MappingProxyType(
    {
        6: "power amplifier not acknowledged",
        7: "interlock input 1",
        8: "interlock input 2",
        9: "master interlock (disabled at the front panel)",
        **dict.fromkeys(range(10, 16), "internal watchdog"),
    }
)
_ERRORS_QUEUED = 1 << 7
_DEEPEST_QUEUE = 32

_NUMBER = replies.NumberForm(
    "a number without leading + or blank", re.compile(r"-?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:E[+-]?[0-9]+)?")
)
"""NR1, NR2 or NR3, never with a leading + (ACL manual, section 2)."""


def detect_header(first: bytes) -> Header:
    """Return the kind of header before replies, from the first eight bytes of the first.

    A length above 32 768 cannot be: the other byte order is meant, or the bytes are text.
    """
    for header, layout in _FORMATS.items():
        error, length = layout.unpack(first)
        if 0 < length < _LONGEST_MESSAGE and error < _LONGEST_MESSAGE:
            return header  # type: ignore[return-value]
    return "none"


def take_counted(line: TableLine, deadline: Deadline) -> bytes | None:
    """Return the reply to an accepted query if a header counts it; None for text, which stays unread."""
    first = line.take(1, deadline)
    line.put_back(first)
    if first != b"\0":  # an error code of zero begins so in either byte order, and no text does
        return None
    start = line.take(_HEADER_BYTES, deadline)
    header = detect_header(start)
    if header == "none":
        line.put_back(start)
        return None
    return line.take(_FORMATS[header].unpack(start)[1], deadline)


class AclDialect(TableDialect):
    """One axis of an ACL controller; the header is learnt at the first reply when it is ``auto``."""

    rate_quantum_deg_s = 1e-5

    def __init__(self, settings: TableSettings) -> None:
        self.axis = settings.axis
        self.header = self._header_asked = settings.reply_header
        self._identity = b""

    # Identity and synchronisation

    def identify(self, line: TableLine, deadline: Deadline) -> Identity:
        """Ask ``*IDN?``; its answer serves to find the place again after a failed exchange."""
        if not self._identity:
            self.header = self._header_asked  # what was learnt so far was learnt of no identity: of a greeting
        answer = self.ask(line, "*IDN?", deadline)
        identity = Identity(*replies.identity_fields(answer))
        self._identity = answer.encode("ascii")
        return identity

    def resync(self, line: TableLine, deadline: Deadline) -> None:
        """Drop late replies up to the known answer of ``*IDN?``, then up to a number; all, where none is known.

        The second question is there because the one that failed may itself have been ``*IDN?``.
        """
        if not self._identity:
            line.drain(deadline)
            return
        line.take_unasked()
        line.send(b"*IDN?\n", deadline)
        line.take_through(self._identity, deadline)
        line.send(b":Status:STB?\n", deadline)
        while self._body(line, deadline).encode("ascii") == self._identity:
            pass
        line.take_unasked()  # every question has been answered: a second answer, or noise

    def may_come_unasked(self, data: bytes) -> bool:
        """Acknowledgements may: which command's does not matter, for each is followed by a question."""
        *whole, rest = data.replace(b"\r", b"\n").split(b"\n")
        return not rest and all(part in _ACKNOWLEDGEMENTS for part in whole)

    # Words that are sent blind

    def stop_words(self, acceleration_deg_s2: float | None) -> tuple[bytes, ...]:
        """Return the demand of rate 0; the line end before it ends a torn message.

        The limit of the acceleration comes after a demand that needs none: were it torn to 0, nothing would stop.
        """
        stop = f":Demand:Rate {self.axis},0\n"
        if acceleration_deg_s2 is not None and math.isfinite(acceleration_deg_s2):
            faster = f":Limit:Acceleration R,{self.axis},{decimal(acceleration_deg_s2)};{stop}"
            return (f"\n{stop}".encode("ascii"), faster.encode("ascii"))
        return (f"\n{stop}".encode("ascii"),)

    def shutdown_words(self) -> tuple[bytes, ...]:
        """Select mode OFF, which no demand affects, then open the servo along the ABORT profile."""
        return (f"\n:Mode:Off {self.axis}\n".encode("ascii"), f":Interlock:Open {self.axis}\n".encode("ascii"))

    # Commands

    def claim(self, line: TableLine, deadline: Deadline) -> None:
        """Bar the controller's other interfaces."""
        self.command(line, ":Utility:Lockout ON", deadline)

    def release(self, line: TableLine, deadline: Deadline) -> None:
        """Enable the controller's other interfaces; a byte stream has no other way back to local (inferred)."""
        self.command(line, ":Utility:Lockout OFF", deadline)

    def set_limits(self, line: TableLine, limits: TableSettings, deadline: Deadline) -> None:
        """Set the limits of rate mode (``R``) and the trip on the measured rate."""
        settings: list[str] = []
        if math.isfinite(limits.max_rate_deg_s):
            trip_deg_s = limits.max_rate_deg_s * _TRIP_MARGIN
            settings.append(f"Rate R,{self.axis},{decimal(limits.max_rate_deg_s)}")
            settings.append(f"Vtrip R,{self.axis},{decimal(trip_deg_s)}")
        if math.isfinite(limits.max_acceleration_deg_s2):
            settings.append(f"Acceleration R,{self.axis},{decimal(limits.max_acceleration_deg_s2)}")
        if settings:
            self.command(line, f":Limit:{';'.join(settings)}", deadline)

    def close_servo(self, line: TableLine, deadline: Deadline) -> None:
        """Zero the demand before the mode is selected: a stale demand would be executed as fast as possible."""
        self.command(line, f":Demand:Rate {self.axis},0;:Mode:Rate {self.axis}", deadline)
        self.command(line, f":Interlock:Close {self.axis}", deadline)

    def hold(self, line: TableLine, deadline: Deadline) -> None:
        """Select mode OFF: closed-loop zero rate that no demand affects."""
        self.command(line, f":Mode:Off {self.axis}", deadline)

    def open_servo(self, line: TableLine, deadline: Deadline) -> None:
        """Open the interlock: an orderly shutdown along the ABORT profile."""
        self.command(line, f":Interlock:Open {self.axis}", deadline)

    def demand_rate(self, line: TableLine, rate_deg_s: float, acceleration_deg_s2: float, deadline: Deadline) -> None:
        """Set the acceleration limit of rate mode and the demand, in one message: on the same control frame."""
        demand = f":Demand:Rate {self.axis},{decimal(rate_deg_s)}"
        if math.isfinite(acceleration_deg_s2):
            demand = f":Limit:Acceleration R,{self.axis},{decimal(acceleration_deg_s2)};{demand}"
        self.command(line, demand, deadline)

    def clear_fault(self, line: TableLine, deadline: Deadline) -> None:
        """Clear the latched faults of all axes; a servoed axis is not affected."""
        self.command(line, ":Interlock:Reset", deadline)

    # Questions

    def servo_closed(self, line: TableLine, deadline: Deadline) -> bool:
        """Read bit 4 of the axis' state word."""
        return bool(self._word(line, "STATE", deadline) & _SERVOED)

    def at_rate(self, line: TableLine, deadline: Deadline) -> bool:
        """Read bit 9 of the dynamic word, Rate Profile Complete."""
        return replies.boolean(self.ask(line, f":Status:CSR? A{self.axis}DYN,9", deadline))

    def rate_deg_s(self, line: TableLine, deadline: Deadline) -> float:
        """Read the measured rate."""
        return self._number(line, f":Read:Rate? {self.axis}", deadline)

    def angle_deg(self, line: TableLine, deadline: Deadline) -> float:
        """Read the measured position."""
        return self._number(line, f":Read:Position? {self.axis}", deadline)

    def fault(self, line: TableLine, deadline: Deadline) -> str | None:
        """Name the latched faults; None when the interlock has not latched."""
        interlock = self.ask(line, f":Interlock? {self.axis}", deadline)
        aborts = _names(self._word(line, "STATE", deadline), _ABORTS)
        if not interlock.upper().startswith("F") and not aborts:
            return None
        causes = _names(self._word(line, "SWFLT", deadline), _SOFTWARE_FAULTS)
        causes += _names(self._word(line, "INTLK", deadline), _INTERLOCKS)
        return ", ".join(causes + aborts) or "interlock fault of unnamed cause"

    def check_errors(self, line: TableLine, deadline: Deadline) -> None:
        """Read the words of refusals, as long as the status byte says that there are some.

        ``:Status:STB?`` leaves the byte as it is, ``*STB?`` would clear it. On a controller whose bit outlives its
        messages an empty message ends them.

        Raises:
            InstrumentError: something was refused; also if the messages do not end.
        """
        refused: list[str] = []
        while (
            len(refused) < _DEEPEST_QUEUE and replies.integer(self.ask(line, ":Status:STB?", deadline)) & _ERRORS_QUEUED
        ):
            # The next message, empty if there is none: a question has just been answered, so this is the reply
            message = replies.text(
                line.exchanged(self, b":Status:MSG? QERROR\n", deadline, lambda limit: self._message(line, limit))
            )
            if not message:
                break
            refused.append(message)
        if refused:
            raise InstrumentError(f"refused with {'; then '.join(refused)}", words=refused[0], **line.where)

    def _word(self, line: TableLine, word: str, deadline: Deadline) -> int:
        return replies.integer(self.ask(line, f":Status:CSR? A{self.axis}{word}", deadline))

    def _number(self, line: TableLine, question: str, deadline: Deadline) -> float:
        return replies.number(self.ask(line, question, deadline), _NUMBER)

    # Exchanges

    def ask(self, line: TableLine, question: str, deadline: Deadline) -> str:
        """Put one question and return its answer, without header and terminator."""
        message = question.encode("ascii") + b"\n"
        return line.exchanged(self, message, deadline, lambda limit: self._body(line, limit))

    def command(self, line: TableLine, command: str, deadline: Deadline) -> None:
        """Give one command; raises InstrumentError with the table's refusal."""
        with line.exchange(command, deadline):
            line.exchanged(self, command.encode("ascii") + b"\n", deadline, lambda limit: self._done(line, limit))
            self.check_errors(line, deadline)

    def _done(self, line: TableLine, deadline: Deadline) -> None:
        if self.header == "auto":
            raise FramingError("identify the table before commanding it")
        if self.header != "none" and (body := self._counted(line, deadline)) not in _ACKNOWLEDGEMENTS:
            raise FramingError(f"expected an acknowledgement, got {body[:60]!r}")

    def _message(self, line: TableLine, deadline: Deadline) -> bytes:
        return self._counted(line, deadline) if self.header != "none" else line.take_line(deadline)

    def _body(self, line: TableLine, deadline: Deadline) -> str:
        """Return the data of the next reply that has any, or that a header says to have none."""
        if self.header == "auto":
            first = b"\n"
            while first[:1] in (b"\r", b"\n"):
                first = first[1:] + line.take(_HEADER_BYTES - len(first) + 1, deadline)
            line.put_back(first)
            self.header = detect_header(first)
        body = b""
        while body in _ACKNOWLEDGEMENTS:
            body = self._message(line, deadline)
        if body.startswith(b"#"):
            raise FramingError("the table answers in binary, set its reply format to floating point")
        return replies.text(body)

    def _counted(self, line: TableLine, deadline: Deadline) -> bytes:
        """Return a reply that its header counts, without line end; the rest of an uncounted one is skipped."""
        layout = _FORMATS[self.header]
        error, length = layout.unpack(line.take(_HEADER_BYTES, deadline))
        while length >= _LONGEST_MESSAGE:
            rest = layout.pack(error, length)
            if rest[:1] not in (b"\r", b"\n"):
                raise FramingError(f"expected a length of a reply, got {length}")
            error, length = layout.unpack(rest[1:] + line.take(1, deadline))
        body = line.take(length, deadline).rstrip(b"\r\n\0")
        if error:
            raise InstrumentError(
                f"refused with {error}" + (f" {body.decode('ascii', 'replace')!r}" if body else ""),
                number=error,
                **line.where,
            )
        return body


def _names(word: int, meanings: Mapping[int, str]) -> list[str]:
    return list(dict.fromkeys(meaning for bit, meaning in meanings.items() if word >> bit & 1))
