"""The front panel of the ACUTROL3000: who is in command."""

from __future__ import annotations

from simrack.rate_tables.acl.arguments import Action, Arguments, Query, switch


class FrontPanel:
    """ACTIVATE REMOTE, and the two lock-outs that the host may ask for; those are told, and act on nothing here.

    What they bar are the other interfaces: front panel, GPIB, reflective memory. None of them is here: the sockets and
    the serial line are one, for a real ACUTROL3000 has RS-232 by way of a converter to TCP (TM-9411).
    """

    def __init__(self) -> None:
        self.remote_active = True
        """ACTIVATE REMOTE; while it is off no command acts, queries do."""
        self.lockout = False
        self.remote_lockout = False

    def commands(self) -> dict[str, Action]:
        """Return what can be told about the panel."""
        return {"Utility:Lockout": self._lock, "Utility:RemoteLockout": self._lock_remote}

    def queries(self) -> dict[str, Query]:
        """Return what can be asked about the panel."""
        return {
            "Utility:Lockout": lambda _: "ON" if self.lockout else "OFF",
            "Utility:RemoteLockout": lambda _: "ON" if self.remote_lockout else "OFF",
        }

    def _lock(self, arguments: Arguments) -> None:
        self.lockout = switch(arguments)

    def _lock_remote(self, arguments: Arguments) -> None:
        self.remote_lockout = switch(arguments)
