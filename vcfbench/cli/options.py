"""Options and arguments that several commands have, declared once."""

from __future__ import annotations

from pathlib import Path  # typer reads the annotations when it runs
from typing import Annotated

import typer

from vcfbench.cli.completion import run_names

Bench_ = Annotated[
    Path | None,
    typer.Option("--bench", metavar="FILE", help="Bench file; without it the embedded simulated paper bench."),
]
Json_ = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout and nothing else there.")]
Run_ = Annotated[
    str,
    typer.Argument(
        metavar="RUN", autocompletion=run_names, help="Name of the run, its beginning or end, 'last', or its directory."
    ),
]
Runs_ = Annotated[Path, typer.Option("--runs", metavar="DIR", help="Where the records are.")]
