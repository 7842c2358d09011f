"""``vcfbench runs``: the records of runs."""

import sys
from collections.abc import Sequence
from csv import writer as csv_writer
from itertools import islice
from pathlib import Path
from shutil import get_terminal_size
from typing import Annotated

import typer
from msgspec import structs, to_builtins

from vcfbench.archive.amending import amend_run
from vcfbench.archive.export import export_run
from vcfbench.archive.recorded import directory_of, recorded_run
from vcfbench.archive.run import Run
from vcfbench.archive.summary import RunSummary, run_summaries
from vcfbench.archive.verified import verify_run
from vcfbench.cli.answer import not_seen, print_json, print_not_seen, print_report, print_verdicts
from vcfbench.cli.options import (
    Json_,
    Run_,
    Runs_,
    argument,
    flag,
    keys_and_values,
    option,
    output_option,
    run_names,
    tags_of,
)
from vcfbench.errors import ConfigError
from vcfbench.files import shown
from vcfbench.records import signing
from vcfbench.records.directory import RunDirectory
from vcfbench.records.journal import JournalRecord
from vcfbench.reports.document import Column, Table
from vcfbench.reports.text import printable, table_text
from vcfbench.station.equipment import overdue_words

app = typer.Typer(no_args_is_help=True, help="List and show records.")


@app.command("list")
def list_(
    runs: Runs_ = Path("runs"),
    *,
    dut: Annotated[str | None, option("SERIAL", "Only runs of this device.")] = None,
    since: Annotated[str | None, option("DATE", "Only runs that began on this day (UTC) or later.")] = None,
    status: Annotated[str | None, option("STATUS", "Only runs with this status: complete, aborted, ...")] = None,
    procedure: Annotated[str | None, option("NAME", "Only runs of this procedure.")] = None,
    tag: Annotated[
        list[str] | None, option("KEY=VALUE", "Only runs with this tag. Repeatable: all must match.")
    ] = None,
    json: Json_ = False,
    csv: Annotated[bool, flag("Print comma-separated values, one row for each run.", "--csv")] = False,
) -> None:
    """List the records, oldest first: device, key results, verdict."""
    if json and csv:
        raise ConfigError("--json and --csv: expected one of the two, got both")
    asked = {"dut": dut, "since": since, "status": status, "procedure": procedure}
    known = run_summaries(runs, **asked, tags=tags_of(tag or ()))
    for each in known:
        if each.problem is not None:
            typer.echo(f"vcfbench: {each.problem}", err=True)
        if each.copies:
            typer.echo(f"vcfbench: {printable(', '.join(each.copies))}: copies of {printable(each.run)}", err=True)
    if json:
        print_json({"runs": [each.as_json() for each in known]})
    elif csv:
        # Print a row a run; for each result that one of them has: value, uncertainty, unit, missing contributions
        names = list(dict.fromkeys(name for each in known for name in each.results))
        writer = csv_writer(sys.stdout, lineterminator="\n")
        writer.writerow(
            [*_CSV, "tags", *(f"{name}{part}" for name in names for part in ("", "_u", "_u95", "_unit", "_missing"))]
        )
        for each in known:
            values = each.as_json()
            found = [each.results.get(name) for name in names]
            parts = [
                part
                for k in found
                for part in ((None,) * 5 if k is None else (k.value, k.u, k.u95, k.unit, ";".join(k.missing)))
            ]
            tags = ";".join(f"{key}={value}" for key, value in each.tags.items())
            cells = [*(values[name] for name in _CSV), tags, *parts]
            # a spreadsheet would take some texts for formulas: those have an apostrophe before them
            texts = [f"'{cell}" if isinstance(cell, str) and cell[:1] in "=+-@" and cell else cell for cell in cells]
            writer.writerow([printable(cell) if isinstance(cell, str) else cell for cell in texts])
    elif not known:
        typer.echo(f"no records in {runs}" if not any((*asked.values(), tag)) else f"no such records in {runs}")
    else:
        _print_list(known)


