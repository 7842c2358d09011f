"""Noise between the instants that a run has drawn: waveforms see the noise that readings see, and change nothing."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.linalg import expm, solve_continuous_lyapunov
from simrack.instruments.hp34401a.ac import AcResponse, detect
from simrack.instruments.hp34401a.imperfections import MeterErrors
from simrack_tests.cells import few

from tests.sim.gyro.bench import locked_chain, mean_v, powered
from tests.sim.gyro.plain import flutter_density, noise_matrices, rate_response
from vcfbench.sim.gyro.bridge import NoisePath
from vcfbench.sim.gyro.data_sheet import own_gyro
from vcfbench.sim.gyro.design import ideal_bench, paper_bench
from vcfbench.sim.gyro.noise import FlickerNoise, NoiseState, NoisyChain
from vcfbench.testing.gyroscopes import drawn_sheet

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from vcfbench.clock import VirtualClock
    from vcfbench.sim.parameters import BenchParameters
    from vcfbench.sim.world import World

PAPER = paper_bench()
STILL = replace(PAPER, thermal=replace(PAPER.thermal, self_heating_k=0.0))
WHITE = math.radians(PAPER.noise.angle_random_walk_deg_sqrt_s)
COUNT = PAPER.noise.flicker_processes
FILTERED, INTEGRAL = 10, 12 + COUNT
"""Rows of the plainly written system."""


def noisy() -> NoisyChain:
    return NoisyChain(locked_chain(PAPER), FlickerNoise.of(PAPER.noise), WHITE)


def white_only() -> BenchParameters:
    return replace(STILL, noise=replace(STILL.noise, bias_instability_deg_s=0.0))


def stationary(bench: BenchParameters) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """A, G G' and the stationary covariance of the plainly written system, its integral left out.

    Equation A S + S A' + G G' = 0, every process scaled to about one first.
    """
    a, q = (each[:INTEGRAL, :INTEGRAL] for each in noise_matrices(bench))
    scale = np.ones(INTEGRAL)
    scale[[2, 3, 6, 7]] = 2 * math.pi * bench.drive_mode.frequency_hz
    a, q = a * scale[None, :] / scale[:, None], q / np.multiply.outer(scale, scale)
    return a, q, solve_continuous_lyapunov(a, -q)


def density(bench: BenchParameters, frequencies_hz: NDArray[np.float64]) -> NDArray[np.float64]:
    """One-sided density of the output's noise, V^2/Hz, from the plainly written system."""
    a, q, _ = stationary(bench)
    row = np.zeros(INTEGRAL)
    row[FILTERED] = bench.output_stage.gain
    densities = []
    for frequency in frequencies_hz:
        seen = np.linalg.solve((2j * math.pi * frequency * np.eye(INTEGRAL) - a).T, row)
        densities.append(2.0 * (seen @ q @ seen.conj()).real)
    return np.array(densities)


def deviation_v(bench: BenchParameters) -> float:
    """Standard deviation of the output about its slow wander: the white part."""
    return abs(bench.output_stage.gain) * math.sqrt(stationary(bench)[2][FILTERED, FILTERED])


def stepped(chain: NoisyChain, duration_s: float, seed: int) -> tuple[NoisePath, NoiseState, NoiseState, float]:
    """A stationary state, a step from it, and the path of that step."""
    random = np.random.default_rng(seed)
    start, _ = chain.step(NoiseState.of(np.zeros(8, complex), np.zeros(COUNT)), 1e6, random)
    end, integral = chain.step(start, duration_s, random)
    path = NoisePath(chain, start, end, integral_v_s=integral, duration_s=duration_s, key=(seed, 5))
    return path, start, end, integral


@pytest.mark.parametrize("duration_s", [0.2e-3, 0.6e-3, 0.01, 0.2, 1.9, 7.0])
def test_path_keeps_ends_and_mean_of_its_step(duration_s: float) -> None:
    chain = noisy()
    to_filtered = locked_chain(PAPER).to_filtered
    for seed in range(3):
        path, start, end, integral = stepped(chain, duration_s, seed)
        size = deviation_v(PAPER) / abs(PAPER.output_stage.gain)
        seen = path.filtered(np.array([0.0, duration_s]))
        assert seen[0] == pytest.approx((to_filtered @ start.modal).real, abs=1e-9 * size)
        assert seen[1] == pytest.approx((to_filtered @ end.modal).real, abs=1e-9 * size)
        middles = duration_s * (np.arange(20_000) + 0.5) / 20_000
        assert path.filtered(middles).mean() == pytest.approx(integral / duration_s, abs=3e-6 * size)


