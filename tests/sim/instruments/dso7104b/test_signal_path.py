"""Coupling, bandwidth limit, skew, rejects, high resolution, peaks and the counter, against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from simrack.instruments.dso7104b import Dso7104BTwin, ScopeErrors
from simrack.leads import Leads
from simrack.sources import Drive, Sine
from simrack_tests.cells import few
from simrack_tests.instruments.dso7104b.bench import Bench, waveform

from vcfbench.clock import VirtualClock
from vcfbench.sim.gyro.design import ideal_bench
from vcfbench.sim.world import World

CORNER_HZ = 3.5
FORMS = ["closed", "sampled"]


def bench_with(form: str, dc_v: float, *sines: Sine) -> Bench:
    """Channel 1 sees sines, known in closed form or only by their volts; an 8 V screen."""
    bench = Bench()
    bench.put("drive", dc_v, *sines)
    if form == "sampled":
        del bench.sines["drive"], bench.finest_s["drive"]
    bench.send(":CHAN1:RANG 8")
    return bench


# --- AC coupling


@pytest.mark.parametrize(
    ("form", "frequency_hz"), [("closed", 0.5), ("closed", 3.5), ("closed", 30.0), ("sampled", 0.5)]
)
def test_ac_coupling_is_a_high_pass_at_3_5_hz(form: str, frequency_hz: float) -> None:
    bench = bench_with(form, 2.0, Sine(1.0, frequency_hz, 0.4))
    bench.send(f":CHAN1:COUP AC;:TIM:RANG {3.3 / frequency_hz!r};:DIG CHAN1")
    gain = 1.0 / abs(1.0 + CORNER_HZ / (1j * frequency_hz))
    assert bench.number(":MEAS:VPP?") == pytest.approx(2.0 * gain, rel=1e-4)
    assert bench.number(":MEAS:VAV? CYCL") == pytest.approx(0.0, abs=1e-4)
    assert len(bench.histories) == 1
    bench.send(":CHAN1:COUP DC")
    assert bench.histories == []  # nobody looks on for ever


@pytest.mark.parametrize("frequency_hz", [1000.0, 123e3])
def test_a_pulse_keeps_its_shape_about_its_long_term_mean(frequency_hz: float) -> None:
    """A tenth of the time 1 V; on a screen of a tenth of a period."""
    bench = Bench()
    bench.nodes["drive"] = lambda t: np.where((t * frequency_hz) % 1.0 < 0.1, 1.0, 0.0)
    bench.send(f":CHAN1:RANG 8;COUP AC;:TIM:RANG {0.1 / frequency_hz!r};:TRIG:LEV 0.3;:DIG CHAN1")
    assert bench.number(":MEAS:VMAX?") == pytest.approx(0.9, abs=3e-3)
    assert bench.number(":MEAS:VMIN?") == pytest.approx(-0.1, abs=3e-3)


def test_the_trigger_sees_the_coupling_of_its_channel() -> None:
    bench = bench_with("closed", 3.0, Sine(1.0, 1000.0, 0.0))
    bench.send(":CHAN1:COUP AC;:TIM:RANG 1E-3;:TRIG:SWE NORM;LEV 0.5;:SING")
    bench.clock.sleep_until(bench.clock.now() + 0.01)
    assert bench.ask(":TER?") == "+1"
    # the trigger is where the sine without its 3 V comes to 0.5 V
    assert math.sin(2e3 * math.pi * bench.scope.shown.record.trigger_s) == pytest.approx(0.5, abs=4e-3)


def test_a_step_before_the_record_is_still_charging_the_capacitor() -> None:
    """V_Vc goes from 0 to 1 V with the channel AC coupled: 45 ms later 1/e of it is left."""
    clock = VirtualClock()
    world = World(clock, ideal_bench(), 0)
    scope = Dso7104BTwin(world, {1: "v_vc"}, ScopeErrors.none())
    world.drive("v_vc", Drive(0.0))
    scope.write(b":CHAN1:RANG 8;COUP AC;:TIM:RANG 1E-3;:TRIG:SWE AUTO;LEV 7\n")
    clock.sleep_until(1.0)
    world.drive("v_vc", Drive(1.0))
    step_v = world.value_v("v_vc")
    assert step_v > 0.5
    clock.sleep_until(1.0 + 1.0 / (2 * math.pi * CORNER_HZ))
    scope.write(b":DIG CHAN1;:MEAS:VAV? DISP\n")
    while not (reply := scope.read(100)[0]):
        wake = scope.wake_at()
        assert wake is not None
        clock.sleep_until(wake)
    seen_s = scope.shown.record.trigger_s - 1.0
    assert float(reply) == pytest.approx(step_v * math.exp(-seen_s * 2 * math.pi * CORNER_HZ), rel=1e-3)


@pytest.mark.parametrize("setup", ["COUP AC", "BWL ON", "COUP AC;BWL ON"])
def test_free_lead_is_at_0_v_behind_filters(setup: str) -> None:
    clock = VirtualClock()
    leads = Leads(World(clock, ideal_bench(), 0), "oscilloscope", {"CHAN1": "drive"})
    scope = Dso7104BTwin(leads, {1: "CHAN1"}, ScopeErrors.none())
    leads.connect("CHAN1", None)
    scope.write(f":CHAN1:{setup};:DIG CHAN1;:MEAS:VPP?\n".encode())
    while not (reply := scope.read(100)[0]):
        wake = scope.wake_at()
        assert wake is not None
        clock.sleep_until(wake)
    assert float(reply) == 0.0


# --- bandwidth limit, skew


@pytest.mark.parametrize(
    ("form", "range_s"), [("closed", 200e-9), ("closed", 20e-6), ("sampled", 200e-9), ("sampled", 20e-6)]
)
def test_the_bandwidth_limit_is_25_mhz(form: str, range_s: float) -> None:
    bench = bench_with(form, 0.5, Sine(1.0, 25e6, 0.3))
    bench.send(f":TIM:RANG {range_s!r};:TRIG:LEV 0.5;:CHAN1:BWL ON;:DIG CHAN1")
    assert bench.number(":MEAS:VPP?") == pytest.approx(math.sqrt(2.0), rel=1e-3)
    assert bench.number(":MEAS:VRMS? AC") == pytest.approx(0.5, rel=1e-3)
    bench.send(":CHAN1:BWL OFF;:DIG CHAN1")
    assert bench.number(":MEAS:VPP?") == pytest.approx(2.0, rel=1e-3)


def test_an_edge_through_the_bandwidth_limit_is_an_exponential() -> None:
    bench = Bench()
    bench.nodes["drive"] = lambda t: np.where((t * 1e5) % 1.0 < 0.5, 1.0, -1.0)
    bench.send(":CHAN1:RANG 4;BWL ON;:TIM:RANG 100E-9;:DIG CHAN1")
    tau_s = 1.0 / (2 * math.pi * 25e6)
    assert bench.number(":MEAS:RIS?") < 100e-9
    bench.send(":WAV:FORM WORD")
    times, volts = waveform(bench)
    after = times > 1e-9  # the trigger is at 0 V, ln 2 time constants after the edge
    assert volts[after] == pytest.approx(1.0 - np.exp(-times[after] / tau_s), abs=0.02)


@pytest.mark.exhaustive
def test_the_trigger_sees_the_bandwidth_limit() -> None:
    bench = bench_with("sampled", 0.0, Sine(1.0, 100e6, 0.0))
    bench.send(":TIM:RANG 1E-6;:TRIG:SWE NORM;LEV 0.5;:CHAN1:BWL ON;:SING")
    bench.clock.sleep_until(bench.clock.now() + 1.1e-3)
    assert bench.ask(":TER?") == "+0"  # a quarter is left
    bench.send(":CHAN1:BWL OFF;:SING")
    bench.clock.sleep_until(bench.clock.now() + 1.1e-3)
    assert bench.ask(":TER?") == "+1"


@pytest.mark.parametrize("skew_s", [50e-9, -80e-9])
def test_skew_shows_a_channel_later(skew_s: float) -> None:
    bench = bench_with("closed", 0.0, Sine(1.0, 1e6, 0.0))
    bench.put("carrier", 0.0, Sine(1.0, 1e6, 0.0))
    bench.send(f":CHAN2:RANG 8;PROB:SKEW {skew_s!r};:TIM:RANG 5E-6;:DIG CHAN1,CHAN2")
    assert bench.number(":MEAS:DEL? CHAN1,CHAN2") == pytest.approx(skew_s, abs=1e-11)
    assert bench.number(":MEAS:PHAS? CHAN1,CHAN2") == pytest.approx(360e6 * skew_s, abs=0.01)
    bench.send(":TRIG:SOUR CHAN2;:DIG CHAN1,CHAN2;:WAV:SOUR CHAN2;FORM WORD")
    times, volts = waveform(bench)
    assert volts[np.abs(times).argmin()] == pytest.approx(0.0, abs=0.02)  # its own edge is the trigger still


# --- rejects


@pytest.mark.exhaustive
@pytest.mark.parametrize("form", FORMS)
def test_hf_reject_attenuates_10_mhz_to_5_mv(form: str) -> None:
    bench = bench_with(form, 0.0, Sine(1.0, 10e6, 0.0))
    for level, triggers in (("0.5", "+0"), ("0.006", "+0"), ("0.004", "+1")):
        bench.send(f":TIM:RANG 1E-3;:TRIG:SWE NORM;HFR ON;LEV {level};:TER?")
        bench.scope.read(100)
        bench.send(":SING")
        bench.clock.sleep_until(bench.clock.now() + 5e-3)
        assert bench.ask(":TER?") == triggers


def test_lf_reject_takes_the_mean_and_what_is_slow() -> None:
    bench = bench_with("closed", 3.0, Sine(1.0, 5e3, 0.0))  # 0.0995 V are left of the sine
    for level, triggers in (("3", "+0"), ("0.11", "+0"), ("0.09", "+1")):
        bench.send(f":TRIG:SWE NORM;COUP LFR;LEV {level};:TER?")
        bench.scope.read(100)
        bench.send(":SING")
        bench.clock.sleep_until(bench.clock.now() + 0.02)
        assert bench.ask(":TER?") == triggers


# --- high resolution, peaks


@pytest.mark.parametrize(
    ("form", "periods"), [("closed", 0.307), ("closed", 19.99), ("sampled", 1.37), ("sampled", 19.99)]
)
def test_high_resolution_averages_the_signal(form: str, periods: float) -> None:
    """Periods of the sine between two points: what is left is the sinc's value."""
    bench = bench_with(form, 0.0, Sine(1.0, periods * 1e6, 0.3))
    bench.send(":TIM:RANG 1E-3;:TRIG:LEV 0.1;:ACQ:TYPE HRES;:DIG CHAN1;:WAV:FORM WORD")
    _, volts = waveform(bench)
    assert volts.std() * math.sqrt(2) == pytest.approx(abs(np.sinc(periods)), rel=0.02, abs=1e-4)
    assert bench.number(":MEAS:VPP?") == pytest.approx(2 * abs(np.sinc(periods)), rel=0.02, abs=1e-4)


