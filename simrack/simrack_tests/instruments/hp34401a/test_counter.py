"""Frequency and period of the simulated 34401A."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simrack.instruments.hp34401a import MeterErrors
from simrack.instruments.hp34401a.functions import BY_NAME
from simrack.instruments.hp34401a.imperfections import CounterErrors
from simrack.sources import Sine

from simrack_tests.instruments.hp34401a.bench import MeterBench, bench, specimens


def counter(*sines: Sine, gate_s: float = 0.1, errors: MeterErrors | None = None) -> MeterBench:
    made = bench(errors)
    made.world.play(*sines)
    made.talk.write(f"CONF:FREQ;:FREQ:APER {gate_s}")
    return made


@pytest.mark.parametrize("frequency_hz", [3.0, 40.0, 1e3, 25.1e3, 50e3, 123456.0, 3e5])
@pytest.mark.parametrize("gate_s", [0.01, 0.1, 1.0])
def test_a_sine_of_any_frequency_at_any_gate(frequency_hz: float, gate_s: float) -> None:
    made = counter(Sine(1.0, frequency_hz, 0.3), gate_s=gate_s)
    assert made.value() == pytest.approx(frequency_hz, rel=1e-8)
    made.talk.write(f"CONF:PER;:PER:APER {gate_s}")
    assert made.value() == pytest.approx(1.0 / frequency_hz, rel=1e-8)


@settings(max_examples=10, deadline=None)
@given(st.floats(3.0, 5e3), st.floats(0.0, 1.0), st.sampled_from([0.01, 0.1, 1.0]))
def test_waveform_without_closed_form_is_counted(hertz: float, phase: float, gate_s: float) -> None:
    made = counter(gate_s=gate_s)
    made.world.play(waveform=lambda times: 0.2 + np.sin(2 * np.pi * (hertz * times + phase)))
    assert made.value() == pytest.approx(hertz, rel=1e-5)


@pytest.mark.parametrize("frequency_hz", [3.0, 100.0, 1e3])
@pytest.mark.parametrize("duty", [0.1, 0.5])
def test_pulses_that_only_tell_their_volts(frequency_hz: float, duty: float) -> None:
    made = counter(gate_s=1.0)
    made.world.play(waveform=lambda times: np.where((times * frequency_hz) % 1.0 < duty, 2.0, 0.0))
    assert made.value() == pytest.approx(frequency_hz, rel=2e-5)


def test_harmonics_and_sidebands_do_not_fool_it() -> None:
    """A triangle's 16 harmonics; a carrier of 100 kHz, amplitude modulated by 80 %."""
    triangle = [Sine(1.0 / n**2, n * 1e3, (n % 4 == 3) * np.pi) for n in range(1, 33, 2)]
    assert counter(*triangle).value() == pytest.approx(1e3, rel=1e-9)
    sides = (Sine(0.4, 99e3, 1.57), Sine(0.4, 101e3, -1.57))
    assert counter(Sine(1.0, 1e5, 0.0), *sides).value() == pytest.approx(1e5, rel=1e-9)
    square = [Sine(4 / np.pi / n, n * 1e3, 0.0) for n in range(1, 129, 2)]
    assert counter(*square).value() == pytest.approx(1e3, rel=1e-9)


def _next_rise(frequency_hz: float, instant_s: float) -> float:
    """When sin(2 pi f t) next rises through the threshold, 10 mV rms, with what capacitor and amplifier turn it by."""
    turned = math.atan(1.22 / frequency_hz) - math.atan(math.sqrt(2.0) * frequency_hz / 1e6)
    phase = (math.asin(0.01 * math.sqrt(2.0)) - turned) / math.tau
    return (math.ceil(instant_s * frequency_hz - phase) + phase) / frequency_hz


def test_a_change_within_the_gate_counts_by_its_time() -> None:
    made = counter(Sine(1.0, 1e3, 0.0), gate_s=1.0)
    made.talk.write("FREQ:VOLT:RANG 1;:TRIG:DEL 0")
    made.talk.settle()
    made.talk.write("INIT")
    made.world.clock.sleep_until(made.world.clock.now() + 0.02 + 0.25)
    changed = made.world.clock.now()
    made.world.play(Sine(1.0, 2e3, 0.0))
    opened = _next_rise(1e3, changed - 0.25)
    closed = _next_rise(2e3, changed + 0.75)
    events = round((changed - opened) * 1e3 - 0.5) + round((closed - changed) * 2e3 - 0.5) + 1
    assert made.value("FETC?") == pytest.approx(events / (closed - opened), rel=1e-6)


