"""A GPIB adapter with two instruments behind it, asked as its manual says, over a socket and a serial line."""

from __future__ import annotations

import re
import socket
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import pytest
import pyvisa
import serial
from simrack.clock import VirtualClock
from simrack.gpib_adapter import GpibAdapter
from simrack.plan import plan_of
from simrack.rack import Rack
from simrack.serve import Control, ControlError
from simrack.serve.raw import has_ptys

from simrack_tests.cells import few
from simrack_tests.test_rack import serving

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

IDENTITIES = {22: "HEWLETT-PACKARD,34401A,0,11-5-2\n", 5: "HEWLETT-PACKARD,E3631A,0,2.1-5.0-1.0\n"}
SLOW = "CONF:VOLT:DC 10\nVOLT:DC:NPLC 10\nREAD?\n"  # a reading of 0.42 s


class Host:
    """Who is connected to the adapter; each wait for an answer takes bench time."""

    def __init__(self) -> None:
        self.rack = Rack.build(VirtualClock(), plan_of(["34401A:gpib22", "E3631A:gpib5"]))
        adapter = self.rack.devices["gpib"]
        assert isinstance(adapter, GpibAdapter)
        self.adapter, self.clock = adapter, self.rack.world.clock

    def ask(self, said: str) -> str:
        self.adapter.write(said.encode("latin-1"))
        heard = b""
        while part := self.adapter.read(1 << 16)[0] or self._wait():
            heard += part
        return heard.decode("latin-1")

    def _wait(self) -> bytes:
        while (wake_s := self.adapter.wake_at()) is not None:
            self.clock.sleep_until(wake_s)
            if part := self.adapter.read(1 << 16)[0]:
                return part
        return b""

    def errors(self) -> str:
        return self.ask("++read_tmo_ms 500\nSYST:ERR?\n++read eoi\n").strip()


@pytest.fixture
def host() -> Host:
    return Host()


def test_each_instrument_answers_at_its_address(host: Host) -> None:
    for address, identity in IDENTITIES.items():
        assert host.ask(f"++addr {address}\n*IDN?\n++read eoi\n") == identity
    assert host.ask("++addr 9 96\n++addr\n*IDN?\n++read eoi\n") == "9 96\r\n"


@pytest.mark.parametrize(
    ("name", "values", "wrong"),
    [
        ("auto", ("1", "0"), "2"),
        ("eoi", ("0", "1"), "x"),
        ("eos", ("3", "0"), "4"),
        ("eot_char", ("255",), "256"),
        ("eot_enable", ("1",), "-1"),
        ("mode", ("0", "1"), "2"),
        ("read_tmo_ms", ("1", "3000"), "3001"),
        ("savecfg", ("0",), "2"),
    ],
)
def test_setting_out_of_range_changes_nothing(host: Host, name: str, values: tuple[str, ...], wrong: str) -> None:
    for value in values:
        assert host.ask(f"++{name} {value}\n++{name}\n") == f"{value}\r\n"
    assert host.ask(f"++{name} {wrong}\n++{name}\n") == f"Unrecognized command\r\n{values[-1]}\r\n"


@pytest.mark.parametrize("word", ["++frob", "++", "++read x", "++read 256", "++addr 31", "++addr 9 95"])
def test_an_unknown_word_is_told(host: Host, word: str) -> None:
    assert host.ask(f"{word}\r\n") == "Unrecognized command\r\n"


def test_read_times_out_after_last_character_and_resumes_later(host: Host) -> None:
    before = host.clock.now()
    assert host.ask(f"++addr 22\n{SLOW}++read_tmo_ms 50\n++read eoi\n") == ""
    assert host.clock.now() - before == pytest.approx(0.05)
    assert host.ask("++read_tmo_ms 3000\n++read eoi\n") == "+0.00000000E+00\n"
    assert 0.4 < host.clock.now() - before < 0.5


def test_read_without_eoi_ends_by_silence_or_at_its_character(host: Host) -> None:
    host.ask("++addr 22\n++read_tmo_ms 100\n")
    before = host.clock.now()
    assert host.ask("*IDN?\n++read\n") == IDENTITIES[22]
    assert host.clock.now() - before == pytest.approx(0.1)
    assert host.errors() == '-420,"Query UNTERMINATED"'  # it was made to talk beyond its END
    assert host.ask(f"*IDN?\n++read {ord(',')}\n") == "HEWLETT-PACKARD,"
    assert host.ask("++read eoi\n") == "34401A,0,11-5-2\n"
    assert host.errors() == '+0,"No error"'


def test_custom_character_marks_the_end_of_an_answer(host: Host) -> None:
    assert host.ask("++addr 5\n++eot_enable 1\n++eot_char 42\n*IDN?\n++read eoi\n") == f"{IDENTITIES[5]}*"
    assert host.ask("++ver\n").startswith("Prologix GPIB")


def test_each_query_is_read_back_and_each_command_is_not(host: Host) -> None:
    assert host.ask("++addr 22\n++read_tmo_ms 20\n++auto 1\n*IDN?\n") == IDENTITIES[22]
    assert host.ask("*CLS\n++auto 0\n") == ""
    assert host.errors() == '-420,"Query UNTERMINATED"'


def test_only_escaped_line_ends_reach_instrument(host: Host) -> None:
    assert host.ask('++addr 22\nDISP:TEXT "\x1b+\x1b+A"\r\n\r\nDISP:TEXT?\n++read eoi\n') == '"++A"\n'
    assert host.ask("\x1b++addr 5\n++addr\n") == "22\r\n"
    assert host.errors().startswith("-1")  # "++addr 5" was for the meter, as a command


