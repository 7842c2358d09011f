"""``vcfbench bench discover``: the instruments that answer, and their part of a bench file."""

import typer
from msgspec.structs import asdict

from vcfbench.cli.answer import print_json
from vcfbench.cli.options import (
    AnswerTime_,
    Json_,  # typer reads them
    Library_,
    ProbeSerial_,
    Trace_,
    Tries_,
    tracing,
)
from vcfbench.errors import BenchError
from vcfbench.station import discovery
from vcfbench.station.discovery import DiscoveredInstrument


def discover(
    library: Library_ = "@py",
    tries: Tries_ = None,
    timeout: AnswerTime_ = 1.0,
    trace: Trace_ = None,
    *,
    probe_serial: ProbeSerial_ = False,
    json: Json_ = False,
) -> None:
    """Ask every VISA resource for its identity, list the serial ports, and print lines for a bench file.

    Exit code 3 when a resource given with --try does not answer.
    """
    with tracing(trace):
        found = discovery.discover(library, tries or (), timeout_s=timeout, serial_probe=probe_serial)
    stanza = discovery.stanza(found)
    if json:
        ports = [
            {
                "port": each.port,
                "description": each.description,
                "asked": each.found is not None,
                **({} if each.found is None else asdict(each.found)),
            }
            for each in found.serial_ports
        ]
        asked = {"resources": found.resources, "serial_ports": ports, "tried": found.tried}
        print_json({"library": found.library, **asked, "stanza": stanza})
    else:
        for resource in (*found.resources, *found.tried):
            typer.echo(_line(resource))
        for port in found.serial_ports:
            unasked = f"{port.port}: {port.description}, not asked (--probe-serial asks)"
            typer.echo(unasked if port.found is None else _line(port.found))
        if not (found.resources or found.tried or found.serial_ports):
            typer.echo("nothing found: no VISA resource, no serial port")
        if stanza.strip():
            typer.echo("\n# for a bench file (vcfbench bench show --template has the rest):\n")
            typer.echo(stanza.rstrip())
    silent = [each.resource for each in found.tried if each.answer is None]
    if silent:
        raise BenchError(f"no answer from {', '.join(silent)}")


def _line(found: DiscoveredInstrument) -> str:
    if found.answer is None:
        return f"{found.resource}: {found.problem}"
    known = f"{found.model}" if found.model is not None else "not recognised"
    return f"{found.resource}: {known}, {found.answer}"
