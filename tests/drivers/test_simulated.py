"""The drivers on simulated instruments, through PyVISA and pyserial like on real ones."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pytest
from simrack.instruments.agilent33220a import Agilent33220ATwin, GeneratorErrors
from simrack.instruments.dso7104b import Dso7104BTwin, ScopeErrors
from simrack.instruments.e3631a import E3631ATwin, SupplyErrors
from simrack.instruments.hp34401a import Hp34401ATwin, MeterErrors
from simrack.rate_tables.acl import AclTable, TableErrors
from simrack.wires import serial_backend
from simrack.wires.visa_backend import SimVisaLibrary

from vcfbench.clock import Deadline, VirtualClock, sleep
from vcfbench.drivers.registry import open_instrument
from vcfbench.errors import DeadlineExceeded, InterlockError
from vcfbench.interfaces import Regulation
from vcfbench.sim.gyro.design import ideal_bench
from vcfbench.sim.world import World

if TYPE_CHECKING:
    from collections.abc import Iterator

    from simrack.device import Device

HANDLE = "driver-tests"


@pytest.fixture
def world() -> World:
    return World(VirtualClock(), ideal_bench(), 0)


class Plugs:
    """Opens a driver on a simulated instrument under any resource name."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.devices: dict[str, Device] = {}

    def open(self, role: str, model: str, resource: str, device: Device) -> Any:
        self.devices[resource] = device
        SimVisaLibrary.register(HANDLE, self.devices, self.world.clock)
        return open_instrument(
            role, model, resource, library=f"{HANDLE}@vcfbench", clock=self.world.clock, settings={"timeout_s": 5.0}
        )

    def table(self, device: Device, **settings: object) -> Any:
        serial_backend.register(HANDLE, device, self.world.clock)
        return open_instrument(
            "rate_table", "acl", f"sim://{HANDLE}", library="", clock=self.world.clock, settings=settings
        )


@pytest.fixture
def plugs(world: World) -> Iterator[Plugs]:
    made = Plugs(world)
    yield made
    if made.devices:
        SimVisaLibrary.unregister(HANDLE)


@pytest.mark.parametrize(("interface", "resource"), [("gpib", "GPIB0::5::INSTR"), ("rs232", "ASRL1::INSTR")])
def test_supply(plugs: Plugs, interface: str, resource: str) -> None:
    device = E3631ATwin(plugs.world, errors=SupplyErrors.none(), interface=interface)
    supply = plugs.open("power", "E3631A", resource, device)
    supply.configure_output("P25V", 10.0, 0.1)
    supply.configure_output("N25V", -10.0, 0.1)
    supply.enable_outputs()
    sleep(supply.clock, 2.0)
    assert supply.measure_voltage_v("P25V") == pytest.approx(10.0, abs=2e-3)
    assert supply.measure_voltage_v("N25V") == pytest.approx(-10.0, abs=2e-3)
    assert supply.measure_current_a("P25V") > 1e-3
    assert supply.regulation("P25V") is Regulation.CONSTANT_VOLTAGE
    assert plugs.world.value_v("rail_positive") == pytest.approx(10.0, abs=2e-3)
    assert supply.make_safe(Deadline.after(supply.clock, 20.0)).safe
    assert supply.regulation("P25V") is Regulation.OFF
    assert abs(plugs.world.value_v("rail_positive")) < 0.5
    supply.close()


def test_a_supply_in_current_limit_says_so(plugs: Plugs) -> None:
    supply = plugs.open("power", "E3631A", "GPIB0::5::INSTR", E3631ATwin(plugs.world, errors=SupplyErrors.none()))
    supply.configure_output("P25V", 10.0, 0.001)
    supply.enable_outputs()
    sleep(supply.clock, 2.0)
    assert supply.regulation("P25V") is Regulation.CONSTANT_CURRENT
    supply.close()


@pytest.mark.parametrize(
    ("interface", "resource"),
    [
        ("usb", "USB0::0x0957::0x0407::MY44000001::INSTR"),
        ("gpib", "GPIB0::10::INSTR"),
        ("lan", "TCPIP0::generator.lab::5025::SOCKET"),
        ("lan", "TCPIP0::generator.lab::inst0::INSTR"),
    ],
)
def test_generator(plugs: Plugs, interface: str, resource: str) -> None:
    device = Agilent33220ATwin(plugs.world, GeneratorErrors.none(), interface, node="v_vc")
    generator = plugs.open("rate_source", "33220A", resource, device)
    generator.configure_sine(1000.0, 2.0, 4.0)
    assert generator.configure_dc(-9.876) == pytest.approx(-9.876, abs=1e-3)
    for voltage_v in (5.0, -2.5, 0.1234, 0.0, 10.0, -10.0):
        assert generator.set_dc(voltage_v) == pytest.approx(voltage_v, abs=1e-3)
    generator.set_dc(2.5)
    generator.enable_output()
    sleep(generator.clock, 0.1)
    assert plugs.world.value_v("v_vc") == pytest.approx(2.5, rel=1e-2)
    assert generator.make_safe(Deadline.after(generator.clock, 5.0)).safe
    assert not generator.output_enabled()
    assert plugs.world.value_v("v_vc") == 0.0
    generator.close()


