"""Gaussian noise of the chain over any interval, exactly.

White force noise (angle random walk, both quadratures of the carrier) and flicker, a sum of Ornstein-Uhlenbeck
processes on the rate, drive the chain of :mod:`.chain`. All of it is linear, so the
increments of chain, flicker and the running integral of the filtered signal are jointly Gaussian with a covariance
known in closed form: in the eigenmodes each entry is (G G*)_ab (exp((l_a + l_b*) T) - 1) / (l_a + l_b*). It is
factored once an interval, scaled to correlations first and with negative round-off cut away, and kept. The noise has a
state of its own, added to the deterministic one, and passes the demodulator by its first product only: the second one
would change its size by less than 1e-5.
"""

import math
from collections.abc import Callable
from functools import cached_property, lru_cache
from typing import TypeVar

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from vcfbench.sim.gyro.chain import Chain
from vcfbench.sim.parameters import NoiseSources

_AsArray = Callable[[NDArray[np.complex128]], NDArray[np.complex128]]
_Number = TypeVar("_Number", np.float64, np.complex128)
_Kept = TypeVar("_Kept")


class FlickerNoise(Struct, frozen=True):
    """Ornstein-Uhlenbeck processes whose sum has the spectrum B^2/(2 pi f) (two-sided), correlation times 1:4:16..."""

    times_s: NDArray[np.float64]
    deviation_rad_s: float

    @classmethod
    def of(cls, noise: NoiseSources) -> "FlickerNoise":
        """Return the processes of a parameter set; variance B^2 ln(4) / pi each makes the sum's density right."""
        times = np.array([noise.flicker_shortest_s * 4.0**n for n in range(noise.flicker_processes)])
        deviation = math.radians(noise.bias_instability_deg_s) * math.sqrt(math.log(4) / math.pi)
        return cls(times, deviation)

    def drawn(self, random: np.random.Generator) -> NDArray[np.float64]:
        """Return rates of stationary processes, rad/s."""
        return np.asarray(self.deviation_rad_s * random.standard_normal(len(self.times_s)))

    def later(
        self, rates_rad_s: NDArray[np.float64], duration_s: float, random: np.random.Generator
    ) -> NDArray[np.float64]:
        """Return the flicker rates after `duration_s` without a reading."""
        kept = np.exp(-duration_s / self.times_s)
        return np.asarray(rates_rad_s * kept + np.sqrt(-np.expm1(-2 * duration_s / self.times_s)) * self.drawn(random))


class NoiseState(Struct, frozen=True):
    """Part of the chain's eigenmodes (first product only) and of each flicker rate made by noise, rad/s.

    `made` has them as the matrices of a step take them: Re modal, Im modal, rates; `modes` is how many modes there are.
    """

    made: NDArray[np.float64]
    modes: int

    @classmethod
    def of(cls, modal: NDArray[np.complex128], rates_rad_s: NDArray[np.float64]) -> "NoiseState":
        """Return the state with these modes and rates."""
        return cls(np.concatenate((modal.real, modal.imag, rates_rad_s)), len(modal))

    @property
    def modal(self) -> NDArray[np.complex128]:
        """The eigenmodes."""
        modal = np.empty(self.modes, complex)
        modal.real, modal.imag = self.made[: self.modes], self.made[self.modes : 2 * self.modes]
        return modal

    @property
    def rates_rad_s(self) -> NDArray[np.float64]:
        """The flicker rates."""
        return self.made[2 * self.modes :]

    def plus(self, gathered: NDArray[np.float64]) -> "NoiseState":
        """Return it with a vector (Re modal, Im modal, flicker...) added; later elements are not its own."""
        return NoiseState(self.made + gathered[: len(self.made)], self.modes)

    def minus(self, other: "NoiseState") -> NDArray[np.float64]:
        """Return the vector that leads here from another one."""
        return self.made - other.made