@pytest.mark.exhaustive
def test_noise_within_step_has_covariance_of_uncut_noise() -> None:
    """At five instants of 60 ms against exp(A t) S of the plainly written system; 800 draws know it to 5 %."""
    chain, duration_s = noisy(), 0.06
    instants = duration_s * np.array([0.0, 0.13, 0.5, 0.77, 1.0])
    drawn = np.array([stepped(chain, duration_s, seed)[0].filtered(instants) for seed in range(800)])
    a, _, s = stationary(PAPER)
    wanted = np.array([[(expm(a * abs(t - u)) @ s)[FILTERED, FILTERED] for t in instants] for u in instants])
    seen = drawn.T @ drawn / len(drawn)
    assert np.max(np.abs(seen - wanted)) < 5 * math.sqrt(2 / len(drawn)) * wanted[0, 0]


@pytest.mark.exhaustive
def test_halved_stretch_has_same_noise() -> None:
    """40 s, looked at where two of its parts meet and far from them: variance, and covariance over 10 ms."""
    chain, white = NoisyChain(locked_chain(PAPER), FlickerNoise(np.array([1.0] * COUNT), 0.0), WHITE), white_only()
    instants = np.array([0.3, 0.31, 19.995, 20.005, 33.0, 33.01])
    drawn = np.array([stepped(chain, 40.0, seed)[0].filtered(instants) for seed in range(40)])
    a, _, s = stationary(white)
    lagged = (expm(0.01 * a) @ s)[FILTERED, FILTERED]
    pairs = drawn.reshape(-1, 2)
    assert (drawn**2).mean() == pytest.approx(s[FILTERED, FILTERED], rel=5 * math.sqrt(2 / drawn.size) * 1.4)
    assert pairs.prod(axis=1).mean() == pytest.approx(lagged, abs=5 / math.sqrt(120) * 1.4 * s[FILTERED, FILTERED])


def looked_at(seed: int, *, often: bool) -> tuple[list[float], list[float]]:
    """Means of 0.2 s, a record in between, looked at from outside or not."""
    clock, world = powered(PAPER, seed)
    means = []
    for index in range(6):
        start = clock.now()
        window, capture = world.window("output", start, start + 0.2), world.capture(start, start + 0.2)
        clock.sleep_until(start + 0.2)
        if often and index % 2:
            capture.samples("output", np.linspace(start, start + 0.2, 300))
            capture.samples("sense", np.linspace(start + 0.1, start + 0.11, 50))
        means.append(window.mean_v())
    return means, [world.value_v("output"), world.value_v("sense")]


def test_looking_at_a_waveform_changes_nothing_that_is_drawn_later() -> None:
    assert looked_at(3, often=True) == looked_at(3, often=False)


def test_instant_shows_same_volts_in_any_order() -> None:
    def record(order: list[int]) -> NDArray[np.float64]:
        clock, world = powered(PAPER, 8)
        start = clock.now()
        capture = world.capture(start, start + 9.0)
        clock.sleep_until(start + 9.0)
        times = start + np.linspace(0.0, 9.0, 40)
        seen = np.empty(40)
        for index in order:
            seen[index] = capture.samples("output", times[index : index + 1])[0]
        return seen

    forward = record(list(range(40)))
    assert np.array_equal(forward, record(list(range(39, -1, -1))))
    assert np.array_equal(forward, record([*range(0, 40, 3), *range(1, 40, 3), *range(2, 40, 3)]))


def captured(clock: VirtualClock, world: World, seconds: float, rate_hz: float) -> tuple[NDArray[np.float64], float]:
    """A record of the output half a second later, and the mean that a window saw over the same time."""
    start = clock.now() + 0.5
    capture, window = world.capture(start, start + seconds), world.window("output", start, start + seconds)
    clock.sleep_until(start + seconds)
    times = start + (np.arange(round(seconds * rate_hz)) + 0.5) / rate_hz
    return capture.samples("output", times), window.mean_v()