@app.command("show")
def show(run: Run_, runs: Runs_ = Path("runs"), *, json: Json_ = False) -> None:
    """Show one record: points, results, and its end. All is computed again from the journal."""
    directory = directory_of(run, runs)
    record = directory.read()
    shown_run = recorded_run(directory, record)
    if json:
        print_json(
            {
                "revision": shown_run.revision,
                "amendments": [],
                **shown_run.as_json(),
                "damage": record.damage,
                "started_utc": record.header.get("utc"),
                "bench_seconds": shown_run.bench_seconds,
                "physical_minimum_s": shown_run.physical_minimum_s,
                "no_results": shown_run.no_results,
                "not_seen": not_seen(shown_run),
                "asked_again": [said for step in record.steps for said in step.get("asked_again", ())],
                "errors": [error.get("error") for error in record.errors],
                "identities": record.header.get("identities", {}),
                "versions": record.header.get("versions", {}),
            }
        )
    else:
        _print_run(directory, record, shown_run)
    if record.damage is not None:
        raise ConfigError(f"{shown(directory.journal)}: the record is damaged: {record.damage}")


def _print_run(directory: RunDirectory, record: JournalRecord, run: Run) -> None:
    """Print a line of the record, its metadata, the report, and the versions that made it."""
    header, metadata = record.header, run.metadata
    typer.echo(
        f"{printable(directory.run)}: {_status(record.status.value, record.damage)}, "
        f"{printable(header.get('procedure'))}, bench {printable(header.get('bench', {}).get('name'))}, "
        f"seed {printable(header.get('seed'))}, {len(record.points)} points, began {printable(header.get('utc'))}\n"
    )
    conditions = ((metadata.ambient_temperature_c, "degC"), (metadata.humidity_percent, "% relative humidity"))
    words = [
        *([f"device {metadata.dut}"] if metadata.dut else []),
        *([f"operator {metadata.operator}"] if metadata.operator else []),
        *(f"{value:g} {unit}" for value, unit in conditions if value is not None),
        *(f"{key}={value}" for key, value in metadata.tags.items()),
    ]
    for each in (
        *([", ".join(words)] if words else []),
        *([f"note: {metadata.note}"] if metadata.note else []),
        *(f"overdue: {each}" for each in overdue_words(run.equipment)),
        *(amendment.words() for amendment in run.amendments),
    ):
        typer.echo(f"{printable(each)}\n")
    print_report(run.report())
    for said in run.asked_again:
        typer.echo(f"\nquery repeated: {printable(said)}")
    print_not_seen(run)
    if run.no_results is not None:
        typer.echo(f"\n{'no results' if run.results is None else 'results as stored'}: {run.no_results}")
    for error in record.errors:
        typer.echo(f"\nerror: {printable(error.get('error'))}")
    versions = header.get("versions")
    if isinstance(versions, dict):
        programs = ", ".join(f"{name} {version}" for name, version in versions.items())
        typer.echo(f"\n{printable('made with ' + programs)}")
    firmware = [f"{each.model} {each.identity.firmware}" for each in run.equipment if each.identity is not None]
    if firmware:
        typer.echo(f"\n{printable('firmware: ' + ', '.join(firmware))}")
    typer.echo(f"\nrecord: {shown(directory.path)}")


@app.command("export")
def export(
    run: Run_,
    runs: Runs_ = Path("runs"),
    *,
    raw: Annotated[bool, flag("Write every raw reading instead of the points.", "--raw")] = False,
    format_: Annotated[
        str | None, option("csv|parquet|hdf5|xlsx|mat", "Format. Default: by the suffix of FILE.", "--format")
    ] = None,
    output: Annotated[Path | None, output_option("Where to write. Default: RUN-points or RUN-readings here.")] = None,
    json: Json_ = False,
) -> None:
    """Write the points of a run, or every raw reading, for other programs."""

    def progress(rows: int, of: int) -> None:  # a million rows take a spreadsheet most of a minute
        end = "\r" if rows < of else "\r\x1b[K"
        typer.echo(f"\r{100 * rows // of:3} % of {of} rows{end}", err=True, nl=False)

    seen = progress if sys.stderr.isatty() else None
    done = export_run(run, output, format=format_, raw=raw, runs=runs, progress=seen)
    if json:
        print_json({**structs.asdict(done), "file": str(done.file)})
    else:
        typer.echo(f"{shown(done.file)}: {done.rows} {done.table}, {len(done.columns)} columns")


