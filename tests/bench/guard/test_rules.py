"""What each guard lets through; the instruments' answers are from a table, as their manuals print them."""

from __future__ import annotations

import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from msgspec import structs

from vcfbench.bench.description import RailWiring
from vcfbench.bench.file import load_bench
from vcfbench.bench.guard import guard_of
from vcfbench.bench.guard.message import Unreadable
from vcfbench.bench.guard.table import reads_and_stops
from vcfbench.errors import LimitError

BENCH = load_bench("paper")  # 300 deg/s, 200 deg/s^2, 10 V, rails 9.5 ... 10.5 V, 0.2 A

SUPPLY = {
    "INST:SEL?": "P25V",
    "OUTP:TRAC?": "0",
    "OUTP?": "0",
    "APPL? P6V": '"0.000000,5.000000"',
    "APPL? P25V": '"10.000000,0.100000"',
    "APPL? N25V": '"-10.000000,0.100000"',
}
GENERATOR = {
    "FUNC?": "SIN",
    "VOLT:UNIT?": "VPP",
    "VOLT?": "+2.0000000000000E+00",
    "VOLT:OFFS?": "+1.0000000000000E+00",
    "OUTP:LOAD?": "+9.9000000000000E+37",
}
TABLE = {":Demand:Rate? 1": "0.00000", ":Limit:Acceleration? R,1": "100.0", ":Mode? 1": "Rate"}


def judge(role: str, message: str, answers: dict[str, str]) -> None:
    guard_of(role, BENCH).judge(message, answers.__getitem__)


def refused(role: str, message: str, answers: dict[str, str]) -> str:
    with pytest.raises(LimitError) as caught:
        judge(role, message, answers)
    assert caught.value.command == message
    assert str(caught.value).endswith("; nothing was sent")
    return caught.value.what


@pytest.mark.parametrize(
    "message",
    [
        "*IDN?",
        "VOLT 10",
        "SOUR:VOLT:LEV:IMM:AMPL 9.5 V",
        "VOLT 0",
        "VOLT MIN",
        "VOLT 10000 MV",
        "APPL N25V,-10.5,0.2",
        "APPL P25V,DEF",
        "APPL P6V",
        "APPL P6V,0,0.1",
        "INST N25V;:VOLT -10",
        "INST:NSEL 3;:VOLT -10;CURR 100MA",
        "CURR 0.2",
        "VOLT:TRIG 10",
        "OUTP ON",
        "OUTP OFF",
        "OUTP:TRAC ON;:VOLT 9.8",
        "*RST",
        "*RST;:APPL P25V,10,0.1;:OUTP 1",
        "DISP:TEXT 'VOLT 30;OUTP ON'",
        "SYST:BEEP;*CLS",
        "CAL:COUN?",
    ],
)
def test_supply_within_the_limits(message: str) -> None:
    judge("power", message, SUPPLY)


@pytest.mark.parametrize(
    ("message", "words"),
    [
        ("VOLT 11", "P25V 11 V is outside the bench's rail window of 9.5 to 10.5 V"),
        ("VOLT 9.4", "outside"),
        ("VOLT MAX", "P25V 25.75 V"),
        ("VOLT -10", "P25V -10 V"),
        ("volt:trig 11", "P25V 11 V"),
        ("APPL N25V,10", "N25V 10 V"),
        ("APPL N25V,MAX", "N25V -25.75 V"),
        ("APPL P6V,5", "P6V 5 V: the output feeds no rail"),
        ("INST P6V;:VOLT 1", "P6V 1 V: the output feeds no rail"),
        ("INST:NSEL 1;:VOLT 1", "P6V 1 V"),
        ("CURR 0.21", "P25V current limit 0.21 A is beyond the bench's limit of 0.2 A"),
        ("CURR DEF", "current limit 1 A"),
        ("CURR:TRIG MAX", "current limit 1.03 A"),
        ("APPL P25V,10,1", "current limit 1 A"),
        ("VOLT 10;VOLT 11", "P25V 11 V"),
        ("*IDN?;:VOLT 11", "P25V 11 V"),
        ("*RCL 1", "cannot be judged: *RCL is not known"),
        ("INIT", "INIT is not known"),
        ("*TRG", "*TRG is not known"),
        ("*TST?", "self-test"),
        ("CAL:VOLT 3", "CAL:VOLT is not known"),
        ("VOLT:LEV 10;OFFS 3", "VOLT:OFFS is not known"),
        ("VOLT", "VOLT takes 1 parameters"),
        ("VOLT UP", "'UP' cannot be judged"),
        ("OUTP MAYBE", "neither ON nor OFF"),
        ("INST:NSEL 4", "there is no output 4"),
        ("VOLTAG 30", "VOLTAG is not known"),
        ("DISP:TEXT a';:VOLT 30;'", "has a quotation mark inside a parameter"),
        ("VOLT 10\nVOLT 30", "only printable ASCII"),
    ],
)
def test_supply_beyond_the_limits(message: str, words: str) -> None:
    assert words in refused("power", message, SUPPLY)


