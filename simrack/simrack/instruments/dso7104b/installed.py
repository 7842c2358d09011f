"""A measurement that stays on the screen of the DSO7104B, and the answer where nothing can be measured."""

from __future__ import annotations

from collections.abc import Callable, Generator

from msgspec import Struct

from simrack.instruments.dso7104b.measurements import MeasuredTrace
from simrack.instruments.dso7104b.record import Record
from simrack.scpi import INFINITY, ScpiError

Preparation = Callable[[MeasuredTrace], Generator[None, None, object]]

INVALID = INFINITY
"""The answer where nothing can be measured."""


class Installed(Struct, frozen=True):
    """A measurement on the screen."""

    label: str
    sources: tuple[str, ...]
    of: Callable[..., float | None]
    prepare: Preparation | None = None
    """What of a trace takes long to work out, and is needed."""

    def measuring(
        self,
        trace_of: Callable[[str, Record | None], Generator[None, None, MeasuredTrace]],
        record: Record | None = None,
    ) -> Generator[None, None, float]:
        """Return it, after slices of work, on a record or the one shown, whose trace of a source is `trace_of`.

        Without any record it is not measurable, which is no error.
        """
        traces = []
        try:
            for source in self.sources:
                trace = yield from trace_of(source, record)
                if self.prepare is not None:
                    yield from self.prepare(trace)
                traces.append(trace)
            value = self.of(*traces)
        except ScpiError:
            return INVALID
        return INVALID if value is None else value
