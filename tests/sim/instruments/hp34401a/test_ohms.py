"""Resistance, continuity, diode test and current of the simulated 34401A."""

from __future__ import annotations

import math

import numpy as np
import pytest
from simrack.instruments.hp34401a import Hp34401ATwin, MeterErrors
from simrack.instruments.hp34401a.imperfections import CurrentErrors, OhmsErrors
from simrack.leads import Leads
from simrack.sources import Drive
from simrack_tests.instruments.conversation import Conversation
from simrack_tests.instruments.hp34401a.bench import MeterBench, bench, specimens

from vcfbench.clock import VirtualClock
from vcfbench.sim.gyro.design import ideal_bench
from vcfbench.sim.world import World

ONE_YEAR = {  # p. 216, parts of reading and range
    1e2: (1e-4, 4e-5),
    1e3: (1e-4, 1e-5),
    1e4: (1e-4, 1e-5),
    1e5: (1e-4, 1e-5),
    1e6: (1e-4, 1e-5),
    1e7: (4e-4, 1e-5),
    1e8: (8e-3, 1e-4),
}


def resistor(
    ohm: float, node_v: float = 0.0, errors: MeterErrors | None = None, sense: str | None = None
) -> MeterBench:
    made = bench(errors, sense=sense)
    made.world.resistance_ohm, made.world.offset_v = ohm, node_v
    return made


@pytest.mark.parametrize("ohm", [0.0, 47.0, 100.0, 999.0, 1201.0, 33e3, 0.99e6, 4.7e6, 22e6, 110e6])
@pytest.mark.parametrize("function", ["RES", "FRES"])
def test_autorange_reads_value_of_resistor(ohm: float, function: str) -> None:
    made = resistor(ohm, sense="output")
    assert made.value(f"MEAS:{function}?") == pytest.approx(ohm, rel=1e-8, abs=1e-9)
    assert ohm <= 1.2 * made.value(f"{function}:RANG?")


@pytest.mark.parametrize("range_ohm", ONE_YEAR)
def test_twenty_percent_over_range_and_no_more(range_ohm: float) -> None:
    made = resistor(1.19 * range_ohm)
    made.talk.write(f"CONF:RES {range_ohm}")
    assert made.value() == pytest.approx(1.19 * range_ohm)
    made.world.resistance_ohm = 1.21 * range_ohm
    assert made.talk.ask("READ?") == "+9.90000000E+37"
    assert made.talk.ask("STAT:QUES?") == "+512"


@pytest.mark.parametrize(
    ("range_ohm", "current_a"), [(100, 1e-3), (1e3, 1e-3), (1e4, 1e-4), (1e5, 1e-5), (1e6, 5e-6), (1e7, 5e-7)]
)
def test_node_under_voltage_reads_voltage_over_test_current(range_ohm: float, current_a: float) -> None:
    """Ohm's law: (V + I R)/I; a negative one reads negative."""
    for node_v in (0.3 * range_ohm * current_a, -0.3 * range_ohm * current_a):
        made = resistor(0.5 * range_ohm, node_v)
        made.talk.write(f"CONF:RES {range_ohm}")
        assert made.value() == pytest.approx(0.5 * range_ohm + node_v / current_a, rel=1e-8)


def test_five_volts_overload_all_ranges_but_small_currents() -> None:
    """5 V are 1 Mohm at 5 uA and 10 Mohm at 0.5 uA; beside 10 Mohm they leave no current."""
    made = resistor(50.0, 5.0)
    overloads = []
    for range_ohm in ONE_YEAR:
        made.talk.write(f"CONF:RES {range_ohm}")
        overloads.append(made.value() > 1e37)
    assert overloads == [True, True, True, True, False, False, True]


@pytest.mark.parametrize("query", ["MEAS:RES?", "MEAS:FRES?", "MEAS:CONT?", "MEAS:DIOD?"])
def test_open_leads_overload(query: str) -> None:
    assert resistor(math.inf, sense="output").talk.ask(query) == "+9.90000000E+37"


def test_four_wires_need_the_sense_leads() -> None:
    made = resistor(470.0)
    assert made.talk.ask("MEAS:FRES?") == "+9.90000000E+37"
    assert made.value("MEAS:RES?") == pytest.approx(470.0)


