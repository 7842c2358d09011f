"""``vcfbench page``: the records and devices of a station in a browser."""

from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from vcfbench.cli.ending import Stopped
from vcfbench.cli.options import Devices_, Runs_, option
from vcfbench.page.server import LivePage

_PORT = 8330


def page(
    runs: Runs_ = Path("runs"),
    devices: Devices_ = Path("devices"),
    port: Annotated[int, option(None, "Port on this machine; 0 for any that is free.", min=0, max=65535)] = _PORT,
) -> None:
    """Show devices and runs, finished or in progress, in a browser on this machine, until Ctrl-C (extra page)."""
    with suppress(Stopped), LivePage(runs, devices, port) as served:  # the way in which it is meant to end
        typer.echo(f"page: {served.station}  (Ctrl-C ends it)")
        served.wait()
