"""``vcfbench report``: the whole report of a run in one file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

__all__ = ["report"]


def report(
    run: Annotated[
        str,
        typer.Argument(metavar="RUN", help="Name of the run, its beginning or end, 'last', or its directory."),
    ] = "last",
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE", help="Where it goes: .html, .pdf or .md.  [default: RUN.html]"),
    ] = None,
    runs: Annotated[Path, typer.Option("--runs", metavar="DIR", help="Where the records are.")] = Path("runs"),
) -> None:
    """Write the report of a run: device, conditions, equipment, results, figures, verdict, provenance."""
    from vcfbench.runs.recorded import load_run  # noqa: PLC0415
    from vcfbench.runs.written import write_report  # noqa: PLC0415

    recorded = load_run(run, runs)
    for path in write_report(recorded, output or Path(f"{recorded.name}.html")):
        typer.echo(path)
