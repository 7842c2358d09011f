"""The controller on its line: what comes back for what goes in."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.sim.rate_tables.acl.hosts import Host

if TYPE_CHECKING:
    from simrack.rate_tables.acl import Header


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


def test_without_a_line_an_exchange_takes_the_controllers_own_time(host: Host) -> None:
    start = host.world.clock.now()
    host.ask(":read:pos? 1;rate? 1")
    assert host.world.clock.now() - start == pytest.approx(0.002, rel=1e-9)


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


def test_it_keeps_turning_when_the_host_is_silent(host: Host) -> None:
    host.servo()
    host.ask(":Demand:Rate 1,100")
    host.wait(86400.0)
    assert host.world.table.rate_deg_s() == 100.0


@given(st.binary(max_size=80))
def test_line_noise_does_not_move_unservoed_table(noise: bytes) -> None:
    host = Host()
    host.table.write(noise + b"\n")
    host.wait(1.0)
    host.table.read(65536)
    assert host.world.table.rate_deg_s() == 0.0
    host.table.clear()
    assert host.ask("*IDN?").startswith("Acutronic")


@pytest.mark.parametrize(
    "commands",
    [
        [":utility:lockout on", ":interlock:open 1", ":interlock:reset 1", ":interlock:close 1", ":mode:off 1"],
        [":Interlock:Reset", ":int:close 1", ":mode 1,rate", ":dem:rate 1,5", ":mode 1,pos", ":dem:delta 1,5"],
        [":lim:acc synt,1,4200", ":lim:rate rate,1,1000", ":con:osc 1,Enable,2.0000,0.1000,Pos,Lin", ":int:open 1"],
        [":M:P 1 ", ":M:R 1 ", ":M:A 1 ", ":D:P 1, 5 ", ":D:R 1, 5 ", ":D:A 1, 5 "],
    ],
    ids=["AcutronicRobotics", "IEAv-EFO", "IEAv-EFO's settings", "williamsea"],
)
def test_what_public_clients_of_real_tables_send_is_taken(commands: list[str], host: Host) -> None:
    assert [host.ask(command) for command in commands] == ["OK"] * len(commands)


@pytest.mark.parametrize("axis", ["2", "x", "1,1"])
def test_an_axis_that_is_not_there_is_not_reset(axis: str, host: Host) -> None:
    assert host.ask(f":Interlock:Reset {axis}") == ""
    assert host.ask(":Status:MSG? QERROR").startswith("2,")
