"""A simulated bench on real wires: its instruments, their wires and resource strings.

Each model is offered by default on the interfaces that the real box has: 33220A and DSO7104B on TCP and VXI-11, E3631A
and 34401A on a serial line and, since labs put those on converters, on TCP; rate tables on a serial line and TCP.
"""

from __future__ import annotations

import math
import socket
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from importlib import import_module
from typing import Any, Literal, Protocol, Self, get_args, runtime_checkable

from msgspec import Struct, field
from msgspec.structs import asdict

from simrack.adjustment import Adjustment
from simrack.device import Device
from simrack.faults import FaultScript
from simrack.serve.adjust import adjustments_of
from simrack.serve.clock import ServedClock
from simrack.serve.control import ControlServer, Refused
from simrack.serve.embodied import CONVERTER, SOCKET
from simrack.serve.hislip import HislipServer
from simrack.serve.instrument import ServedInstrument
from simrack.serve.loop import Loop
from simrack.serve.lxi import LxiServer
from simrack.serve.passage import AttendedPassage
from simrack.serve.port_mapper import PortMapper
from simrack.serve.raw import ByteStream, Pty, TcpStream, has_ptys
from simrack.serve.serial_pty import SerialPty
from simrack.serve.served_faults import ServedFaults, require_roles
from simrack.serve.vxi11 import ABORT, CORE, Vxi11Server
from simrack.serve.wire import Listener
from simrack.world import World

__all__ = ["BenchServer", "Offer", "Rs232", "ServedBench", "ServerSettings", "Wires"]

Offer = Literal["tcp", "vxi11", "hislip", "pty", "lxi"]
"""The interfaces that an instrument can be on; "lxi" is the page that identifies it."""
Rs232 = Literal["ideal", "real", "three-wire"]

_SERIAL: frozenset[Offer] = frozenset({"tcp", "pty"})
"""Where an instrument is offered of which nothing is said: rate tables."""

NEEDED_LATER = (
    *("numpy.fft", "numpy.ma", "numpy.random"),
    *(f"simrack.instruments.agilent33220a.{name}" for name in ("banded", "noise")),
    *(f"simrack.instruments.dso7104b.{name}" for name in ("autoscale", "counter", "screen")),
)
"""Modules that instruments import when they are first asked for what needs them."""
_DEFAULT_CONTROL_PORT = 20220
_HIGHEST_PORT = 65_535


class ServedBench(Struct, frozen=True):
    """A bench to serve: the World, the devices by role, and their models by role; all on one :class:`ServedClock`."""

    world: World
    devices: Mapping[str, Device]
    models: Mapping[str, str]
    seed: int | None = None
    """What it was built from, for whoever asks."""
    rebuild: Callable[[int | None], ServedBench] | None = None
    """Builds it anew, of a seed and on the same clock; without it a served bench cannot be reset."""
    wires: Mapping[str, frozenset[Offer]] = field(default_factory=dict)
    """The interfaces of the real boxes by role."""


class ServerSettings(Struct, frozen=True):
    """Settings of a served bench.

    Args:
        host: address to listen on.
        base_port: first of the ports, the control port; None lets the system choose.
        control_port: the control port, wherever the others are; None takes 20220 if that is free.
        offers: further interfaces by role, beside those of the real box.
        only: the interfaces of a role instead of those of the real box.
        port_mapper: port of a port mapper for VXI-11 (111 is what clients expect), None for none.
        faults: what goes wrong, and when.
        rs232: serial lines: on "ideal" ones characters take no time and nothing is lost; on "real" ones they take
            theirs, at the right speed only, and SCPI instruments have their small buffer, a handshake, and are
            switched on in local; "three-wire" ones lack the handshake.
    """

    host: str = "127.0.0.1"
    base_port: int | None = None
    control_port: int | None = None
    offers: Mapping[str, frozenset[Offer]] = field(default_factory=dict)
    only: Mapping[str, frozenset[Offer]] = field(default_factory=dict)
    port_mapper: int | None = None
    faults: FaultScript = field(default_factory=lambda: FaultScript(()))
    rs232: Rs232 = "ideal"