@app.command("amend")
def amend(
    run: Run_,
    runs: Runs_ = Path("runs"),
    *,
    set_: Annotated[
        list[str],
        option(
            "KEY=VALUE",
            "Field to amend: dut, operator, note, checked_by, customer, tags.KEY. Repeatable; empty takes away.",
            "--set",
        ),
    ],
    reason: Annotated[str, option("TEXT", "Why.")],
    by: Annotated[str | None, option("NAME", "Who amends. Default: who is logged in.")] = None,
    json: Json_ = False,
) -> None:
    """Amend the metadata of a run, by a line that is added to its record. No reading can be changed."""
    changes = keys_and_values("--set", set_, "dut=G-018")
    done = amend_run(run, changes, reason=reason, by=by, runs=runs)
    for words in done.stays:
        typer.echo(f"vcfbench: {words}", err=True)
    if json:
        print_json(to_builtins(done))
    else:
        typer.echo(f"{shown(done.run)}: {printable(done.amendment.words())}")


@app.command("verify")
def verify(
    names: Annotated[
        list[str], argument("RUN...", "Directories of runs, their names, or 'last'.", autocompletion=run_names)
    ],
    runs: Runs_ = Path("runs"),
    *,
    key: Annotated[
        list[Path] | None, option("FILE", "Public key that must have signed them. Repeatable: one of them.")
    ] = None,
    json: Json_ = False,
) -> None:
    """Check that records are as written: PASS, or the first fault; exit 1 unless all pass."""
    keys = [signing.public_key_of(each) for each in key or ()]
    found = [verify_run(each, runs, keys=keys) for each in names]
    if json:
        print_json({"runs": [to_builtins(each) for each in found]})
    for each in () if json else found:
        typer.echo(f"{printable(each.run)}: {each.verdict}" + (f": {printable(each.wrong)}" if each.wrong else ""))
        for note in each.notes:
            typer.echo(f"  {printable(note)}")
    if any(each.verdict != "PASS" for each in found):
        raise typer.Exit(1)


@app.command("new-key")
def new_key(file: Annotated[Path, argument("FILE", "Where the private key goes; FILE.pub is the public.")]) -> None:
    """Make a key that signs records: name FILE in [laboratory] of the bench file, or in VCFBENCH_SIGNING_KEY."""
    public = signing.new_key(file)
    typer.echo(
        f"{shown(file)}: keep it where only its owner can read it\n{shown(public)}: give it to those who verify records"
    )


_HEAD = ("run", "procedure", "status", "bench", "seed", "device", "points", "results", "verdict")
_CSV = (
    *("run", "procedure", "status", "damage", "bench", "seed", "points", "started_utc"),
    *("dut", "operator", "note", "verdict", "revision"),
)
_SHOWN_RESULTS = 2
"""Results of a run in its line; --json and --csv have all of them."""


def _print_list(known: Sequence[RunSummary]) -> None:
    rows = []  # a table escapes what would write on the terminal itself
    for run in known:
        dut = (run.dut or "-") + " (amended)" * ("dut" in run.amended)
        results = [f"{name} {found}" for name, found in islice(run.results.items(), _SHOWN_RESULTS)]
        cells = (run.run, run.procedure, _status(run.status, run.damage), run.bench, run.seed, dut, run.points)
        rows.append([*map(str, cells), "; ".join(results) or "-", (run.verdict or "-").upper()])
    table = table_text(Table([Column(name) for name in _HEAD], rows))
    # Whether lines fit where they are printed; into a pipe or a file any do
    if not sys.stdout.isatty() or max(map(len, table.splitlines())) <= get_terminal_size().columns:
        print_verdicts(table)
        return
    for name, *others in rows:
        lines = [f"  {head}: {printable(each)}" for head, each in zip(_HEAD[1:], others, strict=True)]
        lines = [each.replace("; ", "\n    ") if each.startswith("  results: ") else each for each in lines]
        print_verdicts("\n".join([printable(name), *lines]))


def _status(status: str, damage: str | None) -> str:
    return status if damage is None else f"{status}: {damage}"
