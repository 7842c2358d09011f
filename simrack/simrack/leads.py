"""The leads between the PCB and the meters; they can be exchanged, reversed or pulled while the bench runs."""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping
from typing import TYPE_CHECKING

from msgspec import Struct
from msgspec.structs import replace

from simrack.clock import Clock
from simrack.observations import Capture, Recording, Window
from simrack.sources import Sine
from simrack.trace import Piece, Trace
from simrack.world import World

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class Lead(Struct, frozen=True):
    """End of a lead: a node of the PCB, None when it hangs free and reads 0 V; its way round, its pick-up."""

    node: str | None
    reversed: bool = False
    pick_up: Sine | None = None

    @property
    def sign(self) -> float:
        """-1 when it is reversed."""
        return -1.0 if self.reversed else 1.0


class _LeadWindow:
    """An averaging window through a lead as it was when the window was registered."""

    __slots__ = ("_lead", "_window")

    def __init__(self, window: Window, lead: Lead) -> None:
        self._window = window
        self._lead = lead

    def mean_v(self) -> float:
        """Return the mean voltage at the instrument's terminals."""
        mean = self._window.mean_v()
        if self._lead.node is None:
            return 0.0
        caught = self._lead.pick_up
        seen = self._lead.sign * mean
        return seen if caught is None else seen + caught.mean_v(self._window.start_s, self._window.stop_s)


def _seen(known: Trace | Capture, lead: Lead) -> list[Piece]:
    """Return the pieces known of a node through a lead, oldest first."""
    if lead.node is None:
        return []
    pieces = known.pieces(lead.node)
    seen = [piece.reversed() for piece in pieces] if lead.reversed else pieces
    caught = lead.pick_up
    return seen if caught is None else [piece.with_sine(caught) for piece in seen]