class Wires(Struct):
    """Addresses of one instrument: ready resource strings, None for a missing wire."""

    model: str
    tcp: str | None = None
    vxi11: str | None = None
    hislip: str | None = None
    pty: str | None = None
    lxi: str | None = None

    @property
    def places(self) -> list[str]:
        """Addresses of the instrument."""
        return [each for each in (self.tcp, self.vxi11, self.hislip, self.pty, self.lxi) if each is not None]

    def as_json(self) -> dict[str, str | None]:
        """Return the contract of ``vcfbench sim serve --json``."""
        return asdict(self)


@runtime_checkable
class _FrontPanel(Protocol):
    """An instrument that obeys a serial line only in remote."""

    local: bool


class _Ports:
    """Hands out ports: from a base on, or whatever the system has."""

    def __init__(self, base: int | None) -> None:
        self._next = base

    def take(self) -> int:
        if self._next is None:
            return 0
        if self._next > _HIGHEST_PORT:
            raise ValueError(f"ports: too few up to {_HIGHEST_PORT} for all instruments; choose a smaller --ports")
        self._next += 1
        return self._next - 1


class BenchServer:
    """Serves a simulated bench.

    Raises:
        OSError: a port is taken.
        ValueError: the settings name an instrument or an interface that is not there, or a fault that it cannot have.
    """

    def __init__(self, bench: ServedBench, clock: ServedClock, settings: ServerSettings | None = None) -> None:
        self.bench = bench
        self.clock = clock
        self.settings = ServerSettings() if settings is None else settings
        self.loop = Loop()
        self.passage = AttendedPassage(clock)
        self.wires: dict[str, Wires] = {}
        self.instruments = {role: ServedInstrument(role, device, clock) for role, device in bench.devices.items()}
        self._listeners: dict[str, list[Listener]] = {role: [] for role in self.instruments}
        self._adjustments: dict[str, Adjustment] | None = None
        self._first = (bench.seed, clock.speed)
        self._open = ExitStack()
        self._open.callback(self.loop.close)
        try:
            require_roles(self.instruments, self.settings.offers, "offer")
            apart = frozenset(role for role in self.instruments if not self.offered(role))
            self.faults = ServedFaults(self.instruments, self._listeners, self.passage, self.settings.faults, apart)
            self._open.callback(self.faults.close)
            self._listen()
        except BaseException:
            self._open.close()
            raise

    def run(self) -> None:
        """Serve until :meth:`stop`; modules of the instruments are imported before."""
        for name in NEEDED_LATER:
            import_module(name)
        self.loop.run(self.passage)

    def stop(self) -> None:
        """End :meth:`run` soon; may be called from a signal handler or another thread."""
        self.loop.stop()

    def close(self) -> None:
        """End every connection and give everything back to the system."""
        for instrument in self.instruments.values():
            for client in tuple(instrument.clients):
                if isinstance(client, ByteStream):
                    client.close()
        self._open.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def as_json(self) -> dict[str, Any]:
        """Return the object printed by ``serve --json``."""
        return {
            "instruments": {role: wires.as_json() for role, wires in self.wires.items()},
            "control": {"host": _loopback(self.settings.host), "port": self.control.port},
        }

    # --- wires --------------------------------------------------------------------------------------------

    def _listen(self) -> None:
        ports = _Ports(self.settings.base_port)
        self.control = self._control(ports)
        self._open.callback(self.control.close)
        for role, instrument in self.instruments.items():
            self.passage.add(instrument)
            self.wires[role] = self._wire(instrument, ports)
        if self.settings.port_mapper is not None:
            self._map_ports(self.settings.port_mapper, ports)
        self.faults.begin()

    def _control(self, ports: _Ports) -> ControlServer:
        address = _loopback(self.settings.host)
        if self.settings.control_port is not None:
            return ControlServer(self, (address, self.settings.control_port))
        if self.settings.base_port is not None:
            return ControlServer(self, (address, ports.take()))
        try:
            return ControlServer(self, (address, _DEFAULT_CONTROL_PORT))
        except OSError:
            return ControlServer(self, (address, 0))

    def offered(self, role: str) -> frozenset[Offer]:
        """Return the interfaces of an instrument."""
        usual = self.bench.wires.get(role, _SERIAL)
        offers = self.settings.only.get(role, usual) | self.settings.offers.get(role, frozenset())
        wrong = offers - frozenset(get_args(Offer))
        if wrong:
            raise ValueError(f"offer: {role} can be on {', '.join(get_args(Offer))}, not on {min(wrong)!r}")
        return offers if has_ptys() else offers - {"pty"}

    def _wire(self, instrument: ServedInstrument, ports: _Ports) -> Wires:
        role, host, shown = instrument.role, self.settings.host, _address_for_clients(self.settings.host)
        offers = self.offered(role)
        wires = Wires(self.bench.models[role])
        by_visa = instrument.engine is not None or getattr(instrument.device, "by_visa", False)
        names = {"inst0": instrument, role: instrument}
        if "tcp" in offers:
            port = self._tcp(instrument, ports)
            wires.tcp = f"TCPIP0::{shown}::{port}::SOCKET" if by_visa else f"socket://{shown}:{port}"
        if "vxi11" in offers:
            vxi11 = Vxi11Server(self.loop, (host, ports.take()), names)
            self._keep(role, vxi11, vxi11.listener)
            wires.vxi11 = f"TCPIP0::{shown},{vxi11.port}::inst0::INSTR"
        if "hislip" in offers:
            hislip = HislipServer(self.loop, (host, ports.take()), {"hislip0": instrument, role: instrument})
            self._keep(role, hislip, hislip.listener)
            wires.hislip = f"TCPIP0::{shown}::hislip0,{hislip.port}::INSTR"
        if "pty" in offers:
            pty = self._pty(instrument)
            wires.pty = f"ASRL{pty.path}::INSTR" if by_visa else pty.path
            self._leave_in_remote(role)
        if "lxi" in offers:
            lxi = LxiServer(self.loop, (host, ports.take()), instrument, shown, wires.places)
            self._keep(role, lxi, lxi.listener)
            wires.lxi = lxi.url
        return wires

    def _pty(self, instrument: ServedInstrument) -> Pty:
        rs232 = self.settings.rs232
        if rs232 == "ideal":
            return Pty(self.loop, instrument)
        return SerialPty(self.loop, instrument, handshake=rs232 == "real")

    def _leave_in_remote(self, role: str) -> None:
        """Leave it as a program did that sent SYSTem:REMote: many drivers rely on somebody having done so."""
        device = self.instruments[role].device
        if self.settings.rs232 == "ideal" and "pty" in self.offered(role) and isinstance(device, _FrontPanel):
            device.local = False

    def _keep(self, role: str, server: Vxi11Server | HislipServer | LxiServer, listener: Listener) -> None:
        self._open.callback(server.close)
        self._listeners[role].append(listener)

    def _tcp(self, instrument: ServedInstrument, ports: _Ports) -> int:
        on_converter = "pty" in self.bench.wires.get(instrument.role, _SERIAL)  # a box without a network port
        text_only = instrument.engine is not None and not instrument.engine.dialect.takes_blocks
        interface = CONVERTER if on_converter and text_only else SOCKET

        def accept(connection: socket.socket) -> None:
            TcpStream(self.loop, instrument, connection, interface)

        listener = Listener(self.loop, (self.settings.host, ports.take()), accept)
        self._open.callback(listener.close)
        self._listeners[instrument.role].append(listener)
        return listener.port

    def _map_ports(self, port: int, ports: _Ports) -> None:
        """Offer every instrument that has VXI-11 on one port too: by its role, or as inst0, inst1, ... in order."""
        having = [self.instruments[role] for role, wires in self.wires.items() if wires.vxi11 is not None]
        names = {f"inst{number}": instrument for number, instrument in enumerate(having)}
        names |= {instrument.role: instrument for instrument in having}
        gateway = Vxi11Server(self.loop, (self.settings.host, ports.take()), names)
        self._open.callback(gateway.close)
        mapper = PortMapper(self.loop, (self.settings.host, port), {CORE: gateway.port, ABORT: gateway.port})
        self._open.callback(mapper.close)

    # --- what the control port offers ---------------------------------------------------------------------

    def status(self) -> dict[str, Any]:
        """Return bench time, its speed, and the connections of each instrument."""
        clock = self.clock
        return {
            "now_s": clock.now(),
            "seed": self.bench.seed,
            "speed": "max" if math.isinf(clock.speed) else clock.speed,
            "paused": clock.paused,
            "lockstep": clock.lockstep,
            "instruments": {
                role: {
                    **self.wires[role].as_json(),
                    "clients": sum(client.comes_and_goes for client in instrument.clients),
                    "busy": instrument.busy,
                    "faults": self.faults.kinds(role),
                }
                for role, instrument in self.instruments.items()
            },
        }

    def listed(self, match: str = "") -> list[dict[str, Any]]:
        """Return the adjustments whose name contains `match`."""
        return [
            {"name": each.name, "unit": each.unit, "meaning": each.meaning, "writable": each.write is not None}
            for each in self._adjustable()
            if match in each.name
        ]

    def get(self, name: str) -> Any:
        """Return the value of a quantity."""
        return self._adjustment(name).read()

    def set(self, name: str, value: Any) -> Any:
        """Change a quantity; return its value."""
        adjustment = self._adjustment(name)
        if adjustment.write is None:
            raise Refused(f"{name} can be read, not changed")
        self.clock.start()
        adjustment.write(value)
        for instrument in self.instruments.values():
            instrument.touched()
        return adjustment.read()

    def reset(self, seed: int | None = None) -> None:
        """Put the bench back to its state when it was served first, of its first seed or another; connections stay.

        Raises:
            Refused: whoever made the server has not said how the bench is built.
        """
        if self.bench.rebuild is None:
            raise Refused("this bench cannot be reset")
        first_seed, first_speed = self._first
        self.faults.end()
        self.clock.restart()
        self.bench = self.bench.rebuild(first_seed if seed is None else seed)
        self._adjustments = None
        for role, instrument in self.instruments.items():
            instrument.replace(self.bench.devices[role])
            self._leave_in_remote(role)
        self.clock.speed = first_speed
        self.passage.restart()
        self.faults.begin()

    def begin_anew(self) -> None:
        """Reset the bench if time has passed without a client."""
        if not self.clock.attended and self.clock.now() > 0.0 and self.bench.rebuild is not None:
            self.reset(self.bench.seed)

    def _adjustable(self) -> Iterator[Adjustment]:
        if self._adjustments is None:
            self._adjustments = adjustments_of(self.bench.world, self.bench.devices)
        yield from self._adjustments.values()

    def _adjustment(self, name: str) -> Adjustment:
        list(self._adjustable())
        assert self._adjustments is not None  # noqa: S101  (for the type checker)
        if name not in self._adjustments:
            raise Refused(f"there is no {name!r}; `ctl` lists all names")
        return self._adjustments[name]


def _loopback(host: str) -> str:
    return "::1" if ":" in host else "127.0.0.1"


def _address_for_clients(host: str) -> str:
    """Return the address in clients' resource strings: of a wildcard that of this machine in its network."""
    if host in {"0.0.0.0", "::"}:  # noqa: S104  (recognised, not chosen)
        host = _outward_address(host)
    return f"[{host}]" if ":" in host else host


def _outward_address(wildcard: str) -> str:
    """Return the address that this machine sends from, or the loopback's if it is in no network; nothing is sent."""
    family, elsewhere = (socket.AF_INET6, "2001:db8::1") if ":" in wildcard else (socket.AF_INET, "192.0.2.1")
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((elsewhere, 9))
        except OSError:
            return _loopback(wildcard)
        return str(probe.getsockname()[0])
