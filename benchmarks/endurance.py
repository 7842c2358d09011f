"""What a served bench holds: memory over millions of questions, many clients at once, clients that vanish.

python endurance.py [QUESTIONS]; ten million by default, pipelined.
"""

from __future__ import annotations

import os
import selectors
import socket
import struct
import sys
import time
from contextlib import ExitStack
from pathlib import Path

from measure import Figure, report
from tcp import connected, latencies_s, port_of, raw_asker, served_bench

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


def pipelined(connection: socket.socket, questions: int) -> int:
    """Ask `AT_ONCE` questions at a time; return how many bytes came back."""
    connection.sendall(QUESTION)
    size = len(connection.recv(4096))
    total, batch = 0, QUESTION * AT_ONCE
    for _ in range(questions // AT_ONCE):
        connection.sendall(batch)
        wanted = size * AT_ONCE
        while wanted:
            came = len(connection.recv(1 << 16))
            wanted -= came
            total += came
    return total


def memory(pid: int, port: int, questions: int) -> list[Figure]:
    with connected(port) as connection:
        pipelined(connection, 100_000)
        before, started = resident_mb(pid), time.perf_counter()
        pipelined(connection, questions)
        took = time.perf_counter() - started
        grown = resident_mb(pid) - before
    return [
        report(Figure(f"memory before {questions} questions", before, "MB")),
        report(Figure(f"memory grown over {questions} questions", grown, "MB", bar=0.5, gross=5.0)),
        report(Figure("questions, pipelined", questions / took, "1/s")),
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
    with served_bench() as (process, served):
        port = port_of(served, "rate_source")
        return [*memory(process.pid, port, questions), *many(port), *vanish(process.pid, port)]


if __name__ == "__main__":
    figures(int(sys.argv[1]) if len(sys.argv) > 1 else 10_000_000)
