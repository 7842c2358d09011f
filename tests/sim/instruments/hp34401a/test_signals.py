"""Counter and ac volts of the simulated 34401A on what a generator plays: random signals against numpy and series.

Every expectation is worked out here from the signal's formula: by Fourier and Bessel series behind the transfer
function of the path, by the transform of one period, and for the counter by when the phase of the formula passes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import jv
from simrack.adding import added
from simrack.attendance import AttendedClock
from simrack.instruments.agilent33220a import Agilent33220ATwin, GeneratorErrors, phases, waveforms
from simrack.instruments.agilent33220a.envelopes import Envelope, WidthSwing
from simrack.instruments.agilent33220a.noise import NoiseSource
from simrack.instruments.agilent33220a.playing import Playing
from simrack.instruments.hp34401a import Hp34401ATwin, MeterErrors
from simrack.instruments.truevolt import Keysight34461ATwin, Keysight34465ATwin
from simrack.leads import Leads
from simrack.sources import Drive, Sine
from simrack_tests.cells import few
from simrack_tests.instruments.conversation import Conversation
from simrack_tests.instruments.hp34401a.bench import MeterBench, bench

from vcfbench.clock import VirtualClock
from vcfbench.sim.gyro.design import ideal_bench
from vcfbench.sim.world import World

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray
    from simrack.sources import Played

HIGH_HZ, LOW_HZ = 1e6, 1.22
EDGE_S = 13e-9 / 0.8
THRESHOLD_V = math.sqrt(2.0) * 0.01


def passed(frequency_hz: NDArray[np.float64] | float) -> NDArray[np.complex128]:
    """The path: first-order high pass, second-order Butterworth low pass."""
    f, x = np.asarray(frequency_hz), np.asarray(frequency_hz) / HIGH_HZ
    return np.asarray(1.0 / (1.0 - 1j * LOW_HZ / f) / (1.0 + 1j * math.sqrt(2.0) * x - x**2))


@dataclass(frozen=True)
class Signal:
    """What is played, what ac volts of it are, and its cycles by time where it rises once a cycle."""

    name: str
    source: Played
    rms_v: float
    cycles: Callable[[float], float] | None
    size_v: float
    highest_hz: float


def _series(sizes: NDArray[np.float64], hertz: float) -> float:
    """Rms of harmonics 1, 2, ... of these amplitudes behind the path."""
    order = np.arange(1, len(sizes) + 1)
    return float(np.sqrt((np.abs(sizes * passed(order * hertz)) ** 2).sum() / 2))


def _harmonics(hertz: float) -> NDArray[np.float64]:
    return np.arange(1, min(math.ceil(100e6 / hertz), 300_000) + 1, dtype=float)


def sine(draw: np.random.Generator, hertz: float, volts: float) -> Signal:
    turn = draw.uniform()
    source = Playing(draw.uniform(-1, 1), volts, waveforms.SineCycle(), phases.Steady(hertz, turn))
    rms = volts * abs(complex(passed(hertz))) / math.sqrt(2.0)
    return Signal("sine", source, rms, lambda t: hertz * t + turn, volts, hertz)


def square(draw: np.random.Generator, hertz: float, volts: float) -> Signal:
    edge = EDGE_S * hertz
    n = _harmonics(hertz)
    sizes = 4 * volts * 0.5 * np.abs(np.sinc(n / 2) * np.sinc(n * edge))
    source = Playing(0.3, volts, waveforms.PulseCycle(0.5, edge), phases.Steady(hertz, draw.uniform()))
    return Signal("square", source, _series(sizes, hertz), lambda t: hertz * t, volts, hertz)


def ramp(draw: np.random.Generator, hertz: float, volts: float) -> Signal:
    rising = draw.uniform(0.05, 0.95)
    n = _harmonics(hertz)
    sizes = 2 * volts * np.abs(np.sin(np.pi * n * rising)) / (np.pi**2 * n**2 * rising * (1 - rising))
    source = Playing(0.0, volts, waveforms.ramp(rising), phases.Steady(hertz, draw.uniform()))
    return Signal("ramp", source, _series(sizes, hertz), lambda t: hertz * t, volts, hertz)


def pulse(draw: np.random.Generator, hertz: float, volts: float) -> Signal:
    width_s = draw.uniform(max(0.05 / hertz, 20e-9), 0.9 / hertz)
    edge_s = min(draw.uniform(5e-9, 100e-9) / 0.8, 0.5 * width_s, 0.05 / hertz)
    n = _harmonics(hertz)
    sizes = 4 * volts * width_s * hertz * np.abs(np.sinc(n * width_s * hertz) * np.sinc(n * edge_s * hertz))
    shape = waveforms.PulseCycle(width_s * hertz, edge_s * hertz)
    source = Playing(volts, volts, shape, phases.Steady(hertz, draw.uniform()))
    return Signal("pulse", source, _series(sizes, hertz), lambda t: hertz * t, volts, hertz)


def am(draw: np.random.Generator, hertz: float, volts: float) -> Signal:
    depth, rate = draw.uniform(0.1, 0.8), min(draw.uniform(5.0, 20e3), hertz / 20)
    rhythm = phases.Rhythm(waveforms.SineCycle(), rate)
    source = Playing(0.1, volts, waveforms.SineCycle(), phases.Steady(hertz), Envelope(depth, rhythm, 10.0))
    parts = ((volts / 2, hertz), (volts * depth / 4, hertz - rate), (volts * depth / 4, hertz + rate))
    rms = math.sqrt(sum(abs(size * complex(passed(f))) ** 2 for size, f in parts) / 2)
    return Signal("am", source, rms, lambda t: hertz * t, volts * (1 - depth) / 2, hertz)


def fm(draw: np.random.Generator, hertz: float, volts: float) -> Signal:
    deviation, rate = draw.uniform(0.05, 0.9) * hertz, min(draw.uniform(5.0, 20e3), hertz / 50)
    source = Playing(
        0.0, volts, waveforms.SineCycle(), phases.Deviated(hertz, deviation, phases.Rhythm(waveforms.SineCycle(), rate))
    )
    index = deviation / rate
    most = int(index + 30 + 6 * index ** (1 / 3))
    order = np.arange(-most, most + 1)
    lines = jv(order, index) * np.abs(passed(np.abs(hertz + order * rate) + 1e-9))
    cycles = lambda t: hertz * t + index * (1 - math.cos(math.tau * rate * t)) / math.tau  # noqa: E731
    return Signal("fm", source, volts * math.sqrt(float((lines**2).sum()) / 2), cycles, volts, hertz + deviation)


def fsk(draw: np.random.Generator, hertz: float, volts: float) -> Signal:
    hop, rate = hertz * draw.uniform(0.3, 3.0), draw.uniform(1.0, min(hertz / 20, 1e3) + 1.0)
    source = Playing(0.0, volts, waveforms.SineCycle(), phases.Keyed(hertz, hop, rate))
    both = (abs(complex(passed(hertz))) ** 2 + abs(complex(passed(hop))) ** 2) / 2

    def cycles(t: float) -> float:
        whole, part = divmod(t * rate, 1.0)
        return (whole * (hertz + hop) / 2 + hertz * min(part, 0.5) + hop * max(part - 0.5, 0.0)) / rate

    return Signal("fsk", source, volts * math.sqrt(both / 2), cycles, volts, max(hertz, hop))


def burst(draw: np.random.Generator, hertz: float, volts: float) -> Signal:
    count = int(draw.integers(3, min(50, hertz / 40)))
    period = count / hertz / draw.uniform(0.5, 0.9)
    source = Playing(0.0, volts, waveforms.SineCycle(), phases.Bursts(hertz, float(count), 0.0, period))
    points = 1 << 20
    times = (np.arange(points) + 0.5) * period / points
    volts_then = np.where(times < count / hertz, volts * np.sin(math.tau * hertz * times), 0.0)
    sizes = 2 * np.abs(np.fft.rfft(volts_then))[1 : points // 4] / points

    def cycles(t: float) -> float:
        whole, part = divmod(t, period)
        return whole * count + min(part * hertz, count - 1e-9)

    return Signal("burst", source, _series(sizes, 1 / period), cycles, volts, hertz)


KINDS = (sine, square, ramp, pulse, am, fm, fsk, burst)


def drawn(number: int, highest_hz: float) -> Signal:
    draw = np.random.default_rng([12, number])
    hertz = float(math.exp(draw.uniform(math.log(200.0), math.log(highest_hz))))
    return KINDS[number % len(KINDS)](draw, hertz, float(draw.uniform(0.2, 9.0)))


def meter(source: Played, setting: str) -> MeterBench:
    made = bench()
    made.world.play(source=source)
    made.talk.write(setting)
    return made


def ac_deviation(signal: Signal, number: int) -> float:
    """Return how far a reading of an automatic or a fixed range is from the series, as a part of it."""
    range_v = 10 if signal.rms_v < 8.0 else 100
    setting = "CONF:VOLT:AC" if number % 3 else f"CONF:VOLT:AC {range_v}"
    return abs(meter(signal.source, setting).value() / signal.rms_v - 1.0)


AC_TOLERANCE = 1e-4
"""The table of the loss at 33 frequencies, the 20 Hz filter's ripple at 200 Hz; frequency modulation beyond 1 MHz is
apart, where little is left of it: 1e-3."""


def _numbered(count: int, few: int) -> list[Any]:
    return [pytest.param(n, marks=() if n < few else pytest.mark.exhaustive) for n in range(count)]


@pytest.mark.parametrize("number", _numbered(60, 8))
def test_ac_volts_of_random_signals(number: int) -> None:
    signal = drawn(number, 3e6)
    beyond = signal.name == "fm" and signal.highest_hz > 1e6
    assert ac_deviation(signal, number) < (1e-3 if beyond else AC_TOLERANCE)


def counted(made: MeterBench, gate_s: float) -> tuple[float, float, float]:
    """Return a reading, when its gate began, and when it was there."""
    made.talk.write(f"FREQ:APER {gate_s};:TRIG:DEL 0")
    made.talk.settle()
    begun = made.world.clock.now() + 0.02
    made.talk.write("INIT")
    return made.value("FETC?"), begun, made.world.clock.now()


def events_of(signal: Signal, begun_s: float, gate_s: float) -> tuple[float, float, float]:
    """Return the cycles between the events that open and close a gate by the formula of the phase, and both."""
    assert signal.cycles is not None
    cycles = signal.cycles

    def next_s(instant_s: float) -> float:
        wanted = math.floor(cycles(instant_s) - _early(signal)) + 1.0 + _early(signal)
        later = instant_s
        while cycles(later) < wanted:
            later += 0.25 / signal.highest_hz
        return float(brentq(lambda t: cycles(t) - wanted, instant_s, later, xtol=1e-15, rtol=1e-15))

    opened, closed = next_s(begun_s), next_s(begun_s + gate_s)
    return round(cycles(closed) - cycles(opened)), opened, closed


def _early(signal: Signal) -> float:
    """At what part of a cycle a sine is at the threshold; the phase of what else rises once a cycle does not matter."""
    if signal.name not in ("fm", "fsk", "burst", "am"):
        return 0.0
    turned = -math.atan(math.sqrt(2.0) * signal.highest_hz / HIGH_HZ) if signal.name == "burst" else 0.0
    return (math.asin(THRESHOLD_V / signal.size_v) - turned) / math.tau


def count_deviation(number: int) -> tuple[Signal, float]:
    """Return by how many cycles a gate is off."""
    signal, draw = drawn(number, 3e5), np.random.default_rng([34, number])
    gate_s = float(draw.choice([0.01, 0.1, 1.0], p=[0.4, 0.4, 0.2]))
    range_v = 1.0 if signal.rms_v < 1.0 else 10.0
    made = meter(signal.source, f"CONF:FREQ;:FREQ:VOLT:RANG {range_v}")
    made.world.clock.sleep_until(float(draw.uniform(2.0, 3.0)))
    read, begun, _ = counted(made, gate_s)
    events, opened, closed = events_of(signal, begun, gate_s)
    return signal, abs(read * (closed - opened) - events)


COUNT_TOLERANCE = {kind.__name__: 0.02 if kind in (am, fm, fsk, burst) else 3e-4 for kind in KINDS}
"""In cycles. Of what is modulated, the formula has nothing of what the path turns at the frequency of the moment."""


@pytest.mark.parametrize("number", _numbered(60, 8))
def test_random_signals_are_counted(number: int) -> None:
    signal, off_cycles = count_deviation(number)
    assert off_cycles < COUNT_TOLERANCE[signal.name]


TONE = waveforms.SineCycle()


SWING = WidthSwing(0.1, 0.05, phases.Rhythm(TONE, 100.0))


def _wave(hertz: float, shape: waveforms.Cycle, volts: float = 1.0) -> Playing:
    return Playing(0.0, volts, shape, phases.Steady(hertz))


@pytest.mark.parametrize(
    ("source", "expected_v"),
    [
        (_wave(1e6, waveforms.PulseCycle(0.05, 5e-9 / 0.8 * 1e6)), 0.107),
        (_wave(5e6, waveforms.PulseCycle(0.5, EDGE_S * 5e6)), 0.036),
        (_wave(20e6, waveforms.PulseCycle(0.5, EDGE_S * 20e6)), 0.002),
        (_wave(1e6, waveforms.PulseCycle(0.5, EDGE_S * 1e6)), 0.6373),
    ],
)
def test_ac_volts_of_fast_edges(source: Playing, expected_v: float) -> None:
    """By hand: the fundamental of a square at 5 MHz is 4/pi/sqrt(2) V, of which 1/25 is left."""
    assert meter(source, "CONF:VOLT:AC").value() == pytest.approx(expected_v, abs=5e-4)


@pytest.mark.parametrize(
    ("source", "expected_hz"),
    few(
        [
            (Playing(0.0, 1.0, TONE, phases.Deviated(1e4, 5e3, phases.Rhythm(TONE, 50.0))), 1e4),
            (Playing(0.0, 1.0, TONE, phases.Keyed(1e3, 2e3, 10.0)), 1.5e3),
            (Playing(0.0, 1.0, TONE, phases.Bursts(2e4, 50.0, 0.0, 0.01)), 5e3),
            (_wave(20e6, waveforms.PulseCycle(0.5, EDGE_S * 20e6)), 0.0),
            (_wave(5e6, waveforms.PulseCycle(0.5, EDGE_S * 5e6)), 5e6),
            (_wave(1e3, waveforms.PulseCycle(2e-5, 5e-6)), 0.0),
            (_wave(1e3, waveforms.PulseCycle(0.02, 5e-6)), 1e3),
            (Playing(0.0, 1.0, waveforms.PulseCycle(0.1, 1e-4), phases.Steady(1e4), None, SWING), 1e4),
            (added(_wave(1e3, waveforms.ramp(0.3)), Drive(0.0, 0.1, 50.0)), 1e3),
            (added(_wave(2e5, waveforms.PulseCycle(0.5, 3e-3)), Drive(0.0, 1e-3, 49.97)), 2e5),
            (Drive(0.0, 1.0, 1e5, 0.0, 50.0, (Sine(1e-3, 50.01, 0.3),)), 1e5),
        ],
        every=5,
    ),
)
def test_a_second_of_it_is_counted(source: Played, expected_hz: float) -> None:
    """20 MHz is below the threshold behind the amplifier; pulses of 20 ns never come below the lower threshold."""
    assert meter(source, "CONF:FREQ;:FREQ:APER 1").value() == pytest.approx(expected_hz, rel=2e-6)


def test_full_amplitude_modulation_loses_cycles_below_threshold() -> None:
    """Where (1 + sin x)/2 of 1 V is less than the threshold."""
    source = Playing(0.0, 1.0, TONE, phases.Steady(1e5), Envelope(1.0, phases.Rhythm(TONE, 100.0), 10.0))
    x = np.linspace(0.0, math.tau, 1_000_001)
    counted_part = float(((1.0 + np.sin(x)) / 2.0 > THRESHOLD_V).mean())
    assert meter(source, "CONF:FREQ").value() == pytest.approx(1e5 * counted_part, rel=2e-3)


@pytest.mark.exhaustive
def test_noise_is_counted_as_often_as_it_crosses_both_thresholds() -> None:
    """Against Gaussian numbers through a Butterworth filter, counted one by one."""
    from scipy.signal import bilinear, lfilter  # noqa: PLC0415  # it takes a second to load

    rate_hz, rms_v = 64e6, 0.3
    made = meter(NoiseSource(0.0, rms_v, 5), "CONF:FREQ;:FREQ:VOLT:RANG 1")
    analog = ([(math.tau * HIGH_HZ) ** 2], [1.0, math.sqrt(2.0) * math.tau * HIGH_HZ, (math.tau * HIGH_HZ) ** 2])
    drawn_v = np.random.default_rng(1).normal(0.0, 1.0, 200_000)
    volts = lfilter(*bilinear(*analog, fs=rate_hz), drawn_v)
    volts *= made.value("MEAS:VOLT:AC?") / volts.std()
    rises, armed = 0, True
    for each in volts.tolist():
        if armed and each > THRESHOLD_V:
            rises, armed = rises + 1, False
        elif each < -THRESHOLD_V:
            armed = True
    made.talk.write("CONF:FREQ;:FREQ:VOLT:RANG 1;:FREQ:APER 0.01")
    assert made.value() == pytest.approx(rises * rate_hz / 200_000, rel=0.04)


def test_ac_volts_of_noise_are_its_power_behind_the_path() -> None:
    noise, rate_hz, points = NoiseSource(0.2, 0.5, 7), 50e6, 1 << 18
    seen = noise.at(3.0 + np.arange(points) / rate_hz)
    powers = np.abs(np.fft.rfft(seen - seen.mean())) ** 2 * 2.0 / points**2
    left = powers[1:] @ np.abs(passed(np.fft.rfftfreq(points, 1 / rate_hz)[1:])) ** 2
    assert meter(noise, "CONF:VOLT:AC").value() == pytest.approx(math.sqrt(float(left)), rel=0.03)


TRUEVOLT = [pytest.param(model, marks=pytest.mark.exhaustive) for model in (Keysight34461ATwin, Keysight34465ATwin)]


@pytest.mark.exhaustive
@pytest.mark.parametrize("model", [Hp34401ATwin, *TRUEVOLT])
def test_a_generator_and_a_meter_on_v_vc(model: type[Hp34401ATwin]) -> None:
    """The whole way: words of both, the World's pieces of 1/64 s, mains in the meter's leads."""
    world = World(AttendedClock(VirtualClock()), ideal_bench(), 0)
    generator = Agilent33220ATwin(world, GeneratorErrors.none(), node="v_vc")
    caught = Sine(1e-3 * math.sqrt(2.0), 50.01, 0.3)
    meter = model(Leads(world, "meter", {"output": "v_vc"}, caught), errors=MeterErrors.none())
    for each in (generator, meter):
        world.clock.attend(each)  # type: ignore[attr-defined]
    source, talk = Conversation(generator, world.clock), Conversation(meter, world.clock)
    source.write("OUTP:LOAD INF;:FUNC SQU;:FREQ 1E6;:VOLT 2;:VOLT:OFFS 0;:OUTP ON")
    source.settle()
    order = np.arange(1, 100)
    expected_v = _series(np.where(order % 2, 4 / np.pi / order, 0.0) * np.sinc(EDGE_S * 1e6 * order), 1e6)
    assert float(talk.ask("MEAS:VOLT:AC? 1") or "nan") == pytest.approx(expected_v, rel=1e-3)
    assert float(talk.ask("MEAS:FREQ?") or "nan") == pytest.approx(1e6, rel=1e-7)
    source.write("FUNC SIN;:FREQ 10000;:FM:DEV 5000;:FM:INT:FREQ 50;:FM:STAT ON")
    source.settle()
    talk.write("CONF:FREQ")
    assert float(talk.ask("READ?") or "nan") == pytest.approx(1e4, rel=2e-5)
