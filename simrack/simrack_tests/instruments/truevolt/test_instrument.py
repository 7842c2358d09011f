"""The simulated 34461A and 34465A: what their expectation files cannot say."""

from __future__ import annotations

import numpy as np
import pytest
from simrack.instruments.hp34401a import Hp34401ATwin, MeterErrors
from simrack.instruments.keithley import Keithley2000Twin, KeithleyDMM6500Twin
from simrack.instruments.truevolt import Keysight34461ATwin, Keysight34465ATwin, SimulatedTruevolt

from simrack_tests.instruments.conversation import Conversation
from simrack_tests.instruments.fake_world import FakeWorld

MODELS = [Keysight34461ATwin, Keysight34465ATwin]


class Bench:
    def __init__(self, kind: type[SimulatedTruevolt], errors: MeterErrors | None = None, **more: str) -> None:
        self.world = FakeWorld()
        self.world.offset_v = 1.0
        self.meter = kind(self.world, errors=errors or MeterErrors.none(), **more)  # type: ignore[arg-type]
        self.world.clock.attend(self.meter)
        self.talk = Conversation(self.meter, self.world.clock)

    def value(self, query: str) -> float:
        return float(self.talk.ask(query) or "nan")

    def duration_s(self, query: str) -> float:
        self.talk.settle()
        start = self.world.clock.now()
        assert self.talk.ask(query) is not None
        return self.world.clock.now() - start


@pytest.mark.parametrize("kind", MODELS)
def test_it_reads_the_mean_over_the_aperture(kind: type[SimulatedTruevolt]) -> None:
    bench = Bench(kind)
    bench.world.slope_v_s = 0.1
    bench.talk.write("CONF:VOLT:DC 10;:TRIG:DEL 0")
    bench.talk.settle()
    middle_s = bench.world.clock.now() + 0.02 + 0.2 / 2  # 20 ms until it waits for a trigger
    assert bench.value("READ?") == pytest.approx(1.0 + 0.1 * middle_s)


@pytest.mark.parametrize(("nplc", "aperture_s"), [(0.02, 0.3e-3), (0.2, 3e-3), (1.0, 0.02), (10.0, 0.2)])
def test_apertures_of_a_34461a_are_the_guides(nplc: float, aperture_s: float) -> None:
    """Guide p. 452, 50 Hz."""
    assert Bench(Keysight34461ATwin).meter.inputs.aperture_s(nplc) == pytest.approx(aperture_s)


@pytest.mark.parametrize("kind", MODELS)
def test_autozero_doubles_the_time_of_a_reading(kind: type[SimulatedTruevolt]) -> None:
    bench = Bench(kind)
    bench.talk.write("CONF:VOLT:DC 10;:VOLT:DC:NPLC 100")
    with_zero_s = bench.duration_s("READ?")
    bench.talk.write("VOLT:DC:ZERO:AUTO OFF")
    assert with_zero_s - bench.duration_s("READ?") == pytest.approx(2.0)


def test_an_integration_time_in_seconds_is_kept() -> None:
    bench = Bench(Keysight34465ATwin)
    bench.talk.write("CONF:VOLT:DC 10;:VOLT:DC:ZERO:AUTO OFF;:VOLT:DC:APER 0.3")
    longer_s = bench.duration_s("READ?")
    bench.talk.write("VOLT:DC:APER 0.1")
    assert longer_s - bench.duration_s("READ?") == pytest.approx(0.2)
    assert 1e-7 < bench.value("VOLT:DC:RES?") / 10.0 < 3e-7  # between those of 10 and of 1 PLC


@pytest.mark.parametrize("kind", MODELS)
def test_noise_and_steps_go_with_the_resolution(kind: type[SimulatedTruevolt]) -> None:
    bench = Bench(kind, MeterErrors(noise=0.3, quantised=True))
    bench.talk.write("CONF:VOLT:DC 10;:SAMP:COUN 200")
    readings = np.array([float(each) for each in (bench.talk.ask("READ?") or "").split(",")])
    resolution_v = kind.kind.sheet.resolution_v(10.0, 10.0)
    assert readings.std() == pytest.approx(0.3 * resolution_v, rel=0.25)
    assert (readings - 1.0) / (resolution_v / 10) == pytest.approx(
        np.round((readings - 1.0) / (resolution_v / 10)), abs=1e-3
    )


