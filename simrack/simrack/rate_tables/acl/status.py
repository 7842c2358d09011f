"""Status of the ACUTROL3000: its status byte, the queue of its messages, its front panel."""

from __future__ import annotations

from collections import deque

from simrack.handlers import Handlers
from simrack.rate_tables.acl import language


class FrontPanel:
    """ACTIVATE REMOTE, and the two lock-outs of the host; they are reported, and act on nothing here.

    What they bar are the other interfaces: front panel, GPIB, reflective memory. None of them is here: the sockets and
    the serial line are one, for a real ACUTROL3000 has RS-232 by way of a converter to TCP (TM-9411).
    """

    _COMMANDS = Handlers()

    def __init__(self) -> None:
        self.remote_active = True
        """ACTIVATE REMOTE; while it is off no command acts, queries do."""
        self.lockout = False
        self.remote_lockout = False

    def commands(self) -> dict[str, language.Action]:
        """Return the commands of the panel."""
        return self._COMMANDS.bound(self)

    def queries(self) -> dict[str, language.Query]:
        """Return the queries of the panel."""
        return {
            "Utility:Lockout": lambda _: "ON" if self.lockout else "OFF",
            "Utility:RemoteLockout": lambda _: "ON" if self.remote_lockout else "OFF",
        }

    @_COMMANDS.of("Utility:Lockout")
    def _lock(self, arguments: language.Arguments) -> None:
        self.lockout = language.switch(arguments)

    @_COMMANDS.of("Utility:RemoteLockout")
    def _lock_remote(self, arguments: language.Arguments) -> None:
        self.remote_lockout = language.switch(arguments)


_INTERLOCK, _AXIS, _SUMMARY, _QUEUE = 0x01, 0x02, 0x40, 0x80


class AclStatus:
    """Collects errors and faults: as messages, and as bits of the status byte."""

    _QUERIES = Handlers()
    _COMMANDS = Handlers()

    def __init__(self) -> None:
        self._byte = 0
        self._service_enable = _INTERLOCK
        self._event_enable = 0
        self._messages: deque[str] = deque(maxlen=64)

    @property
    def empty(self) -> bool:
        """Return True if there is no message."""
        return not self._messages

    @property
    def full(self) -> bool:
        """Return True if the next message drives out the oldest."""
        return len(self._messages) == self._messages.maxlen

    def refuse(self, code: int, *details: str) -> None:
        """Note an error of a command."""
        self._messages.append(",".join((str(code), language.WORDS[code], *details)))
        self._byte |= _QUEUE

    def fault(self, words: str) -> None:
        """Note the cause of a shutdown."""
        self._byte |= _INTERLOCK | _AXIS
        self._messages.append(f"0,{words}")

    def summarise_interlock(self) -> None:
        """Set the summary bit of the interlocks."""
        self._byte |= _INTERLOCK

    def commands(self) -> dict[str, language.Action]:
        """Return the commands of status."""
        return {
            "Status:MSGClr": lambda _: self._messages.clear(),
            "*CLS": lambda _: self._clear(),
            **self._COMMANDS.bound(self),
        }

    def queries(self) -> dict[str, language.Query]:
        """Return the queries of status."""
        return {
            "*STB": lambda _: self._taken_byte(),
            "*SRE": lambda _: str(self._service_enable),
            "*ESE": lambda _: str(self._event_enable),
            "*ESR": lambda _: "0",
            "Status:STB": lambda _: str(self._summed_byte()),
            **self._QUERIES.bound(self),
        }

    def _clear(self) -> None:
        self._byte = 0
        self._messages.clear()

    @_COMMANDS.of("*SRE")
    def _enable_service(self, arguments: language.Arguments) -> None:
        self._service_enable = language.integer(language.one(arguments), 0, 255)

    @_COMMANDS.of("*ESE")
    def _enable_events(self, arguments: language.Arguments) -> None:
        self._event_enable = language.integer(language.one(arguments), 0, 255)

    def _summed_byte(self) -> int:
        return self._byte | (_SUMMARY if self._byte & self._service_enable else 0)

    def _taken_byte(self) -> str:
        value = self._summed_byte()
        self._byte = 0
        return str(value)

    @_QUERIES.of("Status:MSG")
    def _take_messages(self, arguments: language.Arguments) -> str:
        if not arguments or len(arguments) > 2 or arguments[0].upper() not in {"QERROR", "QFAULT", "QALL"}:
            raise language.Refusal(language.OUT_OF_RANGE)
        wanted = [*arguments, "1"][1]
        most = 64 if wanted.upper() == "ALL" else language.integer(wanted, 1, 64)
        messages = [self._messages.popleft() for _ in range(min(most, len(self._messages)))]
        if self.empty:  # the bit says that there are messages, as a summary bit does (unverified)
            self._byte &= ~_QUEUE
        return ";".join(messages)
