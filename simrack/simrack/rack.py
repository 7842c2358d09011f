"""A rack of instruments, and what they are wired to: opened by ``simrack serve`` and ``"@simrack"``."""

from __future__ import annotations

import inspect
import re
import runpy
from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import Struct, field
from msgspec.structs import replace

from simrack.attendance import AttendedClock
from simrack.clock import Clock
from simrack.device import Device
from simrack.leads import Leads
from simrack.models import SimulatedModel, model_named
from simrack.own import OwnInstrument
from simrack.serve import Offer, ServedBench, ServedClock
from simrack.sources import Approach
from simrack.wired import Circuit, Through, WiredWorld

OFFERS: Mapping[str, Offer] = {"TCP": "tcp", "VXI-11": "vxi11", "HiSLIP": "hislip", "serial line": "pty"}
_SUPPLY_OUTPUTS = {"output_1": "P6V", "output_2": "P25V", "output_3": "N25V"}
_UPSIDE_DOWN = {("E36312A", "output_3")}
"""Outputs whose class gives the sign of the rail that they are meant for, not that of their terminals."""
_LAN_PORT = 5025
_WORD = re.compile(r"(?:(?P<name>[\w-]+)=)?(?P<model>[\w-]+)(?::(?P<wires>[\w+]+))?")


class Place(Struct, frozen=True):
    """An instrument of a rack.

    Args:
        name: what it is called.
        model: what it is.
        wires: what it is served on; none are those of the real box.
        terminals: the node that each terminal goes to, `-NODE` the wrong way round, None nowhere.
        resource: its VISA resource name in this process; empty for one that is made up.
    """

    name: str
    model: SimulatedModel
    wires: frozenset[Offer] = frozenset()
    terminals: Mapping[str, str | None] = field(default_factory=dict)
    resource: str = ""

    @property
    def box(self) -> frozenset[Offer]:
        """The wires of the real box."""
        return frozenset(OFFERS[each] for each in self.model.wires)

    def made_up(self, number: int) -> str:
        """Return a VISA resource name for the instrument of this number: on LAN if it has that, else on GPIB."""
        wires = self.wires or self.box
        if "vxi11" in wires:
            return f"TCPIP0::{self.name}::inst0::INSTR"
        if "hislip" in wires:
            return f"TCPIP0::{self.name}::hislip0::INSTR"
        if self.wires == {"tcp"}:
            return f"TCPIP0::{self.name}::{_LAN_PORT}::SOCKET"
        return f"ASRL{number}::INSTR" if self.wires or self.model.kind == "rate table" else f"GPIB0::{number}::INSTR"


class Plan(Struct, frozen=True):
    """Instruments and circuits; `links` are those of the World, by the node at the output of each."""

    places: tuple[Place, ...]
    links: Mapping[str, Through]

    def wires_asked_for(self) -> dict[str, frozenset[Offer]]:
        """Return the wires of the instruments of which they were said."""
        return {place.name: place.wires for place in self.places if place.wires}


class OwnModel(SimulatedModel, frozen=True):
    """An instrument of somebody's own: `made` is its class."""

    made: type[OwnInstrument] = OwnInstrument

    @property
    def feeds(self) -> tuple[str, ...]:
        """Its terminals that are outputs."""
        return self.made.outputs

    def load(self) -> Any:
        """Return its class."""
        return self.made


def plan_of(words: Iterable[str]) -> Plan:
    """Return the plan of a command's words, each a Python file or ``[NAME=]MODEL[:WIRE[+WIRE...]]``.

    A file defines CIRCUIT, instruments of one's own, or both; those that no word names are there once. Without any
    instrument it is the desk: a supply, a generator, a multimeter and an oscilloscope.

    Raises:
        ValueError: there is no such model or wire, a name is given twice, or a file defines nothing of use.
        OSError: a file cannot be read.
    """
    files, others = _sorted(words)
    circuit: Circuit | None = None
    own: dict[str, SimulatedModel] = {}
    for file in files:
        found = runpy.run_path(file)
        made = own_models(found)
        if not made or "CIRCUIT" in found:
            circuit = _circuit(found, file)
        own |= made
    places: list[Place] = []
    for word in others:
        places.append(_place(word, own, {each.name for each in places}))
    named = {place.model.name for place in places}
    places += [_place(name, own, {each.name for each in places}) for name in own if name not in named]
    return Plan(_wired(places or DESK), {"output": Through("input", circuit)})


