"""The `vcfbench` command: its groups, and what becomes of errors.

Whatever a user can cause ends in one sentence on stderr and the exit code of its kind: 0 done, 1 a limit failed,
2 usage or bench file, 3 bench or instrument, 4 aborted and safe, 5 not safe. Nothing heavy is imported before a
command runs.
"""

from __future__ import annotations

import os
import signal
import sys
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from vcfbench import __version__
from vcfbench.cli import analyze, bench, run, runs, sim, talk
from vcfbench.errors import Aborted, BenchError

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["app", "main"]


class Commands(TyperGroup):
    """The root of all commands; errors of any of them end here."""

    def make_context(self, *arguments: Any, **options: Any) -> Any:
        """Read the command line; ``--help`` and ``--version`` are answered here."""
        with _errors_told():
            return super().make_context(*arguments, **options)

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        with _errors_told():
            result = super().invoke(ctx)
            if sys.stdout is not None:  # it is None when it was closed before the start
                sys.stdout.flush()
            return result


@contextmanager
def _errors_told() -> Iterator[None]:
    """Turn what a user can cause into a sentence and an exit code."""
    try:
        yield
    except BenchError as error:
        _tell(f"{error}; the bench was made safe" if isinstance(error, Aborted) else error)
        raise typer.Exit(error.exit_code) from None
    except KeyboardInterrupt:
        _tell("stopped by the keyboard")
        raise typer.Exit(Aborted.exit_code) from None
    except BrokenPipeError:  # whoever read our output has left: nobody is there to be told
        _discard_stdout()
        raise typer.Exit(Aborted.exit_code) from None
    except OSError as error:  # a full disk behind stdout; files that the user named have errors of their own
        _tell(f"cannot read or write: {error.strerror}")
        _discard_stdout()
        raise typer.Exit(BenchError.exit_code) from None


def _tell(what: object) -> None:
    with suppress(OSError):  # who closes stderr is not told
        typer.echo(f"vcfbench: {what}", err=True)


def _discard_stdout() -> None:
    """Send what is still buffered nowhere, or the interpreter complains about it when it ends."""
    with suppress(OSError, ValueError):  # stdout need not be a file
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


app = typer.Typer(
    name="vcfbench",
    cls=Commands,
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,  # rich takes longer to import than all the rest
    pretty_exceptions_enable=False,
    help="Calibrate MEMS vibratory gyroscopes on a rate table and by a virtual Coriolis force.",
    epilog="Exit codes: 0 done, 1 a limit failed, 2 usage or bench file, 3 bench or instrument, "
    "4 aborted and safe, 5 NOT safe.",
)


def _version(*, wanted: bool) -> None:
    if wanted:
        typer.echo(f"vcfbench {__version__}")
        raise typer.Exit


@app.callback()
def root(
    *,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and leave.")
    ] = False,
) -> None:
    """Calibrate MEMS vibratory gyroscopes on a rate table and by a virtual Coriolis force."""
    del version


app.add_typer(run.app, name="run")
app.command("analyze")(analyze.analyze)
app.add_typer(runs.app, name="runs")
app.add_typer(bench.app, name="bench")
app.add_typer(sim.app, name="sim")
app.command("talk")(talk.talk)


def main() -> None:
    """Run the command line."""
    # the model's matrices have some twenty rows: threads for them cost half as much again as the whole calibration
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        app(prog_name="vcfbench")
    finally:  # the answer is given: a signal that comes this late shall not change the exit code
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)
