"""The one physical world that all simulated instruments look at.

Nobody steps it: whoever is asked something takes it to `clock.now()` first, over whatever interval has passed.
Propagation stops at events and at the edges of registered windows and captures only, so an hour of waiting costs what
a second does.
"""

from __future__ import annotations

import bisect
import math
from typing import TYPE_CHECKING, Protocol

from msgspec.structs import replace

from vcfbench.sim.adding import added
from vcfbench.sim.flutter import Flutter
from vcfbench.sim.gyro.gyro import Gyro
from vcfbench.sim.loads import NodeLoads
from vcfbench.sim.mains import Mains
from vcfbench.sim.motion import TableMotion
from vcfbench.sim.sources import Approach
from vcfbench.sim.trace import Trace, piece_of

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable

    import numpy as np
    from numpy.typing import NDArray

    from vcfbench.clock import Clock
    from vcfbench.sim.gyro.stretch import Stretch
    from vcfbench.sim.parameters import BenchParameters
    from vcfbench.sim.sources import Drive, Played, Ripple
    from vcfbench.sim.trace import Piece

RAILS = ("positive", "negative")
NODES = ("output", "v_vc", "drive", "carrier", "sense", "rail_positive", "rail_negative")
EARLY_S = 1e-9


class LeadEnd(Protocol):
    """Where a lead goes."""

    @property
    def node(self) -> str | None:
        """The node of the PCB, None when it hangs free."""

    @property
    def reversed(self) -> bool:
        """Whether it is the wrong way round."""


class LeadsOfRole(Protocol):
    """What a person can do to the leads of one instrument; they look at the World, which only knows that there are."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """The names of the inputs."""

    def lead(self, name: str) -> LeadEnd:
        """Return where the lead of an input goes."""

    def connect(self, name: str, node: str | None) -> None:
        """Put the lead of input `name` on another node, or leave it free."""

    def turn(self, name: str, *, reversed_: bool) -> None:
        """Put the lead of input `name` on the right way round, or reversed."""


class Window:
    """An averaging window on a node."""

    __slots__ = ("_integral_v_s", "_world", "node", "start_s", "stop_s")

    def __init__(self, world: World, node: str, start_s: float, stop_s: float) -> None:
        self._world = world
        self._integral_v_s = 0.0
        self.node = node
        self.start_s = start_s
        self.stop_s = stop_s

    def mean_v(self) -> float:
        """Return the mean voltage over the window.

        Raises:
            RuntimeError: the window is not over yet.
        """
        if not self._world.reach(self.stop_s):
            raise RuntimeError("the averaging window is not over yet")
        return self._integral_v_s / (self.stop_s - self.start_s)

    def take(self, stretch: Stretch) -> None:
        """Add a stretch that lies within the window."""
        self._integral_v_s += stretch.integral(self.node)


class Capture:
    """A stretch of time whose waveforms can be looked at, at carrier level too."""

    __slots__ = ("_stretches", "_world", "start_s", "stop_s")

    def __init__(self, world: World, start_s: float, stop_s: float) -> None:
        self._world = world
        self._stretches: list[Stretch] = []
        self.start_s = start_s
        self.stop_s = stop_s

    def samples(self, node: str, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the node's volts at absolute times within the capture, in the shape of `times_s`.

        Raises:
            RuntimeError: the capture is not over yet.
        """
        import numpy as np  # noqa: PLC0415  (kept out of the import of the package)

        times = np.asarray(times_s, dtype=float)
        self._require_over(times)
        starts = [each.start_s for each in self._stretches]
        held = np.clip(np.searchsorted(starts, times, side="right") - 1, 0, None)
        volts = np.empty_like(times)
        for index in np.unique(held):
            volts[held == index] = self._stretches[index].at(node, times[held == index])
        return volts

    def finest_s(self, node: str) -> float:
        """Return a time in which a node's voltage bends so little that a cubic tells it, but where it jumps."""
        return min((each.finest_s(node) for each in self._stretches), default=math.inf)

    def fed(self, node: str) -> bool:
        """Tell whether a node's voltage is put on it from outside the PCB."""
        return all(each.fed(node) for each in self._stretches)

    def whole(self, start_s: float, stop_s: float) -> bool:
        """Tell whether nothing happened between two times that could make a node jump."""
        return sum(each.start_s < stop_s and each.stop_s > start_s for each in self._stretches) <= 1

    def pieces(self, node: str) -> list[Piece]:
        """Return what is known of a node up to now, oldest first."""
        self._world.advance()
        return [piece_of(stretch, node) for stretch in self._stretches]

    def take(self, stretch: Stretch) -> None:
        """Keep a stretch that lies within the capture."""
        self._stretches.append(stretch)

    def _require_over(self, times_s: NDArray[np.float64]) -> None:
        del times_s
        self._world.advance()
        if self._world.reached_s < self.stop_s:
            raise RuntimeError("the capture is not over yet")


