"""``vcfbench safe``: brings a bench to rest and switches it off, from any state."""

from contextlib import suppress
from pathlib import Path  # typer reads the annotations when it runs
from typing import Annotated, Final

import msgspec
import typer
from msgspec.structs import replace

from vcfbench.bench.make_safe import MadeSafe, safe_bench
from vcfbench.cli.answer import answer, print_json
from vcfbench.cli.ending import say
from vcfbench.cli.options import Json_, Trace_, flag, option, tracing
from vcfbench.cli.person import at_the_terminal
from vcfbench.clock import WallClock
from vcfbench.errors import Aborted, ConfigError
from vcfbench.reports.text import left_table
from vcfbench.safety.signals import StopSignals
from vcfbench.station.description import BenchDescription
from vcfbench.station.file import read_bench

_AGAIN_S: Final = 1.0
"""From one try to the next, s."""


def safe(
    bench: Annotated[Path | None, option("FILE", "Bench file of the station.", envvar="VCFBENCH_BENCH")] = None,
    trace: Trace_ = None,
    *,
    end_owner: Annotated[
        bool, flag("First end the process that has the bench: SIGTERM, after 10 s SIGKILL.", "--end-owner")
    ] = False,
    force: Annotated[bool, flag("Do it even while another process uses the bench.", "--force")] = False,
    once: Annotated[bool, flag("Try once; without this option, repeat until the bench is safe.", "--once")] = False,
    json: Json_ = False,
) -> None:
    """Stop the table, switch the outputs off, check both, and list those that were on. Exit code 0 or 5.

    What is not proved is tried again until it is, or Ctrl-C ends that.
    """
    if bench is None:  # a simulated bench that is safe would be said to be yours
        raise ConfigError(
            "name a bench: nothing was switched off",
            hint="vcfbench safe --bench FILE, the bench file of the station; or name it in VCFBENCH_BENCH",
        )
    description = read_bench(bench)
    with tracing(trace):
        done = _safed(description, force=force, end_owner=end_owner, once=once or description.simulation is not None)

    for owner in done.ended:
        say(f"vcfbench: {owner} was ended")
    if done.unlocked is not None:
        say(f"vcfbench: the instruments are not locked, another process may have them: {done.unlocked}")

    def show() -> None:
        if json:
            print_json(
                {
                    "bench": description.name,
                    "safe": done.failure() is None,
                    "ended": list(done.ended),
                    "left_to": {role: str(error.owner or "another process") for role, error in done.left_to.items()},
                    "instruments": {each.role: msgspec.to_builtins(each) for each in done.instruments},
                }
            )
        else:
            rows = (
                (each.role, each.found or "not known", "safe" if each.safe else "NOT SAFE", each.detail)
                for each in done.instruments
            )
            typer.echo(f"{description.title}\n\n{left_table(('role', 'found', 'now', 'proof'), rows)}")

    answer(show, done.failure())


def _safed(description: BenchDescription, *, force: bool, end_owner: bool, once: bool) -> MadeSafe:
    """Switch the bench off, again until it is or a person ends that; the found state is that of the first try."""
    operator, wall, tries = at_the_terminal(None, None), WallClock(), 1
    done = safe_bench(description, force=force, end_owner=end_owner, operator=operator)
    found = {each.role: each.found for each in done.instruments}
    with StopSignals() as signals, suppress(Aborted):
        while done.unsafe_beside(description.by_hand) and not (once or done.signalled):
            words = f"try {tries}, after {wall.now():.0f} s: {done.failure()}"
            say(f"vcfbench: {words}; it is tried again until it is safe, Ctrl-C ends that", alarm=True)
            signals.wait(wall, wall.now() + _AGAIN_S)
            tries += 1
            again = safe_bench(description, force=force, operator=operator)
            instruments = tuple(replace(each, found=found[each.role] or each.found) for each in again.instruments)
            done = replace(again, instruments=instruments, ended=done.ended)
    return done
