"""The `vcfbench` command: its groups, and what becomes of errors.

Whatever a user can cause ends in one sentence on stderr and the exit code of its kind: 0 done, 1 a limit failed,
2 usage or bench file, 3 bench or instrument, 4 aborted and safe, 5 not safe. Nothing heavy is imported before a
command runs.
"""

from __future__ import annotations

import os
import sys
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from vcfbench import __version__
from vcfbench.cli import analyze, bench, run, runs, sim
from vcfbench.errors import Aborted, BenchError

__all__ = ["app", "main"]


class Commands(TyperGroup):
    """The root of all commands; errors of any of them end here."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command; turn what a user can cause into a sentence and an exit code."""
        try:
            result = super().invoke(ctx)
            sys.stdout.flush()
        except BenchError as error:
            _tell(f"{error}; the bench was made safe" if isinstance(error, Aborted) else error)
            raise typer.Exit(error.exit_code) from None
        except KeyboardInterrupt:
            _tell("stopped by the keyboard")
            raise typer.Exit(Aborted.exit_code) from None
        except BrokenPipeError:  # whoever read our output has left: nobody is there to be told
            _discard_stdout()
            raise typer.Exit(Aborted.exit_code) from None
        return result


def _tell(what: object) -> None:
    typer.echo(f"vcfbench: {what}", err=True)


def _discard_stdout() -> None:
    """Send what is still buffered nowhere, or the interpreter complains about it when it ends."""
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


def main() -> None:
    """Run the command line."""
    app(prog_name="vcfbench")