def test_what_an_earlier_program_left_counts_when_the_outputs_go_on() -> None:
    left = {**SUPPLY, "APPL? P25V": '"15.000000,0.100000"'}
    assert "P25V 15 V" in refused("power", "OUTP ON", left)
    judge("power", "OUTP OFF", {**left, "OUTP?": "1"})
    judge("power", "VOLT 10;:OUTP ON", left)
    unlimited = {**SUPPLY, "APPL? N25V": '"-10.000000,1.000000"'}
    assert "N25V current limit 1 A" in refused("power", "OUTP ON", unlimited)
    assert "N25V current limit 1 A" in refused("power", "VOLT 10", {**unlimited, "OUTP?": "1"})
    assert "P6V 3 V" in refused("power", "OUTP ON", {**SUPPLY, "APPL? P6V": '"3.000000,1.000000"'})


def test_tracking_moves_the_twin() -> None:
    assert "P25V" in refused("power", "OUTP:TRAC ON", {**SUPPLY, "APPL? P25V": '"12.000000,0.1"'})
    judge("power", "OUTP:TRAC ON", SUPPLY)
    rails = RailWiring(positive="P25V", negative="P6V")
    other = structs.replace(BENCH, wiring=structs.replace(BENCH.wiring, rails=rails))
    with pytest.raises(LimitError, match="N25V -10 V: the output feeds no rail"):
        guard_of("power", other).judge("OUTP:TRAC ON", SUPPLY.__getitem__)


@given(st.floats(-30, 30), st.sampled_from(["P6V", "P25V", "N25V"]))
def test_no_spelling_of_a_voltage_gets_past(volts: float, output: str) -> None:
    allowed = volts == 0 or (output == "P25V" and 9.5 <= volts <= 10.5) or (output == "N25V" and -10.5 <= volts <= -9.5)
    for message in (f"APPL {output},{volts!r}", f"inst:sel {output};:sour:volt {volts!r} v"):
        if allowed:
            judge("power", message, SUPPLY)
        else:
            refused("power", message, SUPPLY)


@pytest.mark.parametrize(
    "message",
    [
        "APPL:SIN 3.5 KHZ, 2 VPP, 0 V",
        "APPL:DC DEF,DEF,5",
        "FUNC DC;:VOLT:OFFS -10",
        "VOLT 18",
        "VOLT MIN;:VOLT:OFFS 9.9",
        "VOLT:HIGH 10;LOW -10",
        "OUTP ON",
        "OUTP OFF",
        "OUTP:LOAD 50",
        "FREQ 3488.9;:FUNC SQU",
        "AM:DEPT 100;STAT ON",
        "BURS:NCYC 5;:TRIG:SOUR BUS;*TRG",
        "VOLT:UNIT VRMS",
        "*RST",
        "DATA VOLATILE,0,0.5,1",
        "FUNC:USER VOLATILE",
    ],
)
def test_generator_within_the_limits(message: str) -> None:
    judge("rate_source", message, GENERATOR)


@pytest.mark.parametrize(
    ("message", "words"),
    [
        ("VOLT 18.1", "peak voltage 10.05 V (open circuit) is beyond the bench's limit of 10 V"),
        ("VOLT:OFFS 9.1", "peak voltage 10.1 V"),
        ("VOLT:OFFS -10", "peak voltage 11 V"),
        ("VOLT:HIGH 10.1", "level 10.1 V"),
        ("VOLT:LOW -11;HIGH 1", "level 11 V"),
        ("VOLT MAX", "peak voltage 11 V"),
        ("APPL:SIN 1000,19,1", "peak voltage 10.5 V"),
        ("APPL:DC DEF,DEF,10.5", "peak voltage 10.5 V"),
        ("OUTP:LOAD 50;:VOLT:OFFS 5", "peak voltage 11 V"),
        ("OUTP:LOAD MIN;:VOLT:OFFS 1", "peak voltage"),
        ("VOLT 3 VRMS", "'3 VRMS' cannot be judged"),
        ("VOLT:UNIT VRMS;:VOLT 3", "send VOLT:UNIT VPP first"),
        ("AM:DEPT 120", "modulation depth 120 %"),
        ("*RCL 0", "*RCL is not known"),
        ("*TST?", "self-test"),
        ("FUNC TRIANGLE", "no function 'TRIANGLE'"),
        ("APPL:WHAT", "no function 'WHAT'"),
        ("MEM:STAT:REC:AUTO ON", "MEM:STAT:REC:AUTO is not known"),
    ],
)
def test_generator_beyond_the_limits(message: str, words: str) -> None:
    assert words in refused("rate_source", message, GENERATOR)


