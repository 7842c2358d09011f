"""``vcfbench analyze``: the whole analysis of a table that was measured somewhere else."""

import sys
from csv import reader
from json import dumps
from pathlib import Path
from typing import Annotated

import typer

from vcfbench.analysis.csv_table import Layout, read_head
from vcfbench.archive.analyzed import TableAnalysis
from vcfbench.archive.analyzed import analyze as analyzed
from vcfbench.archive.analyzed_axes import AxesAnalysis, analyze_axes
from vcfbench.archive.analyzed_record import RecordAnalysis, analyze_record, is_record
from vcfbench.archive.analyzed_temperature import TemperatureAnalysis, analyze_temperature
from vcfbench.archive.table_files import opened_table
from vcfbench.archive.written import write_document
from vcfbench.cli.options import Json_, argument, flag, key_and_value, keys_and_values, option, output_option
from vcfbench.errors import ConfigError
from vcfbench.files import shown
from vcfbench.reports.text import text_of

_WIDTH = 80


def analyze(  # noqa: PLR0917  # options of a command
    file: Annotated[
        Path,
        argument(
            "FILE.csv",
            "Table: a column of rates, every other column an output, units in the names. With --rate, or a first "
            "column of times: a record at rest, one line per reading.",
        ),
    ],
    compare: Annotated[
        str | None, option("A,B", "Compare column B with column A. Two columns are compared by default.")
    ] = None,
    rate: Annotated[float | None, option("HZ", "A record at rest: readings per second.", min=1e-6)] = None,
    columns: Annotated[
        str | None,
        option(
            "NAME,...",
            "Which columns: the one of a record; of a table rate and outputs. Of a file without names the names of "
            "all. A name with a comma stands in quotes.",
            "--columns",
            "--column",
        ),
    ] = None,
    scale_factor: Annotated[
        float | None,
        option("V/(deg/s)", "Scale factor of a record at rest in volts or counts, V or LSB per deg/s."),
    ] = None,
    unit: Annotated[
        list[str] | None, option("COLUMN=UNIT", "Unit of a column; UNIT alone: unit of the record's column.", "--unit")
    ] = None,
    axes: Annotated[
        str | None, option("X,Y,Z", "Columns of rates about three axes: cross-axis matrix and misalignment of outputs.")
    ] = None,
    temperature: Annotated[
        str | None,
        option("NAME", "Column of temperatures: scale factor and bias over it; of a record at rest the bias."),
    ] = None,
    time: Annotated[str | None, option("NAME|none", "Column of times; none: ignore the times.")] = None,
    skip: Annotated[int, option("LINES", "Lines before the names of the columns.", min=0)] = 0,
    separator: Annotated[str | None, option("comma|semicolon|tab|space", "Separator of the columns.")] = None,
    decimal: Annotated[str | None, option("point|comma", "Decimal sign.")] = None,
    rows: Annotated[
        str | None, option("COLUMN=WORD", "Read the lines with this word alone, where a file has several sensors.")
    ] = None,
    output: Annotated[Path | None, output_option("Write a report: .html, .pdf or .md.")] = None,
    *,
    strict: Annotated[
        bool, flag("Exit code 1 if a notice reports values that no sensor can give.", "--strict")
    ] = False,
    json: Json_ = False,
) -> None:
    """Analyse a calibration table, or with --rate the noise of a record at rest: Allan deviation, N, B, K, R."""
    names = () if columns is None else tuple(name.strip() for name in next(reader([columns], skipinitialspace=True)))
    of_all = [each for each in unit or () if "=" not in each]
    if len(of_all) > 1:
        raise ConfigError(f"--unit {of_all[1]}: the unit of all columns is given twice")
    units = keys_and_values("--unit", (each for each in unit or () if "=" in each), "gyro=mdps")
    units |= zip([""], of_all, strict=False)  # that of all others stands under no name
    only = None if rows is None else key_and_value("--rows", rows, "sensor=gyro")
    layout = Layout(names, skip, units, time, separator, decimal, only)
    with opened_table(file) as raw:
        at_rest = rate is not None or scale_factor is not None or is_record(read_head(raw, shown(file), layout), layout)
    if compare is not None and (at_rest or temperature is not None or axes is not None):
        raise ConfigError("--compare: of a calibration table, not of a record at rest, over temperature or of axes")
    found: TableAnalysis | RecordAnalysis | TemperatureAnalysis | AxesAnalysis
    title = f"Analysis of {file.name}"
    if temperature is not None:
        found = analyze_temperature(file, temperature, scale_factor_per_deg_s=scale_factor, layout=layout)
    elif axes is not None:
        found = analyze_axes(file, [name.strip() for name in axes.split(",")], layout=layout)
    elif at_rest:
        seen = _progress if sys.stderr.isatty() else None
        found = analyze_record(file, rate, scale_factor_per_deg_s=scale_factor, layout=layout, progress=seen)
        title = f"Noise of {found.column}"
    else:
        pair = None if compare is None else [name.strip() for name in compare.split(",")]
        found = analyzed(file, pair, layout=layout)
    typer.echo(dumps(found.as_json(), allow_nan=False) if json else text_of(found.report(), _WIDTH))
    if output is not None:
        for written in write_document(found.report(), title, file.name, output):
            typer.echo(written, err=json)
    if strict and found.notices:
        raise typer.Exit(1)


def _progress(part: float) -> None:
    typer.echo(f"\r{100.0 * part:3.0f} % read" if part < 1.0 else "\r\x1b[K", err=True, nl=False)
