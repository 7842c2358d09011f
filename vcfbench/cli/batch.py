"""``vcfbench batch``: gyroscopes one after another, and the sheet of all."""

import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from msgspec import Struct, structs, to_builtins

from vcfbench.archive.batch_sheet import batch_sheet, write_sheet
from vcfbench.cli.answer import print_json, print_verdicts
from vcfbench.cli.conduct import RunOptions, attended
from vcfbench.cli.ending import SignalsWithoutBench
from vcfbench.cli.options import DevicesOfPlan_, Json_, Plain_, Quiet_, Runs_, Speed_, Yes_, argument, option
from vcfbench.cli.person import somebody_there
from vcfbench.errors import Aborted, BenchError, ConfigError, NotSafe
from vcfbench.records.schema import Status
from vcfbench.reports.text import text_of
from vcfbench.runs.batch import Batch, read_batch
from vcfbench.runs.request import Prepared
from vcfbench.safety.control import RunControl
from vcfbench.safety.signals import StopSignals
from vcfbench.station.acceptance import Acceptance

if TYPE_CHECKING:
    from vcfbench.page.server import LivePage

_WIDTH = 80


def batch(
    file: Annotated[Path, argument("PLAN.toml", "The batch: name, bench, runs, devices.")],
    *,
    runs: Runs_ = Path("runs"),
    devices: DevicesOfPlan_ = None,
    sheet: Annotated[Path | None, option("FILE", "Write the sheet: .html, .pdf, .xlsx or .md.")] = None,
    operator: Annotated[str | None, option("NAME", "Operator, in place of the plan's.")] = None,
    speed: Speed_ = None,
    context: typer.Context,
    json: Json_ = False,
    quiet: Quiet_ = False,
    plain: Plain_ = False,
    yes: Yes_ = False,
) -> None:
    """Measure gyroscopes one after another, each by the same runs, and show the sheet of all.

    Typed again, the same command goes on with what has no complete record as the plan asks for it; a device that failed
    is tried again. The exit code is that of all devices.
    """
    asked = read_batch(file, operator, devices)
    options = RunOptions(bench=Path(asked.bench), json=json, runs=runs, speed=speed, quiet=quiet, plain=plain, yes=yes)
    if not (yes or asked.description.simulated or somebody_there()):
        raise ConfigError(
            f"batch {asked.name}: expected a terminal, to ask a person to mount the devices",
            hint="--yes where another program mounts them",
        )
    for serial in asked.devices:
        asked.check(serial, runs)  # before anybody mounts anything
    if sheet is not None:
        write_sheet(asked.name, asked.rows(runs, {}), sheet)  # what cannot be written is known now
    worst, why = 0, dict[str, str]()
    try:
        for serial in asked.devices or _typed(asked, runs):
            outcome = _mounted(asked, serial, options)
            worst = max(worst, outcome.code)
            why |= {serial: outcome.why} if outcome.code else {}
    finally:  # what there is, also when the batch was stopped
        left_out = asked.left_out(runs)
        rows = asked.rows(runs, why, left_out)
        if not json:
            print_verdicts(text_of(batch_sheet(asked.name, rows, left_out), _WIDTH))
        written = () if sheet is None else write_sheet(asked.name, rows, sheet, left_out)
        if json:
            listed = [to_builtins(each) for each in rows]
            answer = {"batch": asked.name, "rows": listed, "left_out": left_out, "sheet": list(map(str, written))}
            print_json(answer)
        else:
            for each in written:
                typer.echo(f"sheet: {each}")
    if (ending := context.find_object(SignalsWithoutBench)) is not None:
        ending.answered()
    tried = {each.device for each in rows if not each.waits}
    of_lot = [each for each in rows if each.device in tried and not each.passed]
    if code := max([worst, *(1 if each.status is Status.COMPLETE else BenchError.exit_code for each in of_lot)]):
        raise typer.Exit(code)


