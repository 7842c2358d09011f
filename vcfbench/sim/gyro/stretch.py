"""One stretch of the gyro's history between two events, in closed form at any time within it."""

import cmath
import math
from collections.abc import Mapping

import numpy as np
from msgspec import Struct, field
from numpy.typing import NDArray
from simrack.dense import COARSE_S, coarser
from simrack.sources import Played

from vcfbench.sim.gyro.bridge import NoisePath
from vcfbench.sim.gyro.chain import Response
from vcfbench.sim.gyro.course import Answer
from vcfbench.sim.gyro.drive import DriveSegment
from vcfbench.sim.gyro.electronics import Oscillation, OutputLimits, Passage, Pin, PlayedVoltage, amplify
from vcfbench.sim.gyro.means import output_integral
from vcfbench.sim.gyro.modes import Resonance
from vcfbench.sim.parameters import BenchParameters

FINEST_RAD = 0.05
PINS = ("rail_positive", "rail_negative")


class Situation(Struct, frozen=True):
    """Conditions from one event to the next: the chain's answer, the drive, the voltages on V_Vc and the supply pins.

    A PCB without enough power is not `alive`.
    """

    bench: BenchParameters
    answer: Answer
    drive_mode: Resonance
    drive: DriveSegment
    passage: Passage
    pins: tuple[Pin, Pin]
    alive: bool


