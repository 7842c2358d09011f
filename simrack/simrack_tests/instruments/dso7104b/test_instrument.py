from __future__ import annotations

import math
import re
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simrack.instruments.dso7104b import Dso7104BTwin, ScopeErrors

from simrack_tests.instruments.dso7104b.bench import Bench, F, errors_with, waveform


@pytest.fixture
def bench() -> Bench:
    bench = Bench()
    bench.send("CHAN1:RANG 4;:CHAN2:RANG 8;:CHAN3:RANG 4;:CHAN4:RANG 4;:TIM:RANG 1E-3")
    return bench


POWER_ON = {
    "*IDN?": "AGILENT TECHNOLOGIES,DSO7104B,MY49520121,06.00.0003",
    ":CHAN1:DISP?": "1",
    ":CHAN2:DISP?": "0",
    ":CHAN1:SCAL?": "+5.00000000E+000",
    ":CHAN1:OFFS?": "+0.00000000E+000",
    ":CHAN1:COUP?": "DC",
    ":CHAN1:IMP?": "ONEM",
    ":CHAN1:UNIT?": "VOLT",
    ":CHAN1:LAB?": '"1"',
    ":TIM:SCAL?": "+1.00000000E-004",
    ":TIM:POS?": "+0.00000000E+000",
    ":TIM:REF?": "CENT",
    ":TRIG:MODE?": "EDGE",
    ":TRIG:SOUR?": "CHAN1",
    ":TRIG:EDGE:SLOP?": "POS",
    ":TRIG:LEV?": "+0.00000000E+000",
    ":TRIG:SWE?": "AUTO",
    ":ACQ:TYPE?": "NORM",
    ":WAV:FORM?": "BYTE",
    ":WAV:POIN?": "+1000",
    ":WAV:POIN:MODE?": "NORM",
    ":WAV:UNS?": "1",
    ":WAV:BYT?": "MSBF",
    ":OPER:COND?": "+8",
    ":TER?": "+0",
    ":MEAS:SOUR?": "CHAN1,NONE",
    ":MEASure?": ":MEAS:SOUR CHAN1,NONE",
    ":ACQuire?": ":ACQ:MODE RTIM;TYPE NORM;COMP 100;COUN 8;SEGM:COUN 2",
    ":WAVeform?": ":WAV:UNS 1;VIEW MAIN;BYT MSBF;FORM BYTE;POIN +1000;SOUR CHAN1",
    ":TRIGger?": ":TRIG:MODE EDGE;SWE AUTO;NREJ 0;HFR 0;HOLD +60.0000000000000E-09;"
    ":TRIG:EDGE:SOUR CHAN1;LEV +0.00000E+00;SLOP POS;REJ OFF;COUP DC",
    "*OPT?": "0,0,0,0,MEMUP,0,0,0,0,0,0,0",
    "*TST?": "+0",
    ":CHANnel1?": ":CHAN1:RANG +40.0E+00;OFFS +0.00000E+00;COUP DC;IMP ONEM;DISP 1;BWL 0;INV 0;"
    'LAB "1";UNIT VOLT;PROB +1.0E+00;PROB:SKEW +0.00E+00;STYP SING',
    ":TIMebase?": ":TIM:MODE MAIN;REF CENT;MAIN:RANG +1.00E-03;POS +0.0E+00",
    ":SYST:ERR?": '+0,"No error"',
}


@pytest.mark.parametrize(("query", "reply"), POWER_ON.items())
def test_default_setup_to_the_character(query: str, reply: str) -> None:
    assert Bench().ask(query) == reply


def test_exponents_of_two_digits_are_a_matter_of_firmware() -> None:
    bench = Bench(errors_with(exponent_digits=2))
    bench.send(":TIM:RANG 200E-9;:CHAN3:RANG 8;OFFS 0.0125;:TRIG:SOUR CHAN3;:WAV:SOUR CHAN3;:DIG CHAN3")
    scaling = "+2.00000000E-10,-1.00000000E-07,+0,+3.12500000E-02,+1.25000000E-02,+128"
    assert bench.ask(":WAV:PRE?") == f"+0,+0,+1000,+1,{scaling}"
    assert bench.ask(":TIM:SCAL?;:MEAS:FREQ? CHAN3") == "+2.00000000E-08;+9.90000000E+37"
    assert bench.ask(":WAV:FORM ASC;POIN 100;DATA?").split(",")[1] == "+2.50049E-01"


