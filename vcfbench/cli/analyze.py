"""``vcfbench analyze``: the whole analysis of a table that was measured somewhere else."""

import sys
from collections.abc import Iterator
from json import dumps
from pathlib import Path
from shutil import get_terminal_size
from typing import Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from vcfbench.analysis.nonlinearity import DEFINITIONS
from vcfbench.archive.analyzed import TableAnalysis
from vcfbench.archive.analyzed import analyze as analyzed
from vcfbench.archive.analyzed_record import analyze_record
from vcfbench.archive.written import write_document
from vcfbench.cli.options import Json_, argument, option, output_option
from vcfbench.errors import ConfigError
from vcfbench.reports.text import text_of

_UNBOUNDED = 1000
"""Columns of a pipe or a file: nothing is folded there."""


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
    output: Annotated[Path | None, output_option("Of a record at rest: its report, .html, .pdf or .md.")] = None,
    *,
    json: Json_ = False,
) -> None:
    """Analyse a calibration table, or with --rate the noise of a record at rest: Allan deviation, N, B, K, R."""
    if rate is not None or column is not None or scale_factor is not None or output is not None:
        if compare is not None:
            raise ConfigError("--compare: of a calibration table, not of a record at rest")
        found = analyze_record(file, rate, column=column, scale_factor_v_per_deg_s=scale_factor)
        typer.echo(dumps(found.as_json(), allow_nan=False) if json else text_of(found.report()))
        if output is not None:
            for written in write_document(found.report(), f"Noise of {found.column}", file.name, output):
                typer.echo(written, err=json)
        return
    names = None if compare is None else [name.strip() for name in compare.split(",")]
    if names is not None and len(names) != 2:
        raise ConfigError(f"--compare {compare}: two column names with a comma between them are needed")
    analysis = analyzed(file, names)
    if json:
        typer.echo(dumps(analysis.as_json(), allow_nan=False))
    else:
        tables = list(_tables(analysis))
        console = Console(highlight=False, width=_UNBOUNDED)
        if sys.stdout.isatty():
            # where figures would be cut the terminal shall wrap them: then nothing is lost
            least = max(console.measure(table).minimum for table in tables)
            console.width = max(least, get_terminal_size().columns)
        with console.capture() as text:
            for table in tables:
                console.print(table)
        typer.echo("".join(f"{line.rstrip()}\n" for line in text.get().splitlines()), nl=False)


def _columns_table(title: str, columns: list[str], *, note: str = "") -> Table:
    table = Table(
        title=title,
        title_justify="left",
        caption=note or None,
        caption_justify="left",
        box=SIMPLE_HEAD,
        show_edge=False,
        pad_edge=False,
    )
    table.add_column("")
    for column in columns:
        table.add_column(column, justify="right", no_wrap=True)
    return table


def _tables(analysis: TableAnalysis) -> Iterator[Table]:
    """Yield the lines, their non-linearities, and the comparison of two where there is one."""
    results = analysis.series
    fits = _columns_table(
        "Least-squares line",
        list(results),
        note="u_fit: of the fit alone, lack of fit included; of points alone no combined u is known",
    )
    lines = [result.line for result in results.values()]
    rows = {
        "scale factor, mV/(deg/s)": [f"{1e3 * line.scale_factor:.6f}" for line in lines],
        "  u_fit, mV/(deg/s)": [f"{1e3 * result.u_fit_scale_factor:.2g}" for result in results.values()],
        "bias, mV": [f"{1e3 * line.bias:.4f}" for line in lines],
        "  u_fit, mV": [f"{1e3 * result.u_fit_bias:.2g}" for result in results.values()],
        "bias, deg/s": [f"{line.bias_deg_s:.4f}" for line in lines],
        "residual std, mV": [f"{1e3 * line.s_v:.4f}" for line in lines],
        "degrees of freedom": [str(line.dof) for line in lines],
    }
    for name, cells in rows.items():
        fits.add_row(name, *cells)
    yield fits
    note = "full scale: |K| times the largest rate; reading: from 10 deg/s on"
    bends = _columns_table("\nNon-linearity and asymmetry, ppm", list(results), note=note)
    bends.add_column("definition", overflow="fold")
    for name, words in DEFINITIONS.items():
        values = (result.nonlinearity_ppm[name] for result in results.values())
        bends.add_row(name, *("-" if value is None else f"{value:.1f}" for value in values), words)
    yield bends
    found = analysis.comparison
    if analysis.compared is None or found is None:
        return
    table = _columns_table(f"\n{analysis.compared[1]} against {analysis.compared[0]}", [""])
    table.show_header = False
    rounded, e_n = found.scale_factor_error_percent_rounded, found.e_n
    table.add_row("scale factor error, %", f"{found.scale_factor_error_percent:.3f}")
    table.add_row("  u_fit, percentage points", f"{found.u_fit_scale_factor_error_percent:.3f}")
    table.add_row("  from slopes rounded to five decimals, %", "-" if rounded is None else f"{rounded:.3f}")
    table.add_row("E_n (above 1: they disagree)", "-" if e_n is None else f"{e_n:.2f}")
    table.add_row("bias difference, mV", f"{1e3 * found.bias_difference_v:.3f}")
    yield table
