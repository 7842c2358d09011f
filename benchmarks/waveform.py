"""Eight million points read out through PyVISA-py, beside a bare socket's time for the same bytes.

The record is acquired, and read once, before anything is timed; then everybody reads it in turn, round after round.
Over HiSLIP, PyVISA-py is about as fast as the bare socket. What a raw socket has it takes 4096 bytes at a time, whoever
sends it: its own time for the same bytes from a bare server is shown beside. Over VXI-11 it asks for 16384 bytes a
time, because that is what the real oscilloscope announces: 489 questions, as slow as they are there.
"""

from __future__ import annotations

import statistics
import time
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from operator import truediv
from typing import TYPE_CHECKING, Any

from measure import Figure, report
from tcp import connected, served_bench, server

from vcfbench.clock import WallClock
from vcfbench.drivers.session import Session, visa_resource

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

POINTS = 8_000_000
CHUNK = 1 << 20
VISA: tuple[tuple[str, str, int | None, float | None], ...] = (
    ("HiSLIP", "hislip", None, 1.5),
    ("HiSLIP in pieces of 1 MiB", "hislip", CHUNK, 1.5),
    ("SOCKET", "tcp", CHUNK, None),
    ("VXI-11", "vxi11", None, None),
    ("VXI-11 in pieces of 1 MiB", "vxi11", CHUNK, None),
)
OTHER = "PyVISA-py, SOCKET of a bare server"
SETTINGS = (
    *("*RST", ":CHAN1:DISP 1", ":TIM:RANG 0.02", ":ACQ:TYPE NORM", ":ACQ:MODE RTIM", ":DIG CHAN1"),
    *(":WAV:SOUR CHAN1", ":WAV:FORM BYTE", ":WAV:POIN:MODE MAX", f":WAV:POIN {POINTS}"),
)


def received(connection: Any, question: bytes, size: int) -> bytearray:
    """Ask over a plain socket and keep `size` bytes."""
    connection.sendall(question)
    kept = bytearray(size)
    free = memoryview(kept)
    while free:
        free = free[connection.recv_into(free) :]
    return kept


@contextmanager
def visa(resource: str, chunk: int | None = None) -> Iterator[Any]:
    """Give PyVISA-py's resource, reading in pieces of `chunk` bytes, or of PyVISA's default."""
    import pyvisa  # noqa: PLC0415

    end: dict[str, Any] = {}
    if resource.endswith("SOCKET"):
        end = {"read_termination": "\n", "write_termination": "\n"}
    instrument: Any = pyvisa.ResourceManager("@py").open_resource(resource, **end)
    instrument.timeout = 120_000
    if chunk is not None:
        instrument.chunk_size = chunk
    try:
        yield instrument
    finally:
        instrument.close()


def seconds(read: Callable[[], object]) -> float:
    started = time.perf_counter()
    read()
    return time.perf_counter() - started


def values(instrument: Any, question: str = ":WAV:DATA?") -> Any:
    """Return the points as an array of bytes."""
    import numpy as np  # noqa: PLC0415

    return instrument.query_binary_values(question, datatype="B", container=np.ndarray)


@dataclass(frozen=True)
class Case:
    """Something that reads the whole record."""

    name: str
    read: Callable[[], object]
    bar: float | None = None
    """Of its time against the bare socket's."""


@contextmanager
def cases(size: int, wires: dict[str, str]) -> Iterator[list[Case]]:
    """Open everything that is to read."""
    with ExitStack() as stack:
        (_, bare), (_, bulk) = (stack.enter_context(server("bulk")) for _ in range(2))
        line = b"%d\n" % size
        port = int(wires["tcp"].split("::")[2])
        sockets = [stack.enter_context(connected(each)) for each in (bare, port)]
        found = [
            Case("a bare socket", partial(received, sockets[0], line, size + 11)),
            Case("a plain socket from us", partial(received, sockets[1], b":WAV:DATA?\n", size + 11), 1.5),
        ]
        for name, kind, chunk, bar in VISA:
            instrument = stack.enter_context(visa(wires[kind], chunk))
            found.append(Case(f"PyVISA-py, {name}", partial(values, instrument), bar))
        other = stack.enter_context(visa(f"TCPIP0::127.0.0.1::{bulk}::SOCKET", CHUNK))
        found.append(Case(OTHER, partial(values, other, str(size))))
        for kind in ("tcp", "hislip"):
            connect, clock = visa_resource(wires[kind], "@py"), WallClock()
            session = Session.opened(connect, name="scope", resource=wires[kind], clock=clock, timeout_s=60.0)
            read = partial(stack.enter_context(session).query_block, ":WAV:DATA?")
            found.append(Case(f"vcfbench's session, {kind}", read, 1.5))
        yield found


def figures(rounds: int = 9) -> list[Figure]:
    with served_bench("--offer", "oscilloscope:hislip") as (_, served):
        wires = served["instruments"]["oscilloscope"]
        with visa(wires["hislip"]) as scope:
            for setting in SETTINGS:
                scope.write(setting)
            first_s = seconds(lambda: scope.query("*OPC?"))
            first_s += seconds(lambda: values(scope))
            size = len(values(scope))
        with cases(size, wires) as found:
            rows = [[seconds(case.read) for case in found] for _ in range(rounds + 1)][1:]
            return figures_of(size, first_s, found, rows)


def figures_of(size: int, first_s: float, found: list[Case], rows: list[list[float]]) -> list[Figure]:
    """Report medians of the times, and of the ratios within each round."""
    said = [
        report(Figure("waveform: points", size, "1", bar=POINTS, gross=POINTS, at_least=True)),
        report(Figure("waveform: acquired and read the first time", first_s, "s")),
    ]
    taken = {case.name: [row[number] for row in rows] for number, case in enumerate(found)}
    for name, times in taken.items():
        said.append(report(Figure(f"waveform: {name}", 1e3 * statistics.median(times), "ms")))
    bare = taken[found[0].name]
    for case in found[1:]:
        ratio = statistics.median(map(truediv, taken[case.name], bare))
        said.append(report(Figure(f"waveform: {case.name}, against a bare socket", ratio, "ratio", bar=case.bar)))
    ratio = statistics.median(map(truediv, taken["PyVISA-py, SOCKET"], taken[OTHER]))
    said.append(report(Figure("waveform: PyVISA-py, SOCKET, ours against a bare server", ratio, "ratio", bar=1.5)))
    return said


if __name__ == "__main__":
    figures()
