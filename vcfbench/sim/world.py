"""The one physical world that all simulated instruments look at.

Nobody steps it: whoever is asked something takes it to `clock.now()` first, over whatever interval has passed.
Propagation stops at events and at the edges of registered windows and captures only, so an hour of waiting costs what
a second does.
"""

from __future__ import annotations

import bisect
import math
from typing import TYPE_CHECKING

from vcfbench.sim.gyro.gyro import Gyro
from vcfbench.sim.motion import TableMotion
from vcfbench.sim.trace import Trace

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np
    from numpy.typing import NDArray

    from vcfbench.clock import Clock
    from vcfbench.sim.gyro.stretch import Stretch
    from vcfbench.sim.leads import Leads
    from vcfbench.sim.parameters import BenchParameters
    from vcfbench.sim.sources import Drive, Ripple

__all__ = ["NODES", "RAILS", "Capture", "Window", "World"]

RAILS = ("positive", "negative")
NODES = ("output", "v_vc", "drive", "carrier", "sense", "rail_positive", "rail_negative")
EARLY_S = 1e-9


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
        """Return the mean voltage over the window; carrier-level nodes have none in the mean.

        Raises:
            RuntimeError: the window is not over yet.
        """
        self._world.advance()
        if self._world.reached_s < self.stop_s:
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

        self._world.advance()
        if self._world.reached_s < self.stop_s:
            raise RuntimeError("the capture is not over yet")
        times = np.asarray(times_s, dtype=float)
        starts = [each.start_s for each in self._stretches]
        held = np.clip(np.searchsorted(starts, times, side="right") - 1, 0, None)
        volts = np.empty_like(times)
        for index in np.unique(held):
            volts[held == index] = self._stretches[index].at(node, times[held == index])
        return volts

    def take(self, stretch: Stretch) -> None:
        """Keep a stretch that lies within the capture."""
        self._stretches.append(stretch)


class World:
    """Gyro, PCB, table, rails and wiring at bench time; see the module's words on how time passes."""

    def __init__(self, clock: Clock, parameters: BenchParameters, seed: int) -> None:
        self.clock = clock
        self.parameters = parameters
        self.table = TableMotion(clock, parameters.table, self.advance)
        self._gyro = Gyro(parameters, seed, clock.now())
        self.leads: dict[str, Leads] = {}
        """The leads of what looks at the World, by role."""
        self._rails_v = dict.fromkeys(RAILS, 0.0)
        self._loads_ohm = dict.fromkeys(RAILS, math.inf)
        self._on_load: list[Callable[[], None]] = []
        self._edges_s: list[float] = []
        self._observers: list[Window | Capture | Trace] = []

    @property
    def reached_s(self) -> float:
        """The bench time that the world was taken to."""
        return self._gyro.now_s

    def advance(self) -> None:
        """Take the world to `clock.now()`."""
        target = self.clock.now()
        while self._gyro.now_s < target:
            self._step(target)

    def _step(self, target_s: float) -> None:
        now = self._gyro.now_s
        rate = self.table.segment(now)
        edge = self._edges_s[0] if self._edges_s else math.inf
        stop = min(target_s, rate.stop_s, self._gyro.next_event_s(), edge)
        stretch = self._gyro.propagate(rate, stop)
        for each in self._observers:
            if each.start_s <= now:
                each.take(stretch)
        if stop == edge:
            self._pass_edge(stop)

    def _pass_edge(self, now_s: float) -> None:
        del self._edges_s[: bisect.bisect_right(self._edges_s, now_s)]
        self._observers = [each for each in self._observers if each.stop_s > now_s]

    def set_rail(self, rail: str, voltage_v: float) -> None:
        """Put a voltage on a supply pin from now on, signed: "positive" +10 V, "negative" -10 V.

        A pin of the wrong polarity counts as 0 V: the PCB's protection diodes block it.
        """
        self._require(rail, RAILS)
        self.advance()
        self._rails_v[rail] = voltage_v
        self._gyro.set_rails(max(self._rails_v["positive"], 0.0), min(self._rails_v["negative"], 0.0))

    def set_ripple(self, rail: str, ripple: Ripple | None) -> None:
        """Put a ripple on a supply pin from now on while it has a voltage, or none."""
        self._require(rail, RAILS)
        self.advance()
        self._gyro.set_ripple(RAILS.index(rail), ripple)

    def rail_current_a(self, rail: str, voltage_v: float) -> float:
        """Return the magnitude of the current that PCB and load would draw from `rail` now at `voltage_v`, A."""
        self._require(rail, RAILS)
        self.advance()
        return self._gyro.rail_current_a(RAILS.index(rail), voltage_v) + abs(voltage_v) / self._loads_ohm[rail]

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

    def drive_v_vc(self, source: Drive | None) -> None:
        """Connect a generator to the V_Vc input from now on, or None.

        None is a generator whose relay is open: the pull-down holds the node at 0 V and the carrier switch opens, so
        that the modulator's leakage does not reach the combs.
        """
        self.advance()
        self._gyro.connect_v_vc(source)

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

    def trace(self, span_s: float) -> Trace:
        """Keep the last `span_s` of every node from now on, until the trace is ended."""
        self.advance()
        trace = Trace(self._gyro.now_s, span_s, self.advance, self._dismiss)
        self._observers.append(trace)
        return trace

    def value_v(self, node: str) -> float:
        """Return a node's voltage now."""
        import numpy as np  # noqa: PLC0415  (kept out of the import of the package)

        self._require(node, NODES)
        self.advance()
        now = self._gyro.now_s
        return float(self._gyro.look(self.table.segment(now), now).at(node, np.array([now]))[0])

    def _coming(self, start_s: float, stop_s: float) -> float:
        """Return the start of an observation; a start in the past by less than 1 ns is round-off and becomes now."""
        self.advance()
        now = self._gyro.now_s
        if not now - EARLY_S <= start_s < stop_s:
            raise ValueError(f"an observation from {start_s} to {stop_s} s cannot be registered at {now} s")
        return max(start_s, now)

    def _observe(self, observer: Window | Capture) -> None:
        self._observers.append(observer)
        for edge in (observer.start_s, observer.stop_s):
            if edge > self._gyro.now_s:
                bisect.insort(self._edges_s, edge)

    def _dismiss(self, trace: Trace) -> None:
        self._observers.remove(trace)

    @staticmethod
    def _require(name: str, known: tuple[str, ...]) -> None:
        if name not in known:
            raise ValueError(f"{name!r} is none of {', '.join(known)}")
