"""``vcfbench sim soak``: runs under faults drawn by seed; each seed that breaks one is a line to repeat."""

from typing import Annotated

import typer

from vcfbench.cli.options import flag, option
from vcfbench.clock import WallClock
from vcfbench.errors import ConfigError
from vcfbench.testing import soaking
from vcfbench.testing.soaking import Verdict


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
