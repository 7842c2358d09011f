"""``vcfbench sim serve`` and ``vcfbench sim ctl``: the simulated bench on real wires, and its remote control."""

import contextlib
import gc
import json as encoder
import re
import signal
import sys
from collections.abc import Iterator
from pathlib import Path  # typer reads the annotations when it runs
from typing import Annotated, Any, cast

import typer
from simrack.faults import FaultScript, fault_from
from simrack.serve import MAX_SPEED, BenchServer, Control, ControlError, Offer, Rs232, ServedClock, ServerSettings

from vcfbench.bench.ground import FASTEST, pace_of
from vcfbench.bench.simulated_instruments import CONTROL_PORT, CONTROL_VARIABLE
from vcfbench.cli.options import Bench_, argument, flag, option, seed_option
from vcfbench.errors import BenchError, ConfigError
from vcfbench.files import failing_as
from vcfbench.procedures.bench_file import load_bench
from vcfbench.sim.fault_scripts import read_script
from vcfbench.sim.served import build_served, on_wires
from vcfbench.station.description import BenchDescription
from vcfbench.station.writing import bench_text


def serve(
    bench: Bench_ = None,
    *,
    speed: Annotated[
        str, option("X|max", "Multiple of real time. max jumps to the instant that a client waits for.")
    ] = "1",
    host: Annotated[str, option(None, "Address to listen on.")] = "127.0.0.1",
    ports: Annotated[str, option("auto|BASE", "Ports: any that are free, or from BASE on.")] = "auto",
    control_port: Annotated[
        int | None,
        option(
            "PORT", "Control port; by default 20220, or one that is free.", min=1, max=65535, envvar=CONTROL_VARIABLE
        ),
    ] = None,
    faults: Annotated[Path | None, option("FILE", "TOML file of faults and their times.")] = None,
    offer: Annotated[
        list[str] | None, option("ROLE:KIND,...", "Further interfaces: tcp, vxi11, hislip, pty, lxi. May be repeated.")
    ] = None,
    rs232: Annotated[
        Rs232,
        option(
            "KIND", "Serial lines: ideal; real (characters take time, small buffers, handshake); three-wire (none)."
        ),
    ] = "ideal",
    port_mapper: Annotated[
        int | None, option("PORT", "Also run a port mapper for VXI-11 clients (111).", min=1, max=65535)
    ] = None,
    write_bench: Annotated[Path | None, option("FILE", "Write the bench file that uses what is served here.")] = None,
    wires: Annotated[str, option("KIND", "Interface to write into the bench file: tcp, vxi11, hislip or pty.")] = "tcp",
    seed: Annotated[int | None, seed_option("Seed of every random stream.")] = None,
    json: Annotated[bool, flag("Print one JSON object on the first line of stdout.", "--json")] = False,
) -> None:
    """Serve every simulated instrument on sockets, VXI-11, HiSLIP or a pseudo-terminal, until SIGTERM or Ctrl-C."""
    description = load_bench(bench)
    if ports != "auto" and not (re.fullmatch(r"[0-9]{1,5}", ports) and 0 < int(ports) < 65536):
        raise ConfigError(f"--ports {ports}: expected a port number, or 'auto'")
    base = None if ports == "auto" else int(ports)
    settings = ServerSettings(
        host,
        base,
        faults=FaultScript(()) if faults is None else read_script(faults),
        control_port=control_port,
        offers=_offers(offer or []),
        port_mapper=port_mapper,
        rs232=rs232,
    )
    try:
        clock = ServedClock(MAX_SPEED if speed == FASTEST else pace_of(speed, f"--speed {speed}"))
        server = BenchServer(build_served(description, seed, clock), clock, settings)
    except ValueError as error:
        raise ConfigError(str(error)) from error
    except OSError as error:
        raise BenchError(f"cannot serve on {host}, ports {ports}: {error}") from error
    with server, _stopped_by_signals(server):
        if write_bench is not None:
            _write_bench(write_bench, description, server, wires)
        # Say where everything is, at once: whoever started the server reads it from a pipe
        if json:
            typer.echo(encoder.dumps(server.as_json()))
        else:
            typer.echo(f"{description.title}, served until Ctrl-C")
            for role, at in server.wires.items():
                typer.echo(f"{role:<16} {at.model:<9} {'  '.join(at.places)}")
            typer.echo(f"{'control':<16} {'':<9} vcfbench sim ctl --port {server.control.port} status")
        sys.stdout.flush()
        gc.freeze()  # what is here now stays: collections in between the answers are short
        gc.set_threshold(50_000)
        server.run()