@pytest.mark.parametrize(("gate_s", "rate_hz"), [(1.0, 1.0), (0.1, 9.8), (0.01, 80.0)])
def test_published_rates(gate_s: float, rate_hz: float) -> None:
    """Readings a second without delay."""
    made = counter(Sine(1.0, 1e3, 0.0), gate_s=gate_s)
    made.talk.write("FREQ:VOLT:RANG 1;:TRIG:DEL 0;:SAMP:COUN 20")
    made.talk.settle()
    assert 20.0 / (made.duration_s("READ?") - 0.02) == pytest.approx(rate_hz, rel=0.03)


def test_period_longer_than_gate_is_waited_for() -> None:
    made = counter(Sine(1.0, 4.0, 0.0), gate_s=0.01)
    made.talk.write("FREQ:VOLT:RANG 1;:TRIG:DEL 0")
    made.talk.settle()
    assert 0.25 < made.duration_s("READ?") < 1.1


@pytest.mark.parametrize("query", ["MEAS:FREQ?", "MEAS:PER?"])
def test_no_signal_reads_0(query: str) -> None:
    made = bench()
    assert made.talk.ask(query) == "+0.00000000E+00"
    made.world.play(Sine(0.009, 1e3, 0.0))
    assert made.talk.ask(query) == "+0.00000000E+00"
    assert made.talk.ask("*ESR?") == "+128"


def test_a_fixed_range_overloads_and_autorange_does_not() -> None:
    made = counter(Sine(5.0, 1e3, 0.0))
    assert made.value() == pytest.approx(1e3)
    assert made.value("FREQ:VOLT:RANG?") == 10.0
    made.talk.write("FREQ:VOLT:RANG 1;:*CLS")
    assert made.talk.ask("READ?") == "+9.90000000E+37"
    assert made.talk.ask("STAT:QUES?;*ESR?") == "+1;+8"


@pytest.mark.parametrize(
    ("errors", "frequency_hz", "change"),
    [
        (CounterErrors(timebase_error=5e-5), 1e5, 5e-5),
        (CounterErrors(timebase_error=5e-5), 4.0, 5e-5),
        (CounterErrors(low_frequency_error=8e-4), 3.0, 8e-4),
        (CounterErrors(low_frequency_error=8e-4), 1e3, 0.0),
    ],
)
def test_each_error_shows_by_itself(errors: CounterErrors, frequency_hz: float, change: float) -> None:
    made = counter(Sine(1.0, frequency_hz, 0.0), gate_s=1.0, errors=MeterErrors(counter=errors))
    assert made.value() / frequency_hz - 1.0 == pytest.approx(change, abs=1e-8)


@pytest.mark.exhaustive
def test_noise_falls_with_the_gate() -> None:
    made = counter(Sine(1.0, 1e4, 0.0), errors=MeterErrors(counter=CounterErrors(noise=0.3), noise_seed=1))
    spreads = []
    for gate_s, resolution in ((0.01, 1e-4), (1.0, 1e-6)):
        made.talk.write(f"FREQ:APER {gate_s};:FREQ:VOLT:RANG 1;:TRIG:DEL 0;:SAMP:COUN 400")
        readings = [float(text) for text in (made.talk.ask("READ?") or "").split(",")]
        spreads.append(float(np.std(readings)) / 1e4 / resolution)
    assert spreads == pytest.approx([0.3, 0.3], rel=0.12)  # 3.5 sigma of the spread of 400 readings


@pytest.mark.parametrize(
    ("frequency_hz", "limit"), [(3.0, 1e-3), (5.1, 5e-4), (10.1, 3e-4), (40.1, 1e-4), (123456.0, 1e-4)]
)
def test_a_thousand_specimens_are_within_the_published_accuracy_and_differ(frequency_hz: float, limit: float) -> None:
    """One year (p. 218), read at the longest gate; noise included."""
    inputs = [bench(specimen).meter.inputs for specimen in specimens()]
    errors = [each._counted(BY_NAME["FREQ"], frequency_hz, 1.0) / frequency_hz - 1.0 for each in inputs]
    assert max(map(abs, errors)) <= limit
    spread = float(np.std(errors))
    assert spread > 0.05 * limit
    assert 0.6 < float(np.mean(np.abs(errors) < spread)) < 0.76  # a normal one has 0.68


def test_123_456_khz_reads_within_accuracy_of_drawn_unit() -> None:
    specimen = MeterErrors.drawn(np.random.default_rng(7))
    reading = counter(Sine(1.0, 123456.0, 0.0), gate_s=1.0, errors=specimen).value()
    assert reading != 123456.0
    assert abs(reading / 123456.0 - 1.0) < 1e-4
