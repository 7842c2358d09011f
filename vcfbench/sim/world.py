"""The one physical world that all simulated instruments look at.

Nobody steps it: whoever is asked something takes it to `clock.now()` first, over whatever interval has passed.
Propagation stops at events and at the edges of registered windows and captures only, so an hour of waiting costs what
a second does.
"""

from collections.abc import Hashable, Iterator
from copy import copy
from functools import partial

import numpy as np
from msgspec.structs import asdict, replace
from simrack.adding import added
from simrack.adjustment import Adjustment
from simrack.flutter import Flutter
from simrack.loads import Loaded
from simrack.motion import TableMotion
from simrack.sources import Approach, Drive, Played, Ripple
from simrack.world import LeadsOfRole

from vcfbench.clock import Clock
from vcfbench.sim.gyro.gyro import Gyro
from vcfbench.sim.gyro.stretch import Stretch
from vcfbench.sim.mains import Mains
from vcfbench.sim.parameters import BenchParameters, Contradiction

RAILS = ("positive", "negative")
NODES = ("output", "v_vc", "drive", "carrier", "sense", "rail_positive", "rail_negative")
UP_AXES = {
    sign + axis: tuple(float(f"{sign}1") if each == axis else 0.0 for each in "xyz") for axis in "xyz" for sign in "+-"
}
"""Directions of the case's axes, by name."""
INPUTS = ("v_vc", "vibration")
"""Where generators are connected: what is put on the second is added to what is on the first."""


