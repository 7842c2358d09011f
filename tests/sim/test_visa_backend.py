"""The PyVISA backend: names, time-outs in bench time, terminators, polls, locks, several benches at once."""

from __future__ import annotations

import gc
import threading
from typing import TYPE_CHECKING, NamedTuple

import pytest
import pyvisa
from pyvisa import constants
from pyvisa.constants import AccessModes, StatusCode
from simrack.instruments.e3631a import E3631ATwin, SupplyErrors
from simrack.instruments.hp34401a import Hp34401ATwin, MeterErrors
from simrack.wires.visa_backend import SimVisaLibrary
from simrack_tests.instruments.fake_world import FakeWorld

from pyvisa_vcfbench import WRAPPER_CLASS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from pyvisa.resources import MessageBasedResource

GPIB = "GPIB0::22::INSTR"
USB = "USB0::0x0957::0x0407::MY44008868::0::INSTR"
VXI = "TCPIP0::192.0.2.7::inst0::INSTR"
SOCKET = "TCPIP0::192.0.2.7::5025::SOCKET"
SERIAL = "ASRL3::INSTR"
NAMES = (GPIB, USB, VXI, SOCKET, SERIAL)


class Station(NamedTuple):
    world: FakeWorld
    manager: pyvisa.ResourceManager
    meter: Hp34401ATwin

    def open(self, name: str = GPIB, **settings: object) -> MessageBasedResource:
        return self.manager.open_resource(name, **settings)  # type: ignore[return-value]


def build(handle: str) -> Station:
    world = FakeWorld()
    errors = MeterErrors.none()
    meters = {
        name: Hp34401ATwin(world, errors=errors, interface="rs232" if name in (SOCKET, SERIAL) else "gpib")  # type: ignore[arg-type]
        for name in NAMES
    }
    SimVisaLibrary.register(handle, meters, world.clock)
    return Station(world, pyvisa.ResourceManager(f"{handle}@vcfbench"), meters[GPIB])


@pytest.fixture
def station() -> Iterator[Station]:
    gc.freeze()  # only what the test makes is to be collected: going through all the rest takes a quarter of a second
    built = build("station")
    yield built
    built.manager.close()
    SimVisaLibrary.unregister("station")
    gc.collect()
    gc.unfreeze()


def test_list_resources(station: Station) -> None:
    assert station.manager.list_resources() == (GPIB, USB, VXI, SERIAL)
    assert station.manager.list_resources("?*") == NAMES
    assert station.manager.list_resources("GPIB?*") == (GPIB,)


@pytest.mark.parametrize("name", ["GPIB0::22::INSTR", "GPIB::22", "gpib0::22", USB, VXI, "TCPIP::192.0.2.7"])
def test_names_as_people_write_them(station: Station, name: str) -> None:
    assert station.open(name).query("*IDN?").strip().startswith("HEWLETT-PACKARD,34401A")


@pytest.mark.parametrize(
    ("name", "status"),
    [("GPIB0::23::INSTR", StatusCode.error_resource_not_found), ("FOO0::1", StatusCode.error_invalid_resource_name)],
)
def test_names_nobody_has(station: Station, name: str, status: StatusCode) -> None:
    with pytest.raises(pyvisa.VisaIOError) as caught:
        station.manager.open_bare_resource(name)
    assert caught.value.error_code == status


@pytest.mark.parametrize("name", [GPIB, USB, VXI])
def test_a_message_ends_with_end(station: Station, name: str) -> None:
    assert station.open(name).query("*OPC?") == "1\n"
    assert station.open(name, read_termination="\n").query("*OPC?") == "1"
    assert station.open(name, write_termination="").query("*OPC?") == "1\n"


def test_serial_ends_at_line_feed_by_itself(station: Station) -> None:
    assert station.open(SERIAL).query("*OPC?") == "1\r\n"
    assert station.open(SERIAL, baud_rate=9600, data_bits=8, read_termination="\r\n").query("*OPC?") == "1"


def test_a_socket_has_no_end(station: Station) -> None:
    meter = station.open(SOCKET)
    with pytest.raises(pyvisa.VisaIOError, match="TMO"):
        meter.query("*OPC?")
    meter.read_termination = "\n"
    assert meter.query("*OPC?") == "1\r"
    meter.write("*IDN?;")
    assert meter.read_bytes(7) == b"HEWLETT"


