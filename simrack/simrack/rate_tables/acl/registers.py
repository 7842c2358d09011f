"""The condition registers of the ACUTROL3000, bit by bit (TM-8004-C appendix B)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simrack.rate_tables.acl.arguments import MODES, Arguments, Query, integer
from simrack.rate_tables.acl.refusal import OUT_OF_RANGE, Refusal

if TYPE_CHECKING:
    from collections.abc import Callable

    from simrack.rate_tables.acl.demand import Demand
    from simrack.rate_tables.acl.drive import AclDrive
    from simrack.rate_tables.acl.front_panel import FrontPanel
    from simrack.rate_tables.acl.profiler import Profiler
    from simrack.rate_tables.acl.protection import Protection
    from simrack.rate_tables.acl.status import AclStatus


class Registers:
    """Status:CSR: the registers as they stand, by name."""

    def __init__(
        self,
        drive: AclDrive,
        demand: Demand,
        profiler: Profiler,
        protection: Protection,
        *,
        status: AclStatus,
        panel: FrontPanel,
    ) -> None:
        self._drive = drive
        self._demand = demand
        self._profiler = profiler
        self._protection = protection
        self._status = status
        self._panel = panel
        self._registers: dict[str, Callable[[], int]] = {
            "A1STATE": self._state,
            "A1STATIC": self._state,
            "A1DYN": self._dynamic,
            "A1ERR": lambda: 0,
            "A1SWFLT": lambda: protection.faults,
            "A1SWFAULT": lambda: protection.faults,
            "A1INTLK": lambda: protection.interlocks,
            "A1": self._axis,
            "ACP": lambda: bool(self._axis()) << 1,
            "SI": lambda: bool(protection.interlocks) << 2 | bool(protection.faults) << 3,
            "G1INTLK": lambda: (protection.interlocks >> 7 & 3) | (protection.interlocks >> 9 & 1) << 15,
            "SUP": lambda: 1,
            "SUP1": self._supervisor,
            "RI": lambda: 0,
        }

    def queries(self) -> dict[str, Query]:
        """Return how a register is asked for."""
        return {"Status:CSR": self._ask}

    def _ask(self, arguments: Arguments) -> str:
        if not 1 <= len(arguments) <= 2:
            raise Refusal(OUT_OF_RANGE)
        register = self._registers.get(arguments[0].upper())
        if register is None:
            raise Refusal(OUT_OF_RANGE)
        value = register()
        if len(arguments) == 1:
            return str(value)
        return str(value >> integer(arguments[1], 0, 15) & 1)

    def _axis(self) -> int:
        return bool(self._state()) | bool(self._dynamic()) << 1

    def _state(self) -> int:
        drive = self._drive
        mode = "Abort" if drive.aborting else self._profiler.mode
        reason = 0 if drive.servoed or not drive.unservo_bit else 1 << drive.unservo_bit
        return MODES.index(mode) | drive.servoed << 4 | reason | self._protection.tripped << 8

    def _dynamic(self) -> int:
        if not self._drive.servoed:
            return 0
        return self._ramping() | self._limited() | self._profiling()

    def _ramping(self) -> int:
        direction = self._profiler.ramp_direction()
        return (direction > 0) << 2 | (direction < 0) << 3

    def _limited(self) -> int:
        """Return the bits of what keeps the axis from its demand: rate limits and ends of travel."""
        profiler, demanded = self._profiler, self._demand.rate_deg_s
        complete = self._drive.motion.profile_complete()
        limited = profiler.regulates_rate and complete and demanded != profiler.profiled_rate_deg_s()
        return limited << (4 if demanded > 0 else 5) | (profiler.at_end > 0) << 6 | (profiler.at_end < 0) << 7

    def _profiling(self) -> int:
        """Return the bits of what profiler and synthesizer have come to."""
        complete, swings = self._drive.motion.profile_complete(), self._drive.motion.oscillating
        arrived = self._profiler.mode in {"Position", "Track"} and complete and not self._drive.moves.active
        return arrived << 8 | (complete and not swings) << 9 | (swings and complete) << 10 | swings << 11

    def _supervisor(self) -> int:
        panel, status = self._panel, self._status
        in_command = panel.remote_active << 1 | panel.remote_lockout << 2 | panel.lockout << 3
        return 1 | in_command | status.full << 12 | status.empty << 13
