from __future__ import annotations

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import asdict, replace
from simrack.instruments.agilent33220a import Agilent33220ATwin, GeneratorErrors, OutputRange
from simrack.sources import Drive

from simrack_tests.instruments.agilent33220a.bench import Socket


@pytest.fixture
def box() -> Socket:
    return Socket()


def nr3(value: float) -> str:
    return f"{value:+.13E}"


POWER_ON = {
    "FUNC?": "SIN",
    "FREQ?": "+1.0000000000000E+03",
    "VOLT?": "+1.0000000000000E-01",
    "VOLT:OFFS?": "+0.0000000000000E+00",
    "VOLT:HIGH?": "+5.0000000000000E-02",
    "VOLT:LOW?": "-5.0000000000000E-02",
    "VOLT:UNIT?": "VPP",
    "VOLT:RANG:AUTO?": "1",
    "FUNC:SQU:DCYC?": nr3(50),
    "FUNC:RAMP:SYMM?": nr3(100),
    "OUTP?": "0",
    "OUTP:LOAD?": nr3(50),
    "OUTP:POL?": "NORM",
    "OUTP:SYNC?": "1",
    "PULS:PER?": nr3(1e-3),
    "FUNC:PULS:WIDT?": nr3(1e-4),
    "FUNC:PULS:TRAN?": nr3(5e-9),
    "AM:INT:FUNC?": "SIN",
    "AM:INT:FREQ?": nr3(100),
    "AM:DEPT?": nr3(100),
    "AM:SOUR?": "INT",
    "AM:STAT?": "0",
    "FM:INT:FREQ?": nr3(10),
    "FM:DEV?": nr3(100),
    "FSK:FREQ?": nr3(100),
    "FSK:INT:RATE?": nr3(10),
    "FREQ:STAR?": nr3(100),
    "FREQ:STOP?": nr3(1000),
    "FREQ:CENT?": nr3(550),
    "FREQ:SPAN?": nr3(900),
    "SWE:SPAC?": "LIN",
    "TRIG:SOUR?": "IMM",
    "TRIG:SLOP?": "POS",
    "TRIG:DEL?": nr3(0),
    "OUTP:TRIG?": "0",
    "MARK:FREQ?": nr3(500),
    "MARK?": "0",
    "BURS:MODE?": "TRIG",
    "BURS:NCYC?": nr3(1),
    "BURS:INT:PER?": nr3(1e-2),
    "BURS:PHAS?": nr3(0),
    "BURS:STAT?": "0",
    "UNIT:ANGL?": "DEG",
    "BURS:GATE:POL?": "NORM",
    "FORM:BORD?": "NORM",
    "FUNC:USER?": "EXP_RISE",
    "DATA:ATTR:POIN?": "+16384",
    "DATA:ATTR:PTP?": "+1.0000000000000E+00",
    "DISP?": "1",
    "SYST:BEEP:STAT?": "1",
    "PHAS?": nr3(0),
    "APPL?": '"SIN +1.0000000000000E+03,+1.0000000000000E-01,+0.0000000000000E+00"',
    "*IDN?": "Agilent Technologies,33220A,MY44021876,2.02-2.02-22-2",
    "SYST:VERS?": "1999.0",
    "*TST?": "+0",
    "DATA:CAT?": '"EXP_RISE","EXP_FALL","NEG_RAMP","SINC","CARDIAC"',
    "DATA:NVOL:CAT?": '""',
    "DATA:NVOL:FREE?": "+4",
    "MEM:NST?": "+5",
    "STAT:QUES:COND?": "+0",
    "SYST:ERR?": '+0,"No error"',
}


def test_power_on_replies_to_the_character() -> None:
    assert {query: Socket().ask(query) for query in POWER_ON} == POWER_ON


def test_built_in_rise_has_recorded_average_and_crest(box: Socket) -> None:
    assert float(box.ask("DATA:ATTR:AVER? EXP_RISE")) == pytest.approx(6.71563e-01, rel=5e-6)
    assert float(box.ask("DATA:ATTR:CFAC? EXP_RISE")) == pytest.approx(2.11199, rel=6e-4)


