"""The person at the terminal: told what only hands can do, and waited for."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from vcfbench.errors import Aborted

if TYPE_CHECKING:
    from vcfbench.bench.signals import StopSignals
    from vcfbench.plans.step import Operator, Request


def at_the_terminal(signals: StopSignals, *, yes: bool) -> Operator | None:
    """Return who does what hands must do on a real bench; None where nobody can be asked.

    With `yes` all is taken as done, and said on stderr; else a person presses Enter on a terminal. Signals stop the
    run while it waits, and so does the end of the input.
    """
    if yes:
        return _taken_as_done
    return (lambda request: _asked(request, signals)) if sys.stdin is not None and sys.stdin.isatty() else None


def _taken_as_done(request: Request) -> str:
    _say(f"by hand: {request.words}; taken as done (--yes)\n")
    return "taken as done: --yes"


def _asked(request: Request, signals: StopSignals) -> str:
    _say(f"\nPlease {request.words}, then press Enter: ")
    line = signals.attend(sys.stdin.readline)
    if not line:
        raise Aborted(f"the terminal was closed where somebody had to {request.words}")
    return line.strip() or "done"


def _say(words: str) -> None:
    sys.stderr.write(words)
    sys.stderr.flush()
