"""The modes of the ACUTROL3000's axis, as the host selects them (TM-8004-C 4.7)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simrack.rate_tables.acl.arguments import MODES, Action, Arguments, Query, check_axis, counted, word
from simrack.rate_tables.acl.refusal import OUT_OF_RANGE, Refusal
from simrack.rate_tables.acl.tracking import interval_ms

if TYPE_CHECKING:
    from simrack.rate_tables.acl.profiler import Profiler


class ModeCommands:
    """Mode and all below it."""

    def __init__(self, profiler: Profiler) -> None:
        self._profiler = profiler

    def commands(self) -> dict[str, Action]:
        """Return how a mode is selected."""
        return {"Mode": self._set, **{f"Mode:{mode}": self._selector(mode) for mode in MODES if mode != "Abort"}}

    def queries(self) -> dict[str, Query]:
        """Return how the mode is asked for."""
        return {"Mode": self._ask}

    def _selector(self, mode: str) -> Action:
        return lambda arguments: self._select(mode, arguments)

    def _select(self, mode: str, arguments: Arguments) -> None:
        check_axis(arguments, most=2 if mode == "Track" else 1)
        if mode == "Track":
            self._profiler.track_test.select(interval_ms(arguments[1] if len(arguments) == 2 else None))
        self._profiler.select(mode)

    def _set(self, arguments: Arguments) -> None:
        mode = word(counted(arguments, 2)[1], MODES)
        if mode == "Abort":
            raise Refusal(OUT_OF_RANGE)  # used by the controller itself only
        self._select(mode, arguments[:1])

    def _ask(self, arguments: Arguments) -> str:
        check_axis(arguments, everything=False)
        return self._profiler.mode  # the full word, as a real unit answers; the manual prints the first letter
