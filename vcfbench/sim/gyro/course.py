"""Course of the sense chain: its forcing, one after another, and its response.

What acts is only noted. The chain's response is worked out when somebody looks, and no further back than the chain
remembers: a start-up that nobody watches costs next to nothing, and so does a long way down to rest.
"""

import cmath
import copy
import math
from collections import deque

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from simrack.motion import RateSegment

from vcfbench.sim.gyro.chain import Chain, ChainDesign, Forcing, Response
from vcfbench.sim.gyro.design import earth_rate_deg_s, g_rate_deg_s
from vcfbench.sim.gyro.drive import DriveSegment, weaker_v
from vcfbench.sim.gyro.electronics import Passage, Pin
from vcfbench.sim.gyro.modes import Resonance
from vcfbench.sim.gyro.signals import real_terms
from vcfbench.sim.gyro.thermal import WarmUp, resonance_at
from vcfbench.sim.parameters import BenchParameters, NoiseSources

_SWITCHED_ON = 6
"""Of the seed, with the number of the switch-on; 2, 4 and 5 are the gyroscope's."""
FORGOTTEN_DEG_S = 1e-18
FORGOTTEN_NEPERS = 36.0
"""What has decayed by so much, to 2e-16, is no more than the rounding of what came later."""


class SwitchOn(Struct, frozen=True):
    """Additional bias and gain of one switch-on; both sense columns have the same gain."""

    bias_deg_s: float = 0.0
    gain: float = 1.0


def switch_on(noise: NoiseSources, seed: int, number: int) -> SwitchOn:
    """Draw the switch-on of this number, the first being 0."""
    if not (noise.switch_on_bias_deg_s or noise.switch_on_scale_factor):
        return SwitchOn()
    bias, gain = np.random.default_rng((seed, _SWITCHED_ON, number)).standard_normal(2).tolist()
    return SwitchOn(noise.switch_on_bias_deg_s * bias, 1.0 + noise.switch_on_scale_factor * gain)


class Acting(Struct, frozen=True):
    """Conditions from one event to the next, and their forcing of the chain; at `since_s` the carrier's phase was that.

    `passage` and `pins` are the voltages on V_Vc and the supply pins.
    """

    since_s: float
    phase_rad: float
    bench: BenchParameters
    temperature_c: float
    drive_mode: Resonance
    drive: DriveSegment
    rate: RateSegment
    warm_up: WarmUp
    passage: Passage
    pins: tuple[Pin, Pin]
    switched_on: SwitchOn

    @property
    def alive(self) -> bool:
        """Return True if the PCB has enough power for any output."""
        positive, negative = self.pins
        return weaker_v((positive.approach, negative.approach), self.since_s) >= self.bench.supply.dead_v

    @property
    def turn(self) -> complex:
        """Twice the carrier's phase when it began, as e^{2j th}."""
        return cmath.exp(2j * self.phase_rad)

    def chain(self, design: ChainDesign) -> Chain:
        """Return the chain that it acts on."""
        return chain_at(design, self.bench, self.temperature_c, self.drive)

    def forcing(self) -> Forcing:
        """Return rate and modulator voltage from `since_s` on."""
        bench, rate, warm_up, gain = self.bench, self.rate, self.warm_up, self.switched_on.gain
        since, scale = self.since_s - rate.start_s, math.pi / 180 * gain
        # The bias rate by temperature, deg/s: its goal, and what is left of the warm-up
        per_k = bench.thermal.bias_coefficient_deg_s_k
        goal = per_k * (warm_up.goal_c - bench.thermal.reference_c)
        left = per_k * (warm_up.at(self.since_s) - warm_up.goal_c)
        bias = earth_rate_deg_s(bench) + goal + self.switched_on.bias_deg_s + g_rate_deg_s(bench)
        constant = scale * (rate.rate_deg_s + rate.slope_deg_s2 * since + bias)
        turning = [(a * cmath.exp(s * since), s) for a, s in rate.terms]
        terms = [*turning, (complex(left), complex(-1 / warm_up.time_constant_s))]
        moving = real_terms([(scale * a, s) for a, s in terms if abs(a) > FORGOTTEN_DEG_S])
        virtual = self.passage.modulated(self.since_s)
        pushed = real_terms([(gain * a, s) for a, s in virtual.terms])
        slopes = scale * rate.slope_deg_s2, gain * virtual.slope_v_s
        return Forcing(constant, slopes[0], moving, gain * virtual.constant_v, pushed, slopes[1])


