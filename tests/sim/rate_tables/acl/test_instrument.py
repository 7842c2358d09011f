from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.sim.rate_tables.ideal import IdealWorld, exchange
from vcfbench.clock import sleep
from vcfbench.sim.rate_tables.acl import AclTable, Header, TableErrors


class Host:
    """A person at a terminal."""

    def __init__(self, errors: TableErrors | None = None, header: Header = "none") -> None:
        self.world = IdealWorld()
        self.table = AclTable(self.world, errors or TableErrors.none(), header)

    def raw(self, text: str) -> bytes:
        return exchange(self.table, self.world.clock, text.encode() + b"\r\n")

    def ask(self, text: str) -> str:
        reply = self.raw(text)
        assert reply.endswith(b"\r\n"), reply
        return reply[:-2].decode()

    def wait(self, seconds: float) -> None:
        sleep(self.world.clock, seconds)

    def servo(self) -> None:
        assert self.ask(":Demand:Rate 1,0;:Mode:Rate 1") == "OK"
        assert self.ask(":Interlock:Close 1") == "OK"
        self.wait(0.25)
        assert self.ask(":Status:CSR? A1STATE,4") == "1"


@pytest.fixture
def host() -> Host:
    return Host()


@pytest.mark.parametrize(
    ("command", "reply"),
    [
        ("*IDN?", "Acutronic R&D USA,Acutrol3000,0,A8800-001-01.000-a"),
        (":Query:System?", "1,1"),
        (":Utility:Lockout ON", "OK"),
        (":Interlock? 1", "Open"),
        (":Mode? 1", "Off"),
        (":read:pos? 1;rate? 1;acc? 1", "0.00000;0.00000;0.00000"),
        (":Read:Position 1", "0.00000"),
        (":LIM:H P,1,180.0;L P,1,-180.0;R P,1,100.0;A P,1,2000.0", "OK"),
        (":Utility:Format?", "FLOAT"),
        ("*STB?", "0"),
        (":Status:MSG? QERROR", ""),
    ],
)
def test_golden_exchanges_after_power_on(host: Host, command: str, reply: str) -> None:
    if reply:
        assert host.ask(command) == reply
    else:
        assert host.ask(command) in {"", "OK"}


def test_limits_read_back_in_one_message_as_the_manual_shows(host: Host) -> None:
    host.ask(":LIM:H P,1,180.0;L P,1,-180.0;R P,1,100.0;A P,1,2000.0")
    assert host.ask(":LIM:H? P,1;L? P,1;R? P,1;A? P,1") == "180.00000;-180.00000;100.00000;2000.00000"


def test_a_rate_run_follows_the_trapezoid(host: Host) -> None:
    host.ask(":Limit:Acceleration R,1,50;Vtrip R,1,110")
    host.servo()
    start = host.world.clock.now()
    host.table.write(b":Demand:Rate 1,100\r\n")
    host.world.clock.sleep_until(start + 1.0)
    host.table.read(100)
    assert host.world.table.rate_deg_s() == pytest.approx(50.0, rel=1e-12)
    assert host.ask(":Status:CSR? A1DYN,9") == "0"
    assert host.ask(":Status:CSR? A1DYN,2") == "1"
    assert host.ask(":Read:Acc? 1") == "50.00000"
    host.world.clock.sleep_until(start + 3.0)
    assert host.ask(":Status:CSR? A1DYN,9") == "1"
    host.world.clock.sleep_until(start + 5.0)
    # 2 s of ramp cover 100 deg, 3 s at 100 deg/s another 300; the read-back wraps at 360
    host.table.write(b":Read:Pos? 1;Rate? 1\r\n")
    host.wait(0.2)
    assert host.table.read(100)[0] == b"40.00000;100.00000\r\n"


def test_an_exchange_takes_the_lines_time(host: Host) -> None:
    start = host.world.clock.now()
    host.ask(":read:pos? 1;rate? 1")
    assert host.world.clock.now() - start == pytest.approx(0.002 + (20 + 1 + 17) * 10 / 9600, rel=1e-9)


def test_selecting_a_mode_executes_the_stale_demand(host: Host) -> None:
    host.servo()
    host.ask(":Mode:Off 1;:Demand:Rate 1,77")
    host.wait(5.0)
    assert host.ask(":Read:Rate? 1") == "0.00000"
    host.ask(":Mode:Rate 1")
    host.wait(5.0)
    assert host.ask(":Read:Rate? 1") == "77.00000"


