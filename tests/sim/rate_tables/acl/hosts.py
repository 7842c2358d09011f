"""Hosts that speak to the simulated ACUTROL3000: on an ideal table, or on the World's own behind an attended clock."""

from __future__ import annotations

from simrack.rate_tables.acl import AclTable, Header, TableErrors
from simrack_tests.rate_tables.ideal import IdealWorld, exchange

from tests.sim.rate_tables.real import RealWorld
from vcfbench.clock import sleep


class Host:
    """A person at a terminal."""

    def __init__(self, errors: TableErrors | None = None, header: Header = "none") -> None:
        self.world = IdealWorld()
        self.table = AclTable(self.world, errors or TableErrors.none(), header)

    def raw(self, text: str) -> bytes:
        return exchange(self.table, self.world.clock, text.encode() + b"\r\n")

    def ask(self, text: str) -> str:
        reply = self.raw(text)
        assert reply.endswith(b"\r\n"), reply
        return reply[:-2].decode()

    def wait(self, seconds: float) -> None:
        sleep(self.world.clock, seconds)

    def servo(self) -> None:
        assert self.ask(":Demand:Rate 1,0;:Mode:Rate 1") == "OK"
        assert self.ask(":Interlock:Close 1") == "OK"
        self.wait(0.25)
        assert self.ask(":Status:CSR? A1STATE,4") == "1"


class AttendedHost:
    """A program that looks at the table only when it asks; what happens by itself happens all the same."""

    def __init__(self) -> None:
        self.world = RealWorld()
        self.acl = AclTable(self.world, TableErrors.none())
        self.world.clock.attend(self.acl)

    def ask(self, text: str) -> str:
        self.acl.write(text.encode() + b"\n")
        self.wait(0.5)
        return self.acl.read(1000)[0].decode().strip()

    def wait(self, seconds: float) -> None:
        self.world.clock.sleep_until(self.world.clock.now() + seconds)

    def servo(self, mode: str) -> None:
        self.ask(f":Demand:Rate 1,0;Position 1,0;:Mode:{mode} 1;:Interlock:Close 1")
