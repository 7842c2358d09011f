"""Response of the chain to the table's flutter: the answer to a sum of sines, exact over any interval.

It is added to the noise, whose way through the chain it takes: by the demodulator's first product only, the second one
would change its size by less than 1e-5, and with the parameters that the noise has. What is here is what a stretch of
flutter makes of a chain at rest; what went before decays with the rest of the noise.
"""

import math
from functools import cached_property

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from simrack.flutter import Flutter
from simrack.motion import RateSegment

from vcfbench.sim.gyro.chain import Chain
from vcfbench.sim.gyro.noise import NoiseState, kept, turning_with
from vcfbench.sim.gyro.signals import ExponentialSum


class Shaking:
    """A chain that one flutter shakes: how each of its lines, and of their mirror images, moves each eigenmode."""

    def __init__(self, chain: Chain, flutter: Flutter) -> None:
        self.chain = chain
        half = 0.5 * math.radians(1.0) * flutter.rates
        self.exponents = np.asarray(1j * np.concatenate((flutter.speeds_rad_s, -flutter.speeds_rad_s)), complex)
        self.forced = chain.rate[:, None] / (self.exponents - chain.eigenmodes[:, None])
        self.forced *= np.concatenate((half, half.conj()))
        lines = len(flutter.speeds_rad_s)
        self._speeds_rad_s = flutter.speeds_rad_s
        self._shown = chain.to_filtered @ self.forced
        self._power = np.abs(self._shown[:lines] + self._shown[lines:].conj()) ** 2 / 2.0
        self._kept_interval = kept(self._interval)
        self.variance_v2 = kept(self._variance_v2)

    def shaken(self, rate: RateSegment, start_s: float, duration_s: float) -> "Shaken | None":
        """Return the response to the flutter of a segment of the motion over an interval, None if it has none."""
        if not rate.shaking_deg_s:
            return None
        turned = rate.shaking_deg_s * np.exp(1j * (self._speeds_rad_s * start_s))
        sizes, (to_modal, to_integral) = np.concatenate((turned, turned.conj())), self._kept_interval(duration_s)
        modal = to_modal @ sizes
        gathered = np.concatenate((modal.real, modal.imag))
        return Shaken(self, sizes, rate.shaking_deg_s, gathered, float((to_integral @ sizes).real))

    def _interval(self, duration_s: float) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Return the effect of an interval on a chain at rest, a column a line: on each eigenmode, and the integral.

        The lines turn; the free motions that keep the chain at rest at the start decay.
        """
        turned = self._speeds_rad_s * duration_s
        moved = -2.0 * np.sin(0.5 * turned) ** 2 + 1j * np.sin(turned)
        both = np.concatenate((moved, moved.conj()))
        decayed = np.asarray(np.expm1(self.chain.eigenmodes * duration_s), complex)
        free = self.chain.to_filtered * decayed / self.chain.eigenmodes
        return self.forced * (both - decayed[:, None]), self._shown * both / self.exponents - free @ self.forced

    def _variance_v2(self, duration_s: float) -> float:
        """Return the variance of the filtered signal about its mean over a time, of flutter of 1 deg/s, V^2."""
        turned = np.sinc(self._speeds_rad_s * duration_s / math.tau)
        return float(self._power @ (1.0 - turned**2))


class Shaken(Struct, frozen=True, dict=True):
    """Response of a chain at rest to flutter: modes `forced exp(exponents t)` less its free motion.

    `sizes` are those of the lines at its start. `gathered` is what they come to, Re modal and Im modal, and
    `integral_v_s` what they put into the integral.
    """

    by: Shaking
    sizes: NDArray[np.complex128]
    shaking_deg_s: float
    gathered: NDArray[np.float64]
    integral_v_s: float

    def added(self, state: NoiseState, integral_v_s: float, sign: float = 1.0) -> tuple[NoiseState, float]:
        """Return the noise at the end, and its integral, with this in it (or, sign -1, without)."""
        made = state.made.copy()
        made[: len(self.gathered)] += sign * self.gathered
        return NoiseState(made, state.modes), integral_v_s + sign * self.integral_v_s

    @cached_property
    def filtered(self) -> ExponentialSum:
        """The filtered signal from the start on, V; its real part counts."""
        return self._sum(self.by.chain.to_filtered)

    @cached_property
    def sense(self) -> ExponentialSum:
        """The envelope of V_s, V."""
        return self._sum(turning_with(self.by.chain))

    def _sum(self, weights: NDArray[np.complex128]) -> ExponentialSum:
        free = -(self.by.forced @ self.sizes)
        sizes = np.concatenate((weights * free, (weights @ self.by.forced) * self.sizes))
        return ExponentialSum(0j, 0j, sizes, np.concatenate((self.by.chain.eigenmodes, self.by.exponents)))

    def variance_v2(self, duration_s: float) -> float:
        """Return the variance of the filtered signal about its mean over a time, once the chain has settled, V^2."""
        return self.shaking_deg_s**2 * self.by.variance_v2(duration_s)
