"""A rack of instruments that see each other: opened by ``simrack serve`` and ``"@simrack"``."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Mapping
from functools import partial
from typing import Any

import numpy as np
from msgspec import Struct

from simrack.attendance import AttendedClock
from simrack.clock import Clock
from simrack.device import Device
from simrack.faulty_device import FaultInjector
from simrack.gpib_adapter import GpibAdapter
from simrack.leads import Leads
from simrack.motion import TableMotion
from simrack.plan import UPSIDE_DOWN, OwnModel, Place, Plan, plan_of
from simrack.scpi.twin import tell_apart
from simrack.serve import ServedBench, ServedClock
from simrack.sources import Approach
from simrack.wired import Mechanics, WiredWorld

_SUPPLY_OUTPUTS = {"output_1": "P6V", "output_2": "P25V", "output_3": "N25V"}


class _Turned:
    """The World as a supply sees it some of whose outputs are the other way round."""

    def __init__(self, world: WiredWorld, rails: frozenset[str]) -> None:
        self._world = world
        self._rails = rails

    def __getattr__(self, name: str) -> Any:
        return getattr(self._world, name)

    def move_rail(self, rail: str, approach: Approach) -> None:
        """Change the voltage on a supply pin along a given course from now on, signed."""
        if rail in self._rails:
            terms = tuple((-size, tau) for size, tau in approach.terms)
            approach = Approach(-approach.goal_v, approach.origin_s, terms)
        self._world.move_rail(rail, approach)


class _Shaft(Struct, frozen=True):
    """Shaft of a rate table that is not the first, with nothing on it."""

    clock: Clock
    table: TableMotion


class Rack(Struct, frozen=True):
    """The World and its instruments by name."""

    plan: Plan
    world: WiredWorld
    devices: Mapping[str, Device]

    @classmethod
    def build(cls, clock: Clock, plan: Plan | None = None, seed: int | None = None) -> Rack:
        """Build it on `clock`; with a `seed`, or one of the plan, instruments are specimens with errors, else ideal.

        Raises:
            ValueError: two feed a node, or nothing does that a meter or a load is on.
        """
        plan = plan_of(()) if plan is None else plan
        seed = plan.seed if seed is None else seed
        attended = AttendedClock(clock)
        fed, rails = _fed(plan, {"generator", "own", "box"}), _fed(plan, {"supply"})
        world = WiredWorld(attended, links=plan.links, inputs=fed, rails=rails)
        if both := {*rails} & {*world.nodes}:
            raise ValueError(f"a supply feeds {min(both)!r}, and a circuit or a generator too")
        tables = [place for place in plan.places if place.model.kind == "rate table"]
        devices: dict[str, Device] = {}
        on_gpib = {place.gpib: place.name for place in plan.places if place.gpib is not None}
        for place in plan.places:
            if place.model.kind == "adapter":  # the last
                devices[place.name] = GpibAdapter({at: devices[name] for at, name in on_gpib.items()}, attended)
                continue
            apart = place in tables[1:]
            seen = _Shaft(attended, TableMotion(attended, Mechanics(), lambda: None)) if apart else world
            devices[place.name] = _built(place, seen, seed)
        for node, ohm in plan.loads_ohm.items():
            world.put_load(_named(node, world, "loads"), ohm)
        tell_apart(devices.values())
        attended.attend(*devices.values())
        return cls(plan, world, devices)

    def by_resource(self) -> dict[str, Device]:
        """Return the instruments, and their faults, by their VISA resource names."""
        devices = self.devices
        if self.plan.faults.faults:
            injector = FaultInjector(devices, self.world.clock)
            injector.play(self.plan.faults)
            devices = injector.devices
        found: dict[str, Device] = {}
        for number, place in enumerate(self.plan.places, start=1):
            own = {name: made(self.world) for name, made in place.resources.items()}
            found |= own or {place.resource or place.made_up(number): devices[place.name]}
        return found


def _fed(plan: Plan, kinds: set[str]) -> tuple[str, ...]:
    """Return the nodes that outputs of some kinds feed."""
    owners: dict[str, str] = {}
    for place in plan.places:
        for terminal in place.model.outputs:
            node = place.terminals.get(terminal)
            if place.model.kind not in kinds or node is None:
                continue
            name = node.removeprefix("-")
            if name in owners:
                raise ValueError(f"{owners[name]} and {place.name}.{terminal} both feed {name!r}")
            owners[name] = f"{place.name}.{terminal}"
    return tuple(owners)


def _built(place: Place, world: Any, seed: int | None) -> Device:
    """Return an instrument at its place; its draws depend on the seed and its name alone."""
    twin = place.model.load()
    random = None if seed is None else np.random.default_rng([seed, *place.name.encode()])
    nodes = {each: node.removeprefix("-") for each, node in place.terminals.items() if node is not None}
    turned = {each for each, node in place.terminals.items() if (node or "").startswith("-")}
    around: dict[str, Any] = {"nodes": {each: node for each, node in nodes.items() if each in place.model.outputs}}
    if not isinstance(place.model, OwnModel):
        around["errors"] = twin.errors_class.none() if random is None else twin.errors_class.drawn(random)
        around["noise_seed"] = 0 if random is None else int(random.integers(1 << 32))
    seen: Any = world
    if place.model.kind == "supply":
        upside_down = {each for model, each in UPSIDE_DOWN if model == place.model.name}
        seen = _Turned(world, frozenset(nodes[each] for each in turned ^ upside_down if each in nodes))
        around["rails"] = {_SUPPLY_OUTPUTS[each]: rail for each, rail in nodes.items()}
    elif place.model.kind == "generator":
        around |= {"node": nodes.get("output_1"), "second_node": nodes.get("output_2")}
    elif isinstance(place.model, OwnModel) and place.model.inputs:
        around["leads"] = _leads(place, world, nodes, turned)
    elif place.model.inputs:
        seen = _leads(place, world, nodes, turned)
        around |= {"node": "input", "channels": {n: f"channel_{n}" for n in range(1, len(place.model.inputs) + 1)}}
    takes = inspect.signature(twin).parameters
    device: Device = twin(seen, **{each: value for each, value in around.items() if each in takes or "around" in takes})
    return device


def _leads(place: Place, world: WiredWorld, nodes: Mapping[str, str], turned: Iterable[str]) -> Leads:
    leads = Leads(world, place.name, dict.fromkeys(place.model.inputs, world.nodes[0]))
    for terminal in place.model.inputs:
        node = nodes.get(terminal)
        leads.connect(terminal, None if node is None else _named(node, world, f"{place.name}.{terminal}"))
        leads.turn(terminal, reversed_=terminal in turned)
    return leads


def _named(node: str, world: WiredWorld, where: str) -> str:
    """Return the World's name of a node: of a supply's output the name of the rail."""
    named = f"rail_{node}" if node in world.rails else node
    if named not in world.nodes:
        raise ValueError(f"{where}: expected a node with a source, {', '.join(world.nodes)}; got {node!r}")
    return named


def served(clock: ServedClock, plan: Plan | None = None, seed: int | None = None) -> ServedBench:
    """Return a rack for serving, which a reset builds again."""
    built = Rack.build(clock, plan, seed)
    seed = built.plan.seed if seed is None else seed
    places = built.plan.places
    models = {place.name: place.model.name for place in places}
    rebuild = partial(served, clock, built.plan)
    return ServedBench(built.world, built.devices, models, seed, rebuild, {place.name: place.box for place in places})
