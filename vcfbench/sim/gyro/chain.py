"""The sense chain between two events: linear, hence known in closed form at any time.

Rate, modulator voltage and quadrature force the two sense modes (four first-order complex parts, :mod:`.modes`); the
demodulator turns their sum into the base band u, a Butterworth filter g_k' = p_k g_k + r_k u gives the filtered signal
v = Re sum g_k. The filter's free motions h_k = g_k - sum_i r_k c_i q_i / (s_i - p_k) and the parts q_i are the chain's
eigenmodes, so the matrix exponential of the whole chain is one exponential an eigenmode, exact over any interval.

The product with the reference also makes a 2 w_d part; behind the filter it is (f_c / 2 f_d)^order of the demodulated
amplitude, 4.2e-8 for 100 Hz, 6978 Hz and order 4, and is left out here. :mod:`.carrier` has it.
"""

from __future__ import annotations

import cmath
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from vcfbench.sim.gyro.modes import butterworth_poles, butterworth_residues
from vcfbench.sim.gyro.signals import ExponentialSum

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from vcfbench.sim.gyro.modes import Resonance
    from vcfbench.sim.parameters import BenchParameters, SenseMode

__all__ = ["Chain", "ChainState", "Forcing", "Response", "build_chain"]


@dataclass(frozen=True, slots=True)
class ChainState:
    """What the chain remembers, in terms that outlive a change of its parameters.

    `displacements`, `velocities`: complex envelopes of both sense modes, m and m/s. `filtered`: the filter's parts, V.
    """

    displacements: NDArray[np.complex128]
    velocities: NDArray[np.complex128]
    filtered: NDArray[np.complex128]

    @classmethod
    def at_rest(cls, order: int) -> ChainState:
        """Return the state of a chain that never moved."""
        return cls(np.zeros(2, complex), np.zeros(2, complex), np.zeros(order, complex))


@dataclass(frozen=True, slots=True)
class Forcing:
    """Rate (rad/s) and modulator output (V) from now on; terms (a, s) add a exp(s t) each."""

    rate: complex
    rate_slope: complex
    rate_terms: list[tuple[complex, complex]]
    virtual_v: complex
    virtual_terms: list[tuple[complex, complex]]


@dataclass(frozen=True, slots=True)
class Response:
    """The chain's answer to a forcing, t from the moment it began."""

    eigenmodes: NDArray[np.complex128]
    free: NDArray[np.complex128]
    constant: NDArray[np.complex128]
    slope: NDArray[np.complex128]
    forced: NDArray[np.complex128]
    exponents: NDArray[np.complex128]

    def modal(self, time_s: float) -> NDArray[np.complex128]:
        """Return the eigenmodes' coordinates at `time_s`."""
        moving: NDArray[np.complex128] = self.forced @ np.exp(self.exponents * time_s)
        return self.free * np.exp(self.eigenmodes * time_s) + self.constant + self.slope * time_s + moving

    def seen(self, weights: NDArray[np.complex128]) -> ExponentialSum:
        """Return the signal that a weighted sum of the eigenmodes makes."""
        return ExponentialSum(
            complex(weights @ self.constant),
            complex(weights @ self.slope),
            np.concatenate((weights * self.free, weights @ self.forced)),
            np.concatenate((self.eigenmodes, self.exponents)),
        )


@dataclass(frozen=True, slots=True)
class Chain:
    """The sense chain with fixed parameters: eigenmodes, how each source forces them, what they show.

    `to_modal`/`from_modal` turn (q1+, q1-, q2+, q2-, g_1...) into eigenmodes and back; `by_rate` is per rad/s,
    `by_virtual` per volt at the modulator's output, `by_quadrature` the constant quadrature force; `to_filtered` and
    `to_sense` weigh eigenmodes into the filtered signal and the envelope of V_s, V.
    """

    resonances: tuple[Resonance, Resonance]
    eigenmodes: NDArray[np.complex128]
    coupling: NDArray[np.complex128]
    by_rate: NDArray[np.complex128]
    by_virtual: NDArray[np.complex128]
    by_quadrature: NDArray[np.complex128]
    to_filtered: NDArray[np.complex128]
    to_sense: NDArray[np.complex128]

    def modal(self, state: ChainState) -> NDArray[np.complex128]:
        """Return the eigenmodes' coordinates of a state."""
        parts = np.array(
            [
                part
                for mode, y, dy in zip(self.resonances, state.displacements, state.velocities, strict=True)
                for part in mode.parts(complex(y), complex(dy))
            ]
        )
        return np.concatenate((parts, state.filtered - self.coupling @ parts))

    def state(self, modal: NDArray[np.complex128]) -> ChainState:
        """Return the state that has these coordinates."""
        parts = modal[:4]
        pairs = [(complex(parts[2 * i]), complex(parts[2 * i + 1])) for i in range(2)]
        modes = list(zip(self.resonances, pairs, strict=True))
        return ChainState(
            np.array([mode.displacement(pair) for mode, pair in modes]),
            np.array([mode.velocity(pair) for mode, pair in modes]),
            modal[4:] + self.coupling @ parts,
        )

    def respond(self, modal: NDArray[np.complex128], forcing: Forcing) -> Response:
        """Return the response to `forcing` from coordinates `modal` on."""
        own = self.eigenmodes
        steady = self.by_rate * forcing.rate + self.by_virtual * forcing.virtual_v + self.by_quadrature
        slope = self.by_rate * (-forcing.rate_slope / own)
        constant = (slope - steady) / own
        terms = [*forcing.rate_terms, *forcing.virtual_terms]
        exponents = np.array([s for _, s in terms], complex)
        forces = np.concatenate(
            (_spread(self.by_rate, forcing.rate_terms), _spread(self.by_virtual, forcing.virtual_terms)), axis=1
        )
        forced = forces / (exponents - own[:, None])
        return Response(own, modal - constant - forced.sum(axis=1), constant, slope, forced, exponents)


