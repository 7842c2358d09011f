"""The noise of the chain over time, advanced to the instant of each reading.

What changes it (the chain that it passes, the table's motion) is only noted. The steps in between are drawn when
somebody looks, the same numbers as if they had been drawn at once. A way down to rest that nobody watches costs none.
"""

import math
from collections import deque
from functools import lru_cache

import numpy as np
from msgspec import Struct
from simrack.motion import RateSegment

from vcfbench.sim.gyro.bridge import NoisePath
from vcfbench.sim.gyro.chain import ChainDesign
from vcfbench.sim.gyro.course import chain_at
from vcfbench.sim.gyro.drive import DriveSegment, locked
from vcfbench.sim.gyro.noise import FlickerNoise, NoiseState, NoisyChain
from vcfbench.sim.gyro.shaken import Shaken, Shaking
from vcfbench.sim.gyro.thermal import resonance_at
from vcfbench.sim.parameters import BenchParameters

NOISE_STEP_K = 1.0
"""Steps in which the chain that the noise passes follows the temperature: 6e-4 of the noise's size at most."""
CHAINS_KEPT = 32
MOST_NOTED = 64
"""Changes that are noted at most; with the next one the steps are drawn."""


class _Noted(Struct, frozen=True):
    """Conditions from `since_s` on; while the drive is not locked there is no chain, and only the flicker goes on."""

    since_s: float
    passing: tuple[int, complex] | None
    """Which chain the noise passes: by its temperature, in steps so that its factors last, and its drive, m."""
    bench: BenchParameters
    rate: RateSegment | None


@lru_cache(CHAINS_KEPT)
def _noisy_chain(design: ChainDesign, bench: BenchParameters, passing: tuple[int, complex]) -> NoisyChain:
    """Return the chain that noise passes; gyroscopes of the same parameters share it, and its factors."""
    temperature_c, displacement_m = passing[0] * NOISE_STEP_K, passing[1]
    speed = resonance_at(bench.drive_mode, bench.thermal, temperature_c).natural_rad_s
    chain = chain_at(design, bench, temperature_c, locked(abs(displacement_m), speed))
    white = math.radians(bench.noise.angle_random_walk_deg_sqrt_s)
    return NoisyChain(chain, FlickerNoise.of(bench.noise), white)


class NoiseCourse:
    """The noise at `_now_s`, the last instant that it was brought up to."""

    def __init__(self, design: ChainDesign, bench: BenchParameters, seed: int, now_s: float) -> None:
        self._design = design
        self._random = np.random.default_rng(seed)
        self._flicker = FlickerNoise.of(bench.noise)
        white = bench.noise.angle_random_walk_deg_sqrt_s > 0
        self._noisy = self._flicker.deviation_rad_s > 0 or white or bench.table.flutter_per_sqrt_hz > 0
        self._chain: NoisyChain | None = None
        self._shaking: Shaking | None = None
        self._quiet = np.zeros(4 + bench.sense_path.low_pass_order, complex)
        self._state = NoiseState.of(self._quiet, self._flicker.drawn(self._random))
        self._now_s = now_s
        self._held = self._latest = _Noted(now_s, None, bench, None)
        """What holds at `_now_s`, and what was noted last."""
        self._noted: deque[_Noted] = deque()
        """What has changed since, in order."""

    def part(self, key: tuple[int, ...]) -> None:
        """Detach from the original: copy shared mutable state; `key` is a seed."""
        self._noted = self._noted.copy()
        self._random = np.random.default_rng([*key, 0])

    def shake(self, now_s: float, rate: RateSegment) -> None:
        """Change the motion of the gyroscope's axis from now on, because flutter depends on the rate."""
        self._note(_Noted(now_s, self._latest.passing, self._latest.bench, rate))

    def go_through(self, now_s: float, bench: BenchParameters, temperature_c: float, drive: DriveSegment) -> None:
        """Change the chain of the noise to that of the present temperature and drive."""
        passing = None
        if drive.locked and self._noisy:
            passing = round(temperature_c / NOISE_STEP_K), drive.displacement_m
        if passing != self._latest.passing:
            self._note(_Noted(now_s, passing, bench, self._latest.rate))

    def _note(self, noted: _Noted) -> None:
        self._latest = noted
        self._noted.append(noted)
        if len(self._noted) > MOST_NOTED:
            self.bring_up(noted.since_s)

    def bring_up(self, now_s: float) -> None:
        """Advance the noise to now, one step from change to change, without a reading in between."""
        while self._noted:
            noted = self._noted.popleft()
            self._go(noted.since_s)
            if noted.passing != self._held.passing:
                # Go on with another chain; the noise so far stays
                passing, modal = noted.passing, self._quiet
                chain = None if passing is None else _noisy_chain(self._design, noted.bench, passing)
                if chain is not None and self._chain is not None:
                    modal = self._chain.chain.handed_over(self._state.modal, 0j, chain.chain)
                self._state = NoiseState.of(modal, self._state.rates_rad_s)
                self._chain, self._shaking = chain, None
            self._held = noted
        self._go(now_s)

    def _go(self, now_s: float) -> None:
        if self._now_s < now_s:
            self._state, _, _ = self._at(now_s)
            self._now_s = now_s

    def path_now(self, key: tuple[int, ...]) -> NoisePath | None:
        """Return the present noise, or None; a picture's random numbers come from `key`."""
        if self._chain is None:
            return None
        return NoisePath(self._chain, self._state, None, integral_v_s=0.0, duration_s=0.0, key=key)

    def gone(self, stop_s: float, key: tuple[int, ...]) -> tuple[NoisePath | None, float]:
        """Go on to `stop_s` from where it was brought up to; return the path, as above, and its integral, V s."""
        begun, begun_s = self._state, self._now_s
        self._state, integral_v_s, shaken = self._at(stop_s)
        self._now_s = stop_s
        if self._chain is None:
            return None, integral_v_s
        return NoisePath(self._chain, begun, self._state, integral_v_s, stop_s - begun_s, key, shaken), integral_v_s

    def _at(self, stop_s: float) -> tuple[NoiseState, float, Shaken | None]:
        """Return the noise at `stop_s`, its integral until then, and the part of both made by the table's flutter."""
        if not self._noisy:
            return self._state, 0.0, None
        duration = stop_s - self._now_s
        if self._chain is None:
            rates = self._flicker.later(self._state.rates_rad_s, duration, self._random)
            return NoiseState.of(self._state.modal, rates), 0.0, None
        noise, integral = self._chain.step(self._state, duration, self._random)
        rate = self._held.rate
        if rate is None or rate.flutter is None or not rate.shaking_deg_s:
            return noise, integral, None
        if self._shaking is None:
            self._shaking = Shaking(self._chain.chain, rate.flutter)
        shaken = self._shaking.shaken(rate, self._now_s, duration)
        return (noise, integral, None) if shaken is None else (*shaken.added(noise, integral), shaken)