@pytest.mark.exhaustive
def test_high_resolution_reduces_noise_by_the_samples_that_there_are() -> None:
    for range_s, samples in ((1e-3, 4000), (5e-6, 20), (200e-9, 1)):
        bench = Bench(ScopeErrors((0.0,) * 4, (0.0,) * 4, (0.0,) * 4, 0.0, 0.1, 0))
        bench.send(f":CHAN3:RANG 8;:TRIG:SOUR CHAN3;:WAV:SOUR CHAN3;FORM WORD;:TIM:RANG {range_s!r};:ACQ:TYPE HRES")
        bench.send(":DIG CHAN3")
        expected = 0.1 / math.sqrt(samples) * (1.0 if range_s > 1e-6 else math.sqrt(2 / 3))
        assert waveform(bench)[1].std() == pytest.approx(expected, rel=0.15)


@pytest.mark.exhaustive
def test_what_peak_detection_shows_is_what_is_measured() -> None:
    bench = Bench()
    bench.nodes["drive"] = lambda t: np.where(np.abs(t % 0.1 - 60.00005e-3) < 1e-6, 1.0, -1.0)  # 2 us in 0.1 s
    bench.send(":CHAN1:RANG 8;:TIM:RANG 0.1;:TRIG:SOUR CHAN3;LEV 9;:WAV:FORM WORD;:ACQ:TYPE PEAK;:DIG CHAN1")
    _, volts = waveform(bench)
    assert volts.max() == pytest.approx(1.0, abs=1e-3)
    assert bench.number(":MEAS:VMAX?") == pytest.approx(1.0, abs=1e-3)
    assert bench.number(":MEAS:VMIN?") == pytest.approx(-1.0, abs=1e-3)
    assert bench.number(":MEAS:VPP?") == pytest.approx(2.0, abs=1e-3)


