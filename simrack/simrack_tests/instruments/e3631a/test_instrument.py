"""The simulated E3631A against the facts of its User's Guide."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from simrack.instruments.e3631a import E3631ATwin, OutputErrors, SupplyErrors
from simrack.sources import Ripple, Sine

from simrack_tests.instruments.conversation import Conversation
from simrack_tests.instruments.fake_world import FakeWorld


class Bench(NamedTuple):
    world: FakeWorld
    supply: E3631ATwin
    talk: Conversation


def bench(errors: SupplyErrors | None = None, interface: str = "gpib") -> Bench:
    world = FakeWorld()
    supply = E3631ATwin(world, errors=errors or SupplyErrors.none(), interface=interface)  # type: ignore[arg-type]
    world.clock.attend(supply)
    return Bench(world, supply, Conversation(supply, world.clock))


RESET = {
    "*IDN?": "HEWLETT-PACKARD,E3631A,0,2.1-5.0-1.0",
    "SYST:VERS?": "1995.0",
    "INST?": "P6V",
    "INST:NSEL?": "1",
    "INST:COUP?": "NONE",
    "APPL?": '"0.000000,5.000000"',
    "APPL? P25V": '"0.000000,1.000000"',
    "APPL? N25V": '"0.000000,1.000000"',
    "VOLT?": "+0.00000000E+00",
    "VOLT? MIN": "+0.00000000E+00",
    "VOLT? MAX": "+6.18000000E+00",
    "CURR?": "+5.00000000E+00",
    "CURR? MAX": "+5.15000000E+00",
    "VOLT:TRIG?": "+0.00000000E+00",
    "CURR:TRIG?": "+5.00000000E+00",
    "OUTP?": "0",
    "OUTP:TRAC?": "0",
    "TRIG:SOUR?": "BUS",
    "TRIG:DEL?": "+0.00000000E+00",
    "TRIG:DEL? MAX": "+3.60000000E+03",
    "DISP?": "1",
    "DISP:TEXT?": '""',
    "STAT:QUES?": "0",
    "STAT:QUES:INST:ISUM3:COND?": "0",
    "CAL:SEC:STAT?": "1",
    "*TST?": "0",
    "SYST:ERR?": '+0,"No error"',
}


@pytest.mark.parametrize("query", RESET)
def test_replies_at_power_on_and_after_reset(query: str) -> None:
    talk = bench().talk
    assert talk.ask(query) == RESET[query]
    talk.write("APPL N25V,-3,0.2;:OUTP:TRAC ON;:OUTP ON;:TRIG:SOUR IMM;DEL 3;:DISP OFF;:VOLT:TRIG -1")
    talk.write("INST:COUP P6V,P25V")
    talk.write("*RST")
    talk.settle()
    assert talk.ask(query) == RESET[query]


@pytest.mark.parametrize(
    ("output", "volts", "amps"), [("P6V", 6.18, 5.15), ("P25V", 25.75, 1.03), ("N25V", -25.75, 1.03)]
)
def test_ranges(output: str, volts: float, amps: float) -> None:
    talk = bench().talk
    talk.write(f"INST {output};:VOLT MAX;:CURR MAX")
    assert talk.ask("APPL?") == f'"{volts:.6f},{amps:.6f}"'
    beyond = [f"VOLT {volts * 1.01}", f"VOLT {-volts / 100}", f"CURR {amps * 1.01}", "CURR -0.1"]
    for message in [*beyond, f"APPL {output},{volts * 1.01}", f"APPL {output},1,{amps * 1.01}"]:
        assert talk.refusals(message) == [-222], message
    assert talk.ask("APPL?") == f'"{volts:.6f},{amps:.6f}"'


@pytest.mark.parametrize(
    ("message", "numbers"),
    [
        ("APPL", [-109]),
        ("APPL 5", [-128]),
        ("APPL P6V 1.0 1.0", [-103]),
        ("INST P7V", [-224]),
        ("INST:NSEL 4", [-222]),
        ("OUTP:TRAC #ON", [-101]),
        ("OUTP? 10", [-108]),
        ("OUTP 1, (@2)", [-108]),
        ("OUTP MAYBE", [-224]),
        ("VOL 1", [-113]),
        ("CURREN 1", [-113]),
        ("VOLT:PROT 7", [-113]),
        ("VOLT:RANG P25V", [-113]),
        ("STAT:OPER?", [-113]),
        ("STAT:QUES:INST:ISUM4?", [-114]),
        ("DISP:TEXT 123", [-128]),
        ("DISP:TEXT ON", [-148]),
        ("DISP:TEXT 'ON", [-151]),
        ("*TRG", [-211]),
        ("INIT;INIT", [-213]),
        ("*SAV 0", [-222]),
        ("*RCL 4", [-222]),
        ("SYST:REM", [514]),
        ("SYST:LOC", [514]),
        ("SYST:RWL", [514]),
        ("CAL:STR 'x'", [702]),
        ("CAL:SEC:STAT OFF,WRONG", [703]),
        ("TRIG:DEL 3601", [-222]),
        ("TRIG:SOUR EXT", [-224]),
        ("INST:COUP P25V,N25V;:OUTP:TRAC ON", [801]),
        ("OUTP:TRAC ON;:INST:COUP N25V,P25V", [800]),
        ("OUTP:TRAC ON;:INST:COUP ALL", [800]),
    ],
)
def test_refusals(message: str, numbers: list[int]) -> None:
    assert bench().talk.refusals(message) == numbers


def test_the_words_of_the_errors_of_its_own() -> None:
    talk = bench().talk
    talk.write("SYST:REM;:OUTP:TRAC ON;:INST:COUP ALL")
    talk.settle()
    assert talk.ask("SYST:ERR?") == '+514,"Command allowed only with RS-232"'
    talk.write("OUTP:TRAC ON;:INST:COUP ALL")
    talk.settle()
    assert talk.ask("SYST:ERR?") == '+800,"P25V and N25V coupled by track system"'


def test_all_outputs_go_on_together_and_reach_the_rails() -> None:
    world, _, talk = bench()
    talk.write("APPL P25V,10,0.5")
    talk.write("APPL N25V,-10,0.5")
    assert world.rails == []
    talk.write("OUTP ON")
    talk.settle()
    assert (world.rail_v("positive"), world.rail_v("negative")) == (10.0, -10.0)
    assert talk.ask("MEAS:VOLT? P25V") == "+1.00000000E+01"
    assert talk.ask("MEAS:CURR? P25V") == "+1.00000000E-01"
    assert talk.ask("MEAS? N25V") == "-1.00000000E+01"
    assert talk.ask("MEAS? P6V") == "+0.00000000E+00"
    assert talk.ask("INST?") == "N25V"
    talk.write("OUTP OFF")
    talk.settle()
    assert (world.rail_v("positive"), world.rail_v("negative")) == (0.0, 0.0)


def test_timing() -> None:
    """Programming acts after 50 ms, a rise settles to 1 % in 20 ms (no load) to 50 ms (full), a fall in 400 ms."""
    world, _, talk = bench()
    world.load_ohm["positive"] = 1e9
    talk.write("APPL P25V,20,1;:OUTP ON")
    talk.settle()
    assert world.rail_v("positive", 0.1 - 1e-9) == 0.0
    assert world.rail_v("positive", 0.1 + 0.02) == pytest.approx(0.99 * 20.0, abs=1e-6)
    assert world.rail_v("positive") == 20.0
    start = world.clock.now()
    talk.write("OUTP OFF")
    talk.settle()
    assert world.rail_v("positive", start + 0.05 - 1e-9) == 20.0
    assert world.rail_v("positive", start + 0.05 + 0.4) == pytest.approx(0.01 * 20.0, abs=1e-6)
    assert world.rail_v("positive") == 0.0
    start = world.clock.now()
    talk.ask("MEAS?")
    assert world.clock.now() - start == pytest.approx(0.1)


def test_the_ramp_happens_at_its_own_time_when_nobody_asks() -> None:
    world, _, talk = bench()
    talk.write("APPL P25V,10,1;:OUTP ON")
    world.clock.sleep_until(10.0)
    assert world.rails[-1][0] < 0.2
    assert world.rail_v("positive") == 10.0


@given(st.floats(2.0, 1000.0), st.floats(0.01, 1.0))
def test_constant_voltage_or_constant_current(ohm: float, limit: float) -> None:
    world, _, talk = bench()
    world.load_ohm["positive"] = ohm
    talk.write(f"APPL P25V,10,{limit!r};:OUTP ON")
    talk.settle()
    limited = 10.0 / ohm > limit
    expected = limit * ohm if limited else 10.0
    assert world.rail_v("positive") == pytest.approx(expected, rel=1e-9)
    assert float(talk.ask("MEAS:CURR?") or "nan") == pytest.approx(min(limit, 10.0 / ohm), rel=1e-8)
    assert talk.ask("STAT:QUES:INST:ISUM2:COND?") == ("1" if limited else "2")


def test_constant_current_reaches_the_status_byte() -> None:
    world, supply, talk = bench()
    talk.write("STAT:QUES:INST:ISUM2:ENAB 1;:STAT:QUES:INST:ENAB 14;:STAT:QUES:ENAB 8192;:*SRE 8")
    talk.write("APPL P25V,10,0.5;:OUTP ON")
    talk.settle()
    assert not supply.requests_service()
    world.load_ohm["positive"] = 4.0
    assert supply.status_byte() == 8 + 64
    assert talk.ask("STAT:QUES?;QUES:INST?;INST:ISUM2?") == "8192;4;3"
    assert supply.status_byte() == 0


def test_tracking() -> None:
    talk = bench().talk
    talk.write("APPL P25V,12,1;:OUTP:TRAC ON")
    talk.settle()
    assert talk.ask("APPL? N25V") == '"-12.000000,1.000000"'
    talk.write("INST N25V;:VOLT -5;:CURR 0.2")
    talk.settle()
    assert talk.ask("APPL? P25V") == '"5.000000,1.000000"'
    assert talk.ask("APPL? N25V") == '"-5.000000,0.200000"'


def test_triggered_levels() -> None:
    world, _, talk = bench()
    talk.write("INST P25V;:VOLT:TRIG 4;:CURR:TRIG 0.3;:TRIG:DEL 2;:INIT")
    assert talk.ask("APPL?") == '"0.000000,1.000000"'
    assert talk.ask("VOLT:TRIG?") == "+4.00000000E+00"
    start = world.clock.now()
    talk.write("*TRG")
    assert talk.ask("*OPC?") == "1"
    assert world.clock.now() - start == pytest.approx(2.0)
    assert talk.ask("APPL?") == '"4.000000,0.300000"'
    talk.write("TRIG:SOUR IMM;:INST:COUP ALL;:VOLT:TRIG 1;:INST P6V;:VOLT:TRIG 2;:INIT")
    assert talk.ask("APPL? P25V") == '"1.000000,0.300000"'
    assert talk.ask("APPL? P6V") == '"2.000000,5.000000"'
    assert talk.errors() == []


def test_stored_states() -> None:
    talk = bench().talk
    talk.write("APPL P25V,7,0.5;:OUTP ON;:TRIG:SOUR IMM;:*SAV 2;*RST")
    talk.write("*RCL 2")
    talk.settle()
    assert talk.ask("APPL?;:OUTP?;:TRIG:SOUR?") == '"7.000000,0.500000";1;IMM'
    talk.write("*RCL 3")
    talk.settle()
    assert talk.ask("APPL?;:OUTP?;:TRIG:SOUR?") == '"0.000000,5.000000";0;BUS'


def test_rs232_needs_remote_and_answers_with_crlf() -> None:
    world, supply, talk = bench(interface="rs232")
    assert talk.refusals("VOLT 1") == [550]
    assert talk.refusals("SYST:REM;:VOLT 1") == []
    supply.write(b"VOLT?\n")
    world.clock.sleep_until(world.clock.now() + 1)
    assert supply.read(100)[0] == b"+1.00000000E+00\r\n"


def test_calibration_is_guarded() -> None:
    talk = bench().talk
    assert talk.refusals("CAL:SEC:STAT OFF,HP003631;:CAL:STR 'done'") == []
    assert talk.ask("CAL:STR?;SEC:STAT?") == '"done";0' or talk.errors() == [-113]
    assert talk.refusals(f"CAL:STR '{'x' * 41}'") == [-223]
    assert talk.refusals("CAL:SEC:CODE NEWCODE;:CAL:SEC:STAT ON,NEWCODE;:CAL:VOLT 1") == [702]


def test_every_error_of_a_specimen_shows() -> None:
    output = OutputErrors(
        programming_gain=1e-3,
        programming_offset_v=5e-3,
        current_programming_gain=2e-3,
        current_programming_offset_a=1e-3,
        readback_gain=-1e-3,
        readback_offset_v=2e-3,
        current_readback_gain=1e-2,
        current_readback_offset_a=1e-3,
        resistance_ohm=0.1,
    )
    world, _, talk = bench(SupplyErrors(p25v=output))
    talk.write("APPL P25V,10,1;:OUTP ON")
    talk.settle()
    current = 10.015 / 100.0
    true = 10.015 - 0.1 * current
    assert world.rail_v("positive") == pytest.approx(true, rel=1e-12)
    assert float(talk.ask("MEAS?") or "nan") == pytest.approx(true * 0.999 + 2e-3, rel=1e-8)
    assert float(talk.ask("MEAS:CURR?") or "nan") == pytest.approx(current * 1.01 + 1e-3, rel=1e-8)
    world.load_ohm["positive"] = 2.0
    assert float(talk.ask("MEAS:CURR?") or "nan") == pytest.approx((1.002 + 1e-3) * 1.01 + 1e-3, rel=1e-8)


def test_specimens_stay_within_the_published_accuracy() -> None:
    rng = np.random.default_rng(1)
    for _ in range(200):
        errors = SupplyErrors.drawn(rng)
        assert abs(errors.p25v.programming_gain) < 1.5 * 0.5e-3
        assert abs(errors.n25v.programming_offset_v) < 1.5 * 20e-3
        assert abs(errors.p6v.current_programming_offset_a) < 1.5 * 10e-3
    again, same = (SupplyErrors.drawn(np.random.default_rng(7)) for _ in range(2))
    assert again == same


def test_readings_come_in_steps() -> None:
    talk = bench(SupplyErrors(quantised=True)).talk
    talk.write("APPL P25V,10.0004,1;:OUTP ON")
    talk.settle()
    volts = float(talk.ask("MEAS?") or "nan")
    assert math.isclose(volts / 1.5e-3, round(volts / 1.5e-3), rel_tol=1e-9)


def test_a_load_that_changes_by_itself_is_felt_at_once() -> None:
    world, supply, talk = bench()
    talk.write("APPL P25V,10,0.5;:OUTP ON;:STAT:QUES:INST:ISUM2:ENAB 3")
    talk.settle()
    world.load_ohm["positive"] = 5.0
    world.on_load_change()
    talk.clock.sleep_until(talk.clock.now() + 0.1)
    assert world.rail_v("positive") == pytest.approx(2.5)
    assert talk.ask("STAT:QUES:INST:ISUM2:COND?") == "1"
    assert talk.ask("STAT:QUES:INST:ISUM2?") == "3"  # was in constant voltage, and went to constant current
    world.load_ohm["positive"] = 100.0  # lets go without a word, as a PCB that has started
    wake = supply.wake_at()
    assert wake is not None
    talk.clock.sleep_until(wake + 0.2)
    supply.wake_at()
    assert world.rail_v("positive") == pytest.approx(10.0)
    assert supply.wake_at() is None


def test_the_voltage_sags_with_the_load_and_follows_the_line() -> None:
    errors = SupplyErrors(p25v=OutputErrors(resistance_ohm=2e-3, sag=1e-4, line_gain=5e-5))
    world, _, talk = bench(errors)
    world.load_ohm["positive"] = 20.0
    talk.write("APPL P25V,20,1.02;:OUTP ON")
    talk.settle()
    assert world.rail_v("positive") == pytest.approx(20.0 * (1 + 5e-5) - 2e-3 - 2e-3, abs=1e-6)


def test_ripple_is_there_while_the_output_is_on() -> None:
    world, _, talk = bench(SupplyErrors(n25v=OutputErrors(ripple_v=0.2e-3, ripple_phase_rad=1.0)))
    talk.write("APPL N25V,-10,0.5;:APPL P25V,10,0.5;:OUTP ON")
    talk.settle()
    assert world.ripples == {"negative": Ripple(0.2e-3, 100.0, 1.0)}
    talk.write("OUTP OFF")
    talk.settle()
    assert world.ripples == {"negative": None}


@pytest.mark.parametrize("seed", range(5))
def test_ripple_of_a_specimen_is_below_0_35_mv_rms(seed: int) -> None:
    """By the sum of its sines over 2 s; the second, third and fourth harmonic are there, and no line is as large."""
    drawn = SupplyErrors.drawn(np.random.default_rng(seed))
    times = np.arange(0.0, 2.0, 2e-5)
    for errors in (drawn.p6v, drawn.p25v, drawn.n25v):
        ripple = errors.ripple()
        volts = Sine(math.sqrt(2.0) * ripple.rms_v, ripple.frequency_hz, 0.3).at(times)
        volts = volts + sum(each.at(times) for each in ripple.beside)
        assert 0.1e-3 < float(volts.std()) < 0.35e-3
        assert float(np.ptp(volts)) < 2e-3
        sizes = {each.frequency_hz: each.amplitude_v for each in ripple.beside}
        assert {200.0, 300.0, 400.0} < set(sizes)
        assert sizes[200.0] * 2 == pytest.approx(sizes[400.0] * 4)
        assert sum(sizes[hertz] ** 2 for hertz in (200.0, 300.0, 400.0)) / 2 == pytest.approx(
            errors.ripple_harmonics_v**2
        )
        noise = sum(size**2 for hertz, size in sizes.items() if hertz not in (200.0, 300.0, 400.0)) / 2
        assert noise == pytest.approx(errors.noise_v**2)


def test_a_drawn_specimen_has_ripple_within_its_limit() -> None:
    drawn = SupplyErrors.drawn(np.random.default_rng(4))
    assert all(0.1e-3 <= each.ripple_v <= 0.35e-3 for each in (drawn.p6v, drawn.p25v, drawn.n25v))
    assert len({each.ripple_phase_rad for each in (drawn.p6v, drawn.p25v, drawn.n25v)}) == 3


def test_a_fan_that_stops_is_in_the_questionable_status() -> None:
    supply, talk = bench()[1:]
    (fan,) = supply.adjustments()
    talk.write("*CLS;:STAT:QUES:ENAB 16;:APPL P25V,10,0.5;:OUTP ON")
    talk.settle()
    assert (fan.read(), supply.status_byte()) == (False, 0)
    assert fan.write is not None
    fan.write(True)  # noqa: FBT003
    assert (fan.read(), supply.status_byte()) == (True, 8)
    assert talk.ask("STAT:QUES?") == "16"
    assert talk.ask("STAT:QUES?") == "0"  # it says so once
    assert talk.ask("OUTP?") == "1"
