"""The sense chain between two events: linear, hence known in closed form at any time.

Rate, modulator voltage and quadrature force the two sense modes (four first-order complex parts q_i, :mod:`.modes`).
With V_s = Re(S e^{j th}) the product with the reference is exactly Re(u), u = d S + d* S e^{2j th}, and a Butterworth
filter g_k' = p_k g_k + r_k u gives the filtered signal v = Re sum g_k. The filter's free motions h_k = g_k - sum_i
r_k (d c_i / (s_i - p_k) + d* c_i e^{2j th} / (s_i + 2j w_d - p_k)) q_i and the parts q_i are the chain's eigenmodes,
so the matrix exponential of the whole chain is one exponential an eigenmode, exact over any interval.

The second product is not only the 2 w_d ripple, which is (f_c / 2 f_d)^order = 4.2e-8 of the demodulated amplitude
behind 100 Hz, order 4, at 6978 Hz. It also brings the conjugate of each mode's free motion down to the base band:
0.36 % of a transient (half the split over the carrier), with a phase that depends on the carrier's at the moment of
the step.
"""

import cmath
from collections.abc import Callable
from functools import cached_property

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from vcfbench.sim.gyro.modes import Resonance, butterworth_poles, butterworth_residues
from vcfbench.sim.gyro.signals import FEW_TERMS, ExponentialSum
from vcfbench.sim.parameters import BenchParameters, SenseMode


class Forcing(Struct, frozen=True):
    """Rate (rad/s) and modulator output (V) from now on; terms (a, s) add a exp(s t) each."""

    rate: complex
    rate_slope: complex
    rate_terms: list[tuple[complex, complex]]
    virtual_v: complex
    virtual_terms: list[tuple[complex, complex]]
    virtual_slope: complex = 0.0


class Response(Struct, frozen=True, dict=True):
    """The chain's answer to a forcing, t from the moment it began.

    Eigenmodes move as `free exp(eigenmodes t) + constant + slope t + forced exp(exponents t)`, and the filter's
    besides as `(turned_constant + turned_slope t + turned_forced exp(exponents t)) exp(2j w_d t)`. `through` is what
    V_s has without motion: constant, slope, one size an exponent.
    """

    chain: "Chain"
    turn: complex
    free: NDArray[np.complex128]
    constant: NDArray[np.complex128]
    slope: NDArray[np.complex128]
    forced: NDArray[np.complex128]
    exponents: NDArray[np.complex128]
    turned_constant: NDArray[np.complex128]
    turned_slope: NDArray[np.complex128]
    turned_forced: NDArray[np.complex128]
    through: tuple[complex, complex, NDArray[np.complex128]]

    def modal(self, time_s: float) -> NDArray[np.complex128]:
        """Return the eigenmodes' coordinates at `time_s`."""
        modal = self.free * np.exp(self.chain.eigenmodes * time_s) + self.constant + self.slope * time_s
        turned = self.turned_constant + self.turned_slope * time_s
        moved = np.exp(self.exponents * time_s)
        modal += _moved(self.forced, moved)
        turned += _moved(self.turned_forced, moved)
        modal[4:] += turned * cmath.exp(2j * self.chain.drive_rad_s * time_s)
        return np.asarray(modal)

    @cached_property
    def sense(self) -> ExponentialSum:
        """The envelope S of V_s."""
        weights = self.chain.to_sense
        constant, slope, moving = self.through
        return ExponentialSum(
            complex(weights @ self.constant) + constant,
            complex(weights @ self.slope) + slope,
            np.concatenate((weights * self.free, _weighed(weights, self.forced) + moving)),
            np.concatenate((self.chain.eigenmodes, self.exponents)),
        )

    @cached_property
    def filtered(self) -> ExponentialSum:
        """The filtered signal v; its real part counts."""
        chain, weights = self.chain, self.chain.to_filtered
        turned, twice = self.turn * chain.turned_to_filtered, 2j * chain.drive_rad_s
        still = turned @ self.constant[:4] + self.turned_constant.sum()
        return ExponentialSum(
            complex(weights @ self.constant),
            complex(weights @ self.slope),
            np.concatenate(
                (
                    weights * self.free,
                    _weighed(weights, self.forced),
                    turned * self.free[:4],
                    _weighed(turned, self.forced[:4]) + self.turned_forced.sum(axis=0),
                    [still],
                )
            ),
            np.concatenate(
                (chain.eigenmodes, self.exponents, chain.eigenmodes[:4] + twice, self.exponents + twice, [twice])
            ),
            complex(turned @ self.slope[:4] + self.turned_slope.sum()),
            twice,
        )


