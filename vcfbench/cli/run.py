"""``vcfbench run``: a calibration, from the bench file to the record and the table."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from vcfbench.cli.ending import EarlyAndLate
from vcfbench.errors import ConfigError, PlanError

__all__ = ["app"]


class KnownProcedures(TyperGroup):
    """The group of procedures; an unknown one is answered with the list of those that there are."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command named by the first of `args`."""
        if args and not args[0].startswith("-") and self.get_command(ctx, args[0]) is None:
            known = ", ".join(self.list_commands(ctx))
            raise PlanError(f"there is no procedure {args[0]!r}; known are {known}")
        return super().resolve_command(ctx, args)


app = typer.Typer(cls=KnownProcedures, no_args_is_help=True, help="Run a calibration procedure on a bench.")

Bench_ = Annotated[
    Path | None,
    typer.Option("--bench", metavar="FILE", help="Bench file; without it the embedded simulated paper bench."),
]
Seed_ = Annotated[
    int | None,
    typer.Option(
        "--seed", min=0, max=2**63 - 1, help="Seed of a simulated bench; the same seed gives the same results."
    ),
]
Json_ = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout and nothing else there.")]
DryRun_ = Annotated[
    bool, typer.Option("--dry-run", help="Print every step and the estimated bench time; touch nothing.")
]


def _directory(name: str | Path) -> Path:
    """Read the name of a directory; an empty one would be the working directory, which nobody means by it."""
    if not str(name).strip():
        raise ConfigError("--runs: expected a directory, came an empty name")
    return Path(name)


Runs_ = Annotated[Path, typer.Option("--runs", metavar="DIR", parser=_directory, help="Where the records go.")]
Speed_ = Annotated[
    str | None,
    typer.Option("--speed", metavar="X|max", help="Simulated benches only: times real time, or max, the default."),
]
Quiet_ = Annotated[bool, typer.Option("--quiet", help="No progress.")]
Match_ = Annotated[
    str,
    typer.Option(
        "--match",
        metavar="zero|absolute",
        help="How step 2 compares outputs: each from its own zero, or as they are (the paper's words).",
    ),
]


@app.command("turntable")
def turntable(
    bench: Bench_ = None,
    seed: Seed_ = None,
    runs: Runs_ = Path("runs"),
    speed: Speed_ = None,
    *,
    context: typer.Context,
    json: Json_ = False,
    dry_run: DryRun_ = False,
    quiet: Quiet_ = False,
) -> None:
    """Calibrate on the rate table: 17 rates, generator off."""
    _conduct(
        context,
        "turntable",
        bench=bench,
        seed=seed,
        json=json,
        dry_run=dry_run,
        runs=runs,
        speed=speed,
        quiet=quiet,
        match="zero",
    )


@app.command("virtual-coriolis")
def virtual_coriolis(
    bench: Bench_ = None,
    seed: Seed_ = None,
    runs: Runs_ = Path("runs"),
    speed: Speed_ = None,
    match: Match_ = "zero",
    *,
    context: typer.Context,
    json: Json_ = False,
    dry_run: DryRun_ = False,
    quiet: Quiet_ = False,
) -> None:
    """Calibrate by the paper's four steps: on the rate table and by the virtual Coriolis force."""
    _conduct(
        context,
        "virtual-coriolis",
        bench=bench,
        seed=seed,
        json=json,
        dry_run=dry_run,
        runs=runs,
        speed=speed,
        quiet=quiet,
        match=match,
    )


def _conduct(context: typer.Context, name: str, **options: Any) -> None:
    from vcfbench.cli.conduct import RunOptions, conduct  # noqa: PLC0415  # keeps ``vcfbench --help`` quick

    conduct(name, RunOptions(**options), context.find_object(EarlyAndLate))
