"""A desk with four instruments and a circuit between them, opened by ``simrack serve`` and ``"@simrack"``."""

from __future__ import annotations

import runpy
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import Struct

from simrack.attendance import AttendedClock
from simrack.clock import Clock
from simrack.device import Device
from simrack.instruments.agilent33220a import Agilent33220ATwin, GeneratorErrors
from simrack.instruments.dso7104b import Dso7104BTwin, ScopeErrors
from simrack.instruments.e3631a import E3631ATwin, SupplyErrors
from simrack.instruments.hp34401a import Hp34401ATwin, MeterErrors
from simrack.leads import Leads
from simrack.serve import Offer, ServedBench, ServedClock
from simrack.wired import Circuit, WiredWorld

MODELS = {"power": "E3631A", "generator": "33220A", "multimeter": "34401A", "oscilloscope": "DSO7104B"}
RESOURCES = {
    "power": "GPIB0::5::INSTR",
    "generator": "USB0::0x0957::0x0407::MY44021876::INSTR",
    "multimeter": "GPIB0::22::INSTR",
    "oscilloscope": "USB0::0x0957::0x175D::MY49520121::INSTR",
}
WIRES: Mapping[str, frozenset[Offer]] = {
    "power": frozenset({"tcp", "pty"}),
    "generator": frozenset({"tcp", "vxi11"}),
    "multimeter": frozenset({"tcp", "pty"}),
    "oscilloscope": frozenset({"tcp", "vxi11"}),
}


class Desk(Struct, frozen=True):
    """The World and its instruments by role.

    The supply is on the rails, the generator on `input`, the meter on `output`, the oscilloscope on both.
    """

    world: WiredWorld
    devices: Mapping[str, Device]

    @classmethod
    def build(cls, clock: Clock, circuit: Circuit | None = None, seed: int | None = None) -> Desk:
        """Build it on `clock`; with a `seed` instruments are specimens within their data sheets, else ideal."""
        attended = AttendedClock(clock)
        world = WiredWorld(attended, circuit)
        random = None if seed is None else np.random.default_rng(seed)

        def errors(kind: Any) -> Any:
            return kind.none() if random is None else kind.drawn(random)

        leads = Leads(world, "multimeter", {"input": "output"})
        channels = Leads(world, "oscilloscope", {"channel_1": "input", "channel_2": "output"})
        rails = {"P25V": "positive", "N25V": "negative"}
        devices: dict[str, Device] = {
            "power": E3631ATwin(world, rails=rails, errors=errors(SupplyErrors)),
            "generator": Agilent33220ATwin(world, errors(GeneratorErrors), node="input"),
            "multimeter": Hp34401ATwin(leads, node="input", errors=errors(MeterErrors)),
            "oscilloscope": Dso7104BTwin(channels, {1: "channel_1", 2: "channel_2"}, errors(ScopeErrors)),
        }
        attended.attend(*devices.values())
        return cls(world, devices)

    def by_resource(self) -> dict[str, Device]:
        """Return the instruments by their VISA resource names."""
        return {RESOURCES[role]: device for role, device in self.devices.items()}


def served_desk(clock: ServedClock, circuit: Circuit | None = None, seed: int | None = None) -> ServedBench:
    """Return a desk as it is served; a reset builds it anew."""
    built = Desk.build(clock, circuit, seed)
    rebuild = partial(served_desk, clock, circuit)
    return ServedBench(built.world, built.devices, MODELS, seed, rebuild, WIRES)


def circuit_in(file: Path) -> Circuit:
    """Return the value ``CIRCUIT`` that a Python file defines.

    Raises:
        ValueError: it defines none.
    """
    found = runpy.run_path(str(file)).get("CIRCUIT")
    if not isinstance(found, Circuit):
        raise ValueError(f"{file}: expected CIRCUIT = ..., a simrack.wired.Circuit, came {type(found).__name__}")  # noqa: TRY004  (what a user wrote)
    return found
