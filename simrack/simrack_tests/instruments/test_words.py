"""Words that drivers in public use send, and the models had not."""

from __future__ import annotations

import pytest
from simrack.clock import VirtualClock
from simrack.plan import plan_of
from simrack.rack import Rack


@pytest.mark.parametrize(
    ("model", "messages", "answer"),
    [
        ("34465A", ["SYST:COMM:LAN:DHCP?"], "1"),
        ("34465A", ['SYST:COMM:LAN:IPAD "10.0.0.7";IPAD?'], '"10.0.0.7"'),
        ("34465A", ["SYST:COMM:LAN:DNS2?"], '"0.0.0.0"'),
        ("34461A", ["TEST:ALL?"], "+0"),
        ("DMM6500", ["NOSUCH", "SYST:EVEN:COUN? ALL"], "1"),
        ("DMM6500", ["NOSUCH", "SYST:EVEN:COUN? WARN"], "0"),
        ("DMM6500", ['TRIG:LOAD "Empty"', "SYST:ERR:COUN?"], "0"),
        ("DMM6500", ['TRIG:LOAD "SimpleLoop", 2', 'TRIG:LOAD "Empty"', "INIT", "SYST:ERR?"], "-221"),
        ("DMM6500", ['TRIG:LOAD "SimpleLoop"', "SYST:ERR?"], "-109"),
        ("33522B", ["INIT2:CONT OFF", "INIT2:IMM", "SYST:ERR?"], "+0"),
        ("33522B", ["INIT", "SYST:ERR?"], "-213"),
    ],
)
def test_words_of_drivers_are_known(model: str, messages: list[str], answer: str) -> None:
    clock = VirtualClock()
    device = Rack.build(clock, plan_of([model])).devices[model]
    for message in messages:
        device.write(message.encode() + b"\n")
    clock.sleep_until(60.0)
    assert device.read(100)[0].decode().startswith(answer)
