"""``vcfbench validate``: checks with known answers on the laboratory's own machine; one document."""

from pathlib import Path  # typer reads the annotation when it runs
from typing import Annotated

import typer
from msgspec import to_builtins

from vcfbench.cli.answer import print_json
from vcfbench.cli.options import Json_, Quiet_, Yes_, option, output_option
from vcfbench.validation.benches import RUNS
from vcfbench.validation.check import Checked
from vcfbench.validation.validate import validate as validated
from vcfbench.validation.validate import write_validation


def validate(
    bench: Annotated[Path | None, option("FILE", "Bench file of your own bench: checked too.")] = None,
    output: Annotated[
        Path | None, output_option("File of the document: .html, .pdf or .md; without it no document is written.")
    ] = None,
    by: Annotated[str, option("NAME", "Who validates; without it the user.")] = "",
    runs: Annotated[
        int, option(None, "Number of calibrations compared with the true values.", min=30, max=10_000)
    ] = RUNS,
    *,
    json: Json_ = False,
    quiet: Quiet_ = False,
    yes: Yes_ = False,
) -> None:
    """Validate the program on this machine: numbers, uncertainties, faults, seals, wires, and your own bench.

    The document helps to fulfil ISO/IEC 17025:2017, 7.11.2. Exit code 1: a check has failed.
    """

    def shown(each: Checked) -> None:
        if not (json or quiet):
            typer.echo(f"{each.verdict:11}  {each.name}: {each.came}")

    found = validated(bench, by=by, runs=runs, trust=yes, shown=shown)
    written = () if output is None else write_validation(found, output)
    if json:
        print_json({**to_builtins(found), "passed": found.passed, "document": list(map(str, written))})
    else:
        counted = f"{sum(each.verdict == 'PASS' for each in found.checks)} of {len(found.checks)} checks passed"
        typer.echo(f"{'PASS' if found.passed else 'FAIL'}: {counted} in {found.took_s:.0f} s")
        for each in written:
            typer.echo(f"document: {each}")
    if not found.passed:
        raise typer.Exit(1)
