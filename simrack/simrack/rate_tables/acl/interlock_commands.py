"""How the host closes and opens the servo of the ACUTROL3000's axis, and resets what has shut it down."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simrack.rate_tables.acl.arguments import Action, Arguments, Query, check_axis
from simrack.rate_tables.acl.drive import NORMAL_UNSERVO_BIT

if TYPE_CHECKING:
    from collections.abc import Callable

    from simrack.rate_tables.acl.drive import AclDrive
    from simrack.rate_tables.acl.protection import Protection
    from simrack.rate_tables.acl.status import AclStatus


class InterlockCommands:
    """Interlock and all below it; `advance` does what is due of the whole controller."""

    def __init__(self, drive: AclDrive, protection: Protection, status: AclStatus, advance: Callable[[], None]) -> None:
        self._drive = drive
        self._protection = protection
        self._status = status
        self._advance = advance

    def commands(self) -> dict[str, Action]:
        """Return what can be told about the servo."""
        return {"Interlock:Close": self._close, "Interlock:Open": self._open, "Interlock:Reset": self._reset}

    def queries(self) -> dict[str, Query]:
        """Return what can be asked about the servo."""
        return {"Interlock": self._ask}

    def _close(self, arguments: Arguments) -> None:
        check_axis(arguments)
        if self._drive.servoed_or_closing:
            return
        if self._protection.faulted:
            self._status.summarise_interlock()
        else:
            self._drive.close()

    def _open(self, arguments: Arguments) -> None:
        check_axis(arguments)
        self._drive.closing_at_s = None
        if self._drive.servoed and not self._drive.aborting:
            self._drive.abort(NORMAL_UNSERVO_BIT)
            self._advance()

    def _reset(self, arguments: Arguments) -> None:
        if arguments:  # the manual has none, a client of a real table names its axis and expects an OK
            check_axis(arguments)
        if not self._drive.servoed:  # no effect on a servoed axis
            self._protection.reset()

    def _ask(self, arguments: Arguments) -> str:
        check_axis(arguments, everything=False)
        if self._protection.faulted:
            return "Fault"
        return "Close" if self._drive.servoed else "Open"