def test_reset_brings_it_back(bench: Bench) -> None:
    bench.send(":STOP;:TRIG:SWE NORM;:WAV:FORM WORD;:CHAN3:DISP ON;*RST")
    assert {query: bench.ask(query) for query in POWER_ON if query != ":TER?"} == {
        query: reply for query, reply in POWER_ON.items() if query != ":TER?"
    }


def test_digitize_keeps_the_parser_busy_then_stops(bench: Bench) -> None:
    start = bench.clock.now()
    assert bench.ask(":DIG CHAN1,CHAN2;*OPC?") == "1"
    assert bench.clock.now() - start >= 1e-3
    assert bench.ask(":OPER:COND?") == "+0"
    assert (bench.ask(":TER?"), bench.ask(":TER?")) == ("+1", "+0")
    assert [bench.ask(f":CHAN{n}:DISP?") for n in (1, 2, 3, 4)] == ["1", "1", "0", "0"]


def test_digitize_without_a_trigger_holds_up_every_later_query(bench: Bench) -> None:
    bench.send(":TRIG:SWE NORM;:TRIG:LEV 3.0;:DIG CHAN1")
    with pytest.raises(TimeoutError):
        bench.raw(":WAV:POIN?", limit_s=0.5)
    bench.scope.clear()
    assert bench.ask(":WAV:POIN?") == "+1000"


def test_auto_sweep_triggers_without_a_signal(bench: Bench) -> None:
    bench.send(":TRIG:SOUR CHAN3;:TRIG:LEV 1")
    start = bench.clock.now()
    assert bench.ask(":DIG CHAN3;*OPC?") == "1"
    assert 0.02 <= bench.clock.now() - start < 0.03


def test_single_returns_at_once_and_status_shows_end(bench: Bench) -> None:
    bench.send(":SING")
    assert bench.ask("*OPC?") == "1"
    assert bench.ask(":AER?") == "+1"
    assert int(bench.ask(":OPER:COND?")) == 8 + 32
    assert bench.number(":MEAS:VPP?") == 9.9e37
    bench.clock.sleep_until(bench.clock.now() + 0.01)
    assert int(bench.ask(":OPER:COND?")) == 0
    assert bench.number(":MEAS:VPP?") == pytest.approx(3.0, abs=1e-3)


def test_a_triggered_wait_can_be_forced(bench: Bench) -> None:
    bench.send(":TRIG:SWE NORM;:TRIG:LEV 3.0;:DIG CHAN1")
    bench.send(":TRIG:FORC")
    assert bench.ask("*OPC?") == "1"


@pytest.mark.parametrize("slope", ["POS", "NEG"])
def test_the_trigger_is_at_time_zero(bench: Bench, slope: str) -> None:
    bench.send(f":TRIG:LEV 0.5;SLOP {slope};:WAV:FORM WORD;:DIG CHAN1")
    times, volts = waveform(bench)
    middle = int(np.argmin(abs(times)))
    assert volts[middle] == pytest.approx(0.5, abs=4 / 65536)
    assert (volts[middle + 1] > volts[middle]) == (slope == "POS")


def test_the_preamble_of_the_live_sample(bench: Bench) -> None:
    bench.send(":TIM:RANG 200E-9;:CHAN3:RANG 8;OFFS 0.0125;:TRIG:SOUR CHAN3;:WAV:SOUR CHAN3;:DIG CHAN3")
    assert (
        bench.ask(":WAV:PRE?")
        == "+0,+0,+1000,+1,+2.00000000E-010,-1.00000000E-007,+0,+3.12500000E-002,+1.25000000E-002,+128"
    )


def test_the_waveform_is_the_sine_within_half_a_code(bench: Bench) -> None:
    bench.send(":DIG CHAN1")
    times, volts = waveform(bench)
    phase = math.asin(-0.1 / 1.5)  # trigger: rising through 0 V
    wanted = 0.1 + 1.5 * np.sin(2 * np.pi * F * times + phase)
    assert abs(volts - wanted).max() <= 4 / 256 / 2 * 1.001
    bench.send(":WAV:FORM WORD")
    times, volts = waveform(bench)
    assert abs(volts - wanted).max() <= 4 / 65536 / 2 * 1.1