def _sorted(words: Iterable[str]) -> tuple[list[str], list[str]]:
    """Return the files and the others."""
    found: tuple[list[str], list[str]] = ([], [])
    for word in words:
        found[not word.endswith(".py")].append(word)
    return found


def own_models(module: Mapping[str, Any]) -> dict[str, SimulatedModel]:
    """Return the instruments that a module defines, by the names of their classes."""
    classes = [each for each in module.values() if isinstance(each, type) and issubclass(each, OwnInstrument)]
    return {
        made.__name__: OwnModel(made.__name__, "own", "", "", made.wires, "", {}, (*made.inputs, *made.outputs), made)
        for made in classes
        if made.__module__ == module["__name__"]
    }


def _place(word: str, own: Mapping[str, SimulatedModel], taken: set[str]) -> Place:
    found = _WORD.fullmatch(word)
    if found is None:
        raise ValueError(f"expected a file.py or [NAME=]MODEL[:WIRE[+WIRE...]], came {word!r}")
    model = model_named(found["model"], own)
    usual = [model.name, *(f"{model.name}-{number}" for number in range(2, len(taken) + 2))]
    name = found["name"] or next(each for each in usual if each not in taken)
    if name in taken:
        raise ValueError(f"two instruments are called {name!r}")
    return Place(name, model, _wires(model, (found["wires"] or "").split("+")))


def _wires(model: SimulatedModel, words: Iterable[str]) -> frozenset[Offer]:
    known = {offer: offer for offer in OFFERS.values() if model.kind != "rate table" or offer in {"tcp", "pty"}}
    wires = [word for word in words if word]
    if wrong := [word for word in wires if word not in known]:
        raise ValueError(f"{model.name} can be on {', '.join(known)}, not on {wrong[0]!r}")
    return frozenset(known[word] for word in wires)  # type: ignore[index]  # it is one of them


def _wired(places: Iterable[Place]) -> tuple[Place, ...]:
    """Say of each terminal where it goes.

    The first supply is on the rails, the first generator on `input`, further outputs are on nodes of their own. Meters
    are on `output`, oscilloscopes on both.
    """
    seen: set[str] = set()
    wired = []
    for place in places:
        kind, first = place.model.kind, place.model.kind not in seen
        node = {"channel_1": "input", "channel_2": "output"}
        node |= {each: "output" for each in place.model.terminals if kind in {"multimeter", "own"}}
        node |= {each: f"{place.name}.{each}" for each in place.model.feeds}
        if first and kind == "generator":
            node["output_1"] = "input"
        if first and kind == "supply":
            node |= {"output_2": "positive", "output_3": "negative"}
            node |= {each: f"-{node[each]}" for model, each in _UPSIDE_DOWN if model == place.model.name}
        seen.add(place.model.kind)
        wired.append(replace(place, terminals={each: node.get(each) for each in place.model.terminals}))
    return tuple(wired)


DESK = (
    Place("power", model_named("E3631A"), resource="GPIB0::5::INSTR"),
    Place("generator", model_named("33220A"), resource="USB0::0x0957::0x0407::MY44021876::INSTR"),
    Place("multimeter", model_named("34401A"), resource="GPIB0::22::INSTR"),
    Place("oscilloscope", model_named("DSO7104B"), resource="USB0::0x0957::0x175D::MY49520121::INSTR"),
)


class _Turned:
    """The World as a supply sees it some of whose outputs are the other way round."""

    def __init__(self, world: WiredWorld, rails: frozenset[str]) -> None:
        self._world = world
        self._rails = rails

    def __getattr__(self, name: str) -> Any:
        return getattr(self._world, name)

    def move_rail(self, rail: str, approach: Approach) -> None:
        """Let the voltage on a supply pin go its way from now on, signed."""
        if rail in self._rails:
            terms = tuple((-size, tau) for size, tau in approach.terms)
            approach = Approach(-approach.goal_v, approach.origin_s, terms)
        self._world.move_rail(rail, approach)


class Rack(Struct, frozen=True):
    """The World and its instruments by name."""

    plan: Plan
    world: WiredWorld
    devices: Mapping[str, Device]

    @classmethod
    def build(cls, clock: Clock, plan: Plan | None = None, seed: int | None = None) -> Rack:
        """Build it on `clock`; with a `seed` instruments are specimens within their data sheets, else ideal.

        Raises:
            ValueError: two feed a node, or nothing does that a meter is on.
        """
        plan = plan_of(()) if plan is None else plan
        attended = AttendedClock(clock)
        fed = _fed(plan, {"generator", "own"})
        world = WiredWorld(attended, links=plan.links, inputs=fed, rails=_fed(plan, {"supply"}))
        devices = {place.name: _built(place, world, seed) for place in plan.places}
        attended.attend(*devices.values())
        return cls(plan, world, devices)

    def by_resource(self) -> dict[str, Device]:
        """Return the instruments by their VISA resource names."""
        return {
            place.resource or place.made_up(number): self.devices[place.name]
            for number, place in enumerate(self.plan.places, start=1)
        }


