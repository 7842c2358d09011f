"""Eight million points read out through PyVISA-py, beside a bare socket's time for the same bytes.

The record is acquired, and read once, before anything is timed. PyVISA-py takes what a socket has 4096 bytes at a time,
whoever sends it: its own time for the same bytes from a bare server is shown beside.
"""

from __future__ import annotations

import statistics
import time
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

from measure import Figure, report
from tcp import connected, port_of, served_bench, server

from vcfbench.clock import WallClock
from vcfbench.drivers.session import open_session

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

POINTS = 8_000_000
CHUNK = 1 << 20
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
def visa(port: int) -> Iterator[Any]:
    """Give PyVISA-py's resource at `port`, reading in big pieces."""
    import pyvisa  # noqa: PLC0415

    end = {"read_termination": "\n", "write_termination": "\n"}
    instrument = pyvisa.ResourceManager("@py").open_resource(f"TCPIP0::127.0.0.1::{port}::SOCKET", **end)
    instrument.timeout = 120_000
    instrument.chunk_size = CHUNK
    try:
        yield instrument
    finally:
        instrument.close()


def seconds(read: Callable[[], object]) -> float:
    started = time.perf_counter()
    read()
    return time.perf_counter() - started


def figures(rounds: int = 7) -> list[Figure]:
    with (
        served_bench() as (_, served),
        server("bulk") as (_, bulk_port),
        visa(port_of(served, "oscilloscope")) as scope,
    ):
        for setting in SETTINGS:
            scope.write(setting)
        first_s = seconds(lambda: scope.query("*OPC?"))
        first_s += seconds(lambda: values(scope))
        size = len(values(scope))
        with connected(bulk_port) as bare, visa(bulk_port) as bulk, connected(port_of(served, "oscilloscope")) as raw:
            line = b"%d\n" % size
            cases: dict[str, Callable[[], object]] = {
                "bare": lambda: received(bare, line, size + 11),
                "raw": lambda: received(raw, b":WAV:DATA?\n", size + 11),
            }
            taken = {name: [seconds(read) for _ in range(rounds)][1:] for name, read in cases.items()}
        with visa(bulk_port) as bulk:
            taken["PyVISA-py from a bare server"] = [seconds(lambda: values(bulk, str(size))) for _ in range(rounds)][
                1:
            ]
        resource = served["instruments"]["oscilloscope"]["tcp"]
        with open_session(resource, library="@py", clock=WallClock(), name="scope", timeout_s=60.0) as session:
            read = partial(session.query_block, ":WAV:DATA?")
            taken["vcfbench's session on PyVISA-py's socket"] = [seconds(read) for _ in range(rounds)][1:]
        taken["PyVISA-py"] = [seconds(lambda: values(scope)) for _ in range(rounds)][1:]
    return told(size, first_s, {name: statistics.median(times) for name, times in taken.items()})


def values(instrument: Any, question: str = ":WAV:DATA?") -> Any:
    """Return the points as an array of bytes."""
    import numpy as np  # noqa: PLC0415

    return instrument.query_binary_values(question, datatype="B", container=np.ndarray)


def told(size: int, first_s: float, taken: dict[str, float]) -> list[Figure]:
    found = [
        report(Figure("waveform: points", size, "1", bar=POINTS, gross=POINTS, at_least=True)),
        report(Figure("waveform: acquired and read the first time", first_s, "s")),
    ]
    found += [report(Figure(f"waveform: {name}", 1e3 * each, "ms")) for name, each in taken.items()]
    for name in ("raw", "PyVISA-py", "vcfbench's session on PyVISA-py's socket"):
        ratio = taken[name] / taken["bare"]
        found.append(report(Figure(f"waveform: {name} against a bare socket", ratio, "ratio", bar=1.5)))
    ratio = taken["PyVISA-py"] / taken["PyVISA-py from a bare server"]
    found.append(report(Figure("waveform: PyVISA-py, ours against a bare server", ratio, "ratio", bar=1.5)))
    return found


if __name__ == "__main__":
    figures()