def test_reset_brings_them_back(box: Socket) -> None:
    box.send("APPL:SQU 5 KHZ,3.0,-1.0;:OUTP:LOAD INF;:AM:STAT ON;*RST")
    assert {query: box.ask(query) for query in POWER_ON} == POWER_ON


def test_the_generator_starts_with_the_relay_open(box: Socket) -> None:
    assert box.drives == [None]
    box.send("OUTP ON")
    assert box.sine == Drive(0.0, pytest.approx(0.1), 1000.0, 0.0)  # type: ignore[arg-type]
    box.send("OUTP OFF")
    assert box.drives[-1] is None


def test_direct_voltage_into_high_impedance(box: Socket) -> None:
    box.send("OUTP:LOAD INF;:FUNC DC;:VOLT:OFFS 5.025;:OUTP ON")
    assert box.sine == Drive(5.025)
    assert box.ask("VOLT:OFFS?") == nr3(5.025)
    box.send("VOLT:OFFS -10")
    assert box.sine == Drive(-10.0)
    assert box.errors() == []


def test_apply_direct_voltage_turns_the_output_on(box: Socket) -> None:
    box.send("OUTP:LOAD INF;:APPL:DC DEF,DEF,-2.5")
    assert box.ask("OUTP?") == "1"
    assert box.ask("FUNC?") == "DC"
    assert box.sine == Drive(-2.5)


def test_apply_a_sine_as_the_manual_shows(box: Socket) -> None:
    box.send("APPL:SIN 5 KHZ, 3.0 VPP, -2.5 V")
    assert box.ask("APPL?") == '"SIN +5.0000000000000E+03,+3.0000000000000E+00,-2.5000000000000E+00"'
    # 50 ohm assumed, open circuit real: twice as much
    assert box.sine == Drive(-5.0, 3.0, 5000.0, 0.0)
    assert box.errors() == []


def test_load_setting_changes_display_not_output(box: Socket) -> None:
    box.send("VOLT 10;:OUTP ON")
    before = box.sine
    box.send("OUTP:LOAD INF")
    assert box.ask("VOLT?") == nr3(20)
    assert box.ask("OUTP:LOAD?") == "+9.9000000000000E+37"
    box.send("OUTP:LOAD 50")
    assert box.ask("VOLT?") == nr3(10)
    assert box.sine == before
    assert box.errors() == []


@pytest.mark.parametrize(
    ("command", "query", "reply", "error"),
    [
        ("FREQ 21 MHZ", "FREQ?", 20e6, '-222,"Data out of range; frequency; value clipped to upper limit"'),
        ("FREQ 0", "FREQ?", 1e-6, '-222,"Data out of range; frequency; value clipped to lower limit"'),
        ("VOLT 11", "VOLT?", 10, '-222,"Data out of range; amplitude; value clipped to upper limit"'),
        ("VOLT 0.001", "VOLT?", 0.01, '-222,"Data out of range; amplitude; value clipped to lower limit"'),
        ("VOLT:OFFS 6", "VOLT:OFFS?", 4.95, '-222,"Data out of range; offset; value clipped to upper limit"'),
        ("VOLT:OFFS -6", "VOLT:OFFS?", -4.95, '-222,"Data out of range; offset; value clipped to lower limit"'),
        ("BURS:NCYC 50001", "BURS:NCYC?", 50000, '-222,"Data out of range; burst count; value clipped to upper limit"'),
        ("AM:DEPT 121", "AM:DEPT?", 120, '-222,"Data out of range; value clipped to upper limit"'),
        (
            "FUNC:SQU:DCYC 85",
            "FUNC:SQU:DCYC?",
            80,
            '-222,"Data out of range; duty cycle; value clipped to upper limit"',
        ),
        ("OUTP:LOAD 0.5", "OUTP:LOAD?", 1, '-222,"Data out of range; value clipped to lower limit"'),
    ],
)
def test_numbers_out_of_range_are_clipped_with_an_error(
    box: Socket, command: str, query: str, reply: float, error: str
) -> None:
    box.send(command)
    assert float(box.ask(query)) == pytest.approx(reply, rel=1e-12)
    assert box.errors() == [error]


