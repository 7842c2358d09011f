"""The World as instruments see it: nodes and rails that they are wired to, a shaft, the air around.

Whoever has a device of his own to look at implements :class:`World`. Nobody steps it: who is asked something takes
itself to `clock.now()` first.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Protocol

from simrack.clock import Clock
from simrack.motion import TableMotion
from simrack.observations import Capture, Recording, Window
from simrack.sources import Approach, Drive, Played, Ripple
from simrack.trace import Trace


class LeadEnd(Protocol):
    """End of a lead."""

    @property
    def node(self) -> str | None:
        """The node, None when it hangs free."""

    @property
    def reversed(self) -> bool:
        """True if it is the wrong way round."""


class LeadsOfRole(Protocol):
    """Actions of a person on the leads of one instrument; they look at the World, which only knows that there are."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """The names of the inputs."""

    def lead(self, name: str) -> LeadEnd:
        """Return where the lead of an input goes."""

    def connect(self, name: str, node: str | None) -> None:
        """Put the lead of input `name` on another node, or leave it free."""

    def turn(self, name: str, *, reversed_: bool) -> None:
        """Put the lead of input `name` on the right way round, or reversed."""


class World(Protocol):
    """The one physical world that all instruments of a rack look at. Voltages are in V from ground, times in s."""

    @property
    def clock(self) -> Clock:
        """Bench time."""

    @property
    def device(self) -> str:
        """The device under test in a word or two, for people: ``gyroscope``."""

    @property
    def nodes(self) -> tuple[str, ...]:
        """The nodes that leads can go to, ``rail_...`` of each rail among them."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """The nodes that :meth:`drive` puts a source on."""

    @property
    def rails(self) -> tuple[str, ...]:
        """The supply pins."""

    @property
    def table(self) -> TableMotion:
        """The shaft of the rate table, with the device on it."""

    @property
    def leads(self) -> dict[str, LeadsOfRole]:
        """Leads of the instruments, by role."""

    def drive(self, node: str, source: Drive | Played | None) -> None:
        """Connect a generator to an input from now on; None is one with an open relay."""

    def move_rail(self, rail: str, approach: Approach) -> None:
        """Let the voltage on a supply pin go its way from now on, signed."""

    def set_rail(self, rail: str, voltage_v: float) -> None:
        """Put a voltage on a supply pin from now on, signed."""

    def set_ripple(self, rail: str, ripple: Ripple | None) -> None:
        """Put a ripple on a supply pin from now on while it has a voltage, or none."""

    def rail_current_a(self, rail: str, voltage_v: float) -> float:
        """Return the magnitude of the current that would be drawn from `rail` now at `voltage_v`, A."""

    def drawing(self) -> Hashable:
        """Return a key of the rails' currents: while it is equal, so are they; None while they change."""

    def load_ohm(self, rail: str) -> float:
        """Return the load on `rail` parallel to the device, ohm; inf is none."""

    def set_load(self, rail: str, resistance_ohm: float) -> None:
        """Put a load on `rail` parallel to the device; inf takes it off."""

    def load_node(self, who: Hashable, node: str, resistance_ohm: float) -> None:
        """Hang a resistance on `node` from now on in place of any former one of `who`; inf takes it off."""

    def source_ohm(self, node: str) -> float:
        """Return the resistance behind a node now, ohm."""

    def on_load(self, regulate: Callable[[], None]) -> None:
        """Have `regulate` called after each change of a load."""

    def ambient_c(self) -> float:
        """Return the temperature around the device, degC."""

    def set_ambient_c(self, ambient_c: float) -> None:
        """Change the temperature around the device from now on, degC."""

    def window(self, node: str, start_s: float, stop_s: float) -> Window:
        """Register an averaging window that begins now or later."""

    def capture(self, start_s: float, stop_s: float) -> Capture:
        """Register a stretch of time that begins now or later, whose waveforms will be asked for."""

    def record(self) -> Recording:
        """Keep all that happens from now on, until the recording is closed."""

    def trace(self, span_s: float) -> Trace:
        """Keep the last `span_s` of every node from now on, until the trace is ended."""

    def value_v(self, node: str) -> float:
        """Return a node's voltage now."""

    def glance_v(self, node: str) -> float:
        """Return the present voltage of a node for display; the look changes nothing in the simulation."""

    def glance_current_a(self, rail: str) -> float:
        """Return the magnitude of the current drawn from `rail` now, A; it leaves no mark."""

    def glance_temperature_c(self) -> float:
        """Return the temperature of the device now, degC; it leaves no mark."""
