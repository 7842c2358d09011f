"""Run in python-vxi11's environment: all that its Instrument and CoreClient can do; prints what was seen as JSON.

Its rpc module has a server too, on which the interrupt program stands: service requests are received by code that
nobody here wrote.
"""

from __future__ import annotations

import json
import queue
import sys
import threading
from typing import Any

from vxi11 import rpc, vxi11

INTERRUPTS, TCP = 0x0607B1, 0


class Interrupts(rpc.TCPServer):  # type: ignore[misc]
    """Serves device_intr_srq."""

    def __init__(self) -> None:
        super().__init__("127.0.0.1", INTERRUPTS, 1, 0)
        self.handles: queue.Queue[bytes] = queue.Queue()
        self.sock.listen(1)
        threading.Thread(target=self.loop, daemon=True).start()

    def handle_30(self) -> None:
        handle = self.unpacker.unpack_opaque()
        self.turn_around()
        self.handles.put(handle)


def opened(port: int) -> Any:
    """Return a device at a port of its own: no port mapper is asked."""
    device = vxi11.Instrument("127.0.0.1", "inst0")
    device.client = vxi11.CoreClient("127.0.0.1", port)
    device.abort_client = vxi11.AbortClient("127.0.0.1", port)
    device.open()
    return device


def refused(act: Any) -> int | None:
    """Return the error that `act` meets."""
    try:
        act()
    except vxi11.Vxi11Exception as error:
        return int(error.err)
    return None


def service_request(generator: Any) -> dict[str, Any]:
    program, client = Interrupts(), generator.client
    loopback = 0x7F000001
    seen: dict[str, Any] = {"create": client.create_intr_chan(loopback, program.port, INTERRUPTS, 1, TCP)}
    seen["enable"] = client.device_enable_srq(generator.link, True, b"generator")  # noqa: FBT003
    generator.write("*CLS;*SRE 32;*ESE 32")
    generator.write("NONSENSE")
    seen["handle"] = program.handles.get(timeout=10).decode()
    seen["stb"] = [generator.read_stb(), generator.read_stb()]
    seen["error"] = generator.ask("SYST:ERR?")
    seen["disable"] = client.device_enable_srq(generator.link, False, b"")  # noqa: FBT003
    seen["destroy"] = client.destroy_intr_chan()
    return seen


def locks(generator: Any, port: int) -> dict[str, Any]:
    other = opened(port)
    other.lock_timeout = 0.05
    generator.lock()
    seen = {"locked out": refused(lambda: other.write("*RST")), "not locked": refused(other.unlock)}
    generator.unlock()
    seen["free"] = refused(lambda: other.write("VOLT:OFFS 0"))
    other.close()
    return seen


def aborted(generator: Any) -> int | None:
    generator.timeout = 20
    timer = threading.Timer(0.3, generator.abort)
    timer.start()
    error = refused(generator.read_raw)
    timer.join()
    return error


def main() -> None:
    generator_port, scope_port = map(int, sys.argv[1:])
    generator, scope = opened(generator_port), opened(scope_port)
    seen: dict[str, Any] = {"identity": [generator.ask("*IDN?"), scope.ask("*IDN?")]}
    seen["most"] = scope.max_recv_size
    generator.write(["FUNC SIN", "FREQ 1234.5"])
    seen["frequency"] = float(generator.ask("FREQ?"))
    client, rest = generator.client, (generator.link, 0, 1000, 1000)
    seen["remote"] = [client.device_remote(*rest), client.device_local(*rest), refused(generator.trigger)]
    seen["service request"] = service_request(generator)
    seen["locks"] = locks(generator, generator_port)
    generator.write("*IDN?")
    generator.clear()
    seen["cleared"] = generator.ask("SYST:ERR?")
    seen["aborted"] = aborted(generator)
    seen["errors after"] = generator.ask("SYST:ERR?")
    scope.write("*RST;:WAV:FORM BYTE;:WAV:POIN 1000;:DIG CHAN1")
    scope.write(":WAV:DATA?")
    block = scope.read_raw()
    seen["block"] = [block[:10].decode(), len(block)]
    generator.write("DATA VOLATILE, " + ", ".join(["0.25", "-0.25"] * 2500))  # twice the most of one write
    seen["long write"] = generator.ask("DATA:ATTR:POIN? VOLATILE") + " " + generator.ask("SYST:ERR?")
    scope.close()
    generator.close()
    sys.stdout.write(json.dumps(seen))


if __name__ == "__main__":
    main()
