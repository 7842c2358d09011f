from __future__ import annotations

import cmath
import math
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest
from msgspec.structs import replace
from simrack.sources import Approach

from tests.sim.gyro.bench import powered
from vcfbench.clock import VirtualClock
from vcfbench.sim.gyro.design import paper_bench
from vcfbench.sim.gyro.drive import ring_down, start_up
from vcfbench.sim.gyro.modes import Resonance
from vcfbench.sim.world import World

if TYPE_CHECKING:
    from collections.abc import Callable

    from vcfbench.sim.gyro.drive import DriveSegment

PAPER = paper_bench()
MODE = Resonance(2 * math.pi * 3488.9, 1395.0)
AMPLITUDE = PAPER.drive_loop.amplitude_m


def started(*rails: Approach) -> tuple[DriveSegment, ...]:
    positive, negative = rails
    return start_up(PAPER, MODE, (positive, negative), parts=(0j, 0j), start_s=0.0, phase_rad=0.0)


@pytest.mark.parametrize("supply_v", [10.0, 8.0])
def test_start_up_time_is_what_saturated_force_and_damping_say(supply_v: float) -> None:
    """Saturated, the amplitude grows as F/F0 (1 - exp(-t w/2Q)), F0 the force that holds A_x.

    The PI leaves saturation only above 40 % of it. Then 1 % is reached within a quarter of a second.
    """
    segments = started(Approach(supply_v), Approach(-supply_v))
    damping = MODE.natural_rad_s / (2 * MODE.quality)
    holding = PAPER.drive_mode.mass_kg * MODE.natural_rad_s**2 * AMPLITUDE / MODE.quality
    wanted = -math.log(1 - 0.4 * holding / (PAPER.drive_loop.force_limit_n_per_v * supply_v)) / damping
    before, after = next(pair for pair in pairwise(segments) if abs(pair[1].displacement_m) > 0.4 * AMPLITUDE)
    span = abs(after.displacement_m) - abs(before.displacement_m)  # segments hold their middle's envelope
    seen = before.stop_s - 0.002 + 0.004 * (0.4 * AMPLITUDE - abs(before.displacement_m)) / span
    assert seen == pytest.approx(wanted, abs=0.001)
    settled = [each.stop_s for each in segments if abs(abs(each.displacement_m) / AMPLITUDE - 1) > 0.01]
    assert 0.1 < settled[-1] < 0.25
    assert max(abs(each.displacement_m) for each in segments) < 1.1 * AMPLITUDE


def started_plainly(steps: int, weaker_v: Callable[[float], float] = lambda _: 10.0) -> np.ndarray:
    """Drive pick-off (V) after each control step from power-on, from x'' + (w/Q) x' + w^2 x = F sin(th) itself.

    Runge-Kutta, 96 steps a control step of 0.25 ms; the controller takes amplitude and phase off x and x'. The weaker
    rail, of the time since then, sets the largest force and a little of the amplitude.
    """
    loop, w, q = PAPER.drive_loop, MODE.natural_rad_s, MODE.quality
    hold = w**2 / q  # displacement in units of A_x
    x = v = theta = agc = pll = 0.0
    control, h, seen = 0.25e-3, 0.25e-3 / 96, []
    for step in range(steps):
        rail_v = weaker_v(step * control)
        target = 1 + loop.amplitude_supply_coefficient_per_v * (rail_v - 10.0)
        strongest = loop.force_limit_n_per_v * rail_v / (PAPER.drive_mode.mass_kg * AMPLITUDE * hold) / target
        picture = complex(x, -v / w) * cmath.exp(-1j * theta)
        error, phase = 1 - abs(picture) / target, cmath.phase(-picture) if picture else 0.0
        force = min(max(loop.agc_proportional * error + agc, 0.0), strongest)
        if force == loop.agc_proportional * error + agc:
            agc += loop.agc_integral_per_s * error * control
        pll += loop.pll_integral_per_s2 * phase * control
        speed = w + 2 * math.pi * loop.pll_free_running_offset_hz + loop.pll_proportional_per_s * phase + pll
        for _ in range(96):
            pushes = [force * target * hold * math.sin(theta + part * h * speed) for part in (0.0, 0.5, 1.0)]

            def slope(y: float, dy: float, push: float) -> tuple[float, float]:
                return dy, push - w / q * dy - w * w * y

            a = slope(x, v, pushes[0])
            b = slope(x + 0.5 * h * a[0], v + 0.5 * h * a[1], pushes[1])
            c = slope(x + 0.5 * h * b[0], v + 0.5 * h * b[1], pushes[1])
            d = slope(x + h * c[0], v + h * c[1], pushes[2])
            x += h / 6 * (a[0] + 2 * b[0] + 2 * c[0] + d[0])
            v += h / 6 * (a[1] + 2 * b[1] + 2 * c[1] + d[1])
            theta += h * speed
        seen.append(loop.pick_off_v_per_m * AMPLITUDE * x)
    return np.array(seen)