class _LeadCapture:
    """A stretch of time seen through leads as they were when it was registered."""

    __slots__ = ("_capture", "_leads")

    def __init__(self, capture: Capture, leads: Mapping[str, Lead]) -> None:
        self._capture = capture
        self._leads = leads

    def samples(self, node: str, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the volts at input `node` at absolute times."""
        lead = self._leads[node]
        if lead.node is None:
            return 0.0 * times_s
        volts = lead.sign * self._capture.samples(lead.node, times_s)
        return volts if lead.pick_up is None else volts + lead.pick_up.at(times_s)

    def finest_s(self, node: str) -> float:
        """Return a time within which a cubic describes the voltage at input `node`."""
        lead = self._leads[node]
        return math.inf if lead.node is None else self._capture.finest_s(lead.node)

    def fed(self, node: str) -> bool:
        """Return True if the voltage at input `node` is put on the PCB from outside."""
        lead = self._leads[node]
        return lead.node is not None and self._capture.fed(lead.node)

    def whole(self, start_s: float, stop_s: float) -> bool:
        """Return True if nothing happened between two times that could make an input jump."""
        return self._capture.whole(start_s, stop_s)

    def pieces(self, node: str) -> list[Piece]:
        """Return the pieces known of input `node` up to now, oldest first."""
        return _seen(self._capture, self._leads[node])


class _LeadRecording(_LeadCapture):
    """A recording from a time on, through leads as they were then."""

    __slots__ = ("_recording",)

    def __init__(self, recording: Recording, leads: Mapping[str, Lead]) -> None:
        super().__init__(recording, leads)
        self._recording = recording

    def forget(self, before_s: float) -> None:
        """Drop everything that was over before a time."""
        self._recording.forget(before_s)

    def close(self) -> None:
        """Keep the pieces so far and take nothing more."""
        self._recording.close()


class _LeadTrace:
    """The recent history of the inputs, through the leads as they are when it is asked for."""

    __slots__ = ("_leads", "_trace")

    def __init__(self, trace: Trace, leads: Leads) -> None:
        self._trace = trace
        self._leads = leads

    def pieces(self, name: str) -> list[Piece]:
        """Return the pieces known of input `name` up to now."""
        return _seen(self._trace, self._leads.lead(name))

    def end(self) -> None:
        """Forget it."""
        self._trace.end()


class Leads:
    """The World for one instrument, with the instrument's inputs in the place of the World's nodes.

    Args:
        world: the World.
        role: whose leads these are.
        inputs: node that each input is wired to.
        pick_up: what the leads catch of the mains.
    """

    def __init__(self, world: World, role: str, inputs: Mapping[str, str], pick_up: Sine | None = None) -> None:
        self._world = world
        self._role = role
        self._leads = {name: Lead(node, pick_up=pick_up) for name, node in inputs.items()}
        self._loads_ohm: dict[str, float] = {}
        world.leads[role] = self

    @property
    def clock(self) -> Clock:
        """Bench time."""
        return self._world.clock

    @property
    def inputs(self) -> tuple[str, ...]:
        """The names of the inputs."""
        return tuple(self._leads)

    def lead(self, name: str) -> Lead:
        """Return where the lead of an input goes."""
        return self._leads[name]

    def connect(self, name: str, node: str | None) -> None:
        """Put the lead of input `name` on another node, or leave it free; measurements under way go on."""
        nodes = self._world.nodes
        if node is not None and node not in nodes:
            raise ValueError(f"{node!r} is none of {', '.join(nodes)}")
        self._change(name, replace(self._leads[name], node=node))

    def turn(self, name: str, *, reversed_: bool) -> None:
        """Put the lead of input `name` on the right way round, or reversed."""
        self._change(name, replace(self._leads[name], reversed=reversed_))

    def _change(self, name: str, lead: Lead) -> None:
        self._leads = {**self._leads, name: lead}
        if name in self._loads_ohm:
            self._hang(name)

    def load_node(self, who: Hashable, name: str, resistance_ohm: float) -> None:
        """Hang a resistance on input `name`, which goes with its lead; as of the World, by the name of the input."""
        del who
        self._loads_ohm[name] = resistance_ohm
        self._hang(name)

    def _hang(self, name: str) -> None:
        node = self._leads[name].node
        resistance_ohm = math.inf if node is None else self._loads_ohm[name]
        self._world.load_node((self._role, name), node or self._world.nodes[0], resistance_ohm)

    def window(self, name: str, start_s: float, stop_s: float) -> _LeadWindow:
        """Register an averaging window at input `name`; as of the World."""
        lead = self._leads[name]
        return _LeadWindow(self._world.window(lead.node or self._world.nodes[0], start_s, stop_s), lead)

    def capture(self, start_s: float, stop_s: float) -> _LeadCapture:
        """Register a stretch of time whose waveforms will be asked for; as of the World."""
        return _LeadCapture(self._world.capture(start_s, stop_s), self._leads)

    def record(self) -> _LeadRecording:
        """Keep all that happens from now on; as of the World."""
        return _LeadRecording(self._world.record(), self._leads)

    def trace(self, span_s: float) -> _LeadTrace:
        """Keep the last `span_s` of the inputs from now on; as of the World."""
        return _LeadTrace(self._world.trace(span_s), self)

    def source_ohm(self, name: str) -> float:
        """Return the resistance between the terminals of input `name`, ohm; inf when its lead hangs free."""
        node = self._leads[name].node
        return math.inf if node is None else self._world.source_ohm(node)

    def value_v(self, name: str) -> float:
        """Return the voltage at input `name` now."""
        lead = self._leads[name]
        if lead.node is None:
            return 0.0
        volts = lead.sign * self._world.value_v(lead.node)
        return volts if lead.pick_up is None else volts + lead.pick_up.value_v(self.clock.now())


class LoadingLeads(Leads):
    """The leads of a meter that loads the node: everybody sees the loaded voltage, and the meter reads that.

    Args:
        load_ohm: what each input puts across its node; inf is nothing.
    """

    def __init__(
        self, world: World, role: str, inputs: Mapping[str, str], pick_up: Sine | None = None, *, load_ohm: float
    ) -> None:
        super().__init__(world, role, inputs, pick_up)
        for name in inputs:
            self.load_node(role, name, load_ohm)

    def source_ohm(self, name: str) -> float:
        """Return 0 for a connected input: the node's voltage is that with the meter on it already."""
        return math.inf if self.lead(name).node is None else 0.0
