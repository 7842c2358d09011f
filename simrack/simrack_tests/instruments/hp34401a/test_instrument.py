"""The simulated 34401A against the facts of its User's Guide."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from simrack.instruments.hp34401a import MeterErrors

from simrack_tests.instruments.hp34401a.bench import bench

RESET = {
    "*IDN?": "HEWLETT-PACKARD,34401A,0,11-5-2",
    "SYST:VERS?": "1991.0",
    "FUNC?": '"VOLT"',
    "CONF?": '"VOLT +1.00000000E+01,+1.00000000E-05"',
    "VOLT:RANG?": "+1.00000000E+01",
    "VOLT:RANG? MIN": "+1.00000000E-01",
    "VOLT:RANG? MAX": "+1.00000000E+03",
    "VOLT:RANG:AUTO?": "1",
    "VOLT:NPLC?": "+1.00000000E+01",
    "VOLT:NPLC? MIN": "+2.00000000E-02",
    "SENS:CURR:DC:NPLC? MAX": "+1.00000000E+02",
    "FREQ:APER?": "+1.00000000E-01",
    "ZERO:AUTO?": "1",
    "INP:IMP:AUTO?": "0",
    "ROUT:TERM?": "FRON",
    "CALC:FUNC?": "NULL",
    "CALC:STAT?": "0",
    "CALC:DBM:REF?": "+6.00000000E+02",
    "DATA:FEED?": '"CALC"',
    "DATA:POIN?": "+0",
    "TRIG:SOUR?": "IMM",
    "TRIG:DEL:AUTO?": "1",
    "TRIG:COUN?": "+1.00000000E+00",
    "SAMP:COUN?": "+1",
    "SAMP:COUN? MAX": "+50000",
    "DISP?": "1",
    "DISP:WIND:STAT?": "1",
    "SYST:BEEP:STAT?": "1",
    "STAT:QUES:ENAB?": "+0",
    "*TST?": "+0",
}


@pytest.mark.parametrize("query", RESET)
def test_replies_at_power_on_and_after_reset(query: str) -> None:
    talk = bench().talk
    assert talk.ask(query) == RESET[query]
    talk.write("CONF:FREQ;:SAMP:COUN 3;:TRIG:COUN INF;DEL 2;SOUR BUS;:ZERO:AUTO OFF;:DISP OFF;:VOLT:RANG 100;NPLC 1")
    talk.write("FREQ:APER 1;:INP:IMP:AUTO ON;:DATA:FEED RDG_STORE,'';:CALC:FUNC AVER")
    talk.write("*RST")
    assert talk.ask(query) == RESET[query]


@pytest.mark.parametrize(
    ("message", "numbers"),
    [
        ("CONF:VOLT#DC", [-101]),
        ("SAMP:COUN ,1", [-102]),
        ("TRIG:COUN,1", [-103]),
        ("TRIG:SOUR,BUS", [-103]),
        ("CONF:FREQ 1000 0.1", [-103]),
        ("DISP:TEXT 5.0", [-104]),
        ("READ? 10", [-108]),
        ("SAMP:COUN", [-109]),
        ("CONFIGURATION:VOLT:DC", [-112]),
        ("TRIGG:COUN 3", [-113]),
        ("*ESE #B01010102", [-121]),
        ("TRIG:DEL 0.5 SECS", [-131]),
        ("SAMP:COUN 1 SEC", [-138]),
        ("DISP:TEXT ON", [-148]),
        ("DISP:TEXT 'ON", [-151]),
        ("CALC:STAT 'ON'", [-158]),
        ("TRIG:DEL 'zero'", [-158]),
        ("*TRG", [-211]),
        ("TRIG:SOUR BUS;:READ?", [-214]),
        ("CONF:VOLT:DC DEF,0.1", [-221]),
        ("CONF:VOLT:DC 2000", [-222]),
        ("VOLT:RANG 1001", [-222]),
        ("TRIG:COUN 0", [-222]),
        ("SAMP:COUN 50001", [-222]),
        ("TRIG:DEL 3601", [-222]),
        ("FUNC 'VOLTS'", [-224]),
        ("CONF:VOLT:DC AUTO", [-224]),
        ("FETC?", [-230]),
        ("SAMP:COUN 513;:INIT", [531]),
        ("TRIG:COUN 100;:SAMP:COUN 10;:INIT", [531]),
        ("TRIG:COUN INF;:INIT", [531]),
        ("CONF:VOLT:DC 10,1e-9", [532]),
        ("SYST:REM", [514]),
        ("*SAV 1", [-113]),
        ("*RCL 1", [-113]),
        ("ABOR", [-113]),
        ("STAT:QUES:COND?", [-113]),
        ("CAL:STR 'x'", [702]),
        ("CAL:SEC:STAT OFF,WRONG", [703]),
        ("FUNC 'RES';:CALC:FUNC DB;STAT ON", [-221]),
        ("CALC:NULL:OFFS 1", [-221]),
        ("CALC:FUNC DBM;STAT ON;:FUNC 'FREQ'", [-221]),
    ],
)
def test_refusals(message: str, numbers: list[int]) -> None:
    assert bench().talk.refusals(message) == numbers


def test_the_queue_overflows_in_its_own_words() -> None:
    talk = bench().talk
    for _ in range(25):
        talk.write("FOO")
    entries = [talk.ask("SYST:ERR?") for _ in range(21)]
    assert entries[19:] == ['-350,"Too many errors"', '+0,"No error"']


@pytest.mark.parametrize("node_v", [0.0, 1.25, -7.5, 11.999])
def test_a_reading_is_the_mean_over_the_aperture(node_v: float) -> None:
    bench_ = bench()
    bench_.world.offset_v = node_v
    bench_.talk.write("CONF:VOLT:DC 10")
    assert bench_.talk.ask("READ?") == f"{node_v:+.8E}"


def test_the_aperture_really_averages() -> None:
    """On a ramp of 1 V/s the mean is the value in the middle of the aperture."""
    bench_ = bench()
    bench_.world.offset_v, bench_.world.slope_v_s = 0.0, 1.0
    bench_.talk.write("CONF:VOLT:DC 10")
    reading = bench_.value()
    ((start, stop),) = bench_.world.windows
    assert stop - start == pytest.approx(0.2)
    assert reading == pytest.approx((start + stop) / 2, rel=1e-8)


@pytest.mark.parametrize(("nplc", "seconds"), [(100, 2.0), (10, 0.2), (1, 0.02), (0.2, 0.003), (0.02, 0.0004)])
@pytest.mark.parametrize("autozero", [0, 1])
def test_reading_time(nplc: float, seconds: float, autozero: int) -> None:
    """Integration (p. 217) doubles with autozero; delay 1.5 or 1 ms, 20 ms arming, a fraction of a ms beside."""
    bench_ = bench()
    bench_.talk.write(f"CONF:VOLT:DC 10;:VOLT:NPLC {nplc};:ZERO:AUTO {autozero}")
    bench_.talk.settle()
    delay = 0.0015 if nplc >= 1 else 0.001
    took = bench_.duration_s("READ?")
    assert took == pytest.approx(0.02 + delay + seconds * (1 + autozero), abs=0.7e-3)
    (window,) = bench_.world.windows
    assert window[1] - window[0] == pytest.approx(seconds)


@pytest.mark.parametrize(("nplc", "resolution"), [(0.02, 1e-3), (0.2, 1e-4), (1, 3e-5), (10, 1e-5), (100, 3e-6)])
def test_integration_and_resolution_go_together(nplc: float, resolution: float) -> None:
    bench_ = bench()
    bench_.talk.write(f"VOLT:RANG 10;NPLC {nplc}")
    assert bench_.value("VOLT:RES?") == pytest.approx(resolution)
    bench_.talk.write(f"VOLT:NPLC 10;RES {resolution}")
    assert bench_.value("VOLT:NPLC?") == nplc
    bench_.talk.write(f"CONF:VOLT:DC 10,{resolution}")
    assert bench_.value("VOLT:NPLC?") == nplc
    assert bench_.talk.ask("ZERO:AUTO?") == ("1" if nplc >= 1 else "0")


def test_the_manuals_example_of_a_resolution() -> None:
    bench_ = bench()
    bench_.talk.write("CONF:VOLT:DC 10,0.001")
    assert bench_.talk.ask("CONF?") == '"VOLT +1.00000000E+01,+1.00000000E-03"'


@pytest.mark.parametrize(
    ("volts", "range_"), [(0.05, 0.1), (0.11, 0.1), (0.13, 1), (5, 10), (11.9, 10), (12.1, 100), (1000, 1000)]
)
def test_a_range_holds_the_value(volts: float, range_: float) -> None:
    bench_ = bench()
    bench_.talk.write(f"VOLT:RANG {volts}")
    assert bench_.value("VOLT:RANG?") == range_
    assert bench_.talk.ask("VOLT:RANG:AUTO?") == "0"


@given(st.floats(-1000.0, 1000.0))
def test_autorange_always_gives_a_reading(volts: float) -> None:
    bench_ = bench()
    bench_.world.offset_v = volts
    assert bench_.value() == pytest.approx(volts, rel=1e-8, abs=1e-15)
    assert abs(volts) <= 1.2 * bench_.value("VOLT:RANG?")


def test_autorange_has_hysteresis() -> None:
    bench_ = bench()
    for volts, range_ in [(1.1, 10), (0.99, 1), (1.19, 1), (1.21, 10)]:
        bench_.world.offset_v = volts
        bench_.value()
        assert bench_.value("VOLT:RANG?") == range_


@pytest.mark.parametrize(("volts", "reply"), [(12.1, "+9.90000000E+37"), (-12.1, "-9.90000000E+37")])
def test_overload(volts: float, reply: str) -> None:
    bench_ = bench()
    bench_.world.offset_v = volts
    bench_.talk.write("*CLS;:CONF:VOLT:DC 10")
    assert bench_.talk.ask("READ?") == reply
    assert bench_.talk.ask("*ESR?;:STAT:QUES?") == "+8;+1"
    assert bench_.talk.errors() == []


@pytest.mark.parametrize(
    ("query", "reply", "bit"),
    [
        ("MEAS:RES?", "+9.90000000E+37", "+512"),
        ("MEAS:FRES? 1000", "+9.90000000E+37", "+512"),
        ("MEAS:CONT?", "+9.90000000E+37", "+512"),
        ("MEAS:DIOD?", "+9.90000000E+37", "+1"),
        ("MEAS:CURR?", "+0.00000000E+00", "+0"),
        ("MEAS:CURR:AC?", "+0.00000000E+00", "+0"),
        ("MEAS:VOLT:DC:RAT?", "+9.90000000E+37", "+1"),
        ("MEAS:FREQ?", "+0.00000000E+00", "+0"),
        ("MEAS:PER?", "+0.00000000E+00", "+0"),
    ],
)
def test_open_inputs(query: str, reply: str, bit: str) -> None:
    talk = bench().talk
    assert talk.ask(query) == reply
    assert talk.ask("STAT:QUES?") == bit
    assert talk.errors() == []


@pytest.mark.parametrize(
    ("spelling", "reply"),
    [
        ('"VOLT:DC"', '"VOLT"'),
        ("'voltage'", '"VOLT"'),
        ('"VOLT:AC"', '"VOLT:AC"'),
        ('"VOLTAGE:DC:RATIO"', '"VOLT:RAT"'),
        ('"CURR:DC"', '"CURR"'),
        ('"RESISTANCE"', '"RES"'),
        ('"FRES"', '"FRES"'),
        ('"PER"', '"PER"'),
        ('"CONT"', '"CONT"'),
        ('"DIOD"', '"DIOD"'),
    ],
)
def test_function_names(spelling: str, reply: str) -> None:
    talk = bench().talk
    talk.write(f"FUNC {spelling}")
    assert talk.ask("FUNC?") == reply


def test_memory() -> None:
    talk = bench().talk
    talk.write("SAMP:COUN 3;:INIT")
    assert talk.ask("FETC?") == ",".join(["+1.25000000E+00"] * 3)
    assert talk.ask("FETC?;:DATA:POIN?") == ",".join(["+1.25000000E+00"] * 3) + ";+3"
    assert talk.ask("READ?") == ",".join(["+1.25000000E+00"] * 3)
    assert talk.ask("DATA:POIN?") == "+3"
    talk.write("DATA:FEED RDG_STORE,'';:INIT")
    assert talk.refusals("FETC?") == [-230]
    talk.write('DATA:FEED RDG_STORE,"CALC";:SAMP:COUN 512;:VOLT:NPLC 0.02;:INIT')
    assert talk.ask("DATA:POIN?") == "+512"
    talk.write("CONF:VOLT:DC")
    assert talk.ask("DATA:POIN?") == "+0"


def test_after_init_nothing_is_done_until_the_sequence_is_through() -> None:
    bench_ = bench()
    bench_.talk.write("SAMP:COUN 5;:INIT;:TRIG:DEL 1")
    assert bench_.meter.triggering.delay_auto
    assert bench_.duration_s("FETC?") == pytest.approx(0.02 + 5 * (0.0015 + 0.4))
    assert not bench_.meter.triggering.delay_auto


def test_bus_trigger() -> None:
    bench_ = bench()
    bench_.talk.write("TRIG:SOUR BUS;COUN 2;:INIT")
    bench_.world.clock.sleep_until(100.0)
    assert bench_.world.windows == []
    bench_.talk.write("*TRG")
    bench_.world.clock.sleep_until(200.0)
    bench_.meter.trigger()
    assert bench_.talk.ask("FETC?") == "+1.25000000E+00,+1.25000000E+00"
    assert [start > instant for (start, _), instant in zip(bench_.world.windows, (100, 200), strict=True)]
    assert bench_.talk.errors() == []


def test_external_trigger_and_its_one_place_in_the_queue() -> None:
    bench_ = bench()
    bench_.talk.write("TRIG:SOUR EXT;COUN 2;:READ?")
    bench_.meter.external_trigger()
    assert bench_.world.windows == []
    bench_.world.clock.sleep_until(1.0)
    for _ in range(3):
        bench_.meter.external_trigger()
    assert bench_.talk.read() == "+1.25000000E+00,+1.25000000E+00"
    assert len(bench_.world.windows) == 2


def test_device_clear_ends_an_endless_measurement() -> None:
    bench_ = bench()
    bench_.talk.write("TRIG:COUN INF;:READ?")
    bench_.world.clock.sleep_until(10.0)
    bench_.meter.clear()
    assert bench_.talk.ask("TRIG:COUN?") == "+9.90000000E+37"
    assert bench_.meter.wake_at() is None


def test_delay() -> None:
    bench_ = bench()
    bench_.talk.write("CONF:VOLT:DC 10;:TRIG:DEL 2.5")
    bench_.talk.settle()
    assert bench_.talk.ask("TRIG:DEL:AUTO?;:TRIG:DEL?") == "0;+2.50000000E+00"
    assert bench_.duration_s("READ?") == pytest.approx(0.02 + 2.5 + 0.4)


def test_statistics() -> None:
    bench_ = bench()
    bench_.talk.write("CALC:FUNC AVER;STAT ON")
    for volts in (1.0, 2.0, 6.0):
        bench_.world.offset_v = volts
        bench_.value()
    reply = bench_.talk.ask("CALC:AVER:MIN?;MAX?;AVER?;COUN?")
    assert reply == "+1.00000000E+00;+6.00000000E+00;+3.00000000E+00;+3.00000000E+00"


def test_null_takes_the_first_reading() -> None:
    bench_ = bench()
    bench_.talk.write("CALC:FUNC NULL;STAT ON")
    bench_.world.offset_v = 2.0
    assert bench_.value() == 0.0
    bench_.world.offset_v = 3.5
    assert bench_.value() == 1.5
    bench_.talk.write("CALC:NULL:OFFS 1")
    assert bench_.value() == 2.5
    assert bench_.talk.errors() == []


def test_decibels() -> None:
    bench_ = bench()
    bench_.world.offset_v = 600.0**0.5 / 1000.0**0.5
    bench_.talk.write("CALC:FUNC DBM;STAT ON")
    assert bench_.value() == pytest.approx(0.0, abs=1e-12)
    bench_.talk.write("CALC:DBM:REF 60")
    assert bench_.value("CALC:DBM:REF?") in (50.0, 75.0)
    bench_.talk.write("CALC:FUNC DB;STAT ON")
    bench_.value()
    bench_.world.offset_v *= 10.0
    assert bench_.value() == pytest.approx(20.0)


def test_zero_volts_have_no_level() -> None:
    """The guide of the 34461A: what is outside the range of a result reads as -9.9E37."""
    bench_ = bench()
    bench_.talk.write("CALC:FUNC DBM;STAT ON")
    bench_.world.offset_v = 0.0
    assert bench_.value() == -9.9e37
    bench_.talk.write("CALC:FUNC DB;STAT ON")
    assert bench_.value() == -9.9e37
    assert bench_.talk.errors() == [540]


@pytest.mark.parametrize(
    ("configured", "answered"),
    [
        ("CONF:FREQ", "FREQ +3.00000000E+00,+3.00000000E-05"),
        ("CONF:PER", "PER +3.33333333E-01,+3.33333333E-06"),
        ("CONF:FREQ DEF,MIN", "FREQ +3.00000000E+00,+3.00000000E-06"),
        ("CONF:PER DEF,3.4E-6", "PER +3.33333333E-01,+3.33333333E-06"),
    ],
)
def test_frequency_and_period_are_configured_for_the_slowest_signal(configured: str, answered: str) -> None:
    """The E1412A, a 34401A in VXI, answers so."""
    bench_ = bench()
    bench_.talk.write(configured)
    assert bench_.talk.ask("CONF?") == f'"{answered}"'
    assert bench_.talk.errors() == []


def test_limits() -> None:
    bench_ = bench()
    bench_.talk.write("CALC:LIM:LOW 1;UPP 2;:CALC:FUNC LIM;STAT ON")
    bits = []
    for volts in (0.5, 1.5, 2.5):
        bench_.world.offset_v = volts
        bench_.value()
        bits.append(bench_.talk.ask("STAT:QUES?"))
    assert bits == ["+2048", "+0", "+4096"]


def test_an_overload_cannot_be_a_reference() -> None:
    bench_ = bench()
    bench_.world.offset_v = 50.0
    bench_.talk.write("VOLT:RANG 10;:CALC:FUNC NULL;STAT ON")
    assert bench_.talk.ask("READ?") == "+9.90000000E+37"
    assert bench_.talk.errors() == [540]
    assert bench_.talk.ask("CALC:STAT?") == "0"


def test_rs232_personality() -> None:
    bench_ = bench(interface="rs232")
    assert bench_.talk.refusals("READ?") == [550]
    bench_.talk.write("SYST:REM")
    bench_.meter.write(b"READ?\n")
    bench_.world.clock.sleep_until(5.0)
    assert bench_.meter.read(100)[0] == b"+1.25000000E+00\r\n"


def test_self_test_takes_its_time() -> None:
    assert bench().duration_s("*TST?") == pytest.approx(15.0)


@pytest.mark.parametrize(
    ("errors", "reading"),
    [
        (MeterErrors(gain_error=1e-4), 5.0005),
        (MeterErrors(offset_v=1e-3), 5.001),
        (MeterErrors(unzeroed_offset_v=1e-3), 5.0),
        (MeterErrors(input_ohm=10e6), 5.0 * 10e6 / (10e6 + 1e5)),
    ],
)
def test_each_error_of_a_specimen_shows(errors: MeterErrors, reading: float) -> None:
    bench_ = bench(errors, source_ohm=1e5)
    bench_.world.offset_v = 5.0
    bench_.talk.write("CONF:VOLT:DC 10")
    assert bench_.value() == pytest.approx(reading, rel=1e-8)


def test_autozero_and_input_impedance_act() -> None:
    bench_ = bench(MeterErrors(unzeroed_offset_v=1e-3, input_ohm=10e6), source_ohm=1e5)
    bench_.world.offset_v = 5.0
    bench_.talk.write("CONF:VOLT:DC 10;:ZERO:AUTO OFF;:INP:IMP:AUTO ON")
    assert bench_.value() == pytest.approx(5.001, rel=1e-8)


def test_noise_falls_with_the_integration_time() -> None:
    bench_ = bench(MeterErrors(noise=0.3, noise_seed=1))
    bench_.talk.write("CONF:VOLT:DC 10;:SAMP:COUN 400")
    spreads = []
    for nplc, resolution in ((0.02, 1e-3), (1, 3e-5)):
        bench_.talk.write(f"VOLT:NPLC {nplc}")
        readings = [float(text) for text in (bench_.talk.ask("READ?") or "").split(",")]
        spreads.append(float(np.std(readings)) / resolution)
    assert spreads == pytest.approx([0.3, 0.3], rel=0.12)  # 3.5 sigma of the spread of 400 readings


def test_specimens_stay_near_the_published_accuracy_and_repeat() -> None:
    drawn = [MeterErrors.drawn(np.random.default_rng(seed)) for seed in range(200)]
    assert max(abs(errors.gain_error) for errors in drawn) < 35e-6
    assert max(abs(errors.offset_v) for errors in drawn) < 50e-6
    assert drawn[3] == MeterErrors.drawn(np.random.default_rng(3))


@pytest.mark.parametrize("language", ["L2", "L3"])
def test_in_another_language_scpi_is_not_understood(language: str) -> None:
    talk = bench().talk
    talk.write(language)
    assert talk.ask("*IDN?") is None
    talk.write("*RST")
    assert talk.ask("*IDN?") is None
    talk.write("L1")
    assert (talk.ask("*IDN?") or "").startswith("HEWLETT-PACKARD,34401A")
    assert talk.errors() == []


def test_rs232_has_scpi_only() -> None:
    assert bench(interface="rs232").talk.refusals("L2") == [-113]


def test_growing_voltage_takes_higher_range() -> None:
    ramp = bench()
    ramp.world.slope_v_s = 40.0
    ramp.talk.write("CONF:VOLT:DC")
    assert 1.2 < abs(ramp.value()) < 100.0
    assert float(ramp.talk.ask("VOLT:DC:RANG?") or "nan") in (10.0, 100.0)


def test_a_fixed_range_is_overloaded_by_it() -> None:
    ramp = bench()
    ramp.world.slope_v_s = 40.0
    ramp.talk.write("CONF:VOLT:DC 0.1")
    assert ramp.value() == 9.9e37
