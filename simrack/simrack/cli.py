"""The command ``simrack``."""

from __future__ import annotations

import gc
import json
import math
import signal
import sys
from importlib.metadata import version
from typing import Annotated

import typer

from simrack import card as cards
from simrack.bench_file import planned
from simrack.models import RACK, model_named
from simrack.plan import ADAPTER, Plan
from simrack.rack import served
from simrack.serve import BenchServer, Control, ControlError, Offer, ServedClock, ServerSettings

app = typer.Typer(no_args_is_help=True, add_completion=False)


def _version(wanted: bool) -> None:  # noqa: FBT001  (typer's)
    if wanted:
        typer.echo(f"simrack {version('simrack')}")
        raise typer.Exit


@app.callback()
def simrack(
    *, version_: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Print it.")] = False
) -> None:
    """Simulated instruments on the wires that real ones have."""


@app.command()
def serve(
    things: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[FILE.py] [[NAME=]MODEL[:WIRE+WIRE]]...",
            help="CIRCUIT of a file is your device under test. Models are those of `simrack models`, on the wires of "
            "the real box or on those named, of tcp, vxi11, hislip, pty, or gpib22 behind an adapter; without, a "
            "supply, a generator, a meter and an oscilloscope.",
        ),
    ] = None,
    *,
    bench: Annotated[
        str | None, typer.Option("--bench", metavar="FILE.toml", help="Instruments, and what they are wired to.")
    ] = None,
    speed: Annotated[str, typer.Option("--speed", metavar="X|max", help="Times real time.")] = "1",
    host: Annotated[str, typer.Option("--host", help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[int | None, typer.Option("--port", help="First port, of the control port; any without.")] = None,
    port_mapper: Annotated[
        int | None, typer.Option("--port-mapper", help="Port of a port mapper for VXI-11; 111 is where VISA looks.")
    ] = None,
    seed: Annotated[int | None, typer.Option("--seed", help="Specimens with errors; without, they are ideal.")] = None,
    lxi: Annotated[bool, typer.Option("--lxi", help="Also identify those on a network over HTTP.")] = False,
    json_: Annotated[bool, typer.Option("--json", help="Print one JSON object on the first line.")] = False,
) -> None:
    """Serve instruments that see each other, until Ctrl-C."""
    try:
        clock = ServedClock(math.inf if speed == "max" else float(speed))
        plan = planned([*(things or ()), *([] if bench is None else [bench])])
        rack, only = served(clock, plan, seed), plan.wires_asked_for()
        page: frozenset[Offer] = frozenset({"lxi"})
        wires = {**rack.wires, **only}
        pages = {role: page for role, offers in wires.items() if lxi and offers & {"vxi11", "hislip"}}
        settings = ServerSettings(host, port, offers=pages, only=only, port_mapper=port_mapper, faults=plan.faults)
        server = BenchServer(rack, clock, settings)
    except (OSError, ValueError) as error:
        raise typer.BadParameter(str(error)) from error
    with server:
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: server.stop())
        signal.set_wakeup_fd(server.loop.wake_fd, warn_on_full_buffer=False)
        typer.echo(json.dumps(server.as_json()) if json_ else _places(server, plan))
        sys.stdout.flush()
        gc.freeze()  # what is here now stays: collections in between the answers are short
        server.run()


def _places(server: BenchServer, plan: Plan) -> str:
    lines = [f"{plan.circuits or 'no circuit'}, served until Ctrl-C"]
    gpib = {place.name: place.gpib for place in plan.places if place.gpib is not None}
    wide = max(map(len, (*server.wires, "control"))) + 1
    for role, wires in server.wires.items():
        where = "  ".join(wires.places) if role not in gpib else f"++addr {gpib[role]} of {ADAPTER}"
        lines.append(f"{role:<{wide}} {wires.model:<9} {where}")
    return "\n".join([*lines, f"{'control':<{wide}} {server.control.port}"])


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
    """Show the known commands of a model's manual and of the standards, the sources, and unverified points."""
    try:
        typer.echo(cards.overview() if model is None else cards.card(model_named(model).name))
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error


@app.command()
def models() -> None:
    """List the models, their kinds, and the wires of the real box."""
    for each in RACK.values():
        typer.echo(f"{each.name:<10} {each.kind:<13} {', '.join(each.wires)}")


def _parsed(text: str) -> object:
    try:
        return json.loads(text)
    except ValueError:
        return text
