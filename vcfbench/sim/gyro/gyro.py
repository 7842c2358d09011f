"""The gyro with its PCB: its state, and the way from one event to the next.

Between events (a rail, V_Vc, a corner of the table's motion, a segment of the drive's start-up, a band of
temperature) the sense chain is linear with fixed parameters and Gaussian noise, and one step of any length is exact.

A rail that moves (:class:`simrack.sources.Approach`) is exact at its pin, in the output's limits, in the control
steps of a start-up and in when it crosses the PCB's thresholds. The amplitude of the locked drive, which the whole
chain depends on, follows it in steps.
"""

import copy
import math
from collections.abc import Hashable
from functools import lru_cache

from msgspec.structs import replace
from simrack.motion import RateSegment
from simrack.sources import NOTHING_V, Approach, Drive, Played, Ripple

from vcfbench.sim.gyro.bridge import NoisePath
from vcfbench.sim.gyro.chain import ChainDesign
from vcfbench.sim.gyro.course import Acting, Answer, Course, SwitchOn, switch_on
from vcfbench.sim.gyro.design import seen_share
from vcfbench.sim.gyro.drive import (
    held_m,
    locked,
    resting,
    ring_down,
    start_up,
    strongest_m,
    wanted_m,
    weaker_v,
)
from vcfbench.sim.gyro.electronics import Pin, passage, rail_current_a
from vcfbench.sim.gyro.modes import Resonance
from vcfbench.sim.gyro.noise_course import NoiseCourse
from vcfbench.sim.gyro.stretch import Stretch
from vcfbench.sim.gyro.thermal import WarmUp, resonance_at
from vcfbench.sim.parameters import BenchParameters

COLDEST_C, HOTTEST_C = -55.0, 125.0
AMPLITUDE_STEP = 1e-4
"""Of the drive amplitude: the largest step in which it follows a rail that moves, at most half of it off."""
FORCED_STEP_V = 10e-3
"""The same where the drive's force is at its limit, in volts of the rail: 0.15 % of the amplitude at most."""
_LOOKS, _IMAGINED = 2, 5
"""Random streams beside the gyro's own noise (1: :mod:`simrack.flutter`, 3: :mod:`vcfbench.sim.mains`); no number
is ever given again, 4 neither."""


_design = lru_cache(8)(ChainDesign)