class Chain(Struct, frozen=True, dict=True):
    """The sense chain with fixed parameters: eigenmodes, their forcing by each source, their outputs.

    `coupling` and `turned_coupling` (times e^{2j th}) tell the filter's parts from its free motions. Sources: `rate`
    per rad/s, `virtual` per volt at the modulator's output, `quadrature` the constant force; `turned_*` act on the
    filter's free motions times e^{2j th}. `to_filtered` and `turned_to_filtered` (times e^{2j th}, on the modes'
    parts) weigh eigenmodes into the filtered signal, `to_sense` into the envelope of V_s, V. What feeds through into
    V_s without motion acts on the filter alone: `carrier_through` of the carrier, `virtual_through` per modulator volt.
    """

    resonances: tuple[Resonance, Resonance]
    drive_rad_s: float
    eigenmodes: NDArray[np.complex128]
    coupling: NDArray[np.complex128]
    turned_coupling: NDArray[np.complex128]
    rate: NDArray[np.complex128]
    virtual: NDArray[np.complex128]
    quadrature: NDArray[np.complex128]
    turned_rate: NDArray[np.complex128]
    turned_virtual: NDArray[np.complex128]
    turned_quadrature: NDArray[np.complex128]
    to_filtered: NDArray[np.complex128]
    turned_to_filtered: NDArray[np.complex128]
    to_sense: NDArray[np.complex128]
    carrier_through: complex
    virtual_through: complex

    @cached_property
    def lag(self) -> NDArray[np.complex128]:
        """Response of the filter's free motions to a steady force times e^{2j th}."""
        return np.asarray(1 / (2j * self.drive_rad_s - self.eigenmodes[4:]))

    def handed_over(self, modal: NDArray[np.complex128], turn: complex, other: "Chain") -> NDArray[np.complex128]:
        """Return the coordinates that the state with these has in another chain; `turn` is e^{2j th} then.

        0 leaves the second product out. Where only the drive has changed the modes' parts stay: see :mod:`.modes`.
        """
        parts = modal[:4]
        if other.resonances == self.resonances:
            between = self.coupling - other.coupling + turn * (self.turned_coupling - other.turned_coupling)
            return np.concatenate((parts, modal[4:] + between @ parts))
        pairs = [(complex(plus), complex(minus)) for plus, minus in parts.reshape(2, 2)]
        modes = zip(self.resonances, other.resonances, pairs, strict=True)
        moved = [after.parts(before.displacement(pair), before.velocity(pair)) for before, after, pair in modes]
        others = np.ravel(moved)
        filtered = modal[4:] + (self.coupling + turn * self.turned_coupling) @ parts
        return np.concatenate((others, filtered - (other.coupling + turn * other.turned_coupling) @ others))

    def respond(self, modal: NDArray[np.complex128], forcing: Forcing, turn: complex) -> Response:
        """Return the response to `forcing` from coordinates `modal` on; `turn` is e^{2j th} then."""
        own, lag = self.eigenmodes, self.lag
        steady = self.rate * forcing.rate + self.virtual * forcing.virtual_v + self.quadrature
        turned_steady = self.turned_rate * forcing.rate + self.turned_virtual * forcing.virtual_v
        slope = self.rate * (-forcing.rate_slope / own) + self.virtual * (-forcing.virtual_slope / own)
        turned_slope = turn * forcing.rate_slope * self.turned_rate * lag
        turned_slope += turn * forcing.virtual_slope * self.turned_virtual * lag
        constant = (slope - steady) / own
        turned_constant = turn * (turned_steady + self.turned_quadrature) * lag - turned_slope * lag
        exponents = np.array([s for _, s in (*forcing.rate_terms, *forcing.virtual_terms)], complex)
        # What each term of the forcing moves, a column each
        by_rate, by_virtual = (
            np.array([a for a, _ in terms], complex) for terms in (forcing.rate_terms, forcing.virtual_terms)
        )
        forced = np.hstack((self.rate[:, None] * by_rate, self.virtual[:, None] * by_virtual))
        forced /= exponents - own[:, None]
        turned_forced = np.hstack((self.turned_rate[:, None] * by_rate, self.turned_virtual[:, None] * by_virtual))
        turned_forced = turn * turned_forced / (exponents + 2j * self.drive_rad_s - own[4:, None])
        free = modal - constant - forced.sum(axis=1)
        free[4:] -= turned_constant + turned_forced.sum(axis=1)
        # The envelope of V_s without motion; of a rate there is nothing
        sizes = [0j] * len(forcing.rate_terms) + [self.virtual_through * a for a, _ in forcing.virtual_terms]
        still = self.carrier_through + self.virtual_through * forcing.virtual_v
        through = still, self.virtual_through * forcing.virtual_slope, np.array(sizes, complex)
        return Response(
            self, turn, free, constant, slope, forced, exponents, turned_constant, turned_slope, turned_forced, through
        )


