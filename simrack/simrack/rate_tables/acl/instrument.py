"""A simulated ACUTROL3000 motion controller with one continuous axis, spoken to in ACL over a serial line.

Sources: Acutronic TM-8004-C (ACL), TM-9385A (interlocks), TM-9388 (user guide), TM-9411 (RS-232 hook-up); the grammar
is in :mod:`simrack.rate_tables.acl.language`. Unverified, and said so where it matters: the reply prefix's byte
order, the body of an acknowledgement, the numeric error codes (their appendix is missing from the manual), the
coding of the mode bits, and what a faulty command answers.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterable
from typing import Any, ClassVar, Literal

from simrack.adjustment import Adjustment
from simrack.rate_tables.acl import language
from simrack.rate_tables.acl.commands import (
    DemandCommands,
    InterlockCommands,
    LimitCommands,
    ModeCommands,
    Readback,
    Registers,
    system_queries,
)
from simrack.rate_tables.acl.drive import AclDrive
from simrack.rate_tables.acl.limits import AclLimits, Demand
from simrack.rate_tables.acl.profiler import Oscillator, Profiler
from simrack.rate_tables.acl.protection import Protection
from simrack.rate_tables.acl.status import AclStatus, FrontPanel
from simrack.rate_tables.axis import TableErrors, TableWorld
from simrack.rate_tables.interlocked import interlock_adjustments
from simrack.rate_tables.line import LineDevice, SerialTiming

Header = Literal["none", "u32le2", "u32be2"]

_TIMING = SerialTiming(baud=9600.0, processing_s=0.002)
"""9600 8N1 (TM-9411); 2 ms is what TCP clients see, so it is the controller's own share."""


class AclTable(LineDevice):
    """The controller with its table, which keeps turning when the host is silent: ACL has no host time-out.

    `header` is the prefix of every reply: none, or error code and length as two 32-bit words of either byte order.
    Without a prefix a command is acknowledged by ``OK``, a faulty one by an empty line (both unverified).
    """

    errors_class: ClassVar = TableErrors

    def __init__(self, world: TableWorld, errors: TableErrors, header: Header = "none") -> None:
        super().__init__(world, _TIMING, terminators=b"\r\n", longest=language.MAX_MESSAGE_CHARS)
        self._header = header
        self._panel, self._status = FrontPanel(), AclStatus()
        self._demand, self._limits = Demand(), AclLimits()
        self._drive = AclDrive(world, errors, self._limits)
        oscillator = Oscillator(self._drive, self._limits, self._demand)
        self._profiler = Profiler(self._drive, self._limits, self._demand, oscillator)
        self._protection = Protection(self._drive, oscillator, self._limits, self._status, wired=errors.interlocks)
        # Commands and the queries of the controller, by path
        states = language.StateFormat()
        both = (
            DemandCommands(self._demand, self._profiler, states),
            InterlockCommands(self._drive, self._protection, self._status, self._advance),
            LimitCommands(self._limits, self._profiler),
            ModeCommands(self._profiler),
            *(oscillator, states, self._status, self._panel),
        )
        registers = Registers(
            *(self._drive, self._demand, self._profiler, self._protection), status=self._status, panel=self._panel
        )
        asked = (*both, Readback(self._drive, self._profiler, states), registers)
        commands = {path: action for part in both for path, action in part.commands().items()}
        queries = {path: query for part in asked for path, query in part.queries().items()}
        self._commands, self._queries = commands, queries | system_queries()

    # --- outside the wire -------------------------------------------------------------------------------------

    @property
    def remote_active(self) -> bool:
        """The front panel's ACTIVATE REMOTE; while it is off no command acts, queries do."""
        return self._panel.remote_active

    @remote_active.setter
    def remote_active(self, active: bool) -> None:
        self._panel.remote_active = active

    def set_interlock(self, cause: str | int, *, faulty: bool) -> None:
        """Break or restore an interlock: by the name that it has on any table, or bit 0...15 of ours.

        A broken one drops the drive at once if the axis is servoed, and stays latched until Interlock:Reset.

        Raises:
            ValueError: there is none of that name.
        """
        self._quiet_until_s = -math.inf
        self._protection.set_interlock(cause, faulty=faulty)
        self._advance()

    def jam(self, *, held: bool) -> None:
        """Hold the axis from outside, or let it go: the tracking error trips while it should turn."""
        self._quiet_until_s = -math.inf
        self._protection.jammed = held
        self._advance()

    def misread(self, how: Any) -> Callable[[], None]:
        """Start wrong read-backs of rate and angle; return a function that ends them."""
        return self._drive.axis.misread(how)

    def adjustments(self) -> Iterable[Adjustment]:
        """Return the adjustments of a served table from outside its wire."""
        protection = self._protection
        return interlock_adjustments(self, protection.broken, lambda: protection.jammed, protection.shut_down_by)

    # --- the wire ---------------------------------------------------------------------------------------------

    def _answer(self, message: bytes) -> bytes | None:
        replies, code = list[str](), 0
        for item in language.parse_message(message.decode("latin-1")):
            try:
                reply = self._do(item)
            except language.Refusal as refusal:
                self._status.refuse(refusal.code, str(item) if isinstance(item, language.BadCommand) else item.path)
                code = code or refusal.code
            else:
                if reply is not None:
                    replies.append(reply)
        return self._framed(code, replies)

    def _only_asks(self, data: bytes) -> bool:
        if self._input or data[-1:] not in (b"\r", b"\n"):
            return False
        items = language.parse_message(data[:-1].decode("latin-1"))
        return bool(items) and all(isinstance(item, language.AclRequest) and item.query for item in items)

    def _overflow(self) -> bytes | None:
        self._status.refuse(language.TOO_LONG)
        return self._framed(language.TOO_LONG, [])

    def _framed(self, code: int, replies: list[str]) -> bytes:
        text = ";".join(replies) if replies else "" if code else "OK"
        # latin-1: a reply in BINARY format carries bytes of any value
        body = text.encode("latin-1")
        if self._header == "none":
            return body + b"\r\n"
        return struct.pack("<II" if self._header == "u32le2" else ">II", code, len(body)) + body

    def _do(self, item: language.AclRequest | language.BadCommand) -> str | None:
        if isinstance(item, language.BadCommand):
            raise language.Refusal(language.PARSING)
        # Act2000 compatibility: the question mark of a Read may be left out
        if item.query or item.path.startswith("Read:"):
            query = self._queries.get(item.path)
            if query is None:
                raise language.Refusal(language.PARSING)
            return query(item.arguments)
        action = self._commands.get(item.path)
        if action is None:
            raise language.Refusal(language.PARSING)
        if not self._panel.remote_active:
            raise language.Refusal(language.LOCAL)
        action(item.arguments)
        return None

    # --- what happens by itself -------------------------------------------------------------------------------

    def _advance(self) -> None:
        if self._drive.close_when_due():
            self._profiler.follow()
        self._protection.advance()
        self._profiler.advance()
        self._drive.finish_abort()

    def _own_events_s(self) -> tuple[float, ...]:
        instants = (
            *(self._drive.closing_at_s, self._drive.abort_ends_s()),
            *(*self._profiler.due_s(), *self._protection.due_s()),
        )
        return tuple(instant for instant in instants if instant is not None)
