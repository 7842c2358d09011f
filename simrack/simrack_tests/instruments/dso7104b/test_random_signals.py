"""Measurements and spectra of random signals, against closed forms and numpy on the signals themselves.

Worst of 200 signals: 1.8e-4 of the peak of volts that are extremes or levels, 7e-5 of an rms, 9e-4 of a mean over
the screen (of 1000 samples), 1e-7 of periods, 2e-4 of rise and fall times, 1.1e-5 of duties, 0.012 degrees of phases,
0.0031 dB of lines (half a code of what is read).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.signal import get_window
from simrack.sources import Sine

from simrack_tests.instruments.dso7104b.bench import Bench, waveform

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Wave = Callable[[NDArray[np.float64]], NDArray[np.float64]]

NUMBERS = [*range(7), *(pytest.param(number, marks=pytest.mark.exhaustive) for number in range(7, 60))]
SHAPES = ("sine", "square", "ramp", "pulse", "am", "fm", "noise")
DENSE = 1 << 18


@dataclass
class Signal:
    """A random signal: volts at bench times, and what is known of it in closed form."""

    shape: str
    wave: Wave
    frequency_hz: float
    offset_v: float
    peak_v: float
    duty: float
    rise: float
    """10 to 90 %, parts of a period."""


def corners(phase: NDArray[np.float64], duty: float, edge: float) -> NDArray[np.float64]:
    """Return -1...1 with straight edges about phases 0 and `duty`, each `edge` long."""
    places = [-edge / 2, edge / 2, duty - edge / 2, duty + edge / 2, 1 - edge / 2]
    return np.interp((phase + edge / 2) % 1.0 - edge / 2, places, [-1.0, 1.0, 1.0, -1.0, -1.0])


def drawn(rng: np.random.Generator, shape: str) -> Signal:
    hertz = 10 ** rng.uniform(1.0, 7.3 if shape in {"sine", "am", "fm"} else 6.0)
    peak, offset, start = rng.uniform(0.05, 3.0), rng.uniform(-1.0, 1.0), rng.uniform()
    duty = 0.5 if shape != "pulse" else rng.uniform(0.1, 0.9)
    edge = {"square": rng.uniform(0.01, 0.1), "pulse": rng.uniform(0.01, 0.08), "ramp": 0.5}.get(shape, 0.0)
    turn = 2 * math.pi
    tones = rng.uniform(0.2, 3.0, 12) * hertz, rng.uniform(0.0, turn, 12)
    shapes: dict[str, Wave] = {
        "sine": lambda t: np.sin(turn * (hertz * t + start)),
        "am": lambda t: (1 + 0.5 * np.sin(turn * hertz / 17 * t)) / 1.5 * np.sin(turn * (hertz * t + start)),
        "fm": lambda t: np.sin(turn * (hertz * t + start) + 2.0 * np.sin(turn * hertz / 23 * t)),
        "noise": lambda t: sum((np.sin(turn * f * t + p) for f, p in zip(*tones, strict=True)), 0.0 * t) / 9,
    }
    unit = shapes.get(shape, lambda t: corners(hertz * t + start, duty, edge))
    rise = math.asin(0.8) / math.pi if shape == "sine" else 0.8 * edge
    return Signal(shape, lambda t: offset + peak * unit(t), hertz, offset, peak, duty, rise)


def shown(signal: Signal, rng: np.random.Generator) -> Bench:
    """A bench whose first channel has a record of it, on a random scale and time base."""
    bench = Bench()
    sampled = signal.shape != "sine" or rng.uniform() < 0.5
    if not sampled:
        at_zero = math.atan2(
            signal.wave(np.zeros(1))[0] - signal.offset_v,
            signal.wave(np.array([0.25 / signal.frequency_hz]))[0] - signal.offset_v,
        )
        bench.put("drive", signal.offset_v, Sine(signal.peak_v, signal.frequency_hz, at_zero))
    else:
        bench.nodes["drive"] = signal.wave
    periods = rng.uniform(2.2, 180.0)
    fill = rng.uniform(0.3, 0.95)
    bench.send(
        f":CHAN1:RANG {2 * signal.peak_v / fill!r};OFFS {signal.offset_v!r};:TIM:RANG {periods / signal.frequency_hz!r}"
    )
    bench.send(f":TRIG:SWE NORM;LEV {signal.offset_v!r};:DIG CHAN1")
    assert bench.ask("*OPC?") == "1"
    return bench


def screen(bench: Bench, signal: Signal, points: int = DENSE) -> NDArray[np.float64]:
    """Return the signal over the screen as it was."""
    record = bench.scope.shown.record
    return signal.wave(record.trigger_s + record.screen.times_s(points))


def periodic(signal: Signal) -> dict[str, float]:
    """Return what the measurements of a periodic signal are, in closed form."""
    period, mean_v = 1.0 / signal.frequency_hz, signal.offset_v
    cycle = signal.wave(np.arange(DENSE) * (period / DENSE))
    levels = {"VPP": 2 * signal.peak_v, "VMAX": mean_v + signal.peak_v, "VMIN": mean_v - signal.peak_v}
    flat = {"VTOP": levels["VMAX"], "VBAS": levels["VMIN"], "VAMP": levels["VPP"]}
    times = {"PER": period, "FREQ": signal.frequency_hz, "COUN": float(f"{signal.frequency_hz:.4e}")}
    edges = {"RIS": signal.rise * period, "FALL": signal.rise * period, "DUTY": 100.0 * signal.duty}
    means = {
        "VAV? CYCL": float(cycle.mean()),
        "VRMS? CYCL,DC": math.sqrt(float(np.mean(cycle**2))),
        "VRMS? CYCL,AC": float(cycle.std()),
    }
    return levels | flat | times | edges | means


IN_VOLTS = {"VPP", "VMAX", "VMIN", "VTOP", "VBAS", "VAMP", "VAV? CYCL", "VAV? DISP", "VRMS? CYCL,DC", "VRMS? CYCL,AC"}
IN_VOLTS |= {"VRMS? DISP,DC", "VRMS? DISP,AC"}
LIMITS = dict.fromkeys(IN_VOLTS, 3e-4) | {"PER": 1e-6, "FREQ": 1e-6, "RIS": 3e-4, "FALL": 3e-4, "DUTY": 3e-5}
LIMITS |= {"VAV? DISP": 1.1e-3, "COUN": 1.1e-4, "PHAS": 0.02, "DEL": 5e-5}
"""Of volts in parts of the peak, of a phase degrees, of a delay parts of the period, the others relative."""


def deviations(number: int) -> dict[str, float]:
    """Return by how much each measurement is off: volts in parts of the peak, others relative, degrees."""
    rng = np.random.default_rng((61, number))
    signal = drawn(rng, SHAPES[number % len(SHAPES)])
    bench = shown(signal, rng)
    volts = screen(bench, signal)
    wanted = {
        "VPP": float(np.ptp(volts)),
        "VMAX": float(volts.max()),
        "VMIN": float(volts.min()),
        "VAV? DISP": float(volts.mean()),
        "VRMS? DISP,DC": math.sqrt(float(np.mean(volts**2))),
        "VRMS? DISP,AC": float(volts.std()),
    }
    if signal.shape not in {"am", "fm", "noise"}:
        wanted |= periodic(signal)
    found = {}
    for name, value in wanted.items():
        read = bench.number(f":MEAS:{name}" if "?" in name else f":MEAS:{name}?")
        found[name] = abs(read - value) / (signal.peak_v if name in IN_VOLTS else abs(value))
    return found


@pytest.mark.parametrize("number", NUMBERS)
def test_measurements_of_a_random_signal(number: int) -> None:
    for name, deviation in deviations(number).items():
        assert deviation <= LIMITS[name], name


def pair_deviations(number: int) -> dict[str, float]:
    """Return by how much phase (degrees) and delay (parts of the period) of two sines are off."""
    rng = np.random.default_rng((62, number))
    hertz, lag_deg = 10 ** rng.uniform(1.0, 7.3), rng.uniform(-178.0, 178.0)
    bench = Bench()
    bench.put("drive", 0.0, Sine(1.0, hertz, rng.uniform(0.0, 6.0)))
    first = bench.sines["drive"][1][0]
    bench.put("carrier", 0.3, Sine(rng.uniform(0.1, 2.0), hertz, first.phase_rad - math.radians(lag_deg)))
    bench.send(
        f":CHAN1:RANG 3;:CHAN2:RANG 6;:TIM:RANG {rng.uniform(2.2, 180.0) / hertz!r};:TRIG:SWE NORM;:DIG CHAN1,CHAN2"
    )
    assert bench.ask("*OPC?") == "1"
    return {
        "PHAS": abs(math.remainder(bench.number(":MEAS:PHAS? CHAN1,CHAN2") - lag_deg, 360.0)),
        "DEL": abs(math.remainder(bench.number(":MEAS:DEL? CHAN1,CHAN2") * hertz - lag_deg / 360.0, 1.0)),
    }


@pytest.mark.parametrize("number", NUMBERS)
def test_phase_and_delay_of_two_sines(number: int) -> None:
    for name, deviation in pair_deviations(number).items():
        assert deviation <= LIMITS[name], name


WINDOWS = {"RECT": "boxcar", "HANN": "hann", "FLAT": "flattop", "BHAR": "blackmanharris"}


def spectrum_deviation(number: int) -> float:
    """Return by how much the lines of a spectrum are off, dB: those within 100 dB of the largest."""
    rng = np.random.default_rng((63, number))
    signal = drawn(rng, SHAPES[number % len(SHAPES)])
    bench = shown(signal, rng)
    record, rate_hz = bench.scope.shown.record, bench.number(":ACQ:SRAT?")
    range_s, window = record.screen.range_s, list(WINDOWS)[number % len(WINDOWS)]
    samples = min(65536, round(range_s * rate_hz))
    # as many lines as there are points to show, each at a point of its own; half of the time those about the signal
    largest = signal.frequency_hz * range_s if rng.uniform() < 0.5 else rng.uniform(0, samples / 2)
    first = round(min(max(0.0, largest - 500), max(0.0, samples / 2 - 1000)))
    bench.send(
        f":FUNC:OPER FFT;SOUR1 CHAN1;DISP ON;WIND {window};SPAN {1000 / range_s!r};CENT {(first + 500) / range_s!r}"
    )
    assert bench.number(":FUNC:SPAN?") == pytest.approx(min(1000, samples / 2) / range_s)
    bench.send(":WAV:SOUR FUNC;FORM WORD;:FUNC:RANG 400;OFFS -100")
    hertz, dbv = waveform(bench)
    weights = get_window(WINDOWS[window], samples)
    lines = np.abs(np.fft.rfft(screen(bench, signal, samples) * weights)) / weights.sum()
    lines[1:] *= math.sqrt(2.0)
    # a screen with fewer lines than points shows what joins them: lines are looked at alone
    places = np.rint(hertz * range_s).astype(int)
    inside = (places < samples // 2) & (np.abs(hertz * range_s - places) < 1e-3)
    wanted = 20 * np.log10(np.maximum(lines[places[inside]], 1e-10))
    strong = wanted > 20 * math.log10(lines.max()) - 100.0
    return float(np.abs(dbv[inside] - wanted)[strong].max(initial=0.0))


@pytest.mark.parametrize("number", NUMBERS)
def test_the_spectrum_of_a_random_signal_is_numpys(number: int) -> None:
    assert spectrum_deviation(number) <= 0.01