@pytest.mark.parametrize(
    ("arranged", "command", "word"),
    [
        ("FUNC RAMP", "FREQ 300E3", "ramp frequency"),
        ("FUNC PULS", "FREQ 6E6", "pulse frequency"),
        ("FUNC USER", "FREQ 7E6", "user frequency"),
        ("*CLS", "APPL:RAMP 300E3", "ramp frequency"),
        ("FUNC SQU;:FREQ 15E6", "FUNC:SQU:DCYC 80", "duty cycle limited by frequency"),
        ("FUNC PULS", "FUNC:PULS:TRAN 200E-9", "pulse edge time"),
        ("*CLS", "BURS:INT:PER 600", "burst period"),
    ],
)
def test_what_was_clipped_has_the_name_of_the_limit(box: Socket, arranged: str, command: str, word: str) -> None:
    box.send(arranged)
    assert box.errors() == []
    box.send(command)
    assert f'-222,"Data out of range; {word}; value clipped to upper limit"' in box.errors()


def test_the_calibration_can_be_asked_for(box: Socket) -> None:
    assert box.ask("CAL:COUN?;SEC:STAT?;:CAL:STR?;VAL?") == f'+1;1;"";{nr3(0)}'
    assert box.errors() == []
    assert box.ask("CAL?") == "+1"
    assert box.errors() == ['+702,"Calibration error; calibration memory is secured"']


def test_location_0_holds_a_state_from_the_start(box: Socket) -> None:
    assert box.ask("MEM:STAT:VAL? 0") == "1"
    box.send("FREQ 2E3;*RCL 0")
    assert (box.ask("FREQ?"), box.errors()) == (nr3(1000), [])


def test_amplitude_wins_over_offset_and_offset_loses_to_amplitude(box: Socket) -> None:
    box.send("OUTP:LOAD INF;:VOLT:OFFS 8")
    box.send("VOLT 10")
    assert (box.ask("VOLT?"), box.ask("VOLT:OFFS?")) == (nr3(10), nr3(5))
    assert box.errors() == ['-221,"Settings conflict; offset changed due to amplitude"']
    assert box.ask("VOLT:OFFS? MAX") == nr3(5)
    assert box.ask("VOLT:OFFS? MIN") == nr3(-5)


def test_leaving_dc_moves_an_offset_that_no_longer_fits(box: Socket) -> None:
    box.send("OUTP:LOAD INF;:VOLT 2;:FUNC DC;:VOLT:OFFS 10;:FUNC SIN")
    assert box.ask("VOLT:OFFS?") == nr3(9)
    assert box.errors() == ['-221,"Settings conflict; offset changed on exit from dc function"']


@pytest.mark.parametrize(
    ("frequency", "function", "result", "words"),
    [
        ("1 MHZ", "RAMP", 200e3, "frequency reduced for ramp function"),
        ("15 MHZ", "USER", 6e6, "frequency reduced for user function"),
        ("10 MHZ", "PULS", 5e6, "frequency changed for pulse function"),
        ("0.0001", "PULS", 5e-4, "frequency changed for pulse function"),
    ],
)
def test_a_function_with_smaller_limits_reduces_the_frequency(
    box: Socket, frequency: str, function: str, result: float, words: str
) -> None:
    box.send(f"FREQ {frequency};:FUNC {function}")
    assert box.ask("FREQ?") == nr3(result)
    assert box.errors()[0] == f'-221,"Settings conflict; {words}"'


def test_levels_and_amplitude_are_two_views_of_the_same(box: Socket) -> None:
    box.send("OUTP:LOAD INF;:VOLT:LOW -1;:VOLT:HIGH 3")
    assert (box.ask("VOLT?"), box.ask("VOLT:OFFS?")) == (nr3(4), nr3(1))
    box.send("VOLT:LOW 5")
    assert float(box.ask("VOLT:HIGH?")) > float(box.ask("VOLT:LOW?"))
    assert box.errors() == ['-221,"Settings conflict; high level changed due to low level"']