class Gyro:
    """State of the gyro at `now_s`, the last instant that it was taken to.

    The chain's response goes on until something changes what forces it. The noise, which is added to it, lags: it is
    brought up to now, in one step, when somebody looks or when its size changes.
    """

    def __init__(self, bench: BenchParameters, seed: int, now_s: float) -> None:
        self.now_s = now_s
        self._bench = bench
        self._seed = seed
        self._pins = (Pin(1.0, Approach(0.0)), Pin(-1.0, Approach(0.0)))
        self._rail_event_s = math.inf
        self._running = False
        self._switch_ons, self._switched_on = 0, SwitchOn()
        self._source: Drive | Played | None = None
        self._passage = passage(None, bench.virtual_path, now_s)
        self._phase = 0.0
        """The carrier's when what acts on the chain changed last."""
        self._acting: Acting | None = None
        self._next_event_s = math.inf
        """That while the same acts, which every such event ends."""
        self._answer: Answer | None = None
        """The chain's to it, once somebody looks."""
        self._seen_share = seen_share(bench)
        self._rate: RateSegment | None = None
        self._seen: RateSegment | None = None
        """What the gyroscope's own axis sees of it."""
        self._warm_up = WarmUp(now_s, bench.thermal.ambient_c, bench.thermal.ambient_c, bench.thermal.time_constant_s)
        self._bands = self._warm_up.bands(bench.thermal)
        self._drive_mode = self._mode_at(self._temperature_c())
        self._drive = [resting(self._drive_mode.natural_rad_s)]
        self._design = _design(bench)
        self._course = Course(self._design, bench)
        self._noise = NoiseCourse(self._design, bench, seed, now_s)

    def imagined(self) -> "Gyro":
        """Return an independent copy of the gyro that goes on from here, with its own random numbers."""
        other = copy.copy(self)
        other.part()
        return other

    def part(self) -> None:
        """Detach from the original: copy shared mutable state."""
        self._drive, self._bands = list(self._drive), list(self._bands)
        self._course = copy.copy(self._course)
        self._course.part()
        self._noise = copy.copy(self._noise)
        self._noise.part((self._seed, _IMAGINED, round(self.now_s * 1e9)))

    # -- commands, all at `now_s` --

    def set_rails(self, positive: Approach, negative: Approach) -> None:
        """Set the course of both rails, signed; of the wrong polarity they count as 0 V."""
        self._pins = (replace(self._pins[0], approach=positive), replace(self._pins[1], approach=negative))
        self._follow_rails()

    def _follow_rails(self) -> None:
        """Start or stop the drive loop and the warm-up as the rails have crossed their thresholds."""
        self._end_acting()
        positive, negative = (replace(pin, approach=pin.approach.later(self.now_s)) for pin in self._pins)
        self._pins = (positive, negative)
        supply, was_running = self._bench.supply, self._running
        self._running = self._weaker_at(self.now_s) >= (supply.brown_out_v if was_running else supply.start_v)
        if self._running != was_running:
            self._heat()
        if self._running and not was_running:
            self._switched_on = switch_on(self._bench.noise, self._seed, self._switch_ons)
            self._switch_ons += 1
            bench, mode, rails, parts = self._bench, self._drive_mode, self._rails, self._drive_parts()
            self._drive = list(start_up(bench, mode, rails, parts=parts, start_s=self.now_s, phase_rad=self._phase))
        elif was_running and not self._running:
            speed = self._drive[0].drive_rad_s
            self._drive = ring_down(
                self._drive_mode, self._drive_parts(), drive_rad_s=speed, start_s=self.now_s, phase_rad=self._phase
            )
        self._settle()

    def set_ripple(self, rail: int, ripple: Ripple | None) -> None:
        """Change the ripple on rail 0 (positive) or 1 (negative); its pin shows it.

        What it does to the drive amplitude, 1e-7 of it for a millivolt, is left out.
        """
        self._end_acting()
        positive, negative = self._pins
        with_ripple = replace(self._pins[rail], ripple=ripple)
        self._pins = (with_ripple, negative) if rail == 0 else (positive, with_ripple)

    def connect_v_vc(self, source: Drive | Played | None) -> None:
        """Connect a generator to the V_Vc input, or leave it to the pull-down with the modulator's switch open."""
        self._end_acting()
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

    @property
    def up(self) -> tuple[float, ...]:
        """Direction of up, by the axes of the case."""
        return self._bench.site.up

    def set_up(self, up: tuple[float, ...]) -> None:
        """Turn the case: its direction `up` points up from now on."""
        self._bench = replace(self._bench, site=replace(self._bench.site, up=up))
        self._seen_share, self._rate = seen_share(self._bench), None
        self._end_acting()

    def temperature_c(self) -> float:
        """Return its temperature, degC."""
        return self._warm_up.at(self.now_s)

    def rail_current_a(self, rail: int, voltage_v: float, instant_s: float) -> float:
        """Return the magnitude of the current drawn from rail 0 (positive) or 1 (negative) at a voltage.

        `instant_s` is not before now and not after the next event.
        """
        weaker_v = min(abs(voltage_v), abs(self._pins[1 - rail].smooth_v(instant_s)))
        starts = weaker_v > 0.0 and (self._running or weaker_v >= self._bench.supply.start_v)
        swings_m = abs(self._drive[0].displacement_m)
        lacking = 1 - swings_m / held_m(self._bench, self._drive_mode, weaker_v) if starts else 0.0
        return rail_current_a(self._bench.supply, voltage_v, min(max(lacking, 0.0), 1.0))

    def drawing(self) -> Hashable:
        """Return a key of the rails' currents, until the next event or command; None while a rail moves."""
        moving = any(rail.terms for rail in self._rails)
        return None if moving else (self._pins, self._drive[0], self._running)

    # -- time --

    def next_event_s(self) -> float:
        """Return when the gyro's own parameters change next, or V_Vc begins another piece."""
        return self._event_ahead_s() if self._acting is None else self._next_event_s

    def _event_ahead_s(self) -> float:
        band = self._bands[1][0] if len(self._bands) > 1 else math.inf
        return min(self._drive[0].stop_s, band, self._passage.stop_s, self._rail_event_s)

    def look(self, rate: RateSegment, stop_s: float) -> Stretch:
        """Return the stretch from now to `stop_s`, as it will be without noise but that of now; goes nowhere."""
        acting = self._act(rate)
        self._noise.bring_up(self.now_s)
        return self._stretch(acting, stop_s, self._noise.path_now(self._key), 0.0)

    def go(self, rate: RateSegment, stop_s: float) -> None:
        """Advance to `stop_s`, not beyond the next event, without a reading in between."""
        self._act(rate)
        self._arrive(stop_s)

    def propagate(self, rate: RateSegment, stop_s: float) -> Stretch:
        """Go to `stop_s`, not beyond the next event, and return the stretch."""
        acting = self._act(rate)
        self._noise.bring_up(self.now_s)
        path, integral_v_s = self._noise.gone(stop_s, self._key)
        stretch = self._stretch(acting, stop_s, path, integral_v_s)
        self._arrive(stop_s)
        return stretch

    @property
    def _key(self) -> tuple[int, ...]:
        """Key of a picture's random numbers: the seed and the instant."""
        return self._seed, _LOOKS, round(self.now_s * 1e9)

    def _act(self, rate: RateSegment) -> Acting:
        """Return the forcing of the chain; where it has changed, it acts from now on."""
        if rate is not self._rate:
            self._end_acting()
            self._rate = rate
            self._seen = rate if self._seen_share == 1.0 else rate.askew(self._seen_share)
            self._noise.shake(self.now_s, self._seen)
        if self._acting is None:
            self._acting = Acting(
                self.now_s,
                self._phase,
                self._bench,
                self._temperature_c(),
                self._drive_mode,
                self._drive[0],
                self._seen or rate,
                self._warm_up,
                self._passage,
                self._pins,
                self._switched_on,
            )
            self._course.note(self._acting)
            self._next_event_s = self._event_ahead_s()
        return self._acting

    def _end_acting(self) -> None:
        """End the present forcing of the chain now, before something changes it."""
        self._phase = self._phase_now()
        if self._answer is not None:
            self._answer.part()
        self._acting = self._answer = None

    def _arrive(self, stop_s: float) -> None:
        self.now_s = stop_s
        if self.next_event_s() <= stop_s:
            self._end_acting()
            changed = False
            if self._passage.stop_s <= self.now_s:
                self.connect_v_vc(self._source)
            while self._drive[0].stop_s <= self.now_s:
                self._drive.pop(0)
                changed = True
            while len(self._bands) > 1 and self._bands[1][0] <= self.now_s:
                self._bands.pop(0)
                self._drive_mode = self._mode_at(self._temperature_c())
                changed = True
            if self._rail_event_s <= self.now_s:
                self._follow_rails()
            elif changed:
                self._settle()

    def _phase_now(self) -> float:
        """Return the carrier's phase, rad."""
        if self._acting is None:
            return self._phase
        return math.fmod(
            self._phase + self._acting.drive.drive_rad_s * (self.now_s - self._acting.since_s), 2 * math.pi
        )

    def _settle(self) -> None:
        """Go on with the drive and the chain that fit rails and temperature now; a locked loop follows both at once."""
        held_v, self._rail_event_s = self._rails_ahead()
        if self._drive[0].locked:
            self._drive = [locked(held_m(self._bench, self._drive_mode, held_v), self._drive_mode.natural_rad_s)]
        self._end_acting()
        self._noise.go_through(self.now_s, self._bench, self._temperature_c(), self._drive[0])

    def _stretch(self, acting: Acting, stop_s: float, noise: NoisePath | None, noise_integral_v_s: float) -> Stretch:
        """Return the stretch from now to `stop_s`."""
        answer = self._answer = self._answer or Answer(self._course, self.now_s)
        since_s, phase_rad = self.now_s - acting.since_s, self._phase_now()
        return Stretch(acting, answer, self.now_s, stop_s, since_s, phase_rad, noise, noise_integral_v_s)

    # -- power --

    @property
    def _rails(self) -> tuple[Approach, Approach]:
        return self._pins[0].approach, self._pins[1].approach

    def _weaker_at(self, instant_s: float) -> float:
        return weaker_v(self._rails, instant_s)

    def _rails_ahead(self) -> tuple[float, float]:
        """Return the weaker rail that a locked drive goes by, and up to when: the next threshold, end or step."""
        moving = [(sign, rail) for sign, rail in zip((1.0, -1.0), self._rails, strict=True) if rail.terms]
        if not moving:
            return self._weaker_at(self.now_s), math.inf
        supply, now = self._bench.supply, self.now_s
        levels = (0.0, supply.dead_v, supply.brown_out_v if self._running else supply.start_v)
        crossings = [rail.crosses_s(now, sign * level) for sign, rail in moving for level in levels]
        stop = min(*crossings, *(rail.ends_s(now) for _, rail in moving))
        if not self._drive[0].locked:
            return self._weaker_at(self.now_s), stop
        step_v = self._rail_step_v()
        travels = [(rail, rail.travel_v(now)) for _, rail in moving]
        # what is left is never more than half a step; by rounding alone it would be a step that takes no time
        steps = [
            (rail, min(step_v, left_v - 0.5 * step_v)) for rail, left_v in travels if left_v > 0.5 * step_v + NOTHING_V
        ]
        if not steps:
            positive, negative = self._rails
            return max(min(positive.goal_v, -negative.goal_v), 0.0), stop
        stop = min(stop, *(rail.moved_s(now, distance_v) for rail, distance_v in steps))
        return 0.5 * (self._weaker_at(self.now_s) + self._weaker_at(stop)), stop

    def _rail_step_v(self) -> float:
        """Return the amount by which the rails may move before the locked drive's amplitude follows."""
        weakest = min(self._weaker_at(self.now_s), *(abs(rail.goal_v) for rail in self._rails))
        weakest = max(weakest, self._bench.supply.brown_out_v)  # below, the drive is not locked any more
        if wanted_m(self._bench, weakest) > strongest_m(self._bench, self._drive_mode, weakest):
            return FORCED_STEP_V
        relative = abs(self._bench.drive_loop.amplitude_supply_coefficient_per_v)
        return AMPLITUDE_STEP / relative if relative else math.inf

    def _heat(self) -> None:
        """Let the temperature go to its new goal from where it is."""
        thermal = self._bench.thermal
        goal = thermal.ambient_c + (thermal.self_heating_k if self._running else 0.0)
        self._warm_up = WarmUp(self.now_s, self._warm_up.at(self.now_s), goal, thermal.time_constant_s)
        self._bands = self._warm_up.bands(thermal)
        self._drive_mode = self._mode_at(self._temperature_c())

    def _drive_parts(self) -> tuple[complex, complex]:
        """Return the two parts of the drive mode now."""
        segment, mode = self._drive[0], self._drive_mode
        if not segment.motions:
            return mode.parts(segment.displacement_m, segment.velocity_m_s)
        motion = next(each for each in reversed(segment.motions) if each.start_s <= self.now_s)
        return mode.step(motion.parts, motion.force_m_s2, motion.drive_rad_s, self.now_s - motion.start_s)

    # -- parameters at the present temperature --

    def _temperature_c(self) -> float:
        return self._bands[0][1] * self._bench.thermal.refresh_k

    def _mode_at(self, temperature_c: float) -> Resonance:
        """Return the drive mode at a temperature."""
        return resonance_at(self._bench.drive_mode, self._bench.thermal, temperature_c)