@pytest.mark.parametrize("kind", MODELS)
def test_specimens_scatter_as_the_data_sheet_of_the_model_says(kind: type[SimulatedTruevolt]) -> None:
    """What budgets take from it: two standard deviations within the limits."""
    drawn = [kind.errors_class.drawn(np.random.default_rng(seed)) for seed in range(400)]
    limit = kind.kind.sheet.accuracy_of(10.0, 365)
    assert kind.kind.sheet.limit_sigmas == 2.0
    assert np.std([each.gain_error for each in drawn]) == pytest.approx(limit.reading / 2.0, rel=0.15)
    assert np.std([each.offset_v for each in drawn]) == pytest.approx(10.0 * limit.range / 2.0, rel=0.15)
    assert drawn[7].input_ohm == MeterErrors.drawn(np.random.default_rng(7)).input_ohm


def test_null_statistics_and_limits_are_on_at_once() -> None:
    bench = Bench(Keysight34461ATwin)
    bench.talk.write("CONF:VOLT:DC 10;:VOLT:NULL ON;:CALC:AVER ON;:CALC:LIM:LOW -0.5;UPP 0.5;:CALC:LIM ON")
    assert bench.value("READ?") == 0.0  # the first reading becomes the null value
    bench.world.offset_v = 2.0
    assert bench.value("READ?") == 1.0
    assert bench.talk.ask("CALC:AVER:ALL?") == "+5.00000000E-01,+7.07106781E-01,+0.00000000E+00,+1.00000000E+00"
    assert bench.talk.ask("CALC:AVER:PTP?;COUN?") == "+1.00000000E+00;+2.00000000E+00"
    assert bench.talk.ask("STAT:QUES?") == "+4096"
    assert bench.talk.ask("VOLT:NULL:VAL?") == "+1.00000000E+00"
    bench.talk.write("VOLT:NULL:VAL 0.5")
    assert bench.value("READ?") == 1.5
    bench.talk.write("CONF:VOLT:DC 10")
    assert bench.value("READ?") == 2.0
    assert bench.talk.errors() == []


def test_autorange_once_takes_the_range_of_the_signal_and_stays() -> None:
    bench = Bench(Keysight34465ATwin)
    bench.world.offset_v = 0.05
    bench.talk.write("VOLT:RANG:AUTO ONCE")
    assert bench.talk.ask("VOLT:RANG?;RANG:AUTO?") == "+1.00000000E-01;0"
    assert bench.talk.ask("MEAS:VOLT:DC? AUTO") == "+5.00000000E-02"
    assert bench.talk.ask("VOLT:RANG:AUTO?") == "1"
    bench.talk.write("CONF:VOLT:DC AUTO,0.001")
    assert bench.talk.errors() == [-221]


def test_an_overload_is_told_as_one() -> None:
    bench = Bench(Keysight34461ATwin)
    bench.talk.write("CONF:VOLT:DC 0.1")
    assert bench.talk.ask("READ?") == "+9.90000000E+37"
    assert bench.talk.ask("STAT:QUES?") == "+1"


def test_it_calls_itself_what_the_bench_calls_it() -> None:
    assert (Bench(Keysight34465ATwin, model="34470A").talk.ask("*IDN?") or "").split(",")[1] == "34470A"
    assert (Bench(Keysight34465ATwin).talk.ask("*IDN?") or "").split(",")[1] == "34465A"


@pytest.mark.parametrize(
    ("kind", "query"),
    [
        *((each, query) for each in MODELS for query in ("MEAS:TEMP?", "MEAS:TEMP? TC,K", "MEAS:TEMP? FRTD,85,1,0.1")),
        *((each, "MEAS:CAP? 1E-6") for each in MODELS),
        *((each, "MEAS:TEMP?") for each in (KeithleyDMM6500Twin, Keithley2000Twin)),
        (KeithleyDMM6500Twin, "MEAS:CAP?"),
    ],
)
def test_there_is_no_probe_and_no_capacitor(kind: type[SimulatedTruevolt], query: str) -> None:
    assert Bench(kind).value(query) == 9.9e37


