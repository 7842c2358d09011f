"""Questions a second over TCP, and how long the answers take, beside a bare server and the peers that there are.

Client and server share one processor: across two, a wake-up costs more than the question. All servers run at the same
time, stopped (SIGSTOP) while another is asked, and take many short turns, for the machine is shared; and all of that
several times with new processes, of which one may be a tenth slower than the next by nothing but its place in memory.
Peers are found in the environments that peers.sh has made.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import statistics
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from measure import Figure, here, report

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

PEERS = Path(os.environ.get("PEERS", Path.home() / ".cache" / "vcfbench-peers"))
PEER_NAMES = ("instro", "sinstruments", "lewis", "tickit")
PEER_QUESTION = "MEAS1:VOLT?"
SERVE = (sys.executable, "-m", "vcfbench", "sim", "serve", "--json", "--speed", "max")


def pin() -> None:
    """Keep this process and its children on one processor, where the system can."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})


@dataclass
class Asked:
    """A server, what it is asked, and what was measured of it."""

    name: str
    process: subprocess.Popen[str]
    port: int
    question: str
    raw: list[float] = field(default_factory=list)
    pyvisa: list[float] = field(default_factory=list)
    times_s: list[float] = field(default_factory=list)

    def sleep(self) -> None:
        """Stop the server, so that it takes no time from the others."""
        if hasattr(signal, "SIGSTOP"):
            self.process.send_signal(signal.SIGSTOP)

    def measure(self, seconds: float) -> None:
        """Let the server go on for one round of measurements; one client at a time, for some serve no more."""
        if hasattr(signal, "SIGCONT"):
            self.process.send_signal(signal.SIGCONT)
        with raw_asker(self.port, self.question) as ask:
            self.raw.append(rate(ask, seconds))
            self.times_s += latencies_s(ask, 200)
        with pyvisa_asker(self.port, self.question) as ask:
            self.pyvisa.append(rate(ask, seconds))
        self.sleep()


@contextmanager
def running(command: list[str], **options: Any) -> Iterator[subprocess.Popen[str]]:
    """Run `command` until left."""
    process = subprocess.Popen(command, text=True, **options)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


@contextmanager
def served_bench(*options: str) -> Iterator[tuple[subprocess.Popen[str], dict[str, Any]]]:
    """Serve the paper bench; the process, and what it says of itself."""
    with running([*SERVE, *options], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None  # noqa: S101
        yield process, json.loads(process.stdout.readline())


def port_of(served: dict[str, Any], role: str) -> int:
    """Return the port of an instrument's raw socket."""
    return int(served["instruments"][role]["tcp"].split("::")[2])


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return int(probe.getsockname()[1])


@contextmanager
def server(kind: str, python: str = sys.executable) -> Iterator[tuple[subprocess.Popen[str], int]]:
    """Run one of servers.py; the process and its port."""
    port = free_port()
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with running([python, str(here() / "servers.py"), kind, str(port)], **quiet) as process:
        await_port(process, port)
        yield process, port


def await_port(process: subprocess.Popen[str], port: int) -> None:
    for _ in range(400):
        if process.poll() is not None:
            raise ConnectionError("the server has ended")
        with contextlib.suppress(OSError):
            socket.create_connection(("127.0.0.1", port), timeout=0.5).close()
            return
        time.sleep(0.05)
    raise ConnectionError("nobody listens")


def connected(port: int) -> socket.socket:
    connection = socket.create_connection(("127.0.0.1", port), timeout=20)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return connection


@contextmanager
def raw_asker(port: int, question: str) -> Iterator[Callable[[], bytes]]:
    """Give what asks once over a plain socket."""
    line = question.encode() + b"\n"
    with connected(port) as connection:
        send, receive = connection.sendall, connection.recv

        def ask() -> bytes:
            send(line)
            data = receive(4096)
            while not data.endswith(b"\n"):
                data += receive(4096)
            return data

        yield ask


@contextmanager
def pyvisa_asker(port: int, question: str) -> Iterator[Callable[[], str]]:
    """Give what asks once through PyVISA-py."""
    import pyvisa  # noqa: PLC0415

    end: dict[str, Any] = {"read_termination": "\n", "write_termination": "\n"}
    instrument: Any = pyvisa.ResourceManager("@py").open_resource(f"TCPIP0::127.0.0.1::{port}::SOCKET", **end)
    instrument.timeout = 20_000
    try:
        yield lambda: str(instrument.query(question))
    finally:
        instrument.close()


def rate(ask: Callable[[], object], seconds: float) -> float:
    """Return the answers a second."""
    for _ in range(50):
        ask()
    done, started = 0, time.perf_counter()
    while (elapsed := time.perf_counter() - started) < seconds:
        for _ in range(50):
            ask()
        done += 50
    return done / elapsed


def latencies_s(ask: Callable[[], object], count: int) -> list[float]:
    """Return how long each of `count` answers took."""
    found, clock = [], time.perf_counter
    for _ in range(count):
        started = clock()
        ask()
        found.append(clock() - started)
    return found


@contextmanager
def everybody() -> Iterator[list[Asked]]:
    """Start everything that can be asked."""
    with ExitStack() as stack:
        ours, served = stack.enter_context(served_bench())
        port = port_of(served, "rate_source")
        found = [Asked("vcfbench", ours, port, "VOLT:OFFS?")]
        found.append(Asked("bare", *stack.enter_context(server("bare")), PEER_QUESTION))
        for name in PEER_NAMES:
            python = PEERS / name / "bin" / "python"
            if not python.exists():
                continue
            try:
                found.append(Asked(name, *stack.enter_context(server(name, str(python))), PEER_QUESTION))
            except ConnectionError as error:
                print(f"{name}: {error}", file=sys.stderr)
        yield found


def figures(starts: int = 7, turns: int = 10, seconds: float = 0.05) -> list[Figure]:
    pin()
    by_name: dict[str, Asked] = {}
    for _ in range(starts):
        with everybody() as servers:
            for each in servers:
                each.sleep()
            for _ in range(turns):
                for each in servers:
                    each.measure(seconds)
        for each in servers:
            before = by_name.setdefault(each.name, each)
            if before is not each:
                before.raw += each.raw
                before.pyvisa += each.pyvisa
                before.times_s += each.times_s
    return figures_of(by_name)


def figures_of(by_name: dict[str, Asked]) -> list[Figure]:
    servers, found = [*by_name.values()], []
    for each in servers:
        times = sorted(each.times_s)
        found += [
            report(Figure(f"TCP, raw: {each.name}", statistics.median(each.raw), "1/s")),
            report(Figure(f"TCP, PyVISA-py: {each.name}", statistics.median(each.pyvisa), "1/s")),
            report(Figure(f"TCP, raw, p50: {each.name}", 1e6 * times[len(times) // 2], "us")),
            report(Figure(f"TCP, raw, p99: {each.name}", 1e6 * times[len(times) * 99 // 100], "us")),
        ]
    ours = by_name.pop("vcfbench")
    bars = {"bare": (0.85, 0.4), **dict.fromkeys(PEER_NAMES, (1.0, 0.8))}
    for other in by_name.values():
        bar, gross = bars[other.name]
        for what in ("raw", "pyvisa"):
            ratio = statistics.median(a / b for a, b in zip(getattr(ours, what), getattr(other, what), strict=True))
            name = f"TCP, {what}: vcfbench against {other.name}"
            held = (bar, gross) if what == "raw" else (None, None)
            found.append(report(Figure(name, ratio, "ratio", bar=held[0], gross=held[1], at_least=True)))
    return found


if __name__ == "__main__":
    figures()
