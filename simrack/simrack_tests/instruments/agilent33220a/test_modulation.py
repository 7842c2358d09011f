"""What comes out of the 33220A, against syntheses of its own: cumulated phases, Bessel functions, spectra."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.special import jv
from simrack.instruments.agilent33220a import GeneratorErrors
from simrack.sources import Drive

from simrack_tests.cells import few
from simrack_tests.instruments.agilent33220a.bench import Socket

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Values = NDArray[Any]


@pytest.fixture
def box() -> Socket:
    box = Socket()
    box.send("OUTP:LOAD INF;:VOLT 2;:OUTP ON")
    return box


def lines(box: Socket, seconds: float, samples: int, start_s: float = 10.0) -> tuple[Values, Values]:
    """Frequencies and peak phasors (of sines) over whole periods."""
    times = start_s + np.arange(samples) * (seconds / samples)
    return np.fft.rfftfreq(samples, seconds / samples), 2j * np.fft.rfft(box.volts(times)) / samples


def sine(cycles: Values) -> Values:
    return np.sin(2 * np.pi * cycles)


SHAPES: dict[str, Callable[[Values], Values]] = {
    "SIN": sine,
    "SQU": lambda x: np.where(x % 1 < 0.5, 1.0, -1.0),
    "TRI": lambda x: 2 / np.pi * np.arcsin(np.sin(2 * np.pi * x)),
    "RAMP": lambda x: 2 * ((x + 0.5) % 1) - 1,
    "NRAM": lambda x: 1 - 2 * (x % 1),
}
"""Modulating shapes by cycles."""


@pytest.mark.parametrize(
    ("setup", "wanted"),
    [
        ("FUNC SQU;:FUNC:SQU:DCYC 30", lambda x: np.where(x % 1 < 0.3, 1.0, -1.0)),
        ("FUNC PULS;:FUNC:PULS:WIDT 40E-3", lambda x: np.where(x % 1 < 0.4, 1.0, -1.0)),
        ("FUNC RAMP;:FUNC:RAMP:SYMM 25", lambda x: np.interp((x + 0.125) % 1, [0, 0.25, 1], [-1.0, 1.0, -1.0])),
        ("FUNC RAMP;:FUNC:RAMP:SYMM 50", SHAPES["TRI"]),
        ("FUNC RAMP", SHAPES["RAMP"]),
        ("FUNC RAMP;:FUNC:RAMP:SYMM 0", SHAPES["NRAM"]),
    ],
)
def test_every_waveform_comes_out_exactly(setup: str, wanted: Callable[[Values], Values]) -> None:
    box = Socket()
    box.send(f"OUTP:LOAD INF;:VOLT 2;:VOLT:OFFS 0.5;:FREQ 10;:{setup};:PHAS 90;:OUTP ON")
    assert box.errors() == []
    times = 3.0 + (np.arange(5000) + 0.5) / 20000
    np.testing.assert_allclose(box.volts(times), 0.5 + wanted(10 * times + 0.25), atol=1e-9)


def test_edges_are_as_fast_as_they_are_set(box: Socket) -> None:
    box.send("FUNC PULS;:FREQ 1E6;:FUNC:PULS:WIDT 300E-9;TRAN 50E-9")
    times = np.arange(0, 1000) * 1e-9
    # 50 ns from 10 to 90 %
    wanted = np.interp(times, [0, 62.5e-9, 300e-9, 362.5e-9, 1e-6], [-1.0, 1.0, 1.0, -1.0, -1.0])
    np.testing.assert_allclose(box.volts(times), wanted, atol=1e-9)
    high_s = np.count_nonzero(box.volts(np.arange(0, 10000) * 1e-10) > 0) * 1e-10
    assert high_s == pytest.approx(300e-9, abs=1e-10)  # from middle to middle


def test_a_slow_arbitrary_waveform_is_a_staircase_whatever_its_length() -> None:
    box = Socket()
    points = np.round(np.sin(np.arange(1000) ** 1.3), 6)
    box.send("DATA VOLATILE," + ",".join(f"{each:.6f}" for each in points))
    box.send("OUTP:LOAD INF;:VOLT 2;:FREQ 0.01;:FUNC:USER VOLATILE;:FUNC USER;:OUTP ON")
    assert box.errors() == []
    places = np.arange(0, 1000, 0.25) + 0.1
    np.testing.assert_allclose(box.volts(places * 0.1), points[places.astype(int)], atol=1e-12)


def test_arbitrary_points_come_out_in_steps_of_the_converter() -> None:
    box = Socket(replace(GeneratorErrors.none(), dac_bits=14))
    box.send("DATA VOLATILE,0.12345678,-0.87654321;:OUTP:LOAD INF;:VOLT 2;:FUNC:USER VOLATILE;:FUNC USER;:OUTP ON")
    codes = box.volts([0.25e-3, 0.75e-3]) * 8191
    np.testing.assert_allclose(codes - codes[0] + round(0.12345678 * 8191), np.round([1011.2345, -7179.765]), atol=1e-6)


# --- modulation ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("carrier", ["SIN", "SQU", "RAMP"])
def test_am_with_every_carrier_and_shape(box: Socket, carrier: str, shape: str) -> None:
    """(1 + m shape)/2 of the carrier (33210A guide)."""
    box.send(f"FUNC {carrier};:FREQ 1000;:VOLT:OFFS 0.1;:AM:DEPT 60;INT:FREQ 50;FUNC {shape};:AM:STAT ON")
    times = 5.0 + (np.arange(4000) + 0.37) * 1e-5
    wanted = 0.1 + 0.5 * (1 + 0.6 * SHAPES[shape](50 * times)) * SHAPES[carrier](1000 * times)
    np.testing.assert_allclose(box.volts(times), wanted, atol=1e-8)


def test_am_by_sine_has_two_sidebands_in_closed_form(box: Socket) -> None:
    box.send("FREQ 1000;:AM:DEPT 60;INT:FREQ 50;:AM:STAT ON")
    assert isinstance(box.sine, Drive)
    hertz, phasors = lines(box, 0.1, 2000)
    sizes = {round(hertz[i]): abs(phasors[i]) for i in np.flatnonzero(abs(phasors) > 1e-9)}
    assert sizes == {950: pytest.approx(0.15), 1000: pytest.approx(0.5), 1050: pytest.approx(0.15)}


def test_am_from_outside_with_nothing_there_is_half_the_carrier(box: Socket) -> None:
    box.send("AM:SOUR EXT;:AM:STAT ON")
    assert box.sine == Drive(0.0, 0.5, 1000.0, 0.0)
    box.send("AM:STAT OFF")
    assert box.sine == Drive(0.0, 1.0, 1000.0, 0.0)


def test_excess_depth_stays_within_output(box: Socket) -> None:
    box.send("VOLT 20;:FREQ 10000;:AM:DEPT 120;INT:FREQ 100;:AM:STAT ON")
    volts = box.volts(np.arange(20000) * 1e-6)
    assert volts.max() == pytest.approx(10.0, abs=1e-3)
    assert volts.max() <= 10.0


@pytest.mark.parametrize(("deviation", "rate"), [(100.0, 50.0), (300.0, 100.0), (500.0, 20.0), (37.0, 10.0)])
def test_fm_by_a_sine_has_bessel_lines(box: Socket, deviation: float, rate: float) -> None:
    box.send(f"FREQ 2000;:FM:DEV {deviation};INT:FREQ {rate};:FM:STAT ON")
    hertz, phasors = lines(box, 1.0, 20000)
    for order in range(-12, 13):
        place = round(2000 + order * rate)
        assert abs(phasors[place]) == pytest.approx(abs(jv(order, deviation / rate)), abs=1e-9), hertz[place]


@pytest.mark.parametrize(("degrees", "rate"), [(90.0, 50.0), (360.0, 10.0)])
def test_pm_by_a_sine_has_bessel_lines(box: Socket, degrees: float, rate: float) -> None:
    box.send(f"FREQ 2000;:PM:DEV {degrees};INT:FREQ {rate};:PM:STAT ON")
    _, phasors = lines(box, 1.0, 20000)
    for order in range(-9, 10):
        expected = abs(jv(order, math.radians(degrees)))
        assert abs(phasors[round(2000 + order * rate)]) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("shape", few(SHAPES, "SIN"))
@pytest.mark.parametrize("carrier", few(["SIN", "SQU", "RAMP"], "SIN"))
def test_fm_is_the_cumulated_frequency(box: Socket, carrier: str, shape: str) -> None:
    box.send(f"FUNC {carrier};:FREQ 500;:FM:DEV 200;INT:FREQ 10;FUNC {shape};:FM:STAT ON")
    begin, step = box.clock.now() + 0.01, 1e-7
    times = begin + np.arange(2_000_000) * step
    cycles = np.cumsum(500 + 200 * SHAPES[shape](10 * (times + step / 2))) * step
    volts = box.volts(times)
    if carrier == "SIN":  # with that phase taken off it stands still
        assert abs(np.mean(volts * np.exp(-2j * np.pi * cycles))) == pytest.approx(0.5, abs=2e-3)
        return
    rises = np.flatnonzero((volts[:-1] < 0) & (volts[1:] >= 0) & (np.diff(volts) < 2.5))
    turns = np.diff(cycles[rises])
    np.testing.assert_allclose(turns, 1.0, atol=2e-3)


def test_pm_by_a_square_jumps_by_twice_the_deviation(box: Socket) -> None:
    box.send("FREQ 1000;:PM:DEV 45;INT:FREQ 10;FUNC SQU;:PM:STAT ON")
    times = 1.0 + np.arange(500) * 1e-4
    first, second = (np.angle(np.mean(box.volts(times + d) * np.exp(-2j * np.pi * 1000 * times))) for d in (0, 0.05))
    turned = math.degrees(math.remainder(first - second, math.tau))  # 0.05 s are whole cycles of the carrier
    assert turned == pytest.approx(90.0, abs=1e-6)


def test_fsk_hops_without_jump_of_phase(box: Socket) -> None:
    box.send("FREQ 1000;:FSK:FREQ 300;INT:RATE 10;:FSK:STAT ON")
    times = 2.0 + np.arange(1_000_001) * 2e-7
    volts = box.volts(times)
    assert np.abs(np.diff(volts)).max() <= 2 * np.pi * 1000 * 2e-7 * 1.0001
    rises = times[np.flatnonzero((volts[:-1] < 0) & (volts[1:] >= 0))]
    hertz = 1 / np.diff(rises)
    middles = (rises[1:] + rises[:-1]) / 2
    place = (10 * middles) % 1
    clear = np.abs((place % 0.5) - 0.25) < 0.2
    wanted = np.where(place < 0.5, 1000.0, 300.0)
    np.testing.assert_allclose(hertz[clear], wanted[clear], rtol=1e-3)


def test_fsk_from_outside_with_nothing_there_is_the_carrier(box: Socket) -> None:
    box.send("FSK:SOUR EXT;:FSK:FREQ 300;:FSK:STAT ON")
    assert box.sine.frequency_hz == 1000.0


@pytest.mark.parametrize("shape", ["SIN", "TRI"])
def test_pwm_moves_the_width(box: Socket, shape: str) -> None:
    box.send("FUNC PULS;:FREQ 1000;:FUNC:PULS:WIDT 500E-6;TRAN 5E-9;:PWM:DEV 200E-6;INT:FREQ 10")
    box.send(f"PWM:INT:FUNC {shape};:PWM:STAT ON")
    assert box.errors() == []
    times = 1.0 + (np.arange(1_000_000) + 0.5) * 1e-7
    high = (box.volts(times) > 0).reshape(100, -1)
    widths = high.sum(axis=1) * 1e-7
    ends = 1.0 + np.arange(100) * 1e-3 + widths
    np.testing.assert_allclose(widths, 500e-6 + 200e-6 * SHAPES[shape](10 * ends), atol=1e-6)
    assert high[:, 0].all()  # the leading edges stay
    box.send("PWM:DEV:DCYC 10")
    assert float(box.ask("PWM:DEV?")) == pytest.approx(100e-6)


def test_modulating_noise_is_noise_with_the_same_peak(box: Socket) -> None:
    box.send("FREQ 1E6;:AM:DEPT 100;INT:FUNC NOIS;:AM:STAT ON")
    times = 1.0 + np.arange(4096) * 1e-4
    heights = np.hypot(box.volts(times), box.volts(times + 0.25e-6))
    assert heights.mean() == pytest.approx(0.5, abs=0.02)
    assert heights.std() == pytest.approx(0.5 / 3.3, rel=0.1)
    assert heights.max() <= 1.0 + 1e-9


# --- sweeps -------------------------------------------------------------------------------------------------------


def instantaneous(box: Socket, times: Values, apart_s: float = 1e-7) -> Values:
    """Frequency from a sine and its quadrature: the derivative and the second difference, with no phase assumed."""
    before, here, after = (box.volts(times + d) for d in (-apart_s, 0.0, apart_s))
    return np.asarray(np.sqrt(np.maximum(-(before - 2 * here + after) / here, 0.0)) / (2 * np.pi * apart_s))


@pytest.mark.parametrize(
    ("spacing", "wanted"),
    [("LIN", lambda part: 1000 + 9000 * part), ("LOG", lambda part: 1000 * 10**part)],
)
@pytest.mark.parametrize(("start", "stop"), [(1000, 10000), (10000, 1000)])
def test_sweeps_run_through_their_frequencies(
    box: Socket, spacing: str, wanted: Callable[[Values], Values], start: int, stop: int
) -> None:
    box.send(f"FREQ:STAR {start};STOP {stop};:SWE:SPAC {spacing};TIME 0.5")
    begun = box.clock.now()
    box.send("SWE:STAT ON")
    assert box.errors() == []
    parts = np.random.default_rng(1).uniform(0.02, 0.98, 400)
    for number in (0, 7):
        times = begun + 0.5 * (number + parts)
        clear = np.abs(box.volts(times)) > 0.5
        hertz = instantaneous(box, times[clear], 1e-6)
        np.testing.assert_allclose(hertz, wanted(1 - parts[clear] if stop < start else parts[clear]), rtol=2e-3)


def test_a_sweep_begins_again_without_a_jump_of_phase(box: Socket) -> None:
    box.send("FREQ:STAR 100;STOP 1000;:SWE:TIME 0.01;STAT ON")
    volts = box.volts(1.0 + np.arange(400_000) * 1e-7)
    assert np.abs(np.diff(volts)).max() <= 2 * np.pi * 1000 * 1e-7 * 1.0001


def test_triggered_sweep_runs_once_and_returns(box: Socket) -> None:
    box.send("FREQ:STAR 1000;STOP 5000;:SWE:TIME 0.2;:TRIG:DEL 5;SOUR BUS;:SWE:STAT ON")  # only bursts are delayed
    assert box.sine.frequency_hz == 1000.0
    begun = box.clock.now()
    box.send("*TRG")
    times = begun + np.array([0.1, 0.3]) + np.arange(100)[:, None] * 1e-5
    volts = box.volts(times.T.ravel()).reshape(2, 100)
    for row, hertz in zip(volts, (3000.0, 1000.0), strict=True):
        crossings = np.count_nonzero(np.diff(np.sign(row)))
        assert crossings / 2 / 1e-3 == pytest.approx(hertz, abs=600)
    assert box.ask("*OPC?") == "1"
    assert box.clock.now() == pytest.approx(begun + 0.2)
    assert box.errors() == []


# --- bursts -------------------------------------------------------------------------------------------------------


def test_the_internal_timer_starts_bursts_from_their_phase(box: Socket) -> None:
    box.send("FREQ 1000;:VOLT:OFFS 0.1;:BURS:NCYC 3;INT:PER 10E-3;:BURS:PHAS 30")
    begun = box.clock.now()
    box.send("BURS:STAT ON")
    assert box.errors() == []
    since = np.arange(0.005e-3, 40e-3, 0.01e-3)
    wanted = 0.1 + sine(1000 * np.minimum(since % 10e-3, 3e-3) + 30 / 360)
    np.testing.assert_allclose(box.volts(begun + since), wanted, atol=1e-9)


def test_bursts_faster_than_a_millisecond_have_their_gaps(box: Socket) -> None:
    box.send("FREQ 1E6;:BURS:NCYC 5;INT:PER 20E-6;:BURS:STAT ON")
    assert box.errors() == []
    begun = box.clock.now()
    since = (np.arange(4000) + 0.5) * 1e-8
    wanted = sine(1e6 * np.minimum(since % 20e-6, 5e-6))
    np.testing.assert_allclose(box.volts(begun + since), wanted, atol=1e-6)


@pytest.mark.parametrize(("function", "idle"), [("SQU", -1.0), ("PULS", -1.0), ("RAMP", 0.0), ("USER", 0.25)])
def test_between_bursts_it_stands_where_they_begin(box: Socket, function: str, idle: float) -> None:
    box.send("DATA VOLATILE,0.25,1,-1,0;:FUNC:USER VOLATILE")
    box.send(f"FUNC {function};:FREQ 1000;:BURS:NCYC 2;INT:PER 10E-3;:BURS:STAT ON")
    begun = box.clock.now()
    np.testing.assert_allclose(box.volts(begun + np.array([3e-3, 9e-3])), idle, atol=1e-9)
    assert np.ptp(box.volts(begun + np.arange(1, 200) * 1e-5)) > 1.4


@pytest.mark.parametrize("polarity", ["NORM", "INV"])
def test_wai_waits_for_triggered_burst(box: Socket, polarity: str) -> None:
    box.send(f"FREQ 100;:BURS:NCYC 50;:TRIG:SOUR BUS;:OUTP:POL {polarity};:BURS:STAT ON")
    assert box.sine == Drive(0.0)
    start, sign = box.clock.now(), 1.0 if polarity == "NORM" else -1.0
    box.generator.write(b"*TRG;*WAI\n")
    assert box.volts(start + 0.0025) == pytest.approx(sign)
    assert box.ask("*OPC?") == "1"
    assert box.clock.now() - start == pytest.approx(0.5)
    assert box.volts(start + np.array([0.4925, 0.5025])) == pytest.approx([sign, 0.0], abs=1e-6)


def test_burst_starts_after_delay_and_ignores_triggers_within(box: Socket) -> None:
    box.send("FREQ 100;:BURS:NCYC 10;:TRIG:SOUR BUS;DEL 0.2;:BURS:STAT ON")
    start = box.clock.now()
    box.send("*TRG")
    box.clock.sleep_until(start + 0.25)
    box.send("*TRG")
    np.testing.assert_allclose(box.volts(start + np.array([0.1975, 0.2025, 0.2975, 0.3025])), [0, 1, -1, 0], atol=1e-6)
    box.clock.sleep_until(start + 0.4)
    box.send("*TRG")
    np.testing.assert_allclose(box.volts(start + np.array([0.5975, 0.6025])), [0, 1], atol=1e-6)
    assert box.errors() == []


def test_an_infinite_burst_runs_until_a_device_clear(box: Socket) -> None:
    box.send("FREQ 100;:BURS:NCYC INF;STAT ON")
    box.errors()
    start = box.clock.now()
    box.send("*TRG")
    assert box.volts(start + 1000.0025) == pytest.approx(1.0, abs=1e-6)
    box.clock.sleep_until(start + 5.0)
    box.generator.clear()
    assert box.sine == Drive(0.0)


def test_a_gated_burst_follows_its_open_gate(box: Socket) -> None:
    box.send("APPL:SIN 1000,2,0.1;:BURS:MODE GAT;STAT ON")
    assert box.sine == Drive(0.1)
    box.send("BURS:GATE:POL INV")
    assert box.sine.amplitude_v == 1.0


# --- noise --------------------------------------------------------------------------------------------------------


def test_noise_has_its_rms_a_flat_spectrum_and_9_mhz(box: Socket) -> None:
    box.send("FUNC NOIS;:VOLT 6.6;:VOLT:OFFS 0.5")
    times = 1.0 + np.arange(1 << 18) * 20e-9
    volts = box.volts(times) - 0.5
    assert volts.std() == pytest.approx(1.0, rel=0.01)
    assert np.abs(volts).max() <= 3.3 + 1e-12
    assert abs(volts.mean()) < 5 / math.sqrt(len(volts) / 2)
    power, hertz = np.abs(np.fft.rfft(volts)) ** 2, np.fft.rfftfreq(len(volts), 20e-9)

    def level_db(low: float, high: float) -> float:
        return float(10 * np.log10(power[(hertz > low) & (hertz <= high)].mean()))

    slow = level_db(0, 0.1e6)
    assert level_db(0.1e6, 1e6) == pytest.approx(slow, abs=0.5)
    assert level_db(8.8e6, 9.2e6) - level_db(0, 1e6) == pytest.approx(-3.0, abs=0.4)


def test_noise_is_same_for_all_readers_of_one_seed(box: Socket) -> None:
    box.send("FUNC NOIS;:VOLT 2")
    times = np.random.default_rng(0).uniform(0, 1000, 500)
    together = box.volts(times)
    alone = [float(box.volts(each)[0]) for each in times]
    assert together.tolist() == alone
    other = Socket()
    other.generator._player._noise_seed = 6
    other.send("OUTP:LOAD INF;:FUNC NOIS;:VOLT 2;:OUTP ON")
    assert abs(np.corrcoef(together, other.volts(times))[0, 1]) < 0.2


# --- conflicts ----------------------------------------------------------------------------------------------------


CONFLICTS = [
    ("FREQ 1000;:FM:STAT ON", "FM:DEV 2000", "FM:DEV?", 1000, "FM deviation cannot exceed carrier"),
    ("FREQ 15E6;:FM:STAT ON", "FM:DEV 10E6", "FM:DEV?", 5.1e6, "FM deviation exceeds max frequency"),
    ("BURS:STAT ON", "BURS:NCYC 20", "BURS:INT:PER?", 20.0002e-3, "burst period increased to fit entire burst"),
    (
        "FREQ 1;:BURS:INT:PER 500;:BURS:STAT ON",
        "BURS:NCYC 1000",
        "BURS:NCYC?",
        499,
        "burst count reduced to fit entire burst",
    ),
    ("BURS:STAT ON", "TRIG:DEL 1", "TRIG:DEL?", 8.9998e-3, "trigger delay reduced to fit entire burst"),
    ("FREQ 8E6", "BURS:STAT ON", "FREQ?", 6e6, "frequency made compatible with burst mode"),
    ("FUNC SQU;:FUNC:SQU:DCYC 70", "FREQ 15E6", "FUNC:SQU:DCYC?", 60, "frequency forced duty cycle change"),
    (
        "FUNC PULS;:FUNC:PULS:TRAN 100E-9",
        "FUNC:PULS:WIDT 40E-9",
        "FUNC:PULS:TRAN?",
        25e-9,
        "edge time decreased due to pulse width",
    ),
    ("SWE:STAT ON;:MARK ON", "MARK:FREQ 5000", "MARK:FREQ?", 1000, "marker forced into sweep span"),
    (
        "TRIG:SOUR EXT;:BURS:STAT ON",
        "OUTP:TRIG ON",
        "OUTP:TRIG?",
        0,
        "trigger output connector used by trigger external",
    ),
    ("OUTP:TRIG ON", "BURS:MODE GAT;STAT ON", "OUTP:TRIG?", 0, "trigger output connector used by burst gate"),
    ("OUTP:TRIG ON;:FSK:SOUR EXT", "FSK:STAT ON", "OUTP:TRIG?", 0, "trigger output connector used by FSK"),
    ("FUNC NOIS;:BURS:MODE GAT;STAT ON", "BURS:MODE TRIG", "BURS:STAT?", 0, "triggered burst not available for noise"),
    ("FUNC DC", "SWE:STAT ON", "SWE:STAT?", 0, "not able to sweep this function"),
    ("FUNC DC", "BURS:STAT ON", "BURS:STAT?", 0, "not able to burst this function"),
    ("FUNC SIN", "PWM:STAT ON", "PWM:STAT?", 0, "not able to modulate this function"),
    ("FUNC NOIS", "FM:STAT ON", "FM:STAT?", 0, "not able to modulate this function"),
    ("FREQ 1E-3;:TRIG:SOUR BUS", "BURS:STAT ON", "FREQ?", 2e-3, "frequency made compatible with burst mode"),
    ("FREQ 1E-3;:BURS:INT:PER 500", "BURS:STAT ON", "FREQ?", 2.001e-3, "frequency made compatible with burst mode"),
    ("FUNC PULS", "PULS:PER 50E-6", "FUNC:PULS:WIDT?", 49.98e-6, "pulse width decreased due to period"),
    ("FUNC PULS", "PULS:PER 100.01E-6", "FUNC:PULS:WIDT?", 99.99e-6, "pulse width decreased due to period"),
    (
        "FUNC PULS;:FUNC:PULS:WIDT 20E-9",
        "PULS:PER 200",
        "FUNC:PULS:WIDT?",
        2e-6,
        "pulse width increased due to large period",
    ),
    (
        "FUNC PULS;:PWM:STAT ON;DEV 80E-6",
        "FUNC:PULS:WIDT 50E-6",
        "PWM:DEV?",
        49.98e-6,
        "PWM deviation decreased due to pulse parameters",
    ),
    ("SWE:STAT ON", "FUNC NOIS", "SWE:STAT?", 0, "not able to sweep this function"),
]


@pytest.mark.parametrize("case", CONFLICTS, ids=lambda case: case[1])
def test_settings_that_do_not_go_together(box: Socket, case: tuple[str, str, str, float, str]) -> None:
    setup, command, query, reply, words = case
    box.send(setup)
    assert box.errors() == []
    box.send(command)
    assert float(box.ask(query)) == pytest.approx(reply, rel=1e-9)
    assert box.errors() == [f'-221,"Settings conflict; {words}"']


def test_short_period_shortens_edges_first_then_width(box: Socket) -> None:
    box.send("FUNC PULS;:FUNC:PULS:WIDT 200E-9;TRAN 100E-9")
    box.send("PULS:PER 250E-9")
    assert float(box.ask("FUNC:PULS:TRAN?")) == pytest.approx(78.125e-9)
    assert float(box.ask("FUNC:PULS:WIDT?")) == pytest.approx(125e-9)
    words = ("edge time decreased due to period", "pulse width decreased due to period")
    assert box.errors() == [f'-221,"Settings conflict; {each}"' for each in words]


@pytest.mark.parametrize(
    "setup", ["TRIG:SOUR BUS", "TRIG:SOUR EXT;:BURS:STAT ON", "TRIG:SOUR BUS;:BURS:MODE GAT;STAT ON", "SWE:STAT ON"]
)
def test_unexpected_bus_trigger_is_ignored_with_error(box: Socket, setup: str) -> None:
    box.send(setup)
    assert box.errors() == []
    box.send("*TRG")
    assert box.errors() == ['-211,"Trigger ignored"']


def test_group_execute_trigger_and_trigger_start_a_sweep_too(box: Socket) -> None:
    box.send("TRIG:SOUR BUS;:SWE:STAT ON")
    box.generator.trigger()
    assert box.ask("*OPC?") == "1"
    assert box.clock.now() >= 1.0
    box.send("TRIG:SOUR EXT")
    begun = box.clock.now()
    box.send("TRIG")
    assert box.ask("*OPC?") == "1"
    assert box.clock.now() == pytest.approx(begun + 1.0)
    assert box.errors() == []


def test_calling_the_phase_zero_changes_nothing_that_comes_out(box: Socket) -> None:
    box.send("PHAS 60")
    before = box.volts(np.arange(50) * 1e-5)
    box.send("PHAS:REF")
    assert float(box.ask("PHAS?")) == 0.0
    np.testing.assert_allclose(box.volts(np.arange(50) * 1e-5), before, atol=1e-12)


@pytest.mark.parametrize("mode", ["FM:STAT ON", "PM:STAT ON", "FSK:STAT ON", "SWE:STAT ON", "FREQ 1234.5"])
def test_modulation_sets_in_without_a_jump(box: Socket, mode: str) -> None:
    box.send("PM:INT:FUNC SQU")
    box.clock.sleep_until(3.217)
    before = box.source
    box.generator.write(mode.encode() + b"\n")
    box._settle()
    now = np.array([box.clock.now()])
    assert box.source.at(now) == pytest.approx(before.at(now), abs=1e-6)
