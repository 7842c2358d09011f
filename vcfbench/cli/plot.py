"""``vcfbench plot``: the figures of a run as pictures."""

from pathlib import Path
from typing import Annotated

import typer

from vcfbench.archive.recorded import load_run
from vcfbench.archive.written import write_figures
from vcfbench.cli.options import Run_, Runs_, option, output_option


def plot(
    run: Run_ = "last",
    output: Annotated[
        Path | None, output_option("Where the figures go: .svg, .png or .pdf. Several become NAME-1.svg and so on.")
    ] = None,
    figure: Annotated[int | None, option("N", "Only this figure, by its number in the report.", min=1)] = None,
    runs: Runs_ = Path("runs"),
) -> None:
    """Draw the figures of a run."""
    recorded = load_run(run, runs)
    for path in write_figures(recorded, output or Path(f"{recorded.name}.svg"), figure):
        typer.echo(path)