def test_formats_and_byte_orders_say_the_same(bench: Bench) -> None:
    bench.send(":DIG CHAN1;:WAV:FORM WORD")
    big = bench.raw(":WAV:DATA?")[10:-1]
    bench.send(":WAV:BYT LSBF")
    little = bench.raw(":WAV:DATA?")[10:-1]
    assert struct.unpack(">1000H", big) == struct.unpack("<1000H", little)
    bench.send(":WAV:UNS 0")
    signed = struct.unpack("<1000h", bench.raw(":WAV:DATA?")[10:-1])
    assert [code + 32768 for code in signed] == list(struct.unpack(">1000H", big))
    bench.send(":WAV:FORM ASC")
    text = bench.ask(":WAV:DATA?")
    assert int(text[2:10]) == len(text) - 10
    volts = [float(value) for value in text[10:].split(",")]
    assert volts == pytest.approx((np.array(signed)) * 4 / 65536, abs=1e-5)


@pytest.mark.parametrize(("form", "kind"), [("BYTE", ">i1"), ("WORD", ">i2")])
def test_signed_codes_count_from_preambles_reference(bench: Bench, form: str, kind: str) -> None:
    bench.send(f":CHAN1:OFFS 0.5;:DIG CHAN1;:WAV:FORM {form}")
    _, volts = waveform(bench)
    bench.send(":WAV:UNS 0")
    preamble = [float(field) for field in bench.ask(":WAV:PRE?").split(",")]
    codes = np.frombuffer(bench.raw(":WAV:DATA?")[10:-1], kind)
    assert bench.number(":WAV:YREF?") == preamble[9]
    assert (codes - preamble[9]) * preamble[7] + preamble[8] == pytest.approx(volts, abs=1e-9)


@pytest.mark.parametrize(("kind", "points"), [("NORM", 4_000_000), ("HRES", 4_000_000), ("AVER", 1000), ("PEAK", 1000)])
def test_memory_is_read_of_samples_only(bench: Bench, kind: str, points: int) -> None:
    bench.send(f":ACQ:TYPE {kind};:DIG CHAN1;:WAV:POIN:MODE RAW;:WAV:POIN 8000000")
    assert bench.number(":WAV:POIN?") == points
    assert float(bench.ask(":WAV:PRE?").split(",")[2]) == points


@pytest.mark.parametrize("subsystem", ["ACQuire", "WAVeform", "TRIGger", "TIMebase", "CHANnel2", "FUNCtion"])
def test_what_a_subsystem_tells_of_itself_can_be_sent_back(bench: Bench, subsystem: str) -> None:
    answer = bench.ask(f":{subsystem}?")
    bench.send(answer)
    assert bench.errors() == []
    assert bench.ask(f":{subsystem}?") == answer


def test_without_a_second_source_there_is_no_phase(bench: Bench) -> None:
    bench.send(":DIG CHAN1,CHAN2")
    assert bench.number(":MEAS:PHAS?") == 9.9e37
    bench.send(":MEAS:SOUR CHAN1,CHAN2")
    assert bench.number(":MEAS:PHAS?") == pytest.approx(40.0, abs=0.02)


def test_means_are_of_a_cycle_where_there_is_one(bench: Bench) -> None:
    bench.send(":DIG CHAN1,CHAN2")  # 3.49 periods on the screen
    for asked in ("", "AUTO", "CYCL"):
        assert bench.number(f":MEAS:VAV? {asked}") == pytest.approx(0.1, abs=1e-3)
    # the mean of 0.1 + 1.5 sin(wt - asin(1/15)) over 1 ms about the trigger
    assert bench.number(":MEAS:VAV? DISP") == pytest.approx(0.1 - 0.1 * np.sinc(F * 1e-3), abs=1e-4)
    bench.send(":TIM:RANG 200E-6;:DIG CHAN1")  # less than one
    assert bench.number(":MEAS:VRMS?") == bench.number(":MEAS:VRMS? DISP")
    assert bench.number(":MEAS:VRMS? CYCL") == 9.9e37


def test_burst_has_neither_top_nor_base(bench: Bench) -> None:
    bench.nodes["drive"] = lambda t: np.where(t % 0.01 < 3e-3, 0.5 * np.sin(2 * np.pi * 1000.0 * t), 0.0)
    bench.send(":CHAN1:RANG 2;:TRIG:LEV 0.1;:TIM:RANG 10E-3;:DIG CHAN1")
    assert bench.number(":MEAS:VAMP?") == pytest.approx(1.0, rel=0.02)
    assert bench.number(":MEAS:FREQ?") == pytest.approx(1000.0, rel=1e-3)


