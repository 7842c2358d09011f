"""A stand-in for the table of rt200.toml, on a TCP port: ``python stand_in.py 4001``.

It is written from the table's manual, not from the profile, so that each checks the other.
"""

import sys
from socketserver import StreamRequestHandler, ThreadingTCPServer
from typing import ClassVar

from vcfbench.clock import WallClock


class Rt200:
    """One axis: angle, rate, demand (deg, deg/s) and acceleration (deg/s^2)."""

    def __init__(self) -> None:
        self.angle_deg = self.rate_deg_s = self.demand_deg_s = 0.0
        self.acceleration_deg_s2 = 20.0
        self.on = False
        self._clock, self._seen_s = WallClock(), 0.0

    def answer(self, command: str) -> str:
        """Do a command; return the reply."""
        self._turn()
        verb, value = command[:2], command[2:]
        match verb, value:
            case "ID", "?":
                return "RT-200 V1.3"
            case "EN", "0" | "1":
                self.on = value == "1"
            case "PS", "?":
                return f"PS{self.angle_deg % 360.0:07.3f}"
            case "RT", "?":
                return f"RT{self.rate_deg_s:+08.3f}"
            case "ST", "?":
                steady = self.rate_deg_s == self.demand_deg_s != 0.0
                return f"ST{self.on + 2 * steady:X}"
            case "AC", _:
                self.acceleration_deg_s2 = float(value)
            case "RT", _ if self.on or float(value) == 0.0:
                self.demand_deg_s = float(value)
            case _:
                return "ER4"
        return "OK"

    def _turn(self) -> None:
        now_s = self._clock.now()
        passed_s, self._seen_s = now_s - self._seen_s, now_s
        most = self.acceleration_deg_s2 * passed_s
        self.rate_deg_s += max(-most, min(most, self.demand_deg_s - self.rate_deg_s))
        self.angle_deg += self.rate_deg_s * passed_s


class Line(StreamRequestHandler):
    """A connection: commands that end in CR, replies in CR LF."""

    table: ClassVar = Rt200()

    def handle(self) -> None:
        """Answer until the line is closed."""
        kept = b""
        while data := self.request.recv(256):
            *commands, kept = (kept + data).split(b"\r")
            for command in commands:
                self.wfile.write(f"{self.table.answer(command.decode('latin-1'))}\r\n".encode())


if __name__ == "__main__":
    with ThreadingTCPServer(("127.0.0.1", int(sys.argv[1])), Line) as server:
        print(f"RT-200 at socket://127.0.0.1:{server.server_address[1]}", flush=True)  # noqa: T201
        server.serve_forever()