def test_start_up_follows_equation_of_motion() -> None:
    """The first 60 ms, from saturation through lock; the pick-off is 1 V, a phase off by 1 mrad is 1 mV."""
    steps = 240
    clock = VirtualClock()
    world = World(clock, PAPER, 0)
    world.set_rail("positive", 10.0)
    world.set_rail("negative", -10.0)
    capture = world.capture(0.0, 0.2)
    clock.sleep_until(0.2)
    seen = capture.samples("drive", np.asarray(0.25e-3 * np.arange(1, steps + 1) - 1e-9, float))
    assert np.max(np.abs(seen - started_plainly(steps))) < 1e-3


@pytest.mark.exhaustive
def test_start_up_on_rising_rails_follows_equation_of_motion() -> None:
    """It starts as the rail comes to 8 V on its way to 10 V; constant rails of 8 or 10 V miss this by far."""
    begins, steps = 220 * math.tau / MODE.natural_rad_s, 240  # the VCO runs at rest too: whole turns
    tau = begins / math.log(10.0 / 2.0)
    clock = VirtualClock()
    world = World(clock, PAPER, 0)
    world.set_rail("positive", 12.0)
    world.move_rail("negative", Approach(-10.0, 0.0, ((10.0, tau),)))
    capture = world.capture(0.0, 0.2)
    clock.sleep_until(0.2)
    seen = capture.samples("drive", np.asarray(begins + 0.25e-3 * np.arange(1, steps + 1) - 1e-9, float))
    plain = started_plainly(steps, lambda since: 10.0 - 2.0 * math.exp(-since / tau))
    assert np.max(np.abs(seen - plain)) < 1e-3
    assert np.max(np.abs(seen - started_plainly(steps))) > 20e-3
    assert not capture.samples("drive", np.linspace(0.0, begins - 1e-6, 1000)).any()


def test_brown_out_comes_at_the_crossing_of_the_rail() -> None:
    """From there on the pick-off is a free decay: its envelope tells when it began, to a few microseconds."""
    clock, world = powered(PAPER)
    start, tau = clock.now(), 0.08
    world.move_rail("positive", Approach(0.0, start, ((10.0, tau),)))
    capture = world.capture(start, start + 0.06)
    clock.sleep_until(start + 0.06)
    begins = start + tau * math.log(10.0 / 7.0)

    def envelope(since_s: float) -> float:
        times = begins + since_s + np.arange(4000) * 1e-6
        turns = np.exp(1j * MODE.natural_rad_s * (times - begins)) * np.exp(
            -MODE.natural_rad_s / 2 / MODE.quality * times
        )
        columns = np.column_stack((turns.real, turns.imag))
        return float(np.linalg.norm(np.linalg.lstsq(columns, capture.samples("drive", times), rcond=None)[0]))

    held = 1.0 - 200e-6 * 3.0
    gone = math.log(held / (envelope(1e-3) * math.exp(-MODE.natural_rad_s / 2 / MODE.quality * begins)))
    assert gone / (MODE.natural_rad_s / 2 / MODE.quality) == pytest.approx(0.0, abs=60e-6)  # 0.5e-4 of the amplitude