@pytest.mark.parametrize(
    ("function", "unit", "value", "vpp"),
    [("SIN", "VRMS", 1.0, 2 * math.sqrt(2)), ("SQU", "VRMS", 1.0, 2.0), ("SIN", "DBM", 0.0, 0.632455532)],
)
def test_units_of_amplitude(box: Socket, function: str, unit: str, value: float, vpp: float) -> None:
    box.send(f"FUNC {function};:VOLT {value} {unit}")
    assert float(box.ask("VOLT?")) == pytest.approx(vpp, rel=1e-8)
    box.send(f"VOLT:UNIT {unit}")
    assert float(box.ask("VOLT?")) == pytest.approx(value, abs=1e-8)


def test_dbm_needs_a_load(box: Socket) -> None:
    box.send("OUTP:LOAD INF;:VOLT:UNIT DBM")
    assert box.ask("VOLT:UNIT?") == "VPP"
    assert box.errors() == ['-221,"Settings conflict; amplitude units changed to Vpp due to high-Z load"']


def test_one_modulation_at_a_time(box: Socket) -> None:
    box.send("AM:STAT ON;:FM:STAT ON")
    assert (box.ask("AM:STAT?"), box.ask("FM:STAT?")) == ("0", "1")
    assert box.errors() == ['-221,"Settings conflict; AM turned off by selection of other mode or modulation"']
    box.send("FUNC PULS")
    assert box.ask("FM:STAT?") == "0"
    box.errors()
    box.send("AM:STAT ON")
    assert box.errors() == ['-221,"Settings conflict; not able to modulate this function"']


def test_am_halves_the_carrier(box: Socket) -> None:
    box.send("OUTP:LOAD INF;:VOLT 2;:OUTP ON;:AM:STAT ON")
    assert box.sine.amplitude_v == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("command", "number"),
    [
        ("BOGUS", -113),
        ("PULS:WIDT 1e-5", -113),
        ("VOL 3", -113),
        ("FUNC TRI", -224),
        ("FREQ", -109),
        ("FREQ 1,2", -108),
        ("FREQ 3 VPP", -131),
        ("BURS:NCYC 3 S", -138),
        ("*TRG", -211),
        ("TRIG", -211),
        ("FUNC:USER NOSUCH", 785),
        ("DATA:DEL SINC", 786),
        ("DATA:COPY CARDIAC,VOLATILE", 782),
        ("DATA:COPY MINE,VOLATILE", 785),
        ("*RCL 3", 810),
        ("DATA:DAC VOLATILE,8192", -222),
    ],
)
def test_refusals(box: Socket, command: str, number: int) -> None:
    box.send(command)
    (error,) = box.errors()
    assert int(error.split(",")[0]) == number


def test_the_error_queue_is_twenty_deep(box: Socket) -> None:
    for _ in range(25):
        box.send("BOGUS")
    errors = box.errors()
    assert len(errors) == 20
    assert errors[-1] == '-350,"Queue overflow"'


def test_an_infinite_burst_changes_the_trigger_source(box: Socket) -> None:
    box.send("BURS:NCYC INF")
    assert box.ask("BURS:NCYC?") == "+9.9000000000000E+37"
    assert box.ask("TRIG:SOUR?") == "BUS"
    assert box.errors() == ['-221,"Settings conflict; infinite burst changed trigger source to MANUAL"']


def test_arbitrary_waveforms_come_and_go(box: Socket) -> None:
    box.send("DATA VOLATILE,-1,-0.5,0,0.5,1,0.5,0,-0.5")
    box.send("DATA:COPY TRI_1,VOLATILE;:FUNC:USER TRI_1;:OUTP:LOAD INF;:VOLT 2;:FUNC USER;:OUTP ON")
    assert box.ask("DATA:CAT?").startswith('"VOLATILE","EXP_RISE"')
    assert box.ask("DATA:NVOL:CAT?") == '"TRI_1"'
    assert box.ask("DATA:ATTR:POIN? TRI_1") == "+8"
    assert box.ask("DATA:ATTR:AVER? TRI_1") == nr3(0)
    np.testing.assert_allclose(box.volts((np.arange(8) + 0.5) / 8000), [-1, -0.5, 0, 0.5, 1, 0.5, 0, -0.5])
    box.send("DATA:DEL TRI_1")
    assert box.errors() == ['+787,"Not able to delete the currently selected active arb waveform"']


