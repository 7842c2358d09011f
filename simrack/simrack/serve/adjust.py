"""Adjustments of a served World, from outside the wire.

A World or a device that has more to offer than is known here has a method `adjustments()` that returns
:class:`Adjustment` values (:class:`Adjustable`): temperature, loads, swapped leads. Names are dotted; those of a
device get its role in front.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

from simrack.adjustment import Adjustable, Adjustment, number
from simrack.device import Device
from simrack.world import LeadsOfRole, World

_SUDDEN_DEG_S2 = 1e4


def adjustments_of(world: World, devices: Mapping[str, Device]) -> dict[str, Adjustment]:
    """Return everything that can be seen and changed, by name."""
    found = [*_motion(world), *_warmth(world), *_nodes(world), *_rails(world), *_leads(world)]
    found += [*_own(world, ""), *_loads(world)]
    for role, device in devices.items():
        found += _own(device, f"{role}.")
    return {each.name: each for each in found}


def _own(thing: object, prefix: str) -> Iterator[Adjustment]:
    if isinstance(thing, Adjustable):
        for each in thing.adjustments():
            yield Adjustment(prefix + each.name, each.unit, each.meaning, each.read, each.write)


def _motion(world: World) -> Iterator[Adjustment]:
    table = world.table
    turn = partial(_turn, world)
    yield Adjustment(
        "applied_rate_deg_s", "deg/s", "true rate about the axis, whoever turns it", table.rate_deg_s, turn
    )
    yield Adjustment("angle_deg", "deg", "true angle turned so far", table.angle_deg)


def _turn(world: World, rate_deg_s: Any) -> None:
    """Turn the device by hand: the table's controller is not asked, and does not learn of it."""
    world.table.close_servo()
    world.table.demand_rate(number(rate_deg_s), _SUDDEN_DEG_S2)


def _warmth(world: World) -> Iterator[Adjustment]:
    def warm(value: Any) -> None:
        world.set_ambient_c(number(value))

    yield Adjustment("ambient_c", "degC", f"temperature around the {world.device}", world.ambient_c, warm)
    yield Adjustment("temperature_c", "degC", f"temperature of the {world.device}", world.glance_temperature_c)


def _leads(world: World) -> Iterator[Adjustment]:
    for role, leads in world.leads.items():
        for name in leads.inputs:
            yield from _lead(leads, role, name)


def _lead(leads: LeadsOfRole, role: str, name: str) -> Iterator[Adjustment]:
    def turn(value: Any) -> None:
        if not isinstance(value, bool):
            raise ValueError(f"expected true or false, not {value!r}")  # noqa: TRY004  (what came over the wire)
        leads.turn(name, reversed_=value)

    meaning = "node that the lead goes to; null when it hangs free"
    connect = partial(leads.connect, name)
    yield Adjustment(f"{role}.{name}.node", "", meaning, lambda: leads.lead(name).node, connect)
    yield Adjustment(f"{role}.{name}.reversed", "", "leads swapped", lambda: leads.lead(name).reversed, turn)


def _loads(world: World) -> Iterator[Adjustment]:
    def read(rail: str) -> float | None:
        return ohms if math.isfinite(ohms := world.load_ohm(rail)) else None

    def write(rail: str, ohms: Any) -> None:
        world.set_load(rail, math.inf if ohms is None else number(ohms))

    for rail in world.rails:
        meaning = "load beside the PCB; null is none"
        yield Adjustment(f"rail.{rail}.load_ohm", "ohm", meaning, partial(read, rail), partial(write, rail))


def _nodes(world: World) -> Iterator[Adjustment]:
    for node in world.nodes:
        write = partial(_drive, world, node) if node in world.inputs else None
        meaning = "voltage of the node at this instant, mains and noise in it"
        yield Adjustment(f"node.{node}", "V", meaning, partial(world.glance_v, node), write)


def _drive(world: World, node: str, volts: Any) -> None:
    """Put a voltage on an input instead of the generator, or nothing (null)."""
    from simrack.sources import Drive  # noqa: PLC0415  (numpy with it; a client of the control port needs none)

    world.drive(node, None if volts is None else Drive(number(volts)))


def _rails(world: World) -> Iterator[Adjustment]:
    def write(rail: str, volts: Any) -> None:
        """Put a voltage on the pin instead of the supply, until that changes its own."""
        world.set_rail(rail, number(volts))

    for rail in world.rails:
        read = partial(world.glance_current_a, rail)
        yield Adjustment(f"rail.{rail}.current_a", "A", "current that the PCB draws from the rail", read)
        read = partial(world.glance_v, f"rail_{rail}")
        yield Adjustment(f"rail.{rail}.voltage_v", "V", "voltage at the pin", read, partial(write, rail))