@pytest.mark.parametrize(("seconds", "records"), few([(0.02, 40), (0.2, 40), (2.0, 10), (10.0, 4)], (0.2, 40)))
def test_noise_at_end_of_record_equals_noise_at_start(seconds: float, records: int) -> None:
    """Rms in tenths of a record about the true mean against the closed form; each tenth within four of its errors."""
    quiet = powered(replace(STILL, noise=replace(STILL.noise, angle_random_walk_deg_sqrt_s=0.0)), 0)
    level = mean_v(*quiet, 0.1)
    squares = []
    bench = powered(white_only(), 1)
    for _ in range(records):
        volts, mean = captured(*bench, seconds, max(5e3, 400 / seconds))
        assert mean == pytest.approx(volts.mean(), abs=3e-8)
        squares.append(((volts - level) ** 2).reshape(10, -1).mean(axis=1))
    a, _, s = stationary(white_only())
    lags = np.linspace(0.0, seconds / 10, 400)
    once = expm(a * (lags[1] - lags[0]))
    state, covariances = s, []
    for _ in lags:
        covariances.append(state[FILTERED, FILTERED])
        state = once @ state
    part = np.array(covariances) / covariances[0]
    # variance of the mean square of a Gaussian record: 2 C^2 2/T int (1 - t/T) (C(t)/C)^2 dt
    spread = 2 * 2 * np.trapezoid((1 - lags / lags[-1]) * part**2, lags) / lags[-1]
    seen = np.mean(squares, axis=0) / deviation_v(white_only()) ** 2
    assert seen == pytest.approx(np.ones(10), abs=4 * math.sqrt(spread / records))


