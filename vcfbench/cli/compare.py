"""``vcfbench compare``: differences between runs."""

from collections import Counter
from pathlib import Path
from typing import Annotated

import typer

from vcfbench.archive.compared import compare_runs, require_comparable
from vcfbench.archive.keeping import not_withdrawn
from vcfbench.archive.recorded import load_run
from vcfbench.archive.summary import run_summaries
from vcfbench.archive.written import write_document
from vcfbench.cli.answer import print_json
from vcfbench.cli.options import Devices_, Json_, Runs_, argument, option, output_option, run_names
from vcfbench.errors import ConfigError
from vcfbench.reports.text import text_of


def compare(
    runs: Annotated[
        list[str] | None,
        argument(
            "[RUN RUN ...]", "Names of runs, as for `vcfbench report`. Default: the last 2.", autocompletion=run_names
        ),
    ] = None,
    output: Annotated[Path | None, output_option("Write the comparison with figures: .html, .pdf or .md.")] = None,
    directory: Runs_ = Path("runs"),
    devices: Devices_ = Path("devices"),
    dut: Annotated[str | None, option("SERIAL", "The last 2 complete runs of this device, of one procedure.")] = None,
    *,
    json: Json_ = False,
) -> None:
    """Compare runs with the first of them: results with E_n, points, settings and equipment that differ."""
    if runs and dut is not None:
        raise ConfigError("--dut chooses the runs: give no names of runs")
    require_comparable(max(2, len(runs or ())))  # before anything is read
    found = [] if runs else list(run_summaries(directory, dut=dut, status=None if dut is None else "complete"))
    found = found if dut is None else not_withdrawn(found, devices)
    counts = Counter(each.procedure for each in found)
    twice = next((each.procedure for each in reversed(found) if counts[each.procedure] > 1), None)
    alike = [each.directory for each in found if dut is None or each.procedure == twice]
    if len(chosen := runs or alike[-2:]) < 2:
        of = "" if dut is None else f" complete runs of {dut}, of one procedure,"
        known = ", ".join(f"{count} {name}" for name, count in counts.items()) or "none"
        said = f"{directory}: expected two{of or ' runs'} to compare, found {known}"
        raise ConfigError(said, hint="one of elsewhere is named by its path: vcfbench compare DIRECTORY/RUN last")
    comparison = compare_runs(*(load_run(each, directory) for each in chosen), devices=devices)
    if output is not None:
        both = " and ".join(run.name or run.procedure for run in comparison.runs)
        written = write_document(comparison.report(), "Comparison of runs", both, output)
    if json:
        print_json(comparison.as_json())
    elif output is None:
        typer.echo(text_of(comparison.report()))
    else:
        typer.echo("\n".join(map(str, written)))