def test_each_function_has_its_own_null() -> None:
    bench = Bench(Keysight34461ATwin)
    bench.talk.write("VOLT:NULL:VAL 0.25;STAT ON;:RES:NULL:STAT ON;:FREQ:NULL:VAL 3")
    assert [bench.value(f"{each}:NULL:VAL?") for each in ("VOLT", "RES", "FREQ")] == [0.25, 0.0, 3.0]
    assert bench.value('FUNC "VOLT";:READ?') == pytest.approx(0.75)
    assert bench.talk.ask("VOLT:AC:NULL:STAT?;:CURR:NULL:STAT?") == "0;0"


def test_2000_reports_buffer_statistics_and_broken_limits() -> None:
    bench = Bench(Keithley2000Twin)
    bench.world.slope_v_s = 0.1
    bench.talk.write("INIT:CONT OFF;:TRAC:POIN 5;FEED SENS;FEED:CONT NEXT;:SAMP:COUN 5;:INIT")
    bench.world.clock.sleep_until(bench.world.clock.now() + 10.0)
    readings = [float(each) for each in (bench.talk.ask("TRAC:DATA?") or "").split(",")]
    expected = {"MEAN": np.mean(readings), "SDEV": np.std(readings, ddof=1), "MAX": max(readings), "MIN": min(readings)}
    for kind, value in expected.items():
        assert bench.value(f"CALC2:FORM {kind};:CALC2:IMM?") == pytest.approx(value, rel=1e-6)
    bench.talk.write(f"CALC3:LIM2:UPP {readings[-1] + 0.01}")
    assert bench.talk.ask("CALC3:LIM1:FAIL?;:CALC3:LIM2:FAIL?") == "1;0"


def test_a_34465a_takes_samples_by_its_timer() -> None:
    bench = Bench(Keysight34465ATwin)
    bench.world.slope_v_s = 0.1
    bench.talk.write("CONF:VOLT:DC 10;:VOLT:NPLC 1;ZERO:AUTO OFF;:TRIG:DEL 0;:SAMP:COUN 4;SOUR TIM;TIM 0.5")
    assert bench.value("SAMP:TIM? MIN") == pytest.approx(0.02)
    readings = [float(each) for each in (bench.talk.ask("READ?") or "").split(",")]
    assert np.diff(readings) == pytest.approx([0.05] * 3, abs=1e-5)
    bench.talk.write("SAMP:TIM 0.001")
    assert bench.talk.errors() == [-222]


@pytest.mark.parametrize(("kind", "word"), [(KeithleyDMM6500Twin, "REL"), (Keithley2000Twin, "REF")])
def test_what_a_keithley_acquires_is_taken_off_later_readings(kind: type[SimulatedTruevolt], word: str) -> None:
    bench = Bench(kind)
    bench.talk.write(f"INIT:CONT OFF;:VOLT:{word}:ACQ;STAT ON" if word == "REF" else f"VOLT:{word}:ACQ;STAT ON")
    assert bench.value(f"VOLT:{word}?") == 1.0
    bench.world.offset_v = 1.25
    assert bench.value("READ?") == pytest.approx(0.25)
    bench.talk.write(f"VOLT:{word}:ACQ")
    assert bench.value(f"VOLT:{word}?") == 1.25
    assert bench.value("READ?") == 0.0
    assert "No error" in (bench.talk.ask("SYST:ERR?") or "")


@pytest.mark.parametrize("kind", MODELS)
def test_device_clear_ends_an_infinite_wait(kind: type[SimulatedTruevolt]) -> None:
    bench = Bench(kind)
    bench.talk.write("CONF:VOLT:DC 10;:TRIG:SOUR BUS;:INIT")
    bench.talk.write("FETC?")
    bench.meter.clear()
    assert bench.talk.ask("*OPC?") == "1"


def test_tsp_line_gets_error_at_once() -> None:
    talk = Bench(KeithleyDMM6500Twin).talk
    assert talk.ask("print(dmm.measure.read())") == "TSP is not simulated, the command set is SCPI"
    talk.write("dmm.measure.func = dmm.FUNC_DC_VOLTAGE")
    told = '-113,"Undefined header; TSP is not simulated'
    assert [str(talk.ask("SYST:ERR?"))[: len(told)] for _ in range(2)] == [told, told]
    assert str(talk.ask("SYST:ERR?")).startswith("0,")


