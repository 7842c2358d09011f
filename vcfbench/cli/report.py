"""``vcfbench report``: the whole report of a run in one file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from vcfbench.archive.recorded import load_run
from vcfbench.archive.written import write_certificate, write_report
from vcfbench.cli.options import Run_, Runs_  # noqa: TC001  # typer reads them
from vcfbench.errors import ConfigError


def report(
    run: Run_ = "last",
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="FILE", help="Where the report goes: .html, .pdf or .md.  [default: RUN.html]"
        ),
    ] = None,
    runs: Runs_ = Path("runs"),
    words: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="With --dcc: a field that no measurement gives. Repeatable."),
    ] = None,
    *,
    dcc: Annotated[
        bool, typer.Option("--dcc", help="Write a Digital Calibration Certificate (XML, DCC 3.3.0), not signed.")
    ] = False,
) -> None:
    """Write the report of a run: device, conditions, equipment, results, figures, verdict, provenance."""
    if words and not dcc:
        raise ConfigError("--set: what a certificate says goes with --dcc")
    recorded = load_run(run, runs)
    if dcc:
        typer.echo(write_certificate(recorded, output or Path(f"{recorded.name}.xml"), dict(map(_pair, words or ()))))
        return
    for path in write_report(recorded, output or Path(f"{recorded.name}.html")):
        typer.echo(path)


def _pair(text: str) -> tuple[str, str]:
    key, sign, value = text.partition("=")
    if not sign or not key:
        raise ConfigError(f"--set: expected KEY=VALUE, came {text!r}")
    return key, value
