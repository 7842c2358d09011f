"""What is played, piece by piece, against what it is at every instant."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simrack.instruments.agilent33220a.envelopes import Envelope, WidthSwing
from simrack.instruments.agilent33220a.noise import NoiseSource, gaussian
from simrack.instruments.agilent33220a.phases import (
    Bursts,
    Deviated,
    Keyed,
    Rhythm,
    Shifted,
    Steady,
    Swept,
    continued,
)
from simrack.instruments.agilent33220a.playing import Playing
from simrack.instruments.agilent33220a.waveforms import PulseCycle, SineCycle, held, ramp, turned

from simrack_tests.cells import few

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from simrack.instruments.agilent33220a.waveforms import Cycle
    from simrack.sources import Bend, Piece, Played

BEND: Bend = (0.01, 0.9, 0.05, 0.02)
WAVEFORMS: dict[str, Cycle] = {
    "sine": SineCycle(),
    "pulse": PulseCycle(0.3),
    "triangle": ramp(0.5),
    "rise": ramp(1.0),
    "fall": ramp(0.0),
    "points": held([0.1, -1.0, 0.4, 0.4, 1.0]),
}


@pytest.mark.parametrize("name", WAVEFORMS)
@settings(max_examples=20, deadline=None)
@given(place=st.floats(0.0, 1.0), power=st.sampled_from([1, 2, 3]))
def test_integrals_are_those_of_the_values(name: str, place: float, power: int) -> None:
    waveform = WAVEFORMS[name]
    parts = (np.arange(200_000) + 0.5) / 200_000 * place
    area = place * float((waveform.values(parts) ** power).mean()) if place else 0.0
    assert waveform.integral(power, np.array([place]))[0] == pytest.approx(area, abs=2e-5)


def test_integrals_go_on_over_whole_cycles_backwards_too() -> None:
    rise = held([1.0, 0.0])
    np.testing.assert_allclose(turned(rise, np.array([-1.25, -0.5, 0.25, 1.0, 2.75])), [-0.5, 0.0, 0.25, 0.5, 1.5])


def bent(volts: NDArray[Any]) -> NDArray[Any]:
    return BEND[0] + BEND[1] * volts + BEND[2] * volts**2 + BEND[3] * volts**3


def written_out(piece: Piece, times: NDArray[Any]) -> NDArray[Any]:
    since = times - piece.start_s
    swung = sum((a * np.exp(s * since)).real for a, s in piece.terms)
    return np.asarray(piece.constant + piece.slope_per_s * since + swung)


def slowly(values: NDArray[Any], share: int) -> NDArray[Any]:
    """Three running means one after the other."""
    kernel = np.ones(share) / share
    for _ in range(3):
        values = np.convolve(values, kernel, "valid")
    return values


TONE = Rhythm(SineCycle(), 40.0)
PLAYED = {
    "sine": Playing(0.3, 1.0, SineCycle(), Steady(100.0, 0.2)),
    "square by lines": Playing(0.3, 1.0, PulseCycle(0.3, 1e-6), Steady(100.0, 0.2)),
    "square by levels": Playing(0.3, -1.0, PulseCycle(0.3, 1e-6), Steady(7.0, 0.2)),
    "ramp": Playing(0.3, 1.0, ramp(0.25), Steady(1.0, 0.9)),
    "few points": Playing(0.3, 1.0, held([0.0, 1.0, -0.5]), Steady(1.0, 0.9)),
    "many points": Playing(0.3, 1.0, held(np.cos(np.arange(6000) / 500).tolist()), Steady(1.0, 0.2)),
    "FM": Playing(0.3, 1.0, SineCycle(), Deviated(500.0, 200.0, TONE)),
    "PM of a ramp": Playing(0.3, 1.0, ramp(0.5), Shifted(500.0, 0.4, TONE)),
    "FSK": Playing(0.3, 1.0, SineCycle(), Keyed(500.0, 200.0, 100.0)),
    "sweep": Playing(0.3, 1.0, PulseCycle(0.5), Swept(100.0, 4000.0, 0.02, logarithmic=True, from_s=0.0, again=True)),
    "bursts": Playing(0.3, 1.0, SineCycle(), Bursts(1000.0, 3.0, 0.0, 5e-3, 0.125)),
    "bursts beyond hearing": Playing(0.3, 1.0, SineCycle(), Bursts(300e3, 30.0, 0.0, 1e-3, 0.125)),
    "AM of a square": Playing(0.3, 1.0, PulseCycle(0.5), Steady(300.0), Envelope(0.8, TONE, 10.0)),
    "AM of a fast carrier": Playing(0.3, 1.0, SineCycle(), Steady(1.1e6), Envelope(0.8, TONE, 10.0)),
    "PWM": Playing(0.3, 1.0, PulseCycle(0.5), Steady(300.0), None, WidthSwing(0.5, 0.3, TONE)),
    "PWM of fast pulses": Playing(0.3, 1.0, PulseCycle(0.5), Steady(1.1e6), None, WidthSwing(0.5, 0.3, TONE)),
}  # fmt: skip


@pytest.mark.parametrize("name", few(PLAYED, "square by levels", "FM", "bursts", "PWM"))
def test_pieces_are_what_the_input_makes_of_the_volts(name: str) -> None:
    """Behind three means over 1 ms: what is cut off at 16 kHz is 1e-5 then, (0.5 ms pi 16 kHz)^-3 of an edge.

    The samples here see a piece's end half a microsecond late; PWM takes the width in the middle of 4 us.
    """
    playing = PLAYED[name]
    start, step = 1.2345, 1.7e-6
    times = start + (np.arange(20_000, dtype=np.float64) + 0.5) * step
    finely = times[:, None] + (np.arange(50) - 24.5) / 50 * step
    made, reached = np.empty_like(times), start
    while reached < times[-1]:
        piece = playing.piece(reached, BEND)
        here = (times >= reached) & (times < piece.stop_s)
        made[here] = written_out(piece, times[here])
        reached = piece.stop_s
    seen = bent(playing.at(finely.ravel())).reshape(len(times), 50).mean(axis=1)
    assert np.abs(slowly(made - seen, 600)).max() < (1e-3 if "level" in name or "PWM" in name else 2e-4)


def test_a_corner_is_left_behind_once_it_is_reached() -> None:
    playing = Playing(0.0, 1.0, PulseCycle(0.5), Steady(0.1, 0.0))
    reached, levels = 0.3, []
    for _ in range(6):
        piece = playing.piece(reached, (0.0, 1.0, 0.0, 0.0))
        levels.append((round(piece.stop_s, 9), piece.constant))
        reached = piece.stop_s
    assert levels == [(5.0, 1.0), (10.0, -1.0), (15.0, 1.0), (20.0, -1.0), (25.0, 1.0), (30.0, -1.0)]


@settings(max_examples=25, deadline=None)
@given(st.floats(1e-6, 31.0), st.floats(0.01, 0.99), st.floats(0.0, 1e6))
def test_pieces_of_slow_pulses_always_go_on(hertz: float, duty: float, start: float) -> None:
    playing, reached = Playing(0.0, 1.0, PulseCycle(duty), Steady(hertz, 0.123)), start
    for _ in range(5):
        piece = playing.piece(reached, BEND)
        assert piece.stop_s > reached
        reached = piece.stop_s


@pytest.mark.parametrize(
    ("phase", "instant", "run"),
    [
        (Steady(5.0, 0.25), 2.0, (5.0, 10.25, math.inf)),
        (Keyed(10.0, 4.0, 2.0), 0.1, (10.0, 1.0, 0.25)),
        (Keyed(10.0, 4.0, 2.0), 0.25, (4.0, 2.5, 0.5)),
        (Bursts(10.0, 3.0, 1.0, 0.5, 0.1), 0.2, (0.0, 0.1, 1.0)),
        (Bursts(10.0, 3.0, 1.0, 0.5, 0.1), 1.0, (10.0, 0.1, 1.3)),
        (Bursts(10.0, 3.0, 1.0, 0.5, 0.1), 1.3, (0.0, 0.1, 1.5)),
        (Bursts(10.0, 3.0, 1.0, math.inf, 0.1), 1.3, (0.0, 0.1, math.inf)),
        (Bursts(10.0, math.inf, 1.0, math.inf, 0.1), 1.3, (10.0, 3.1, math.inf)),
        (Swept(10.0, 20.0, 1.0, logarithmic=False, from_s=3.0, again=False), 1.0, (10.0, -20.0, 3.0)),
        (Swept(10.0, 20.0, 1.0, logarithmic=False, from_s=3.0, again=False), 5.0, (10.0, 25.0, math.inf)),
    ],
)  # fmt: skip
def test_stretches_of_one_frequency(phase: Any, instant: float, run: tuple[float, float, float]) -> None:
    assert phase.run(instant) == pytest.approx(run, abs=1e-9)


def test_while_the_frequency_changes_there_is_no_such_stretch() -> None:
    sweeping = Swept(1.0, 2.0, 1.0, logarithmic=True, from_s=0.0, again=True)
    changing = (Deviated(5.0, 1.0, TONE), Shifted(5.0, 1.0, TONE), sweeping)
    assert [each.run(0.5) for each in changing] == [None, None, None]


def test_a_phase_goes_on_from_the_one_before() -> None:
    before, now = Deviated(1234.5, 300.0, TONE, 0.4), 7.77
    after = continued(Steady(999.0), before, now)
    instant = np.array([now])
    assert math.remainder(float((after.at(instant) - before.at(instant))[0]), 1.0) == pytest.approx(0.0, abs=1e-9)
    assert continued(Deviated(1234.5, 300.0, TONE), before, now) is before


# --- noise --------------------------------------------------------------------------------------------------------

TICK_S = 25e-9


def test_gaussians_have_their_moments_and_do_not_know_each_other() -> None:
    one, other = gaussian(1, 0, np.arange(200_000)), gaussian(1, 1, np.arange(200_000))
    assert abs(one.mean()) < 0.01
    assert one.std() == pytest.approx(1.0, abs=0.01)
    assert float((one**4).mean()) == pytest.approx(3.0, abs=0.1)
    assert abs(np.corrcoef(one, other)[0, 1]) < 0.01
    assert abs(np.corrcoef(one[1:], one[:-1])[0, 1]) < 0.01
    assert np.all(np.isfinite(gaussian(2**63, 9, np.array([-(2**60), 0, 2**60]))))


def test_mean_of_piece_is_mean_of_its_readings() -> None:
    noise, whole = NoiseSource(0.2, 0.5, 11), 512 * TICK_S
    for number in (0, 7, 123_456):
        ticks = (512 * number + np.arange(512, dtype=np.float64) + 0.5) * TICK_S
        # of eight ticks at either end a part belongs to the neighbours: 0.5 V sqrt(8) / 512
        assert noise.at(ticks).mean() - 0.2 == pytest.approx(float(noise._means_v(np.array([number]))[0]), abs=6e-3)
        piece = noise.piece(number * whole + 1e-9, (0.0, 1.0, 0.0, 0.0))
        means = 0.2 + noise._means_v(np.arange(number, number + 2048))
        assert piece.constant == pytest.approx(float(means.mean()))
        assert piece.stop_s == pytest.approx((number + 2048) * whole)


def test_noise_is_equal_between_ticks_and_flat_to_9_mhz() -> None:
    """By the transform of a record: 3 dB down at 9 MHz, and no line of nulls at the rate of the ticks."""
    noise, places = NoiseSource(0.0, 1.0, 3), np.arange(0.0, 1.0, 0.125)
    loudness = [float(noise.at((np.arange(100_000) + place) * TICK_S).std()) for place in places]
    assert loudness == pytest.approx([1.0] * len(places), abs=0.01)
    seen = noise.at(np.arange(1 << 19) * 5e-9).reshape(-1, 4096)
    powers = (np.abs(np.fft.rfft(seen * np.hanning(4096))) ** 2).mean(axis=0)
    hertz = np.fft.rfftfreq(4096, 5e-9)

    def level_db(near_hz: float) -> float:
        near, slow = np.abs(hertz - near_hz) < 0.5e6, (hertz > 0.2e6) & (hertz < 2e6)
        return 10.0 * math.log10(float(powers[near].mean() / powers[slow].mean()))

    assert level_db(5e6) == pytest.approx(-0.4, abs=0.4)
    assert level_db(9e6) == pytest.approx(-3.0, abs=0.5)
    assert level_db(28e6) < -40.0


@pytest.mark.parametrize("source", [NoiseSource(0.4, 0.5, 3), *list(PLAYED.values())[:2]])
def test_behind_a_load_everything_is_divided(source: Played) -> None:
    times = np.linspace(0.0, 0.1, 50)
    loaded = source.divided(0.25)
    np.testing.assert_allclose(loaded.at(times), source.at(times) / 4)
    assert loaded.source_ohm == 12.5