@pytest.mark.parametrize(("interface", "resource"), [("gpib", "GPIB0::22::INSTR"), ("rs232", "ASRL2::INSTR")])
def test_meter(plugs: Plugs, interface: str, resource: str) -> None:
    plugs.world.set_rail("positive", 10.0)
    device = Hp34401ATwin(plugs.world, node="rail_positive", errors=MeterErrors.none(), interface=interface)
    meter = plugs.open("multimeter", "34401A", resource, device)
    meter.configure_dc_voltage(10.0, 10.0)
    begin_s = meter.clock.now()
    assert meter.read_voltage_v() == pytest.approx(10.0, abs=1e-4)
    assert meter.clock.now() - begin_s == pytest.approx(meter.reading_time_s, abs=0.05)
    meter.configure_dc_voltage(100.0, 100.0)
    begin_s = meter.clock.now()
    meter.read_voltage_v()
    assert meter.clock.now() - begin_s == pytest.approx(4.0, abs=0.1)
    assert meter.make_safe(Deadline.after(meter.clock, 5.0)).safe
    meter.close()


def test_a_reading_that_outlasts_its_deadline_is_never_returned_later(plugs: Plugs) -> None:
    plugs.world.set_rail("positive", 10.0)
    device = Hp34401ATwin(plugs.world, node="rail_positive", errors=MeterErrors.none())
    meter = plugs.open("multimeter", "34401A", "GPIB0::22::INSTR", device)
    meter.configure_dc_voltage(10.0, 100.0)
    session = meter._session
    with pytest.raises(DeadlineExceeded):
        session.query("READ?", session.deadline(1.0))
    assert session.query("*IDN?").startswith("HEWLETT-PACKARD")
    meter.check_errors()
    meter.close()


def test_oscilloscope(plugs: Plugs) -> None:
    plugs.world.set_rail("positive", 10.0)
    plugs.world.set_rail("negative", -10.0)
    sleep(plugs.world.clock, 5.0)
    device = Dso7104BTwin(plugs.world, {1: "drive", 2: "carrier"}, ScopeErrors.none())
    scope = plugs.open("oscilloscope", "DSO7104B", "USB0::0x0957::0x175D::MY49000001::INSTR", device)
    scope.configure_channel(1, 1.0)
    scope.configure_channel(2, 1.0)
    scope.configure_timebase(200e-6)
    scope.configure_trigger(1)
    scope.acquire(1, 2)
    frequency_hz = scope.measure_frequency_hz(1)
    assert frequency_hz == pytest.approx(3488.9, rel=0.01)
    records = [scope.waveform(channel) for channel in (1, 2)]
    phasors = [np.mean(r.voltage_v * np.exp(-2j * np.pi * frequency_hz * r.time_s)) for r in records]
    phase_deg = float(np.degrees(np.angle(phasors[1] / phasors[0])))
    assert scope.measure_phase_deg(2, 1) == pytest.approx(phase_deg, abs=5.0)
    assert scope.measure_amplitude_v(1) == pytest.approx(float(np.ptp(records[0].voltage_v)) / 2.0, rel=0.05)
    assert scope.waveform(1, 10_000).time_s.shape == (10_000,)
    assert scope.make_safe(Deadline.after(scope.clock, 5.0)).safe
    scope.close()


@pytest.mark.parametrize("header", ["none", "u32le2", "u32be2"])
@pytest.mark.parametrize("configured", ["auto", "itself"])
def test_table(plugs: Plugs, header: Literal["none", "u32le2", "u32be2"], configured: str) -> None:
    device = AclTable(plugs.world, TableErrors.none(), header)
    settings = {"reply_header": "auto" if configured == "auto" else header}
    table = plugs.table(device, max_rate_deg_s=300.0, max_acceleration_deg_s2=200.0, **settings)
    table.enable()
    table.set_rate(-50.0, 100.0)
    assert not table.at_rate()
    sleep(table.clock, 2.0)
    assert table.at_rate()
    assert table.rate_deg_s() == pytest.approx(-50.0, abs=0.01)
    assert plugs.world.table.rate_deg_s() == pytest.approx(-50.0, abs=0.01)
    with pytest.raises(InterlockError):
        table.disable()
    assert table.make_safe(Deadline.after(table.clock, 20.0)).safe
    assert not plugs.world.table.servo_closed
    assert abs(plugs.world.table.rate_deg_s()) < 0.05
    table.check_errors()
    table.close()


def test_table_left_turning_is_refused_and_can_be_made_safe(plugs: Plugs) -> None:
    table = plugs.table(AclTable(plugs.world, TableErrors.none(), "none"), max_acceleration_deg_s2=200.0)
    table.enable()
    table.set_rate(100.0, 200.0)
    sleep(table.clock, 2.0)
    table.line.close()  # the program died
    other: Any = open_instrument(
        "rate_table",
        "acl",
        f"sim://{HANDLE}",
        library="",
        clock=plugs.world.clock,
        settings={"max_acceleration_deg_s2": 200.0},
    )
    with pytest.raises(InterlockError, match="found turning at 100"):
        other.enable()
    assert other.make_safe(Deadline.after(other.clock, 20.0)).safe
    assert abs(plugs.world.table.rate_deg_s()) < 0.05
    other.close()
