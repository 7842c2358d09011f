"""Requests to the person at the terminal, for actions by hand."""

import select
import sys
from contextlib import nullcontext, suppress
from functools import partial
from typing import Final

from vcfbench.cli.keys import Keys, forget_typed
from vcfbench.clock import WallClock, sleep
from vcfbench.errors import Aborted
from vcfbench.interfaces import Operator, Request
from vcfbench.safety.signals import StopSignals

_LOOKS_S: Final = 0.1
_DISPLAYED_S: Final = 0.05
"""Wall time in which a display, which writes in a thread of its own, has shown what went before a question."""


def somebody_there() -> bool:
    """Return True if a person may type at a terminal."""
    return sys.stdin is not None and sys.stdin.isatty()


def at_the_terminal(signals: StopSignals | None, keys: Keys | None, *, yes: bool = False) -> Operator | None:
    """Return the operator for actions by hand on a real bench; None without a terminal.

    With `yes` all is taken as done that needs no answer, and said on stderr; else a person presses Enter on a terminal,
    which `keys` leave alone meanwhile. Signals stop the run while it waits, and so does the end of the input.
    """
    if not (yes or somebody_there()):
        return None

    def ask(request: Request) -> str:
        if yes and not request.types:
            _say(f"by hand: {request.words}; counted as done (--yes)\n")
            return "counted as done: --yes"
        with nullcontext() if keys is None else keys.left_alone():
            sleep(WallClock(), _DISPLAYED_S)
            forget_typed()
            _say(f"\nPlease {request.words}, then press Enter: ")
            line = _line(request) if signals is None else signals.attend(partial(_line, request))
            if not line:
                raise Aborted(f"the terminal was closed during the request to {request.words}")
            return line.strip() or ("" if request.types else "done")

    return ask


def _line(request: Request) -> str:
    """Read a line from the terminal, as long as it is wanted: a thread that is left behind keeps it from nobody."""
    with suppress(OSError, ValueError):  # it has no descriptor, or Windows has no select for it
        while sys.stdin.isatty() and not select.select([sys.stdin], [], [], _LOOKS_S)[0]:
            if not request.wanted():
                raise Aborted(f"the request was withdrawn: {request.words}")
    return sys.stdin.readline()


def agreed(words: str, signals: StopSignals | None = None, keys: Keys | None = None) -> bool:
    """Ask a person on a terminal for leave to run a program; False if nobody is there. The rest is as above."""
    if not somebody_there():
        return False
    with nullcontext() if keys is None else keys.left_alone():
        _say(f"{words}. Run it? [y/N] ")
        line = sys.stdin.readline() if signals is None else signals.attend(sys.stdin.readline)
    return line.strip().lower() in {"y", "yes"}


def _say(words: str) -> None:
    sys.stderr.write(words)
    sys.stderr.flush()