class Stretch(Struct, frozen=True):
    """Voltages of every node over [start_s, stop_s]; a dead PCB shows 0 V everywhere but at its inputs.

    The response began `responding_s` before the stretch did. `noise_integral_v_s` is the noise's part of the integral
    of the filtered signal, `noise` its path, drawn if somebody looks. `shares` says of loaded nodes how much of their
    open voltage is left.
    """

    given: Situation
    start_s: float
    stop_s: float
    responding_s: float
    phase_rad: float
    noise: NoisePath | None
    noise_integral_v_s: float
    shares: Mapping[str, float] = field(default_factory=dict)

    def integral(self, node: str) -> float:
        """Return the integral of a node's voltage over the stretch, V s.

        The noise of `sense` enters by what it is at both ends; what it gathers between, 1e-6 of it in 0.2 s, does not.
        """
        duration = self.stop_s - self.start_s
        source = self._source(node)
        if source is not None:
            return source.integral(duration)
        if not self.given.alive:
            return 0.0
        return self._share(node) * (
            self._whole_output(duration) if node == "output" else self._carrier_level_integral(node, duration)
        )

    def finest_s(self, node: str) -> float:
        """Return a time in which a node does next to nothing that a cubic through its ends and neighbours misses."""
        source = self._source(node)
        if source is None:
            return COARSE_S
        if not isinstance(source, Oscillation):
            return 0.0
        fastest = max((abs(exponent) for _, exponent in source.terms), default=0.0)
        return FINEST_RAD / fastest if fastest else math.inf

    @property
    def _response(self) -> Response:
        """The chain's, from `responding_s` before the start."""
        return self.given.answer.response()

    def _share(self, node: str) -> float:
        return self.shares.get(node, 1.0)

    def closed_form(self, node: str) -> Oscillation | None:
        """Return the voltage of a node as sines, its origin at the start of the stretch; None where only `at` tells."""
        source = self._source(node)
        if source is None:
            return None if self.given.alive else Oscillation(0.0, [])
        if not isinstance(source, Oscillation) or any(exponent.real for _, exponent in source.terms):
            return None
        return source

    def fed(self, node: str) -> bool:
        """Tell whether a node's voltage is put on it from outside the PCB."""
        return self._source(node) is not None

    def source(self, node: str) -> tuple[Played, float] | None:
        """Return the source that plays on a node, and the part of it that is there; None where nothing plays."""
        source = self._source(node)
        if not isinstance(source, PlayedVoltage):
            return None
        return source.source, source.share * self._share(node)

    def _source(self, node: str) -> Oscillation | PlayedVoltage | None:
        """Return the voltage of one of the PCB's inputs; None for its own nodes."""
        if node == "v_vc":
            return self.given.passage.voltage(self.start_s)
        return self.given.pins[PINS.index(node)].voltage(self.start_s) if node in PINS else None

    def _whole_output(self, duration: float) -> float:
        """Return the integral of the output, the rails' ripple in it."""
        rippling = self._rippling()
        variance = 0.0 if self.noise is None else self.noise.variance_v2(duration)
        noise = self.noise_integral_v_s / duration
        filtered = self._response.filtered.later(self.responding_s)
        output = output_integral(self._limits(), filtered, duration, noise, variance)
        if rippling is not None:
            output += rippling.integral(duration)
        return output

    def _rippling(self) -> Oscillation | None:
        """Return the rails' ripple in the output, None where nothing comes through.

        The approach of a rail to its level does not: the output knows the rails' level by its limits alone.
        """
        share = self.given.bench.supply.ripple_feedthrough
        ripples = [term for pin in self.given.pins for term in pin.rippling(self.start_s)] if share else []
        terms = [(share * size, speed) for size, speed in ripples]
        return Oscillation(0.0, terms) if terms else None

    def _limits(self) -> OutputLimits:
        """Return where the output saturates."""
        positive, negative = self.given.pins
        stage = self.given.bench.output_stage
        return OutputLimits(stage, positive.smooth(self.start_s), negative.smooth(self.start_s))

    def _carrier_level_integral(self, node: str, duration: float) -> float:
        turn = cmath.exp(1j * self.phase_rad)
        if node == "drive":
            return self.given.bench.drive_loop.pick_off_v_per_m * self._drive_integral(turn, duration)
        if node == "carrier":
            return (self._carrier_v() * turn * _turned(self.given.drive.drive_rad_s, duration)).real
        carried = (
            self._response.sense.later(self.responding_s).carried(1j * self.given.drive.drive_rad_s).integral(duration)
        )
        if self.noise is not None:
            carried += self.noise.carried_v_s(self.given.drive.drive_rad_s, duration)
        return (turn * carried).real

    def _carrier_v(self) -> complex:
        """Return the envelope of the carrier."""
        v_dac = self.given.bench.sense_path.reference_amplitude_v
        v_dac *= abs(self.given.drive.displacement_m) / self.given.bench.drive_loop.amplitude_m
        return -1j * v_dac * cmath.exp(1j * self.given.bench.virtual_path.carrier_phase_rad)

    def _drive_integral(self, turn: complex, duration: float) -> float:
        if not self.given.drive.motions:
            return (self.given.drive.displacement_m * turn * _turned(self.given.drive.drive_rad_s, duration)).real
        total, ends = 0.0, [each.start_s for each in self.given.drive.motions[1:]] + [math.inf]
        for motion, end in zip(self.given.drive.motions, ends, strict=True):
            start, stop = max(motion.start_s, self.start_s), min(end, self.stop_s)
            if start < stop:
                moved = motion.waveform(self.given.drive_mode)
                whole, before = moved.integral(stop - motion.start_s), moved.integral(start - motion.start_s)
                total += (whole - before).real
        return total

    def at(self, node: str, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a node's voltage at absolute times within the stretch."""
        volts, share = self._open_circuit(node, times_s), self._share(node)
        return volts if share == 1.0 else share * volts

    def _open_circuit(self, node: str, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        elapsed = times_s - self.start_s
        source = self._source(node)
        if source is not None:
            return source.at(elapsed)
        if not self.given.alive:
            return np.zeros_like(elapsed)
        coarse = coarser(times_s)
        if coarse is not None:
            return coarse.interpolated(self._open_circuit(node, coarse.times_s()))
        if node == "output":
            filtered = self._response.filtered.at(self.responding_s + elapsed).real
            noisy = filtered if self.noise is None else filtered + self.noise.filtered(elapsed)
            volts = amplify(self.given.bench.output_stage, noisy, self._limits().at(elapsed))
            rippling = self._rippling()
            return volts if rippling is None else volts + rippling.at(elapsed)
        return self._carrier_level(node, times_s)

    def _carrier_level(self, node: str, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        elapsed = times_s - self.start_s
        phase = self.phase_rad + self.given.drive.drive_rad_s * elapsed
        if node == "sense":
            envelope = self._response.sense.at(self.responding_s + elapsed)
            envelope = envelope if self.noise is None else envelope + self.noise.sense(elapsed)
            return np.asarray((envelope * np.exp(1j * phase)).real)
        loop = self.given.bench.drive_loop
        if node == "carrier":
            return np.asarray((self._carrier_v() * np.exp(1j * phase)).real)
        if node == "drive":
            return loop.pick_off_v_per_m * self._drive_displacement(times_s, phase)
        raise ValueError(f"the PCB has no node {node!r}")

    def _drive_displacement(self, times_s: NDArray[np.float64], phase_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        if not self.given.drive.motions:
            return np.asarray((self.given.drive.displacement_m * np.exp(1j * phase_rad)).real)
        starts = np.array([each.start_s for each in self.given.drive.motions])
        held = np.clip(np.searchsorted(starts, times_s, side="right") - 1, 0, None)
        moved = np.zeros_like(times_s)
        for index in np.unique(held):
            motion = self.given.drive.motions[index]
            moved[held == index] = (
                motion.waveform(self.given.drive_mode).at(times_s[held == index] - motion.start_s).real
            )
        return moved


def _turned(speed_rad_s: float, duration_s: float) -> complex:
    """Return the integral of exp(j w t) from 0 on."""
    return cmath.exp(0.5j * speed_rad_s * duration_s) * duration_s * float(np.sinc(speed_rad_s * duration_s / math.tau))