class Interval(Struct, frozen=True, dict=True):
    """Effect of an interval on a noise state: decay, mean effect of the flicker, factor of the added noise."""

    decay: NDArray[np.complex128]
    fade: NDArray[np.float64]
    carried: NDArray[np.complex128]
    integral: NDArray[np.complex128]
    factor: NDArray[np.float64]

    @cached_property
    def whole(self) -> NDArray[np.float64]:
        """Matrix from (Re modal, Im modal, flicker, random numbers) to (Re modal, Im modal, flicker, integral)."""
        n, k = len(self.decay), len(self.fade)
        whole = np.zeros((2 * n + k + 1, 4 * n + 2 * k + 1))
        modes, rates = np.arange(n), 2 * n + np.arange(k)
        whole[modes, modes] = whole[n + modes, n + modes] = self.decay.real
        whole[n + modes, modes] = self.decay.imag
        whole[modes, n + modes] = -self.decay.imag
        whole[:n, 2 * n : 2 * n + k], whole[n : 2 * n, 2 * n : 2 * n + k] = self.carried.real, self.carried.imag
        whole[rates, rates] = self.fade
        whole[-1, :n], whole[-1, n : 2 * n] = self.integral[:n].real, -self.integral[:n].imag
        whole[-1, 2 * n : 2 * n + k] = self.integral[n:].real
        whole[:, 2 * n + k :] = self.factor
        return whole

    def integral_of(self, state: NoiseState) -> float:
        """Return the integral of the filtered noise that a state makes by itself, V s."""
        return float((self.integral @ np.concatenate((state.modal, state.rates_rad_s))).real)

    def later(self, state: NoiseState) -> NoiseState:
        """Return a state after the interval, by itself."""
        modal = state.modal * self.decay + self.carried @ state.rates_rad_s
        return NoiseState.of(modal, state.rates_rad_s * self.fade)


STEPS_KEPT = 64
"""Intervals of which something is kept: a plan has a handful, a bench served in real time never the same one twice."""
BLOCK = 128
SMALL = 1e-3


def kept(worked_out: Callable[[float], _Kept]) -> Callable[[float], _Kept]:
    """Return a function of an interval (s) that keeps its values, by the interval rounded to 1 ns."""
    by_ns = lru_cache(STEPS_KEPT)(lambda interval_ns: worked_out(interval_ns * 1e-9))
    return lambda interval_s: by_ns(round(interval_s * 1e9))


