"""Calibration of the simulated 34401A: what it changes, and what it refuses."""

from __future__ import annotations

import math

import pytest
from simrack.instruments.hp34401a import MeterErrors
from simrack.instruments.hp34401a.imperfections import AcErrors, CounterErrors, CurrentErrors, OhmsErrors
from simrack.sources import Sine

from simrack_tests.instruments.hp34401a.bench import MeterBench, bench


def unsecured(errors: MeterErrors | None = None, sense: str | None = None) -> MeterBench:
    made = bench(errors, sense=sense)
    made.talk.write("CAL:SEC:STAT OFF,HP034401")
    return made


def test_a_round_of_zero_and_gain_makes_the_reading_true() -> None:
    made = unsecured(MeterErrors(gain_error=2e-4, offset_v=3e-3))
    made.talk.write("CONF:VOLT:DC 10")
    made.world.offset_v = 5.0
    assert made.value() == pytest.approx(5.0 * (1 + 2e-4) + 3e-3)
    made.world.offset_v = 0.0
    assert made.talk.ask("CAL:VAL 0;:CAL?") == "+0"
    made.world.offset_v = 10.0
    assert made.talk.ask("CAL:VAL 10;:CAL?") == "+0"
    for volts in (-7.0, 0.0, 5.0, 11.0):
        made.world.offset_v = volts
        assert made.value() == pytest.approx(volts, rel=1e-8, abs=1e-12)
    assert made.talk.ask("CAL:COUN?") == "+3"
    assert made.talk.errors() == []


def test_zero_calibrates_all_ranges_and_gain_one() -> None:
    made = unsecured(MeterErrors(gain_error=2e-4, offset_v=3e-3))
    made.talk.write("CONF:VOLT:DC 10;:CAL:VAL 0")
    made.world.offset_v = 0.0
    made.talk.ask("CAL?")
    made.world.offset_v = 1.0
    made.talk.write("CONF:VOLT:DC 1;:CAL:VAL 1")
    made.talk.ask("CAL?")
    assert made.value() == pytest.approx(1.0, rel=1e-8)
    made.talk.write("CONF:VOLT:DC 10")
    assert made.value() == pytest.approx(1.0 + 2e-4, rel=1e-8)


def test_a_calibration_with_a_wrong_value_makes_the_reading_wrong() -> None:
    made = unsecured()
    made.world.offset_v = 10.0
    assert made.talk.ask("CONF:VOLT:DC 10;:CAL:VAL 10.05;:CAL?") == "+0"
    made.world.offset_v = 4.0
    assert made.value() == pytest.approx(4.02, rel=1e-8)


def test_it_survives_a_reset_and_the_secured_state_guards_it() -> None:
    made = unsecured(MeterErrors(gain_error=5e-4))
    made.world.offset_v = 10.0
    made.talk.ask("CONF:VOLT:DC 10;:CAL:VAL 10;:CAL?")
    made.talk.write("CAL:SEC:STAT ON,HP034401;*RST;:CONF:VOLT:DC 10")
    assert made.value() == pytest.approx(10.0, rel=1e-8)
    assert made.talk.refusals("CAL?") == [702]
    assert made.talk.ask("CAL:COUN?") == "+2"


def test_resistance() -> None:
    made = unsecured(MeterErrors(ohms=OhmsErrors(0.9, 0.9, 0.17)))
    made.world.offset_v = made.world.resistance_ohm = 0.0
    assert made.talk.ask("CONF:RES 1000;:CAL:VAL 0;:CAL?") == "+0"
    made.world.resistance_ohm = 1e3
    assert made.talk.ask("CAL:VAL 1000;:CAL?") == "+0"
    assert made.value() == pytest.approx(1e3, rel=1e-8)


def test_ac_gain_at_one_kilohertz_and_flatness_at_fifty() -> None:
    made = unsecured(MeterErrors(ac=AcErrors(gain_error=4e-4, flatness_error=0.02)))
    for frequency_hz in (1e3, 5e4):
        made.world.play(Sine(math.sqrt(2.0), frequency_hz, 0.0))
        made.talk.write("CONF:VOLT:AC 1;:CAL:VAL 1")
        assert made.talk.ask("CAL?") == "+0"
    for frequency_hz, rel in ((1e3, 2e-6), (5e4, 2e-6), (3e5, 5e-3)):
        made.world.play(Sine(math.sqrt(2.0), frequency_hz, 0.0))
        assert made.value("MEAS:VOLT:AC? 1") == pytest.approx(1.0, rel=rel)


