"""The command ``simrack``."""

from __future__ import annotations

import gc
import json
import math
import signal
import sys
from pathlib import Path  # typer reads the annotations when it runs
from typing import Annotated

import typer

from simrack import card as cards
from simrack.desk import circuit_in, served_desk
from simrack.models import MODELS
from simrack.serve import BenchServer, Control, ControlError, Offer, ServedClock, ServerSettings

app = typer.Typer(no_args_is_help=True, add_completion=False)


@app.callback()
def simrack() -> None:
    """Simulated instruments on the wires that real ones have."""


@app.command()
def serve(
    circuit: Annotated[
        Path | None, typer.Argument(metavar="[FILE.py]", help="Defines CIRCUIT, your device under test; else a wire.")
    ] = None,
    *,
    speed: Annotated[str, typer.Option("--speed", metavar="X|max", help="Times real time.")] = "1",
    host: Annotated[str, typer.Option("--host", help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[int | None, typer.Option("--port", help="First port, of the control port; any without.")] = None,
    seed: Annotated[int | None, typer.Option("--seed", help="Specimens with errors; without, they are ideal.")] = None,
    lxi: Annotated[bool, typer.Option("--lxi", help="Also identify those on a network over HTTP.")] = False,
    json_: Annotated[bool, typer.Option("--json", help="Print one JSON object on the first line.")] = False,
) -> None:
    """Serve a supply, a generator, a multimeter and an oscilloscope that see each other, until Ctrl-C."""
    try:
        clock = ServedClock(math.inf if speed == "max" else float(speed))
        bench = served_desk(clock, None if circuit is None else circuit_in(circuit), seed)
        page: frozenset[Offer] = frozenset({"lxi"})
        pages = {role: page for role, offers in bench.wires.items() if lxi and "vxi11" in offers}
        server = BenchServer(bench, clock, ServerSettings(host, port, offers=pages))
    except (OSError, ValueError) as error:
        raise typer.BadParameter(str(error)) from error
    with server:
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: server.stop())
        signal.set_wakeup_fd(server.loop.wake_fd, warn_on_full_buffer=False)
        typer.echo(json.dumps(server.as_json()) if json_ else _places(server))
        sys.stdout.flush()
        gc.freeze()  # what is here now stays: collections in between the answers are short
        server.run()


def _places(server: BenchServer) -> str:
    lines = [f"{server.bench.world.device} between the generator and the meters, served until Ctrl-C"]
    for role, wires in server.wires.items():
        lines.append(f"{role:<13} {wires.model:<9} {'  '.join(wires.places)}")
    return "\n".join([*lines, f"{'control':<13} {server.control.port}"])


@app.command()
def ctl(
    port: Annotated[int, typer.Argument(help="Control port, as printed by serve.")],
    name: Annotated[str | None, typer.Argument(help="What to see or change; without, all is listed.")] = None,
    value: Annotated[str | None, typer.Argument(help="Its new value, as in JSON.")] = None,
) -> None:
    """See and change the World while it is served: voltages, loads, leads."""
    try:
        with Control(port) as control:
            if name is None:
                answer = control.request("list")
            elif value is None:
                answer = control.request("get", name=name)
            else:
                answer = control.request("set", name=name, value=_parsed(value))
    except ControlError as error:
        raise typer.BadParameter(str(error)) from error
    typer.echo(json.dumps(answer, indent=2))


@app.command()
def card(
    model: Annotated[
        str | None, typer.Argument(metavar="[MODEL]", help="As on the box; without, all in a table.")
    ] = None,
) -> None:
    """Show which commands of its manual and of the standards a model knows, the sources, and what is unverified."""
    if model is not None and model not in MODELS:
        raise typer.BadParameter(f"there is no {model!r}, only {', '.join(MODELS)}")
    typer.echo(cards.overview() if model is None else cards.card(model))


def _parsed(text: str) -> object:
    try:
        return json.loads(text)
    except ValueError:
        return text


if __name__ == "__main__":
    app()
