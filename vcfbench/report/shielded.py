"""A display that can harm nobody."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

from vcfbench.errors import BenchError

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import TracebackType

    from vcfbench.procedures.executor import Event
    from vcfbench.report.progress import NoProgress

__all__ = ["Shielded"]


class Shielded:
    """Shows a run for as long as that works; the run and its record do not depend on it.

    `lost` says what went wrong with the display, None when nothing did; it goes into the record.

    Args:
        make: makes the display. That it cannot be made is no reason not to run either.
    """

    def __init__(self, make: Callable[[], NoProgress]) -> None:
        self._make = make
        self._display: NoProgress | None = None
        self.lost: str | None = None

    def __enter__(self) -> Self:
        self._guarded(self._begin)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """End the display, if there is one still."""
        if (display := self._display) is not None:
            self._guarded(lambda: display.__exit__(kind, error, traceback))

    def handle(self, event: Event) -> None:
        """Pass on what happens."""
        if (display := self._display) is not None:
            self._guarded(lambda: display.handle(event))

    def _begin(self) -> None:
        self._display = self._make().__enter__()

    def _guarded(self, act: Callable[[], object]) -> None:
        try:
            act()
        except BenchError:  # a signal that came just now: it is meant for the run
            raise
        except Exception as error:  # noqa: BLE001  # a display may fail as it likes
            self._display = None
            self.lost = f"{type(error).__name__}: {error}"
