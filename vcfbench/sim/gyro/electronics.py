"""Memoryless electronics: modulator, output amplifier, supply of the PCB."""

from __future__ import annotations

import cmath
import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from vcfbench.sim.parameters import OutputStage, Supply, VirtualPath
    from vcfbench.sim.sources import Drive, Sine

__all__ = ["Oscillation", "amplify", "modulate", "node_voltage", "output_limits", "rail_current_a", "source_voltage"]

FORGOTTEN = 1e-9
"""Part of the largest below which a product of sines is left out."""


@dataclass(frozen=True, slots=True)
class Oscillation:
    """A constant and sines: `constant_v + Re sum a exp(j w t)`, terms (a, j w), t from its own origin."""

    constant_v: float
    terms: list[tuple[complex, complex]]

    def later(self, elapsed_s: float) -> Oscillation:
        """Return the same from `elapsed_s` after its origin on."""
        if not self.terms:
            return self
        return Oscillation(self.constant_v, [(a * cmath.exp(s * elapsed_s), s) for a, s in self.terms])

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


def source_voltage(source: Drive, path: VirtualPath) -> Oscillation:
    """Return what a generator puts on the V_Vc input; its origin is bench time 0."""
    loaded = node_voltage(1.0, source.source_ohm, path)
    constant, terms = source.dc_v * loaded, list[tuple[complex, complex]]()
    sines: tuple[Drive | Sine, ...] = (source, *source.overtones)
    for sine in sines:
        size = -1j * cmath.rect(sine.amplitude_v * loaded, sine.phase_rad)
        if sine.frequency_hz == 0:
            constant += size.real
        elif size:
            terms.append((size, 2j * math.pi * sine.frequency_hz))
    return Oscillation(constant, terms)


def modulate(path: VirtualPath, node: Oscillation) -> Oscillation:
    """Return the modulator's multiplicand m(V) = V + offset + k2 V^2 + k3 V^3, switch closed.

    Powers of one sine are written out as harmonics, those of several as products, so that sines on V_Vc stay exact
    through the curvature.
    """
    if len(node.terms) > 1:
        return _modulate_several(path, node)
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


def _modulate_several(path: VirtualPath, node: Oscillation) -> Oscillation:
    once = _two_sided(node)
    squared = _product(once, once)
    parts = ((1.0, once), (path.second_order_per_v, squared), (path.third_order_per_v2, _product(squared, once)))
    total: dict[float, complex] = {0.0: complex(path.offset_v)}
    for factor, spectrum in parts:
        for speed, size in spectrum.items():
            total[speed] = total.get(speed, 0j) + factor * size
    least = FORGOTTEN * max(abs(size) for size in total.values())
    terms = [(2 * size, 1j * speed) for speed, size in total.items() if speed > 0 and abs(size) > least]
    return Oscillation(total[0.0].real, terms)


def _two_sided(signal: Oscillation) -> dict[float, complex]:
    """Return the complex size of each angular frequency, negative ones too."""
    spectrum: dict[float, complex] = {0.0: complex(signal.constant_v)}
    for size, exponent in signal.terms:
        for speed, half in ((exponent.imag, size / 2), (-exponent.imag, size.conjugate() / 2)):
            _add(spectrum, speed, half)
    return spectrum


def _product(one: dict[float, complex], other: dict[float, complex]) -> dict[float, complex]:
    product: dict[float, complex] = {}
    for (first, a), (second, b) in itertools.product(one.items(), other.items()):
        _add(product, first + second, a * b)
    return product


def _add(spectrum: dict[float, complex], speed: float, size: complex) -> None:
    """Add to a frequency; sums that differ by rounding alone are one."""
    same = round(speed, 6) + 0.0
    spectrum[same] = spectrum.get(same, 0j) + size


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
