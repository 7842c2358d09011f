"""One stretch of the gyro's history between two events, in closed form at any time within it."""

import cmath
import math
from collections.abc import Mapping

import numpy as np
from msgspec import Struct, field
from numpy.typing import NDArray
from simrack.dense import COARSE_S, coarser
from simrack.oscillation import Oscillation
from simrack.sources import Played

from vcfbench.sim.gyro.bridge import NoisePath
from vcfbench.sim.gyro.course import Acting, Answer
from vcfbench.sim.gyro.electronics import OutputLimits, PlayedVoltage, amplify
from vcfbench.sim.gyro.means import output_integral

PINS = ("rail_positive", "rail_negative")


class Stretch(Struct, frozen=True):
    """Voltages of every node over [start_s, stop_s]; a dead PCB shows 0 V everywhere but at its inputs.

    `answer` is the chain's to what is acting; it began `responding_s` before the stretch did. `noise_integral_v_s` is
    the noise's part of the integral of the filtered signal, `noise` its path, drawn if somebody looks. `shares` says of
    loaded nodes how much of their open voltage is left.
    """

    acting: Acting
    answer: Answer
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
        duration, source = self.stop_s - self.start_s, self._source(node)
        if source is not None:
            return source.integral(duration)
        if not self.acting.alive:
            return 0.0
        whole = self._whole_output(duration) if node == "output" else self._carrier_level_integral(node, duration)
        return self.shares.get(node, 1.0) * whole

    def finest_s(self, node: str) -> float:
        """Return a time in which a node does next to nothing that a cubic through its ends and neighbours misses."""
        source = self._source(node)
        if source is None:
            return COARSE_S
        return source.finest_s() if isinstance(source, Oscillation) else 0.0

    def closed_form(self, node: str) -> Oscillation | None:
        """Return the voltage of a node as sines, its origin at the start of the stretch; None without a closed form."""
        source = self._source(node)
        if source is None:
            return None if self.acting.alive else Oscillation(0.0, [])
        if not isinstance(source, Oscillation) or any(exponent.real for _, exponent in source.terms):
            return None
        return source

    def fed(self, node: str) -> bool:
        """Return True if a node's voltage is put on it from outside the PCB."""
        return self._source(node) is not None

    def source(self, node: str) -> tuple[Played, float] | None:
        """Return the source that plays on a node, and its share there; None without one."""
        source = self._source(node)
        if not isinstance(source, PlayedVoltage):
            return None
        return source.source, source.share * self.shares.get(node, 1.0)

    def _source(self, node: str) -> Oscillation | PlayedVoltage | None:
        """Return the voltage of one of the PCB's inputs; None for its own nodes."""
        if node == "v_vc":
            return self.acting.passage.voltage(self.start_s)
        return self.acting.pins[PINS.index(node)].voltage(self.start_s) if node in PINS else None

    def _rippling(self) -> Oscillation | None:
        """Return the rails' ripple in the output, None where nothing comes through.

        The approach of a rail to its level does not: the output knows the rails' level by its limits alone.
        """
        share = self.acting.bench.supply.ripple_feedthrough
        ripples = [term for pin in self.acting.pins for term in pin.rippling(self.start_s)] if share else []
        terms = [(share * size, speed) for size, speed in ripples]
        return Oscillation(0.0, terms) if terms else None

    def _limits(self) -> OutputLimits:
        """Return where the output saturates."""
        positive, negative = self.acting.pins
        stage, single = self.acting.bench.output_stage, self.acting.bench.supply.single
        return OutputLimits(stage, positive.smooth(self.start_s), negative.smooth(self.start_s), single)

    def _swinging(self, node: str) -> tuple[complex, float]:
        """Return the envelope of carrier or locked drive, and the volts that one of its unit is."""
        bench, displacement_m = self.acting.bench, self.acting.drive.displacement_m
        if node == "drive":
            return displacement_m, bench.drive_loop.pick_off_v_per_m
        if node != "carrier":
            raise ValueError(f"the PCB has no node {node!r}")
        v_dac = bench.sense_path.reference_amplitude_v
        v_dac *= abs(displacement_m) / bench.drive_loop.amplitude_m
        return -1j * v_dac * cmath.exp(1j * bench.virtual_path.carrier_phase_rad), 1.0

    def _whole_output(self, duration: float) -> float:
        """Return the integral of the output, the rails' ripple in it."""
        rippling = self._rippling()
        variance = 0.0 if self.noise is None else self.noise.variance_v2(duration)
        noise = self.noise_integral_v_s / duration
        filtered = self.answer.response().filtered.later(self.responding_s)
        output = output_integral(self._limits(), filtered, duration, noise, variance)
        return output if rippling is None else output + rippling.integral(duration)

    def _carrier_level_integral(self, node: str, duration: float) -> float:
        drive, turn = self.acting.drive, cmath.exp(1j * self.phase_rad)
        if node == "sense":
            sense = self.answer.response().sense.later(self.responding_s)
            carried = sense.carried(1j * drive.drive_rad_s).integral(duration)
            if self.noise is not None:
                carried += self.noise.carried_v_s(drive.drive_rad_s, duration)
            return (turn * carried).real
        envelope, volts = self._swinging(node)
        if node == "carrier" or not drive.motions:
            turned = drive.drive_rad_s * duration  # and the integral of exp(j w t)
            swung = cmath.exp(0.5j * turned) * duration * float(np.sinc(turned / math.tau))
            return volts * (envelope * turn * swung).real
        total, ends = 0.0, [each.start_s for each in drive.motions[1:]] + [math.inf]
        for motion, end in zip(drive.motions, ends, strict=True):
            start, stop = max(motion.start_s, self.start_s), min(end, self.stop_s)
            if start < stop:
                moved = motion.waveform(self.acting.drive_mode)
                whole, before = moved.integral(stop - motion.start_s), moved.integral(start - motion.start_s)
                total += (whole - before).real
        return volts * total

    def at(self, node: str, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a node's voltage at absolute times within the stretch."""
        volts, share = self._open_circuit(node, times_s), self.shares.get(node, 1.0)
        return volts if share == 1.0 else share * volts

    def _open_circuit(self, node: str, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        elapsed = times_s - self.start_s
        source = self._source(node)
        if source is not None:
            return source.at(elapsed)
        if not self.acting.alive:
            return np.zeros_like(elapsed)
        coarse = coarser(times_s)
        if coarse is not None:
            return coarse.interpolated(self._open_circuit(node, coarse.times_s()))
        if node == "output":
            filtered = self.answer.response().filtered.at(self.responding_s + elapsed).real
            noisy = filtered if self.noise is None else filtered + self.noise.filtered(elapsed)
            volts = amplify(self.acting.bench.output_stage, noisy, self._limits().at(elapsed))
            rippling = self._rippling()
            return volts if rippling is None else volts + rippling.at(elapsed)
        return self._carrier_level(node, times_s)

    def _carrier_level(self, node: str, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        elapsed, drive = times_s - self.start_s, self.acting.drive
        turned = np.exp(1j * (self.phase_rad + drive.drive_rad_s * elapsed))
        if node == "sense":
            sense = self.answer.response().sense.at(self.responding_s + elapsed)
            return np.asarray(((sense if self.noise is None else sense + self.noise.sense(elapsed)) * turned).real)
        envelope, volts = self._swinging(node)
        if node == "carrier" or not drive.motions:
            return np.asarray(volts * (envelope * turned).real)
        held = np.clip(np.searchsorted([each.start_s for each in drive.motions], times_s, side="right") - 1, 0, None)
        moved = np.zeros_like(times_s)
        for index in np.unique(held):
            motion, now = drive.motions[index], held == index
            moved[now] = motion.waveform(self.acting.drive_mode).at(times_s[now] - motion.start_s).real
        return volts * moved
