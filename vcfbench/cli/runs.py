"""``vcfbench runs``: what was recorded."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from vcfbench.cli.answer import print_json
from vcfbench.errors import ConfigError

if TYPE_CHECKING:
    from vcfbench.record.directory import RunDirectory
    from vcfbench.record.journal import JournalRecord

__all__ = ["app"]

app = typer.Typer(no_args_is_help=True, help="List and show records.")

Runs_ = Annotated[Path, typer.Option("--runs", metavar="DIR", help="Where the records are.")]
Json_ = Annotated[bool, typer.Option("--json", help="Print JSON on stdout and nothing else.")]


@app.command("list")
def list_(runs: Runs_ = Path("runs"), *, json: Json_ = False) -> None:
    """List the records, oldest first."""
    from vcfbench.record.directory import list_runs  # noqa: PLC0415

    known = [_line_or_why_not(directory) for directory in list_runs(runs)]
    if json:
        print_json({"runs": known})
    elif not known:
        typer.echo(f"no records in {runs}")
    else:
        _print_list(known)


@app.command("show")
def show(
    run: Annotated[str, typer.Argument(metavar="RUN", help="Name of the run, its beginning or end, or 'last'.")],
    runs: Runs_ = Path("runs"),
    *,
    json: Json_ = False,
) -> None:
    """Show one record: points, results, and how it ended. Everything is made again from the journal."""
    from vcfbench.record.directory import find_run  # noqa: PLC0415

    directory = find_run(runs, run)
    record = directory.read()
    if json:
        print_json(_answer(directory, record))
    else:
        _print_record(directory, record)


def _line(directory: RunDirectory) -> dict[str, Any]:
    record = directory.read()
    return {
        "run": directory.run,
        "procedure": record.header.get("procedure"),
        "status": record.status.value,
        "bench": record.header.get("bench", {}).get("name"),
        "seed": record.header.get("seed"),
        "points": len(record.points),
    }


def _line_or_why_not(directory: RunDirectory) -> dict[str, Any]:
    """Return the line of one record; one that cannot be read keeps no other from being listed."""
    try:
        return _line(directory)
    except ConfigError as error:
        typer.echo(f"vcfbench: {error}", err=True)
        unknown = dict.fromkeys(("procedure", "status", "bench", "seed", "points"))
        return {"run": directory.run, **unknown, "status": "unreadable"}


def _print_list(known: list[dict[str, Any]]) -> None:
    from vcfbench.report.table import columns  # noqa: PLC0415

    typer.echo(columns(list(known[0]), ([str(value) for value in line.values()] for line in known)))


def _answer(directory: RunDirectory, record: JournalRecord) -> dict[str, Any]:
    footer = record.footer or {}
    return {
        **_line(directory),
        "simulated": record.header.get("simulated"),
        "started_utc": record.header.get("utc"),
        "bench_seconds": footer.get("bench_seconds"),
        "physical_minimum_s": footer.get("physical_minimum_s"),
        "points": [point.as_json() for point in record.points],
        "results": _results(record),
        "errors": [error["error"] for error in record.errors],
        "identities": record.header.get("identities", {}),
        "versions": record.header.get("versions", {}),
    }


def _results(record: JournalRecord) -> dict[str, Any]:
    """Compute the results again from the points of a complete run; of any other there are none."""
    from vcfbench.procedures.catalogue import procedure  # noqa: PLC0415
    from vcfbench.procedures.settings import CalibrationSettings  # noqa: PLC0415
    from vcfbench.record.schema import Status  # noqa: PLC0415

    if record.status is not Status.COMPLETE:
        return {}
    try:
        settings = CalibrationSettings.from_json(record.header["settings"])
        name = str(record.header["procedure"])
    except (KeyError, ValueError) as error:  # msgspec.ValidationError is a ValueError
        raise ConfigError(f"the record's header is not one of this version: {error!r}") from error
    return procedure(name).results(settings, record.points)


def _print_record(directory: RunDirectory, record: JournalRecord) -> None:
    from vcfbench.report.table import summary  # noqa: PLC0415

    line = _line(directory)
    typer.echo(
        f"{line['run']}: {line['status']}, bench {line['bench']}, seed {line['seed']}, {line['points']} points\n"
    )
    typer.echo(summary(str(line["procedure"]), record.points, _results(record)))
    for error in record.errors:
        typer.echo(f"\nerror: {error['error']}")
    typer.echo(f"\nrecord: {directory.path}")
