"""Memoryless electronics: modulator, output amplifier, supply of the PCB."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from vcfbench.sim.parameters import OutputStage, Supply, VirtualPath

__all__ = ["Oscillation", "amplify", "modulate", "node_voltage", "output_limits", "rail_current_a"]


@dataclass(frozen=True, slots=True)
class Oscillation:
    """A constant and harmonics: `constant_v + Re sum a exp(j n w t)`, terms (a, j n w), t from its own origin."""

    constant_v: float
    terms: list[tuple[complex, complex]]

    def at(self, elapsed_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the voltage at times from its origin."""
        swung = ((a * np.exp(s * elapsed_s)).real for a, s in self.terms)
        return np.asarray(self.constant_v + sum(swung, start=np.zeros_like(elapsed_s)))

    def integral(self, duration_s: float) -> float:
        """Return the integral from its origin on, V s."""
        swung = sum((a * (np.exp(s * duration_s) - 1) / s).real for a, s in self.terms)
        return self.constant_v * duration_s + float(swung)


def node_voltage(open_circuit_v: float, source_ohm: float, path: VirtualPath) -> float:
    """Return what a source puts on the V_Vc input, loaded by the pull-down."""
    return open_circuit_v * path.pull_down_ohm / (path.pull_down_ohm + source_ohm)


def modulate(path: VirtualPath, node: Oscillation) -> Oscillation:
    """Return the modulator's multiplicand m(V) = V + offset + k2 V^2 + k3 V^3 of d + a sin(psi), switch closed.

    Powers of the sine are written out as harmonics, so a sine on V_Vc stays exact through the curvature.
    """
    d, second, third = node.constant_v, path.second_order_per_v, path.third_order_per_v2
    constant = path.offset_v + d + second * d**2 + third * d**3
    if not node.terms:
        return Oscillation(constant, [])
    turn, speed = node.terms[0]
    a = abs(turn)
    unit = turn / a  # -j e^{j psi0}: Re(unit e^{jwt}) = sin(psi)
    constant += second * a**2 / 2 + third * 1.5 * d * a**2
    first = a * (1 + 2 * second * d + third * (3 * d**2 + 0.75 * a**2))
    twice = a**2 * (second / 2 + 1.5 * third * d)  # -cos(2 psi) = Re(unit^2 e^{2jwt})
    thrice = third * a**3 / 4  # -sin(3 psi) = Re(unit^3 e^{3jwt})
    sizes = (first, twice, thrice)
    terms = [(size * unit ** (n + 1), speed * (n + 1)) for n, size in enumerate(sizes) if size]
    return Oscillation(constant, terms)


def amplify(stage: OutputStage, filtered_v: NDArray[np.float64], limits: tuple[float, float]) -> NDArray[np.float64]:
    """Return the output amplifier's voltage: gain, curvature, offset, saturation."""
    u = stage.gain * filtered_v
    curved = stage.offset_v + u * (1 + u * (stage.second_order_per_v + u * stage.third_order_per_v2))
    return np.asarray(np.clip(curved, *limits))


def output_limits(stage: OutputStage, positive_v: float, negative_v: float) -> tuple[float, float]:
    """Return where the output saturates, lowest and highest."""
    return min(negative_v + stage.headroom_v, 0.0), max(positive_v - stage.headroom_v, 0.0)


def rail_current_a(supply: Supply, voltage_v: float, starting: float) -> float:
    """Return a rail's current: resistive below brown-out, constant above, more while `starting` (0 to 1)."""
    powered = min(1.0, abs(voltage_v) / supply.brown_out_v)
    extra = supply.start_up_a * starting if math.isclose(powered, 1.0) else 0.0
    return supply.quiescent_a * powered + extra