def _spread(weights: NDArray[np.complex128], terms: list[tuple[complex, complex]]) -> NDArray[np.complex128]:
    return np.asarray(np.multiply.outer(weights, np.array([a for a, _ in terms], complex)))


def build_chain(
    bench: BenchParameters,
    resonances: tuple[Resonance, Resonance],
    drive_rad_s: float,
    drive_displacement_m: complex,
    drive_velocity_m_s: complex,
) -> Chain:
    """Return the chain for a drive motion given by its displacement and velocity envelopes.

    The Coriolis force per mass is -2 Omega x' in the rows of both modes, each with its share (equation (1), where the
    paper leaves the participation out); quadrature is a stiffness, in phase with x. The virtual force is m(V_Vc)
    K_FBY V_dac sin(w_d t + phi_c) (equation (8)) on each mass's own combs, and V_dac follows the drive pick-off. With
    x = -A cos(w_d t), the corrected equation (4), phi_c = pi gives it the direction of the Coriolis force.
    """
    poles = np.array([p for mode in resonances for p in mode.poles])
    eigen = poles - 1j * drive_rad_s
    seen = _pick_off(bench, resonances)
    v_dac = bench.sense_path.reference_amplitude_v * abs(drive_displacement_m) / bench.drive_loop.amplitude_m
    base_band = seen * _demodulator(bench, v_dac)
    filter_poles = butterworth_poles(2 * np.pi * bench.sense_path.low_pass_hz, bench.sense_path.low_pass_order)
    residues = np.array(butterworth_residues(filter_poles))
    coupling = residues[:, None] * base_band / (eigen - np.array(filter_poles)[:, None])
    rate = -2 * drive_velocity_m_s * _each(bench, _share)
    nominal = 2 * np.pi * bench.drive_mode.frequency_hz
    quadrature = -2 * nominal * drive_displacement_m * _each(bench, lambda mode: mode.quadrature_rad_s)
    carrier = -1j * cmath.exp(1j * bench.virtual_path.carrier_phase_rad) * v_dac / bench.virtual_path.mass_kg
    virtual = carrier * _each(bench, lambda mode: _combs(bench, mode))
    return Chain(
        resonances,
        np.concatenate((eigen, filter_poles)),
        coupling,
        by_rate=_forced(rate, coupling),
        by_virtual=_forced(virtual, coupling),
        by_quadrature=_forced(quadrature, coupling),
        to_filtered=np.concatenate((coupling.sum(axis=0), np.ones(len(filter_poles)))),
        to_sense=np.concatenate((seen, np.zeros(len(filter_poles)))),
    )


def _forced(force: NDArray[np.complex128], coupling: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return how a force on the modes' parts acts on the eigenmodes."""
    return np.concatenate((force, -coupling @ force))


def _pick_off(bench: BenchParameters, resonances: tuple[Resonance, Resonance]) -> NDArray[np.complex128]:
    """Return what each part adds to V_s = K_amp K_pre (K_inyv y1 + K_anyv y2), equations (7) and (8), V."""
    gain = bench.sense_path.preamplifier_gain * bench.sense_path.amplifier_gain
    weights = []
    for mode, resonance in zip((bench.sense_in_phase, bench.sense_anti_phase), resonances, strict=True):
        plus, minus = resonance.poles
        each = gain * mode.pick_off_v_per_m / (plus - minus)
        weights += [each, -each]
    return np.array(weights)


def _demodulator(bench: BenchParameters, v_dac: float) -> complex:
    """Return d of the base band Re(d S) of equation (9), Re(S e^{j th}) times V_dac sin(th + phi)."""
    phase = cmath.exp(-1j * bench.sense_path.demodulator_phase_rad)
    return 0.5j * bench.sense_path.multiplier_per_v * v_dac * phase


def _each(bench: BenchParameters, figure: _ModeFigure) -> NDArray[np.complex128]:
    """Return a figure of each mode, once for each of its two parts."""
    return np.array(
        [figure(mode) for mode in (bench.sense_in_phase, bench.sense_anti_phase) for _ in range(2)], complex
    )


def _share(mode: SenseMode) -> float:
    return mode.left_participation + mode.right_participation


def _combs(bench: BenchParameters, mode: SenseMode) -> float:
    left, right = bench.virtual_path.left_comb_n_per_v2, bench.virtual_path.right_comb_n_per_v2
    return mode.left_participation * left + mode.right_participation * right


if TYPE_CHECKING:
    from collections.abc import Callable

    _ModeFigure = Callable[[SenseMode], float]
