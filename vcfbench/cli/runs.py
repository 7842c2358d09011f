"""``vcfbench runs``: what was recorded."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from vcfbench.cli.answer import print_json
from vcfbench.cli.completion import run_names
from vcfbench.errors import ConfigError
from vcfbench.files import shown

if TYPE_CHECKING:
    from collections.abc import Iterator

    from vcfbench.record.directory import RunDirectory
    from vcfbench.record.journal import JournalRecord
    from vcfbench.record.outline import Outline
    from vcfbench.runs.run import Run

__all__ = ["app"]

app = typer.Typer(no_args_is_help=True, help="List and show records.")

Runs_ = Annotated[Path, typer.Option("--runs", metavar="DIR", help="Where the records are.")]
Json_ = Annotated[bool, typer.Option("--json", help="Print JSON on stdout and nothing else.")]


@app.command("list")
def list_(runs: Runs_ = Path("runs"), *, json: Json_ = False) -> None:
    """List the records, oldest first."""
    from vcfbench.record.directory import list_runs  # noqa: PLC0415

    known = [_listed(directory) for directory in list_runs(runs)]
    if json:
        print_json({"runs": known})
    elif not known:
        typer.echo(f"no records in {runs}")
    else:
        _print_list(known)


@app.command("show")
def show(
    run: Annotated[
        str,
        typer.Argument(
            metavar="RUN", autocompletion=run_names, help="Name of the run, its beginning or end, or 'last'."
        ),
    ],
    runs: Runs_ = Path("runs"),
    *,
    json: Json_ = False,
) -> None:
    """Show one record: points, results, and how it ended. Everything is made again from the journal."""
    from vcfbench.record.directory import find_run  # noqa: PLC0415
    from vcfbench.runs.recorded import recorded_run  # noqa: PLC0415

    directory = find_run(runs, run)
    record = directory.read()
    shown_run = recorded_run(directory, record)
    if json:
        print_json(_answer(directory, record, shown_run))
    else:
        _print_record(directory, record, shown_run)
    if record.damage is not None:
        raise ConfigError(f"{shown(directory.journal)}: the record is damaged: {record.damage}")


def _line(directory: RunDirectory, record: JournalRecord) -> dict[str, Any]:
    return {
        "run": directory.run,
        "procedure": record.header.get("procedure"),
        "status": record.status.value,
        "damage": record.damage,
        "bench": record.header.get("bench", {}).get("name"),
        "seed": record.header.get("seed"),
        "points": len(record.points),
    }


def _outlined(directory: RunDirectory, outline: Outline, verdict: str | None) -> dict[str, Any]:
    return {
        "run": directory.run,
        "procedure": outline.procedure,
        "status": outline.status.value,
        "damage": None,
        "bench": outline.bench,
        "seed": outline.seed,
        "points": len(outline.marks),
        "verdict": verdict,
    }


def _listed(directory: RunDirectory) -> dict[str, Any]:
    """Return the line of one record; one that cannot be read keeps no other from being listed."""
    from vcfbench.record.outline import outline_of  # noqa: PLC0415
    from vcfbench.runs.recorded import outlined_verdict, recorded_verdict  # noqa: PLC0415

    outline = outline_of(directory.journal)
    if outline is not None:
        with suppress(ConfigError):  # what was not stored with the run is computed from its points
            return _outlined(directory, outline, outlined_verdict(directory, outline))
    try:
        record = directory.read()
        return {**_line(directory, record), "verdict": recorded_verdict(directory, record)}
    except ConfigError as error:
        typer.echo(f"vcfbench: {error}", err=True)
        unknown = dict.fromkeys(("procedure", "status", "damage", "bench", "seed", "points", "verdict"))
        return {"run": directory.run, **unknown, "status": "unreadable"}


def _print_list(known: list[dict[str, Any]]) -> None:
    from vcfbench.report.document import Column, Table  # noqa: PLC0415
    from vcfbench.report.text import table_text  # noqa: PLC0415
    from vcfbench.runs.recorded import printable  # noqa: PLC0415

    cells = [{**line, "status": _status(line), "verdict": (line["verdict"] or "-").upper()} for line in known]
    head = [name for name in cells[0] if name != "damage"]
    rows = [[printable(line[name]) for name in head] for line in cells]
    table = table_text(Table([Column(name) for name in head], rows))
    if _fits(table):
        typer.echo(table)
        return
    for line in cells:
        typer.echo(printable(line["run"]))
        typer.echo("".join(f"  {name}: {printable(line[name])}\n" for name in head[1:]), nl=False)


def _status(line: dict[str, Any]) -> str:
    return str(line["status"]) if line["damage"] is None else f"{line['status']}: {line['damage']}"


def _fits(table: str) -> bool:
    """Tell whether lines fit where they are printed; into a pipe or a file any do."""
    import sys  # noqa: PLC0415
    from shutil import get_terminal_size  # noqa: PLC0415

    return not sys.stdout.isatty() or max(map(len, table.splitlines())) <= get_terminal_size().columns


def _answer(directory: RunDirectory, record: JournalRecord, run: Run) -> dict[str, Any]:
    told = run.as_json()
    return {
        **_line(directory, record),
        "simulated": run.simulated,
        "started_utc": record.header.get("utc"),
        "bench_seconds": run.bench_seconds,
        "physical_minimum_s": run.physical_minimum_s,
        "points": told["points"],
        "results": told["results"],
        "no_results": run.no_results,
        "acceptance": told["acceptance"],
        "asked_again": [said for step in record.steps for said in step.get("asked_again", ())],
        **{key: told[key] for key in ("resumed", "not_checked") if key in told},
        "metadata": told["metadata"],
        "equipment": told["equipment"],
        "errors": [error.get("error") for error in record.errors],
        "identities": record.header.get("identities", {}),
        "versions": record.header.get("versions", {}),
    }


def _told_of(run: Run) -> Iterator[str]:
    """Yield in lines what the record says of the run beside what was measured."""
    from vcfbench.bench.equipment import overdue_words  # noqa: PLC0415

    told = run.metadata
    conditions = ((told.ambient_temperature_c, "degC"), (told.humidity_percent, "% relative humidity"))
    words = [
        *([f"device {told.dut}"] if told.dut else []),
        *([f"operator {told.operator}"] if told.operator else []),
        *(f"{value:g} {unit}" for value, unit in conditions if value is not None),
        *(f"{key}={value}" for key, value in told.tags.items()),
    ]
    if words:
        yield ", ".join(words)
    if told.note:
        yield f"note: {told.note}"
    for each in overdue_words(run.equipment):
        yield f"overdue: {each}"


def _print_record(directory: RunDirectory, record: JournalRecord, run: Run) -> None:
    from vcfbench.report.text import text_of  # noqa: PLC0415
    from vcfbench.runs.recorded import printable  # noqa: PLC0415

    line = _line(directory, record)
    typer.echo(
        f"{printable(line['run'])}: {_status(line)}, {printable(line['procedure'])}, bench {printable(line['bench'])}, "
        f"seed {printable(line['seed'])}, {line['points']} points, began {printable(record.header.get('utc'))}\n"
    )
    for words in _told_of(run):
        typer.echo(f"{printable(words)}\n")
    typer.echo(text_of(run.report()))
    for said in run.asked_again:
        typer.echo(f"\nasked again: {printable(said)}")
    if run.no_results is not None:
        typer.echo(f"\n{'no results' if run.results is None else 'results as stored'}: {run.no_results}")
    for error in record.errors:
        typer.echo(f"\nerror: {printable(error.get('error'))}")
    typer.echo(f"\nrecord: {shown(directory.path)}")