def _fed(plan: Plan, kinds: set[str]) -> tuple[str, ...]:
    """Return the nodes that outputs of some kinds feed."""
    owners: dict[str, str] = {}
    for place in plan.places:
        for terminal in place.model.feeds:
            node = place.terminals.get(terminal)
            if place.model.kind not in kinds or node is None:
                continue
            name = node.removeprefix("-")
            if name in owners:
                raise ValueError(f"{owners[name]} and {place.name}.{terminal} both feed {name!r}")
            owners[name] = f"{place.name}.{terminal}"
    return tuple(owners)


def _built(place: Place, world: WiredWorld, seed: int | None) -> Device:
    """Return an instrument at its place; what it draws depends on the seed and its name alone."""
    twin = place.model.load()
    random = None if seed is None else np.random.default_rng([seed, *place.name.encode()])
    nodes = {each: node.removeprefix("-") for each, node in place.terminals.items() if node is not None}
    turned = {each for each, node in place.terminals.items() if (node or "").startswith("-")}
    around: dict[str, Any] = {"nodes": {each: node for each, node in nodes.items() if each in place.model.feeds}}
    if place.model.kind != "own":
        around["errors"] = twin.errors_class.none() if random is None else twin.errors_class.drawn(random)
        around["noise_seed"] = 0 if random is None else int(random.integers(1 << 32))
    seen: Any = world
    if place.model.kind == "supply":
        upside_down = {each for model, each in _UPSIDE_DOWN if model == place.model.name}
        seen = _Turned(world, frozenset(nodes[each] for each in turned ^ upside_down if each in nodes))
        around["rails"] = {_SUPPLY_OUTPUTS[each]: rail for each, rail in nodes.items()}
    elif place.model.kind == "generator":
        around |= {"node": nodes.get("output_1"), "second_node": nodes.get("output_2")}
    elif place.model.kind == "own" and len(place.model.terminals) > len(place.model.feeds):
        around["leads"] = _leads(place, world, nodes, turned)
    elif place.model.kind != "own" and place.model.terminals:
        seen = _leads(place, world, nodes, turned)
        around |= {"node": "input", "channels": {n: f"channel_{n}" for n in range(1, len(place.model.terminals) + 1)}}
    takes = inspect.signature(twin).parameters
    device: Device = twin(seen, **{each: value for each, value in around.items() if each in takes})
    return device


def _leads(place: Place, world: WiredWorld, nodes: Mapping[str, str], turned: Iterable[str]) -> Leads:
    leads = Leads(world, place.name, dict.fromkeys(place.model.terminals, world.nodes[0]))
    for terminal in place.model.terminals:
        node = nodes.get(terminal)
        named = f"rail_{node}" if node in world.rails else node
        if named is not None and named not in world.nodes:
            raise ValueError(f"{place.name}.{terminal}: nothing feeds {node!r}, only {', '.join(world.nodes)}")
        leads.connect(terminal, named)
        leads.turn(terminal, reversed_=terminal in turned)
    return leads


def served(clock: ServedClock, plan: Plan | None = None, seed: int | None = None) -> ServedBench:
    """Return a rack as it is served; a reset builds it anew."""
    built = Rack.build(clock, plan, seed)
    places = built.plan.places
    models = {place.name: place.model.name for place in places}
    rebuild = partial(served, clock, built.plan)
    return ServedBench(built.world, built.devices, models, seed, rebuild, {place.name: place.box for place in places})


def circuit_in(file: Path) -> Circuit:
    """Return the value ``CIRCUIT`` that a Python file defines.

    Raises:
        ValueError: it defines none.
    """
    return _circuit(runpy.run_path(str(file)), str(file))


def _circuit(module: Mapping[str, Any], file: str) -> Circuit:
    found = module.get("CIRCUIT")
    if not isinstance(found, Circuit):
        raise ValueError(f"{file}: expected CIRCUIT = ..., a simrack.wired.Circuit, came {type(found).__name__}")  # noqa: TRY004  (what a user wrote)
    return found