# --- how many samples are measured


@pytest.mark.parametrize(
    ("finest_s", "range_s", "points"),
    [
        (2e-6, 5e-3, 1000),  # the drive signal at 0.5 ms/div: the screen tells it
        (2e-6, 10e-3, 20_000),
        (math.inf, 1.0, 1000),
        (1e-9, 1.0, 1 << 20),
        (1e-10, 2e-6, 8000),  # no more than there are samples
    ],
)
def test_measurements_see_the_memory_where_the_screen_misses_the_signal(
    finest_s: float, range_s: float, points: int
) -> None:
    bench = Bench()
    bench.finest_s["drive"] = finest_s
    bench.ask(f":TIM:RANG {range_s!r};:DIG CHAN1;*OPC?")
    assert bench.scope.shown.record.measured_points(1, 1000) == points


def test_noise_and_coarse_steps_do_not_shift_an_edge() -> None:
    """Two equal sines, one of them in 8-bit steps of 3.6 degrees and noise as large, looked at every 0.6 degrees."""
    bench = Bench(ScopeErrors((0.0,) * 4, (0.0,) * 4, (0.0,) * 4, 0.0, 0.03, 8, noise_seed=3))
    for node in ("drive", "carrier"):
        bench.put(node, 0.0, Sine(1.0, 3489.0, 0.3))
        bench.finest_s[node] = 2e-6
    bench.send(":CHAN1:RANG 2.4;:CHAN2:RANG 16;:TIM:RANG 10E-3")
    phases = []
    for _ in range(16):
        assert bench.ask(":DIG CHAN1,CHAN2;*OPC?") == "1"
        phases.append(bench.number(":MEAS:PHAS? CHAN1,CHAN2"))
    assert np.std(phases) < 2.0
    assert np.mean(phases) == pytest.approx(0.0, abs=3.0 * np.std(phases) / math.sqrt(16))