def test_noise_is_no_faster_than_the_samples_are() -> None:
    bench = Bench(errors_with(noise_div=0.1))
    bench.send(":CHAN3:RANG 4;:TRIG:SOUR CHAN3;:WAV:SOUR CHAN3;:WAV:FORM WORD;:TIM:RANG 50E-9;:DIG CHAN3")
    _, volts = waveform(bench)
    assert volts.std() == pytest.approx(0.05 * math.sqrt(2 / 3), rel=0.25)  # joined by straight lines
    # 200 samples behind 1000 points: a fifth of a sample apart they are nearly the same
    assert np.diff(volts).std() == pytest.approx(0.05 * math.sqrt(2) / 5, rel=0.15)


def test_two_specimens_have_noise_of_their_own() -> None:
    drawn = [ScopeErrors.drawn(np.random.default_rng(seed)).noise_seed for seed in (1, 1, 2)]
    volts = []
    for seed in drawn:
        bench = Bench(errors_with(noise_div=0.1, noise_seed=seed))
        bench.send(":CHAN3:RANG 4;:TRIG:SOUR CHAN3;:WAV:SOUR CHAN3;:WAV:FORM WORD;:DIG CHAN3")
        volts.append(waveform(bench)[1])
    assert volts[0].tolist() == volts[1].tolist()
    assert abs(np.corrcoef(volts[0], volts[2])[0, 1]) < 0.2


def test_codes_beyond_the_converter_are_1_and_255(bench: Bench) -> None:
    bench.send(":CHAN1:RANG 2;:DIG CHAN1")
    codes = np.frombuffer(bench.raw(":WAV:DATA?")[10:-1], "u1")
    assert {1, 255} <= set(codes.tolist())
    assert not {0} & set(codes.tolist())
    assert bench.number(":MEAS:VPP?") == 9.9e37


@pytest.mark.parametrize(
    ("asked", "got"),
    [
        (100, 100),
        (600, 500),
        (999, 500),
        (1000, 1000),
        (30_000, 20_000),
        (4_000_000, 4_000_000),
        (8_000_000, 4_000_000),
    ],
)
def test_points_are_listed_numbers(bench: Bench, asked: int, got: int) -> None:
    bench.send(":DIG CHAN1;:WAV:POIN:MODE RAW")
    bench.send(f":WAV:POIN {asked}")
    assert bench.number(":WAV:POIN?") == got  # 1 ms at 4 GSa/s are 4 million


def test_eight_million_points(bench: Bench) -> None:
    bench.send(":TIM:RANG 10E-3;:DIG CHAN1;:WAV:POIN:MODE RAW;:WAV:POIN 8000000")
    data = bench.raw(":WAV:DATA?")
    assert data[:10] == b"#808000000"
    assert len(data) == 8_000_011
    assert bench.ask(":ACQ:SRAT?") == "+8.00000000E+008"


def test_channels_of_one_pair_share_the_memory(bench: Bench) -> None:
    bench.send(":TIM:RANG 10E-3;:CHAN2:DISP ON")
    assert bench.ask(":ACQ:POIN?") == "+4000000"
    bench.send(":CHAN2:DISP OFF;:CHAN3:DISP ON")
    assert bench.ask(":ACQ:POIN?") == "+8000000"