def test_locked_drive_follows_moving_rail_within_0_005_percent() -> None:
    clock, world = powered(PAPER)
    start, tau = clock.now(), 0.08
    world.move_rail("positive", Approach(7.5, start, ((2.5, tau),)))
    capture = world.capture(start, start + 1.0)
    clock.sleep_until(start + 1.0)
    for since in np.linspace(0.0, 0.9, 46):
        times = start + since + np.arange(400) * 1e-6
        columns = np.column_stack([turn(MODE.natural_rad_s * (times - start)) for turn in (np.cos, np.sin)])
        seen = np.linalg.norm(np.linalg.lstsq(columns, capture.samples("drive", times), rcond=None)[0])
        expected = 1.0 - 200e-6 * 2.5 * (1.0 - math.exp(-(since + 2e-4) / tau))
        assert seen == pytest.approx(expected, abs=1.01 * 0.5e-4 + 2e-6)


def test_start_up_locks_at_resonance_with_minus_cosine() -> None:
    segments = started(Approach(10.0), Approach(-10.0))
    *starting, last = segments
    assert last.locked
    assert math.isinf(last.stop_s)
    assert last.displacement_m == -AMPLITUDE
    assert starting[-1].displacement_m == pytest.approx(-AMPLITUDE, rel=1e-6)
    assert starting[-1].stop_s < 1.2


def test_ring_down_gives_frequency_and_q_within_0_1_percent() -> None:
    """Seen on the oscilloscope: rails pulled below brown-out while the pick-off still works."""
    clock, world = powered(PAPER)
    world.set_rail("positive", 6.0)
    start = clock.now()
    capture = world.capture(start, start + 0.5)
    clock.sleep_until(start + 0.5)
    step = 1 / 40_000
    x = capture.samples("drive", np.asarray(start + step * np.arange(18_000), float))
    spans = [x[i : i + 2000] for i in (0, 14_000)]
    (first, second), *_ = np.linalg.lstsq(np.column_stack((x[1:-1], x[:-2])), x[2:], rcond=None)
    natural = math.acos(first / (2 * math.sqrt(-second))) / step
    decay = math.log(np.std(spans[0]) / np.std(spans[1])) / (14_000 * step)
    assert natural == pytest.approx(MODE.natural_rad_s, rel=1e-3)
    assert natural / (2 * decay) == pytest.approx(MODE.quality, rel=1e-3)


def test_nothing_is_left_after_a_ring_down() -> None:
    parts = MODE.parts(-AMPLITUDE, -1j * MODE.natural_rad_s * AMPLITUDE)
    segments = ring_down(MODE, parts, drive_rad_s=MODE.natural_rad_s, start_s=0.0, phase_rad=0.0)
    assert abs(segments[-2].displacement_m) < 2e-7 * AMPLITUDE
    assert segments[-1].displacement_m == 0


def test_power_on_to_drive_amplitude_on_the_scope() -> None:
    clock = VirtualClock()
    world = World(clock, PAPER, 0)
    world.set_rail("positive", 10.0)
    world.set_rail("negative", -10.0)
    capture = world.capture(0.0, 2.0)
    clock.sleep_until(2.0)
    early = capture.samples("drive", np.linspace(0.010, 0.012, 400))
    late = capture.samples("drive", np.linspace(1.990, 1.992, 400))
    assert 0.3 < np.max(early) < 0.9
    assert np.max(np.abs(late)) == pytest.approx(1.0, rel=1e-3)
    assert capture.samples("drive", np.array([0.0]))[0] == 0.0


def test_drive_is_continuous_from_one_control_step_to_the_next() -> None:
    clock = VirtualClock()
    world = World(clock, PAPER, 0)
    world.set_rail("positive", 10.0)
    world.set_rail("negative", -10.0)
    capture = world.capture(0.0, 1.2)
    clock.sleep_until(1.2)
    times = np.arange(0.0, 1.2, 1e-5)
    x = capture.samples("drive", times)
    assert np.max(np.abs(np.diff(x))) < 1.1 * 2 * math.pi * 3490 * 1e-5