def test_closing_the_interlock_executes_the_stale_demand(host: Host) -> None:
    host.ask(":Mode:Rate 1;:Demand:Rate 1,30;:Interlock:Close 1")
    host.wait(0.3)
    host.ask(":Interlock? 1")
    host.wait(5.0)
    assert host.ask(":Read:Rate? 1") == "30.00000"


def test_mode_off_stops_and_keeps_the_servo(host: Host) -> None:
    host.servo()
    host.ask(":Demand:Rate 1,50")
    host.wait(2.0)
    host.ask(":Mode:Off 1;:Demand:Rate 1,90")
    host.wait(2.0)
    assert host.ask(":Read:Rate? 1;:Interlock? 1") == "0.00000;Close"


def test_interlock_open_stops_by_the_abort_profile_then_opens_the_servo(host: Host) -> None:
    host.servo()
    host.ask(":Limit:Acceleration Abort,1,200;:Demand:Rate 1,100")
    host.wait(2.0)
    host.ask(":Interlock:Open 1")
    start = host.world.clock.now()
    assert host.ask(":Status:CSR? A1STATE,4") == "1"
    host.world.clock.sleep_until(start + 0.49)
    assert host.ask(":Interlock? 1") == "Open"
    assert host.world.table.rate_deg_s() == 0.0
    assert host.ask(":Status:CSR? A1STATE,5;:Status:CSR? A1STATE,6") == "1;0"


def test_a_zero_acceleration_limit_inhibits_every_change_even_stopping(host: Host) -> None:
    host.servo()
    host.ask(":Demand:Rate 1,20")
    host.wait(2.0)
    host.ask(":Limit:Acceleration R,1,0;:Demand:Rate 1,0")
    host.wait(100.0)
    assert host.ask(":Read:Rate? 1") == "20.00000"
    host.ask(":Limit:Acceleration R,1,10")
    host.wait(3.0)
    assert host.ask(":Read:Rate? 1") == "0.00000"


def test_over_rate_trips_on_the_measured_rate_and_latches(host: Host) -> None:
    host.ask(":Limit:Vtrip R,1,60;Acceleration Abort,1,100")
    host.servo()
    host.ask(":Demand:Rate 1,80")
    host.wait(0.7)
    assert host.ask(":Interlock? 1") == "Fault"
    assert host.ask(":Status:CSR? A1SWFLT,1;:Status:CSR? SI,3") == "1;1"
    host.wait(2.0)
    assert host.ask(":Status:CSR? A1STATE,6;:Status:CSR? A1STATE,4") == "1;0"
    assert host.world.table.rate_deg_s() == 0.0
    assert host.ask("*STB?") == "67"
    assert host.ask("*STB?") == "0"
    host.ask(":Interlock:Close 1")
    host.wait(1.0)
    assert host.ask(":Interlock? 1") == "Fault"
    host.ask(":Interlock:Reset")
    assert host.ask(":Interlock? 1;:Status:CSR? A1SWFLT") == "Open;0"


def test_a_broken_interlock_drops_the_drive_at_once_and_the_table_coasts(host: Host) -> None:
    host.servo()
    host.ask(":Demand:Rate 1,100")
    host.wait(2.0)
    host.table.set_interlock(9, faulty=True)
    start = host.world.clock.now()
    host.table.set_interlock(9, faulty=False)
    assert host.ask(":Status:CSR? A1INTLK,9;:Status:CSR? A1STATE,7;:Interlock? 1") == "1;1;Fault"
    host.table.set_interlock(9, faulty=True)
    host.world.clock.sleep_until(start + 1.0)
    assert host.world.table.rate_deg_s() == pytest.approx(100.0 - host.world.table.friction_deg_s2)
    host.ask(":Interlock:Reset")
    assert host.ask(":Interlock? 1") == "Fault"
    host.table.set_interlock(9, faulty=False)
    assert host.ask(":Interlock? 1") == "Open"


def test_an_interlock_is_tested_only_while_servoed(host: Host) -> None:
    host.table.set_interlock(7, faulty=True)
    host.table.set_interlock(7, faulty=False)
    assert host.ask(":Interlock? 1") == "Open"


def test_it_keeps_turning_when_the_host_is_silent(host: Host) -> None:
    host.servo()
    host.ask(":Demand:Rate 1,100")
    host.wait(86400.0)
    assert host.world.table.rate_deg_s() == 100.0


def test_the_demand_is_held_to_the_rate_limit(host: Host) -> None:
    host.servo()
    host.ask(":Limit:Rate R,1,40;:Demand:Rate 1,-90")
    host.wait(2.0)
    assert host.ask(":Read:Rate? 1;:Status:CSR? A1DYN,5;:Demand:Rate? 1") == "-40.00000;1;-90.00000"