def test_measurements_against_the_closed_form(bench: Bench) -> None:
    bench.send(":DIG CHAN1,CHAN2,CHAN3")
    for query, value, tolerance in (
        (":MEAS:FREQ? CHAN1", F, 1e-4),
        (":MEAS:PER? CHAN1", 1 / F, 1e-4),
        (":MEAS:COUN? CHAN1", 3488.9, 1e-4),
        (":MEAS:VPP? CHAN1", 3.0, 2e-4),
        (":MEAS:VMAX? CHAN1", 1.6, 2e-4),
        (":MEAS:VMIN? CHAN1", -1.4, 2e-4),
        (":MEAS:VAMP? CHAN1", 3.0, 2e-4),
        (":MEAS:VTOP? CHAN1", 1.6, 2e-4),
        (":MEAS:VBAS? CHAN1", -1.4, 2e-4),
        (":MEAS:VAV? CYCL,CHAN1", 0.1, 1e-3),
        (":MEAS:VRMS? CYCL,AC,CHAN1", 1.5 / math.sqrt(2), 1e-4),
        (":MEAS:VRMS? CYCL,DC,CHAN1", math.hypot(0.1, 1.5 / math.sqrt(2)), 1e-4),
        (":MEAS:DUTY? CHAN1", 50.0, 1e-3),
        (":MEAS:PWID? CHAN1", 0.5 / F, 1e-3),
        (":MEAS:NWID? CHAN1", 0.5 / F, 1e-3),
        (":MEAS:RIS? CHAN1", 2 * math.asin(0.8) / (2 * math.pi * F), 1e-3),
        (":MEAS:FALL? CHAN1", 2 * math.asin(0.8) / (2 * math.pi * F), 1e-3),
        (":MEAS:VMAX? CHAN3", 0.25, 1e-6),
        (":MEAS:VAV? CHAN3", 0.25, 1e-6),
        (":MEAS:VRAT? CHAN2,CHAN1", 20 * math.log10(2.0 / 1.5), 2e-2),
    ):
        assert bench.number(query) == pytest.approx(value, rel=tolerance), query
    assert abs(bench.number(":MEAS:TVAL? 0.1,+1,CHAN2")) < 1e-3
    assert bench.errors() == []


def test_phase_is_delay_over_period(bench: Bench) -> None:
    bench.send(":DIG CHAN1,CHAN2")
    # channel 2 lags channel 1 by 40 deg: its edges come later
    assert bench.number(":MEAS:PHAS? CHAN1,CHAN2") == pytest.approx(40.0, abs=0.02)
    assert bench.number(":MEAS:PHAS? CHAN2,CHAN1") == pytest.approx(-40.0, abs=0.02)
    assert bench.number(":MEAS:DEL? CHAN1,CHAN2") == pytest.approx(40 / 360 / F, rel=1e-3)


def test_pulse_measurements(bench: Bench) -> None:
    bench.send(":TIM:RANG 5E-3;:TRIG:SOUR CHAN4;:DIG CHAN4")
    assert bench.number(":MEAS:DUTY? CHAN4") == pytest.approx(30.0, rel=0.02)
    assert bench.number(":MEAS:VTOP? CHAN4") == pytest.approx(1.0, rel=1e-3)
    assert bench.number(":MEAS:OVER? CHAN4") == pytest.approx(0.0, abs=0.1)
    rising, falling = bench.number(":MEAS:TEDG? +1,CHAN4"), bench.number(":MEAS:TEDG? -1,CHAN4")
    assert (falling - rising) % 1e-3 == pytest.approx(0.3e-3, abs=1e-5)


@pytest.mark.parametrize(
    "query",
    [
        ":MEAS:FREQ? CHAN3",
        ":MEAS:PHAS? CHAN1,CHAN3",
        ":MEAS:RIS? CHAN3",
        ":MEAS:DUTY? CHAN3",
        ":MEAS:TEDG? +99,CHAN1",
        ":MEAS:VTIM? 1,CHAN1",
        ":MEAS:TVAL? 9,+1,CHAN1",
        ":MEAS:OVER? CHAN3",
    ],
)
def test_what_cannot_be_measured_is_9_9e37_and_no_error(bench: Bench, query: str) -> None:
    bench.send(":DIG CHAN1,CHAN3")
    assert bench.ask(query) == "+9.90000000E+037"
    assert bench.errors() == []


def test_less_than_a_period_on_the_screen_has_no_frequency(bench: Bench) -> None:
    bench.send(":TIM:RANG 200E-6;:DIG CHAN1")
    assert bench.number(":MEAS:FREQ? CHAN1") == 9.9e37


def test_measuring_while_running_takes_a_fresh_record(bench: Bench) -> None:
    before = bench.clock.now()
    assert bench.number(":MEAS:VPP? CHAN1") == pytest.approx(3.0, abs=1e-3)
    assert bench.clock.now() > before
    bench.nodes["drive"] = lambda t: np.sin(2 * np.pi * F * t)
    assert bench.number(":MEAS:VPP? CHAN1") == pytest.approx(2.0, abs=1e-3)


