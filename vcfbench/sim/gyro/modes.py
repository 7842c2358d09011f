"""Second-order modes as exact complex envelopes.

A mode y'' + (w/Q) y' + w^2 y = Re(f e^{j th}) with th' = w_d has the analytic displacement D = Y e^{j th}, y = Re D,
and Y'' + (2 j w_d + w/Q) Y' + (w^2 - w_d^2 + j w w_d / Q) Y = f exactly: no slow-flow approximation. With the poles
p+- = -w/2Q +- j w', w' = w sqrt(1 - 1/4Q^2), it splits into two first-order parts q+-' = (p+- - j w_d) q+- + f, Y =
(q+ - q-) / (p+ - p-). The parts do not depend on w_d but for the turning frame, so a carrier whose frequency changes
needs no conversion.
"""

import cmath
import math
from functools import cached_property

from msgspec import Struct


class Resonance(Struct, frozen=True, dict=True):
    """A second-order mode: natural frequency in rad/s and quality factor (> 1/2)."""

    natural_rad_s: float
    quality: float

    @cached_property
    def poles(self) -> tuple[complex, complex]:
        """p+ and p-, 1/s."""
        damping = self.natural_rad_s / (2 * self.quality)
        ringing = self.natural_rad_s * math.sqrt(1 - 1 / (4 * self.quality**2))
        return complex(-damping, ringing), complex(-damping, -ringing)

    def displacement(self, parts: tuple[complex, complex]) -> complex:
        """Return the envelope Y of the displacement from its two parts."""
        plus, minus = self.poles
        return (parts[0] - parts[1]) / (plus - minus)

    def velocity(self, parts: tuple[complex, complex]) -> complex:
        """Return the envelope Y' + j w_d Y of the velocity from its two parts."""
        plus, minus = self.poles
        return (plus * parts[0] - minus * parts[1]) / (plus - minus)

    def parts(self, displacement: complex, velocity: complex) -> tuple[complex, complex]:
        """Return the two parts that make this displacement and velocity."""
        plus, minus = self.poles
        return velocity - minus * displacement, velocity - plus * displacement

    def step(
        self, parts: tuple[complex, complex], force: complex, drive_rad_s: float, duration_s: float
    ) -> tuple[complex, complex]:
        """Return the two parts after `duration_s` under a constant force envelope (force per mass, m/s^2)."""
        turning, (plus, minus) = 1j * drive_rad_s, self.poles
        rate, other = plus - turning, minus - turning
        steady, opposite = -force / rate, -force / other
        return (
            steady + (parts[0] - steady) * cmath.exp(rate * duration_s),
            opposite + (parts[1] - opposite) * cmath.exp(other * duration_s),
        )


def butterworth_poles(cut_off_rad_s: float, order: int) -> list[complex]:
    """Return the poles of a Butterworth low-pass filter, 1/s."""
    return [cut_off_rad_s * cmath.exp(1j * math.pi * (2 * k + order + 1) / (2 * order)) for k in range(order)]


def butterworth_residues(poles: list[complex]) -> list[complex]:
    """Return the residues r of H(s) = sum r / (s - p) with H(0) = 1."""
    gain = math.prod([-p for p in poles], start=1 + 0j)
    return [
        gain / math.prod([p - other for i, other in enumerate(poles) if i != k], start=1 + 0j)
        for k, p in enumerate(poles)
    ]
