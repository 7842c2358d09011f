"""Identity of instruments by their resource names: two may mean the same.

`GPIB0::22::INSTR` is `GPIB::22`, `TCPIP::Meter.lab::INSTR` is `TCPIP0::192.168.1.5::inst0::INSTR`, and
`/dev/serial/by-id/usb-FTDI...` is `/dev/ttyUSB0`. One instrument on two interfaces, or behind a gateway, is not
recognised: nothing in its names tells. A GPIB adapter is the socket or port that it is on.
"""

import ipaddress
import os
import re
import socket
import sys
from collections.abc import Mapping
from urllib.parse import urlsplit

from vcfbench.errors import ConfigError


def require_apart(resources: Mapping[str, str], *, ask: bool = True) -> None:
    """Check that each role has its own instrument under any name; `resources` are names by role, `ask` as below.

    Raises:
        ConfigError: two have.
    """
    found: dict[str, str] = {}
    for role, resource in resources.items():
        other = found.setdefault(resource_key(resource, ask=ask), role)
        if other != role:
            raise ConfigError(
                f"the same instrument as {other} at {resources[other]}, written otherwise",
                instrument=role,
                resource=resource,
                hint="expected a separate instrument for each role",
            )


def resource_key(resource: str, *, ask: bool = True) -> str:
    """Return a name that is the same for all names of one resource: VISA names, serial ports, URLs of pyserial.

    Without `ask` nobody is asked for the address of a host: its names are told apart.
    """
    text = resource.strip()
    try:
        if "://" in text:
            url = urlsplit(text)
            if url.scheme in {"socket", "rfc2217"} and url.hostname and url.port:
                return _of_socket(url.hostname, url.port, ask=ask)
            if url.scheme in {"spy", "alt"}:  # a port, looked at or opened otherwise
                return _of_port(url.netloc + url.path)
            return text.casefold()
        return _of_visa(text, ask=ask) if "::" in text or text.upper().startswith("ASRL") else _of_port(text)
    except (ValueError, IndexError):  # no name that anything could be opened by
        return text.casefold()


def _of_visa(text: str, *, ask: bool) -> str:
    head, *rest = text.split("::")
    if head.upper().startswith(("ASRL", "PRLGX-ASRL")):
        return _of_port(rest[0] if head[0] in "Pp" else head[len("ASRL") :])
    found = re.fullmatch(r"([A-Za-z-]+?)(\d*)", head)
    interface, board = (found[1].upper(), found[2] or "0") if found else (head.upper(), "0")
    kind = rest.pop().upper() if rest[-1].upper() in {"INSTR", "SOCKET", "INTFC", "RAW"} else "INSTR"
    match interface:
        case "GPIB":
            return " ".join(["gpib", board, *(str(int(address)) for address in rest), *([kind] * (kind == "INTFC"))])
        case "TCPIP" | "PRLGX-TCPIP" if kind in {"SOCKET", "INTFC"}:
            return _of_socket(rest[0], int(rest[1] if len(rest) > 1 else "1234"), ask=ask)
        case "TCPIP":
            device = rest[1].casefold() if len(rest) > 1 else "inst0"
            host, comma, port = rest[0].partition(",")  # of the core channel, where no portmapper tells it
            return f"lan {_of_host(host, ask=ask)}{comma}{port} {device.removesuffix(',4880')}"
        case "USB":
            return f"usb {int(rest[0], 0):04x} {int(rest[1], 0):04x} {rest[2].casefold()}"
    return text.casefold()


def _of_port(port: str) -> str:
    if sys.platform == "win32" or re.fullmatch(r"(?i)(?:\\\\\.\\)?com\d+", port):
        name = port.upper().removeprefix("\\\\.\\")
        return f"serial COM{name}" if name.isdigit() else f"serial {name}"
    return f"serial {port}" if port.isdigit() else f"serial {os.path.realpath(port)}"


def _of_socket(host: str, port: int, *, ask: bool) -> str:
    return f"socket {_of_host(host, ask=ask)}:{port}"


def _of_host(host: str, *, ask: bool) -> str:
    """Return the address of `host`, ``localhost`` for every name of this computer; the name if nobody knows it."""
    name = host.strip("[]").casefold()
    try:
        flags = 0 if ask or name == "localhost" else socket.AI_NUMERICHOST
        found = sorted({str(entry[4][0]) for entry in socket.getaddrinfo(name, None, flags=flags)})
    except (OSError, UnicodeError):
        return name
    addresses = [ipaddress.ip_address(address.partition("%")[0]) for address in found]
    return "localhost" if any(address.is_loopback for address in addresses) else found[0]
