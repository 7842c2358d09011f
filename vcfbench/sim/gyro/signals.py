"""Signals in closed form: a constant, a ramp, a sum of complex exponentials and one ramped exponential."""

import math

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

BLOCK = 1 << 20
FEW_TERMS = 256
_MANY_TIMES, _EVEN = 256, 1e-7
"""From so many on, and even so far that no exponential turns by more (rad), times are dealt with in rows."""


class ExponentialSum(Struct, frozen=True):
    """The signal `constant + slope t + sum amplitudes exp(exponents t) + turning t exp(turn t)`, complex.

    t is in s from the signal's own origin. An exponent is 0 where a sine on V_Vc meets the second product of the
    demodulator, at 2 f_d.
    """

    constant: complex
    slope: complex
    amplitudes: NDArray[np.complex128]
    exponents: NDArray[np.complex128]
    turning: complex = 0j
    turn: complex = 1j

    def at(self, times_s: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the signal at an array of times."""
        block = max(1, BLOCK // max(len(self.exponents), 1))  # fewer times where there are many exponentials
        if times_s.ndim != 1 or len(times_s) <= block:
            turned = self._summed(times_s)
        else:
            parts = (times_s[start : start + block] for start in range(0, len(times_s), block))
            turned = np.concatenate([self._summed(part) for part in parts])
        ramped = self.turning * times_s * np.exp(self.turn * times_s) if self.turning else 0.0
        return np.asarray(turned + (self.constant + self.slope * times_s) + ramped)

    def _summed(self, times_s: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the exponentials' sum."""
        if times_s.ndim == 1 and len(times_s) >= _MANY_TIMES:
            step_s = float(times_s[-1] - times_s[0]) / (len(times_s) - 1)
            left_s = float(np.abs(times_s - times_s[0] - step_s * np.arange(len(times_s))).max())
            if left_s * float(np.abs(self.exponents).max(initial=0.0)) < _EVEN:
                # of even times: exponentials of rows and of places in them alone, not of all times
                width = math.isqrt(len(times_s))
                rows = np.arange(0, len(times_s), width) * step_s + float(times_s[0])
                turned = np.exp(np.multiply.outer(rows, self.exponents)) * self.amplitudes
                within = np.exp(np.multiply.outer(np.arange(width) * step_s, self.exponents))
                return np.asarray(np.einsum("ik,jk->ij", turned, within).reshape(-1)[: len(times_s)])
        turned = np.exp(np.multiply.outer(times_s, self.exponents))
        # of many, the product is not left to a library that spreads it over threads
        many = turned.shape[-1] > FEW_TERMS
        return np.asarray((turned * self.amplitudes).sum(axis=-1) if many else turned @ self.amplitudes)

    def integral(self, duration_s: float) -> complex:
        """Return the integral from 0 to `duration_s`."""
        grown = np.expm1(self.exponents * duration_s)
        if np.count_nonzero(self.exponents) == len(self.exponents):
            grown /= self.exponents
        else:
            still = self.exponents == 0
            grown = np.where(still, duration_s, grown / np.where(still, 1.0, self.exponents))
        ramp = self.constant * duration_s + 0.5 * self.slope * duration_s**2
        end, turn = duration_s, self.turn
        ramped = self.turning * (end * np.exp(turn * end) - np.expm1(turn * end) / turn) / turn if self.turning else 0j
        return complex(self.amplitudes @ grown) + ramp + complex(ramped)

    def later(self, elapsed_s: float) -> "ExponentialSum":
        """Return the same signal with its origin `elapsed_s` later."""
        if not elapsed_s:
            return self
        moved = self.amplitudes * np.exp(self.exponents * elapsed_s)
        constant = self.constant + self.slope * elapsed_s
        if not self.turning:
            return ExponentialSum(constant, self.slope, moved, self.exponents)
        turning = self.turning * complex(np.exp(self.turn * elapsed_s))
        amplitudes, exponents = np.append(moved, turning * elapsed_s), np.append(self.exponents, self.turn)
        return ExponentialSum(constant, self.slope, amplitudes, exponents, turning, self.turn)

    def carried(self, turn: complex) -> "ExponentialSum":
        """Return this signal, which has no ramped exponential, times exp(turn t)."""
        amplitudes = np.append(self.amplitudes, self.constant)
        return ExponentialSum(0j, 0j, amplitudes, np.append(self.exponents, 0j) + turn, self.slope, turn)

    def swing(self) -> float:
        """Return a bound of how far the exponentials can move the signal, all of them decaying or turning."""
        return float(np.abs(self.amplitudes).sum())


def real_terms(terms: list[tuple[complex, complex]]) -> list[tuple[complex, complex]]:
    """Return terms (a, s) whose plain sum is the real part of the given ones' sum."""
    halves: list[tuple[complex, complex]] = []
    for amplitude, exponent in terms:
        if exponent.imag == 0:
            halves.append((complex(amplitude.real), exponent))
        else:
            halves += [(amplitude / 2, exponent), (amplitude.conjugate() / 2, exponent.conjugate())]
    return halves
