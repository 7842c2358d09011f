"""The line to a table over real ports: a pseudo-terminal and TCP."""

from __future__ import annotations

import os
import socket
import sys
import threading
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

import pytest
from simrack_tests.ports import BUSY_S, PLENTY_S

from tests.drivers.servers import lines
from vcfbench.clock import Deadline, WallClock
from vcfbench.drivers.rate_table.acl import AclDialect
from vcfbench.drivers.rate_table.dialect import TableSettings
from vcfbench.drivers.rate_table.driver import RateTableDriver
from vcfbench.drivers.rate_table.line import TableLine
from vcfbench.drivers.serial_wire import Link, serial_port
from vcfbench.errors import ConnectFailed, DeadlineExceeded, LinkLost

if TYPE_CHECKING:
    from collections.abc import Iterator

CLOCK = WallClock()
IDENTITY = "Acutronic R&D USA,Acutrol3000,0,A8800-001-01.000-a"
POSIX = pytest.mark.skipif(sys.platform == "win32", reason="this system has no pseudo-terminals")


def answer(line: str) -> str | None:
    known = {"*IDN?": IDENTITY, ":Status:STB?": "0", ":Read:Rate? 1": "1.25", ":Read:Position? 1": "90.5"}
    return known.get(line)


def opened(url: str, timeout_s: float) -> TableLine:
    connect = serial_port(url, Link(), CLOCK, timeout_s)
    return TableLine.opened(connect, name="rate_table", resource=url, clock=CLOCK, timeout_s=timeout_s)


def table(line: TableLine) -> RateTableDriver:
    return RateTableDriver(line, AclDialect(TableSettings()), TableSettings(100.0, 100.0))


@contextmanager
def pseudo_terminal() -> Iterator[tuple[int, str]]:
    import tty  # noqa: PLC0415 - POSIX only

    host, device = os.openpty()
    tty.setraw(device)
    try:
        yield host, os.ttyname(device)
    finally:
        for descriptor in (host, device):
            with suppress(OSError):
                os.close(descriptor)


def serve(host: int) -> None:
    received = b""
    with suppress(OSError):
        while data := os.read(host, 1024):
            *whole, received = (received + data).split(b"\n")
            for line in whole:
                if (reply := answer(line.decode())) is not None:
                    os.write(host, reply.encode() + b"\r\n")


@POSIX
def test_a_table_on_a_pseudo_terminal() -> None:
    with pseudo_terminal() as (host, name):
        thread = threading.Thread(target=serve, args=(host,), daemon=True)
        thread.start()
        driver = table(opened(name, PLENTY_S))
        assert driver.rate_deg_s() == 1.25
        assert driver.angle_deg() == 90.5
        assert driver.dialect.header == "none"  # type: ignore[attr-defined]
        driver.close()


@POSIX
def test_a_port_has_one_owner() -> None:
    with pseudo_terminal() as (_, name):
        first = opened(name, 0.2)
        with pytest.raises(ConnectFailed, match="rate_table at"):
            opened(name, PLENTY_S)
        first.close()


@POSIX
def test_a_silent_port_is_a_deadline() -> None:
    with pseudo_terminal() as (_, name):
        line = opened(name, PLENTY_S)
        begin_s = CLOCK.now()
        with pytest.raises(DeadlineExceeded):
            line.take_line(Deadline.after(CLOCK, 0.1))
        assert 0.1 <= CLOCK.now() - begin_s < 0.1 + BUSY_S
        line.close()


def test_a_table_over_tcp_that_hangs_up() -> None:
    server = socket.create_server(("127.0.0.1", 0))

    def run() -> None:
        connection, _ = server.accept()
        with connection:
            for line in lines(connection):
                if line == ":Read:Position? 1":
                    return
                if (reply := answer(line)) is not None:
                    connection.sendall(reply.encode() + b"\n")

    threading.Thread(target=run, daemon=True).start()
    url = f"socket://127.0.0.1:{server.getsockname()[1]}"
    driver = table(opened(url, PLENTY_S))
    assert driver.rate_deg_s() == 1.25
    with pytest.raises(LinkLost, match=r"rate_table at socket://.*Position"):
        driver.angle_deg()
    with pytest.raises(LinkLost, match="is closed"):
        driver.rate_deg_s()
    server.close()


def test_a_port_where_nobody_listens() -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with pytest.raises(ConnectFailed, match=f"rate_table at socket://127.0.0.1:{port}: cannot be opened"):
        opened(f"socket://127.0.0.1:{port}", 0.2)