class Course:
    """The chain's course; it begins at rest, with the first noted forcing."""

    def __init__(self, design: ChainDesign, bench: BenchParameters) -> None:
        path = bench.sense_path
        self._design = design
        self._at_rest = np.zeros(4 + path.low_pass_order, complex)
        self._filter_nepers_s = 2 * math.pi * path.low_pass_hz * math.sin(math.pi / (2 * path.low_pass_order))
        self._noted: deque[tuple[Acting, float]] = deque()
        """What was not worked out yet, in order, each with the chain's decay until then since the course began."""
        self._forgetting = (0.0, 0.0, 0.0)
        """Since when it decays as it does, 1/s, and by how much it had decayed then."""
        self._followed: tuple[Acting, Response] | None = None
        """The last that was worked out, and the response; None is a chain at rest before the first that is noted."""

    def part(self) -> None:
        """Detach from the original: copy shared mutable state."""
        self._noted = self._noted.copy()

    def note(self, acting: Acting) -> None:
        """Note a forcing from now on."""
        modes = _resonances(acting.bench, acting.temperature_c)
        nepers_s = min(*[mode.natural_rad_s / (2 * mode.quality) for mode in modes], self._filter_nepers_s)
        decayed = self._decayed(acting.since_s)
        self._forgetting = acting.since_s, nepers_s, decayed
        self._noted.append((acting, decayed))
        self._forget(acting.since_s)

    def _decayed(self, instant_s: float) -> float:
        since_s, nepers_s, decayed = self._forgetting
        return decayed + nepers_s * (instant_s - since_s)

    def response(self, from_s: float) -> Response:
        """Return the chain's response to the last noted forcing, its time from then; exact from `from_s` on.

        Raises:
            RuntimeError: nothing was noted.
        """
        self._forget(from_s)
        while self._noted:
            # Work out the response to a forcing, from the chain's state by then
            acting, _ = self._noted.popleft()
            turn = acting.turn
            if self._followed is None:
                chain, modal = acting.chain(self._design), self._at_rest
            else:
                earlier, response = self._followed
                modal, chain = response.modal(acting.since_s - earlier.since_s), response.chain
                same_modes = acting.temperature_c == earlier.temperature_c and acting.bench is earlier.bench
                if not (same_modes and acting.drive == earlier.drive):
                    chain = acting.chain(self._design)
                    modal = response.chain.handed_over(modal, turn, chain)
            forcing = _past_dead_band(acting.forcing(), chain, acting.bench.sense_path.dead_band_deg_s)
            self._followed = acting, chain.respond(modal, forcing, turn)
        if self._followed is None:
            raise RuntimeError("the simulated signal chain has no level yet")
        return self._followed[1]

    def _forget(self, instant_s: float) -> None:
        """Leave out forcings that the chain has forgotten by then: it might as well have been at rest."""
        decayed = self._decayed(instant_s)
        while len(self._noted) > 1 and decayed - self._noted[1][1] > FORGOTTEN_NEPERS:
            self._noted.popleft()
            self._followed = None


class Answer(Struct):
    """The chain's response to the last noted forcing, computed on request from `_from_s` on.

    A meter on a rail, or a picture of the drive, never asks.
    """

    _course: Course
    _from_s: float
    _response: Response | None = None

    def response(self) -> Response:
        """Return the response, its time from the start of the forcing."""
        if self._response is None:
            self._response = self._course.response(self._from_s)
        return self._response

    def part(self) -> None:
        """Answer later questions apart from the course, which goes on to something else."""
        if self._response is None:
            self._course = copy.copy(self._course)
            self._course.part()


def chain_at(design: ChainDesign, bench: BenchParameters, temperature_c: float, drive: DriveSegment) -> Chain:
    """Return the sense chain at a temperature, under a drive."""
    return design.chain(_resonances(bench, temperature_c), drive.drive_rad_s, drive.displacement_m, drive.velocity_m_s)


def _past_dead_band(forcing: Forcing, chain: Chain, half_deg_s: float) -> Forcing:
    """Return the part of a forcing beyond the dead band.

    It acts on the rate that, steady, would move the output as rate and modulator voltage together. Exact while that
    stays on one side of an edge. What changes within less than a second, or turns (a table's ripple), counts by its
    middle or by where it comes to, a ramp by where it begins: the rate is off by the width of the band at most.
    """
    if not half_deg_s or not chain.rate.any():  # a drive at rest answers to no rate
        return forcing
    answer, half = chain.to_filtered / chain.eigenmodes, math.radians(half_deg_s)
    per_v = float((answer @ chain.virtual).real / (answer @ chain.rate).real)
    slow = sum((a for a, s in forcing.rate_terms if s.imag == 0.0 and s.real > -1.0), start=0j)
    acting = (forcing.rate + per_v * forcing.virtual_v + slow).real
    if abs(acting) <= half:
        return Forcing(0j, 0j, [], 0j, [])
    return replace(forcing, rate=forcing.rate - math.copysign(half, acting))


def _resonances(bench: BenchParameters, temperature_c: float) -> tuple[Resonance, Resonance]:
    """Return the sense modes at a temperature."""
    in_phase = resonance_at(bench.sense_in_phase, bench.thermal, temperature_c)
    return in_phase, resonance_at(bench.sense_anti_phase, bench.thermal, temperature_c)
