"""``vcfbench safe``: a bench brought to rest and switched off, from whatever state it is in."""

from pathlib import Path  # typer reads the annotations when it runs
from typing import Annotated

import msgspec
import typer

from vcfbench.bench.make_safe import safe_bench
from vcfbench.cli.answer import answer, print_json
from vcfbench.cli.ending import say
from vcfbench.cli.options import Json_, Trace_, flag, option, tracing
from vcfbench.cli.person import at_the_terminal
from vcfbench.errors import ConfigError
from vcfbench.reports.text import left_table
from vcfbench.station.file import read_bench


def safe(
    bench: Annotated[Path | None, option("FILE", "Bench file of the station.", envvar="VCFBENCH_BENCH")] = None,
    trace: Trace_ = None,
    *,
    end_owner: Annotated[
        bool, flag("First end the process that has the bench: SIGTERM, after 10 s SIGKILL.", "--end-owner")
    ] = False,
    force: Annotated[bool, flag("Do it even while another process uses the bench.", "--force")] = False,
    json: Json_ = False,
) -> None:
    """Stop the table, switch the outputs off, check both, and list those that were on. Exit code 0 or 5."""
    if bench is None:  # a simulated bench that is safe would be said to be yours
        raise ConfigError(
            "which bench is to be made safe was not said, and nothing was done",
            hint="vcfbench safe --bench FILE, the bench file of the station; or name it in VCFBENCH_BENCH",
        )
    description = read_bench(bench)
    with tracing(trace):
        done = safe_bench(description, force=force, end_owner=end_owner, operator=at_the_terminal(None, None))

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