@pytest.mark.parametrize("timeout_ms", [10, 250, 5000])
def test_a_time_out_takes_bench_time(station: Station, timeout_ms: int) -> None:
    meter = station.open(timeout=timeout_ms)
    meter.write("TRIG:SOUR EXT;:READ?")
    before = station.world.clock.now()
    with pytest.raises(pyvisa.VisaIOError) as caught:
        meter.read()
    assert caught.value.error_code == StatusCode.error_timeout
    assert station.world.clock.now() - before == pytest.approx(timeout_ms / 1000)


def test_short_time_out_loses_reading(station: Station) -> None:
    meter = station.open(read_termination="\n", timeout=100)
    meter.write("READ?")
    with pytest.raises(pyvisa.VisaIOError, match="TMO"):
        meter.read()
    assert station.world.clock.now() == pytest.approx(0.1)
    meter.timeout = 5000
    assert meter.read() == "+1.25000000E+00"
    assert station.world.clock.now() == pytest.approx(0.4215)
    del meter.timeout
    assert meter.query("*OPC?") == "1"


def test_wait_for_reading_polls_each_device_once(station: Station, monkeypatch: pytest.MonkeyPatch) -> None:
    looked_in = []
    next_event_s = Hp34401ATwin.next_event_s
    monkeypatch.setattr(Hp34401ATwin, "next_event_s", lambda meter: looked_in.append(meter) or next_event_s(meter))
    meter = station.open(read_termination="\n")
    assert meter.query("READ?") == "+1.25000000E+00"
    assert len(looked_in) == len(NAMES)


def test_an_endless_time_out_with_nothing_under_way_ends(station: Station) -> None:
    meter = station.open()
    del meter.timeout
    with pytest.raises(pyvisa.VisaIOError, match="TMO"):
        meter.read()


def test_reading_in_chunks_and_at_characters(station: Station) -> None:
    meter = station.open()
    meter.chunk_size = 5
    assert meter.query("*IDN?") == "HEWLETT-PACKARD,34401A,0,11-5-2\n"
    meter.read_termination = ","
    meter.write("*IDN?")
    assert [meter.read(), meter.read()] == ["HEWLETT-PACKARD", "34401A"]


def test_polls_triggers_clear(station: Station) -> None:
    meter = station.open(read_termination="\n")
    meter.write("*CLS;*ESE 32;*SRE 32;:FOO")
    assert meter.read_stb() == 96
    assert meter.read_stb() == 32
    meter.write("*CLS;:TRIG:SOUR BUS;:INIT")
    meter.assert_trigger()
    assert meter.query("FETC?") == "+1.25000000E+00"
    meter.write("TRIG:SOUR EXT;:READ?")
    meter.clear()
    assert meter.query("*OPC?") == "1"


@pytest.mark.parametrize("name", [SOCKET, SERIAL])
def test_a_stream_cannot_be_polled(station: Station, name: str) -> None:
    meter = station.open(name, read_termination="\n")
    for call in (meter.read_stb, meter.assert_trigger):
        with pytest.raises(pyvisa.VisaIOError) as caught:
            call()
        assert caught.value.error_code == StatusCode.error_nonsupported_operation
    meter.write("*IDN?")
    meter.clear()
    assert meter.query("*OPC?").strip() == "1"


def test_service_request(station: Station) -> None:
    meter = station.open()
    meter.write("*CLS;*SRE 16;:READ?")
    meter.wait_for_srq(10000)  # type: ignore[attr-defined]
    assert station.world.clock.now() == pytest.approx(0.4215)
    assert meter.read() == "+1.25000000E+00\n"
    assert meter.wait_on_event(constants.EventType.service_request, 50, capture_timeout=True).timed_out


def test_attributes(station: Station) -> None:
    meter = station.open()
    assert (meter.resource_name, meter.resource_class, meter.interface_type) == (GPIB, "INSTR", 1)
    assert (meter.primary_address, meter.send_end, meter.timeout) == (22, True, 2000)  # type: ignore[attr-defined]
    serial = station.open(SERIAL)
    serial.baud_rate = 4800  # type: ignore[attr-defined]
    assert serial.baud_rate == 4800  # type: ignore[attr-defined]
    serial.write("*OPC?")
    assert serial.bytes_in_buffer == 3  # type: ignore[attr-defined]
    serial.flush(constants.BufferOperation.discard_read_buffer)
    assert serial.bytes_in_buffer == 0  # type: ignore[attr-defined]
    with pytest.raises(pyvisa.VisaIOError):
        meter.get_visa_attribute(constants.ResourceAttribute.asrl_baud_rate)
    with pytest.raises(pyvisa.VisaIOError):
        meter.set_visa_attribute(constants.ResourceAttribute.resource_name, "x")


