"""``vcfbench resume``: a run that was stopped, failed or died, taken up where its record ends."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from vcfbench.cli.conduct import RunOptions
from vcfbench.cli.conduct import resume as resumed
from vcfbench.cli.ending import SignalsWithoutBench
from vcfbench.cli.options import (  # typer reads them
    Json_,
    Page_,
    Plain_,
    Port_,
    Quiet_,
    Run_,
    Runs_,
    Speed_,
    Trace_,
    Yes_,
    tracing,
)


def resume(
    run: Run_,
    bench: Annotated[
        Path | None,
        typer.Option("--bench", metavar="FILE", help="Bench file, if the bench of the run has other addresses now."),
    ] = None,
    procedure: Annotated[
        Path | None,
        typer.Option("--procedure", metavar="FILE", help="Procedure file, if that of the run was moved or changed."),
    ] = None,
    runs: Runs_ = Path("runs"),
    *,
    context: typer.Context,
    trace: Trace_ = None,
    speed: Speed_ = None,
    json: Json_ = False,
    quiet: Quiet_ = False,
    plain: Plain_ = False,
    page: Page_ = False,
    port: Port_ = 0,
    yes: Yes_ = False,
) -> None:
    """Go on with a run that failed, or was stopped or killed. Nothing is measured twice; the record is new."""
    options = RunOptions(
        bench=bench,
        seed=None,
        json=json,
        dry_run=False,
        runs=runs,
        speed=speed,
        quiet=quiet,
        plain=plain,
        page=page,
        port=port,
        yes=yes,
        settings={},
        metadata={},
    )
    with tracing(trace):
        resumed(run, procedure, options, context.find_object(SignalsWithoutBench))
