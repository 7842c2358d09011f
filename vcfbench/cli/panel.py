"""``vcfbench panel``: the devices of a batch, started by their operator in a browser."""

from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from vcfbench.cli.batch import measured
from vcfbench.cli.conduct import RunOptions
from vcfbench.cli.ending import Stopped
from vcfbench.cli.options import DevicesOfPlan_, Runs_, Speed_, Yes_, argument, option
from vcfbench.errors import Aborted, NotSafe
from vcfbench.page.panel import Panel
from vcfbench.page.server import LivePage
from vcfbench.runs.batch import read_batch

_PORT = 8331


def panel(
    file: Annotated[Path, argument("PLAN.toml", "The batch: name, bench, runs, devices.")],
    *,
    runs: Runs_ = Path("runs"),
    devices: DevicesOfPlan_ = None,
    operator: Annotated[str | None, option("NAME", "Operator, in place of the plan's.")] = None,
    speed: Speed_ = None,
    port: Annotated[int, option(None, "Port on this machine; 0 for any that is free.", min=0, max=65535)] = _PORT,
    yes: Yes_ = False,
) -> None:
    """Measure gyroscopes one after another, each started in a browser on this machine, until Ctrl-C (extra page).

    Scan or type the serial number, mount the device, start, watch, read the verdict; the sheet grows below.
    """
    asked = read_batch(file, operator, devices)
    options = RunOptions(bench=Path(asked.bench), runs=runs, speed=speed, quiet=True, yes=yes)
    board = Panel(asked, runs)
    with suppress(Stopped), LivePage(runs, asked.kept_in, port, board) as page:  # the way in which it is meant to end
        typer.echo(f"page: {page.address}  (Ctrl-C ends it)")
        while True:
            try:
                outcome = measured(asked, board.next_device(), options, page)
            except NotSafe as error:
                board.judge("NOT SAFE", str(error))
                typer.echo(f"vcfbench: {error}", err=True)
                with suppress(Stopped):
                    board.next_device()  # there is none: the page shows it until somebody comes
                raise
            except Aborted as error:
                if not page.was_stopped:
                    raise
                board.judge("STOPPED", str(error))
            else:
                board.judge(outcome.word, outcome.why)
