"""The drive loop: AGC and PLL around the drive mode, from power-on to lock and from brown-out to rest.

While it starts, the loop is a sampled controller on the exact envelope of the mode: force and VCO frequency are held
for `CONTROL_STEP_S`, and within such a step the mode's motion is exact. Nothing else acts on the drive, so the whole
transient is laid out at once, as segments from now on; the last of them lasts for ever and costs nothing.

The force is F_d sin(th); locked, w_d = w_x and x = -A_x cos(th): equation (4) of the paper with its sign corrected,
since the phase of equation (2) is -pi/2 there.
"""

import cmath
import math
from collections.abc import Iterator, Sequence
from functools import lru_cache

import numpy as np
from msgspec import Struct
from simrack.sources import Approach

from vcfbench.sim.gyro.modes import Resonance
from vcfbench.sim.gyro.signals import ExponentialSum
from vcfbench.sim.parameters import BenchParameters

CONTROL_STEP_S = 0.25e-3
STEPS_A_SEGMENT = 16
"""A segment has so many control steps, or a multiple of it while the drive hardly changes."""
STEADY = 1e-4
"""Change of the envelope, relative to the set amplitude, within which one segment goes on."""
RING_DOWN_SEGMENT_S = 20e-3
LONGEST_START_S = 3.0
SETTLED = 1e-7


class Motion(Struct, frozen=True):
    """The mode under a constant force, exact from `start_s` on: two parts, force per mass, frame and phase there."""

    start_s: float
    parts: tuple[complex, complex]
    force_m_s2: complex
    drive_rad_s: float
    phase_rad: float

    def waveform(self, mode: Resonance) -> ExponentialSum:
        """Return the analytic displacement D as a signal from `start_s` on."""
        plus, minus = mode.poles
        turn, scale = cmath.exp(1j * self.phase_rad), 1 / (plus - minus)
        steady = [-self.force_m_s2 / (pole - 1j * self.drive_rad_s) for pole in (plus, minus)]
        amplitudes = [scale * (self.parts[0] - steady[0]), -scale * (self.parts[1] - steady[1])]
        sizes = turn * np.array([*amplitudes, scale * (steady[0] - steady[1])])
        return ExponentialSum(0j, 0j, sizes, np.array([plus, minus, 1j * self.drive_rad_s]))


class DriveSegment(Struct, frozen=True):
    """A stretch of the drive's motion as the sense chain takes it: constant mean envelopes and frequency.

    `motions` hold the exact motion within it. A `locked` segment follows the resonance and lasts for ever.
    """

    stop_s: float
    drive_rad_s: float
    displacement_m: complex
    velocity_m_s: complex
    locked: bool
    motions: tuple[Motion, ...]


def locked(amplitude_m: float, drive_rad_s: float) -> DriveSegment:
    """Return the drive locked at resonance: x = -A cos(th), x' = A w_d sin(th)."""
    velocity = -1j * drive_rad_s * amplitude_m
    return DriveSegment(math.inf, drive_rad_s, complex(-amplitude_m), velocity, locked=True, motions=())


def resting(drive_rad_s: float) -> DriveSegment:
    """Return the drive at rest."""
    return DriveSegment(math.inf, drive_rad_s, 0j, 0j, locked=False, motions=())


def weaker_v(rails: tuple[Approach, Approach], instant_s: float) -> float:
    """Return the weaker rail at a bench time, V; of the wrong polarity it counts as 0 V."""
    positive, negative = rails
    return max(min(positive.at(instant_s), -negative.at(instant_s)), 0.0)


def held_m(bench: BenchParameters, mode: Resonance, rail_v: float) -> float:
    """Return the drive amplitude that the AGC holds on rails of `rail_v`, limited by its largest force."""
    return min(wanted_m(bench, rail_v), strongest_m(bench, mode, rail_v))


def wanted_m(bench: BenchParameters, rail_v: float) -> float:
    """Return the drive amplitude that the AGC wants."""
    loop, nominal = bench.drive_loop, bench.supply.nominal_v
    return loop.amplitude_m * (1 + loop.amplitude_supply_coefficient_per_v * (rail_v - nominal))


def strongest_m(bench: BenchParameters, mode: Resonance, rail_v: float) -> float:
    """Return the drive amplitude that the largest force can hold."""
    loop, mass = bench.drive_loop, bench.drive_mode.mass_kg
    return loop.force_limit_n_per_v * rail_v * mode.quality / (mass * mode.natural_rad_s**2)