def ctl(
    command: Annotated[list[str], argument(None, "Command and its arguments, e.g. set applied_rate_deg_s 10.")],
    port: Annotated[
        int, option(None, "Control port, as printed by serve.", min=1, max=65535, envvar=CONTROL_VARIABLE)
    ] = CONTROL_PORT,
) -> None:
    """Read and change a served bench through its control port.

    status; list [PART]; get NAME; set NAME VALUE; speed X|max; pause; resume; now; advance SECONDS;
    fault INSTRUMENT KIND [DURATION_S]; clear_faults [INSTRUMENT]; reset [SEED]; stop

    Any argument can be given by its name, as in fault multimeter late delay_s=3 count=1.
    """
    name, *given = command
    named = dict(text.split("=", 1) for text in given if _NAMED.match(text))
    placed = [text for text in given if not _NAMED.match(text)]
    names = _ARGUMENTS.get(name, ())
    if len(placed) > len(names):
        raise ConfigError(f"ctl {name} takes {' '.join(names).upper() or 'no arguments'}, not {' '.join(given)!r}")
    if reserved := {"do", "id"} & set(named):
        raise ConfigError(f"ctl {name}: {min(reserved)} is not an argument of a command")
    asked = {key: _value(text) for key, text in [*zip(names, placed, strict=False), *named.items()]}
    try:
        with Control(port) as control:
            result = control.request(name, **asked)
    except ControlError as error:
        raise BenchError(str(error), instrument="control port", resource=str(port)) from error
    typer.echo(encoder.dumps(result, indent=2))
    if name == "fault":
        armed = fault_from({**asked, "at_s": asked.get("at_s", result)})  # what was not given has its default
        typer.echo(f"vcfbench: {armed.describe()}", err=True)


_NAMED = re.compile(r"[a-z_]+=")
_ARGUMENTS: dict[str, tuple[str, ...]] = {
    "list": ("match",),
    "get": ("name",),
    "set": ("name", "value"),
    "speed": ("value",),
    "advance": ("seconds",),
    "fault": ("instrument", "kind", "duration_s"),
    "clear_faults": ("instrument",),
    "reset": ("seed",),
}


def _value(text: str) -> Any:
    """Return an argument: numbers, true, false and null as in JSON, else a text."""
    try:
        return encoder.loads(text)
    except (ValueError, RecursionError):
        return text


def _offers(texts: list[str]) -> dict[str, frozenset[Offer]]:
    """Return the interfaces by role: ``a:hislip,power:vxi11,pty`` is of two roles, and may be given in two options."""
    found: dict[str, frozenset[Offer]] = {}
    for text in texts:
        role = ""
        for part in text.split(","):
            before, colon, kind = part.rpartition(":")
            role = before if colon else role
            if not role or not kind:
                raise ConfigError(f"--offer {text}: expected ROLE:KIND,... as in rate_source:hislip,power:vxi11")
            found[role] = found.get(role, frozenset()) | {cast("Offer", kind)}
    return found


def _write_bench(path: Path, description: BenchDescription, server: BenchServer, kind: str) -> None:
    where = {role: wires.as_json() for role, wires in server.wires.items()}
    if not any(kind in wires and kind != "model" for wires in where.values()):
        raise ConfigError(f"--wires {kind}: expected tcp, vxi11, hislip or pty")
    resources = {role: str(wires[kind] or wires["tcp"]) for role, wires in where.items()}
    control = server.as_json()["control"]
    host = f"[{control['host']}]" if ":" in control["host"] else control["host"]
    text = bench_text(on_wires(description, resources, f"{host}:{control['port']}"))
    with failing_as(ConfigError, f"--write-bench {path}"):
        path.write_text(text, encoding="utf-8", newline="\n")


@contextlib.contextmanager
def _stopped_by_signals(server: BenchServer) -> Iterator[None]:
    """Let SIGTERM and SIGINT end the server, and nothing else."""

    def stop(_number: int, _frame: object) -> None:
        server.stop()

    wanted = (signal.SIGTERM, signal.SIGINT)
    before = [signal.signal(number, stop) for number in wanted]
    wakes_before = signal.set_wakeup_fd(server.loop.wake_fd, warn_on_full_buffer=False)
    try:
        yield
    finally:
        signal.set_wakeup_fd(wakes_before)
        for number, handler in zip(wanted, before, strict=True):
            signal.signal(number, handler)