class Recording(Capture):
    """A capture without an end: what has passed can be looked at already. It leaves no mark in the World's course."""

    __slots__ = ("_open",)

    def __init__(self, world: World, start_s: float) -> None:
        super().__init__(world, start_s, math.inf)
        self._open = True

    def forget(self, before_s: float) -> None:
        """Drop what was over before a time."""
        self._stretches = [each for each in self._stretches if each.stop_s > before_s]

    def close(self) -> None:
        """Keep what there is and take nothing more."""
        self._world.advance()
        self._world.dismiss(self)
        self._open = False

    def _require_over(self, times_s: NDArray[np.float64]) -> None:
        self._world.advance()
        if self._open and times_s.size and self._world.reached_s < times_s.max():
            raise RuntimeError("the recording has not come so far yet")


class World:
    """Gyro, PCB, table, rails and wiring at bench time; see the module's words on how time passes."""

    def __init__(self, clock: Clock, parameters: BenchParameters, seed: int) -> None:
        self.clock = clock
        self.parameters = parameters
        self.table = TableMotion(clock, parameters.table, self.advance, Flutter.of(parameters.table, seed))
        self._gyro = Gyro(parameters, seed, clock.now())
        self.mains = Mains.drawn(parameters.pick_up, seed)
        """What the leads catch of the mains."""
        self.leads: dict[str, LeadsOfRole] = {}
        """The leads of what looks at the World, by role."""
        self._rails = dict.fromkeys(RAILS, Approach(0.0))
        self._loads_ohm = dict.fromkeys(RAILS, math.inf)
        self._node_loads = NodeLoads(parameters.source)
        self._generators: dict[str, Drive | Played | None] = {"rate": None, "vibration": None}
        self._v_vc_source: Drive | Played | None = None
        self._imagined: Gyro | None = None
        self._on_load: list[Callable[[], None]] = []
        self._edges_s: list[float] = []
        self._observers: list[Window | Capture | Trace] = []

    @property
    def reached_s(self) -> float:
        """The bench time that the world was taken to."""
        return self._gyro.now_s

    def advance(self) -> None:
        """Take the world to `clock.now()`."""
        self.reach(self.clock.now())

    def reach(self, instant_s: float) -> bool:
        """Take the world to an instant if it has not been there; return whether it lies in the past."""
        if instant_s > self.clock.now():
            return False
        self._imagined = None
        while self._gyro.now_s < instant_s:
            self._step(instant_s)
        return True

    def _pass_events(self) -> None:
        """Take the world past all that has happened by now; between events nothing needs to be worked out."""
        self._imagined, now = None, self.clock.now()
        while (due := min(self.table.segment(self._gyro.now_s).stop_s, self._gyro.next_event_s())) <= now:
            self._step(due)

    def _step(self, target_s: float) -> None:
        now = self._gyro.now_s
        rate = self.table.segment(now)
        edge = self._edges_s[0] if self._edges_s else math.inf
        stop = min(target_s, rate.stop_s, self._gyro.next_event_s(), edge)
        looking = [each for each in self._observers if each.start_s <= now]
        if looking:
            stretch = self._loaded(self._gyro.propagate(rate, stop))
            for each in looking:
                each.take(stretch)
        else:
            self._gyro.go(rate, stop)
        if stop == edge:
            self._pass_edge(stop)

    def _loaded(self, stretch: Stretch) -> Stretch:
        shares = self._node_loads.shares
        return replace(stretch, shares=shares) if shares else stretch

    def _pass_edge(self, now_s: float) -> None:
        del self._edges_s[: bisect.bisect_right(self._edges_s, now_s)]
        self._observers = [each for each in self._observers if each.stop_s > now_s]

    def set_rail(self, rail: str, voltage_v: float) -> None:
        """Put a voltage on a supply pin from now on, signed: "positive" +10 V, "negative" -10 V.

        A pin of the wrong polarity counts as 0 V: the PCB's protection diodes block it.
        """
        self.move_rail(rail, Approach(voltage_v))

    def move_rail(self, rail: str, approach: Approach) -> None:
        """Let the voltage on a supply pin go its way from now on; signs and wrong polarity as of :meth:`set_rail`."""
        self._require(rail, RAILS)
        self.advance()
        self._rails[rail] = approach
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
        beside = 1.0 / self._loads_ohm[rail] + self._node_loads.conductance_s(f"rail_{rail}")
        own = self._gyro.rail_current_a(RAILS.index(rail), voltage_v, self.clock.now())
        return own + abs(voltage_v) * beside

    def drawing(self) -> Hashable:
        """Return what the currents of the rails go by now: while it is equal, so are they; None while they change."""
        self._pass_events()
        return self._gyro.drawing()

    def load_ohm(self, rail: str) -> float:
        """Return the load on `rail` beside the PCB, ohm; inf is none."""
        self._require(rail, RAILS)
        return self._loads_ohm[rail]

    def set_load(self, rail: str, resistance_ohm: float) -> None:
        """Put a load on `rail` beside the PCB, a fault for instance; inf takes it off.

        Raises:
            ValueError: it is not above 0 ohm.
        """
        self._require(rail, RAILS)
        if not resistance_ohm > 0.0:
            raise ValueError(f"a load has more than 0 ohm, not {resistance_ohm}")
        self.advance()
        self._loads_ohm[rail] = resistance_ohm
        self._regulate()

    def load_node(self, who: Hashable, node: str, resistance_ohm: float) -> None:
        """Hang a resistance on `node` from now on in place of what `who` had put anywhere; inf takes it off.

        The PCB's outputs divide with their own resistance, V_Vc with the generator's; a rail has to supply it.

        Raises:
            ValueError: the node is unknown, or the resistance is not above 0 ohm.
        """
        self._require(node, NODES)
        self.advance()
        self._node_loads.put(who, node, resistance_ohm)
        self._gyro.connect_v_vc(self._node_loads.behind(self._v_vc_source))
        self._regulate()

    def source_ohm(self, node: str) -> float:
        """Return the resistance behind a node now, ohm; a PCB without power counts as one with it."""
        self._require(node, NODES)
        if node != "v_vc":
            return self._node_loads.presented_ohm(node)
        pull_down, source = self.parameters.virtual_path.pull_down_ohm, self._v_vc_source
        own = pull_down if source is None else pull_down * source.source_ohm / (pull_down + source.source_ohm)
        return self._node_loads.presented_ohm(node, own)

    def _regulate(self) -> None:
        for regulate in self._on_load:
            regulate()

    def on_load(self, regulate: Callable[[], None]) -> None:
        """Have `regulate` called after each change of a load: a supply finds its working point anew at once."""
        self._on_load.append(regulate)

    def ambient_c(self) -> float:
        """Return the temperature around the gyroscope, degC."""
        return self._gyro.ambient_c

    def set_ambient_c(self, ambient_c: float) -> None:
        """Change the temperature around the gyroscope from now on; it follows with its time constant.

        Raises:
            ValueError: it is outside -55 to 125 degC, or the modes would not oscillate there.
        """
        self.advance()
        self._gyro.set_ambient_c(ambient_c)

    def temperature_c(self) -> float:
        """Return the temperature of the gyroscope now, degC."""
        self.advance()
        return self._gyro.temperature_c()

    def drive_v_vc(self, source: Drive | Played | None) -> None:
        """Connect a generator to the V_Vc input from now on, or None.

        None is a generator whose relay is open: the pull-down holds the node at 0 V and the carrier switch opens, so
        that the modulator's leakage does not reach the combs.
        """
        self._connect("rate", source)

    def drive_vibration(self, source: Drive | Played | None) -> None:
        """Connect a second generator from now on, or None: its voltage is added to what the first puts on V_Vc."""
        self._connect("vibration", source)

    def _connect(self, generator: str, source: Drive | Played | None) -> None:
        self.advance()
        self._generators[generator] = source
        both = added(self._generators["rate"], self._generators["vibration"])
        self._v_vc_source = self.mains.through_v_vc_lead(both)
        self._gyro.connect_v_vc(self._node_loads.behind(self._v_vc_source))

    def window(self, node: str, start_s: float, stop_s: float) -> Window:
        """Register an averaging window that begins now or later.

        Raises:
            ValueError: it begins in the past, does not last, or the node is unknown.
        """
        self._require(node, NODES)
        start_s = self._coming(start_s, stop_s)
        window = Window(self, node, start_s, stop_s)
        self._observe(window)
        return window

    def capture(self, start_s: float, stop_s: float) -> Capture:
        """Register a stretch of time that begins now or later, whose waveforms will be asked for.

        Raises:
            ValueError: it begins in the past or does not last.
        """
        start_s = self._coming(start_s, stop_s)
        capture = Capture(self, start_s, stop_s)
        self._observe(capture)
        return capture

    def record(self) -> Recording:
        """Keep all that happens from now on, until the recording is closed."""
        self.advance()
        recording = Recording(self, self._gyro.now_s)
        self._observers.append(recording)
        return recording

    def trace(self, span_s: float) -> Trace:
        """Keep the last `span_s` of every node from now on, until the trace is ended."""
        self.advance()
        trace = Trace(self._gyro.now_s, span_s, self.advance, self.dismiss)
        self._observers.append(trace)
        return trace

    def value_v(self, node: str) -> float:
        """Return a node's voltage now."""
        import numpy as np  # noqa: PLC0415  (kept out of the import of the package)

        self._require(node, NODES)
        self.advance()
        now = self._gyro.now_s
        look = self._loaded(self._gyro.look(self.table.segment(now), now))
        return float(look.at(node, np.array([now]))[0])

    def glance_v(self, node: str) -> float:
        """Return what a node's voltage may be now, for who looks from outside the bench; it leaves no mark.

        An instrument that asks takes the world to now, and ends a step of the noise. A glance goes on from the last
        such step with noise of its own, glance after glance, until an instrument asks: what readings see later stays.
        """
        self._require(node, NODES)
        now, gyro = self.clock.now(), self._glanced_at()
        look = self._loaded(gyro.look(self.table.segment(now), now))
        import numpy as np  # noqa: PLC0415  (kept out of the import of the package)

        return float(look.at(node, np.array([now]))[0])

    def glance_current_a(self, rail: str) -> float:
        """Return the magnitude of the current that PCB and load draw from `rail` now, A; it leaves no mark."""
        self._require(rail, RAILS)
        voltage_v = self.glance_v(f"rail_{rail}")
        beside = 1.0 / self._loads_ohm[rail] + self._node_loads.conductance_s(f"rail_{rail}")
        gyro = self._glanced_at()
        return gyro.rail_current_a(RAILS.index(rail), voltage_v, gyro.now_s) + abs(voltage_v) * beside

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

    def _coming(self, start_s: float, stop_s: float) -> float:
        """Return the start of an observation; a start in the past by less than 1 ns is round-off and becomes now."""
        now = self.clock.now()
        if not now - EARLY_S <= start_s < stop_s:
            raise ValueError(f"an observation from {start_s} to {stop_s} s cannot be registered at {now} s")
        return max(start_s, now)

    def _observe(self, observer: Window | Capture) -> None:
        self._observers.append(observer)
        for edge in (observer.start_s, observer.stop_s):
            if edge > self._gyro.now_s:
                bisect.insort(self._edges_s, edge)

    def dismiss(self, observer: Recording | Trace) -> None:
        """Let go of what would otherwise look on for ever."""
        if observer in self._observers:
            self._observers.remove(observer)

    @staticmethod
    def _require(name: str, known: tuple[str, ...]) -> None:
        if name not in known:
            raise ValueError(f"{name!r} is none of {', '.join(known)}")
