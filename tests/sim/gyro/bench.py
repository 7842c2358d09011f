"""Shared set-ups of the gyro's tests."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from vcfbench.clock import VirtualClock
from vcfbench.sim.gyro.chain import Chain, ChainDesign
from vcfbench.sim.gyro.modes import Resonance
from vcfbench.sim.world import World

if TYPE_CHECKING:
    from vcfbench.sim.parameters import BenchParameters


def locked_chain(bench: BenchParameters) -> Chain:
    """The chain at the reference temperature, drive locked."""
    omega, amplitude = 2 * math.pi * bench.drive_mode.frequency_hz, bench.drive_loop.amplitude_m
    modes = (bench.sense_in_phase, bench.sense_anti_phase)
    first, second = (Resonance(2 * math.pi * mode.frequency_hz, mode.quality) for mode in modes)
    return ChainDesign(bench).chain((first, second), omega, -amplitude, -1j * omega * amplitude)


def powered(bench: BenchParameters, seed: int = 0, wait_s: float = 4.0) -> tuple[VirtualClock, World]:
    """A world on +-10 V rails with its drive locked and everything settled, servo closed."""
    clock = VirtualClock()
    world = World(clock, bench, seed)
    world.set_rail("positive", 10.0)
    world.set_rail("negative", -10.0)
    world.table.close_servo()
    clock.sleep_until(wait_s)
    world.advance()
    return clock, world


def mean_v(clock: VirtualClock, world: World, seconds: float) -> float:
    """The output's mean over the next `seconds`."""
    start = clock.now()
    window = world.window("output", start, start + seconds)
    clock.sleep_until(start + seconds)
    return window.mean_v()
