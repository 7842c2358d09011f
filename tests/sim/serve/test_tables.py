"""Every simulated table on real wires, with the driver of its dialect; frames, and what comes unasked."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import pytest
import serial
from simrack.rate_tables.dd16 import Dd16Table, TableErrors
from simrack.rate_tables.ruya import RuyaTable
from simrack.serve import MAX_SPEED, Control, ServedClock
from simrack.serve.raw import Pty
from simrack_tests.cells import few
from simrack_tests.ports import eventually
from simrack_tests.rate_tables.ideal import IdealMotion
from simrack_tests.serve.lamp import Served, serving

from tests.drivers.rate_table import DIALECTS
from vcfbench.clock import Deadline, ScaledClock, sleep
from vcfbench.drivers.registry import open_instrument
from vcfbench.procedures.bench_file import load_bench
from vcfbench.station.file import embedded_text
from vcfbench.testing import serve_simulated

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

SPEED = 20.0
STEPS = 640000 / 360
WIRES = ["tcp", pytest.param("pty", marks=pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals"))]


@pytest.mark.parametrize("wire", few(WIRES, "tcp"))
@pytest.mark.parametrize("dialect", few(DIALECTS, every=4))
def test_a_rate_is_reached_and_the_table_made_safe(dialect: str, wire: str, tmp_path: Path) -> None:
    settings: dict[str, Any] = {"steps_per_deg": STEPS} if dialect == "zaber" else {}
    said = "".join(f"\n{key} = {value}" for key, value in settings.items())
    settings["timeout_s"] = 5.0 * SPEED  # of the wall: the machine may be busy
    file = tmp_path / "bench.toml"
    file.write_text(embedded_text("ideal").replace('dialect = "acl"', f'dialect = "{dialect}"{said}'), encoding="utf-8")
    clock = ScaledClock(SPEED)
    with serve_simulated(load_bench(file), speed=SPEED) as lab, lab.control() as control:
        resource = lab.resource("rate_table", wire)
        table: Any = open_instrument("rate_table", dialect, resource, library="", clock=clock, settings=settings)
        table.enable()
        table.set_rate(10.0, 50.0)
        within = Deadline.after(clock, 20.0 * SPEED)
        while control.request("get", name="applied_rate_deg_s") != pytest.approx(10.0, abs=0.05):
            assert not within.expired()
            sleep(clock, 0.2)
        report = table.make_safe(Deadline.after(clock, 20.0 * SPEED))
        assert report.safe, report
        assert control.request("get", name="applied_rate_deg_s") == pytest.approx(0.0, abs=1e-9)
        table.close()


CONNECT = bytes([0xDD, 0, 0x55, *bytes(12), 0xCE])
POSITION = bytes([0xDD, 1, 0x13, *bytes(12), 0x0F])


class StillWorld:
    def __init__(self, clock: ServedClock) -> None:
        self.clock = clock
        self.table = IdealMotion(clock)  # type: ignore[arg-type]  # any clock will do


@pytest.fixture
def frames() -> Iterator[Served]:
    clock = ServedClock(MAX_SPEED)
    with serving({"table": Dd16Table(StillWorld(clock), TableErrors.none())}, clock) as served:
        yield served


@pytest.fixture
def statuses() -> Iterator[Served]:
    clock = ServedClock(100.0)
    with serving({"table": RuyaTable(StillWorld(clock), TableErrors.none())}, clock) as served:
        yield served


def test_frame_ends_by_length() -> None:
    table = Dd16Table(StillWorld(ServedClock()), TableErrors.none())
    noise, damaged = b"\r\n", CONNECT[:15] + b"\0"
    received = (b"", CONNECT[:15], CONNECT, CONNECT + noise, noise + CONNECT, noise, damaged + CONNECT)
    assert [table.message_size(data) for data in received] == [0, 0, 16, 16, 2, 2, 1]


def test_the_frames_of_two_clients_do_not_mix(frames: Served) -> None:
    where = frames.resource("tcp", "table")
    with serial.serial_for_url(where, timeout=5.0) as first, serial.serial_for_url(where, timeout=5.0) as second:
        first.write(CONNECT[:7])
        second.write(b"\r\n\xdd" + CONNECT + POSITION)
        assert second.read(32)[::16] == b"\xdd\xdd"
        first.write(CONNECT[7:])
        assert first.read(16)[:3] == CONNECT[:3]


def test_a_status_comes_unasked_to_everybody(statuses: Served) -> None:
    wires = statuses.server.wires["table"]
    with (
        serial.serial_for_url(wires.tcp, timeout=5.0) as first,
        serial.serial_for_url(wires.tcp, timeout=5.0) as second,
    ):
        for port in (first, second):
            numbers = [int(port.read_until(b"\n")[4:6]) for _ in range(5)]
            assert numbers == list(range(numbers[0], numbers[0] + 5))


def test_a_paused_bench_answers_when_time_goes_on(frames: Served) -> None:
    """A table takes 5 ms of bench time for an answer: its client's patience ends first, and nothing is lost."""
    with (
        Control(frames.server.control.port) as control,
        serial.serial_for_url(frames.resource("tcp", "table"), timeout=0.2) as port,
    ):
        control.request("pause")
        port.write(CONNECT)
        assert port.read(16) == b""
        control.request("advance", seconds=0.004)
        assert port.read(16) == b""
        control.request("advance", seconds=0.001)
        assert port.read(16) == CONNECT
        port.timeout = 5.0
        port.write(CONNECT)
        control.request("resume")
        assert port.read(16) == CONNECT


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
def test_a_terminal_that_nobody_reads_does_not_fill_up(statuses: Served) -> None:
    terminal = next(client for client in statuses.server.instruments["table"].clients if isinstance(client, Pty))
    eventually(lambda: not terminal.listens)
    held = terminal._unread()
    with serial.serial_for_url(statuses.server.wires["table"].tcp, timeout=5.0) as other:
        assert all(other.read_until(b"\n").startswith(b"$1") for _ in range(20))
    assert terminal._unread() == held
    with serial.Serial(terminal.path, timeout=5.0) as port:
        assert port.read_until(b"\n").startswith(b"$1")