# --- the counter


@pytest.mark.parametrize(
    ("frequency_hz", "form", "read_hz"),
    few(
        [
            (123456.789, "closed", 123460.0),
            (123456.789, "sampled", 123460.0),
            (19.87654e6, "closed", 19.877e6),
            (19.87654e6, "sampled", 19.877e6),
            (37.77777, "sampled", 37.778),
        ],
        every=2,
    ),
)
def test_the_counter_counts_the_signal(frequency_hz: float, form: str, read_hz: float) -> None:
    bench = bench_with(form, 0.2, Sine(1.3, frequency_hz, 0.3))
    bench.ask(":TIM:RANG 20E-3;:DIG CHAN1;*OPC?")
    began_s = bench.clock.now()
    assert bench.number(":MEAS:COUN?") == pytest.approx(read_hz, rel=1e-7)
    assert bench.clock.now() - began_s == pytest.approx(0.1)


def test_counter_has_time_base_error_and_five_digits() -> None:
    bench = Bench(ScopeErrors((0.0,) * 4, (0.0,) * 4, (0.0,) * 4, 1e-3, 0.0, 0))
    bench.put("drive", 0.0, Sine(1.0, 123456.0, 0.0))
    assert bench.number(":MEAS:COUN?") == 123330.0


def test_the_counter_needs_its_level_and_a_channel() -> None:
    bench = bench_with("closed", 0.2, Sine(1.3, 1000.0, 0.3))
    bench.send(":TRIG:LEV 2;:DIG CHAN1;:FUNC:DISP ON")
    assert bench.number(":MEAS:COUN?") == 9.9e37
    bench.send(":TRIG:LEV 0")
    assert bench.number(":MEAS:COUN? CHAN2") == 9.9e37
    assert bench.number(":MEAS:COUN? MATH") == 9.9e37
    assert bench.number(":MEAS:COUN?") == 1000.0
    began_s = bench.clock.now()
    assert bench.number(":TIM:RANG 0.3;:MEAS:COUN?") == 1000.0
    assert bench.clock.now() - began_s == pytest.approx(0.6)
    assert bench.errors() == []


# --- what is off


@pytest.mark.parametrize("source", ["CHAN2", "MATH"])
def test_what_is_off_has_no_data_and_cannot_be_measured(source: str) -> None:
    bench = Bench()
    bench.send(f":CHAN1:RANG 8;:CHAN2:RANG 8;:DIG CHAN1;:WAV:SOUR {source}")
    for query in (f":MEAS:VPP? {source}", f":MEAS:FREQ? {source}", f":MEAS:PHAS? CHAN1,{source}"):
        assert bench.number(query) == 9.9e37
    assert bench.raw(":WAV:DATA?") == b"#800001000" + bytes(1000) + b"\n"  # holes
    assert set(bench.ask(":WAV:FORM ASC;DATA?")[10:].split(",")) == {"+9.90000E+037"}
    bench.send(":WAV:FORM BYTE")
    bench.send(f":VIEW {source}")
    assert bench.number(f":MEAS:VPP? {source}") < 1e3
    assert 0 not in bench.raw(":WAV:DATA?")[10:]
    assert bench.errors() == []