class NoisyChain:
    """A chain with its noise sources; factors of the covariance are kept by interval."""

    def __init__(self, chain: Chain, flicker: FlickerNoise, white_rad_sqrt_s: float) -> None:
        """Take the white noise in phase with the Coriolis force, as much as in quadrature."""
        self._n = len(chain.eigenmodes)
        slow = -1 / flicker.times_s
        self._exponents = np.concatenate((chain.eigenmodes, slow, [0.0]))
        drift = flicker.deviation_rad_s * np.sqrt(2 / flicker.times_s)
        follow = chain.rate[:, None] / (slow - chain.eigenmodes[:, None])
        self.chain = chain
        # How the sources drive the modes (eigenmodes freed of flicker, flicker, exponent 0), and the way back
        (n, k), white = follow.shape, white_rad_sqrt_s * chain.rate
        self._input = np.zeros((n + k + 1, k + 2), complex)
        self._input[:n, :k], self._input[n : n + k, :k] = -follow * drift, np.diag(drift)
        self._input[:n, k], self._input[:n, k + 1] = white, 1j * white
        self._output = np.eye(n + k, n + k + 1, dtype=complex)
        self._output[:n, n : n + k] = follow
        # The integral of v as a sum of modes; the mode of exponent 0 gets its input here
        moving = self._exponents[:-1]
        weights = np.concatenate((chain.to_filtered, chain.to_filtered @ follow)) / moving
        self._input[-1] = weights @ self._input[:-1]
        self._integral = np.concatenate((weights, [-1.0]))
        self._rows = np.vstack((self._output, self._integral))
        self._plain = _gathered(self._input, self._exponents)
        self._turned = _gathered(self._input, self._exponents, np.conj)
        rows = n + k + 1
        self._kept = np.concatenate((np.arange(n), rows + np.arange(n), np.arange(n, rows)))
        """The rows of real and imaginary parts that exist: flicker and integral are real."""
        self._follow = follow
        shows = np.column_stack((chain.to_filtered, chain.to_filtered * chain.eigenmodes, turning_with(chain)))
        self.shows = np.concatenate((shows, follow.T @ shows))
        """What the modes (:meth:`freed`) show: filtered noise and its slope (real parts), noise of the V_s envelope."""
        self._kept_interval = kept(self.interval)
        self.variance_v2 = kept(self._variance_v2)
        self._autocovariance: NDArray[np.complex128] | None = None

    def covariance(self, interval_s: float) -> NDArray[np.float64]:
        """Return the covariance of (Re modal, Im modal, flicker, integral) gathered over `interval_s`."""
        rows, count = self._rows, len(self._exponents)
        hermitian = rows @ self._turned(interval_s) @ rows.conj().T
        plain = rows @ self._plain(interval_s) @ rows.T
        full = np.empty((2 * count, 2 * count))
        full[:count, :count] = 0.5 * (hermitian + plain).real
        full[count:, count:] = 0.5 * (hermitian - plain).real
        full[:count, count:] = cross = 0.5 * (plain - hermitian).imag
        full[count:, :count] = cross.T
        return np.asarray(full[np.ix_(self._kept, self._kept)])

    def step(self, state: NoiseState, interval_s: float, random: np.random.Generator) -> tuple[NoiseState, float]:
        """Return the state after `interval_s` and the integral of the filtered noise over it, V s."""
        once = self._kept_interval(interval_s)
        after = once.whole @ np.concatenate((state.made, random.standard_normal(len(once.factor))))
        return NoiseState(after[:-1], self._n), float(after[-1])

    def interval(self, interval_s: float) -> Interval:
        """Return the effect of an interval on a state."""
        moving, n = self._exponents[:-1], self._n
        grown = np.exp(moving * interval_s)
        follow = self._output[:n, n:-1]
        carried = follow * (grown[n:] - grown[:n, None])
        weights = self._integral[:-1] * np.expm1(moving * interval_s)
        weights[n:] -= weights[:n] @ follow
        return Interval(grown[:n], grown[n:].real, carried, weights, _factor(self.covariance(interval_s)))

    def _variance_v2(self, duration_s: float) -> float:
        """Return the variance of stationary filtered noise about its mean over a time, on average, V^2.

        The autocovariance is a sum of exponentials c exp(l t); the mean over T has the variance of sum c m(l T), m(x) =
        2 (exp(x) - 1 - x) / x^2.
        """
        if self._autocovariance is None:
            shows, sources, moving = self.shows[:, 0], self._input[:-1], self.moving
            plain = (sources @ sources.T) / -np.add.outer(moving, moving) @ shows
            turned = (sources @ sources.conj().T) / -np.add.outer(moving, moving.conj()) @ shows.conj()
            self._autocovariance = np.asarray(0.5 * shows * (plain + turned))
        x = self.moving * duration_s
        small = np.abs(x) < SMALL
        far = np.where(small, 1.0, x)
        mean = np.where(small, 1 + x / 3 + x**2 / 12, 2 * (np.expm1(far) - far) / far**2)
        return max(float((self._autocovariance * (1 - mean)).sum().real), 0.0)

    @property
    def moving(self) -> NDArray[np.complex128]:
        """Exponents of the modes: eigenmodes freed of flicker, flicker; 1/s."""
        return self._exponents[:-1]

    def freed(self, state: NoiseState) -> NDArray[np.complex128]:
        """Return a state by modes that move each by itself."""
        return np.concatenate((state.modal - self._follow @ state.rates_rad_s, state.rates_rad_s))

    def unfreed(self, modes: NDArray[np.complex128]) -> NoiseState:
        """Return the state of such modes."""
        return NoiseState.of(modes[: self._n] + self._follow @ modes[self._n :], modes[self._n :].real)

    def freed_draws(self, drawn: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the contribution of draws (rows: Re modal, Im modal, flicker, integral) to the modes."""
        n = self._n
        rates = drawn[:, 2 * n : -1]
        return np.concatenate((drawn[:, :n] + 1j * drawn[:, n : 2 * n] - rates @ self._follow.T, rates), axis=1)

    def spread(self, time_s: float, duration_s: float, weights: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the covariance of the noise gathered by `time_s` with a weighted sum of that by `duration_s`."""
        seen, left = self._seen(weights), duration_s - time_s
        plain = self._plain(time_s) @ (np.exp(self._exponents * left) * seen)
        turned = self._turned(time_s) @ (np.exp(self._exponents * left) * seen).conj()
        shown = self._rows @ (0.5 * (plain + turned))
        return np.asarray(np.concatenate((shown.real, shown.imag))[self._kept])

    def spread_shown(
        self, grown: NDArray[np.complex128], duration_s: float, weights: NDArray[np.float64]
    ) -> NDArray[np.complex128]:
        """Return the same as it shows (:attr:`shows`), at even times from 0 to `duration_s`.

        `grown` holds exp(moving t) of these times. Each covariance is (exp(l_i t + l_j T) - exp(l_j (T - t))) /
        (l_i + l_j): exponentials forward and backward in time.
        """
        seen = self._seen(weights)
        back = np.concatenate((grown[::-1], np.ones((len(grown), 1))), axis=1)
        total = np.zeros((len(grown), self.shows.shape[1]), complex)
        for other, behind in ((np.asarray, back), (np.conj, back.conj())):
            sums = np.add.outer(self.moving, other(self._exponents))
            parts = (self._input @ other(self._input).T)[:-1] / sums * other(seen)
            ahead = (parts @ other(np.exp(self._exponents * duration_s)))[:, None] * self.shows
            total += by_rows(grown, ahead) - by_rows(behind, parts.T @ self.shows)
        return np.asarray(0.5 * total)

    def _seen(self, weights: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return g for which Re(g @ modes) is the weighted sum of (Re modal, Im modal, flicker, integral)."""
        n = self._n
        real = np.concatenate((weights[:n] - 1j * weights[n : 2 * n], weights[2 * n :]))
        return np.asarray(real @ self._rows)


def _gathered(
    inputs: NDArray[np.complex128], exponents: NDArray[np.complex128], other: np.ufunc | _AsArray = np.asarray
) -> Callable[[float], NDArray[np.complex128]]:
    """Return a function of a time, s: the sum of inputs by then in pairs of modes, or of modes and conjugates."""
    speed = np.add.outer(exponents, other(exponents))
    strength, still = inputs @ other(inputs).T, speed == 0
    apart = np.where(still, -1.0, speed)
    return lambda time_s: np.asarray(strength * np.where(still, time_s, np.expm1(apart * time_s) / apart))


def by_rows(rows: NDArray[_Number], matrix: NDArray[_Number]) -> NDArray[_Number]:
    """Return `rows @ matrix`, in blocks so small that no library spreads them over threads."""
    return np.concatenate([rows[start : start + BLOCK] @ matrix for start in range(0, len(rows), BLOCK)])


def turning_with(chain: Chain) -> NDArray[np.complex128]:
    """Return the weights of V_s without the parts that turn against the carrier: see :mod:`.bridge`."""
    return np.where(chain.eigenmodes.imag > -chain.drive_rad_s, chain.to_sense, 0.0)


def _factor(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return F with F F' = covariance, for a covariance of widely different scales and deficient rank.

    It is the one symmetric root of the correlations: signs and turns of eigenvectors, which each processor chooses
    for itself, would draw other noise from the same random numbers.
    """
    scale = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    safe = np.where(scale == 0, 1.0, scale)
    values, vectors = np.linalg.eigh(covariance / np.multiply.outer(safe, safe))
    return np.asarray(scale[:, None] * ((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T))
