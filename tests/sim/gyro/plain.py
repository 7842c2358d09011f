"""The gyro written down plainly a second time, for the tests: equations of motion and closed forms, no shared code."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from vcfbench.sim.parameters import BenchParameters, SenseMode


def steady_output_v(bench: BenchParameters, rate_rad_s: float, virtual_v: float = 0.0) -> float:
    """Steady filtered volts, corrected (12) and (15): V_dac/2 (...) sum K (P cos phi - R sin phi)/(P^2+R^2)."""
    omega = 2 * math.pi * bench.drive_mode.frequency_hz
    sense, path = bench.sense_path, bench.virtual_path
    phi, carrier = sense.demodulator_phase_rad, path.carrier_phase_rad
    gain = sense.multiplier_per_v * sense.reference_amplitude_v * sense.preamplifier_gain * sense.amplifier_gain
    total = 0.0
    for mode in (bench.sense_in_phase, bench.sense_anti_phase):
        natural = 2 * math.pi * mode.frequency_hz
        p, r = natural**2 - omega**2, natural * omega / mode.quality
        # a force sin(th + a) gives y = (P sin(th + a) - R cos(th + a)) / (P^2 + R^2); times sin(th + phi), mean
        coriolis = -2 * rate_rad_s * bench.drive_loop.amplitude_m * omega * share(mode)
        virtual = virtual_v * combs(bench, mode) * sense.reference_amplitude_v / path.mass_kg
        stiffness = 2 * omega * mode.quadrature_rad_s * bench.drive_loop.amplitude_m  # on -x = A cos(th)
        for size, angle in ((coriolis, 0.0), (virtual, carrier), (stiffness, math.pi / 2)):
            mean = 0.5 * (p * math.cos(angle - phi) + r * math.sin(angle - phi)) / (p * p + r * r)
            total += gain * mode.pick_off_v_per_m * size * mean
    return total


def rate_response(bench: BenchParameters, frequencies_hz: NDArray[np.float64]) -> NDArray[np.float64]:
    """How much of a rate that oscillates gets into the filtered volts, relative to a steady rate: both side bands."""
    omega, phi = 2 * math.pi * bench.drive_mode.frequency_hz, bench.sense_path.demodulator_phase_rad

    def answered(speed: NDArray[np.float64]) -> NDArray[np.complex128]:
        total = np.zeros(len(speed), complex)
        for mode in (bench.sense_in_phase, bench.sense_anti_phase):
            natural = 2 * math.pi * mode.frequency_hz
            compliance = 1.0 / (natural**2 - speed**2 + 1j * speed * natural / mode.quality)
            total += mode.pick_off_v_per_m * share(mode) * compliance
        return total * np.exp(-1j * phi)

    turned = 2 * math.pi * frequencies_hz
    both = answered(omega + turned) + answered(omega - turned).conj()
    steady = 2 * answered(np.array([omega])).real
    return np.abs(both / steady) / np.sqrt(1 + (frequencies_hz / bench.sense_path.low_pass_hz) ** 8)


def flutter_density(bench: BenchParameters, frequencies_hz: NDArray[np.float64]) -> NDArray[np.float64]:
    """One-sided density of the table's flutter, a share of the rate squared a hertz: white torque through the loop."""
    table = bench.table
    through = (2 * table.loop_damping * table.loop_hz * frequencies_hz) ** 2
    return table.flutter_per_sqrt_hz**2 * through / ((table.loop_hz**2 - frequencies_hz**2) ** 2 + through)


def share(mode: SenseMode) -> float:
    return mode.left_participation + mode.right_participation


def combs(bench: BenchParameters, mode: SenseMode) -> float:
    path = bench.virtual_path
    return mode.left_participation * path.left_comb_n_per_v2 + mode.right_participation * path.right_comb_n_per_v2


def output_v(bench: BenchParameters, filtered_v: float) -> float:
    stage = bench.output_stage
    u = stage.gain * filtered_v
    return stage.offset_v + u + stage.second_order_per_v * u**2 + stage.third_order_per_v2 * u**3


