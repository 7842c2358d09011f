"""The gyro with its PCB: what it is in, and how that moves from one event to the next.

Between events (a rail, V_Vc, a corner of the table's motion, a segment of the drive's start-up, a band of
temperature) the sense chain is linear with fixed parameters and Gaussian noise, and one step of any length is exact.

A rail that moves (:class:`vcfbench.sim.sources.Approach`) is exact at its pin, in the output's limits, in the control
steps of a start-up and in when it crosses the PCB's thresholds. The amplitude of the locked drive, which the whole
chain depends on, follows it in steps.
"""

from __future__ import annotations

import cmath
import copy
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from vcfbench.sim.gyro.bridge import NoisePath
from vcfbench.sim.gyro.chain import ChainState, Forcing, build_chain
from vcfbench.sim.gyro.design import EARTH_RATE_DEG_S
from vcfbench.sim.gyro.drive import Supplied, locked, resting, ring_down, start_up
from vcfbench.sim.gyro.electronic import ElectronicNoise
from vcfbench.sim.gyro.electronics import MovingLimits, Oscillation, output_limits, passage, rail_current_a
from vcfbench.sim.gyro.noise import Flicker, Flutter, NoiseState, NoisyChain
from vcfbench.sim.gyro.signals import real_terms
from vcfbench.sim.gyro.stretch import Stretch
from vcfbench.sim.gyro.thermal import WarmUp, resonance_at
from vcfbench.sim.sources import Approach

if TYPE_CHECKING:
    from collections.abc import Callable

    from vcfbench.sim.gyro.chain import Chain, Response
    from vcfbench.sim.gyro.modes import Resonance
    from vcfbench.sim.motion import RateSegment
    from vcfbench.sim.parameters import BenchParameters
    from vcfbench.sim.sources import Drive, Played, Ripple

__all__ = ["Gyro"]

FORGOTTEN_DEG_S = 1e-18
COLDEST_C, HOTTEST_C = -55.0, 125.0
AMPLITUDE_STEP = 1e-4
"""Of the drive amplitude: the largest step in which it follows a rail that moves, at most half of it off."""
FORCED_STEP_V = 10e-3
"""The same where the drive's force is at its limit, in volts of the rail: 0.15 % of the amplitude at most."""
_SHAKES, _LOOKS, _BEHIND, _IMAGINED = 1, 2, 4, 5
"""Random streams beside the gyro's own noise (3: :mod:`vcfbench.sim.mains`); no number is ever given again."""


@dataclass(frozen=True, slots=True)
class _Course:
    """What happens from now to `stop_s`: the chain's response, the noise in the end and its integral, the flutter."""

    stop_s: float
    response: Response
    noise: NoiseState
    noise_integral_v_s: float
    shaking_rad_sqrt_s: float