def test_brown_out_stops_drive_and_rails_restart_it() -> None:
    clock, world = powered(PAPER)
    world.set_rail("negative", -6.9)
    clock.sleep_until(clock.now() + 4.0)
    assert abs(world.value_v("drive")) < 1e-6
    world.set_rail("negative", -7.5)  # hysteresis: above brown-out, below start
    clock.sleep_until(clock.now() + 2.0)
    assert abs(world.value_v("drive")) < 1e-6
    world.set_rail("negative", -10.0)
    clock.sleep_until(clock.now() + 2.0)
    capture = world.capture(clock.now(), clock.now() + 0.001)
    clock.sleep_until(clock.now() + 0.001)
    volts = capture.samples("drive", np.linspace(capture.start_s, capture.stop_s, 500))
    assert np.max(np.abs(volts)) == pytest.approx(1.0, rel=1e-3)


def test_amplitude_follows_the_supply_by_its_coefficient() -> None:
    clock, world = powered(PAPER)
    world.set_rail("positive", 9.0)
    start = clock.now()
    capture = world.capture(start, start + 0.01)
    clock.sleep_until(start + 0.01)
    volts = capture.samples("drive", np.linspace(start, start + 0.01, 20_000))
    assert np.max(volts) == pytest.approx(1 - 200e-6, abs=2e-6)


def test_a_running_drive_goes_on_down_to_brown_out() -> None:
    """Hysteresis: 7.5 V would not start it."""
    clock, world = powered(PAPER)
    world.set_rail("negative", -7.5)
    clock.sleep_until(clock.now() + 2.0)
    capture = world.capture(clock.now(), clock.now() + 0.001)
    clock.sleep_until(clock.now() + 0.001)
    assert np.max(capture.samples("drive", np.linspace(capture.start_s, capture.stop_s, 500))) > 0.99


def test_weak_force_holds_smaller_amplitude() -> None:
    """Saturated for ever: F Q / (m w^2), here 40 % of A_x."""
    holding = PAPER.drive_mode.mass_kg * MODE.natural_rad_s**2 * AMPLITUDE / MODE.quality
    weak = replace(PAPER, drive_loop=replace(PAPER.drive_loop, force_limit_n_per_v=0.4 * holding / 10.0))
    clock, world = powered(weak, wait_s=5.0)
    capture = world.capture(5.0, 5.001)
    clock.sleep_until(5.001)
    volts = capture.samples("drive", np.linspace(5.0, 5.001, 500))
    assert np.max(volts) == pytest.approx(0.4, rel=1e-3)


def test_segments_are_few_and_as_fine_as_the_envelope_asks() -> None:
    segments = started(Approach(10.0), Approach(-10.0))
    changing = segments[:-1]
    assert len(changing) < 80  # of 4 ms they were 200
    for segment in changing:
        seen = [MODE.displacement(motion.parts) for motion in segment.motions]
        if len(seen) > 16:
            assert max(abs(each - seen[0]) for each in seen[::16]) <= 1.0001e-4 * AMPLITUDE
        assert segment.displacement_m == pytest.approx(sum(seen) / len(seen), rel=1e-12)
    assert sum(len(segment.motions) for segment in changing) * 0.25e-3 == pytest.approx(changing[-1].stop_s)


@pytest.mark.parametrize("terms", [(), ((8.5, 1e-4),)])
def test_start_up_ends_with_rails(terms: tuple[tuple[float, float], ...]) -> None:
    """A rail that recovers from its current limit while it is switched off is above the threshold for a moment."""
    segments = started(Approach(0.0, terms=terms), Approach(-10.0))
    assert segments[-1].stop_s == math.inf
    assert segments[0].stop_s <= 0.004 or len(segments) == 1
