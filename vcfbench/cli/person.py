"""The person at the terminal: told the actions that only hands can do, and waited for."""

import sys
from contextlib import nullcontext

from vcfbench.cli.keys import Keys
from vcfbench.errors import Aborted
from vcfbench.safety.signals import StopSignals
from vcfbench.steps.step import Operator, Request


def somebody_there() -> bool:
    """Tell whether a person may type at a terminal."""
    return sys.stdin is not None and sys.stdin.isatty()


def at_the_terminal(signals: StopSignals, keys: Keys | None, *, yes: bool) -> Operator | None:
    """Return the operator for actions by hand on a real bench; None where nobody can be asked.

    With `yes` all is taken as done, and said on stderr; else a person presses Enter on a terminal, which `keys` leave
    alone meanwhile. Signals stop the run while it waits, and so does the end of the input.
    """
    if yes:

        def done(request: Request) -> str:
            _say(f"by hand: {request.words}; taken as done (--yes)\n")
            return "taken as done: --yes"

        return done
    if not somebody_there():
        return None

    def ask(request: Request) -> str:
        with nullcontext() if keys is None else keys.left_alone():
            _say(f"\nPlease {request.words}, then press Enter: ")
            line = signals.attend(sys.stdin.readline)
            if not line:
                raise Aborted(f"the terminal was closed where somebody had to {request.words}")
            return line.strip() or "done"

    return ask


def agreed(words: str, signals: StopSignals | None = None, keys: Keys | None = None) -> bool:
    """Ask a person on a terminal whether a program may run; False where nobody is there. The rest is as above."""
    if not somebody_there():
        return False
    with nullcontext() if keys is None else keys.left_alone():
        _say(f"{words}. Run it? [y/N] ")
        line = sys.stdin.readline() if signals is None else signals.attend(sys.stdin.readline)
    return line.strip().lower() in {"y", "yes"}


def _say(words: str) -> None:
    sys.stderr.write(words)
    sys.stderr.flush()
