"""Adjustments of every simulated table: interlocks that can be broken, an axis that can be held."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from simrack.adjustment import Adjustment
from simrack.rate_tables.axis import INTERLOCKS, ServoAxis


class Interlocked:
    """A table of one :class:`ServoAxis`; each cause of a shutdown comes to :meth:`_noticed`, once."""

    _axis: ServoAxis
    _noticed_before: tuple[str, ...] = ()
    _quiet_until_s: float

    def set_interlock(self, cause: str, *, faulty: bool) -> None:
        """Break or restore an interlock, one of `INTERLOCKS`; a broken one drops the drive at once."""
        self._quiet_until_s = -math.inf
        self._axis.set_interlock(cause, faulty=faulty)
        self._watch()

    def jam(self, *, held: bool) -> None:
        """Hold the axis from outside, or let it go."""
        self._quiet_until_s = -math.inf
        self._axis.jam(held=held)
        self._watch()

    def misread(self, how: Any) -> Callable[[], None]:
        """Start wrong read-backs of rate and angle; return a function that ends them."""
        return self._axis.misread(how)

    def adjustments(self) -> Iterable[Adjustment]:
        """Return the adjustments of a served table from outside its wire."""
        axis = self._axis
        return interlock_adjustments(self, lambda: axis.broken, lambda: axis.jammed, lambda: axis.latched)

    def _advance(self) -> None:
        self._watch()

    def _own_events_s(self) -> tuple[float, ...]:
        return self._axis.own_events_s()

    def _watch(self) -> None:
        """Bring the axis up to now, and tell the causes of a shutdown since."""
        self._axis.advance()
        latched = tuple(self._axis.latched)
        for cause in latched:
            if cause not in self._noticed_before:
                self._noticed(cause)
        self._noticed_before = latched

    def _noticed(self, cause: str, /) -> None:
        """Take note that the axis has shut down by itself."""


def interlock_adjustments(table: Any, broken: Any, jammed: Any, latched: Any) -> list[Adjustment]:
    """Return the adjustments of a table; the last three are callables that say how it is."""

    def broken_by(cause: str) -> bool:
        return cause in broken()

    def throw(cause: str, value: Any) -> None:
        table.set_interlock(cause, faulty=_truth(value))

    found = [
        Adjustment(
            f"interlock.{cause}",
            "",
            f"true while the interlock {cause!r} is broken",
            partial(broken_by, cause),
            partial(throw, cause),
        )
        for cause in INTERLOCKS
    ]
    found.append(
        Adjustment("jammed", "", "true while something holds the axis", jammed, lambda v: table.jam(held=_truth(v)))
    )
    found.append(Adjustment("shut_down_by", "", "what has shut the axis down by itself", lambda: list(latched())))
    return found


def _truth(value: Any) -> bool:
    if not isinstance(value, bool):
        raise ValueError(f"expected true or false, not {value!r}")  # noqa: TRY004  (what came over the wire)
    return value