def test_stop_holds_the_record(bench: Bench) -> None:
    bench.send(":STOP")
    assert bench.number(":MEAS:VPP? CHAN1") == pytest.approx(3.0, abs=1e-3)
    held = bench.clock.now()
    bench.clock.sleep_until(held + 1.0)
    assert bench.number(":MEAS:VPP? CHAN1") == pytest.approx(3.0, abs=1e-3)
    assert bench.clock.now() == held + 1.0
    assert bench.ask(":OPER:COND?") == "+0"


def test_running_without_a_trigger_shows_nothing(bench: Bench) -> None:
    bench.send(":TRIG:SWE NORM;:TRIG:LEV 3")
    assert bench.number(":MEAS:FREQ? CHAN1") == 9.9e37
    bench.send(":WAV:DATA?")
    bench.clock.sleep_until(bench.clock.now() + 1.0)
    assert bench.scope.read(100)[0] == b""
    assert -230 in bench.errors()


def test_ac_coupling_invert_and_probe(bench: Bench) -> None:
    bench.send(":CHAN3:COUP AC;:TRIG:SOUR CHAN1;:DIG CHAN1,CHAN3")
    assert bench.number(":MEAS:VMAX? CHAN3") == pytest.approx(0.0, abs=1e-4)
    bench.send(":CHAN3:COUP DC;INV ON;PROB 10;:DIG CHAN3")
    assert bench.number(":CHAN3:RANG?") == 40.0
    assert bench.number(":MEAS:VMAX? CHAN3") == pytest.approx(-2.5, abs=1e-3)


def test_autoscale_finds_the_signals(bench: Bench) -> None:
    bench.send("*RST;:AUT")
    assert bench.ask("*OPC?") == "1"
    assert [bench.ask(f":CHAN{n}:DISP?") for n in (1, 2, 3, 4)] == ["1", "1", "0", "1"]
    assert bench.number(":TIM:RANG?") == pytest.approx(1e-3)
    assert bench.number(":MEAS:FREQ? CHAN1") == pytest.approx(F, rel=1e-3)


@pytest.mark.parametrize(
    ("command", "query", "value", "number"),
    [
        (":CHAN1:RANG 0.001", ":CHAN1:RANG?", 0.016, -222),
        (":CHAN1:SCAL 6", ":CHAN1:SCAL?", 5.0, -222),
        (":CHAN1:RANG 4;OFFS 80", ":CHAN1:OFFS?", 75.0, -222),
        (":TIM:SCAL 60", ":TIM:SCAL?", 50.0, -222),
        (":ACQ:COUN 1", ":ACQ:COUN?", 2, -222),
        (":TRIG:HOLD 1E-9", ":TRIG:HOLD?", 60e-9, -222),
    ],
)
def test_numbers_out_of_range_are_clipped(bench: Bench, command: str, query: str, value: float, number: int) -> None:
    bench.send(command)
    assert bench.number(query) == pytest.approx(value)
    assert bench.errors() == [number]


@pytest.mark.parametrize(
    ("command", "number"),
    [
        (":BOGUS", -113),
        (":CHAN5:RANG 1", -114),
        (":CHAN1:COUP GND", -224),
        (":CHAN1:LAB 3", -128),
        (":WAV:FORM", -109),
        (":RUN 1", -108),
        (":MEAS:DEF THR,10,50,90", -221),
        (":SYST:SET #10", -161),
    ],
)
def test_refusals(bench: Bench, command: str, number: int) -> None:
    bench.send(command)
    assert bench.errors() == [number]


def test_the_error_queue_is_thirty_deep(bench: Bench) -> None:
    for _ in range(40):
        bench.send(":BOGUS")
    errors = bench.errors()
    assert (len(errors), errors[-1]) == (30, -350)


def test_a_command_while_an_answer_is_unread_is_410(bench: Bench) -> None:
    bench.send(":TIM:RANG?")
    bench.send(":TIM:RANG?")
    bench.scope.read(100)
    assert bench.errors() == [-410]


def test_activity_is_a_bit_a_channel(bench: Bench) -> None:
    """Channels 1, 2 and 4 cross 0 V; channel 3 stays above it."""
    bench.ask(":DIG;*OPC?")
    edges, levels = map(int, bench.ask(":ACT?").split(","))
    assert edges == 0b1011
    assert levels & 0b0100
    bench.send(":TRIG:LEV 9,CHAN1;:TRIG:LEV 9,CHAN2;:TRIG:LEV 9,CHAN3;:TRIG:LEV 9,CHAN4")
    assert bench.ask(":ACT?") == "+0,+0"


