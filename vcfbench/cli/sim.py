"""``vcfbench sim``: the parts of the simulated bench, and the bench on real wires."""

from typing import Annotated, Any

import typer

from vcfbench.cli import serve
from vcfbench.cli.answer import print_json
from vcfbench.cli.options import Bench_, Json_, flag, option, seed_option, with_options
from vcfbench.cli.sim_new import FIGURE_OPTIONS, new
from vcfbench.clock import WallClock
from vcfbench.errors import ConfigError
from vcfbench.procedures.bench_file import load_bench
from vcfbench.sim.inventory import inventory
from vcfbench.testing import soaking
from vcfbench.testing.soaking import Verdict

app = typer.Typer(
    no_args_is_help=True, help="Show the simulated bench, give it your own gyroscope, serve and control it."
)


@app.command("show")
def show(
    bench: Bench_ = None,
    seed: Annotated[int | None, seed_option("Seed from which errors are drawn.")] = None,
    *,
    json: Json_ = False,
) -> None:
    """Show every physical parameter and every instrument error: value, unit, meaning, source."""
    description = load_bench(bench)
    rows = inventory(description, seed)
    if json:
        print_json({"bench": description.name, "parameters": rows})
    else:
        typer.echo(description.title)
        for row in rows:
            unit = "" if row.unit == "1" else f" {row.unit}"
            typer.echo(f"\n{row.path} = {_shown(row.value)}{unit}")
            typer.echo(f"    {row.meaning}{f' ({row.source})' if row.source else ''}")


def _shown(value: Any) -> str:
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_shown, value))}]"
    return f"{value:.10g}" if isinstance(value, float) else str(value)


app.command("new")(with_options(new, FIGURE_OPTIONS, place=1))


@app.command("soak")
def soak(
    seeds: Annotated[str, option("A:B", "Seeds from A up to, not including, B.")] = "0:100",
    minutes: Annotated[float | None, option("N", "Begin no further seed after so long.", min=0.0)] = None,
    *,
    verbose: Annotated[bool, flag("Say of each seed what it draws, and its end.", "--verbose", "-v")] = False,
) -> None:
    """Try runs on simulated benches under faults, kills and full disks that seeds draw.

    What breaks is said with the smallest part of its draw that still breaks it; the exit code is then 1.
    """
    parts = seeds.split(":")
    if not (len(parts) == 2 and all(map(str.isdecimal, parts)) and int(parts[0]) < int(parts[1])):
        raise ConfigError(f"--seeds: expected A:B, whole numbers with A below B, came {seeds!r}")
    first, last = map(int, parts)
    clock, broken, tried = WallClock(), list[int](), 0
    for verdict in soaking.soak(range(first, last)):
        tried += 1
        if verbose or verdict.wrong:
            typer.echo("\n".join([*verdict.draw.describe(), *_words(verdict)]))
        if verdict.wrong:
            broken.append(verdict.draw.seed)
            least = soaking.shrunk(verdict)
            typer.echo("\n".join(["the smallest that still breaks it:", *least.draw.describe(), *_words(least)]))
        if minutes is not None and clock.now() >= 60.0 * minutes:
            break
    typer.echo(f"{tried} seeds from {first} in {clock.now():.0f} s: {len(broken)} broken")
    for seed in broken:
        typer.echo(f"vcfbench sim soak --seeds {seed}:{seed + 1} -v")
    if broken:
        raise typer.Exit(1)


def _words(verdict: Verdict) -> list[str]:
    ends = (f"  start {number}: {end}" for number, end in enumerate(verdict.ends, start=1))
    return [*ends, *(f"  BROKEN: {each}" for each in verdict.wrong)]


serve.register(app)
