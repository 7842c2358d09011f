from __future__ import annotations

import re
import socket
import struct
import sys
import threading
from contextlib import contextmanager
from types import SimpleNamespace
from typing import TYPE_CHECKING

import pytest
from serial.tools import list_ports

from vcfbench.bench.check import check_bench
from vcfbench.errors import BenchError
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.station import discovery
from vcfbench.station.discovery import DiscoveredInstrument, Discovery, SerialPort, discover, recognise, stanza
from vcfbench.station.file import embedded_text, template
from vcfbench.testing import serve_simulated

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

SUPPLY = "HEWLETT-PACKARD,E3631A,0,2.1-5.0-1.0"
GENERATOR = "Agilent Technologies,33220A,MY44008868,2.00-2.00-22-2"
METER = "HEWLETT-PACKARD,34401A,0,10-5-2"
SCOPE = "AGILENT TECHNOLOGIES,DSO7104B,MY49520121,06.00.0003"
TABLE = "Acutronic R&D USA,Acutrol3000,0,A8800-001-01.000-a"


@contextmanager
def server(reply: bytes) -> Iterator[int]:
    """Answer each connection's first bytes with `reply`; nothing when it is empty."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        stop = threading.Event()

        def serve() -> None:
            while not stop.is_set():
                try:
                    connection, _ = listener.accept()
                except OSError:
                    return
                with connection:
                    connection.settimeout(5)
                    if connection.recv(100) and reply:
                        connection.sendall(reply)
                    connection.recv(100)

        threading.Thread(target=serve, daemon=True).start()
        yield listener.getsockname()[1]
        stop.set()
        listener.shutdown(socket.SHUT_RDWR)


def tried(name: str, timeout_s: float = 1.0) -> DiscoveredInstrument:
    (found,) = discover("@vcfbench", [name], timeout_s=timeout_s).tried
    return found


def test_the_simulated_bench_is_recognised() -> None:
    found = discover("@vcfbench")
    assert sorted(each.model or "" for each in found.resources) == ["33220A", "34401A", "DSO7104B", "E3631A"]
    assert found.serial_ports == ()


@pytest.mark.parametrize(
    ("answer", "model"),
    [
        (SUPPLY, "E3631A"),
        (GENERATOR, "33220A"),
        ("KEYSIGHT TECHNOLOGIES,33220A,MY1,2", "33220A"),
        (METER, "34401A"),
        (SCOPE, "DSO7104B"),
        (TABLE, "acl"),
        ("ACME,33220A,0,1", None),
        ("HEWLETT-PACKARD,3458A,0,1", None),
        ("@01 0 OK IDLE -- 30222", "zaber"),
        ("@01 0 RJ IDLE -- BADCOMMAND", None),
        ("ESP301 Version 3.0.1 6/1/99", "esp"),
        ("ESPRESSO", None),
        ("", None),
    ],
)
def test_who_is_recognised(answer: str, model: str | None) -> None:
    assert recognise(answer) == model


def test_real_sockets_are_asked_by_name() -> None:
    with server(GENERATOR.encode() + b"\n") as port:
        found = tried(f"TCPIP::127.0.0.1::{port}::SOCKET")
    assert (found.answer, found.model, found.serial_number) == (GENERATOR, "33220A", "MY44008868")


@pytest.mark.parametrize(
    ("header", "end"),
    [
        (b"", b"\r\n"),
        (struct.pack("<II", 0, len(TABLE) + 2), b"\r\n"),
        (struct.pack(">II", 0, len(TABLE) + 2), b"\r\n"),
        (struct.pack("<II", 0, len(TABLE)), b""),
        (struct.pack(">II", 0, len(TABLE)), b""),
    ],
)
def test_tables_are_asked_by_name(header: bytes, end: bytes) -> None:
    with server(header + TABLE.encode() + end) as port:
        found = tried(f"socket://127.0.0.1:{port}")
    assert (found.answer, found.model) == (TABLE, "acl")


def test_who_does_not_answer_costs_a_bounded_time() -> None:
    with server(b"") as port:
        assert tried(f"TCPIP::127.0.0.1::{port}::SOCKET", timeout_s=0.1).problem == "no answer"
    with server(b"\xff\xfe\n") as port:
        assert "is not text" in str(tried(f"socket://127.0.0.1:{port}", timeout_s=0.1).problem)
    with socket.create_server(("127.0.0.1", 0)) as closing:
        port = closing.getsockname()[1]
    assert "no instrument answers" in str(tried(f"TCPIP::127.0.0.1::{port}::SOCKET").problem)
    assert "cannot be opened" in str(tried("/dev/no-such-port").problem)


def test_a_library_that_does_not_exist_is_an_error() -> None:
    with pytest.raises(BenchError, match="cannot be used"):
        discover("/no/such/libvisa.so")


def test_nothing_is_sent_to_serial_ports_unless_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def ask(name: str, *_: object) -> DiscoveredInstrument:
        asked.append(name)
        return DiscoveredInstrument(name, answer=SUPPLY, model="E3631A")

    names = ["GPIB0::5::INSTR", "ASRL/dev/ttyS0::INSTR", "PRLGX-ASRL::/dev/ttyS0::INTFC", "GPIB0::INTFC"]
    monkeypatch.setattr(discovery, "_listed", lambda _library: names)
    monkeypatch.setattr(list_ports, "comports", lambda: [SimpleNamespace(device="/dev/ttyS0", description="a port")])
    monkeypatch.setattr(discovery, "_ask", ask)
    monkeypatch.setattr(discovery, "_ask_port", ask)
    found = discover("@py")
    assert asked == ["GPIB0::5::INSTR"]
    assert found.serial_ports == (SerialPort("/dev/ttyS0", "a port", None),)
    probed = discover("@py", serial_probe=True)
    assert asked[1:] == ["GPIB0::5::INSTR", "/dev/ttyS0"]
    assert [each.resource for each in probed.answering()] == ["GPIB0::5::INSTR", "/dev/ttyS0"]


def everything() -> Discovery:
    resources = {
        "GPIB0::5::INSTR": SUPPLY,
        "USB0::1::INSTR": GENERATOR,
        "USB0::2::INSTR": GENERATOR,
        "USB0::3::INSTR": GENERATOR,
        "GPIB0::22::INSTR": METER,
        "USB0::4::INSTR": SCOPE,
        "GPIB0::7::INSTR": "ACME,KETTLE,0,1",
        "socket://table:9878": TABLE,
    }
    found = tuple(DiscoveredInstrument(name, answer, recognise(answer)) for name, answer in resources.items())
    return Discovery("/opt/libvisa.so", (*found, DiscoveredInstrument("GPIB0::9::INSTR", problem="no answer")), (), ())


def test_the_stanza_is_a_piece_of_a_bench_file() -> None:
    piece = stanza(everything())
    limits = embedded_text("paper").partition("[limits]")[2].partition("[procedure")[0]
    site = "" if "[site]" in limits else "\n[site]\nlatitude_deg = 0.0\n"
    bench = parse_bench(f'name = "found"\n{piece}\n[limits]{limits}{site}', "found")
    assert bench.visa_library == "/opt/libvisa.so"
    assert bench.power.resource == "GPIB0::5::INSTR"
    assert bench.vibration_source is not None
    assert bench.vibration_source.resource == "USB0::2::INSTR"
    assert bench.rate_table.resource == "socket://table:9878"
    assert "# another 33220A:" in piece
    assert "# not recognised: ACME,KETTLE,0,1" in piece
    assert '# serial_number = "MY49520121"' in piece


def test_a_second_multimeter_is_that_of_v_vc() -> None:
    names = ("GPIB0::22::INSTR", "GPIB0::23::INSTR", "GPIB0::24::INSTR")
    piece = stanza(
        Discovery("@py", tuple(DiscoveredInstrument(name, METER, recognise(METER)) for name in names), (), ())
    )
    bench = parse_bench(f'name = "found"\n{piece}\n[site]\nlatitude_deg = 0.0\n', "found")
    assert bench.multimeter is not None
    assert bench.multimeter.resource == names[0]
    assert bench.v_vc_meter is not None
    assert bench.v_vc_meter.resource == names[1]
    assert "# another 34401A:" in piece


@pytest.mark.parametrize(
    ("found", "lines"),
    [
        (
            DiscoveredInstrument("/dev/ttyUSB0", METER, "34401A", baud_rate=9600),
            ['resource = "ASRL/dev/ttyUSB0::INSTR"'],
        ),
        (
            DiscoveredInstrument("COM3", METER, "34401A", baud_rate=19_200),
            ['resource = "ASRL3::INSTR"', "serial.baud_rate = 19200"],
        ),
        (
            DiscoveredInstrument("socket://10.0.0.5:5025", METER, "34401A"),
            ['resource = "TCPIP0::10.0.0.5::5025::SOCKET"'],
        ),
        (DiscoveredInstrument("TCPIP0::10.0.0.5::9878::SOCKET", TABLE, "acl"), ['resource = "socket://10.0.0.5:9878"']),
        (
            DiscoveredInstrument("/dev/ttyS0", TABLE, "acl", baud_rate=115_200),
            ['resource = "/dev/ttyS0"', "baud_rate = 115200"],
        ),
        (DiscoveredInstrument("COM4", "ESP301 Version 3.0.1", "esp", baud_rate=19_200), ['resource = "COM4"']),
    ],
)
def test_the_stanza_names_what_the_driver_opens(found: DiscoveredInstrument, lines: list[str]) -> None:
    """Instruments are opened by VISA, tables by pyserial, however they were asked."""
    printed = stanza(Discovery("@py", (), (), (found,))).splitlines()
    assert printed[2 : 2 + len(lines)] == lines
    assert sum("baud_rate" in line for line in printed) == len(lines) - 1


@pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals")
@pytest.mark.parametrize(
    "wires",
    [
        pytest.param(("pty", "tcp", "pty", "tcp", "pty"), id="pty", marks=pytest.mark.exhaustive),
        pytest.param(("tcp", "vxi11", "tcp", "vxi11", "tcp"), id="tcp"),
    ],
)
def test_what_discover_prints_is_pasted_and_runs(
    wires: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Found on real wires, ports by their bare names; the template filled in so is a bench that can be opened."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setenv("VCFBENCH_LOCKS", str(tmp_path / "locks"))
    monkeypatch.setattr(list_ports, "comports", list)
    roles = ("power", "rate_source", "multimeter", "oscilloscope", "rate_table")
    with serve_simulated("ideal") as served:
        resources = [served.resource(role, wire) for role, wire in zip(roles, wires, strict=True)]
        tries = [name.removeprefix("ASRL").removesuffix("::INSTR") if "pts" in name else name for name in resources]
        printed = stanza(discover("@py", tries))
        rest = re.sub(r"(?ms)^\[(power|rate_source|multimeter|oscilloscope|rate_table)\].*?(?=^\[)", "", template())
        checked = check_bench(parse_bench(f"{rest}\n{printed}", "pasted"))
    assert checked.failure() is None, checked
    assert {each.role for each in checked.instruments} == set(roles)