def test_the_time_base_of_frequency_and_period() -> None:
    made = unsecured(MeterErrors(counter=CounterErrors(timebase_error=7e-5)))
    made.world.play(Sine(1.0, 1e4, 0.0))
    assert made.talk.ask("CONF:FREQ;:CAL:VAL 10 KHZ;:CAL?") is None or made.talk.errors()
    assert made.talk.ask("CAL:VAL 10000;:CAL?") == "+0"
    assert made.value() == pytest.approx(1e4, rel=1e-8)
    assert made.value("MEAS:PER?") == pytest.approx(1e-4, rel=1e-8)


def test_the_offset_of_an_open_current_input() -> None:
    made = unsecured(MeterErrors(current=CurrentErrors(dc_range_share=0.8)))
    made.talk.write("CONF:CURR 1")
    assert made.value() == pytest.approx(8e-5)
    assert made.talk.ask("CAL:VAL 0;:CAL?") == "+0"
    assert made.value() == pytest.approx(0.0, abs=1e-12)
    assert made.talk.refusals("CAL:VAL 1;:CAL?") == [707]


@pytest.mark.parametrize(
    ("message", "node_v", "number"),
    [
        ("CONF:VOLT:DC 10;:CAL:VAL 5;:CAL?", 5.0, 706),
        ("CONF:VOLT:DC 10;:CAL:VAL 11.1;:CAL?", 11.1, 706),
        ("CONF:VOLT:AC 1;:CAL:VAL -1;:CAL?", 0.0, 706),
        ("CONF:VOLT:AC 1;:CAL:VAL 0;:CAL?", 0.0, 706),
        ("CONF:FREQ;:CAL:VAL 10;:CAL?", 0.0, 706),
        ("CONF:VOLT:DC 10;:CAL:VAL 10;:CAL?", 5.0, 707),
        ("CONF:VOLT:DC 10;:CAL:VAL 10;:CAL?", 13.0, 707),
        ("CONF:VOLT:DC 10;:CAL:VAL 10;:CAL?", 10.2, 710),
        ("CONF:VOLT:DC 10;:CAL:VAL 0;:CAL?", 0.02, 720),
        ("CONF:RES 1000;:CAL:VAL 0;:CAL?", 0.0, 722),
        ("CONF:FRES 1000;:CAL:VAL 0;:CAL?", 0.0, 723),
        ("CONF:DIOD;:CAL:VAL 1;:CAL?", 0.0, 709),
        ("CONF:CONT;:CAL:VAL 1;:CAL?", 0.0, 709),
        ("CONF:PER;:CAL:VAL 1;:CAL?", 0.0, 709),
    ],
)
def test_refusals(message: str, node_v: float, number: int) -> None:
    made = unsecured()
    made.world.offset_v, made.world.resistance_ohm = node_v, 2.0
    assert made.talk.refusals(message) == [number]
    assert made.talk.ask("CAL:COUN?") == "+1"


def test_an_ac_calibration_at_another_frequency_is_refused() -> None:
    made = unsecured()
    made.world.play(Sine(math.sqrt(2.0), 7e3, 0.0))
    assert made.talk.refusals("CONF:VOLT:AC 1;:CAL:VAL 1;:CAL?") == [708]


def test_a_device_clear_gives_it_up_and_changes_nothing() -> None:
    made = unsecured(MeterErrors(gain_error=5e-4))
    made.world.offset_v = 10.0
    made.talk.write("CONF:VOLT:DC 10;:CAL:VAL 10;:CAL?")
    made.world.clock.sleep_until(made.world.clock.now() + 1.0)
    made.meter.clear()
    assert made.talk.errors() == [705]
    assert made.value() == pytest.approx(10.005, rel=1e-8)
    made.meter.clear()
    assert made.talk.errors() == []


def test_after_a_refused_calibration_a_device_clear_reports_nothing() -> None:
    made = unsecured()
    made.world.offset_v = 5.0
    assert made.talk.refusals("CONF:VOLT:DC 10;:CAL:VAL 10;:CAL?") == [707]
    made.meter.clear()
    assert made.talk.errors() == []


def test_the_words_of_the_errors() -> None:
    made = unsecured()
    made.talk.write("CONF:DIOD;:CAL?")
    assert made.talk.ask("SYST:ERR?") == '+709,"No cal for this function or range"'


def test_the_code_can_be_changed() -> None:
    made = unsecured()
    made.talk.write("CAL:SEC:CODE ZZ9;STAT ON,ZZ9")
    assert made.talk.ask("CAL:SEC:STAT?") == "1"
    assert made.talk.refusals("CAL:SEC:STAT OFF,HP034401") == [703]
    made.talk.write("CAL:SEC:STAT OFF,ZZ9")
    assert made.talk.ask("CAL:SEC:STAT?") == "0"


def test_the_count_starts_again_after_its_limit() -> None:
    made = unsecured()
    made.meter.calibration.count = 32767
    made.world.offset_v = 10.0
    assert made.talk.ask("CONF:VOLT:DC 10;:CAL:VAL 10;:CAL?;COUN?") == "+0"