def test_setups_go_round(bench: Bench) -> None:
    bench.send(":CHAN2:LAB 'SENSE';:TIM:RANG 2E-3;:MEAS:DEF THR,80,50,20;*SAV 3")
    setup = bench.raw(":SYST:SET?")[:-1]
    bench.send("*RST")
    bench.scope.write(b":SYST:SET " + setup + b"\n")
    assert (bench.ask(":CHAN2:LAB?"), bench.number(":TIM:RANG?")) == ('"SENSE"', 2e-3)
    bench.send("*RST;*RCL 3")
    assert bench.ask(":CHAN2:LAB?") == '"SENSE"'
    assert bench.errors() == []


def test_thresholds_change_the_rise_time(bench: Bench) -> None:
    bench.send(":DIG CHAN1;:MEAS:DEF THR,80,50,20")
    assert bench.number(":MEAS:RIS?") == pytest.approx(2 * math.asin(0.6) / (2 * math.pi * F), rel=1e-3)
    bench.send(":MEAS:DEF THR,STAN")
    assert bench.number(":MEAS:RIS?") == pytest.approx(2 * math.asin(0.8) / (2 * math.pi * F), rel=1e-3)


def test_peak_detect_alternates_minimum_and_maximum(bench: Bench) -> None:
    bench.send(":ACQ:TYPE PEAK;:TIM:RANG 0.1;:DIG CHAN1")
    _, volts = waveform(bench)
    assert bench.ask(":WAV:PRE?").split(",")[1] == "+1"
    assert (volts[0::2] <= volts[1::2]).all()


def test_averaging_takes_its_time_and_reduces_the_noise() -> None:
    spread = {}
    for kind in ("NORM", "AVER"):
        bench = Bench(errors_with(noise_div=0.1))
        bench.send(f":CHAN3:RANG 4;:ACQ:TYPE {kind};COUN 64;:TRIG:SOUR CHAN3;:WAV:SOUR CHAN3;:WAV:FORM WORD")
        start = bench.clock.now()
        bench.ask(":DIG CHAN3;*OPC?")
        spread[kind] = (float(waveform(bench)[1].std()), bench.clock.now() - start)
    assert spread["NORM"][0] == pytest.approx(0.05, rel=0.1)
    assert spread["NORM"][0] / spread["AVER"][0] == pytest.approx(8.0, rel=0.1)
    assert spread["AVER"][1] - spread["NORM"][1] == pytest.approx(63e-3, rel=0.01)


def test_gain_offset_and_time_base_errors_show() -> None:
    bench = Bench(errors_with(gain_error=(0.02, 0, 0, 0), offset_error_div=(0.1, 0, 0, 0), time_base_error=1e-2))
    bench.send(":CHAN1:RANG 8;:DIG CHAN1")
    assert bench.number(":MEAS:VPP?") == pytest.approx(3.0 * 1.02, rel=1e-3)
    assert bench.number(":MEAS:VAV? CYCL") == pytest.approx(0.1 * 1.02 + 0.1, rel=5e-3)
    assert bench.number(":MEAS:FREQ?") == pytest.approx(F / 1.01, rel=1e-4)


def test_skew_shows_as_phase() -> None:
    bench = Bench(errors_with(skew_s=(0.0, 1e-10, 0.0, 0.0)))
    bench.nodes["drive"] = lambda t: np.sin(2 * np.pi * 50e6 * t)
    bench.nodes["carrier"] = bench.nodes["drive"]
    bench.send(":CHAN1:RANG 4;:CHAN2:RANG 4;:TIM:RANG 100E-9;:DIG CHAN1,CHAN2")
    assert bench.number(":MEAS:PHAS? CHAN1,CHAN2") == pytest.approx(360 * 50e6 * 1e-10, rel=0.05)


@settings(max_examples=25)
@given(offset=st.floats(-1.5, 1.5), amplitude=st.floats(0.05, 0.4))
def test_an_eight_bit_converter_is_within_half_a_step(offset: float, amplitude: float) -> None:
    bench = Bench(errors_with(converter_bits=8))
    bench.nodes["drive"] = lambda t: offset + amplitude * np.sin(2 * np.pi * F * t)
    bench.send(f":CHAN1:RANG 4;:TRIG:LEV {offset!r};:WAV:FORM WORD;:DIG CHAN1")
    times, volts = waveform(bench)
    wanted = offset + amplitude * np.sin(2 * np.pi * F * times)
    assert abs(volts - wanted).max() <= 4 / 256 / 2 * 1.01
    assert np.allclose(np.round(volts * 64) / 64, volts, atol=1e-9)