def test_message_without_eoi_or_line_end_continues(host: Host) -> None:
    assert host.ask("++addr 22\n++read_tmo_ms 10\n++eos 3\n++eoi 0\n*ID\n++read eoi\n") == ""
    assert host.ask("++eoi 1\nN?\n++read eoi\n") == ""  # the read has ended the message, -420
    assert "-420" in host.errors()


def test_service_is_requested_on_one_line_and_found_by_polls(host: Host) -> None:
    assert host.ask("++addr 5\n*CLS;*ESE 32;*SRE 32\n++srq\n++spoll 22\n") == "0\r\n0\r\n"
    assert host.ask("WHAT\n++srq\n++spoll 22\n++spoll 5\n++srq\n") == "1\r\n0\r\n96\r\n0\r\n"


def test_clear_and_trigger_reach_the_instrument(host: Host) -> None:
    host.ask("++addr 22\nTRIG:SOUR BUS;:INIT\n++trg\n")
    assert host.ask("++read_tmo_ms 3000\nFETC?\n++read eoi\n") == "+0.00000000E+00\n"
    host.ask("READ?\n++clr\n++ifc\n++loc\n++llo\n")
    assert host.ask("*IDN?\n++read eoi\n") == IDENTITIES[22]
    assert host.ask("++rst\n") + host.ask("++read_tmo_ms\n") == "1200\r\n"


def test_replies_queue_behind_waiting_read_until_clear(host: Host) -> None:
    host.adapter.write(f"++addr 22\n{SLOW}++read eoi\n++addr 5\n*IDN?\n++read eoi\n".encode())
    assert host.adapter.read(99) == (b"", False)
    assert host.ask("") == f"+0.00000000E+00\n{IDENTITIES[5]}"
    host.adapter.write(b"++addr 22\nREAD?\n++read eoi\n++ver\n")
    host.adapter.clear()
    assert host.ask("++addr\n") == "22\r\n"


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["34401A:gpib22", "2000:gpib22"], "two instruments are at GPIB address 22"),
        (["34401A:gpib31"], "can be on tcp, vxi11, hislip, pty, or gpib0 to gpib30 alone, not on 'gpib31'"),
        (["34401A:gpib22+tcp"], "not on 'gpib22'"),
        (["Zaber:gpib3"], "can be on tcp, pty, not on 'gpib3'"),
        (["gpib=34401A:gpib3"], "'gpib' is the name of the GPIB adapter"),
    ],
)
def test_what_cannot_be_behind_an_adapter_is_refused(words: list[str], why: str) -> None:
    with pytest.raises(ValueError, match=re.escape(why)):
        plan_of(words)


def test_instruments_in_process_are_on_gpib_and_adapter() -> None:
    manager = pyvisa.ResourceManager("?speed=max&models=34401A:gpib22,E3631A:gpib5@simrack")
    assert manager.list_resources("?*") == ("GPIB0::22::INSTR", "GPIB0::5::INSTR", "TCPIP0::gpib::1234::SOCKET")
    adapter: Any = manager.open_resource("TCPIP0::gpib::1234::SOCKET", read_termination="\n")
    adapter.write("++addr 5")
    adapter.write("*IDN?")
    assert adapter.query("++read eoi") + "\n" == IDENTITIES[5]
    meter: Any = manager.open_resource("GPIB0::22::INSTR")
    assert meter.query("*IDN?") == IDENTITIES[22]
    manager.close()


def test_what_goes_wrong_on_the_wire_is_the_adapters() -> None:
    with serving("34401A:gpib22") as server, Control(server.control.port) as control:
        with pytest.raises(ControlError, match="34401A is behind an adapter; give the fault 'silent' to the adapter"):
            control.request("fault", instrument="34401A", kind="silent")
        control.request("fault", instrument="34401A", kind="overload")
        control.request("fault", instrument="gpib", kind="silent")


@pytest.fixture(scope="module")
def places() -> Iterator[dict[str, str]]:
    command = [sys.executable, "-m", "simrack", "serve", "34401A:gpib22", "E3631A:gpib5", "--speed", "max"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:  # noqa: S603
        assert server.stdout is not None
        printed = [server.stdout.readline().split() for _ in range(5)]
        assert printed[1] == ["34401A", "34401A", "++addr", "22", "of", "gpib"]
        yield {"tcp": printed[3][2], "pty": printed[3][3]}
        server.terminate()


def over_tcp(place: str) -> Callable[[bytes], bytes]:
    connection = socket.create_connection(("127.0.0.1", int(place.split("::")[2])), timeout=5)

    def ask(said: bytes) -> bytes:
        connection.sendall(said)
        return connection.recv(4096)

    return ask


def over_pty(place: str) -> Callable[[bytes], bytes]:
    port = serial.Serial(place.removeprefix("ASRL").removesuffix("::INSTR"), timeout=5)

    def ask(said: bytes) -> bytes:
        port.write(said)
        return bytes(port.readline())

    return ask


@pytest.mark.skipif(not has_ptys(), reason="needs pseudo-terminals")
@pytest.mark.parametrize("wire", few(["tcp", "pty"], "tcp"))
def test_it_is_served_on_a_socket_and_a_serial_line(places: dict[str, str], wire: str) -> None:
    ask = {"tcp": over_tcp, "pty": over_pty}[wire](places[wire])
    for address, identity in IDENTITIES.items():
        assert ask(f"++addr {address}\n*IDN?\n++read eoi\n".encode()) == identity.encode()
    assert ask(f"++addr 22\n++read_tmo_ms 3000\n{SLOW}++read eoi\n".encode()) == b"+0.00000000E+00\n"
    assert ask(b"++spoll 5\n") == b"0\r\n"
