"""What a served bench holds: memory over millions of questions, many clients at once, clients that vanish.

python endurance.py [QUESTIONS]; ten million by default, pipelined, on four wires in turn: a raw socket, VXI-11, HiSLIP
and a pseudo-terminal. A line of JSON for each hundredth tells the resident memory of the server.
"""

from __future__ import annotations

import json
import os
import re
import selectors
import socket
import struct
import sys
import time
import tty
from contextlib import ExitStack
from functools import partial
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any

from measure import Figure, report
from msgspec import Struct
from simrack.serve.rpc import call_record, marked, opaque
from simrack.serve.vxi11 import CORE
from tcp import connected, latencies_s, port_of, raw_asker, served_bench

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

QUESTION = b"VOLT:OFFS?\n"
AT_ONCE = 500
CLIENTS = 64
VANISHING = 2000


def resident_mb(pid: int) -> float:
    """Return the resident memory of a process, MB; nan where the system does not tell."""
    path = Path(f"/proc/{pid}/statm")
    if not path.exists():
        return float("nan")
    return int(path.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20


class Wire(Struct):
    """Sends a batch of questions at once and takes all the answers, which are as long each time."""

    name: str
    send: Callable[[bytes], object]
    receive: Callable[[int], bytes]
    question: bytes
    answer_bytes: int
    at_once: int = AT_ONCE

    def ask(self) -> int:
        """Ask a batch; return how many questions it is."""
        self.send(self.question * self.at_once)
        wanted = self.answer_bytes * self.at_once
        while wanted:
            came = len(self.receive(min(wanted, 1 << 16)))
            if not came:
                raise ConnectionError(f"{self.name}: the server has gone")
            wanted -= came
        return self.at_once


def _vxi11_call(procedure: int, arguments: bytes) -> bytes:
    return marked(call_record(1, CORE, 1, procedure, arguments))


def wires(served: dict[str, Any], stack: ExitStack) -> Iterator[Wire]:
    """Connect to the generator on each of its wires."""
    offered = served["instruments"]["rate_source"]
    tcp, vxi11, sync, other = (
        stack.enter_context(connected(int(re.findall(r"[:,](\d{4,5})(?=:)", offered[kind])[0])))
        for kind in ("tcp", "vxi11", "hislip", "hislip")
    )
    tcp.sendall(QUESTION)
    size = len(tcp.recv(4096))
    yield Wire("tcp", tcp.sendall, tcp.recv, QUESTION, size)

    vxi11.sendall(_vxi11_call(10, struct.pack(">iII", 0, 0, 0) + opaque(b"inst0")))
    (link,) = struct.unpack_from(">i", vxi11.recv(4096), 32)
    written = _vxi11_call(11, struct.pack(">iIIi", link, 10_000, 0, 8) + opaque(QUESTION))
    read = _vxi11_call(12, struct.pack(">iIIIii", link, 4096, 10_000, 0, 0, 0))
    yield Wire("vxi11", vxi11.sendall, vxi11.recv, written + read, 28 + 8 + 28 + 8 + len(opaque(bytes(size))))

    header = struct.Struct("!2sBBIQ")
    sync.sendall(header.pack(b"HS", 0, 0, 0x0100 << 16, 7) + b"hislip0")
    session = header.unpack(sync.recv(4096)[:16])[3] & 0xFFFF
    other.sendall(header.pack(b"HS", 17, 0, session, 0))
    other.recv(4096)
    delivered = header.pack(b"HS", 7, 1, 0xFFFF_FF00, len(QUESTION)) + QUESTION
    yield Wire("hislip", sync.sendall, sync.recv, delivered, header.size + size)

    terminal = os.open(offered["pty"].removeprefix("ASRL").removesuffix("::INSTR"), os.O_RDWR | os.O_NOCTTY)
    stack.callback(os.close, terminal)
    tty.setraw(terminal)
    yield Wire("pty", partial(os.write, terminal), partial(os.read, terminal), QUESTION, size + 1, 100)


def memory(pid: int, served: dict[str, Any], questions: int) -> list[Figure]:
    """Ask on all wires in turn; what the first tenth makes the server grow is not counted."""
    asked, sizes_mb, started = 0, list[float](), time.perf_counter()
    with ExitStack() as stack:
        for wire in cycle(list(wires(served, stack))):
            told = asked + questions // 100
            while asked < told:
                asked += wire.ask()
            sizes_mb.append(resident_mb(pid))
            print(json.dumps({"wire": wire.name, "questions": asked, "rss_mb": round(sizes_mb[-1], 3)}), flush=True)
            if asked >= questions:
                break
    took, settled = time.perf_counter() - started, sizes_mb[len(sizes_mb) // 10]
    return [
        report(Figure(f"memory after a tenth of {questions} questions", settled, "MB")),
        report(Figure("memory grown over the others", sizes_mb[-1] - settled, "MB", bar=0.5, gross=5.0)),
        report(Figure("questions on four wires, pipelined", asked / took, "1/s")),
    ]


def many(port: int, rounds: int = 500) -> list[Figure]:
    """Let every client ask and wait, all at once."""
    with ExitStack() as stack, selectors.DefaultSelector() as waiting:
        clients = [stack.enter_context(connected(port)) for _ in range(CLIENTS)]
        left = dict.fromkeys(clients, rounds)
        started = time.perf_counter()
        for client in clients:
            waiting.register(client, selectors.EVENT_READ)
            client.sendall(QUESTION)
        while any(left.values()):
            for key, _ in waiting.select():
                answered = key.fileobj
                assert isinstance(answered, socket.socket)  # noqa: S101
                assert answered.recv(4096).endswith(b"\n")  # noqa: S101
                left[answered] -= 1
                if left[answered]:
                    answered.sendall(QUESTION)
        took = time.perf_counter() - started
    return [report(Figure(f"{CLIENTS} clients at once, all", CLIENTS * rounds / took, "1/s"))]


def vanish(pid: int, port: int) -> list[Figure]:
    """Connect, ask, and reset the connection without taking the answer; the others must not notice."""
    files = Path(f"/proc/{pid}/fd")
    with raw_asker(port, "VOLT:OFFS?") as ask:
        ask()
        memory_before, open_before = resident_mb(pid), len(list(files.iterdir())) if files.exists() else 0
        slowest = 0.0
        for number in range(VANISHING):
            with socket.create_connection(("127.0.0.1", port)) as gone:
                gone.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                gone.sendall(QUESTION if number % 2 else QUESTION[:4])
            slowest = max(slowest, *latencies_s(ask, 2))
        open_after = len(list(files.iterdir())) if files.exists() else 0
    return [
        report(Figure(f"files left open by {VANISHING} clients that vanished", open_after - open_before, "1", gross=0)),
        report(
            Figure(
                f"memory grown by {VANISHING} clients that vanished", resident_mb(pid) - memory_before, "MB", gross=5
            )
        ),
        report(Figure("slowest answer to another client meanwhile", 1e3 * slowest, "ms")),
    ]


def figures(questions: int = 10_000_000) -> list[Figure]:
    with served_bench("--offer", "rate_source:hislip,pty") as (process, served):
        port = port_of(served, "rate_source")
        return [*memory(process.pid, served, questions), *many(port), *vanish(process.pid, port)]


if __name__ == "__main__":
    figures(int(sys.argv[1]) if len(sys.argv) > 1 else 10_000_000)
