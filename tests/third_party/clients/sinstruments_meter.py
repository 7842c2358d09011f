"""Run in an environment with sinstruments: serves a meter that says the same number to every question."""

from __future__ import annotations

import socket
import sys

from sinstruments.simulator import BaseDevice, Server


class Meter(BaseDevice):
    """A meter under the identity of a Keithley 2000."""

    newline = b"\n"

    def handle_message(self, message: bytes) -> bytes | None:
        """Answer a line."""
        asked = message.strip().upper()
        known = {b"*IDN?": b"KEITHLEY INSTRUMENTS INC.,MODEL 2000,1308393,A20\n", b"SYST:ERR?": b'0,"No error"\n'}
        return known.get(asked, b"+1.23456789E+00\n") if asked.endswith(b"?") else None


class _Entry:
    def load(self) -> type[Meter]:
        return Meter


def main() -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    sys.stdout.write(f"{port}\n")
    sys.stdout.flush()
    place = {"class": "Meter", "name": "meter", "transports": [{"type": "tcp", "url": f"127.0.0.1:{port}"}]}
    Server(devices=[place], registry={"Meter": _Entry()}).serve_forever()


if __name__ == "__main__":
    main()
