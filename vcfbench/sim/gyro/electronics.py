"""Memoryless electronics: modulator, output amplifier, supply of the PCB."""

import cmath
import itertools
import math
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray
from simrack.oscillation import Oscillation
from simrack.sources import Approach, Bend, Drive, Piece, Played, Ripple, Sine

from vcfbench.sim.parameters import OutputStage, Supply, VirtualPath

_Volts = TypeVar("_Volts", float, "NDArray[np.float64]")

FORGOTTEN = 1e-9
"""Part of the largest below which a product of sines is left out."""


class Pin(Struct, frozen=True):
    """A supply pin: its voltage and its ripple; `sign` is the polarity that the PCB takes.

    Of the other polarity it counts as 0 V: the protection diodes block it.
    """

    sign: float
    approach: Approach
    ripple: Ripple | None = None

    def smooth_v(self, instant_s: float) -> float:
        """Return the voltage at a bench time without the ripple."""
        return self.sign * max(self.sign * self.approach.at(instant_s), 0.0)

    def smooth(self, now_s: float) -> Oscillation:
        """Return the voltage from `now_s` on without the ripple."""
        if not self.smooth_v(now_s):
            return Oscillation(0.0, [])
        on_its_way = self.approach.later(now_s)
        return Oscillation(on_its_way.goal_v, [(complex(size), complex(-1 / tau)) for size, tau in on_its_way.terms])

    def voltage(self, now_s: float) -> Oscillation:
        """Return the voltage from `now_s` on."""
        smooth, rippling = self.smooth(now_s), self.rippling(now_s)
        beside = self.ripple.beside if rippling and self.ripple is not None else ()
        more = ((each, 2 * math.pi * each.frequency_hz) for each in beside)
        noisy = [
            (-1j * cmath.rect(each.amplitude_v, speed * now_s + each.phase_rad), 1j * speed) for each, speed in more
        ]
        return Oscillation(smooth.constant_v, [*smooth.terms, *rippling, *noisy])

    def rippling(self, now_s: float) -> list[tuple[complex, complex]]:
        """Return the ripple alone, from `now_s` on; none without a voltage."""
        ripple = self.ripple
        if ripple is None or not self.smooth_v(now_s):
            return []
        speed = 2 * math.pi * ripple.frequency_hz
        return [(cmath.rect(math.sqrt(2) * ripple.rms_v, speed * now_s + ripple.phase_rad), 1j * speed)]


