"""How long others wait at a served bench while one client takes eight million points from the oscilloscope.

A process of its own acquires and takes the record again and again, over a plain socket or over VXI-11 (PyVISA-py). This
one asks the multimeter `*IDN?` and the table its rate all the while, one question every millisecond, and notes how long
each answer takes. The bar is 5 ms for the 99th percentile. The machine needs three idle cores for figures that are the
server's alone.
"""

from __future__ import annotations

import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

import numpy as np
from measure import Figure, report
from tcp import connected, port_of, served_bench

if TYPE_CHECKING:
    import socket
    from collections.abc import Iterator

POINTS = 8_000_000
SETTINGS = (
    *("*RST", ":CHAN1:DISP 1", ":TIM:RANG 0.02", ":ACQ:TYPE NORM", ":WAV:SOUR CHAN1"),
    *(":WAV:FORM {form}", ":WAV:POIN:MODE MAX", f":WAV:POIN {POINTS}"),
)
TAKER = """
import sys
import pyvisa
resource, chunk, settings, size = sys.argv[1], int(sys.argv[2]), sys.argv[3].split("|"), int(sys.argv[4])
end = {"read_termination": "\\n", "write_termination": "\\n"} if resource.endswith("SOCKET") else {}
scope = pyvisa.ResourceManager("@py").open_resource(resource, timeout=120_000, chunk_size=chunk, **end)
for setting in settings:
    scope.write(setting)
print("begun", flush=True)
while True:
    scope.write(":DIG CHAN1")
    kept = scope.query_binary_values(":WAV:DATA?", datatype="B", container=bytes)
    assert len(kept) >= size
    print("taken", flush=True)
"""
WIRES = {"TCP, BYTE": ("tcp", "BYTE"), "TCP, WORD": ("tcp", "WORD"), "VXI-11, BYTE": ("vxi11", "BYTE")}


@contextmanager
def taking(resource: str, form: str) -> Iterator[subprocess.Popen[str]]:
    """Let a process take records as long as this lasts."""
    settings = "|".join(SETTINGS).format(form=form)
    command = [sys.executable, "-c", TAKER, resource, str(1 << 20), settings, str(POINTS)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None  # noqa: S101
        assert process.stdout.readline() == "begun\n"  # noqa: S101
        yield process
    finally:
        process.terminate()
        process.wait()


def asked(connection: socket.socket, question: bytes) -> float:
    """Ask once; return the time that the answer took, s."""
    started = time.perf_counter()
    connection.sendall(question)
    while not connection.recv(4096).endswith(b"\n"):
        pass
    return time.perf_counter() - started


def waits(connections: list[tuple[socket.socket, bytes]], seconds: float) -> np.ndarray:
    """Ask in turn, a question a millisecond; return how long each answer took, s."""
    found, end = [], time.perf_counter() + seconds
    while time.perf_counter() < end:
        for connection, question in connections:
            found.append(asked(connection, question))
            time.sleep(1e-3)
    return np.array(found)


def figures(seconds: float = 6.0) -> list[Figure]:
    said = []
    with ExitStack() as stack:
        _, served = stack.enter_context(served_bench("--speed", "max"))
        meter, scope = (
            stack.enter_context(connected(port_of(served, role))) for role in ("multimeter", "oscilloscope")
        )
        questions = [(meter, b"*IDN?\n"), (meter, b"SYST:ERR?\n")]
        said += figures_of("nobody else", waits(questions, seconds / 2))
        scope.sendall(b"*IDN?\n")
        scope.recv(4096)
        for name, (wire, form) in WIRES.items():
            with taking(served["instruments"]["oscilloscope"][wire], form) as process:
                found = waits(questions, seconds)
                process.terminate()
                assert process.stdout is not None  # noqa: S101
                records = process.stdout.read().count("taken")
            said.append(report(Figure(f"neighbours: {name}, records taken", records, "1", gross=1, at_least=True)))
            said += figures_of(name, found)
    return said


def figures_of(name: str, found: np.ndarray) -> list[Figure]:
    p99, longest = 1e3 * float(np.quantile(found, 0.99)), 1e3 * float(found.max())
    return [
        report(Figure(f"neighbours: {name}, p99 of an answer", p99, "ms", bar=5.0)),
        report(Figure(f"neighbours: {name}, longest", longest, "ms")),
    ]


if __name__ == "__main__":
    figures()