def test_dac_codes_as_a_block_of_either_byte_order(box: Socket) -> None:
    box.send(b"DATA:DAC VOLATILE,#14\x1f\xff\xe0\x01")
    assert box.ask("DATA:ATTR:PTP? VOLATILE") == nr3(1)
    box.send(b"FORM:BORD SWAP;:DATA:DAC VOLATILE,#14\xff\x1f\x01\xe0")
    assert box.ask("DATA:ATTR:PTP? VOLATILE") == nr3(1)
    assert box.errors() == []


def test_states_are_kept_through_a_reset(box: Socket) -> None:
    box.send("APPL:SIN 5 KHZ,3.0,-1.0;*SAV 2;*RST;*RCL 2")
    assert box.ask("APPL?") == '"SIN +5.0000000000000E+03,+3.0000000000000E+00,-1.0000000000000E+00"'
    assert (box.ask("MEM:STAT:VAL? 2"), box.ask("MEM:STAT:VAL? 1")) == ("1", "0")


def test_sweep_limits_are_two_views_of_the_same(box: Socket) -> None:
    box.send("FREQ:CENT 2000;SPAN 1000")
    assert (box.ask("FREQ:STAR?"), box.ask("FREQ:STOP?")) == (nr3(1500), nr3(2500))


def test_angles_follow_the_unit(box: Socket) -> None:
    box.send("PHAS 90;:UNIT:ANGL RAD")
    assert float(box.ask("PHAS?")) == pytest.approx(math.pi / 2)
    box.send("OUTP ON")
    assert box.sine.phase_rad == pytest.approx(math.pi / 2)


def test_inverted_polarity_turns_the_wave_and_not_the_offset(box: Socket) -> None:
    box.send("OUTP:LOAD INF;:APPL:SIN 1000,2,1;:OUTP:POL INV")
    assert box.sine.dc_v == 1.0
    assert abs(box.sine.phase_rad) == pytest.approx(math.pi)


def test_a_change_of_frequency_keeps_the_phase(box: Socket) -> None:
    box.send("OUTP ON;:FREQ 1000")
    box.clock.sleep_until(1.2345)
    before = box.sine
    box.generator.write(b"FREQ 1234.5\n")
    box._settle()
    at = box.clock.now()
    box.generator.read(1)
    after = box.sine
    phases = [2 * math.pi * each.frequency_hz * at + each.phase_rad for each in (before, after)]
    assert math.remainder(phases[1] - phases[0], 2 * math.pi) == pytest.approx(0.0, abs=1e-6)


STEPPED = replace(
    GeneratorErrors.none(),
    ranges=(OutputRange(1.0, 0.001, 0.002), OutputRange(10.0, -0.003, -0.004)),
)


@pytest.mark.parametrize(
    ("volts", "real"),
    [(0.0, 0.002), (0.5, 0.5 * 1.001 + 0.002), (1.0, 1.001 + 0.002), (1.001, 1.001 * 0.997 - 0.004), (-10, -9.974)],
)
def test_each_range_has_its_gain_and_offset(volts: float, real: float) -> None:
    box = Socket(STEPPED)
    box.send(f"OUTP:LOAD INF;:FUNC DC;:VOLT:OFFS {volts};:OUTP ON")
    assert box.sine.dc_v == pytest.approx(real, rel=1e-12)


def test_range_hold_keeps_the_larger_range() -> None:
    box = Socket(STEPPED)
    box.send("OUTP:LOAD INF;:FUNC DC;:VOLT:OFFS 5;:OUTP ON;:VOLT:RANG:AUTO OFF;:VOLT:OFFS 0.5")
    assert box.sine.dc_v == pytest.approx(0.5 * 0.997 - 0.004)
    box.send("VOLT:RANG:AUTO ON")
    assert box.sine.dc_v == pytest.approx(0.5 * 1.001 + 0.002)


@given(st.floats(-10.0, 10.0))
def test_converter_rounds_to_half_step_and_setting_to_half_digit(volts: float) -> None:
    box = Socket(replace(GeneratorErrors.none(), dac_bits=14, setting_digits=4))
    box.send(f"OUTP:LOAD INF;:FUNC DC;:VOLT:OFFS {volts!r};:OUTP ON")
    setting = float(box.ask("VOLT:OFFS?"))
    assert abs(setting - volts) <= 5.001e-4 * abs(volts) + 1e-99  # what two digits of an exponent can tell
    upper = next(each.upper_v for each in GeneratorErrors.none().ranges if abs(setting) <= each.upper_v)
    assert abs(box.sine.dc_v - setting) <= upper / 2**14 * 1.000001


