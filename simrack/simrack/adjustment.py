"""Adjustments: parts of the simulated bench that can be seen and changed from outside the wire."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, Protocol, runtime_checkable

from msgspec import Struct

_MOST = 1e9
"""No quantity of a bench is larger in its unit; the squares and sums of what is below are numbers still."""


class Adjustment(Struct, frozen=True):
    """One quantity: its dotted name, unit, meaning, how to read it, and how to change it (None: it cannot be)."""

    name: str
    unit: str
    meaning: str
    read: Callable[[], Any]
    write: Callable[[Any], None] | None = None


@runtime_checkable
class Adjustable(Protocol):
    """An object with adjustments of its own."""

    def adjustments(self) -> Iterable[Adjustment]:
        """Return the adjustments."""


def number(value: Any) -> float:
    """Return a number that came from outside; ValueError if it is none, or of no bench."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"expected a number, not {value!r}")  # noqa: TRY004  (what came over the wire)
    if not -_MOST <= value <= _MOST:
        raise ValueError(f"expected a number of at most {_MOST:g} either sign, not {value:g}")
    return float(value)
