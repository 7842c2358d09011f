"""The math trace against numpy on the same record, and against closed forms."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from simrack.instruments.dso7104b.math_trace import WINDOWS, Spectrum

from simrack_tests.instruments.dso7104b.bench import Bench, F, waveform

if TYPE_CHECKING:
    from numpy.typing import NDArray

STEP_S = 1e-6


@pytest.fixture
def bench() -> Bench:
    bench = Bench()
    bench.send(
        ":CHAN1:RANG 4;:CHAN2:RANG 8;:CHAN3:RANG 4;:TIM:RANG 1E-3;:WAV:FORM WORD;:DIG CHAN1,CHAN2,CHAN3;:FUNC:DISP ON"
    )
    return bench


def trace_of(bench: Bench, source: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    bench.send(f":WAV:SOUR {source}")
    return waveform(bench)


def half_a_code(bench: Bench) -> float:
    return bench.number(":FUNC:RANG?") / 65536 * 0.51


@pytest.mark.parametrize("operation", ["ADD", "SUBT", "MULT"])
def test_two_sources_are_combined_point_by_point(bench: Bench, operation: str) -> None:
    (_, one), (_, two) = trace_of(bench, "CHAN1"), trace_of(bench, "CHAN2")
    bench.send(f":FUNC:OPER {operation};SOUR1 CHAN1;SOUR2 CHAN2")
    wanted = {"ADD": one + two, "SUBT": one - two, "MULT": one * two}[operation]
    times, values = trace_of(bench, "MATH")
    # channels are read in codes of 2^-16 of their range, the math trace is computed from what is not rounded so
    codes_v = 8 / 65536 + 4 / 65536 + (2 * 4 / 65536 + 1.6 * 8 / 65536 if operation == "MULT" else 0.0)
    assert np.abs(values - wanted).max() <= half_a_code(bench) + 0.51 * codes_v
    assert (times[0], times[1] - times[0]) == pytest.approx((-0.5e-3, STEP_S))


def test_the_integral_is_the_trapezoidal_sum_from_the_left_edge(bench: Bench) -> None:
    _, volts = trace_of(bench, "CHAN1")
    bench.send(":FUNC:OPER INT;SOUR1 CHAN1;RANG 2E-3")
    times, values = trace_of(bench, "FUNC")
    assert values[0] == pytest.approx(0.0, abs=half_a_code(bench))
    wanted = [np.trapezoid(volts[: n + 1], dx=STEP_S) for n in range(0, 1000, 50)]
    assert values[::50] == pytest.approx(wanted, abs=half_a_code(bench) + 1e-3 * 2 / 65536)
    # closed form: trigger at 0 V rising, 0.1 + 1.5 sin(wt - asin(1/15))
    w, phase = 2 * math.pi * F, -math.asin(0.1 / 1.5)
    exact = 0.1 * (times - times[0]) - 1.5 / w * (np.cos(w * times + phase) - np.cos(w * times[0] + phase))
    assert np.abs(values - exact).max() < 1e-7


def test_the_derivative_of_the_sine_is_its_cosine(bench: Bench) -> None:
    bench.send(":FUNC:OPER DIFF;SOUR1 CHAN1;RANG 1E5")
    times, values = trace_of(bench, "FUNC")
    w = 2 * math.pi * F
    exact = 1.5 * w * np.cos(w * times - math.asin(0.1 / 1.5))
    assert np.abs(values - exact)[1:-1].max() < half_a_code(bench) + 1.5 * w * (w * STEP_S) ** 2 / 6 * 1.1


def test_a_square_root_has_holes_where_there_is_none(bench: Bench) -> None:
    _, volts = trace_of(bench, "CHAN2")
    bench.send(":FUNC:OPER SQRT;SOUR1 CHAN2")
    _, values = trace_of(bench, "FUNC")
    below = volts < -1e-3
    assert np.abs(values[below]).max() <= half_a_code(bench)
    above = volts > 0.1
    assert values[above] == pytest.approx(np.sqrt(volts[above]), abs=1e-3)


def test_a_function_of_g_of_t(bench: Bench) -> None:
    (_, one), (_, three) = trace_of(bench, "CHAN1"), trace_of(bench, "CHAN3")
    bench.send(":FUNC:OPER INT;GOFT:OPER SUBT;SOUR1 CHAN1;SOUR2 CHAN3;:FUNC:SOUR1 GOFT;RANG 2E-3")
    _, values = trace_of(bench, "FUNC")
    assert values[-1] == pytest.approx(np.trapezoid(one - three, dx=STEP_S), abs=1e-7)
    bench.send(":FUNC:OPER ADD")
    assert bench.errors() == [-221]
    bench.send(":FUNC:SOUR1 CHAN1;OPER ADD;SOUR1 GOFT;SOUR2 GOFT")
    assert bench.errors() == [-221, -224]


@pytest.mark.parametrize(("window", "tolerance_db"), [("FLAT", 0.02), ("HANN", 1.5), ("BHAR", 0.9), ("RECT", 4.0)])
def test_fft_line_of_a_sine_has_frequency_and_dbv(window: str, tolerance_db: float) -> None:
    bench = Bench()
    bench.send(":CHAN1:RANG 4;:TIM:RANG 20E-3;:DIG CHAN1;:FUNC:DISP ON")
    bench.send(f":FUNC:OPER FFT;SOUR1 CHAN1;WIND {window};CENT 5 KHZ;SPAN 10 KHZ")
    line_hz, point_hz = 1 / 20e-3, 10.0
    assert bench.number(":MEAS:XMAX? FUNC") == pytest.approx(F, abs=line_hz / 2 + point_hz)
    level = 20 * math.log10(1.5 / math.sqrt(2))
    assert bench.number(":MEAS:VMAX? MATH") == pytest.approx(level, abs=tolerance_db)
    bench.send(":WAV:SOUR MATH;FORM WORD")
    hertz, dbv = waveform(bench)
    assert (hertz[0], hertz[1] - hertz[0]) == pytest.approx((0.0, point_hz))
    assert dbv[0] == pytest.approx(20 * math.log10(0.1), abs=0.05)  # the mean is a line at 0 Hz
    assert bench.errors() == []


@pytest.mark.parametrize("window", WINDOWS)
def test_a_line_shown_wide_peaks_at_its_own_frequency(window: str) -> None:
    times = np.arange(65536) * (0.05 / 65536)
    spectrum = Spectrum.of(np.sin(2 * np.pi * 1000.0 * times), times[1], window)  # lines every 20 Hz
    shown = spectrum.shown(0.0, 4000.0, 1000)
    assert 4.0 * int(shown.argmax()) == 1000.0
    assert shown[249] < shown[250] > shown[251]


def test_a_spectrum_shows_everything_until_it_is_told_otherwise(bench: Bench) -> None:
    bench.send(":FUNC:OPER FFT")
    highest = 65536 / 1e-3 / 2
    assert bench.number(":FUNC:SPAN?") == pytest.approx(highest)
    assert bench.number(":FUNC:CENT?") == pytest.approx(highest / 2)
    bench.send(":FUNC:SPAN 20 KHZ")
    assert bench.number(":FUNC:CENT?") == pytest.approx(10e3)


@pytest.mark.parametrize(("range_s", "highest_hz"), [(5e-9, 2e9), (50e-9, 2e9), (1e-3, 32.768e6), (10.0, 3276.8)])
def test_a_spectrum_ends_at_half_the_sample_rate(range_s: float, highest_hz: float) -> None:
    bench = Bench()
    bench.send(f":TIM:RANG {range_s!r};:FUNC:OPER FFT;SPAN 100E9")
    assert bench.number(":FUNC:SPAN?") == pytest.approx(highest_hz)
    assert bench.number(":ACQ:SRAT?") <= 4e9


@pytest.mark.parametrize("window", WINDOWS)
def test_a_line_on_the_raster_is_exact_through_every_window(window: str) -> None:
    count, step_s = 4096, 1e-5
    times = np.arange(count) * step_s
    hertz = 400 / (count * step_s)
    spectrum = Spectrum.of(0.5 + math.sqrt(2) * np.sin(2 * np.pi * hertz * times + 1.0), step_s, window)
    assert spectrum.step_hz == pytest.approx(1 / (count * step_s))
    assert spectrum.dbv[400] == pytest.approx(0.0, abs=1e-6)
    assert spectrum.dbv[0] == pytest.approx(20 * math.log10(0.5), abs=1e-6)
    assert spectrum.dbv[1000] < -80.0


def test_measurements_on_the_math_trace(bench: Bench) -> None:
    bench.send(":FUNC:OPER SUBT;SOUR1 CHAN1;SOUR2 CHAN3")
    assert bench.number(":MEAS:VAV? CYCL,MATH") == pytest.approx(0.1 - 0.25, abs=1e-3)
    assert bench.number(":MEAS:FREQ? FUNC") == pytest.approx(F, rel=1e-4)
    assert bench.number(":MEAS:PHAS? CHAN1,FUNC") == pytest.approx(0.0, abs=0.05)
    bench.send(":MEAS:SOUR MATH,CHAN1;:MEAS:VPP")
    assert bench.ask(":MEAS:SOUR?") == "FUNC,CHAN1"
    assert bench.ask(":MEAS:RES?").startswith("VPP(FUNC),+")
    assert bench.errors() == []


def test_a_clipped_source_makes_the_math_trace_unmeasurable(bench: Bench) -> None:
    bench.send(":CHAN1:RANG 2;:DIG CHAN1,CHAN2;:FUNC:OPER ADD")
    assert bench.number(":MEAS:VPP? FUNC") == 9.9e37


REPLIES = {
    ":FUNC?": ":FUNC:OPER ADD;DISP 0;SOUR1 CHAN1;SOUR2 CHAN2;RANG +8.00E+01;OFFS +0.00000E+00",
    ":FUNC:OPER?": "ADD",
    ":FUNC:OPER SUBTRACT;OPER?": "SUBT",
    ":FUNC:WIND?": "HANN",
    ":FUNC:DISP ON;:STAT? MATH": "1",
    ":BLAN FUNC;:FUNC:DISP?": "0",
    ":FUNC:RANG 2;SCAL?": "+2.50000000E-001",
    ":FUNC:OFFS 0.5;REF?": "+5.00000000E-001",
    ":WAV:SOUR MATH;SOUR?": "FUNC",
    ":FUNC:OPER FFT;RANG 80;RANG?": "+8.00000000E+001",
}


@pytest.mark.parametrize(("asked", "reply"), REPLIES.items())
def test_replies_to_the_character(asked: str, reply: str) -> None:
    bench = Bench()
    assert bench.ask(asked) == reply
    assert bench.errors() == []


@pytest.mark.parametrize(
    ("command", "query", "value"),
    [
        (":FUNC:OPER FFT;RANG 1000", ":FUNC:RANG?", 800.0),
        (":FUNC:OPER ADD;RANG 1E-9", ":FUNC:RANG?", 8e-6),
        (":FUNC:OPER DIFF;RANG 1E-3", ":FUNC:RANG?", 80e-3),
        (":FUNC:SPAN 0.1", ":FUNC:SPAN?", 1.0),
        (":FUNC:CENT 50E9", ":FUNC:CENT?", 25e9),
    ],
)
def test_numbers_out_of_range_are_clipped(command: str, query: str, value: float) -> None:
    bench = Bench()
    bench.send(command)
    assert bench.number(query) == pytest.approx(value)
    assert bench.errors() == [-222]
