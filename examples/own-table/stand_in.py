"""A stand-in for the table of corner.toml: ``python stand_in.py PORT [CONTROL]``.

Given the control port of a served bench, it turns the simulated gyroscope. It is written from the table's manual, not
from the profile, so that each checks the other.
"""

import sys
from socketserver import StreamRequestHandler, ThreadingTCPServer
from typing import ClassVar

from simrack.serve import Control

from vcfbench.clock import WallClock


class Table:
    """One axis: angle, rate and demand (deg, deg/s)."""

    def __init__(self) -> None:
        self.angle_deg = self.rate_deg_s = self.demand_deg_s = 0.0
        self._clock, self._seen_s = WallClock(), 0.0

    def answer(self, command: str) -> str:
        """Do a command; return the reply."""
        now_s = self._clock.now()
        self.angle_deg += self.rate_deg_s * (now_s - self._seen_s)
        self._seen_s = now_s
        match command.split():
            case ["V", value]:
                self.demand_deg_s = float(value)
            case ["G"]:
                self._turn(self.demand_deg_s)
            case ["H"]:
                self._turn(0.0)
            case ["P?"]:
                return f"{self.angle_deg:.4f}"
            case _:
                return "ERR 1"
        return "OK"

    def _turn(self, rate_deg_s: float) -> None:
        self.rate_deg_s = rate_deg_s
        for port in sys.argv[2:]:
            with Control(int(port)) as control:
                control.request("set", name="applied_rate_deg_s", value=rate_deg_s)


class Line(StreamRequestHandler):
    """A connection, line by line."""

    table: ClassVar = Table()

    def handle(self) -> None:
        """Answer until the line is closed."""
        for line in self.rfile:
            self.wfile.write(f"{self.table.answer(line.decode('latin-1'))}\r\n".encode())


if __name__ == "__main__":
    with ThreadingTCPServer(("127.0.0.1", int(sys.argv[1])), Line) as server:
        print(f"the table is at socket://127.0.0.1:{server.server_address[1]}", flush=True)  # noqa: T201
        server.serve_forever()
