"""A World of wires: nodes by name that generators feed, circuits between them, rails that supplies feed.

A circuit is a device under test of your own: what it lets through of each frequency. Unless more is said there are
`input` and `output`, and a circuit or a wire between them. What changes at the input of a circuit has settled at its
output at once; sources feel the loads on their nodes.
"""

from __future__ import annotations

import cmath
import math
from abc import ABC, abstractmethod
from collections.abc import Hashable, Iterable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec import Struct

from simrack.adjustment import Adjustment, number
from simrack.clock import Clock
from simrack.loads import Loaded
from simrack.motion import TableMotion
from simrack.oscillation import Oscillation
from simrack.sources import Approach, Drive, Played, Ripple, Sine
from simrack.world import LeadsOfRole

if TYPE_CHECKING:
    from numpy.typing import NDArray

RAILS = ("positive", "negative")
_MOST_POINTS = 1 << 18
_LOOKS = 1 << 16
"""Points of an average of what a circuit makes of a waveform."""
_ROOM_C = 23.0


class Circuit(ABC):
    """A device under test between two nodes, `input` and `output` unless a bench file names others."""

    name = "circuit"
    output_ohm = 0.0
    """Its resistance as whoever loads `output` feels it."""
    memory_s = 0.0
    """How long it remembers what was at its input."""

    @abstractmethod
    def transfer(self, frequency_hz: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return output over input at each frequency, in the shape of `frequency_hz`."""

    def current_a(self, rail: str, voltage_v: float) -> float:
        """Return the magnitude of its current from a rail, "positive" or "negative", at a voltage, A: nothing."""
        del rail, voltage_v
        return 0.0


class Mechanics(Struct, frozen=True):
    """A table without errors: a loop of 25 Hz, no ripple, no flutter."""

    loop_hz: float = 25.0
    loop_damping: float = 0.7
    rate_error: float = 0.0
    ripple_arcsec: tuple[float, ...] = ()
    ripple_harmonic: tuple[int, ...] = ()
    ripple_phase_rad: tuple[float, ...] = ()
    flutter_per_sqrt_hz: float = 0.0
    friction_deg_s2: float = 10.0
    friction_time_s: float = 5.0


class _Filtered(Struct, frozen=True):
    """A playing source behind a circuit."""

    circuit: Circuit
    source: Played
    share: float = 1.0

    def at(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return its volts at bench times, by the spectrum of its input over as long before as it remembers."""
        begin, end = float(times_s.min()) - self.circuit.memory_s, float(times_s.max())
        step = max((end - begin) / _MOST_POINTS, min(1e-6, (end - begin) / 1024)) or 1e-6
        grid = np.asarray(begin + step * np.arange(math.ceil((end - begin) / step) + 2), dtype=np.float64)
        frequencies = np.asarray(np.fft.rfftfreq(len(grid), step), dtype=np.float64)
        passed = np.asarray(np.fft.rfft(self.source.at(grid))) * self.circuit.transfer(frequencies)
        return self.share * np.interp(times_s, grid, np.fft.irfft(passed, len(grid)))


class _Rail(Struct, frozen=True):
    approach: Approach
    ripple: Ripple | None = None

    def sine(self) -> Sine | None:
        """Return the ripple, while there is a voltage to ripple."""
        if self.ripple is None or not self.approach.goal_v:
            return None
        return Sine(math.sqrt(2.0) * self.ripple.rms_v, self.ripple.frequency_hz, self.ripple.phase_rad)

    def at(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return its volts at bench times."""
        moving = [size * np.exp((self.approach.origin_s - times_s) / tau) for size, tau in self.approach.terms]
        sine = self.sine()
        return self.approach.goal_v + sum(moving, np.zeros_like(times_s)) + (0.0 if sine is None else sine.at(times_s))


_Signal = Drive | _Filtered | _Rail


class _Stretch(Struct, frozen=True):
    """Voltages of the nodes while nothing changes."""

    start_s: float
    stop_s: float
    signals: Mapping[str, _Signal | Played]

    def integral(self, node: str) -> float:
        """Return the integral of a node's voltage, V s."""
        signal, lasts = self.signals[node], self.stop_s - self.start_s
        known = self.closed_form(node)
        if known is not None:
            return known.integral(lasts)
        if isinstance(signal, _Rail):
            way = signal.approach.later(self.start_s)
            return way.goal_v * lasts - sum(size * tau * math.expm1(-lasts / tau) for size, tau in way.terms)
        if isinstance(signal, _Filtered):
            middles = self.start_s + lasts * (np.arange(_LOOKS) + 0.5) / _LOOKS
            return lasts * float(signal.at(middles).mean())
        edges = np.array([self.start_s, self.stop_s])
        return lasts * sum(float(part.means(edges)[0]) for part in signal.components())

    def at(self, node: str, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a node's voltage at absolute times."""
        return self.signals[node].at(times_s)

    def finest_s(self, node: str) -> float:
        """Return a time within which a cubic describes a node's voltage."""
        known = self.closed_form(node)
        return 0.0 if known is None else known.finest_s()

    def fed(self, node: str) -> bool:
        """Tell that every node's voltage may be as fast as its source."""
        return node in self.signals

    def closed_form(self, node: str) -> Oscillation | None:
        """Return the voltage of a node as sines, t from the start; None of signals that play or move."""
        signal = self.signals[node]
        if isinstance(signal, _Rail) and not signal.approach.terms:
            ripple = signal.sine()
            return _closed(signal.approach.goal_v, () if ripple is None else (ripple,), self.start_s)
        if not isinstance(signal, Drive):
            return None
        own = Sine(signal.amplitude_v, signal.frequency_hz, signal.phase_rad)
        return _closed(signal.dc_v, (own, *signal.overtones), self.start_s)

    def source(self, node: str) -> tuple[Played, float] | None:
        """Return the source that plays on a node."""
        signal = self.signals[node]
        return None if isinstance(signal, Drive | _Rail | _Filtered) else (signal, 1.0)


def _closed(constant_v: float, sines: tuple[Sine, ...], start_s: float) -> Oscillation:
    still = sum(each.value_v(0.0) for each in sines if not each.frequency_hz)
    terms = [
        (-1j * cmath.rect(each.amplitude_v, speed * start_s + each.phase_rad), 1j * speed)
        for each in sines
        if each.amplitude_v and (speed := math.tau * each.frequency_hz)
    ]
    return Oscillation(constant_v + still, terms)


class Through(Struct, frozen=True):
    """Source of the output of a circuit: the node at its input, and the circuit; None is a wire."""

    node: str
    circuit: Circuit | None = None


class WiredWorld(Loaded):
    """Nodes that sources, circuits and meters share; rails, a shaft, and air at room temperature.

    Args:
        clock: bench time.
        circuit: the device under test from `input` to `output`; None is a wire.
        links: circuits by the node at their output, instead of that one; each begins at a node that a generator feeds.
        inputs: further nodes that generators feed.
        rails: what supplies feed; each is a node `rail_NAME` too.

    Raises:
        ValueError: a circuit begins at the output of another, or two feed a node.
    """

    def __init__(
        self,
        clock: Clock,
        circuit: Circuit | None = None,
        *,
        links: Mapping[str, Through] | None = None,
        inputs: Iterable[str] = (),
        rails: tuple[str, ...] = RAILS,
    ) -> None:
        super().__init__(clock, {})
        self._links = {"output": Through("input", circuit)} if links is None else dict(links)
        self.rails = rails
        fed = tuple(dict.fromkeys((*(link.node for link in self._links.values()), *inputs)))
        self.inputs = fed if fed or rails else ("input",)  # there is a node that a free lead looks at
        self.nodes = (*self._links, *self.inputs, *(f"rail_{rail}" for rail in rails))
        if chained := {link.node for link in self._links.values()} & {*self._links}:
            raise ValueError(f"a circuit begins at {min(chained)!r}, which is the output of one")
        if fed_twice := {node for node in self.nodes if self.nodes.count(node) > 1}:
            raise ValueError(f"{min(fed_twice)!r} is the output of a circuit, and something else feeds it")
        names = [link.circuit.name for link in self._links.values() if link.circuit is not None]
        self.device = " and ".join(names) or "wire"
        self.leads: dict[str, LeadsOfRole] = {}
        self.table = TableMotion(clock, Mechanics(), self.advance)
        self._sources: dict[str, Drive | Played | None] = dict.fromkeys(self.inputs)
        self._rails = dict.fromkeys(rails, _Rail(Approach(0.0)))
        self._ambient_c = _ROOM_C

    def adjustments(self) -> Iterable[Adjustment]:
        """Return the loads on the nodes that are no rails, from outside the wires."""
        for node in (*self._links, *self.inputs):
            load = partial(self._load_on, node)
            meaning = "load to ground; null is none"
            yield Adjustment(f"node.{node}.load_ohm", "ohm", meaning, load, partial(self._put_load, node))

    def _load_on(self, node: str) -> float | None:
        ohm = self._loads.ohm_of(("load", node))
        return ohm if math.isfinite(ohm) else None

    def _put_load(self, node: str, ohm: Any) -> None:
        self.put_load(node, math.inf if ohm is None else number(ohm))

    def put_load(self, node: str, resistance_ohm: float) -> None:
        """Hang a load on a node, as a person does; inf takes it off.

        Raises:
            ValueError: the node is unknown, or the resistance is not above 0 ohm.
        """
        rail = node.removeprefix("rail_")
        if rail != node and rail in self.rails:
            self.set_load(rail, resistance_ohm)
        else:
            self.load_node(("load", node), node, resistance_ohm)

    def _go(self, stop_s: float, *, seen: bool) -> _Stretch | None:
        return self._stretch(self.reached_s, stop_s) if seen else None

    def _stretch(self, start_s: float, stop_s: float) -> _Stretch:
        fed = {node: Drive(0.0) if source is None else source for node, source in self._sources.items()}
        at = {node: self._loaded(node, source, source.source_ohm) for node, source in fed.items()}
        behind = {node: self._output(node, link, at[link.node]) for node, link in self._links.items()}
        rails = {f"rail_{name}": rail for name, rail in self._rails.items()}
        return _Stretch(start_s, stop_s, {**at, **behind, **rails})

    def _loaded(self, node: str, source: Drive | Played, ohm: float) -> Drive | Played:
        conductance = self._loads.conductance_s(node)
        return source.divided(1.0 / (1.0 + ohm * conductance)) if conductance else source

    def _output(self, node: str, link: Through, source: Drive | Played) -> _Signal | Played:
        if link.circuit is None:
            return self._loaded(node, source, source.source_ohm)
        share = 1.0 / (1.0 + link.circuit.output_ohm * self._loads.conductance_s(node))
        if isinstance(source, Drive):
            return _through(link.circuit, source).divided(share)
        return _Filtered(link.circuit, source, share)

    def drive(self, node: str, source: Drive | Played | None) -> None:
        """Connect a generator to an input from now on; None holds it at 0 V."""
        self._require(node, self.inputs)
        self.advance()
        self._sources[node] = source

    def move_rail(self, rail: str, approach: Approach) -> None:
        """Let the voltage on a rail go its way from now on."""
        self._change_rail(rail, _Rail(approach, self._rails[rail].ripple))

    def set_ripple(self, rail: str, ripple: Ripple | None) -> None:
        """Put a ripple on a rail from now on, or none."""
        self._change_rail(rail, _Rail(self._rails[rail].approach, ripple))

    def _change_rail(self, rail: str, changed: _Rail) -> None:
        self._require(rail, self.rails)
        self.advance()
        self._rails[rail] = changed

    def rail_current_a(self, rail: str, voltage_v: float) -> float:
        """Return the magnitude of the current that circuits and loads draw at a voltage, A."""
        circuits = (link.circuit for link in self._links.values() if link.circuit is not None)
        return sum(each.current_a(rail, voltage_v) for each in circuits) + abs(voltage_v) * self._loads.conductance_s(
            f"rail_{rail}"
        )

    def drawing(self) -> Hashable:
        """Return a key of the currents: the loads."""
        return tuple(self._loads.conductance_s(f"rail_{rail}") for rail in self.rails)

    def source_ohm(self, node: str) -> float:
        """Return the resistance behind a node, ohm."""
        self._require(node, self.nodes)
        if node.startswith("rail_"):
            return 0.0
        link = self._links.get(node)
        if link is not None and link.circuit is not None:
            return self._loads.presented_ohm(node, link.circuit.output_ohm)
        source = self._sources[node if link is None else link.node]
        return self._loads.presented_ohm(node, 0.0 if source is None else source.source_ohm)

    def ambient_c(self) -> float:
        """Return the temperature of the air, degC."""
        return self._ambient_c

    def set_ambient_c(self, ambient_c: float) -> None:
        """Change the temperature of the air; the circuit has it at once."""
        self._ambient_c = ambient_c

    def value_v(self, node: str) -> float:
        """Return a node's voltage now."""
        self._require(node, self.nodes)
        self.advance()
        return float(self._stretch(self.reached_s, self.reached_s).at(node, np.array([self.reached_s]))[0])

    def glance_v(self, node: str) -> float:
        """Return a node's voltage now."""
        return self.value_v(node)

    def glance_current_a(self, rail: str) -> float:
        """Return the magnitude of the current drawn from a rail now, A."""
        return self.rail_current_a(rail, self.value_v(f"rail_{rail}"))

    def glance_temperature_c(self) -> float:
        """Return the temperature of the circuit, degC."""
        return self._ambient_c


def _through(circuit: Circuit, source: Drive) -> Drive:
    """Return levels and sines behind a circuit."""
    own = Sine(source.amplitude_v, source.frequency_hz, source.phase_rad)
    sines = (own, *source.overtones)
    passed = circuit.transfer(np.array([0.0, *(each.frequency_hz for each in sines)]))
    first, *others = (
        Sine(each.amplitude_v * abs(gain), each.frequency_hz, each.phase_rad + cmath.phase(gain))
        for each, gain in zip(sines, map(complex, passed[1:]), strict=True)
    )
    dc_v = source.dc_v * float(passed[0].real)
    return Drive(
        dc_v,
        first.amplitude_v,
        first.frequency_hz,
        first.phase_rad,
        source_ohm=circuit.output_ohm,
        overtones=tuple(others),
    )
