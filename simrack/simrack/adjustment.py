"""Adjustments: parts of the simulated bench that can be seen and changed from outside the wire."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, Protocol, runtime_checkable

from msgspec import Struct


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
