"""A command that is not finished: its condition, and its answer then."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator
from typing import Any, Protocol


class StreamedAnswer(Protocol):
    """The answer to a query that is sent while it comes about."""

    def waiting(self) -> bool:
        """True if a part can be sent now."""

    def take(self) -> bytes:
        """Return the bytes that can be sent now; the query's reply follows at the end."""


class Pending:
    """A command that is not finished: the parser stays busy until `ready_at()`.

    Args:
        ready_at: returns the bench time at which it is finished, or None while that is not known (no trigger yet).
        finish: called then, for the query's value (or None, or a further Pending); may raise ScpiError.
        stream: parts of the answer that are sent before.
        labour: what is to be worked out for it, in slices; it takes no bench time.
    """

    __slots__ = ("finish", "labour", "ready_at", "stream")

    def __init__(
        self,
        ready_at: Callable[[], float | None],
        finish: Callable[[], Any],
        stream: StreamedAnswer | None = None,
        labour: Iterator[object] | None = None,
    ) -> None:
        self.ready_at = ready_at
        self.finish = finish
        self.stream = stream
        self.labour = labour

    @classmethod
    def at(cls, instant_s: float, finish: Callable[[], Any] = lambda: None) -> Pending:
        """Return a command that is finished at `instant_s`."""
        return cls(lambda: instant_s, finish)

    @classmethod
    def worked_out(cls, labour: Generator[object, None, Any]) -> Pending:
        """Return a command that is finished once `labour` is at its end, which returns the value."""
        outcome: list[Any] = []

        def keep() -> Iterator[object]:
            outcome.append((yield from labour))

        return cls(lambda: -math.inf, lambda: outcome[0], labour=keep())