def test_the_load_that_the_generator_is_told_is_not_the_one_that_it_has() -> None:
    state = {**GENERATOR, "OUTP:LOAD?": "+5.0000000000000E+01", "FUNC?": "DC"}
    judge("rate_source", "VOLT:OFFS 5", state)
    assert "peak voltage 10.2 V" in refused("rate_source", "VOLT:OFFS 5.1", state)
    judge("rate_source", "OUTP:LOAD INF;:VOLT:OFFS 10", state)


def test_what_an_earlier_program_left_counts_when_the_output_goes_on() -> None:
    left = {**GENERATOR, "VOLT:OFFS?": "+9.5000000000000E+00"}
    assert "peak voltage 10.5 V" in refused("rate_source", "OUTP ON", left)
    assert "peak voltage 10.5 V" in refused("rate_source", "FUNC SQU", {**left, "FUNC?": "DC"})
    judge("rate_source", "OUTP ON", {**left, "FUNC?": "DC"})
    judge("rate_source", "OUTP OFF", {})


def test_amplitudes_that_are_not_in_vpp_are_not_judged() -> None:
    rms = {**GENERATOR, "VOLT:UNIT?": "VRMS"}
    for message in ("VOLT 1", "OUTP ON", "VOLT:HIGH 1", "APPL:SIN"):
        assert "send VOLT:UNIT VPP first" in refused("rate_source", message, rms)
    judge("rate_source", "VOLT:UNIT VPP", rms)
    judge("rate_source", "VOLT:OFFS 1", {**rms, "FUNC?": "DC"})


@given(st.floats(0, 20), st.floats(-10, 10), st.sampled_from(["INF", "50", "1", "600"]))
@example(0.0, 10.0, "INF")
@example(0.0, 9.99, "INF")
def test_no_way_to_a_peak_beyond_the_limit(vpp: float, offset: float, load: str) -> None:
    factor = 1.0 if load == "INF" else (float(load) + 50.0) / float(load)
    peak = factor * abs(offset) + max(factor * vpp, 0.02) / 2.0  # the generator's least amplitude, open circuit
    message = f"APPL:SIN 1E3,{vpp!r},{offset!r}"
    answers = {**GENERATOR, "OUTP:LOAD?": "9.9E37" if load == "INF" else load}
    if peak <= 10.0:
        judge("rate_source", message, answers)
    elif not math.isclose(peak, 10.0, rel_tol=1e-8):
        refused("rate_source", message, answers)


@pytest.mark.parametrize(
    ("message", "allowed"),
    [
        ("CONF:VOLT:DC 10;:READ?", True),
        ("FUNC 'VOLT:DC'", True),
        ("MEAS:VOLT:DC?", True),
        ("MEAS:RES?", False),
        ("CONF:FRES", False),
        ("MEASURE:DIODE?", False),
        ("CONF?", True),
        ('SENS:FUNC "FREQ"', True),
        ("RES:NPLC 10", True),
        ('FUNC "SENS:RES"', False),
        ("FUNC:ON 'RES'", False),
        ("MEAS:SCAL:RES?", False),
        ("FUNC RES'", False),
        ('SENS:FUNC "CONT"', False),
        ("L2", False),
        ("FUNC?", True),
        ("MEAS:CAP?", False),
        ("CONF:TEMP RTD", False),
        ("VOLT:DC:ZERO:AUTO ON;:VOLT:NULL ON", True),
        ("INIT;R? 3;:DATA:REM? 2,WAIT", True),
        ("*RCL 1", False),
        ("MMEM:LOAD:STAT 'RES'", False),
    ],
)
def test_the_meter_may_not_send_a_test_current(message: str, allowed: bool) -> None:  # noqa: FBT001
    if allowed:
        judge("multimeter", message, {})
    else:
        refused("multimeter", message, {})


