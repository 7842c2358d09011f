"""The servers that benchmarks/tcp.py asks, each in its own process: python servers.py KIND PORT.

`bare` is what a socket costs with no instrument behind it. The others are peers, one simple instrument each, run with
the interpreter of an environment that peers.sh has made.
"""

from __future__ import annotations

import logging
import selectors
import socket
import sys
import tempfile
import threading
from pathlib import Path
from typing import Any

REPLY = b"+1.23456789E+00\n"


def bare(port: int) -> None:
    """Answer every line that ends in a question mark, from one selectors loop."""
    server = socket.create_server(("127.0.0.1", port))
    server.settimeout(0.0)
    waiting = selectors.DefaultSelector()
    waiting.register(server, selectors.EVENT_READ)
    pending: dict[Any, bytes] = {}
    while True:
        for key, _ in waiting.select():
            if key.fileobj is server:
                connection, _ = server.accept()
                connection.settimeout(0.0)
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                pending[connection] = b""
                waiting.register(connection, selectors.EVENT_READ)
                continue
            client: Any = key.fileobj
            data = client.recv(4096)
            if not data:
                waiting.unregister(client)
                client.close()
                continue
            *lines, pending[client] = (pending[client] + data).split(b"\n")
            if replies := sum(line.endswith(b"?") for line in lines):
                client.sendall(REPLY * replies)


def bulk(port: int) -> None:
    """Answer every line with a block of as many bytes as it says."""
    server = socket.create_server(("127.0.0.1", port))
    blocks: dict[bytes, bytes] = {}
    while True:
        connection, _ = server.accept()
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        while line := connection.recv(4096):
            size = int(line)
            if line not in blocks:
                blocks[line] = b"#8%08d" % size + bytes(size) + b"\n"
            connection.sendall(blocks[line])


def instro(port: int) -> None:
    """Serve the simulated supply of instro."""
    from instro.psu.scpi_sim_server import SimulatedPSU, SimulatedPSUServer  # noqa: PLC0415

    logging.disable(logging.WARNING)
    SimulatedPSUServer(SimulatedPSU(), port=port).start()
    threading.Event().wait()


def sinstruments(port: int) -> None:
    """A meter of sinstruments."""
    from sinstruments.simulator import BaseDevice, Server  # noqa: PLC0415

    class Meter(BaseDevice):  # type: ignore[misc]
        newline = b"\n"

        def handle_message(self, message: bytes) -> bytes | None:
            return REPLY if message.strip().endswith(b"?") else None

    class Entry:
        def load(self) -> type:
            return Meter

    transport = {"type": "tcp", "url": f"127.0.0.1:{port}"}
    devices = [{"class": "Meter", "name": "meter", "transports": [transport]}]
    Server(devices=devices, registry={"Meter": Entry()}).serve_forever()


LEWIS = """
from lewis.adapters.stream import Cmd, StreamInterface
from lewis.devices import Device

framework_version = "1.3.3"

class Meter(Device):
    voltage = 1.23456789

class MeterInterface(StreamInterface):
    commands = {Cmd("get_voltage", pattern=r"^MEAS1:VOLT\\\\?$", return_mapping="{:+.8E}".format)}
    in_terminator = "\\\\n"
    out_terminator = "\\\\n"

    def get_voltage(self):
        return self.device.voltage

    def handle_error(self, request, error):
        return "ERR"
"""


def lewis(port: int) -> None:
    """A meter of lewis."""
    from lewis.scripts.run import run_simulation  # noqa: PLC0415

    with tempfile.TemporaryDirectory() as folder:
        package = Path(folder) / "vcf_meters"
        (package / "meter").mkdir(parents=True)
        (package / "__init__.py").write_text("")
        (package / "meter" / "__init__.py").write_text(LEWIS.encode().decode("unicode_escape"))
        adapter = f"stream: {{bind_address: 127.0.0.1, port: {port}}}"
        run_simulation(["-a", folder, "-k", "vcf_meters", "-p", adapter, "meter"])


def tickit(port: int) -> None:
    """A meter of tickit."""
    import asyncio  # noqa: PLC0415

    import pydantic.v1.dataclasses  # noqa: PLC0415
    from tickit.adapters.io.tcp_io import TcpIo  # noqa: PLC0415
    from tickit.adapters.specifications import RegexCommand  # noqa: PLC0415
    from tickit.adapters.tcp import CommandAdapter  # noqa: PLC0415
    from tickit.core.adapter import AdapterContainer  # noqa: PLC0415
    from tickit.core.components.component import ComponentConfig  # noqa: PLC0415
    from tickit.core.components.device_component import DeviceComponent  # noqa: PLC0415
    from tickit.core.device import Device, DeviceUpdate  # noqa: PLC0415
    from tickit.core.management.event_router import InverseWiring  # noqa: PLC0415
    from tickit.core.management.schedulers.master import MasterScheduler  # noqa: PLC0415
    from tickit.core.state_interfaces.state_interface import get_interface  # noqa: PLC0415
    from tickit.core.typedefs import ComponentID  # noqa: PLC0415
    from tickit.utils.byte_format import ByteFormat  # noqa: PLC0415

    class MeterDevice(Device):  # type: ignore[misc]
        voltage = 1.23456789

        def update(self, _time: Any, _inputs: Any) -> Any:
            return DeviceUpdate({}, None)

    class MeterAdapter(CommandAdapter):  # type: ignore[misc]
        _byte_format = ByteFormat(b"%b\n")

        def __init__(self, device: MeterDevice) -> None:
            super().__init__()
            self.device = device

        @RegexCommand(r"MEAS1:VOLT\?\s*", False, "utf-8")  # type: ignore[untyped-decorator]  # noqa: FBT003
        async def voltage(self) -> bytes:
            return f"{self.device.voltage:+.8E}".encode()

    @pydantic.v1.dataclasses.dataclass
    class Meter(ComponentConfig):  # type: ignore[misc]
        def __call__(self) -> Any:
            device = MeterDevice()
            adapter = AdapterContainer(MeterAdapter(device), TcpIo("127.0.0.1", port))
            return DeviceComponent(name=self.name, device=device, adapters=[adapter])

    async def serve() -> None:
        component = Meter(name="meter", inputs={})()
        consumer, producer = get_interface("internal")
        scheduler = MasterScheduler(InverseWiring({ComponentID("meter"): {}}), consumer, producer)
        tasks = (component.run_forever(consumer, producer), scheduler.run_forever())
        await asyncio.wait([asyncio.create_task(task) for task in tasks])

    asyncio.run(serve())


KINDS = {each.__name__: each for each in (bare, bulk, instro, sinstruments, lewis, tickit)}

if __name__ == "__main__":
    KINDS[sys.argv[1]](int(sys.argv[2]))
