"""``vcfbench analyze``: the whole analysis of a table that was measured somewhere else."""

from json import dumps
from pathlib import Path
from typing import Annotated

import typer

from vcfbench.archive.analyzed import TableAnalysis
from vcfbench.archive.analyzed import analyze as analyzed
from vcfbench.archive.analyzed_record import RecordAnalysis, analyze_record, begins_with_times
from vcfbench.archive.written import write_document
from vcfbench.cli.options import Json_, argument, option, output_option
from vcfbench.errors import ConfigError
from vcfbench.reports.text import text_of

_WIDTH = 80


def analyze(  # noqa: PLR0917  # options of a command
    file: Annotated[
        Path,
        argument(
            "FILE.csv",
            "Table: first column rate_deg_s, every other column an output in volts. With --rate, or a column of "
            "times: a record at rest, one line a reading.",
        ),
    ],
    compare: Annotated[
        str | None, option("A,B", "Compare column B with column A. Two columns are compared by default.")
    ] = None,
    rate: Annotated[float | None, option("HZ", "A record at rest: readings a second.", min=1e-6)] = None,
    column: Annotated[str | None, option("NAME", "Of a record at rest: which column.")] = None,
    scale_factor: Annotated[
        float | None, option("V/(deg/s)", "Of a record at rest in volts: its scale factor.")
    ] = None,
    output: Annotated[Path | None, output_option("Write a report: .html, .pdf or .md.")] = None,
    *,
    json: Json_ = False,
) -> None:
    """Analyse a calibration table, or with --rate the noise of a record at rest: Allan deviation, N, B, K, R."""
    if rate is not None or column is not None or scale_factor is not None or begins_with_times(file):
        if compare is not None:
            raise ConfigError("--compare: of a calibration table, not of a record at rest")
        of_record = analyze_record(file, rate, column=column, scale_factor_v_per_deg_s=scale_factor)
        _answer(of_record, f"Noise of {of_record.column}", file.name, output, json=json)
        return
    names = None if compare is None else [name.strip() for name in compare.split(",")]
    _answer(analyzed(file, names), f"Analysis of {file.name}", file.name, output, json=json)


def _answer(found: TableAnalysis | RecordAnalysis, title: str, name: str, output: Path | None, *, json: bool) -> None:
    typer.echo(dumps(found.as_json(), allow_nan=False) if json else text_of(found.report(), _WIDTH))
    if output is not None:
        for written in write_document(found.report(), title, name, output):
            typer.echo(written, err=json)