def test_a_drawn_specimen_measures_within_its_data_sheet() -> None:
    bench = Bench(ScopeErrors.drawn(np.random.default_rng(3)))
    bench.send(":CHAN1:RANG 4;:DIG CHAN1")
    assert bench.number(":MEAS:VPP?") == pytest.approx(3.0, rel=0.06)
    assert bench.number(":MEAS:FREQ?") == pytest.approx(F, rel=0.02)


CLEARING = {"*ESR", "AER", "TER", "OPERegister[:EVENt]"}


def spellings(pattern: str) -> tuple[str, str]:
    """Return a header in its shortest and its longest spelling, suffixes as 1."""
    short = re.sub(r"\[[^\]]*\]", "", pattern)
    full = pattern.replace("[", "").replace("]", "")
    one = [re.sub(r"<\d-\d>", "1", text) for text in (short, full)]
    return re.sub(r"[a-z]", "", one[0]), one[1]


def test_every_query_answers_in_every_spelling_without_an_error() -> None:
    for command in Dso7104BTwin.table.commands:
        if not command.query or command.query_parameters:
            continue
        box = Bench()
        box.send(":DIG CHAN1")
        replies = {box.ask(f"{header}?") for header in spellings(command.pattern)}
        assert box.errors() == [], command.pattern
        assert len(replies) == 1 or command.pattern in CLEARING, command.pattern


def test_installed_measurements_give_results(bench: Bench) -> None:
    bench.send(":DIG CHAN1,CHAN2;:MEAS:VPP CHAN1;:MEAS:PHAS CHAN1,CHAN2;:MEAS:STAT CURR")
    vpp, phase = (float(value) for value in bench.ask(":MEAS:RES?").split(","))
    assert vpp == pytest.approx(3.0, rel=1e-3)
    assert phase == pytest.approx(40.0, abs=0.02)
    bench.send(":MEAS:STAT ON")
    assert bench.ask(":MEAS:RES?").startswith("VPP(1),+")
    bench.send(":MEAS:CLE")
    assert bench.ask(":MEAS:RES?") == ""


@pytest.mark.parametrize(
    ("setup", "before_v", "after_v"),
    [
        # 0.3 ms high, 0.7 ms low
        ("POL POS;QUAL GRE;GRE 0.2E-3", 1.0, -1.0),
        ("POL NEG;QUAL GRE;GRE 0.5E-3", -1.0, 1.0),
        ("POL NEG;QUAL RANG;RANG 0.8E-3,0.6E-3", -1.0, 1.0),
        ("POL POS;QUAL LESS;LESS 0.31E-3", 1.0, -1.0),
    ],
)
def test_glitch_trigger_is_at_end_of_matching_pulse(setup: str, before_v: float, after_v: float) -> None:
    bench = Bench()
    bench.send(f":CHAN4:SCAL 1;:TRIG:MODE GLIT;SWE NORM;:TRIG:GLIT:SOUR CHAN4;LEV 0;{setup}")
    bench.send(":TIM:RANG 4E-3;:WAV:SOUR CHAN4;:DIG CHAN4")
    assert float(bench.ask(":MEAS:VTIM? -20E-6,CHAN4")) == pytest.approx(before_v, abs=0.05)
    assert float(bench.ask(":MEAS:VTIM? 20E-6,CHAN4")) == pytest.approx(after_v, abs=0.05)
    assert bench.ask(":SYST:ERR?") == '+0,"No error"'


@pytest.mark.parametrize("setup", ["POL POS;QUAL LESS;LESS 0.2E-3", "POL POS;QUAL GRE;GRE 0.4E-3"])
def test_a_pulse_of_another_width_does_not_trigger(setup: str) -> None:
    bench = Bench()
    bench.send(f":CHAN4:SCAL 1;:TRIG:MODE GLIT;SWE NORM;:TRIG:GLIT:SOUR CHAN4;LEV 0;{setup}")
    bench.send(":TIM:RANG 4E-3;:SING")
    bench.clock.sleep_until(1.0)
    assert bench.ask(":TER?") == "+0"
