from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.linalg import expm
from simrack.flutter import Flutter
from simrack.motion import RateSegment
from simrack_tests.cells import few

from tests.sim.gyro.bench import locked_chain, mean_v, powered
from tests.sim.gyro.plain import flutter_density, noise_matrices, rate_response
from vcfbench.sim.gyro.chain import ChainDesign, Forcing
from vcfbench.sim.gyro.course import chain_at
from vcfbench.sim.gyro.design import ideal_bench, paper_bench
from vcfbench.sim.gyro.drive import locked
from vcfbench.sim.gyro.noise import STEPS_KEPT, FlickerNoise, Interval, NoiseState, NoisyChain
from vcfbench.sim.gyro.noise_course import NOISE_STEP_K
from vcfbench.sim.gyro.shaken import Shaking
from vcfbench.sim.gyro.signals import real_terms
from vcfbench.sim.gyro.thermal import resonance_at

if TYPE_CHECKING:
    from vcfbench.clock import VirtualClock
    from vcfbench.sim.world import World

PAPER = paper_bench()
WHITE = math.radians(PAPER.noise.angle_random_walk_deg_sqrt_s)
COUNT = PAPER.noise.flicker_processes


def noisy() -> NoisyChain:
    return NoisyChain(locked_chain(PAPER), FlickerNoise.of(PAPER.noise), WHITE)