def _moved(forced: NDArray[np.complex128], moved: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the sum of the forced motions; of many it is not left to a library that spreads it over threads."""
    return np.asarray(forced @ moved if len(moved) <= FEW_TERMS else (forced * moved).sum(axis=1))


def _weighed(weights: NDArray[np.complex128], forced: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the outputs of the forced motions, one figure a term; see :func:`_moved`."""
    few = forced.shape[1] <= FEW_TERMS
    return np.asarray(weights @ forced if few else (weights[:, None] * forced).sum(axis=0))


class ChainDesign:
    """Parts of the chain that depend neither on temperature nor on drive, worked out once."""

    def __init__(self, bench: BenchParameters) -> None:
        sense, virtual = bench.sense_path, bench.virtual_path
        self._bench = bench
        self._filter_poles = np.array(butterworth_poles(2 * np.pi * sense.low_pass_hz, sense.low_pass_order))
        self._residues = np.array(butterworth_residues(list(self._filter_poles)))[:, None]
        self._ones = np.ones(len(self._filter_poles))
        self._nothing = np.zeros(len(self._filter_poles))
        self._shares = _each(bench, lambda mode: mode.left_participation + mode.right_participation)
        left, right = virtual.left_comb_n_per_v2, virtual.right_comb_n_per_v2
        self._combs = _each(bench, lambda mode: mode.left_participation * left + mode.right_participation * right)
        self._quadrature = _each(bench, lambda mode: mode.quadrature_rad_s)
        self._nominal_rad_s = 2 * np.pi * bench.drive_mode.frequency_hz
        self._carrier = -1j * cmath.exp(1j * virtual.carrier_phase_rad)
        self._demodulator_phase = cmath.exp(-1j * sense.demodulator_phase_rad)
        gain = sense.preamplifier_gain * sense.amplifier_gain
        self._pick_offs = [gain * mode.pick_off_v_per_m for mode in (bench.sense_in_phase, bench.sense_anti_phase)]

    def chain(
        self,
        resonances: tuple[Resonance, Resonance],
        drive_rad_s: float,
        displacement_m: complex,
        velocity_m_s: complex,
    ) -> Chain:
        """Return the chain for a drive motion given by its displacement and velocity envelopes.

        The Coriolis force per mass is -2 Omega x' in the rows of both modes, each with its share (equation (1), where
        the paper leaves the participation out); quadrature is a stiffness, in phase with x. The virtual force is
        m(V_Vc) K_FBY V_dac sin(w_d t + phi_c) (equation (8)) on each mass's own combs, and V_dac follows the drive
        pick-off. With x = -A cos(w_d t), the corrected equation (4), phi_c = pi gives it the direction of the Coriolis
        force. The base band Re(d S) of equation (9) is that of Re(S e^{j th}) times V_dac sin(th + phi).
        """
        bench, poles = self._bench, self._filter_poles
        eigen = np.array([p for mode in resonances for p in mode.poles]) - 1j * drive_rad_s
        # What each part adds to V_s = K_amp K_pre (K_inyv y1 + K_anyv y2), equations (7) and (8), V
        weights = []
        for pick_off, resonance in zip(self._pick_offs, resonances, strict=True):
            plus, minus = resonance.poles
            each = pick_off / (plus - minus)
            weights += [each, -each]
        seen = np.array(weights)
        v_dac = bench.sense_path.reference_amplitude_v * abs(displacement_m) / bench.drive_loop.amplitude_m
        down = self._residues * (0.5j * bench.sense_path.multiplier_per_v * v_dac * self._demodulator_phase)
        up = self._residues * (0.5j * bench.sense_path.multiplier_per_v * v_dac * self._demodulator_phase).conjugate()
        coupling = down * seen / (eigen - poles[:, None])
        turned = up * seen / (eigen + 2j * drive_rad_s - poles[:, None])
        rate = -2 * velocity_m_s * self._shares
        quadrature = -2 * self._nominal_rad_s * displacement_m * self._quadrature
        unit = self._carrier * v_dac
        virtual = unit / bench.virtual_path.mass_kg * self._combs
        carrier_through = bench.sense_path.carrier_feedthrough * unit
        virtual_through = bench.sense_path.v_vc_feedthrough * unit / bench.sense_path.reference_amplitude_v
        down, up = down[:, 0], up[:, 0]
        return Chain(
            resonances,
            drive_rad_s,
            np.concatenate((eigen, poles)),
            coupling,
            turned,
            rate=np.concatenate((rate, -coupling @ rate)),
            virtual=np.concatenate((virtual, down * virtual_through - coupling @ virtual)),
            quadrature=np.concatenate((quadrature, down * carrier_through - coupling @ quadrature)),
            turned_rate=-turned @ rate,
            turned_virtual=up * virtual_through - turned @ virtual,
            turned_quadrature=up * carrier_through - turned @ quadrature,
            to_filtered=np.concatenate((coupling.sum(axis=0), self._ones)),
            turned_to_filtered=turned.sum(axis=0),
            to_sense=np.concatenate((seen, self._nothing)),
            carrier_through=carrier_through,
            virtual_through=virtual_through,
        )


def _each(bench: BenchParameters, figure: Callable[[SenseMode], float]) -> NDArray[np.complex128]:
    """Return a figure of each mode, once for each of its two parts."""
    return np.array(
        [figure(mode) for mode in (bench.sense_in_phase, bench.sense_anti_phase) for _ in range(2)], complex
    )
