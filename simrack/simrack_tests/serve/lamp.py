"""A small SCPI instrument with one command of each kind that matters to a transport, and a server around it."""

from __future__ import annotations

import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, cast

from simrack.scpi import (
    COMMON_COMMANDS,
    GPIB,
    Command,
    CommandTable,
    Dialect,
    Number,
    Pending,
    ScpiEngine,
    ScpiTwin,
    block,
    quoted,
    real,
    signed_integer,
)
from simrack.serve import BenchServer, ServedBench, ServedClock, ServerSettings

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterator

    from simrack.device import Device
    from simrack.serve import Offer

IDENTITY = b"Nobody,Lamp,0,1.0\n"
MOST_SLICES = 100_000
PICTURE = bytes(range(256)) * 1024  # newlines and every other byte in it


class Lamp(ScpiTwin):
    """READ? takes a second; WAIT? takes a trigger; PICTure? is a block; LEVel is a number from 0 to 10 V.

    THINk? takes no bench time, but works on until `thought`, a hundred thousand slices at most.
    """

    def __init__(self, clock: ServedClock) -> None:
        self.level_v = 0.0
        self.triggers = 0
        self.readings = 0
        self.slices = 0
        self.thought: Callable[[], bool] = lambda: True
        self.dimmed_at_s: list[float] = []
        self.dims_at_s: float | None = None
        self.engine = ScpiEngine(self, TABLE, clock, dialect=Dialect(input_limit=4096), interface=GPIB)

    def identity(self) -> str:
        return IDENTITY.decode().strip()

    def reset(self) -> None:
        self.level_v = 0.0

    def service(self) -> None:
        if self.dims_at_s is not None and self.engine.clock.now() >= self.dims_at_s:
            self.dimmed_at_s.append(self.engine.clock.now())
            self.dims_at_s = None

    def next_event_s(self) -> float | None:
        return self.dims_at_s

    def abort(self) -> None:
        self.triggers = 0


def set_level(lamp: Lamp, volts: float) -> None:
    lamp.level_v = volts


def read_level(lamp: Lamp) -> float:
    lamp.readings += 1
    return lamp.level_v


def wait_for_trigger(lamp: Lamp) -> Pending:
    before = lamp.triggers
    return Pending(
        lambda: lamp.engine.clock.now() if lamp.triggers > before else None, lambda: f"triggered {lamp.triggers}"
    )


def trigger(lamp: Lamp) -> None:
    lamp.triggers += 1


def think(lamp: Lamp) -> Pending:
    def slices() -> Generator[None, None, int]:
        while lamp.slices < MOST_SLICES and not lamp.thought():
            lamp.slices += 1
            yield
        return lamp.slices

    return Pending.worked_out(slices())


def dim_later(lamp: Lamp, seconds: float) -> None:
    lamp.dims_at_s = lamp.engine.clock.now() + seconds


TABLE = CommandTable(
    *COMMON_COMMANDS,
    Command("LEVel", (Number(unit="V"),), do=set_level, query=lambda lamp: lamp.level_v, reply=real(8)),
    Command("SLOWly", (Number(unit="V"),), do=set_level, takes_s=0.5),
    Command("READ", query=read_level, reply=real(8), query_takes_s=1.0),
    Command("WAIT", query=wait_for_trigger, reply=quoted),
    Command("DIM", (Number(unit="S"),), do=dim_later),
    Command("PICTure", query=lambda _lamp: PICTURE, reply=block),
    Command("THINk", query=think, reply=signed_integer),
    Command("TIME", query=lambda lamp: lamp.engine.clock.now(), reply=real(12)),
    Command("*TRG", do=trigger, urgent=True),
    Command("COUNt", query=lambda lamp: lamp.readings, reply=signed_integer),
)


class Served:
    """A running server and its clock."""

    def __init__(self, server: BenchServer, devices: dict[str, Device]) -> None:
        self.server = server
        self.devices = devices
        self.clock = server.clock

    def port(self, kind: str, role: str = "lamp") -> int:
        """Return the port in a resource string."""
        resource = str(self.resource(kind, role))
        part = {"tcp": -2, "vxi11": 1, "hislip": -2}[kind]
        return int(resource.split("::")[part].rpartition(",")[2])

    def resource(self, kind: str, role: str = "lamp") -> str:
        resource = self.server.wires[role].as_json()[kind]
        assert resource is not None
        return resource

    @property
    def lamp(self) -> Lamp:
        return cast("Lamp", self.devices["lamp"])


ALL: frozenset[Offer] = frozenset({"tcp", "vxi11", "hislip", "pty"})


@contextmanager
def served_lamp(speed: float = 1.0, settings: ServerSettings | None = None, world: Any = None) -> Iterator[Served]:
    """Serve a lamp on everything there is."""
    clock = ServedClock(speed)
    with serving({"lamp": Lamp(clock)}, clock, settings or ServerSettings(offers={"lamp": ALL}), world) as served:
        yield served


@contextmanager
def serving(
    devices: dict[str, Any], clock: ServedClock, settings: ServerSettings | None = None, world: Any = None
) -> Iterator[Served]:
    """Serve devices in a thread of this process."""
    bench = ServedBench(world, devices, dict.fromkeys(devices, "lamp"))
    with BenchServer(bench, clock, settings) as server:
        thread = threading.Thread(target=server.run)
        thread.start()
        try:
            yield Served(server, devices)
        finally:
            server.stop()
            thread.join(10)
            assert not thread.is_alive()
