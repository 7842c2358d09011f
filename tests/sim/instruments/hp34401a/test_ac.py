"""AC volts of the simulated 34401A: against power sums in closed form, whatever the frequency."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simrack.instruments.hp34401a import Hp34401ATwin, MeterErrors
from simrack.instruments.hp34401a.ac import AcResponse, crest_limit, detect
from simrack.instruments.hp34401a.imperfections import AcErrors
from simrack.sources import Drive, Sine
from simrack.trace import Piece
from simrack_tests.cells import few
from simrack_tests.instruments.conversation import Conversation
from simrack_tests.instruments.hp34401a.bench import MeterBench, bench, specimens

from vcfbench.clock import VirtualClock
from vcfbench.sim.gyro.design import ideal_bench
from vcfbench.sim.world import World

if TYPE_CHECKING:
    from numpy.typing import NDArray

HIGH_HZ = 1e6
LOW_HZ = {3: 0.1, 20: 1.22, 200: 4.83}


def passed(frequency_hz: float, filter_hz: int = 20) -> float:
    """Magnitude of a first-order high-pass and a second-order Butterworth low-pass, from the textbook."""
    low = 1.0 / math.sqrt(1.0 + (LOW_HZ[filter_hz] / frequency_hz) ** 2)
    return low / math.sqrt(1.0 + (frequency_hz / HIGH_HZ) ** 4)


def ac(*sines: Sine, filter_hz: int = 20, errors: MeterErrors | None = None) -> MeterBench:
    made = bench(errors)
    made.world.play(*sines)
    made.talk.write(f"CONF:VOLT:AC 10;:DET:BAND {filter_hz}")
    return made


@pytest.mark.parametrize("frequency_hz", [20.0, 1e3, 25.1e3, 49.9e3, 50e3, 1e5, 123456.0, 3e5, 1e6, 5e6])
def test_a_sine_of_any_frequency(frequency_hz: float) -> None:
    """Nothing aliases: 50 kHz and its multiples were what the node used to be looked at with."""
    expected = 2.0 / math.sqrt(2.0) * passed(frequency_hz)
    assert ac(Sine(2.0, frequency_hz, 0.7)).value() == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("frequency_hz", [100.0, 1e3, 25.1e3])
def test_waveform_of_volts_reads_like_its_closed_form(frequency_hz: float) -> None:
    made = ac()
    made.world.play(waveform=lambda times: 0.4 + 2.0 * np.sin(2 * np.pi * frequency_hz * times + 0.7))
    assert made.value() == pytest.approx(2.0 / math.sqrt(2.0) * passed(frequency_hz), rel=3e-6)


def test_a_sum_of_sines_adds_in_power() -> None:
    sines = (Sine(1.0, 1e3, 0.1), Sine(0.5, 77e3, 2.0), Sine(0.25, 250e3, 1.0))
    power = sum((each.amplitude_v * passed(each.frequency_hz)) ** 2 / 2 for each in sines)
    assert ac(*sines).value() == pytest.approx(math.sqrt(power), rel=1e-7)


@pytest.mark.parametrize(
    ("filter_hz", "lowest_hz", "loss"),
    [
        (3, 3.0, 0.01),
        (20, 10.0, 0.0074),
        (20, 20.0, 0.0022),
        (20, 40.0, 6e-4),
        (200, 40.0, 0.0073),
        (200, 100.0, 0.0022),
    ],
)
def test_the_filters_lose_low_frequencies_within_the_published_error(
    filter_hz: int, lowest_hz: float, loss: float
) -> None:
    """Additional low frequency errors of the specifications, at the lower end of each class."""
    read = ac(Sine(1.0, lowest_hz, 0.0), filter_hz=filter_hz).value() * math.sqrt(2.0)
    assert read == pytest.approx(passed(lowest_hz, filter_hz), rel=1e-5)
    assert 0.0 < 1.0 - read < loss * 1.01


def test_the_band_ends_within_the_published_error_and_falls_beyond() -> None:
    at = {f: ac(Sine(1.0, f, 0.0)).value() * math.sqrt(2.0) for f in (20e3, 50e3, 1e5, 3e5, 1e6, 1e7)}
    for frequency, limit in ((20e3, 6e-4), (50e3, 1.2e-3), (1e5, 6e-3), (3e5, 0.04)):
        assert abs(at[frequency] - 1.0) < limit
    assert at[1e6] == pytest.approx(1 / math.sqrt(2.0), rel=1e-6)
    assert at[1e7] == pytest.approx(0.01, rel=1e-3)


def test_direct_voltage_does_not_pass() -> None:
    made = ac(Sine(0.5, 1e3, 0.0))
    made.world.offset_v = 8.0
    assert made.value() == pytest.approx(0.5 / math.sqrt(2.0), rel=1e-6)


@pytest.mark.parametrize(("filter_hz", "settling_s"), [(3, 7.0), (20, 1.0), (200, 0.1)])
def test_each_filter_settles_in_its_time(filter_hz: int, settling_s: float) -> None:
    """With the delay defeated a reading soon after a step is neither old nor new; after the settling time it is new."""
    made = ac(Sine(1.0, 1e3, 0.0), filter_hz=filter_hz)
    made.talk.write("TRIG:DEL 0")
    made.world.clock.sleep_until(20.0)
    new = 3.0 / math.sqrt(2.0) * passed(1e3, filter_hz)
    made.world.play(Sine(3.0, 1e3, 0.0))
    made.world.clock.sleep_until(20.0 + 0.3 * settling_s)
    assert 1.01 / math.sqrt(2.0) < made.value() < 0.95 * new
    made.world.clock.sleep_until(20.0 + 1.01 * settling_s)
    assert made.value() == pytest.approx(new, rel=1e-6)


@pytest.mark.parametrize(("filter_hz", "delay_s"), [(3, 7.0), (20, 1.0), (200, 0.6)])
def test_the_automatic_delay_covers_the_settling(filter_hz: int, delay_s: float) -> None:
    made = ac(Sine(1.0, 1e3, 0.0), filter_hz=filter_hz)
    made.talk.settle()
    assert made.duration_s("READ?") == pytest.approx(0.02 + delay_s + 0.02)
    made.talk.write("FUNC 'VOLT:DC';FUNC 'VOLT:AC'")
    assert made.value() == pytest.approx(passed(1e3, filter_hz) / math.sqrt(2.0), rel=1e-6)


def test_fifty_readings_a_second_with_the_delay_defeated() -> None:
    made = ac(Sine(1.0, 1e3, 0.0), filter_hz=200)
    made.talk.write("TRIG:DEL 0;:SAMP:COUN 50")
    made.talk.settle()
    assert made.duration_s("READ?") == pytest.approx(1.0 + 0.02)


@pytest.mark.parametrize(("rms_v", "range_v"), [(0.05, 0.1), (0.099, 0.1), (0.101, 1.0), (5.0, 10.0), (50.0, 100.0)])
def test_autorange(rms_v: float, range_v: float) -> None:
    made = bench()
    made.world.play(Sine(rms_v * math.sqrt(2.0), 1e3, 0.0))
    assert made.value("MEAS:VOLT:AC?") == pytest.approx(rms_v, rel=1e-5)
    assert made.value("VOLT:AC:RANG?") == range_v


def test_autorange_looks_again_when_a_slow_signal_fooled_it() -> None:
    made = bench()
    made.world.play(Sine(3.0, 5.0, 0.0))
    made.talk.write("CONF:VOLT:AC;:DET:BAND 3;:VOLT:AC:RANG 0.1;RANG:AUTO ON")
    assert made.value() == pytest.approx(3.0 / math.sqrt(2.0), rel=1e-3)
    assert made.value("VOLT:AC:RANG?") == 10.0


def test_overload_by_rms_and_by_crest_factor() -> None:
    """Crest factor 5:1 at full scale: pulses of 2 % of the period on the 1 V range, 0.98 and 0.7 V rms."""
    made = bench()
    made.talk.write("CONF:VOLT:AC 1;:DET:BAND 200")
    for height_v, overloads in ((7.0, True), (4.5, False)):
        made.world.play(waveform=partial(_pulses, height_v))
        assert (made.value() > 1e37) is overloads
    made.world.play(Sine(1.25 * math.sqrt(2.0), 1e3, 0.0))
    assert made.talk.ask("READ?") == "+9.90000000E+37"
    assert made.talk.ask("STAT:QUES?") == "+1"


def _pulses(height_v: float, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where((times_s * 1e3) % 1.0 < 0.02, height_v, 0.0)


def test_crest_factor_error_follows_waveform_class() -> None:
    for factor, limit in ((1.0, 5e-4), (2.0, 5e-4), (3.0, 1.5e-3), (4.0, 3e-3), (5.0, 4e-3), (9.0, 4e-3)):
        assert crest_limit(factor) == pytest.approx(limit)
    errors = MeterErrors(ac=AcErrors(crest_share=1.0))
    ideal = 1.0 / math.sqrt(2.0) * passed(1e3)
    assert ac(Sine(1.0, 1e3, 0.0), errors=errors).value() == pytest.approx(ideal, rel=2e-7)
    read = []
    for specimen in (MeterErrors.none(), errors):
        made = ac(errors=specimen)
        made.world.play(waveform=lambda times: np.where((times * 1e3) % 1.0 < 0.2, 1.0, 0.0))  # crest factor 2
        read.append(made.value())
    assert read[1] / read[0] == pytest.approx(1 + 5e-4, abs=2e-6)


@pytest.mark.parametrize(
    ("errors", "frequency_hz", "change"),
    [
        (AcErrors(gain_error=3e-4), 1e3, 3e-4),
        (AcErrors(range_gain_error=(1e-3, 2e-3, 3e-4, 4e-3, 5e-3)), 1e3, 3e-4),
        (AcErrors(low_frequency_error=5e-3), 3.0, 5e-3),
        (AcErrors(low_frequency_error=5e-3), 1e3, 0.0),
        (AcErrors(flatness_error=0.02), 3e5, 0.02),
        (AcErrors(flatness_error=0.02), 1e3, 0.0),
        (AcErrors(range_share=0.5), 1e3, 0.5 * 3e-4 * 10.0),
        (AcErrors(range_share=-0.5), 1e5, -0.5 * 3e-4 * 10.0),
    ],
)
def test_each_error_shows_by_itself(errors: AcErrors, frequency_hz: float, change: float) -> None:
    sine = Sine(math.sqrt(2.0), frequency_hz, 0.0)
    ideal = ac(sine, filter_hz=3).value()
    read = ac(sine, filter_hz=3, errors=MeterErrors(ac=errors)).value()
    assert read / ideal - 1.0 == pytest.approx(change, abs=3e-6)


@pytest.mark.exhaustive
def test_noise_of_readings() -> None:
    made = ac(Sine(1.0, 1e3, 0.0), filter_hz=200, errors=MeterErrors(ac=AcErrors(noise=1e-5), noise_seed=3))
    made.talk.write("TRIG:DEL 0;:SAMP:COUN 400")
    readings = [float(text) for text in (made.talk.ask("READ?") or "").split(",")][20:]
    assert float(np.std(readings)) == pytest.approx(1e-4, rel=0.13)  # 3.5 sigma of the spread of 380 readings


def _limit(frequency_hz: float) -> tuple[float, float]:
    """Published one-year accuracy on the 10 V range, parts of reading and range (p. 218)."""
    classes = ((5.0, 1e-2, 3e-4), (10.0, 3.5e-3, 3e-4), (2e4, 6e-4, 3e-4), (5e4, 1.2e-3, 5e-4), (1e5, 6e-3, 8e-4))
    return next(((r, o) for top, r, o in classes if frequency_hz <= top), (4e-2, 5e-3))


@pytest.mark.parametrize("frequency_hz", few([3.0, 4.9, 9.9, 10.1, 1e3, 19.9e3, 49.9e3, 99.9e3, 3e5], every=4))
def test_a_thousand_specimens_are_within_the_published_accuracy_and_differ(frequency_hz: float) -> None:
    piece = Piece(0.0, 10.0, 0.0, (Sine(5.0 * math.sqrt(2.0), frequency_hz, 0.0),), np.zeros_like)
    of_reading, of_range = _limit(frequency_hz)
    errors = []
    for specimen in (each.ac for each in specimens()):
        seen = abs(complex(AcResponse(3.0, specimen).at(np.array([frequency_hz]))[0])) * 5.0
        errors.append(seen + specimen.range_share * 3e-4 * 10.0 - 5.0)
    assert max(map(abs, errors)) <= of_reading * 5.0 + of_range * 10.0
    spread = float(np.std(errors))
    assert spread > 0.02 * (of_reading * 5.0 + of_range * 10.0)
    assert 0.6 < float(np.mean(np.abs(np.array(errors) - np.mean(errors)) < spread)) < 0.8  # a normal one has 0.68
    assert detect([piece], 1.0, 8.0, AcResponse(3.0, AcErrors())).rms_v == pytest.approx(5.0, rel=6e-3)


@pytest.mark.exhaustive
@settings(max_examples=15, deadline=None)
@given(
    st.lists(st.tuples(st.floats(0.01, 3.0), st.floats(50.0, 3e5), st.floats(0.0, 6.0)), min_size=1, max_size=5),
    st.floats(0.0, 1.0),
)
def test_the_weighted_power_is_the_integral(parts: list[tuple[float, float, float]], split: float) -> None:
    """Against a fine sum over the raised cosine, the window being cut in two pieces at any place."""
    sines = tuple(Sine(*part) for part in parts)
    cut = 0.1 * split
    pieces = [_piece(sines, 0.0, cut), _piece(sines, cut, 0.1)]
    seen = detect([piece for piece in pieces if piece.stop_s > piece.start_s], 0.0, 0.1, AcResponse(20.0, AcErrors()))
    times = (np.arange(1_000_003) + 0.5) * (0.1 / 1_000_003)
    volts = np.zeros_like(times)
    for each in sines:
        passed_by = complex(AcResponse(20.0, AcErrors()).at(np.array([each.frequency_hz]))[0])
        volts += (
            abs(passed_by)
            * each.amplitude_v
            * np.sin(2 * np.pi * each.frequency_hz * times + each.phase_rad + np.angle(passed_by))
        )
    power = float((volts**2 * (1 - np.cos(2 * np.pi * times / 0.1))).mean())
    assert seen.rms_v == pytest.approx(math.sqrt(power), rel=2e-5)


def _piece(sines: tuple[Sine, ...], start_s: float, stop_s: float) -> Piece:
    turned = tuple(
        Sine(each.amplitude_v, each.frequency_hz, each.phase_rad + 2 * math.pi * each.frequency_hz * start_s)
        for each in sines
    )
    return Piece(start_s, stop_s, 0.0, turned, np.zeros_like)


@pytest.mark.parametrize("frequency_hz", [1e3, 1e5, 1e6])
def test_generator_at_a_megahertz_reads_its_output(frequency_hz: float) -> None:
    world = World(VirtualClock(), ideal_bench(), 0)
    meter = Hp34401ATwin(world, node="v_vc", errors=MeterErrors.none())
    talk = Conversation(meter, world.clock)
    world.drive("v_vc", Drive(0.2, 1.0, frequency_hz, 0.4, source_ohm=0.0))
    read = float(talk.ask("MEAS:VOLT:AC? 1") or "nan")
    assert read == pytest.approx(passed(frequency_hz) / math.sqrt(2.0), rel=1e-6)
    assert float(talk.ask("MEAS:FREQ?") or "nan") == pytest.approx(frequency_hz, rel=1e-9)