class Gyro:
    """State of the gyro at `now_s`, the last instant that it was taken to."""

    def __init__(self, bench: BenchParameters, seed: int, now_s: float) -> None:
        self.now_s = now_s
        self._bench = bench
        self._seed = seed
        self._random = np.random.default_rng(seed)
        self._shaking = np.random.default_rng([seed, _SHAKES])
        self._flicker = Flicker.of(bench.noise)
        self._white = math.radians(bench.noise.angle_random_walk_deg_sqrt_s)
        self._noisy = self._flicker.deviation_rad_s > 0 or self._white > 0 or bench.table.flutter_per_sqrt_hz > 0
        noise = bench.noise
        self._electronic = (
            ElectronicNoise(noise.electronic_v_sqrt_hz, noise.electronic_corner_hz, (seed, _BEHIND))
            if noise.electronic_v_sqrt_hz
            else None
        )
        self._rails = (Approach(0.0), Approach(0.0))
        self._held_v, self._rail_event_s = 0.0, math.inf
        self._ripples: list[Ripple | None] = [None, None]
        self._running = False
        self._source: Drive | Played | None = None
        self._passage = passage(None, bench.virtual_path, now_s)
        self._phase = 0.0
        self._warm_up = WarmUp(now_s, bench.thermal.ambient_c, bench.thermal.ambient_c, bench.thermal.time_constant_s)
        self._bands = self._warm_up.bands(bench.thermal)
        self._drive = [resting(self._drive_mode().natural_rad_s)]
        self._locked_chains: dict[tuple[int, complex], tuple[Chain, NoisyChain, Flutter | None]] = {}
        self._chain, self._noisy_chain, self._flutter = self._new_chain()
        self._modal = self._chain.modal(ChainState.at_rest(bench.sense_path.low_pass_order), 0j)
        self._noise = NoiseState(np.zeros_like(self._modal), self._flicker.drawn(self._random))

    def imagined(self) -> Gyro:
        """Return a gyro that goes on from here by itself, with random numbers of its own: this one learns nothing."""
        other = copy.copy(self)
        other.part()
        return other

    def part(self) -> None:
        """Have nothing in common any more with what this was copied from that would change there."""
        self._drive, self._bands, self._ripples = list(self._drive), list(self._bands), list(self._ripples)
        key = (self._seed, _IMAGINED, round(self.now_s * 1e9))
        self._random, self._shaking = np.random.default_rng([*key, 0]), np.random.default_rng([*key, 1])

    # -- commands, all at `now_s` --

    def set_rails(self, positive: Approach, negative: Approach) -> None:
        """Set how both rails go on, signed; of the wrong polarity they count as 0 V."""
        self._rails = (positive, negative)
        self._follow_rails()

    def _follow_rails(self) -> None:
        """Start or stop the drive loop and the warm-up as the rails have crossed their thresholds."""
        self._rails = (self._rails[0].later(self.now_s), self._rails[1].later(self.now_s))
        supply, was_running = self._bench.supply, self._running
        self._running = self._weaker_rail() >= (supply.brown_out_v if was_running else supply.start_v)
        if self._running != was_running:
            self._heat()
        if self._running and not was_running:
            self._start()
        elif was_running and not self._running:
            self._stop()
        self._settle()

    def set_ripple(self, rail: int, ripple: Ripple | None) -> None:
        """Change the ripple on rail 0 (positive) or 1 (negative); its pin shows it.

        What it does to the drive amplitude, 1e-7 of it for a millivolt, is left out.
        """
        self._ripples[rail] = ripple

    def connect_v_vc(self, source: Drive | Played | None) -> None:
        """Connect a generator to the V_Vc input, or leave it to the pull-down with the modulator's switch open."""
        self._source = source
        self._passage = passage(source, self._bench.virtual_path, self.now_s)

    @property
    def ambient_c(self) -> float:
        """The temperature around it, degC."""
        return self._bench.thermal.ambient_c

    def set_ambient_c(self, ambient_c: float) -> None:
        """Change the temperature around it; raises ValueError where the modes would not be modes any more."""
        if not COLDEST_C <= ambient_c <= HOTTEST_C:
            raise ValueError(f"the air has {COLDEST_C:g} to {HOTTEST_C:g} degC, not {ambient_c}")
        thermal = replace(self._bench.thermal, ambient_c=ambient_c)
        modes = (self._bench.drive_mode, self._bench.sense_in_phase, self._bench.sense_anti_phase)
        warmest = ambient_c + thermal.self_heating_k
        if min(resonance_at(mode, thermal, each).quality for mode in modes for each in (ambient_c, warmest)) <= 0.5:
            raise ValueError(f"at {ambient_c:g} degC the modes would not oscillate any more")
        self._bench = replace(self._bench, thermal=thermal)
        self._heat()
        self._settle()

    def temperature_c(self) -> float:
        """Return its temperature, degC."""
        return self._warm_up.at(self.now_s)

    def rail_current_a(self, rail: int, voltage_v: float) -> float:
        """Return the magnitude of the current drawn from rail 0 (positive) or 1 (negative) at a voltage."""
        weaker_v = min(abs(voltage_v), abs(self._rail_v(1 - rail)))
        starts = weaker_v > 0.0 and (self._running or weaker_v >= self._bench.supply.start_v)
        lacking = 1 - abs(self._drive[0].displacement_m) / self._amplitude_m(weaker_v) if starts else 0.0
        return rail_current_a(self._bench.supply, voltage_v, min(max(lacking, 0.0), 1.0))

    # -- time --

    def next_event_s(self) -> float:
        """Return when the gyro's own parameters change next, or V_Vc begins another piece."""
        band = self._bands[1][0] if len(self._bands) > 1 else math.inf
        return min(self._drive[0].stop_s, band, self._passage.stop_s, self._rail_event_s)

    def look(self, rate: RateSegment, stop_s: float) -> Stretch:
        """Return the stretch from now to `stop_s`, as it will be without noise; changes nothing."""
        response = self._chain.respond(self._modal, self._forcing(rate), self._turn())
        return self._stretch(response, stop_s, self._path(None, 0.0, 0.0, 0.0), 0.0)

    def go(self, rate: RateSegment, stop_s: float) -> None:
        """Go to `stop_s`, not beyond the next event, with nobody looking."""
        self._arrive(self._course(rate, stop_s))

    def propagate(self, rate: RateSegment, stop_s: float) -> Stretch:
        """Go to `stop_s`, not beyond the next event, and return what happened."""
        course = self._course(rate, stop_s)
        noise = self._path(course.noise, course.noise_integral_v_s, stop_s - self.now_s, course.shaking_rad_sqrt_s)
        stretch = self._stretch(course.response, stop_s, noise, course.noise_integral_v_s)
        self._arrive(course)
        return stretch

    def _course(self, rate: RateSegment, stop_s: float) -> _Course:
        """Return how it goes on up to `stop_s`; but for the random numbers nothing has changed yet."""
        duration = stop_s - self.now_s
        response = self._chain.respond(self._modal, self._forcing(rate), self._turn())
        noise, integral = self._propagate_noise(duration)
        shaking = self._shaking_rad_sqrt_s(rate, stop_s)
        if shaking and self._flutter is not None:
            noise, integral = self._flutter.added(noise, integral, duration, shaking, self._shaking)
        return _Course(stop_s, response, noise, integral, shaking)

    def _arrive(self, course: _Course) -> None:
        duration = course.stop_s - self.now_s
        self._modal, self._noise = course.response.modal(duration), course.noise
        self._phase = math.fmod(self._phase + self._drive[0].drive_rad_s * duration, 2 * math.pi)
        self.now_s = course.stop_s
        self._pass_events()

    def _turn(self) -> complex:
        return cmath.exp(2j * self._phase)

    def _pass_events(self) -> None:
        changed = False
        if self._passage.stop_s <= self.now_s:
            self.connect_v_vc(self._source)
        while self._drive[0].stop_s <= self.now_s:
            self._drive.pop(0)
            changed = True
        while len(self._bands) > 1 and self._bands[1][0] <= self.now_s:
            self._bands.pop(0)
            changed = True
        if self._rail_event_s <= self.now_s:
            self._follow_rails()
        elif changed:
            self._settle()

    def _settle(self) -> None:
        """Go on with the drive and the chain that fit rails and temperature now; a locked loop follows both at once."""
        self._held_v, self._rail_event_s = self._rails_ahead()
        if self._drive[0].locked:
            self._drive = [locked(self._amplitude_m(self._held_v), self._drive_mode().natural_rad_s)]
        turn = self._turn()
        state, noise = self._chain.state(self._modal, turn), self._chain.state(self._noise.modal, 0j)
        self._chain, self._noisy_chain, self._flutter = self._new_chain()
        self._modal = self._chain.modal(state, turn)
        self._noise = NoiseState(self._chain.modal(noise, 0j), self._noise.rates_rad_s)

    def _propagate_noise(self, duration: float) -> tuple[NoiseState, float]:
        """Return the noise after a step and its integral; while the drive is not locked only the flicker goes on."""
        if not self._noisy:
            return self._noise, 0.0
        if self._noisy_chain is not None:
            return self._noisy_chain.step(self._noise, duration, self._random)
        rates = self._flicker.later(self._noise.rates_rad_s, duration, self._random)
        return NoiseState(np.zeros_like(self._modal), rates), 0.0

    def _shaking_rad_sqrt_s(self, rate: RateSegment, stop_s: float) -> float:
        """Return the size of the table's flutter up to `stop_s`; at rest it does not flutter."""
        if self._flutter is None or (turning := rate.rms_deg_s(self.now_s, stop_s)) == 0.0:
            return 0.0
        # the density is of positive frequencies: white noise gathers half of its square per second
        return self._bench.table.flutter_per_sqrt_hz * math.radians(turning) / math.sqrt(2.0)

    def _path(self, end: NoiseState | None, integral_v_s: float, duration_s: float, shaking: float) -> NoisePath | None:
        """Return the noise of a step, its random numbers from the seed and the instant; without an end, that of now."""
        if not self._noisy or self._noisy_chain is None:
            return None
        return NoisePath(
            self._noisy_chain,
            self._noise,
            end,
            integral_v_s=integral_v_s,
            duration_s=duration_s,
            shaking_rad_sqrt_s=shaking,
            key=(self._seed, _LOOKS, round(self.now_s * 1e9)),
        )

    def _stretch(
        self, response: Response, stop_s: float, noise: NoisePath | None, noise_integral_v_s: float
    ) -> Stretch:
        bench = self._bench
        moving, limits_v = self._limits(stop_s - self.now_s)
        return Stretch(
            bench,
            self.now_s,
            stop_s,
            response,
            noise,
            noise_integral_v_s,
            self._drive_mode(),
            self._drive[0],
            self._phase,
            self._passage.voltage(self.now_s),
            (self._rail(0), self._rail(1)),
            limits_v,
            self._weaker_rail() >= bench.supply.dead_v,
            self._electronic,
            moving,
        )

    # -- what acts on the chain --

    def _forcing(self, rate: RateSegment) -> Forcing:
        since = self.now_s - rate.start_s
        bench, scale = self._bench, math.pi / 180
        earth = EARTH_RATE_DEG_S * math.sin(math.radians(bench.site.latitude_deg))
        warm, drift = self._bias()
        constant = scale * (rate.rate_deg_s + rate.slope_deg_s2 * since + earth + warm)
        terms = [(a * cmath.exp(s * since), s) for a, s in rate.terms] + drift
        moving = real_terms([(scale * a, s) for a, s in terms if abs(a) > FORGOTTEN_DEG_S])
        virtual = self._passage.modulated(self.now_s)
        pushed = real_terms(virtual.terms)
        return Forcing(constant, scale * rate.slope_deg_s2, moving, virtual.constant_v, pushed, virtual.slope_v_s)

    def _bias(self) -> tuple[float, list[tuple[complex, complex]]]:
        """Return the bias rate by temperature, deg/s: its goal, and what is left of the warm-up."""
        thermal, warm_up = self._bench.thermal, self._warm_up
        goal = thermal.bias_coefficient_deg_s_k * (warm_up.goal_c - thermal.reference_c)
        left = thermal.bias_coefficient_deg_s_k * (warm_up.at(self.now_s) - warm_up.goal_c)
        return goal, [(complex(left), complex(-1 / warm_up.time_constant_s))]

    def _rail(self, rail: int) -> Oscillation:
        """Return the voltage really present on a supply pin from now on."""
        ripple, smooth = self._ripples[rail], self._smooth_rail(rail)
        if ripple is None or not self._rail_v(rail):
            return smooth
        speed = 2 * math.pi * ripple.frequency_hz
        turned = cmath.rect(math.sqrt(2) * ripple.rms_v, speed * self.now_s + ripple.phase_rad)
        return Oscillation(smooth.constant_v, [*smooth.terms, (turned, 1j * speed)])

    def _smooth_rail(self, rail: int) -> Oscillation:
        """Return the voltage of a supply pin from now on without its ripple."""
        if not self._rail_v(rail):
            return Oscillation(0.0, [])
        on_its_way = self._rails[rail].later(self.now_s)
        return Oscillation(on_its_way.goal_v, [(complex(size), complex(-1 / tau)) for size, tau in on_its_way.terms])

    def _limits(self, duration_s: float) -> tuple[MovingLimits | None, tuple[float, float]]:
        """Return where the output saturates from now on, as it moves, and the tightest of it."""
        stage = self._bench.output_stage
        if not any(rail.terms for rail in self._rails):
            return None, output_limits(stage, self._rail_v(0), self._rail_v(1))
        moving = MovingLimits(stage, self._smooth_rail(0), self._smooth_rail(1))
        return moving, moving.tightest(duration_s)

    # -- power --

    def _rail_v(self, rail: int) -> float:
        """Return the smooth voltage of a supply pin now."""
        volts = self._rails[rail].at(self.now_s)
        return max(volts, 0.0) if rail == 0 else min(volts, 0.0)

    def _weaker_rail(self) -> float:
        return self._weaker_at(self.now_s)

    def _weaker_at(self, instant_s: float) -> float:
        positive, negative = self._rails
        return max(min(positive.at(instant_s), -negative.at(instant_s)), 0.0)

    def _rails_ahead(self) -> tuple[float, float]:
        """Return the weaker rail that a locked drive goes by, and up to when: the next threshold, end or step."""
        moving = [(sign, rail) for sign, rail in zip((1.0, -1.0), self._rails, strict=True) if rail.terms]
        if not moving:
            return self._weaker_rail(), math.inf
        supply, now = self._bench.supply, self.now_s
        levels = (0.0, supply.dead_v, supply.brown_out_v if self._running else supply.start_v)
        crossings = [rail.crosses_s(now, sign * level) for sign, rail in moving for level in levels]
        stop = min(*crossings, *(rail.ends_s(now) for _, rail in moving))
        if not self._drive[0].locked:
            return self._weaker_rail(), stop
        step_v = self._rail_step_v()
        travels = [(rail, rail.travel_v(now)) for _, rail in moving]
        steps = [(rail, min(step_v, left_v - 0.5 * step_v)) for rail, left_v in travels if left_v > 0.5 * step_v]
        if not steps:
            positive, negative = self._rails
            return max(min(positive.goal_v, -negative.goal_v), 0.0), stop
        stop = min(stop, *(rail.moved_s(now, distance_v) for rail, distance_v in steps))
        return 0.5 * (self._weaker_rail() + self._weaker_at(stop)), stop

    def _rail_step_v(self) -> float:
        """Return by how much the rails may move before the locked drive's amplitude follows."""
        weakest = min(self._weaker_rail(), *(abs(rail.goal_v) for rail in self._rails))
        weakest = max(weakest, self._bench.supply.brown_out_v)  # below, the drive is not locked any more
        if self._wanted_m(weakest) > self._strongest_m(weakest):
            return FORCED_STEP_V
        relative = abs(self._bench.drive_loop.amplitude_supply_coefficient_per_v)
        return AMPLITUDE_STEP / relative if relative else math.inf

    def _supplied(self) -> Callable[[float], Supplied]:
        """Return what the rails will allow at a bench time, as they go on now."""
        ends = [rail.ends_s(self.now_s) for rail in self._rails if rail.terms]
        settled_s, goal_v = max(ends, default=-math.inf), max(min(self._rails[0].goal_v, -self._rails[1].goal_v), 0.0)
        settled = Supplied(self._amplitude_m(goal_v), goal_v)

        def supplied(instant_s: float) -> Supplied:
            if instant_s >= settled_s:
                return settled
            rail_v = self._weaker_at(instant_s)
            return Supplied(self._amplitude_m(rail_v), rail_v)

        return supplied

    def _amplitude_m(self, rail_v: float) -> float:
        """Return the drive amplitude that the AGC holds on rails of `rail_v`, at most what its force can hold."""
        return min(self._wanted_m(rail_v), self._strongest_m(rail_v))

    def _wanted_m(self, rail_v: float) -> float:
        """Return the drive amplitude that the AGC wants."""
        loop, nominal = self._bench.drive_loop, self._bench.supply.nominal_v
        return loop.amplitude_m * (1 + loop.amplitude_supply_coefficient_per_v * (rail_v - nominal))

    def _strongest_m(self, rail_v: float) -> float:
        """Return the drive amplitude that the largest force can hold."""
        loop, mode, mass = self._bench.drive_loop, self._drive_mode(), self._bench.drive_mode.mass_kg
        return loop.force_limit_n_per_v * rail_v * mode.quality / (mass * mode.natural_rad_s**2)

    def _heat(self) -> None:
        """Let the temperature go to its new goal from where it is."""
        thermal = self._bench.thermal
        goal = thermal.ambient_c + (thermal.self_heating_k if self._running else 0.0)
        self._warm_up = WarmUp(self.now_s, self._warm_up.at(self.now_s), goal, thermal.time_constant_s)
        self._bands = self._warm_up.bands(thermal)

    def _start(self) -> None:
        self._drive = start_up(
            self._bench,
            self._drive_mode(),
            self._drive_parts(),
            start_s=self.now_s,
            phase_rad=self._phase,
            supplied=self._supplied(),
        )

    def _stop(self) -> None:
        speed = self._drive[0].drive_rad_s
        self._drive = ring_down(
            self._drive_mode(), self._drive_parts(), drive_rad_s=speed, start_s=self.now_s, phase_rad=self._phase
        )

    def _drive_parts(self) -> tuple[complex, complex]:
        """Return the two parts of the drive mode now."""
        segment, mode = self._drive[0], self._drive_mode()
        if not segment.motions:
            return mode.parts(segment.displacement_m, segment.velocity_m_s)
        motion = next(each for each in reversed(segment.motions) if each.start_s <= self.now_s)
        return mode.step(motion.parts, motion.force_m_s2, motion.drive_rad_s, self.now_s - motion.start_s)

    # -- parameters at the present temperature --

    def _temperature_c(self) -> float:
        return self._bands[0][1] * self._bench.thermal.refresh_k

    def _drive_mode(self) -> Resonance:
        return resonance_at(self._bench.drive_mode, self._bench.thermal, self._temperature_c())

    def _new_chain(self) -> tuple[Chain, NoisyChain | None, Flutter | None]:
        if not self._drive[0].locked:
            return self._build(), None, None
        key = (self._bands[0][1], self._drive[0].displacement_m)
        if key not in self._locked_chains:
            chain = self._build()
            flutter = Flutter(chain) if self._bench.table.flutter_per_sqrt_hz else None
            self._locked_chains[key] = chain, NoisyChain(chain, self._flicker, self._white), flutter
        return self._locked_chains[key]

    def _build(self) -> Chain:
        bench, temperature, drive = self._bench, self._temperature_c(), self._drive[0]
        in_phase = resonance_at(bench.sense_in_phase, bench.thermal, temperature)
        anti_phase = resonance_at(bench.sense_anti_phase, bench.thermal, temperature)
        return build_chain(bench, (in_phase, anti_phase), drive.drive_rad_s, drive.displacement_m, drive.velocity_m_s)
