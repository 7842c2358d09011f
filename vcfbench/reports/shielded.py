"""A display whose errors do not end the run, and one that shows nothing."""

import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Self

from vcfbench.errors import Aborted, NotSafe
from vcfbench.safety.control import RunState
from vcfbench.steps.events import Event, Observer


class NoProgress:
    """A display that shows nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        """Nothing to end."""

    def handle(self, event: Event) -> None:
        """Take no notice."""

    def hear(self, state: RunState, by: str) -> None:
        """Take no notice of a wish to stop, pause or go on."""


class Shielded:
    """Shows a run for as long as that works; the run and its record do not depend on it.

    `lost` says what went wrong with the display, None when nothing did; it goes into the record.

    Args:
        make: makes the display, in a context of its own. That it cannot be made is no reason not to run either.
    """

    def __init__(self, make: Callable[[], AbstractContextManager[Observer]]) -> None:
        self._make = make
        self._context: AbstractContextManager[Observer] | None = None
        self._display: Observer | None = None
        self.lost: str | None = None

    def __enter__(self) -> Self:
        def begin() -> None:
            self._context = self._make()
            self._display = self._context.__enter__()

        self._guarded(begin)
        return self

    def __exit__(self, *error: object) -> None:
        """End the display, if there is one still."""
        if self._display is not None and (context := self._context) is not None:
            self._guarded(lambda: context.__exit__(*sys.exc_info()))

    def handle(self, event: Event) -> None:
        """Pass on an event."""
        if (display := self._display) is not None:
            self._guarded(lambda: display.handle(event))

    def _guarded(self, act: Callable[[], object]) -> None:
        try:
            act()
        except (Aborted, NotSafe):  # a signal that came just now: it is meant for the run
            raise
        except Exception as error:  # noqa: BLE001  # a display may fail as it likes
            if (stop := Aborted.behind(error)) is not None:
                raise stop from None
            self._display = None
            self.lost = f"{type(error).__name__}: {error}"
