"""The gyro at carrier level: the whole equation of motion, product demodulation and filter, cycle by cycle.

This is the proof of the envelope model of :mod:`.chain`, written without any envelope. With the drive locked the
system is linear and periodic: x'' + (w/Q) x' + w^2 x = (F_d/m) sin(th), the sense modes of equation (1), V_s times
V_dac sin(th + phi), low-pass. Each of the `samples` steps of a carrier cycle is four fourth-order Magnus steps (modes
exact, the turning of carrier and reference to about 1e-9); a cycle is their product, and cycles follow by matrix
powers in blocks, some thousand times faster than real time.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct

from vcfbench.sim.gyro.modes import butterworth_poles

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from vcfbench.sim.parameters import BenchParameters, SenseMode

FINE_STEPS = 4
BLOCK_CYCLES = 64


class CarrierRun(Struct, frozen=True):
    """Waveforms at `samples` instants a cycle, from the end of the first step on; V.

    `time_s` counts from the start of the run, `drive` is the pick-off, `filtered` the demodulated signal behind the
    low-pass filter with its 2 w_d ripple, `state` what a following run begins with.
    """

    time_s: NDArray[np.float64]
    drive: NDArray[np.float64]
    sense: NDArray[np.float64]
    filtered: NDArray[np.float64]
    state: NDArray[np.float64]


class CarrierModel:
    """The gyro at its reference temperature with the drive locked at resonance.

    The state is (x, x', y1, y1', y2, y2', low-pass..., 1): displacements in pick-off volts (x: in A_x), velocities over
    w_d likewise. Runs begin and end at th = 0 (mod 2 pi).
    """

    def __init__(self, bench: BenchParameters, samples: int = 64) -> None:
        self._bench = bench
        self._samples = samples
        self._drive_rad_s = 2 * math.pi * bench.drive_mode.frequency_hz
        self._order = bench.sense_path.low_pass_order
        self.cycle_s = 1 / bench.drive_mode.frequency_hz

    def at_rest(self) -> NDArray[np.float64]:
        """Return the state of a locked drive and a sense side that never moved: x = -A_x cos(th) at th = 0."""
        state = np.zeros(7 + self._order)
        state[0], state[-1] = -1.0, 1.0
        return state

    def run(self, state: NDArray[np.float64], cycles: int, *, rate_rad_s: float, virtual_v: float) -> CarrierRun:
        """Go on for whole carrier cycles under a constant rate and modulator voltage."""
        to_samples = self._cycle(rate_rad_s, virtual_v)
        # The states after 0..count applications of `once`, in blocks
        once = to_samples[-1]
        powers = [np.eye(len(state))]
        for _ in range(min(BLOCK_CYCLES, cycles)):
            powers.append(once @ powers[-1])
        block = np.array(powers[1:])
        states = [state[None, :]]
        for start in range(0, cycles, len(block)):
            states.append((block @ states[-1][-1])[: cycles - start])
        starts = np.concatenate(states)
        drive, sense, filtered = (
            (starts[:-1] @ (to_samples.transpose(0, 2, 1) @ row).T).ravel() for row in self._rows()
        )
        step = self.cycle_s / self._samples
        turned = 2 * math.pi / self._samples * np.arange(1, len(sense) + 1)
        sense += self._through(np.asarray(turned, float), virtual_v)
        times = np.asarray(step * np.arange(1, len(drive) + 1), float)
        return CarrierRun(times, drive, sense, filtered, starts[-1])

    def _cycle(self, rate_rad_s: float, virtual_v: float) -> NDArray[np.float64]:
        """Return the matrices from the state at the start of a cycle to each of its sampling instants."""
        from scipy.linalg import expm  # noqa: PLC0415  (only where a carrier-level run is wanted)

        count = self._samples * FINE_STEPS
        turn = 2 * math.pi / count
        step = self.cycle_s / count
        middle = turn * (np.arange(count) + 0.5)
        half = turn * math.sqrt(3) / 6
        early = self._matrices(np.asarray(middle - half, float), rate_rad_s, virtual_v)
        late = self._matrices(np.asarray(middle + half, float), rate_rad_s, virtual_v)
        mixed = math.sqrt(3) / 12 * step**2 * (late @ early - early @ late)
        fine = np.asarray(expm(0.5 * step * (early + late) + mixed))
        whole, cumulative = np.eye(fine.shape[-1]), []
        for index, each in enumerate(fine):
            whole = each @ whole
            if (index + 1) % FINE_STEPS == 0:
                cumulative.append(whole)
        return np.array(cumulative)

    def _matrices(self, phases: NDArray[np.float64], rate_rad_s: float, virtual_v: float) -> NDArray[np.float64]:
        """Return the system matrix at each carrier phase."""
        size = 7 + self._order
        matrices = np.zeros((len(phases), size, size))
        drive, mode = self._drive_rad_s, self._bench.drive_mode
        _oscillate(matrices, 0, drive, drive, mode.quality)
        matrices[:, 1, -1] = drive / mode.quality * np.sin(phases)
        modes = (self._bench.sense_in_phase, self._bench.sense_anti_phase)
        for row, each in zip((2, 4), modes, strict=True):
            _oscillate(matrices, row, 2 * math.pi * each.frequency_hz, drive, each.quality)
            self._force(matrices, row + 1, each, phases, rate_rad_s, virtual_v)
        # Demodulate V_s into the low-pass filter, a chain of integrators with feedback
        sense, order = self._bench.sense_path, self._order
        cut_off = 2 * math.pi * sense.low_pass_hz
        feedback = np.poly(butterworth_poles(1.0, order)).real[:0:-1]
        for index in range(order - 1):
            matrices[:, 6 + index, 7 + index] = cut_off
        matrices[:, 5 + order, 6 : 6 + order] = -cut_off * feedback
        scale = cut_off * sense.multiplier_per_v * sense.reference_amplitude_v
        product = scale * np.sin(phases + sense.demodulator_phase_rad)
        gain = sense.preamplifier_gain * sense.amplifier_gain
        matrices[:, 5 + order, 2] = matrices[:, 5 + order, 4] = gain * product
        matrices[:, 5 + order, -1] = product * self._through(phases, virtual_v)
        return matrices

    def _force(  # noqa: PLR0917
        self,
        matrices: NDArray[np.float64],
        row: int,
        mode: SenseMode,
        phases: NDArray[np.float64],
        rate_rad_s: float,
        virtual_v: float,
    ) -> None:
        """Put Coriolis force, quadrature and virtual force on a sense mode."""
        path, amplitude = self._bench.virtual_path, self._bench.drive_loop.amplitude_m
        volts = mode.pick_off_v_per_m
        share = mode.left_participation + mode.right_participation
        matrices[:, row, 1] = -2 * rate_rad_s * share * amplitude * volts
        matrices[:, row, 0] = -2 * mode.quadrature_rad_s * amplitude * volts
        combs = mode.left_participation * path.left_comb_n_per_v2 + mode.right_participation * path.right_comb_n_per_v2
        force = virtual_v * combs * self._bench.sense_path.reference_amplitude_v / path.mass_kg
        matrices[:, row, -1] = force * volts / self._drive_rad_s * np.sin(phases + path.carrier_phase_rad)

    def _through(self, phases: NDArray[np.float64], virtual_v: float) -> NDArray[np.float64]:
        """Return the part of carrier and modulated V_Vc in V_s without motion."""
        sense = self._bench.sense_path
        size = sense.carrier_feedthrough * sense.reference_amplitude_v + sense.v_vc_feedthrough * virtual_v
        return np.asarray(size * np.sin(phases + self._bench.virtual_path.carrier_phase_rad))

    def _rows(self) -> NDArray[np.float64]:
        """Return the rows that show drive pick-off, V_s and the filtered signal."""
        rows = np.zeros((3, 7 + self._order))
        rows[0, 0] = self._bench.drive_loop.pick_off_v_per_m * self._bench.drive_loop.amplitude_m
        rows[1, 2] = rows[1, 4] = self._bench.sense_path.preamplifier_gain * self._bench.sense_path.amplifier_gain
        rows[2, 6] = 1.0
        return rows


def _oscillate(matrices: NDArray[np.float64], row: int, natural: float, scale: float, quality: float) -> None:
    matrices[:, row, row + 1] = scale
    matrices[:, row + 1, row] = -(natural**2) / scale
    matrices[:, row + 1, row + 1] = -natural / quality