def test_leads_show_with_two_wires_only() -> None:
    made = resistor(47.0, errors=MeterErrors(ohms=OhmsErrors(lead_ohm=0.15)), sense="output")
    assert made.value("MEAS:RES?") == pytest.approx(47.15)
    assert made.value("MEAS:FRES?") == pytest.approx(47.0)
    made.world.resistance_ohm = 0.0
    made.talk.write("CONF:RES 100;:CALC:FUNC NULL;STAT ON")
    made.value()
    made.world.resistance_ohm = 47.0
    assert made.value() == pytest.approx(47.0)


@pytest.mark.parametrize("range_ohm", ONE_YEAR)
def test_errors_are_shares_of_the_published_accuracy_of_the_range(range_ohm: float) -> None:
    of_reading, of_range = ONE_YEAR[range_ohm]
    for errors, change in (
        (OhmsErrors(reading_share=0.5), 0.5 * of_reading * range_ohm),
        (OhmsErrors(range_share=-0.5), -0.5 * of_range * range_ohm),
    ):
        made = resistor(range_ohm, errors=MeterErrors(ohms=errors), sense="output")
        made.talk.write(f"CONF:FRES {range_ohm}")
        assert made.value() - range_ohm == pytest.approx(change, rel=1e-4)


@pytest.mark.parametrize("range_ohm", ONE_YEAR)
def test_a_thousand_specimens_are_within_the_published_accuracy_and_differ(range_ohm: float) -> None:
    """Noise at 100 cycles is far below: 0.3 of 3e-7 of the range."""
    of_reading, of_range = ONE_YEAR[range_ohm]
    ohms = [each.ohms for each in specimens()]
    errors = range_ohm * np.array([each.reading_share * of_reading + each.range_share * of_range for each in ohms])
    limit = (of_reading + of_range) * range_ohm
    assert float(np.abs(errors).max()) <= limit
    assert float(errors.std()) > 0.15 * limit
    leads = [each.lead_ohm for each in ohms]
    assert 0.0 <= min(leads) < 0.01
    assert 0.19 < max(leads) <= 0.2


def test_noise_of_a_resistance_goes_with_its_range() -> None:
    made = resistor(500.0, errors=MeterErrors(noise=0.3, noise_seed=2))
    for range_ohm in (1e3, 1e5):
        made.talk.write(f"CONF:RES {range_ohm};:RES:NPLC 1;:ZERO:AUTO OFF;:SAMP:COUN 400")
        readings = [float(text) for text in (made.talk.ask("READ?") or "").split(",")]
        assert float(np.std(readings)) == pytest.approx(0.3 * 3e-6 * range_ohm, rel=0.12)


def test_continuity_beeps_at_ten_ohms() -> None:
    made = resistor(9.0)
    assert made.value("MEAS:CONT?") == pytest.approx(9.0)
    assert made.meter.beeps == 1
    made.world.resistance_ohm = 11.0
    assert made.value("MEAS:CONT?") == pytest.approx(11.0)
    made.talk.write("SYST:BEEP:STAT OFF")
    made.world.resistance_ohm = 9.0
    made.value("MEAS:CONT?")
    assert made.meter.beeps == 1
    made.world.resistance_ohm = 1300.0
    assert made.value("MEAS:CONT?") > 1e37


def test_three_hundred_continuity_samples_a_second() -> None:
    made = resistor(1.0)
    made.talk.write("CONF:CONT;:TRIG:DEL 0;:SAMP:COUN 300;:ZERO:AUTO OFF")
    made.talk.settle()
    assert made.duration_s("READ?") == pytest.approx(1.02, rel=0.01)


@pytest.mark.parametrize(
    ("ohm", "node_v", "volts", "beeps"), [(0, 0.6, 0.6, 1), (100, 0.0, 0.1, 0), (700, 0.0, 0.7, 1)]
)
def test_the_diode_test_drives_a_milliampere(ohm: float, node_v: float, volts: float, beeps: int) -> None:
    made = resistor(ohm, node_v)
    assert made.value("MEAS:DIOD?") == pytest.approx(volts)
    assert made.meter.beeps == beeps
    made.world.resistance_ohm = 1300.0
    made.talk.write("*CLS")
    assert made.value("MEAS:DIOD?") > 1e37
    assert made.talk.ask("STAT:QUES?") == "+1"