def test_the_oscilloscope_may_be_told_anything() -> None:
    judge("oscilloscope", ":CHAN1:SCAL 5;\n\x00", {})


@pytest.mark.parametrize(
    "message",
    [
        "*IDN?",
        ":Demand:Rate 1,300",
        "demand:rate 1,-300",
        ":Limit:Acceleration R,1,200;:Demand:Rate 1,10",
        ":Limit:Rate R,1,300;Vtrip R,1,330",
        ":Mode:Rate 1",
        ":Mode:Off 1",
        ":Interlock:Close 1",
        ":Interlock:Open 1",
        ":Interlock:Reset",
        ":Read:Rate 1",
        ":D:R? 1",
        ":Utility:Lockout ON",
    ],
)
def test_table_within_the_limits(message: str) -> None:
    judge("rate_table", message, TABLE)


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (":Demand:Rate 1,300.1", "rate 300.1 deg/s is beyond the bench's limit of 300 deg/s"),
        (":Demand:Rate 1,-301", "rate -301 deg/s"),
        (":Demand:Rate 1,10;Rate 1,500", "rate 500 deg/s"),
        (":Demand:Rate 2,10", "axis 2 is not the bench's"),
        (":Demand:Rate ALL,10", "axis ALL"),
        (":D:R 1,10", "D:R is none of the commands that can be judged, written in full words"),
        (":Demand:Position 1,90", "DEMAND:POSITION is none"),
        (":Mode:Synthesis 1", "MODE:SYNTHESIS is none"),
        (":Limit:Acceleration R,1,201", "acceleration limit of the table 201 deg/s^2"),
        (":Limit:Acceleration R,1,0", "could not be stopped"),
        (":Limit:Jerk R,1,0", "could not be stopped"),
        (":Limit:Rate R,1,301", "rate limit 301 deg/s"),
        (":Limit:Vtrip R,1,331", "over-rate trip 331 deg/s"),
        (":Limit 1,R,10,10,10", "LIMIT is none"),
        (":Utility:Format BINARY", "UTILITY:FORMAT is none"),
        ("*RST", "*RST is none"),
        (":Demand:Rate 1", "takes 2 parameters"),
        (":Demand:Rate 1,fast", "'fast' cannot be judged"),
    ],
)
def test_table_beyond_the_limits(message: str, words: str) -> None:
    assert words in refused("rate_table", message, TABLE)


def test_a_stale_demand_counts_when_the_servo_is_to_be_closed() -> None:
    stale = {**TABLE, ":Demand:Rate? 1": "500.0"}
    for message in (":Interlock:Close 1", ":Mode:Rate 1"):
        assert "rate 500 deg/s" in refused("rate_table", message, stale)
    judge("rate_table", ":Demand:Rate 1,0;:Mode:Rate 1;:Interlock:Close 1", stale)


def test_the_acceleration_that_the_table_would_use_counts() -> None:
    fast = {**TABLE, ":Limit:Acceleration? R,1": "1000.0"}
    assert "acceleration limit of the table 1000 deg/s^2" in refused("rate_table", ":Demand:Rate 1,10", fast)
    judge("rate_table", ":Limit:Acceleration R,1,100;:Demand:Rate 1,10", fast)
    assert "1000" in refused("rate_table", ":Limit:Acceleration P,1,100;:Demand:Rate 1,10", fast)


def test_a_servo_is_not_closed_on_a_position() -> None:
    answers = {**TABLE, ":Mode? 1": "Position"}
    assert "mode POSITION, select rate mode first" in refused("rate_table", ":Interlock:Close 1", answers)
    judge("rate_table", ":Mode:Rate 1;:Interlock:Close 1", answers)


@pytest.mark.parametrize(
    ("name", "allowed", "forbidden"),
    [
        (
            "zaber",
            ["/1 get pos", "/stop", "/1 1 stop", "/"],
            ["/1 move vel 1000", "/1 home", "/1 set maxspeed 5", "/1 get pos\r/1 home"],
        ),
        ("esp", ["1TP?", "1ST", "VE?"], ["1PA90", "1MV+", "1MO"]),
        ("atl", ["STO", "PVE"], ["JOG60", "HOM"]),
        ("made-up", [], ["", "STO", "?"]),
    ],
)
def test_of_other_dialects_only_reading_and_stopping_is_understood(
    name: str, allowed: list[str], forbidden: list[str]
) -> None:
    rules = reads_and_stops(name)
    for message in allowed:
        rules.judge(message, str)
    for message in forbidden:
        with pytest.raises(Unreadable):
            rules.judge(message, str)
