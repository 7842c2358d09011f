"""Output of the commands: on stdout, with ``--json`` as one object."""

import os
import re
import sys
from collections.abc import Callable
from shutil import get_terminal_size
from typing import Any, Final

import msgspec
import typer

from vcfbench.archive.run import Run
from vcfbench.cli.ending import JSON_DUE, discard_stdout, terminal_gone
from vcfbench.errors import BenchError
from vcfbench.reports.document import Report
from vcfbench.reports.text import WIDTH, text_of

_NARROWEST: Final = 40
"""A terminal that says it is narrower, or nothing of its size, gets lines of so many characters."""
_MOST_WINDOWS: Final = 1000  # What they cannot show takes 3 s


def print_json(values: dict[str, Any]) -> None:
    """Print `values` as one JSON object on one line of stdout."""
    JSON_DUE.set(False)
    typer.echo(msgspec.json.encode(values).decode())


def print_report(report: Report, widest: int = WIDTH) -> None:
    """Print a report on stdout: as wide as a terminal there, if that is narrower than usual."""
    width = min(widest, get_terminal_size().columns) if sys.stdout.isatty() else widest
    typer.echo(text_of(report, max(width, _NARROWEST)))


def not_seen(run: Run) -> list[dict[str, Any]]:
    """Return the faults that a run cannot have seen, for programs."""
    from vcfbench.archive.unseen import unseen_of  # noqa: PLC0415  # numpy takes longer to import than all else

    found: list[dict[str, Any]] = msgspec.to_builtins(unseen_of(run))
    return found


def print_not_seen(run: Run) -> None:
    """Print in a line which faults a run cannot have seen, up to which sizes."""
    if (count := len(run.points)) > _MOST_WINDOWS:
        typer.echo(f"\nundetected faults: see vcfbench report ({count} windows take minutes)")
        return
    from vcfbench.archive.unseen import unseen_in_short, unseen_of  # noqa: PLC0415  # as above

    if said := unseen_in_short(run, unseen_of(run)):
        typer.echo(f"\nfaults that this run would not detect, not in U95 (effects: vcfbench report): {said}")


def print_verdicts(lines: str) -> None:
    """Print lines on stdout, ``fail`` as a word of its own in red where a terminal reads them (not with NO_COLOR)."""
    if "NO_COLOR" not in os.environ:
        lines = re.sub(
            r"(?<!\S)(?:FAIL|FAILED|fail)(?!\S)", lambda word: typer.style(word[0], fg="red", bold=True), lines
        )
    typer.echo(lines)


def answer(show: Callable[[], None], outcome: BenchError | None) -> None:
    """Call `show` to print an answer, then raise `outcome`, even if printing fails."""
    unwritten = given(show)
    if outcome is not None:
        raise outcome
    if unwritten is not None:
        raise unwritten


def given(show: Callable[[], None]) -> BenchError | None:
    """Call `show` to print an answer; return its error, or None if the reader has gone.

    For commands whose exit code says how a bench or a run is: a reader that has left changes nothing about that.
    """
    try:
        show()
        sys.stdout.flush()
    except BrokenPipeError:
        discard_stdout()
    except OSError as error:
        gone = terminal_gone(error)
        discard_stdout()
        return None if gone else BenchError(f"the answer could not be written: {error.strerror}")
    except ValueError as error:  # stdout was closed, or cannot write some character
        return BenchError(f"the answer could not be written: {error}")
    return None