def test_ratio_of_two_inputs() -> None:
    made = bench(sense="output")
    made.world.offset_v = 2.5
    assert made.value("MEAS:VOLT:DC:RAT?") == pytest.approx(1.0)
    made.talk.settle()
    assert made.duration_s("READ?") == pytest.approx(0.02 + 0.0015 + 4 * 0.2)


def test_ratio_reads_zero_of_both_inputs_without_autozero() -> None:
    made = bench(MeterErrors(unzeroed_offset_v=0.5), sense="output")
    made.world.offset_v = 2.5
    made.talk.write("CONF:VOLT:DC:RAT 10;:ZERO:AUTO OFF")
    assert made.value() == pytest.approx(1.0)


def test_a_current_waits_for_the_trigger_delay() -> None:
    made = bench()
    made.talk.write("CONF:CURR:DC 1;:TRIG:DEL 0")
    made.talk.settle()
    at_once = made.duration_s("READ?")
    made.talk.write("TRIG:DEL 2")
    made.talk.settle()
    assert made.duration_s("READ?") == pytest.approx(at_once + 2.0)


@pytest.mark.parametrize(
    ("query", "limit_a"),
    [("MEAS:CURR?", 2e-4 * 0.01), ("MEAS:CURR? 0.1", 5e-5 * 0.1), ("MEAS:CURR? 1", 1e-4), ("MEAS:CURR? 3", 6e-4)],
)
def test_an_open_current_input_reads_its_offset(query: str, limit_a: float) -> None:
    made = bench(MeterErrors(current=CurrentErrors(dc_range_share=-0.4)))
    assert made.value(query) == pytest.approx(-0.4 * limit_a)
    drawn = [each.current.dc_range_share for each in specimens()]
    assert max(map(abs, drawn)) <= 1.0
    assert float(np.std(drawn)) == pytest.approx(0.25, rel=0.1)


def test_an_open_ac_current_input_reads_no_less_than_0() -> None:
    made = bench(MeterErrors(current=CurrentErrors(ac_range_share=-0.4)))
    assert made.value("MEAS:CURR:AC? 1") == pytest.approx(0.4 * 4e-4)
    assert made.talk.errors() == []


@pytest.fixture
def world() -> World:
    return World(VirtualClock(), ideal_bench(), 0)


def test_on_the_world_a_node_presents_what_hangs_on_it(world: World) -> None:
    """V_Vc: the pull-down alone, the generator beside it, a load beside both."""
    talk = Conversation(Hp34401ATwin(world, node="v_vc", errors=MeterErrors.none()), world.clock)
    pull_down = world.parameters.virtual_path.pull_down_ohm
    assert float(talk.ask("MEAS:RES?") or "nan") == pytest.approx(pull_down, rel=1e-6)
    world.drive("v_vc", Drive(0.0, source_ohm=50.0))
    assert float(talk.ask("MEAS:RES?") or "nan") == pytest.approx(1 / (1 / pull_down + 1 / 50), rel=1e-6)
    world.load_node("test", "v_vc", 100.0)
    assert float(talk.ask("MEAS:RES?") or "nan") == pytest.approx(1 / (1 / pull_down + 1 / 50 + 1 / 100), rel=1e-6)


def test_free_lead_is_open_and_powered_node_no_resistor(world: World) -> None:
    leads = Leads(world, "multimeter", {"input": "rail_positive"})
    talk = Conversation(Hp34401ATwin(leads, node="input", errors=MeterErrors.none()), world.clock)
    assert float(talk.ask("MEAS:CONT?") or "nan") == pytest.approx(world.parameters.supply.input_ohm, rel=1e-6)
    world.set_rail("positive", 10.0)
    assert float(talk.ask("MEAS:CONT?") or "nan") > 1e37
    leads.connect("input", None)
    assert float(talk.ask("MEAS:RES?") or "nan") > 1e37
