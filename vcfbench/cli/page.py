"""``vcfbench page``: the records and devices of a station in a browser."""

from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from vcfbench.cli.ending import Stopped
from vcfbench.cli.options import Devices_, Runs_, option
from vcfbench.page.server import serve_station

_PORT = 8330


def page(
    runs: Runs_ = Path("runs"),
    devices: Devices_ = Path("devices"),
    port: Annotated[int, option(None, "Port on this machine; 0 for any that is free.", min=0, max=65535)] = _PORT,
) -> None:
    """Show devices and runs, finished or in progress, in a browser on this machine, until Ctrl-C (extra page)."""
    with suppress(Stopped):  # the way in which it is meant to end
        serve_station(runs, devices, port, lambda address: typer.echo(f"page: {address}  (Ctrl-C ends it)"))