class PlayedVoltage(Struct, frozen=True):
    """V_Vc of a playing source from `start_s` on: its exact course in pictures, its pieces in means."""

    source: Played
    share: float
    start_s: float

    def later(self, elapsed_s: float) -> "PlayedVoltage":
        """Return the same from `elapsed_s` after its origin on."""
        return replace(self, start_s=self.start_s + elapsed_s)

    def at(self, elapsed_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the voltage at times from its origin."""
        return np.asarray(self.share * self.source.at(self.start_s + elapsed_s))

    def integral(self, duration_s: float) -> float:
        """Return the integral from its origin on, V s."""
        total, reached, stop = 0.0, self.start_s, self.start_s + duration_s
        while reached < stop:
            piece = self.source.piece(reached, (0.0, self.share, 0.0, 0.0))
            end = min(stop, piece.stop_s)
            total += _written(piece).integral(end - reached)
            reached = end
        return total


class Passage(Struct, frozen=True):
    """V_Vc and the modulator's output, from `origin_s` to `stop_s`."""

    origin_s: float
    stop_s: float
    v_vc: Oscillation | PlayedVoltage
    multiplicand: Oscillation

    def voltage(self, now_s: float) -> Oscillation | PlayedVoltage:
        """Return V_Vc from `now_s` on."""
        return self.v_vc.later(now_s - self.origin_s)

    def modulated(self, now_s: float) -> Oscillation:
        """Return the multiplicand from `now_s` on."""
        return self.multiplicand.later(now_s - self.origin_s)


def passage(source: Drive | Played | None, path: VirtualPath, now_s: float) -> Passage:
    """Return the voltages of `source` from `now_s` on; None leaves the input to the pull-down, the switch open."""
    if source is None:  # an open switch lets nothing through, not even the modulator's leakage
        nothing = Oscillation(0.0, [])
        return Passage(0.0, math.inf, nothing, nothing)
    share = path.pull_down_ohm / (path.pull_down_ohm + source.source_ohm)
    if isinstance(source, Drive):  # its origin is bench time 0
        constant, terms = source.dc_v * share, list[tuple[complex, complex]]()
        sines: tuple[Drive | Sine, ...] = (source, *source.overtones)
        for sine in sines:
            size = -1j * cmath.rect(sine.amplitude_v * share, sine.phase_rad)
            if sine.frequency_hz == 0:
                constant += size.real
            elif size:
                terms.append((size, 2j * math.pi * sine.frequency_hz))
        node = Oscillation(constant, terms)
        return Passage(0.0, math.inf, node, modulate(path, node))
    bend: Bend = (path.offset_v, share, path.second_order_per_v * share**2, path.third_order_per_v2 * share**3)
    piece = source.piece(now_s, bend)
    return Passage(now_s, piece.stop_s, PlayedVoltage(source, share, now_s), _written(piece))


def _written(piece: Piece) -> Oscillation:
    return Oscillation(piece.constant, list(piece.terms), piece.slope_per_s)


def modulate(path: VirtualPath, node: Oscillation) -> Oscillation:
    """Return the modulator's multiplicand m(V) = V + offset + k2 V^2 + k3 V^3, switch closed.

    Powers of one sine are written out as harmonics, those of several as products, so that sines on V_Vc stay exact
    through the curvature.
    """
    if len(node.terms) > 1:
        once: dict[float, complex] = {0.0: complex(node.constant_v)}
        for size, exponent in node.terms:  # the complex size of each angular frequency, negative ones too
            _add(once, exponent.imag, size / 2)
            _add(once, -exponent.imag, size.conjugate() / 2)
        squared = _product(once, once)
        parts = ((1.0, once), (path.second_order_per_v, squared), (path.third_order_per_v2, _product(squared, once)))
        total: dict[float, complex] = {0.0: complex(path.offset_v)}
        for factor, spectrum in parts:
            for omega, part in spectrum.items():
                total[omega] = total.get(omega, 0j) + factor * part
        least = FORGOTTEN * max(map(abs, total.values()))
        terms = [(2 * part, 1j * omega) for omega, part in total.items() if omega > 0 and abs(part) > least]
        return Oscillation(total[0.0].real, terms)
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


def _product(one: dict[float, complex], other: dict[float, complex]) -> dict[float, complex]:
    product: dict[float, complex] = {}
    for (first, a), (second, b) in itertools.product(one.items(), other.items()):
        _add(product, first + second, a * b)
    return product


def _add(spectrum: dict[float, complex], speed: float, size: complex) -> None:
    """Add to a frequency; sums that differ by rounding alone are one."""
    same = round(speed, 6) + 0.0
    spectrum[same] = spectrum.get(same, 0j) + size


def amplify(
    stage: OutputStage,
    filtered_v: NDArray[np.float64],
    limits: tuple[float | NDArray[np.float64], float | NDArray[np.float64]],
) -> NDArray[np.float64]:
    """Return the output amplifier's voltage: gain, curvature, offset, saturation."""
    return np.asarray(np.clip(curved(stage, filtered_v), *limits))


def curved(stage: OutputStage, filtered_v: _Volts) -> _Volts:
    """Return the output amplifier's voltage far from its limits: gain, curvature, offset."""
    u, (*lower, before, highest) = stage.gain * filtered_v, stage.orders
    output_v = highest * u + before
    for order in reversed(lower):
        output_v = output_v * u + order
    return output_v


class OutputLimits(Struct, frozen=True):
    """Levels at which the output saturates on its rails; times from the origin of both, ripple left out."""

    stage: OutputStage
    positive: Oscillation
    negative: Oscillation
    single: bool = False
    """True of a PCB with one supply, whose output ends at ground."""

    @property
    def moving(self) -> bool:
        """Return True if a rail moves."""
        return bool(self.positive.terms or self.negative.terms)

    def at(self, elapsed_s: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return lowest and highest voltage at times."""
        headroom = self.stage.headroom_v
        high = np.maximum(self.positive.at(elapsed_s) - headroom, 0.0)
        if self.single:
            return np.minimum(high, headroom), high
        return np.minimum(self.negative.at(elapsed_s) + headroom, 0.0), high

    def tightest(self, duration_s: float) -> tuple[float, float]:
        """Return limits that hold over all of a time."""
        positive = self.positive.constant_v + _bound(self.positive, duration_s, min)
        negative = self.negative.constant_v + _bound(self.negative, duration_s, max)
        high_v = max(positive - self.stage.headroom_v, 0.0)
        return (self.stage.headroom_v if self.single else min(negative + self.stage.headroom_v, 0.0)), high_v

    def cuts_s(self, duration_s: float) -> set[float]:
        """Return times between which the limits are smooth, by the exponentials' time constants."""
        speeds = {abs(exponent) for rail in (self.positive, self.negative) for _, exponent in rail.terms}
        return {cut for speed in speeds for cut in (1.0 / speed, 4.0 / speed, 16.0 / speed) if cut < duration_s}


def _bound(rail: Oscillation, duration_s: float, pick: Callable[[float, float], float]) -> float:
    """Return a bound of the sum of a rail's exponentials within a time."""
    return sum(pick(size.real, size.real * math.exp(exponent.real * duration_s)) for size, exponent in rail.terms)


def rail_current_a(supply: Supply, voltage_v: float, starting: float) -> float:
    """Return a rail's current: resistive below brown-out, constant above, more while `starting` (0 to 1)."""
    powered = min(1.0, abs(voltage_v) / supply.brown_out_v)
    extra = supply.start_up_a * starting if math.isclose(powered, 1.0) else 0.0
    return supply.quiescent_a * powered + extra