@lru_cache(8)  # benches that begin alike share it
def start_up(
    bench: BenchParameters,
    mode: Resonance,
    rails: tuple[Approach, Approach],
    *,
    parts: tuple[complex, complex],
    start_s: float,
    phase_rad: float,
) -> tuple[DriveSegment, ...]:
    """Return the drive's motion from `parts` to lock on rails as they go on.

    The loop starts with empty integrators and its VCO at the free-running frequency. If it has not settled after
    `LONGEST_START_S`, it is taken as locked then. Amplitudes are relative to the one that the rails give, forces to
    the one that holds it.
    """
    rails_settled_s = max((rail.ends_s(start_s) for rail in rails if rail.terms), default=-math.inf)
    goal_v = max(min(rails[0].goal_v, -rails[1].goal_v), 0.0)
    loop, natural_rad_s, (plus, minus) = bench.drive_loop, mode.natural_rad_s, mode.poles
    free_running_rad_s = natural_rad_s + 2 * math.pi * loop.pll_free_running_offset_hz
    agc = pll_rad_s = 0.0
    motions, known_v = list[Motion](), math.nan
    for step in range(round(LONGEST_START_S / CONTROL_STEP_S)):
        instant_s = start_s + step * CONTROL_STEP_S
        supply_v = goal_v if instant_s >= rails_settled_s else weaker_v(rails, instant_s)
        if supply_v != known_v:
            known_v, amplitude_m = supply_v, held_m(bench, mode, supply_v)
            holding = natural_rad_s**2 * amplitude_m / mode.quality
            if not holding:  # the rails are on their way off, and stop the loop before they are
                break
            limit = loop.force_limit_n_per_v * supply_v / (bench.drive_mode.mass_kg * holding)
        displacement_m = (parts[0] - parts[1]) / (plus - minus)
        error = 1 - abs(displacement_m) / amplitude_m
        phase = cmath.phase(-displacement_m) if displacement_m else 0.0
        wanted = loop.agc_proportional * error + agc
        force = 0.0 if wanted < 0.0 else min(wanted, limit)
        if wanted == force:
            agc += loop.agc_integral_per_s * error * CONTROL_STEP_S
        pll_rad_s += loop.pll_integral_per_s2 * phase * CONTROL_STEP_S
        frequency = free_running_rad_s + loop.pll_proportional_per_s * phase + pll_rad_s
        calm = step % STEPS_A_SEGMENT == 0 and max(abs(error), abs(phase)) < SETTLED
        if calm and abs(frequency - natural_rad_s) < SETTLED * natural_rad_s:
            break
        motion = Motion(instant_s, parts, -1j * force * holding, frequency, phase_rad)
        motions.append(motion)
        parts = mode.step(parts, motion.force_m_s2, frequency, CONTROL_STEP_S)
        phase_rad += frequency * CONTROL_STEP_S
    return *_segments(mode, motions, STEADY * amplitude_m), locked(amplitude_m, natural_rad_s)


def _segments(mode: Resonance, motions: Sequence[Motion], steady_m: float) -> Iterator[DriveSegment]:
    """Cut `motions` where the envelope or the VCO's phase has gone further than `steady_m` since the last cut.

    The envelopes of a segment are averaged over its control steps.
    """
    first = 0
    for place in range(STEPS_A_SEGMENT, len(motions) + STEPS_A_SEGMENT, STEPS_A_SEGMENT):
        if place < len(motions):
            begun, now = motions[first], motions[place]
            moved_m = abs(mode.displacement(now.parts) - mode.displacement(begun.parts))
            turned = abs(now.drive_rad_s - begun.drive_rad_s) * (now.start_s - begun.start_s)
            if max(moved_m, turned * abs(mode.displacement(now.parts))) <= steady_m:
                continue
        chunk = motions[first:place]
        plus, minus, speeds = zip(*((*each.parts, each.drive_rad_s) for each in chunk), strict=True)
        parts = sum(plus) / len(chunk), sum(minus) / len(chunk)
        displacement, velocity = mode.displacement(parts), mode.velocity(parts)
        stop = chunk[-1].start_s + CONTROL_STEP_S
        yield DriveSegment(stop, sum(speeds) / len(chunk), displacement, velocity, locked=False, motions=tuple(chunk))
        first = place


def ring_down(
    mode: Resonance, parts: tuple[complex, complex], *, drive_rad_s: float, start_s: float, phase_rad: float
) -> list[DriveSegment]:
    """Return the drive's free decay in the frame of the last VCO frequency, until 1e-7 of it is left."""
    damping = mode.natural_rad_s / (2 * mode.quality)
    moving = abs(mode.displacement(parts)) > 0
    count = math.ceil(math.log(1e7) / damping / RING_DOWN_SEGMENT_S) if moving else 0
    segments = []
    for index in range(count):
        start = start_s + index * RING_DOWN_SEGMENT_S
        motion = Motion(start, parts, 0j, drive_rad_s, phase_rad)
        middle = mode.step(parts, 0j, drive_rad_s, RING_DOWN_SEGMENT_S / 2)
        displacement, velocity = mode.displacement(middle), mode.velocity(middle)
        stop = start + RING_DOWN_SEGMENT_S
        segments.append(DriveSegment(stop, drive_rad_s, displacement, velocity, locked=False, motions=(motion,)))
        parts = mode.step(parts, 0j, drive_rad_s, RING_DOWN_SEGMENT_S)
        phase_rad += drive_rad_s * RING_DOWN_SEGMENT_S
    return [*segments, resting(drive_rad_s)]