@pytest.mark.parametrize("ends_v", [(), (0.1, 1.0, 2.0, 5.0, 10.0)])
def test_drawn_unit_is_within_data_sheet_at_every_level(ends_v: tuple[float, ...]) -> None:
    furthest = 0.0
    for seed in range(200):
        errors = GeneratorErrors.drawn(np.random.default_rng(seed))
        errors = errors.with_ranges(ends_v) if ends_v else errors
        low_v = 0.0
        for each in errors.ranges:
            for level_v in (low_v, each.upper_v):
                off_v = abs(each.gain_error) * level_v + abs(each.offset_error_v)
                assert off_v <= (0.02 * level_v + 0.004) * (1.0 + 1e-12)
            low_v = each.upper_v
            furthest = max(furthest, abs(each.offset_error_v))
        assert (errors.dac_bits, errors.setting_digits) == (14, 4)
    assert furthest > 0.008


CLEARING = {"*ESR", "AER", "TER", "OPERegister[:EVENt]"}


def spellings(pattern: str) -> tuple[str, str]:
    """Return a header in its shortest and its longest spelling, suffixes as 1."""
    short = re.sub(r"\[[^\]]*\]", "", pattern)
    full = pattern.replace("[", "").replace("]", "")
    one = [re.sub(r"<\d-\d>", "1", text) for text in (short, full)]
    return re.sub(r"[a-z]", "", one[0]), one[1]


def test_every_query_answers_in_every_spelling_without_an_error() -> None:
    for command in Agilent33220ATwin.table.commands:
        if not command.query or command.query_parameters or command.pattern == "CALibration[:ALL]":
            continue
        box = Socket()
        replies = {box.ask(f"{header}?") for header in spellings(command.pattern)}
        assert box.errors() == [], command.pattern
        assert len(replies) == 1 or command.pattern in CLEARING, command.pattern


@pytest.mark.parametrize(
    ("setup", "command", "amplitude", "offset"),
    [
        ("", "APPL:SIN 1000,MAX,MIN", 10.0, 0.0),
        ("", "APPL:SIN 1000,8,MAX", 8.0, 1.0),
        ("VOLT 8", "APPL:SQU 1000,2,MIN", 2.0, -4.0),
        ("VOLT:UNIT VRMS", "APPL:SQU 1000,MAX", 5.0, 0.0),
        ("VOLT:UNIT VRMS", "APPL:SIN 1000,MIN", 0.01 / 8**0.5, 0.0),
    ],
)
def test_apply_limits_are_those_of_its_function(
    box: Socket, setup: str, command: str, amplitude: float, offset: float
) -> None:
    box.send(setup)
    box.send(command)
    assert float(box.ask("VOLT?")) == pytest.approx(amplitude, rel=1e-9)
    assert float(box.ask("VOLT:OFFS?")) == pytest.approx(offset, abs=1e-9)
    assert box.errors() == []


@pytest.mark.parametrize(
    ("period", "least"), [("1", 20e-9), ("10", 20e-9), ("20", 200e-9), ("200", 2e-6), ("1000", 2e-6), ("2000", 20e-6)]
)
def test_longer_periods_have_longer_pulses(box: Socket, period: str, least: float) -> None:
    box.send(f"FUNC PULS;:PULS:PER {period};:FUNC:PULS:WIDT MIN")
    assert float(box.ask("FUNC:PULS:WIDT?")) == pytest.approx(least)
    box.send("FUNC:PULS:WIDT MAX")
    assert float(box.ask("FUNC:PULS:WIDT?")) == pytest.approx(float(period) - least)
    box.send("FUNC:PULS:DCYC MIN")
    assert float(box.ask("FUNC:PULS:WIDT?")) == pytest.approx(least)
    assert box.errors() == []