class World(Loaded):
    """Gyro, PCB, table, rails and wiring at bench time; the module's docstring explains the passing of time."""

    device = "gyroscope"
    nodes = NODES
    rails = RAILS
    inputs = INPUTS

    def __init__(self, clock: Clock, parameters: BenchParameters, seed: int, beside: "World | None" = None) -> None:
        super().__init__(clock, {name.removesuffix("_ohm"): ohm for name, ohm in asdict(parameters.source).items()})
        self.parameters = parameters
        self._beside: list[World] = []
        """The gyroscopes beside this one on the same table."""
        if beside is None:
            flutter = Flutter.of(parameters.table, seed)
            self.table = TableMotion(clock, parameters.table, self._all_advance, flutter)
        else:
            self.table = beside.table
            beside.join(self)
        self._gyro = Gyro(parameters, seed, self.reached_s)
        self.mains = Mains.drawn(parameters.pick_up, seed)
        """What the leads catch of the mains."""
        self.leads: dict[str, LeadsOfRole] = {}
        """The leads of what looks at the World, by role."""
        self._rails = dict.fromkeys(RAILS, Approach(0.0))
        self._generators: dict[str, Drive | Played | None] = dict.fromkeys(INPUTS)
        self._v_vc_source: Drive | Played | None = None
        self._imagined: Gyro | None = None

    def join(self, other: "World") -> None:
        """Take another gyroscope onto the table: before each of its motions it is taken to now too."""
        self._beside.append(other)

    def _all_advance(self) -> None:
        for each in (self, *self._beside):
            each.advance()

    def reach(self, instant_s: float) -> bool:
        """Take the world to an instant if it has not been there; return True if it lies in the past."""
        past = super().reach(instant_s)
        self._imagined = None if past else self._imagined
        return past

    def _pass_events(self) -> None:
        """Take the world past all that has happened by now; between events nothing needs to be worked out."""
        self._imagined, now = None, self.clock.now()
        while (due := self._next_event_s()) <= now:
            self._step(due)

    def _next_event_s(self) -> float:
        return min(self.table.segment(self._gyro.now_s).stop_s, self._gyro.next_event_s())

    def _go(self, stop_s: float, *, seen: bool) -> Stretch | None:
        rate = self.table.segment(self._gyro.now_s)
        if seen:
            return self._loaded(self._gyro.propagate(rate, stop_s))
        self._gyro.go(rate, stop_s)
        return None

    def _loaded(self, stretch: Stretch) -> Stretch:
        shares = self._loads.shares
        return replace(stretch, shares=shares) if shares else stretch

    def move_rail(self, rail: str, approach: Approach) -> None:
        """Change the voltage on a supply pin along a given course from now on, signed.

        A pin of the wrong polarity counts as 0 V: the PCB's protection diodes block it.
        """
        self._require(rail, RAILS)
        for each in self._beside:
            each.move_rail(rail, approach)
        self.advance()
        self._rails[rail] = approach
        if self.parameters.supply.single:  # its circuit goes by the one rail as others by the weaker of two
            terms = tuple((-size, tau_s) for size, tau_s in approach.terms)
            self._rails["negative"] = Approach(-approach.goal_v, approach.origin_s, terms)
        self._gyro.set_rails(self._rails["positive"], self._rails["negative"])

    def set_ripple(self, rail: str, ripple: Ripple | None) -> None:
        """Put a ripple on a supply pin from now on while it has a voltage, or none."""
        self._require(rail, RAILS)
        self.advance()
        self._gyro.set_ripple(RAILS.index(rail), ripple)

    def rail_current_a(self, rail: str, voltage_v: float) -> float:
        """Return the magnitude of the current that PCB and load would draw from `rail` now at `voltage_v`, A."""
        self._require(rail, RAILS)
        self._pass_events()
        beside_a = sum(each.rail_current_a(rail, voltage_v) for each in self._beside)
        return self._drawn_a(self._gyro, rail, voltage_v, self.clock.now()) + beside_a

    def _drawn_a(self, gyro: Gyro, rail: str, voltage_v: float, now_s: float) -> float:
        own_a = gyro.rail_current_a(RAILS.index(rail), voltage_v, now_s)
        return own_a + abs(voltage_v) * self._loads.conductance_s(f"rail_{rail}")

    def drawing(self) -> Hashable:
        """Return a key of the rails' currents: while it is equal, so are they; None while they change."""
        self._pass_events()
        return self._gyro.drawing()

    def load_node(self, who: Hashable, node: str, resistance_ohm: float) -> None:
        """Add a resistance from `node` to ground, as :class:`simrack.loads.Loaded` does.

        The PCB's outputs divide with their own resistance, V_Vc with the generator's; a rail has to supply it.
        """
        super().load_node(who, node, resistance_ohm)
        self._gyro.connect_v_vc(self._loads.behind("v_vc", self._v_vc_source))

    def source_ohm(self, node: str) -> float:
        """Return the resistance behind a node now, ohm; a PCB without power counts as one with it, its rails apart."""
        self._require(node, NODES)
        rail = node.removeprefix("rail_")
        if rail in RAILS and not self._rails[rail].at(self.clock.now()):  # no supply holds it
            return self._loads.presented_ohm(node, self.parameters.supply.input_ohm)
        if node != "v_vc":
            return self._loads.presented_ohm(node)
        pull_down, source = self.parameters.virtual_path.pull_down_ohm, self._v_vc_source
        own = pull_down if source is None else pull_down * source.source_ohm / (pull_down + source.source_ohm)
        return self._loads.presented_ohm(node, own)

    def ambient_c(self) -> float:
        """Return the temperature around the gyroscope, degC."""
        return self._gyro.ambient_c

    def set_ambient_c(self, ambient_c: float) -> None:
        """Change the temperature around the gyroscope from now on; it follows with its time constant.

        Raises:
            ValueError: it is outside -55 to 125 degC, or the modes would not oscillate there.
        """
        for each in (self, *self._beside):
            each.warm(ambient_c)

    def warm(self, ambient_c: float) -> None:
        """Change the temperature around this gyroscope alone."""
        self.advance()
        self._gyro.set_ambient_c(ambient_c)

    def temperature_c(self) -> float:
        """Return the temperature of the gyroscope now, degC."""
        self.advance()
        return self._gyro.temperature_c()

    def up_axis(self) -> str:
        """Return the axis of the case that points up, the nearest one."""
        return max(UP_AXES, key=lambda name: sum(a * b for a, b in zip(UP_AXES[name], self._gyro.up, strict=True)))

    def set_up_axis(self, name: str) -> None:
        """Turn the case at once so that an axis points up; ValueError: it has none of that name."""
        if name not in UP_AXES:
            raise ValueError(f"up is one of {', '.join(UP_AXES)}, not {name!r}")
        for each in self._beside:
            each.set_up_axis(name)
        self.advance()
        self._gyro.set_up(UP_AXES[name])

    def drive(self, node: str, source: Drive | Played | None) -> None:
        """Connect a generator to the V_Vc input ("v_vc") from now on, or None; a second one to "vibration".

        None is a generator whose relay is open: the pull-down holds the node at 0 V and the carrier switch opens, so
        that the modulator's leakage does not reach the combs. What the second puts out is added to the first's.

        Raises:
            Contradiction: the gyroscope has a dead band, and the source is no level.
        """
        self._require(node, INPUTS)
        level = source is None or (isinstance(source, Drive) and not (source.amplitude_v or source.overtones))
        if not level and (half_deg_s := self.parameters.sense_path.dead_band_deg_s):
            raise Contradiction(f"no sense_path.dead_band_deg_s where {node} gets more than a level", half_deg_s)
        self.advance()
        self._generators[node] = source
        both = added(self._generators["v_vc"], self._generators["vibration"])
        self._v_vc_source = self.mains.through_v_vc_lead(both)
        self._gyro.connect_v_vc(self._loads.behind("v_vc", self._v_vc_source))

    def value_v(self, node: str) -> float:
        """Return a node's voltage now."""
        self._require(node, NODES)
        self.advance()
        now = self._gyro.now_s
        look = self._loaded(self._gyro.look(self.table.segment(now), now))
        return float(look.at(node, np.array([now]))[0])

    def glance_v(self, node: str) -> float:
        """Return the present voltage of a node for display; the look changes nothing in the simulation.

        An instrument that asks takes the world to now, and ends a step of the noise. A glance goes on from the last
        such step with noise of its own, glance after glance, until an instrument asks: what readings see later stays.
        """
        self._require(node, NODES)
        now, gyro = self.clock.now(), self._glanced_at()
        look = self._loaded(gyro.look(self.table.segment(now), now))
        return float(look.at(node, np.array([now]))[0])

    def glance_current_a(self, rail: str) -> float:
        """Return the magnitude of the current that PCB and load draw from `rail` now, A; it leaves no mark."""
        self._require(rail, RAILS)
        voltage_v, gyro = self.glance_v(f"rail_{rail}"), self._glanced_at()
        return self._drawn_a(gyro, rail, voltage_v, gyro.now_s)

    def glance_temperature_c(self) -> float:
        """Return the temperature of the gyroscope now, degC; it leaves no mark."""
        return self._glanced_at().temperature_c()

    def _glanced_at(self) -> Gyro:
        """Return the gyro at now as it may be."""
        gyro, now = self._imagined or self._gyro.imagined(), self.clock.now()
        while gyro.now_s < now:
            rate = self.table.segment(gyro.now_s)
            gyro.propagate(rate, min(now, rate.stop_s, gyro.next_event_s()))
        self._imagined = gyro
        return gyro

    def adjustments(self) -> Iterator[Adjustment]:
        """Yield the direction of up, which can be changed, and the physical parameters, which cannot."""
        meaning = "axis of the case that points up, +x to -z; z is the input axis, and points east while it is level"
        yield Adjustment("up_axis", "", meaning, self.up_axis, self.set_up_axis)
        for row in self.parameters.rows():
            yield Adjustment(f"parameter.{row.path}", row.unit, row.meaning, partial(copy, row.value))
