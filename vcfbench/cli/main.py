"""The `vcfbench` command: its groups, and its handling of errors.

Whatever a user can cause ends in one sentence on stderr and the exit code of its kind: 0 done, 1 a limit failed,
2 usage or bench file, 3 bench or instrument, 4 aborted and safe, 5 not safe. Nothing heavy is imported before a
command runs.
"""

import gc
import os
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from vcfbench.cli.ending import (
    JSON_DUE,
    SignalsWithoutBench,
    discard_stdout,
    ending_of,
    open_streams,
    print_error,
    say,
    usage_of,
)
from vcfbench.errors import BenchError, NotSafe
from vcfbench.instructions.titles import BUILT_IN
from vcfbench.version import installed_version

COMMANDS = {
    "run": "Run a calibration procedure on a bench.",
    "resume": "Go on with a run that failed, or was stopped or killed.",
    "batch": "Measure gyroscopes one after another.",
    "panel": "Measure gyroscopes one after another, started in a browser.",
    "study": "Run a procedure many times on simulated benches.",
    "report": "Write the report of a run as one file.",
    "compare": "Compare runs with the first of them.",
    "device": "Show the calibration history of a gyroscope.",
    "runs": "List, show and export records.",
    "plot": "Draw the figures of a run.",
    "page": "Show runs and devices in a browser.",
    "analyze": "Analyse a calibration table.",
    "bench": "Make, show and check a bench.",
    "talk": "Talk to the bench, or to one of its instruments.",
    "safe": "Stop the table, switch the outputs off, check both.",
    "sim": "Show the simulated bench, make one, serve it.",
    "kit": "Record how instruments answer, and check it.",
    "validate": "Validate the program on this machine.",
    "article": "Make the paper's numbers, figures and errata again.",
}
"""Commands in the order of the help, each in the module of its name, which has an `app` with commands or the one.

What each does stands here in a few words, because the list of all commands would load all of them for it.
"""
_GROUPS = {
    "Measure": ("run", "resume", "batch", "panel", "study"),
    "Results": ("report", "compare", "device", "runs", "plot", "page", "analyze"),
    "Bench": ("bench", "talk", "safe"),
    "Program": ("sim", "kit", "validate", "article"),
}
"""Headings of the help, and the commands below each."""


_ELSEWHERE = {"resume": "run"}
"""Modules of commands that share another's options."""


class Commands(TyperGroup):
    """The root of all commands, each imported at its use; it prints the errors of all."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of the commands."""
        return [*COMMANDS, *(name for name in super().list_commands(ctx) if name not in COMMANDS)]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command; for a name that is none all are loaded, so that Typer can say which one is like it."""
        for name in (cmd_name,) if cmd_name in COMMANDS else COMMANDS:
            if name not in self.commands:
                module = import_module(f"vcfbench.cli.{_ELSEWHERE.get(name, name)}")
                alone = typer.Typer(rich_markup_mode=None)
                if name not in _ELSEWHERE and hasattr(module, "app"):
                    alone.add_typer(module.app, name=name)
                else:
                    alone.command(name)(getattr(module, name))
                self.commands[name] = typer.main.get_group(alone).commands[name]
        return super().get_command(ctx, cmd_name)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the named command; a command of a group, or a procedure, has several words."""
        try:
            return super().resolve_command(ctx, args)
        except Exception as error:
            groups = (group for group, command in self.commands.items() if args[0] in getattr(command, "commands", ()))
            meant = [*groups, *(["run"] if args[0] in BUILT_IN else [])]
            if meant and hasattr(error, "message"):
                error.message += f" Did you mean {' or '.join(f'vcfbench {each} {args[0]}' for each in meant)}?"
            raise

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the names of the commands and their summaries in groups, without importing one."""
        for heading, names in _GROUPS.items():
            with formatter.section(heading):
                formatter.write_dl([(name, COMMANDS[name]) for name in names])

    def make_context(self, *arguments: Any, **options: Any) -> Any:
        """Read the command line; ``--help`` and ``--version`` are answered here."""
        JSON_DUE.set("--json" in (options.get("args") or arguments[1]))
        with _errors_reported():
            return super().make_context(*arguments, **options)

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        with _errors_reported():
            try:
                result = super().invoke(ctx)
            except SystemExit as leaving:  # of anyone's procedure; its code would be taken for a verdict
                raise RuntimeError("sys.exit was called in mid-command") from leaving
            if sys.stdout is not None:  # it is None when it was closed before the start
                sys.stdout.flush()
            return result


@contextmanager
def _errors_reported() -> Iterator[None]:
    """Turn an error of the user's into a sentence and an exit code."""
    try:
        yield
    except typer.Exit:
        raise
    except BaseException as error:
        code = _report(error)
        if code is None:
            raise
        raise typer.Exit(code) from error


def _report(error: BaseException) -> int | None:
    """Print the error that ended the command and return its exit code; None for a mistake of ours."""
    ending = ending_of(error) or usage_of(error)
    if ending is None:
        return None
    words, code = ending
    if isinstance(error, OSError):
        discard_stdout()
    if words:
        usage: Any = usage_of(error) and error
        say(words if usage else f"vcfbench: {words}", alarm=code == NotSafe.exit_code)
        print_error(usage.format_message() if usage else words, code)
    return code


app = typer.Typer(
    name="vcfbench",
    cls=Commands,
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    rich_markup_mode=None,  # rich takes longer to import than all the rest
    pretty_exceptions_enable=False,
    help="Calibrate MEMS vibratory gyroscopes on a rate table and by a virtual Coriolis force.",
    epilog="Exit codes: 0 done, 1 a limit failed, 2 usage or bench file, 3 bench or instrument, "
    "4 aborted and safe, 5 NOT safe.",
)


def _version(*, wanted: bool) -> None:
    if wanted:
        typer.echo(f"vcfbench {installed_version()}")
        raise typer.Exit


@app.callback()
def root(
    *,
    version: Annotated[
        bool, typer.Option("--version", "-v", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """Calibrate MEMS vibratory gyroscopes on a rate table and by a virtual Coriolis force."""
    del version


def main() -> None:
    """Run the command line; the process ends with the code of the worst error."""
    # the model's matrices have some twenty rows: threads for them cost half as much again as the whole calibration
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    open_streams()
    code = BenchError.exit_code
    with SignalsWithoutBench() as signals:
        try:
            code = app(prog_name="vcfbench", standalone_mode=False, obj=signals) or 0
            signals.answered()
        except SystemExit as leaving:  # Typer's own way out, once a shell has its completions
            code = leaving.code if isinstance(leaving.code, int) else 0
        except BaseException as error:  # noqa: BLE001  # a signal, on the way out, or a mistake of ours
            signals.answered()
            known = _report(error)
            if known is None:  # never 1, a verdict
                say("".join(traceback.format_exception(error)).rstrip("\n"))
                print_error(f"the program has a mistake: {type(error).__name__}: {error}", code)
            code = BenchError.exit_code if known is None else known
        try:
            sys.stdout.flush()
        except (OSError, ValueError):
            discard_stdout()
        # the end of the process gives all memory back at once; Python would first look through every object for cycles
        gc.freeze()
        sys.exit(code)