def test_the_slowest_edge_is_that_of_the_pulse(box: Socket) -> None:
    box.send("FUNC PULS;:FUNC:PULS:WIDT 80E-9;TRAN MAX")
    assert float(box.ask("FUNC:PULS:TRAN?")) == pytest.approx(50e-9)
    assert box.errors() == []


@pytest.mark.parametrize(("width", "most"), [("100E-6", 99.98e-6), ("0.9E-3", 99.98e-6), ("20E-9", 0.0)])
def test_modulated_pulses_keep_their_least_width(box: Socket, width: str, most: float) -> None:
    box.send(f"FUNC PULS;:FUNC:PULS:WIDT {width}")
    assert float(box.ask("PWM:DEV? MAX")) == pytest.approx(most, abs=1e-15)


def test_only_the_volatile_waveform_can_be_copied(box: Socket) -> None:
    box.send("DATA:COPY MINE, SINC")
    assert box.errors() == ['+784,"Name of source arb waveform for copy must be VOLATILE"']


LEARNT = [
    "OUTP:LOAD INF;:FUNC DC;:VOLT:OFFS 9.5;:OUTP ON",
    "FUNC RAMP;:FUNC:RAMP:SYMM 20;:FREQ 2E5;:VOLT:UNIT VRMS;:VOLT 1;:VOLT:OFFS -2;:OUTP:POL INV",
    "FUNC SQU;:FUNC:SQU:DCYC 45;:FREQ 15E6;:VOLT:UNIT DBM;:VOLT 10;:OUTP:SYNC OFF",
    "FUNC PULS;:PULS:PER 20;:FUNC:PULS:WIDT 3;TRAN 50E-9;HOLD DCYC;:PWM:DEV 1;INT:FUNC TRI;:PWM:STAT ON",
    "UNIT:ANGL RAD;:PM:DEV 1;INT:FREQ 3;:PM:STAT ON;:PHAS -1",
    "FREQ 5000;:FM:DEV 3000;SOUR EXT;:FM:STAT ON",
    "FREQ:STAR 9000;STOP 200;:SWE:SPAC LOG;TIME 3;STAT ON;:MARK:FREQ 700;:MARK ON;:TRIG:SOUR BUS;:OUTP:TRIG ON",
    "TRIG:SOUR BUS;DEL 2;:BURS:NCYC INF;PHAS 90;STAT ON",
    "FREQ 2E3;:BURS:NCYC 70;INT:PER 0.2;:BURS:STAT ON",
    "AM:DEPT 30;INT:FUNC USER;:AM:STAT ON;:FUNC:USER SINC;:FUNC USER;:VOLT:RANG:AUTO OFF",
    "FSK:FREQ 5E3;INT:RATE 7;:FSK:STAT ON",
]


@pytest.mark.parametrize("settings", LEARNT)
def test_what_is_learnt_brings_the_settings_back_without_an_error(box: Socket, settings: str) -> None:
    box.send(settings)
    assert box.errors() == []
    learnt, state = box.ask("*LRN?"), asdict(box.generator.state)
    box.send("*RST;:FUNC NOIS;:BURS:MODE GAT;STAT ON")
    box.send(learnt)
    assert box.errors() == []
    assert box.ask("*LRN?") == learnt
    numbers = {key: value for key, value in asdict(box.generator.state).items() if isinstance(value, float)}
    assert numbers == pytest.approx({key: state[key] for key in numbers}, rel=1e-12)
    assert {key: value for key, value in asdict(box.generator.state).items() if key not in numbers} == {
        key: value for key, value in state.items() if key not in numbers
    }


@pytest.mark.parametrize("command", ["*SAV 5", "*RCL 5", "MEM:STAT:DEL 5", "MEM:STAT:NAME 5,TEST", "*SAV -1"])
def test_missing_memory_is_refused(command: str) -> None:
    box = Socket()
    box.send("FREQ 2000;*SAV 4;:FREQ 3000")
    box.send(command)
    assert box.errors() == ['-222,"Data out of range"']
    assert box.ask("FREQ?") == "+3.0000000000000E+03"
    box.send("*RCL 4")
    assert box.ask("FREQ?") == "+2.0000000000000E+03"
    assert box.ask("MEM:STAT:NAME? 4") == '"STATE_4"'
