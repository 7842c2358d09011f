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
        ("33522B", ["DATA:ARB two,0,1", "SYST:ERR?"], '-220,"Parameter error; too little data"'),
        ("33522B", ["DATA:ARB a,0,0,0,0,1,1,1,1", "DATA:ATTR:POIN? a;:SOUR1:DATA:ATTR:AVER? a"], "+8;+5.0"),
        ("33522B", ["DATA:ARB a,0,0,0,0,1,1,1,1", "DATA:VOL:FREE?"], "+999992"),
        ("33522B", ["AM:DSSC ON;:SOUR2:AM:DSSC?;:AM:DSSC?"], "0;1"),
        ("33522B", ["SWE:HTIM 1;RTIM 2;HTIM?;RTIM?"], "+1.000000000000000E+00;+2.0"),
        ("33522B", ["FUNC:NOIS:BAND 1E6;BAND?;BAND? MAX"], "+1.000000000000000E+06;+3.0"),
        *(("33522B", [f"{each}:SOUR CH2;SOUR?"], "CH2") for each in ("AM", "FM", "PM", "PWM")),
        ("33521B", ["AM:SOUR CH2", "SYST:ERR?"], "-224"),
        ("E36312A", ["FETC:VOLT? (@1);:FETC:CURR? (@1)"], "+0.0"),
        *((model, ["FORM REAL,64;FORM?;:READ?;:FORM ASC;:FORM?"], "REAL,64;#18") for model in ("34461A", "34465A")),
        ("34465A", ["FORM:DATA REAL,32;:MEAS:VOLT:DC?"], "#14"),
        ("34465A", ["FORM:DATA REAL;:SAMP:COUN 3;:INIT;*WAI;DATA:REM? 2,WAIT"], "#216"),
    ],
)
def test_words_of_drivers_are_known(model: str, messages: list[str], answer: str) -> None:
    rack = Rack.build(VirtualClock(), plan_of([model]))
    device = rack.devices[model]
    for message in messages:
        device.write(message.encode() + b"\n")
    rack.world.clock.sleep_until(60.0)
    assert device.read(100)[0].decode("latin-1").startswith(answer)


@pytest.mark.parametrize("channel", ["@1", "@2", "@3"])
@pytest.mark.parametrize(
    "messages",
    [
        ["VOLT 5,({0});:OUTP ON,({0})", "VOLT:PROT 4,({0})"],
        ["VOLT:PROT 4,({0})", "VOLT 5,({0})", "OUTP ON,({0})"],
        ["VOLT 5,({0})", "VOLT:PROT 4,({0})", "OUTP ON,({0})"],
        ["VOLT 3,({0});:OUTP ON,({0});:VOLT:PROT 4,({0})", "VOLT 5,({0})"],
        ["VOLT 5,({0});:VOLT:PROT:STAT OFF,({0});LEV 4,({0});:OUTP ON,({0})", "VOLT:PROT:STAT ON,({0})"],
        ["VOLT 5,({0});:CURR 0.1,({0});:CURR:PROT:STAT ON,({0});:OUTP ON,({0})"],
        ["VOLT 5,({0});:CURR 0.1,({0});:OUTP ON,({0})", "CURR:PROT:STAT ON,({0})"],
        ["VOLT 5,({0});:CURR 1,({0});:CURR:PROT:STAT ON,({0});:OUTP ON,({0})", "CURR 0.1,({0})"],
    ],
)
def test_protection_trips_in_any_order_and_until_it_is_cleared(channel: str, messages: list[str]) -> None:
    rack = Rack.build(VirtualClock(), plan_of(["E36312A"]))
    clock = rack.world.clock
    for rail in rack.world.rails:
        rack.world.set_load(rail, 10.0)
    supply, what = rack.devices["E36312A"], "CURR" if "CURR" in messages[0] else "VOLT"

    def said(message: str) -> str:
        supply.write(message.format(channel).encode() + b"\n")
        clock.sleep_until(clock.now() + 2.0)
        return supply.read(200)[0].decode().strip()

    for message in messages:
        said(message)
    assert said(f"OUTP? ({{0}});:{what}:PROT:TRIP? ({{0}});:OUTP ON,({{0}});:OUTP? ({{0}})") == "0;1;0"
    assert abs(float(said("MEAS:VOLT? ({0})"))) < 0.1
    said("VOLT 0.5,({0});:OUTP:PROT:CLE ({0});:OUTP ON,({0})")
    assert said(f"OUTP? ({{0}});:{what}:PROT:TRIP? ({{0}})") == "1;0"
