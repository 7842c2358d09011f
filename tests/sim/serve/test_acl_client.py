"""A client that was written for real tables turns the served one.

It is made from what is known of a public one (AcutronicRobotics/acutrol, for an AC117 over TCP): lines that end in
CR LF, one reply to each, of which the first eight bytes are dropped; `OK` and nothing behind it is success.
"""

from __future__ import annotations

import socket
import struct
from contextlib import contextmanager
from typing import TYPE_CHECKING

import pytest
from msgspec import structs

from vcfbench.testing import ServedLab, serve_simulated, simulated

if TYPE_CHECKING:
    from collections.abc import Iterator

STARTING = [":utility:lockout on", ":interlock:open 1", ":interlock:reset 1", ":interlock:close 1"]
ENDING = [":mode:off 1", ":interlock:open 1"]


class Client:
    """One reply a command, whatever it is; no look at what the eight bytes say."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=30.0)

    def say(self, command: str) -> bytes:
        self.socket.sendall(command.encode() + b"\r\n")
        return self.socket.recv(1024)

    def ask(self, command: str) -> str:
        return self.say(command)[8:].decode()


@contextmanager
def connected(lab: ServedLab) -> Iterator[Client]:
    client = Client(int(lab.resource("rate_table").rpartition(":")[2]))
    try:
        yield client
    finally:
        client.socket.close()


@pytest.fixture(scope="module")
def lab() -> Iterator[ServedLab]:
    with serve_simulated(simulated(parameters="ideal", errors="none"), speed=20.0) as served:
        yield served


def wait(lab: ServedLab, seconds: float) -> None:
    lab.ask("pause")
    lab.ask("advance", seconds=seconds)
    lab.ask("resume")


def test_a_client_of_real_tables_turns_the_served_one(lab: ServedLab) -> None:
    with connected(lab) as client:
        for command in STARTING:
            assert client.ask(command) == "OK"
            wait(lab, 0.25)
        assert client.ask(":mode:rate 1") == "OK"
        assert client.ask(":demand:rate 1, 25.000") == "OK"
        wait(lab, 5.0)
        assert lab.ask("get", name="applied_rate_deg_s") == pytest.approx(25.0, abs=1e-3)
        assert float(client.ask(":read:rate 1")) == pytest.approx(25.0, abs=1e-2)
        assert 0.0 <= float(client.ask(":read:position 1")) < 360.0
        assert client.ask(":demand:rate 1, 00.000") == "OK"
        wait(lab, 5.0)
        for command in ENDING:
            assert client.ask(command) == "OK"
        assert lab.ask("get", name="applied_rate_deg_s") == pytest.approx(0.0, abs=1e-6)


def test_the_eight_bytes_are_error_code_and_length(lab: ServedLab) -> None:
    with connected(lab) as client:
        reply = client.say("*IDN?")
        assert struct.unpack("<II", reply[:8]) == (0, len(reply) - 8)
        assert struct.unpack("<II", client.say(":interlock:reset 2")[:8]) == (2, 0)


@pytest.mark.parametrize(("header", "layout"), [("u32be2", ">II"), ("none", "")])
def test_the_bench_file_says_otherwise(header: str, layout: str) -> None:
    bench = simulated(parameters="ideal", errors="none")
    bench = structs.replace(bench, rate_table=structs.replace(bench.rate_table, reply_header=header))
    with serve_simulated(bench) as served, connected(served) as client:
        reply = client.say("*IDN?")
        body = reply[struct.calcsize(layout) :].decode().strip()
        assert body == "Acutronic R&D USA,Acutrol3000,0,A8800-001-01.000-a"