def carrier_rhs(
    bench: BenchParameters, time_s: float, state: NDArray[np.float64], rate_rad_s: float, virtual_v: float
) -> NDArray[np.float64]:
    """Equation (1), product and filter in real time: x, x', y1, y1', y2, y2' in um and um/s, two biquads in V."""
    omega = 2 * math.pi * bench.drive_mode.frequency_hz
    sense, path = bench.sense_path, bench.virtual_path
    x, dx = state[0], state[1]
    amplitude_um = bench.drive_loop.amplitude_m * 1e6
    force = omega**2 * amplitude_um / bench.drive_mode.quality
    out = np.empty_like(state)
    out[0] = dx
    out[1] = force * math.sin(omega * time_s) - omega / bench.drive_mode.quality * dx - omega**2 * x
    picked = 0.0
    for row, mode in ((2, bench.sense_in_phase), (4, bench.sense_anti_phase)):
        natural = 2 * math.pi * mode.frequency_hz
        y, dy = state[row], state[row + 1]
        carrier = sense.reference_amplitude_v * math.sin(omega * time_s + path.carrier_phase_rad)
        pushed = -2 * rate_rad_s * share(mode) * dx - 2 * omega * mode.quadrature_rad_s * x
        pushed += 1e6 * virtual_v * combs(bench, mode) * carrier / path.mass_kg
        out[row] = dy
        out[row + 1] = pushed - natural / mode.quality * dy - natural**2 * y
        picked += mode.pick_off_v_per_m * 1e-6 * y
    v_s = sense.preamplifier_gain * sense.amplifier_gain * picked
    reference = sense.reference_amplitude_v * math.sin(omega * time_s + sense.demodulator_phase_rad)
    _two_biquads(out, state, 2 * math.pi * sense.low_pass_hz, sense.multiplier_per_v * reference * v_s)
    return out


BUTTERWORTH_4 = (2 * math.sin(math.pi / 8), 2 * math.sin(3 * math.pi / 8))  # damping terms of the two biquads


def _two_biquads(out: NDArray[np.float64], state: NDArray[np.float64], cut_off: float, source: float) -> None:
    for row, damping in zip((6, 8), BUTTERWORTH_4, strict=True):
        out[row] = cut_off * state[row + 1]
        out[row + 1] = cut_off * (source - state[row] - damping * state[row + 1])
        source = state[row]


def noise_matrices(bench: BenchParameters) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Real (A, G G') of the base-band noise: Re, Im of (Y, Y') of both modes, two biquads, flicker, integral of v.

    Y'' + (2j w_d + w/Q) Y' + (w^2 - w_d^2 + j w w_d/Q) Y = 2j A w_d share (rate noise); only the first product of the
    demodulator. Lengths in um.
    """
    omega = 2 * math.pi * bench.drive_mode.frequency_hz
    sense, noise = bench.sense_path, bench.noise
    count = noise.flicker_processes
    size = 8 + 4 + count + 1
    a, g = np.zeros((size, size)), np.zeros((size, count + 2))
    white = math.radians(noise.angle_random_walk_deg_sqrt_s)
    sigma = math.radians(noise.bias_instability_deg_s) * math.sqrt(math.log(4) / math.pi)
    demodulated = 0.5 * sense.multiplier_per_v * sense.reference_amplitude_v * sense.preamplifier_gain
    demodulated *= sense.amplifier_gain
    phi = sense.demodulator_phase_rad
    for index, mode in enumerate((bench.sense_in_phase, bench.sense_anti_phase)):
        natural = 2 * math.pi * mode.frequency_hz
        p, r, damping = natural**2 - omega**2, natural * omega / mode.quality, natural / mode.quality
        re, im, dre, dim = range(4 * index, 4 * index + 4)
        a[re, dre] = a[im, dim] = 1.0
        a[dre, [re, im, dre, dim]] = -p, r, -damping, 2 * omega
        a[dim, [re, im, dre, dim]] = -r, -p, -2 * omega, -damping
        push = 2 * bench.drive_loop.amplitude_m * 1e6 * omega * share(mode)
        a[dim, 12 : 12 + count] = push
        g[dim, count], g[dre, count + 1] = push * white, -push * white
        # Re(d S), d = j k e^{-j phi}: Re d = k sin(phi), Im d = k cos(phi)
        volts = demodulated * mode.pick_off_v_per_m * 1e-6
        cut_off = 2 * math.pi * sense.low_pass_hz
        a[9, re], a[9, im] = cut_off * volts * math.sin(phi), -cut_off * volts * math.cos(phi)
    cut_off = 2 * math.pi * sense.low_pass_hz
    for row, damping in zip((8, 10), BUTTERWORTH_4, strict=True):
        a[row, row + 1] = cut_off
        a[row + 1, row], a[row + 1, row + 1] = -cut_off, -cut_off * damping
    a[11, 8] = cut_off
    for index in range(count):
        tau = noise.flicker_shortest_s * 4.0**index
        a[12 + index, 12 + index] = -1 / tau
        g[12 + index, index] = sigma * math.sqrt(2 / tau)
    a[-1, 10] = 1.0
    return a, g @ g.T
