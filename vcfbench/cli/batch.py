"""``vcfbench batch``: gyroscopes one after another, and the sheet of all."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer
from msgspec import structs, to_builtins

from vcfbench.archive.batch_sheet import batch_sheet, sheet_rows, write_sheet
from vcfbench.cli.answer import print_json, print_verdicts
from vcfbench.cli.conduct import RunOptions, attended
from vcfbench.cli.ending import SignalsWithoutBench
from vcfbench.cli.options import Json_, Plain_, Quiet_, Runs_, Speed_, Yes_, argument, option
from vcfbench.cli.person import somebody_there
from vcfbench.errors import Aborted, BenchError, ConfigError, NotSafe
from vcfbench.reports.text import text_of
from vcfbench.runs.batch import Batch, read_batch, with_operator
from vcfbench.runs.request import Prepared
from vcfbench.safety.signals import StopSignals

_WIDTH = 80


def batch(
    file: Annotated[Path, argument("PLAN.toml", "The batch: name, bench, runs, devices.")],
    runs: Runs_ = Path("runs"),
    sheet: Annotated[Path | None, option("FILE", "Write the sheet: .html, .pdf, .xlsx or .md.")] = None,
    operator: Annotated[str | None, option("NAME", "Who measures, in place of the plan's.")] = None,
    speed: Speed_ = None,
    *,
    context: typer.Context,
    json: Json_ = False,
    quiet: Quiet_ = False,
    plain: Plain_ = False,
    yes: Yes_ = False,
) -> None:
    """Measure gyroscopes one after another, each by the same runs, and show the sheet of all.

    Typed again, the same command goes on with what has no complete record yet; a device that failed is tried again.
    """
    asked = with_operator(read_batch(file), operator)
    options = RunOptions(bench=Path(asked.bench), json=json, runs=runs, speed=speed, quiet=quiet, plain=plain, yes=yes)
    if not (yes or asked.description.simulated or somebody_there()):
        raise ConfigError(
            f"batch {asked.name}: somebody has to mount the devices, and there is no terminal to ask on",
            hint="--yes where another program mounts them",
        )
    for serial in asked.devices:
        asked.check(serial, runs)  # before anybody mounts anything
    worst = 0
    try:
        for serial in asked.devices or _typed(asked, runs):
            worst = max(worst, _measure(asked, serial, options))
    finally:  # what there is, also when the batch was stopped
        rows = sheet_rows(asked.name, runs)
        written = () if sheet is None else write_sheet(asked.name, rows, sheet)
        if json:
            listed = [to_builtins(each) for each in rows]
            print_json({"batch": asked.name, "rows": listed, "sheet": list(map(str, written))})
        else:
            print_verdicts(text_of(batch_sheet(asked.name, rows), _WIDTH))
            for each in written:
                typer.echo(f"sheet: {each}")
    if (ending := context.find_object(SignalsWithoutBench)) is not None:
        ending.answered()
    if worst:
        raise typer.Exit(worst)


def _typed(asked: Batch, runs: Path) -> Iterator[str]:
    """Yield serial numbers as they are typed or scanned, until an empty line; one that cannot be is asked for again."""
    while True:
        if somebody_there():
            typer.echo("\nSerial number of the next device (nothing: the batch ends): ", err=True, nl=False)
        if sys.stdin is None or not (serial := sys.stdin.readline().strip()):
            return
        try:
            asked.check(serial, runs)
        except ConfigError as error:
            typer.echo(f"vcfbench: {error}", err=True)
            continue
        yield serial


def _measure(asked: Batch, serial: str, options: RunOptions) -> int:
    """Measure one device by what is left of the runs; return the exit code that it alone would have."""
    left = asked.left(serial, options.runs)
    if not left:
        typer.echo(f"{serial}: measured already", err=True)
        return 0
    if somebody_there() and not options.yes:
        typer.echo(f"\nPlease mount {serial}, then press Enter: ", err=True, nl=False)
        if not sys.stdin.readline():
            raise Aborted(f"the terminal was closed where somebody had to mount {serial}")
    passed = True
    for each in left:
        request = asked.request(each, serial, options.runs, options.speed)
        try:
            with StopSignals() as signals:
                run = attended(request, Prepared, structs.replace(options, seed=request.seed), signals, None)
            if run.error is not None:
                raise run.error
        except (Aborted, NotSafe):
            raise
        except BenchError as error:
            typer.echo(f"vcfbench: {serial}: {each.procedure.name}: {error}; the batch goes on", err=True)
            return error.exit_code  # its next run would meet the same
        passed = passed and (run.verdict is None or run.verdict.passed)
        word = run.status.value if run.verdict is None else run.verdict.word.upper()
        typer.echo(f"{serial}: {each.procedure.name}: {word}, {run.directory}", err=True)
    return 0 if passed else 1