def _typed(asked: Batch, runs: Path) -> Iterator[str]:
    """Yield serial numbers as they are typed or scanned, until an empty line; one that cannot be is asked for again."""
    while True:
        if somebody_there():
            typer.echo("\nSerial number of the next device (nothing: the batch ends): ", err=True, nl=False)
        if sys.stdin is None or not (serial := sys.stdin.readline().strip()):
            break
        try:
            asked.check(serial, runs)
        except ConfigError as error:
            if not somebody_there():  # nobody would type it again
                raise
            typer.echo(f"vcfbench: {error}", err=True)
            continue
        yield serial
    if not asked.rows(runs, {}):
        words = f"batch {asked.name}: expected at least one device"
        raise ConfigError(words, hint="devices = [...] in the plan, or a serial number a line on standard input")


class Outcome(Struct, frozen=True):
    """Outcome of a device: exit code that it alone would have, one word and the explanation."""

    code: int
    word: str
    why: str = ""


def _mounted(asked: Batch, serial: str, options: RunOptions) -> Outcome:
    """Have one device mounted and measure it."""
    for run, reason in asked.left_out(options.runs, serial).items():
        typer.echo(f"{run}: left out, {reason}", err=True)
    if not asked.left(serial, options.runs):
        typer.echo(f"{serial}: measured already", err=True)
        return Outcome(0, "DONE")
    if somebody_there() and not options.yes:
        typer.echo(f"\nPlease mount {serial}, then press Enter: ", err=True, nl=False)
        if not sys.stdin.readline():
            raise Aborted(f"the terminal was closed during the request to mount {serial}")
    return measured(asked, serial, options)


def measured(asked: Batch, serial: str, options: RunOptions, page: "LivePage | None" = None) -> Outcome:
    """Measure one device by the rest of its runs; `page` shows them.

    Raises:
        Aborted: somebody stopped it.
        NotSafe: the bench was left live.
    """
    left, verdicts = asked.left(serial, options.runs), dict[str, Acceptance]()
    before = control = RunControl()
    for number, each in enumerate(left, 1):
        request = asked.request(each, serial, options.runs, options.speed)
        if page is not None and page.panel is not None:
            before, control = control, RunControl()
            page.follow(control)  # from here on a stop is of this run
            if before.stop_by:
                control.stop(before.stop_by)
                raise Aborted(f"stopped by the page before {each.procedure.name} began")
        try:
            with StopSignals() as signals:
                if page is not None and page.panel is not None:
                    page.panel.begin(each.procedure.name, number, len(left), page.view)
                    person = None if options.yes else page.panel.person(signals)
                    request = structs.replace(request, control=control, person=person)
                run = attended(request, Prepared, structs.replace(options, seed=request.seed), signals, page)
                if page is not None:
                    page.ended(run)
            if run.error is not None:
                raise run.error
        except (Aborted, NotSafe):
            raise
        except BenchError as error:
            why = f"{each.procedure.name}: {error}"
            typer.echo(f"vcfbench: {serial}: {why}; the batch goes on", err=True)
            return Outcome(error.exit_code, "ERROR", why)  # its next run would meet the same
        if run.verdict is not None:
            verdicts[each.procedure.name] = run.verdict
        word = run.status.value if run.verdict is None else run.verdict.said
        typer.echo(f"{serial}: {each.procedure.name}: {word}, {run.directory}", err=True)
    return _judged(verdicts)


def _judged(verdicts: Mapping[str, Acceptance]) -> Outcome:
    """Return the verdict on a device by those on its runs."""
    if failed := [f"{name}: {verdict.said}" for name, verdict in verdicts.items() if not verdict.passed]:
        failing = any(verdict.word == "fail" for verdict in verdicts.values())
        return Outcome(1, "FAIL" if failing else "MARGINAL", "; ".join(failed))
    said = [f"{name}: {verdict.said}" for name, verdict in verdicts.items() if verdict.said != "PASS"]
    return Outcome(0, "PASS", "; ".join(said)) if verdicts else Outcome(0, "DONE", "no limit judges it")