def test_locks(station: Station) -> None:
    mine, other = station.open(), station.open()
    with mine.lock_context():
        mine.query("*OPC?")
        with pytest.raises(pyvisa.VisaIOError) as caught:
            other.query("*OPC?")
        assert caught.value.error_code == StatusCode.error_resource_locked
    assert other.query("*OPC?") == "1\n"


def test_shared_locks(station: Station) -> None:
    """Who takes part may talk, who does not may not; nobody gets an exclusive one meanwhile."""
    mine, ours, other = (station.open() for _ in range(3))
    assert mine.lock(requested_key="ours") == "ours"
    ours.lock(requested_key="ours")
    assert {each.lock_state for each in (mine, ours, other)} == {AccessModes.shared_lock}
    assert mine.query("*OPC?") == ours.query("*OPC?") == "1\n"
    for refused in (lambda: other.query("*OPC?"), other.lock_excl, mine.lock_excl):
        with pytest.raises(pyvisa.VisaIOError) as caught:
            refused()
        assert caught.value.error_code == StatusCode.error_resource_locked
    ours.close()
    mine.lock_excl()
    assert mine.lock_state == AccessModes.exclusive_lock
    mine.unlock()
    mine.unlock()
    assert other.lock_state == AccessModes.no_lock
    with pytest.raises(pyvisa.VisaIOError) as caught:
        mine.unlock()
    assert caught.value.error_code == StatusCode.error_session_not_locked


def test_benches_side_by_side(station: Station) -> None:
    second = build("second")
    try:
        second.world.offset_v = 2.5
        assert second.open().query("READ?") == "+2.50000000E+00\n"
        assert station.open().query("READ?") == "+1.25000000E+00\n"
        assert second.manager is not station.manager
        with pytest.raises(ValueError, match="registered already"):
            SimVisaLibrary.register("second", {}, second.world.clock)
    finally:
        second.manager.close()
        SimVisaLibrary.unregister("second")
        gc.collect()


@pytest.mark.exhaustive
def test_waiting_for_one_instrument_lets_the_others_live() -> None:
    world = FakeWorld()
    supply = E3631ATwin(world, errors=SupplyErrors.none())  # type: ignore[arg-type]
    meter = Hp34401ATwin(world, errors=MeterErrors.none())  # type: ignore[arg-type]
    SimVisaLibrary.register("both", {"GPIB0::5::INSTR": supply, GPIB: meter}, world.clock)
    manager = pyvisa.ResourceManager("both@vcfbench")
    try:
        manager.open_resource("GPIB0::5::INSTR").write("APPL P25V,10,1;:OUTP ON")  # type: ignore[attr-defined]
        manager.open_resource(GPIB).query("READ?")  # type: ignore[attr-defined]
        assert world.rail_v("positive") == 10.0
        assert world.rails[-1][0] < 0.2 < world.clock.now()
    finally:
        manager.close()
        SimVisaLibrary.unregister("both")
        gc.collect()


def test_threads(station: Station) -> None:
    """Two sessions to two devices of a bench, each its own answers."""
    wrong: list[str] = []

    def ask(name: str, query: str, expected: str) -> None:
        session = station.open(name)
        wrong.extend(reply for _ in range(300) if (reply := session.query(query)) != expected)

    threads = [
        threading.Thread(target=ask, args=(GPIB, "*OPC?", "1\n")),
        threading.Thread(target=ask, args=(USB, "SYST:VERS?", "1991.0\n")),
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []


def test_a_bench_nobody_registered_is_told_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(WRAPPER_CLASS, "_resolvers", [])
    with pytest.raises(OSError, match="no simulated bench 'nowhere' is registered"):
        pyvisa.ResourceManager("nowhere@vcfbench")
    gc.collect()


@pytest.mark.exhaustive
def test_a_resolver_makes_benches_on_demand(monkeypatch: pytest.MonkeyPatch) -> None:
    world = FakeWorld()
    asked: list[str] = []

    def resolve(path: str) -> tuple[dict[str, Hp34401ATwin], object]:
        asked.append(path)
        return {GPIB: Hp34401ATwin(world, errors=MeterErrors.none())}, world.clock  # type: ignore[arg-type]

    monkeypatch.setattr(WRAPPER_CLASS, "_resolvers", [resolve])
    for handle, path in (("@vcfbench", ""), ("my bench.toml@vcfbench", "my bench.toml")):
        manager = pyvisa.ResourceManager(handle)
        assert manager.open_resource(GPIB).query("*OPC?") == "1\n"  # type: ignore[attr-defined]
        manager.close()
        assert asked[-1] == path
    gc.collect()