def van_loan(interval_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Transition and covariance over an interval of the plainly written system, by doubling short Van Loan steps."""
    a, q = noise_matrices(PAPER)
    n, doublings = len(a), 20
    step = interval_s / 2**doublings
    block = expm(np.block([[-a, q], [np.zeros((n, n)), a.T]]) * step)
    transition = block[n:, n:].T
    covariance = transition @ block[:n, n:]
    for _ in range(doublings):
        covariance = transition @ covariance @ transition.T + covariance
        transition = transition @ transition
    return transition, covariance


@pytest.mark.parametrize(("interval_s", "tolerance"), [(0.001, 1e-4), (0.02, 1e-6), (0.2, 1e-6), (10.0, 1e-6)])
def test_covariance_meets_van_loan_of_the_plainly_written_system(interval_s: float, tolerance: float) -> None:
    """Within 1 ms nothing has passed the filter yet: a remainder of cancelled terms, 1e-5 of a meter's noise."""
    chain = locked_chain(PAPER)
    covariance = noisy().covariance(interval_s)
    n = len(chain.eigenmodes)
    # What both can show: filtered signal (Re of a weighted sum), flicker, integral.
    weights = chain.to_filtered
    rows = np.zeros((1 + COUNT + 1, len(covariance)))
    rows[0, :n], rows[0, n : 2 * n] = weights.real, -weights.imag
    rows[1:, 2 * n :] = np.eye(COUNT + 1)
    seen = rows @ covariance @ rows.T
    _, wanted = van_loan(interval_s)
    shown = np.array([10, *range(12, 12 + COUNT), 12 + COUNT])
    wanted = wanted[np.ix_(shown, shown)]
    scale = np.sqrt(np.diag(wanted))
    assert np.max(np.abs(seen - wanted) / np.outer(scale, scale)) < tolerance


def test_noise_step_is_propagation_plus_draw() -> None:
    chain, random = noisy(), np.random.default_rng(5)
    state = NoiseState.of(random.standard_normal(8) + 1j * random.standard_normal(8), random.standard_normal(COUNT))
    once = chain.interval(0.2)
    drawn = once.factor @ np.random.default_rng(7).standard_normal(len(once.factor))
    wanted = once.later(state).plus(drawn)
    after, integral_v_s = chain.step(state, 0.2, np.random.default_rng(7))
    np.testing.assert_allclose(after.modal, wanted.modal, rtol=1e-12)
    np.testing.assert_allclose(after.rates_rad_s, wanted.rates_rad_s, rtol=1e-12)
    assert integral_v_s == pytest.approx(once.integral_of(state) + drawn[-1], rel=1e-12)


@pytest.mark.parametrize("temperature_c", [-30.0, 20.0, 85.0])
def test_half_a_step_of_temperature_hardly_changes_the_noise(temperature_c: float) -> None:
    """So the noise may pass a chain whose temperature goes in steps of `NOISE_STEP_K`: see `NoiseCourse`."""
    sizes = []
    for each in (temperature_c, temperature_c + 0.5 * NOISE_STEP_K):
        drive = locked(PAPER.drive_loop.amplitude_m, resonance_at(PAPER.drive_mode, PAPER.thermal, each).natural_rad_s)
        chain = NoisyChain(chain_at(ChainDesign(PAPER), PAPER, each, drive), FlickerNoise.of(PAPER.noise), WHITE)
        sizes.append([math.sqrt(chain.covariance(0.2)[-1, -1]), math.sqrt(chain.variance_v2(0.2))])
    np.testing.assert_allclose(sizes[1], sizes[0], rtol=1e-3)


def test_one_interval_has_the_distribution_of_a_thousand() -> None:
    """Propagated covariance: Phi Q Phi' + Q, a thousand times 1 ms against 1 s, for chain and flicker."""
    noise = noisy()
    n, k = 8, COUNT
    basis = [NoiseState.of(np.eye(n, dtype=complex)[i], np.zeros(k)) for i in range(n)]
    basis += [NoiseState.of(1j * np.eye(n)[i], np.zeros(k)) for i in range(n)]
    basis += [NoiseState.of(np.zeros(n, complex), np.eye(k)[i]) for i in range(k)]

    def transition(interval_s: float) -> np.ndarray:
        columns = []
        for state in basis:
            later = noise.interval(interval_s).later(state)
            columns.append(np.concatenate((later.modal.real, later.modal.imag, later.rates_rad_s)))
        return np.array(columns).T

    once, short = noise.covariance(1.0)[:-1, :-1], noise.covariance(0.001)[:-1, :-1]
    step, gathered = transition(0.001), np.zeros_like(short)
    for _ in range(1000):
        gathered = step @ gathered @ step.T + short
    scale = np.sqrt(np.diag(once))
    assert np.max(np.abs(gathered - once) / np.outer(scale, scale)) < 1e-9


def test_drawn_steps_have_the_covariance_they_claim() -> None:
    noise, random = noisy(), np.random.default_rng(7)
    rest = NoiseState.of(np.zeros(8, complex), np.zeros(COUNT))
    drawn = [noise.step(rest, 0.2, random) for _ in range(4000)]
    claimed = noise.covariance(0.2)
    rates = np.array([state.rates_rad_s for state, _ in drawn])
    integrals = np.array([integral for _, integral in drawn])
    # 4000 draws: a variance is known to 2.2 %; five times that.
    assert integrals.var() == pytest.approx(claimed[-1, -1], rel=0.11)
    assert rates.var(axis=0) == pytest.approx(np.diag(claimed)[16:-1], rel=0.11)


def test_flicker_stays_stationary_while_the_drive_does_not_run() -> None:
    """6000 draws, each carried on over a correlation time: a variance is known to 1.8 %; five times that."""
    flicker, random = FlickerNoise.of(PAPER.noise), np.random.default_rng(11)
    before = [flicker.drawn(random) for _ in range(6000)]
    after = np.array([flicker.later(rates, 8.0, random) for rates in before])
    assert after.var(axis=0) == pytest.approx(np.full(COUNT, flicker.deviation_rad_s**2), rel=0.09)
    kept = (np.array(before) * after).mean(axis=0) / flicker.deviation_rad_s**2
    assert kept == pytest.approx(np.exp(-8.0 / flicker.times_s), abs=5 / math.sqrt(6000))


def test_bench_begins_with_stationary_flicker() -> None:
    """Slow processes alone: 9 of them are 3.1e-3 deg/s of bias when power comes on, which no 4 s could gather."""
    slow = replace(PAPER.noise, angle_random_walk_deg_sqrt_s=0.0, flicker_shortest_s=1e4)
    bench = replace(PAPER, noise=slow)
    biases = [world.value_v("output") / 12.55e-3 for _, world in (powered(bench, seed) for seed in range(12))]
    # 11 degrees of freedom: chi-square bounds of 1 in 1000 either side
    assert 0.37 < np.std(biases, ddof=1) / 3.08e-3 < 1.7


def test_unequal_intervals_do_not_grow_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    plain, worked_out = NoisyChain.interval, list[float]()

    def counted(chain: NoisyChain, interval_s: float) -> Interval:
        worked_out.append(interval_s)
        return plain(chain, interval_s)

    monkeypatch.setattr(NoisyChain, "interval", counted)
    noise, random = noisy(), np.random.default_rng(5)
    state = NoiseState.of(np.zeros(8, complex), np.zeros(COUNT))
    intervals = np.linspace(0.001, 0.003, 200).tolist()
    for interval_s in (*intervals, intervals[-STEPS_KEPT], intervals[-STEPS_KEPT - 1]):
        state, _ = noise.step(state, interval_s, random)
    assert worked_out == pytest.approx([*intervals, intervals[-STEPS_KEPT - 1]], abs=1e-9)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_noise_goes_on_where_the_parameters_change(seed: int) -> None:
    """10 mV of supply move the amplitude by 2 ppm; the noise at an instant, 1 mV or so, must not begin anew."""
    _, world = powered(PAPER, seed)
    before = world.value_v("output")
    world.set_rail("positive", 9.99)
    assert world.value_v("output") == pytest.approx(before, abs=2e-6)


def test_long_and_short_steps_give_same_spread_of_mean() -> None:
    """Statistical: 1 s averages drawn in one step or in ten agree in variance, F-test at five sigma."""
    noise = noisy()

    def averages(parts: int, seed: int) -> np.ndarray:
        random, state, out = np.random.default_rng(seed), NoiseState.of(np.zeros(8, complex), np.zeros(COUNT)), []
        for _ in range(1500):
            total = 0.0
            for _ in range(parts):
                state, integral = noise.step(state, 1.0 / parts, random)
                total += integral
            out.append(total)
        return np.diff(out)

    ratio = averages(1, 1).var() / averages(10, 2).var()
    assert abs(math.log(ratio)) < 5 * math.sqrt(2 * 2 / 1000)


def allan_deviation(samples: np.ndarray, count: int) -> float:
    """Overlapped Allan deviation of samples at 1 s over clusters of `count`."""
    sums = np.concatenate(([0.0], np.cumsum(samples)))
    clusters = (sums[count:] - sums[:-count]) / count
    steps = clusters[count:] - clusters[:-count]
    return float(math.sqrt(0.5 * np.mean(steps**2)))


@pytest.fixture(scope="module")
def record_deg_h() -> np.ndarray:
    """20 000 full-duty 1 s averages of the output at rest and settled temperature, as a rate."""
    still = replace(PAPER, thermal=replace(PAPER.thermal, self_heating_k=0.0))
    clock, world = powered(still, seed=3)
    volts = np.array([mean_v(clock, world, 1.0) for _ in range(20_000)])
    return volts / 12.5527e-3 * 3600


def white_allan_variance(tau_s: float) -> float:
    """Allan variance of the open-loop response to white noise of density 1 in both quadratures, relative to its input.

    2 int |T(f)/T(0)|^2 2 sin^4(pi f tau)/(pi f tau)^2 df over both signs of f: the peak at the split adds 5 % at 1 s.
    """
    omega = 2 * math.pi * PAPER.drive_mode.frequency_hz
    f = np.arange(-100.0, 100.0, 1e-3) + 5e-4
    s, response, still = 2j * math.pi * f, np.zeros(len(f), complex), 0j
    for mode in (PAPER.sense_in_phase, PAPER.sense_anti_phase):
        w = 2 * math.pi * mode.frequency_hz
        response += 1 / ((s + 1j * omega) ** 2 + w / mode.quality * (s + 1j * omega) + w**2)
        still += 1 / (-(omega**2) + 1j * w * omega / mode.quality + w**2)
    phase = np.exp(-1j * PAPER.sense_path.demodulator_phase_rad)
    gain = np.abs(response) ** 2 / (still * phase).real ** 2
    x = math.pi * f * tau_s
    return float(np.sum(gain * 2 * np.sin(x) ** 4 / x**2) * 1e-3)


@pytest.mark.exhaustive
def test_white_part_is_0_21_deg_per_root_hour(record_deg_h: np.ndarray) -> None:
    """Least squares of sigma^2 = N^2 w(tau) + (2 ln 2/pi) B^2 over 1 to 8 s, w the shape of the open-loop response."""
    taus = np.array([1, 2, 3, 4, 6, 8])
    variances = np.array([allan_deviation(record_deg_h, int(t)) ** 2 for t in taus])
    white = np.array([white_allan_variance(float(t)) for t in taus])
    rows = np.column_stack((white, np.ones(len(taus)))) / variances[:, None]
    (found, _), *_ = np.linalg.lstsq(rows, np.ones(len(taus)), rcond=None)
    assert math.sqrt(found) / 60 == pytest.approx(0.21, rel=0.03)


def test_flicker_has_floor_at_3_7_deg_per_hour() -> None:
    """Sum of each process' Allan variance, 2 s^2 T/tau (1 - T/2tau (3 - 4 e^(-tau/T) + e^(-2tau/T)))."""
    noise = PAPER.noise
    variance = noise.bias_instability_deg_s**2 * math.log(4) / math.pi
    for tau in np.geomspace(4.0, 1000.0, 12):
        total = 0.0
        for index in range(noise.flicker_processes):
            t = noise.flicker_shortest_s * 4.0**index
            bracket = 1 - t / (2 * tau) * (3 - 4 * math.exp(-tau / t) + math.exp(-2 * tau / t))
            total += 2 * variance * t / tau * bracket
        assert math.sqrt(total) * 3600 == pytest.approx(3.7, rel=0.04)


@pytest.mark.exhaustive
def test_allan_minimum_is_3_7_deg_per_hour_within_spread(record_deg_h: np.ndarray) -> None:
    """Monte Carlo of one-hour records: minimum 3.53 deg/h on average, sd 0.47, 95 % between 2.58 and 4.37.

    Five hours: their mean within three of its standard deviations, at most two hours outside the 95 % (1 in 1000).
    """
    hours = [record_deg_h[i : i + 3600] for i in range(0, 18_000, 3600)]
    minima = [min(allan_deviation(hour, 2**octave) for octave in range(9)) for hour in hours]
    assert np.mean(minima) == pytest.approx(3.53, abs=3 * 0.47 / math.sqrt(5))
    assert sum(2.58 < each < 4.37 for each in minima) >= 3


def test_ideal_has_no_noise() -> None:
    clock, world = powered(ideal_bench(), seed=1)
    first = mean_v(clock, world, 1.0)
    assert mean_v(clock, world, 1.0) == pytest.approx(first, abs=1e-13)


FLUTTER = 20e-6


def turning(seed: int, rate_deg_s: float, flutter: float) -> tuple[VirtualClock, World]:
    """The ideal gyro on a table that flutters, nothing else being random."""
    ideal = ideal_bench()
    clock, world = powered(replace(ideal, table=replace(ideal.table, flutter_per_sqrt_hz=flutter)), seed)
    world.table.demand_rate(rate_deg_s, 1000.0)
    clock.sleep_until(8.0)
    return clock, world


@pytest.mark.parametrize(("rate_deg_s", "seconds"), few([(300.0, 10.0), (-100.0, 10.0), (300.0, 2.0)], (300.0, 2.0)))
def test_flutter_scatters_averages_as_a_bounded_angle_does(rate_deg_s: float, seconds: float) -> None:
    """The mean over T is what the angle, as the gyroscope passes it, differs at both ends: sqrt(2) of it, over T.

    Eight specimens: the gyroscope is sharp at the split of its modes, 25 Hz, where each has two or three lines.
    """
    squares = []
    for seed in range(8):
        clock, world = turning(seed, rate_deg_s, FLUTTER)
        volts_per_deg_s = mean_v(clock, world, 1.0) / rate_deg_s
        squares.append(np.var([mean_v(clock, world, seconds) for _ in range(40)]) / volts_per_deg_s**2)
    bench = replace(ideal_bench(), table=replace(ideal_bench().table, flutter_per_sqrt_hz=FLUTTER))
    frequencies = np.arange(0.05, 2000.0, 0.05)
    angles = flutter_density(bench, frequencies) * (rate_response(bench, frequencies) / (2 * np.pi * frequencies)) ** 2
    wanted = abs(rate_deg_s) * math.sqrt(2.0 * angles.sum() * 0.05) / seconds
    seen = math.sqrt(np.mean(squares))
    assert seen == pytest.approx(wanted, rel=0.2)
    assert seen < 0.35 * FLUTTER * abs(rate_deg_s) / math.sqrt(2 * seconds)  # white noise of the rate


def test_a_table_at_rest_does_not_flutter() -> None:
    clock, world = turning(4, 0.0, 1e-3)
    assert np.ptp([mean_v(clock, world, 0.2) for _ in range(5)]) == 0.0


def test_flutter_leaves_the_draws_of_the_gyro_as_they_are() -> None:
    """What a fluttering table adds is the same with another size, scaled; the rest stays to the last digit."""
    calm, shaken, twice = (
        powered(replace(PAPER, table=replace(PAPER.table, flutter_per_sqrt_hz=size)), 9) for size in (0.0, 1e-4, 2e-4)
    )
    still = [mean_v(*each, 1.0) for each in (calm, shaken, twice)]
    assert len(set(still)) == 1
    for _, world in (calm, shaken, twice):
        world.table.demand_rate(200.0, 200.0)
    means = [mean_v(*each, 5.0) for each in (calm, shaken, twice)]
    assert means[2] - means[0] == pytest.approx(2 * (means[1] - means[0]), rel=1e-2)
    assert abs(means[1] - means[0]) > 1e-6


def test_flutter_is_what_the_chain_answers_to_its_lines() -> None:
    """Against the chain's own response to the same sines, which the carrier-level integration has proved."""
    chain, lines = locked_chain(PAPER), flutter_of(3)
    start, lasts = 17.3, 0.8
    shaken = Shaking(chain, lines).shaken(steady(lines, 0.05), start, lasts)
    assert shaken is not None
    halves = zip(lines.rates, 1j * lines.speeds_rad_s, strict=True)
    terms = real_terms([(math.radians(0.05) * a * np.exp(s * start), s) for a, s in halves])
    still, pushed = (chain.respond(np.zeros(8, complex), Forcing(0j, 0j, each, 0j, []), 0j) for each in ([], terms))
    state, integral = shaken.added(NoiseState.of(np.zeros(8, complex), np.zeros(0)), 0.0)
    wanted = pushed.modal(lasts) - still.modal(lasts)
    assert np.max(np.abs(state.modal - wanted)) < 1e-9 * np.max(np.abs(wanted))
    assert integral == pytest.approx((pushed.filtered.integral(lasts) - still.filtered.integral(lasts)).real, rel=1e-6)
    times = np.linspace(0.0, lasts, 400)
    seen = (pushed.filtered.at(times) - still.filtered.at(times)).real
    assert np.max(np.abs(shaken.filtered.at(times).real - seen)) < 1e-6 * np.max(np.abs(seen))


def test_flutter_has_its_variance_after_settling() -> None:
    shaken = Shaking(locked_chain(PAPER), flutter_of(3)).shaken(steady(flutter_of(3), 0.05), 0.0, 12.0)
    assert shaken is not None
    seen = shaken.filtered.at(np.linspace(2.0, 12.0, 20_000)).real
    assert shaken.variance_v2(10.0) == pytest.approx(seen.var(), rel=0.02)


def test_flutter_in_one_step_or_in_many_gathers_as_much() -> None:
    chain, lines = locked_chain(PAPER), flutter_of(2)
    shaking, silent = Shaking(chain, lines), NoisyChain(chain, FlickerNoise(np.empty(0), 0.0), 0.0)
    random = np.random.default_rng(0)

    def gathered(parts: int) -> tuple[np.ndarray, float]:
        state, total = NoiseState.of(np.zeros(8, complex), np.zeros(0)), 0.0
        for part in range(parts):
            state, once = silent.step(state, 1.0 / parts, random)
            shaken = shaking.shaken(steady(lines, 1.0), part / parts, 1.0 / parts)
            assert shaken is not None
            state, once = shaken.added(state, once)
            total += once
        return state.modal, total

    (one, whole), (five, summed) = gathered(1), gathered(5)
    assert summed == pytest.approx(whole, rel=1e-9)
    assert np.max(np.abs(five - one)) < 1e-9 * np.max(np.abs(one))


def flutter_of(seed: int) -> Flutter:
    return Flutter.drawn(25.0, 0.8, np.random.default_rng(seed))


def steady(lines: Flutter, shaking_deg_s: float) -> RateSegment:
    return RateSegment(0.0, math.inf, 0.0, 100.0, 0.0, (), lines, shaking_deg_s)
