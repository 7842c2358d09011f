"""Keys on the terminal while a run goes: `p` has it pause, `p` again or Enter lets it go on."""

import os
import select
import sys
from contextlib import contextmanager, suppress
from threading import Event, Lock, Thread
from typing import Any, Final, Self

from vcfbench.safety.control import RunState

with suppress(ImportError):  # Windows has none
    import termios

from collections.abc import Iterator
from types import TracebackType

from vcfbench.safety.control import RunControl

_LOOKS_S: Final = 0.05
_BY: Final = "the terminal"


def forget_typed() -> None:
    """Discard characters typed at the terminal before a question."""
    with suppress(OSError, ValueError, NameError):  # there is none, or Windows
        if sys.stdin.isatty():
            termios.tcflush(sys.stdin.fileno(), termios.TCIFLUSH)


class Keys:
    """Reads single keys from the terminal, in a thread of its own, and hands them to `control`.

    The terminal is left as it was. It is read, and changed, only while this process is in its foreground.
    """

    def __init__(self, control: RunControl) -> None:
        self._control = control
        self._over = Event()
        self._using = Lock()
        self._before: list[Any] | None = None
        self._descriptor = sys.stdin.fileno()
        self._thread = Thread(target=self._watch, name="keys", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Read no more."""
        self._over.set()
        with self._using:
            self._give_back()

    @contextmanager
    def left_alone(self) -> Iterator[None]:
        """Leave the terminal to a reader of whole lines meanwhile."""
        with self._using:
            self._give_back()
            yield

    def _watch(self) -> None:
        with suppress(OSError, ValueError):  # it was closed: nobody presses anything any more
            while not self._over.wait(_LOOKS_S):
                with self._using:
                    if self._over.is_set():
                        return
                    pressed = self._pressed()
                for key in pressed:
                    waits = self._control.state in {RunState.PAUSING, RunState.PAUSED}
                    if waits and key in "pP\r\n":
                        self._control.go_on(_BY)
                    elif key in "pP":
                        self._control.pause(_BY)

    def _pressed(self) -> str:
        """Return the keys pressed since, none where the terminal is another's; OSError at its end."""
        if os.tcgetpgrp(self._descriptor) != os.getpgrp():
            return ""
        now = termios.tcgetattr(self._descriptor)
        if now[3] & termios.ICANON:  # each key as it is pressed; a shell may have changed that meanwhile (Ctrl-Z, fg)
            self._before = list(now)
            now[3] &= ~(termios.ICANON | termios.ECHO)
            termios.tcsetattr(self._descriptor, termios.TCSANOW, now)
        pressed = ""
        while select.select([self._descriptor], [], [], 0.0)[0]:
            data = os.read(self._descriptor, 64)
            if not data:
                raise OSError("the terminal is gone")
            pressed += data.decode("latin-1")
        return pressed

    def _give_back(self) -> None:
        if self._before is not None:
            with suppress(OSError, termios.error):
                termios.tcsetattr(self._descriptor, termios.TCSANOW, self._before)
            self._before = None