def welch(volts: NDArray[np.float64], rate_hz: float, length: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """One-sided density by averaged Hann periodograms that overlap by half."""
    window = np.hanning(length)
    parts = np.lib.stride_tricks.sliding_window_view(volts - volts.mean(), length)[:: length // 2]
    powers = np.abs(np.fft.rfft(parts * window)) ** 2
    return np.fft.rfftfreq(length, 1 / rate_hz), 2 * powers.mean(axis=0) / (rate_hz * (window**2).sum())


def bands(frequencies_hz: NDArray[np.float64], densities: NDArray[np.float64]) -> NDArray[np.float64]:
    """Power in bands around the peak at the split, on its slopes and up the filter's edge, V^2."""
    edges = [3.0, 12.0, 20.0, 24.0, 26.0, 32.0, 50.0, 80.0, 130.0]
    step = frequencies_hz[1] - frequencies_hz[0]
    within = [(frequencies_hz >= low) & (frequencies_hz < high) for low, high in itertools.pairwise(edges)]
    return np.array([densities[each].sum() * step for each in within])


@pytest.mark.exhaustive
def test_the_spectrum_of_a_record_is_the_closed_form() -> None:
    """60 s in one record: a band of 3 Hz holds some 180 independent figures; within 4 of their errors."""
    volts, _ = captured(*powered(white_only(), 21), 60.0, 2e3)
    frequencies, seen = welch(volts, 2e3, 4000)
    ratio = bands(frequencies, seen) / bands(frequencies, density(white_only(), frequencies))
    widths = np.array([9.0, 8.0, 2.0, 2.0, 6.0, 18.0, 30.0, 50.0])
    assert np.all(np.abs(ratio - 1) < 4 / np.sqrt(60.0 * np.minimum(widths, 3.0)))


@pytest.mark.exhaustive
def test_fast_readings_have_the_spectrum_of_the_record() -> None:
    """Means of 1 ms, one after the other for 10 s: the closed form times (sin(x)/x)^2, x = pi f 1 ms."""
    clock, world = powered(white_only(), 22)
    means = np.array([mean_v(clock, world, 1e-3) for _ in range(10_000)])
    frequencies, seen = welch(means, 1e3, 2000)
    wanted = density(white_only(), frequencies) * np.sinc(frequencies * 1e-3) ** 2
    ratio = bands(frequencies, seen) / bands(frequencies, wanted)
    widths = np.array([9.0, 8.0, 2.0, 2.0, 6.0, 18.0, 30.0, 50.0])
    assert np.all(np.abs(ratio - 1) < 4 / np.sqrt(10.0 * np.minimum(widths, 3.0)))


def test_sense_noise_is_demodulated_noise() -> None:
    """A record of V_s, multiplied and filtered by hand, gives the output of the same time.

    Of what lies beyond 1 kHz from the carrier, 1e-3 of the power, a part is folded back: some 2 % of the noise.
    """
    rate_hz, seconds = 40e3, 1.0
    clock, world = powered(white_only(), 5)
    start = clock.now()
    capture = world.capture(start, start + seconds)
    clock.sleep_until(start + seconds)
    times = start + np.arange(round(seconds * rate_hz)) / rate_hz
    sense, drive = capture.samples("sense", times), capture.samples("drive", times)
    path, stage = PAPER.sense_path, PAPER.output_stage
    # the drive pick-off is -cos(th): its analytic signal gives the phase of the reference, sin(th + phi)
    spectrum = np.fft.fft(drive)
    spectrum[len(drive) // 2 :] = 0.0
    phase = np.angle(-np.fft.ifft(spectrum))
    reference = path.reference_amplitude_v * np.sin(phase + path.demodulator_phase_rad)
    product = np.fft.rfft(path.multiplier_per_v * reference * sense)
    f = np.fft.rfftfreq(len(times), 1 / rate_hz) / path.low_pass_hz
    poles = [np.exp(1j * math.pi * (2 * k + 5) / 8) for k in range(4)]
    filtered = np.fft.irfft(product / np.prod([1j * f - pole for pole in poles], axis=0), len(times))
    u = stage.gain * filtered
    wanted = stage.offset_v + u + stage.second_order_per_v * u**2 + stage.third_order_per_v2 * u**3
    seen = capture.samples("output", times)
    middle = slice(len(times) // 10, -len(times) // 10)  # the record's ends are those of a circle here
    assert np.std(seen[middle] - wanted[middle]) < 0.03 * np.std(seen[middle])


@pytest.mark.parametrize("drive_hz", [3490.0, 24_490.0, 50_000.0])
def test_sense_noise_is_at_its_modes_for_any_beat(drive_hz: float) -> None:
    """The in-phase mode is 4 % below the drive, 2.1 kHz of 50: nothing of it is folded back onto the other side."""
    sheet = replace(drawn_sheet(1), drive_hz=drive_hz, split_hz=25.0, q_sense=0.2 * drive_hz, q_drive=1000.0)
    chain = NoisyChain(
        locked_chain(own_gyro(sheet, imperfections=False, latitude_deg=0.0)), FlickerNoise.of(PAPER.noise), WHITE
    )
    duration_s, count = 1.0, 1 << 14
    power = np.zeros(count)
    for seed in range(4):
        seen = stepped(chain, duration_s, seed)[0].sense(duration_s / count * np.arange(count))
        power += np.abs(np.fft.fft(seen * np.hanning(count))) ** 2
    offset_hz = np.fft.fftfreq(count, duration_s / count)
    at_mode = power[np.abs(offset_hz + sheet.in_phase_split_hz) < 30.0].max()
    elsewhere = power[np.abs(offset_hz) > 1.2 * sheet.in_phase_split_hz].max()
    other_side = power[(offset_hz > 0.6 * sheet.in_phase_split_hz)].max()
    assert max(elsewhere, other_side) < 0.03 * at_mode


def test_flutter_of_the_table_is_in_the_waveforms_too() -> None:
    """1e-3 of 300 deg/s per root hertz drowns all else; tenths of a record of 2 s, by the unit of rate noise."""
    ideal = ideal_bench()
    bench = replace(ideal, table=replace(ideal.table, flutter_per_sqrt_hz=1e-3))
    clock, world = turned(bench, 300.0)
    squares = []
    for _ in range(6):
        start = clock.now()
        capture, window = world.capture(start, start + 2.0), world.window("output", start, start + 2.0)
        clock.sleep_until(start + 2.0)
        volts = capture.samples("output", start + (np.arange(20_000) + 0.5) * 1e-4)
        assert window.mean_v() == pytest.approx(volts.mean(), abs=1e-6)
        squares.append((volts - 300.0 * -12.542052e-3).reshape(10, -1).var(axis=1))
    seen = np.sqrt(np.mean(squares, axis=0))
    assert np.max(np.abs(seen / seen.mean() - 1)) < 0.35
    frequencies = np.arange(0.05, 2000.0, 0.05)
    squared = flutter_density(bench, frequencies) * rate_response(bench, frequencies) ** 2
    assert seen.mean() == pytest.approx(300.0 * 12.542052e-3 * math.sqrt(squared.sum() * 0.05), rel=0.1)


def turned(bench: BenchParameters, rate_deg_s: float) -> tuple[VirtualClock, World]:
    clock, world = powered(bench, 3)
    world.table.demand_rate(rate_deg_s, 1000.0)
    clock.sleep_until(8.0)
    return clock, world


@pytest.mark.exhaustive
def test_ac_volts_of_output_follow_closed_form() -> None:
    """20 readings with the 20 Hz filter: the root of the density times the response squared, within five errors."""
    frequencies = np.arange(0.05, 400.0, 0.05)
    response = AcResponse(20.0, MeterErrors.none().ac)
    wanted = math.sqrt((density(white_only(), frequencies) * np.abs(response.at(frequencies)) ** 2).sum() * 0.05)
    clock, world = powered(white_only(), 9)
    trace = world.trace(2.0)
    readings = []
    for _ in range(20):
        clock.sleep_until(clock.now() + 1.5)
        readings.append(detect(trace.pieces("output"), clock.now() - 1.0, clock.now(), response).rms_v)
    seen = math.sqrt(np.mean(np.square(readings)))
    assert seen == pytest.approx(wanted, abs=5 * np.std(readings) / math.sqrt(20))
    assert np.std(readings) < 0.3 * wanted
