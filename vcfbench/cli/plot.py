"""``vcfbench plot``: the figures of a run as pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from vcfbench.cli.completion import run_names


def plot(
    run: Annotated[
        str,
        typer.Argument(
            metavar="RUN",
            autocompletion=run_names,
            help="Name of the run, its beginning or end, 'last', or its directory.",
        ),
    ] = "last",
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help="Where the figures go: .svg, .png or .pdf. Several become NAME-1.svg and so on.",
        ),
    ] = None,
    figure: Annotated[
        int | None, typer.Option("--figure", metavar="N", min=1, help="Only this figure, by its number in the report.")
    ] = None,
    runs: Annotated[Path, typer.Option("--runs", metavar="DIR", help="Where the records are.")] = Path("runs"),
) -> None:
    """Draw the figures of a run."""
    from vcfbench.archive.recorded import load_run  # noqa: PLC0415
    from vcfbench.archive.written import write_figures  # noqa: PLC0415

    recorded = load_run(run, runs)
    for path in write_figures(recorded, output or Path(f"{recorded.name}.svg"), figure):
        typer.echo(path)