CHANGING = [
    *((kind, "CALC:SCAL", "CALC:SCAL:FUNC DB") for kind in MODELS),
    *((kind, each, "CALC:LIM:LOW 2") for kind in MODELS for each in ("CALC:AVER", "CALC:LIM", "VOLT:NULL")),
    (Keysight34465ATwin, "CALC:SMO", "VOLT:NPLC 1"),
    (Hp34401ATwin, "CALC:STAT", "CALC:FUNC DB"),
    (Keithley2000Twin, "CALC:STAT", "CALC:FORM MXB;KMAT:MMF 3"),
    *((Keithley2000Twin, each, "INIT:CONT OFF") for each in ("CALC2:STAT", "CALC3:LIM1:STAT", "VOLT:REF:STAT")),
]
"""Switches of what changes or judges readings, after some setting of it."""


@pytest.mark.parametrize(("kind", "switch", "setting"), CHANGING)
@pytest.mark.parametrize("configured", ["MEAS:VOLT:DC?", "CONF:VOLT:DC;:READ?"])
def test_configuring_switches_mathematics_off(
    kind: type[SimulatedTruevolt], switch: str, setting: str, configured: str
) -> None:
    bench = Bench(kind)
    bench.world.offset_v = 0.5
    bench.talk.write(f"{setting};:{switch} ON")
    assert bench.talk.ask(f"{switch}?") == "1"
    assert bench.value(configured) == 0.5
    assert bench.talk.ask(f"{switch}?") == "0"


@pytest.mark.parametrize("kind", MODELS)
def test_another_function_switches_scaling_off_and_keeps_its_factors(kind: type[SimulatedTruevolt]) -> None:
    bench = Bench(kind)
    bench.talk.write("CALC:SCAL:GAIN 3;FUNC SCAL;:CALC:SCAL ON;:RES:NULL ON;:FUNC 'VOLT:AC'")
    assert bench.talk.ask("CALC:SCAL?;:CALC:SCAL:GAIN?;:RES:NULL?") == "0;+3.00000000E+00;1"


def test_configuring_presets_what_triggers() -> None:
    bench = Bench(Keysight34465ATwin)
    bench.talk.write("SAMP:COUN 5;COUN:PRET 3;:SAMP:SOUR TIM;:TRIG:COUN 4;LEV 1;DEL 2;SLOP POS;SOUR BUS;:CONF:VOLT:DC")
    asked = "SAMP:COUN?;COUN:PRET?;:SAMP:SOUR?;:TRIG:COUN?;LEV?;DEL:AUTO?;:TRIG:SLOP?;SOUR?"
    assert bench.talk.ask(asked) == "+1;+0;IMM;+1.00000000E+00;+0.00000000E+00;1;NEG;IMM"


@pytest.mark.parametrize("continuous", [False, True])
def test_2000_requests_service_when_its_buffer_is_full(continuous: bool) -> None:  # noqa: FBT001
    """As PyMeasure's config_buffer, start_buffer and wait_for_buffer have it."""
    bench = Bench(Keithley2000Twin)
    bench.talk.write("" if continuous else "*RST")
    bench.talk.write(
        ":STAT:PRES;*CLS;*SRE 1;:STAT:MEAS:ENAB 512;:TRAC:CLE;:TRAC:POIN 10;:TRIG:COUN 10;:TRIG:SEQ1:DEL 0"
    )
    bench.talk.write(":TRAC:FEED SENSE1;:TRAC:FEED:CONT NEXT;")
    assert bench.talk.ask("*STB?;:TRAC:FEED?") == "+0;SENS"
    bench.talk.write("" if continuous else ":INIT")
    bench.world.clock.sleep_until(bench.world.clock.now() + 20.0)
    assert bench.talk.ask("*STB?;:STAT:MEAS:COND?") == "+65;+896"
    bench.talk.write("STAT:PRES;:TRAC:CLE")
    assert bench.talk.ask("*STB?;:STAT:MEAS:COND?") == "+0;+0"


def test_2000_tells_of_each_reading_and_of_its_limits() -> None:
    bench = Bench(Keithley2000Twin)
    bench.talk.write("*RST;:CALC3:LIM1:UPP 0.9;STAT ON")
    for offset_v, bits in ((0.5, 32), (1.0, 36), (-2.0, 34)):
        bench.world.offset_v = offset_v
        assert bench.talk.ask("READ?")
        assert bench.talk.ask("STAT:MEAS?;:STAT:MEAS?") == f"+{bits};+0"
    bench.talk.write("VOLT:RANG 0.1")
    assert bench.talk.ask("READ?;:STAT:MEAS?") == "-9.90000000E+37;+35"