@pytest.mark.parametrize(
    "command",
    [
        ":Demand:Rate 2,10",
        ":Demand:Rate 1",
        ":Demand:Rate 1,ten",
        ":Demand:Rate 1,inf",
        ":Limit:Rate R,1,1000.1",
        ":Limit:Acceleration R,1,-1",
        ":Limit:Acceleration X,1,1",
        ":Limit:Vtrip R,1,1201",
        ":Read:Rate? ALL",
        ":Status:CSR? A1DYN,16",
        ":Status:CSR? NOPE",
        ":Mode 1,Abort",
    ],
)
def test_what_is_out_of_range_is_refused_and_changes_nothing(host: Host, command: str) -> None:
    before = host.ask(":Demand:Rate? 1;:Limit:Rate? R,1;Acceleration? R,1;Vtrip? R,1;:Mode? 1")
    assert host.ask(command) == ""
    assert host.ask(":Demand:Rate? 1;:Limit:Rate? R,1;Acceleration? R,1;Vtrip? R,1;:Mode? 1") == before
    assert host.ask(":Status:STB?") == "128"
    assert host.ask(":Status:MSG? QERROR").startswith("2,PARAMETER OUT OF RANGE,")


@pytest.mark.parametrize("command", ["*RST", "*WAI", "*TST?", "*OPC?", ":Interface:RS232?", ":Mode:Home 1", "garbage"])
def test_what_is_not_implemented_is_a_parsing_error(host: Host, command: str) -> None:
    host.ask(command)
    assert host.ask(":Status:MSG? QERROR").startswith("1,")
    assert host.ask(":Query:Error? 1") == "COMMAND PARSING ERROR"


def test_nothing_acts_until_remote_is_active(host: Host) -> None:
    host.table.remote_active = False
    assert host.ask(":Mode:Rate 1") == ""
    assert host.ask(":Mode? 1") == "Off"
    assert host.ask(":Status:MSG? QERROR") == "4,REMOTE NOT ACTIVE,Mode:Rate"


@pytest.mark.parametrize(("header", "order"), [("u32le2", "<II"), ("u32be2", ">II")])
def test_the_eight_byte_prefix(header: Header, order: str) -> None:
    host = Host(header=header)
    assert host.raw(":Mode:Off 1") == struct.pack(order, 0, 2) + b"OK"
    assert host.raw(":Mode? 1") == struct.pack(order, 0, 3) + b"Off"
    assert host.raw(":Demand:Rate 9,1") == struct.pack(order, 2, 0)


def test_an_over_long_message_is_lost(host: Host) -> None:
    host.servo()
    host.table.write(b":Demand:Rate 1,10;" + b" " * 32768 + b"\n")
    host.wait(60.0)
    assert host.table.read(100)[0] == b"\r\n"
    assert host.ask(":Demand:Rate? 1") == "0.00000"
    assert host.ask(":Status:MSG? QERROR") == "3,MESSAGE TOO LONG"


def test_binary_format_sends_scaled_integers(host: Host) -> None:
    host.ask(":Demand:Rate 1,-11250;:Utility:Format BINARY")
    assert host.raw(":Demand:Rate? 1") == b"#14\x00\x00\x00\x80\r\n"


def test_the_encoder_error_shows_in_position_and_rate() -> None:
    host = Host(
        TableErrors(encoder_error_deg=0.01, encoder_phase_deg=0.0, angle_resolution_deg=0, rate_resolution_deg_s=0)
    )
    host.servo()
    host.ask(":Demand:Rate 1,90")
    host.wait(2.0)
    true_angle = host.world.table.angle_deg()
    host.table.write(b":Read:Pos? 1;Rate? 1\n")
    host.wait(0.5)
    angle, rate = (float(text) for text in host.table.read(100)[0].split(b";"))
    assert angle == pytest.approx((true_angle + 0.01 * math.sin(math.radians(true_angle))) % 360, abs=5.1e-6)
    assert rate == pytest.approx(90 * (1 + math.radians(0.01) * math.cos(math.radians(true_angle))), abs=5.1e-6)


@given(st.binary(max_size=80))
def test_noise_on_the_line_never_moves_a_table_that_is_not_servoed(noise: bytes) -> None:
    host = Host()
    host.table.write(noise + b"\n")
    host.wait(1.0)
    host.table.read(65536)
    assert host.world.table.rate_deg_s() == 0.0
    host.table.clear()
    assert host.ask("*IDN?").startswith("Acutronic")
