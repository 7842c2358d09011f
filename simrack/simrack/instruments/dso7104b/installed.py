"""A measurement that stays on the screen of the DSO7104B, and the answer where nothing can be measured."""

from __future__ import annotations

from typing import TYPE_CHECKING

from msgspec import Struct

from simrack.scpi import INFINITY, ScpiError

if TYPE_CHECKING:
    from collections.abc import Callable

    from simrack.instruments.dso7104b.measurements import MeasuredTrace
    from simrack.instruments.dso7104b.record import Record

INVALID = INFINITY
"""The answer where nothing can be measured."""


class Installed(Struct, frozen=True):
    """A measurement on the screen."""

    label: str
    sources: tuple[str, ...]
    of: Callable[..., float | None]

    def value(self, trace_of: Callable[[str, Record], MeasuredTrace], record: Record) -> float:
        """Return it on a record, whose trace of a source is `trace_of`."""
        return measured_or_invalid(lambda: self.of(*(trace_of(source, record) for source in self.sources)))


def measured_or_invalid(measure: Callable[[], float | None]) -> float:
    """Return the measurement; without any record it is not measurable, which is no error."""
    try:
        value = measure()
    except ScpiError:
        return INVALID
    return INVALID if value is None else value
