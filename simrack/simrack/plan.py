"""Plans of a rack: instruments, wires and wiring; of a command's words or of a bench file."""

from __future__ import annotations

import re
import runpy
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from msgspec import Struct, field
from msgspec.structs import replace

from simrack.device import Device
from simrack.faults import FaultScript
from simrack.models import Kind, SimulatedModel, model_named
from simrack.own import OwnBox, OwnInstrument
from simrack.serve import Offer
from simrack.wired import Circuit, Through
from simrack.world import World

OFFERS: Mapping[str, Offer] = {"TCP": "tcp", "VXI-11": "vxi11", "HiSLIP": "hislip", "serial line": "pty"}
UPSIDE_DOWN = {("E36312A", "output_3")}
"""Outputs whose class gives the sign of the rail that they are meant for, not that of their terminals."""
_STREAMS = {"rate table", "box"}
"""Kinds that are on byte streams alone."""
_LAN_PORT, _ADAPTER_PORT = 5025, 1234
_WORD = re.compile(r"(?:(?P<name>[\w-]+)=)?(?P<model>[\w-]+)(?::(?P<wires>[\w+]+))?")
_GPIB = re.compile(r"gpib([12]?\d|30)")
ADAPTER = "gpib"
"""What the adapter is called that has the instruments on GPIB behind it."""


class Place(Struct, frozen=True):
    """An instrument of a rack.

    Args:
        name: what it is called.
        model: what it is.
        wires: what it is served on; none are those of the real box.
        terminals: the node that each terminal goes to, `-NODE` the wrong way round, None nowhere.
        resource: its VISA resource name in this process; empty for one that is made up.
        resources: instead of it, what makes a device of its own for each of several names.
        gpib: its address behind the adapter; it is on no wire of its own then.
    """

    name: str
    model: SimulatedModel
    wires: frozenset[Offer] = frozenset()
    terminals: Mapping[str, str | None] = field(default_factory=dict)
    resource: str = ""
    resources: Mapping[str, Callable[[World], Device]] = field(default_factory=dict)
    gpib: int | None = None

    @property
    def box(self) -> frozenset[Offer]:
        """The wires of the real box."""
        return frozenset(OFFERS[each] for each in self.model.wires)

    def on(self, words: Iterable[str]) -> Place:
        """Return the instrument on the named interfaces; ValueError names an impossible one."""
        model, wires = self.model, [word for word in words if word]
        stream = model.kind in _STREAMS
        if not stream and len(wires) == 1 and (found := _GPIB.fullmatch(wires[0])):
            return replace(self, gpib=int(found[1]))
        known = {offer: offer for offer in OFFERS.values() if not stream or offer in {"tcp", "pty"}}
        if wrong := [word for word in wires if word not in known]:
            alone = "" if stream else ", or gpib0 to gpib30 alone"
            raise ValueError(f"{model.name} can be on {', '.join(known)}{alone}, not on {wrong[0]!r}")
        return replace(self, wires=frozenset(known[word] for word in wires))  # type: ignore[index]  # it is one of them

    def made_up(self, number: int) -> str:
        """Return a VISA resource name for the instrument of this number: on LAN if it has that, else on GPIB."""
        wires = self.wires or self.box
        if self.gpib is not None:
            return f"GPIB0::{self.gpib}::INSTR"
        if self.model.kind == "adapter":
            return f"TCPIP0::{self.name}::{_ADAPTER_PORT}::SOCKET"
        if "vxi11" in wires:
            return f"TCPIP0::{self.name}::inst0::INSTR"
        if "hislip" in wires:
            return f"TCPIP0::{self.name}::hislip0::INSTR"
        if self.wires == {"tcp"}:
            return f"TCPIP0::{self.name}::{_LAN_PORT}::SOCKET"
        return f"ASRL{number}::INSTR" if self.wires or self.model.kind in _STREAMS else f"GPIB0::{number}::INSTR"


class Plan(Struct, frozen=True):
    """Plan of a bench.

    Args:
        places: the instruments.
        links: the circuits, as of the World.
        loads_ohm: resistances to ground, by node.
        faults: what goes wrong, and when.
        seed: of the specimens; None are ideal ones.
    """

    places: tuple[Place, ...]
    links: Mapping[str, Through]
    loads_ohm: Mapping[str, float] = field(default_factory=dict)
    faults: FaultScript = field(default_factory=lambda: FaultScript(()))
    seed: int | None = None

    @property
    def circuits(self) -> str:
        """Circuits between the nodes, for people."""
        return ", ".join(
            f"{'wire' if link.circuit is None else link.circuit.name} from {link.node} to {node}"
            for node, link in self.links.items()
        )

    def wires_asked_for(self) -> dict[str, frozenset[Offer]]:
        """Return the wires of the instruments of which they were said."""
        return {place.name: place.wires for place in self.places if place.wires or place.gpib is not None}


class OwnModel(SimulatedModel, frozen=True):
    """A custom instrument: `made` is its class, or makes it."""

    made: Any = OwnInstrument

    @property
    def outputs(self) -> tuple[str, ...]:
        """Its terminals that feed nodes."""
        return getattr(self.made, "outputs", ())

    @property
    def inputs(self) -> tuple[str, ...]:
        """Its terminals that look at nodes."""
        return getattr(self.made, "inputs", ())

    def load(self) -> Any:
        """Return its class."""
        return self.made


def plan_of(words: Iterable[str]) -> Plan:
    """Return the plan of a command's words, each a file or ``[NAME=]MODEL[:WIRE[+WIRE...]]``.

    A file is one of pyvisa-sim's (.yaml), or Python that defines CIRCUIT, custom instruments, or both; those that
    no word names are there once. Without any instrument it is the desk: a supply, a generator, a multimeter and an
    oscilloscope.

    Raises:
        ValueError: there is no such model or wire, a name is given twice, or a file defines nothing of use.
        OSError: a file cannot be read.
    """
    circuit: Circuit | None = None
    own: dict[str, SimulatedModel] = {}
    others, places = [], list[Place]()
    for word in words:
        if word.endswith((".yaml", ".yml")):
            places += _dialogues(Path(word))
        elif not word.endswith(".py"):
            others.append(word)
        else:
            found = runpy.run_path(word)
            made = own_models(found)
            if not made or "CIRCUIT" in found:
                circuit = _circuit(found, word)
            own |= made
    for word in others:
        places.append(_placed(word, own, {each.name for each in places}))
    named = {place.model.name for place in places}
    places += [_placed(name, own, {each.name for each in places}) for name in own if name not in named]
    return Plan(with_adapter(_wired(places or DESK)), {"output": Through("input", circuit)})


def _dialogues(file: Path) -> list[Place]:
    """Return the devices of a file of pyvisa-sim's; its reader is imported only if there is one."""
    said = import_module("simrack.dialogue").DialogueFile(file)
    return [
        Place(name, OwnModel(name, "own", "", ("TCP", "serial line"), made=made), resources=said.by_resource(name))
        for name, made in said.by_device().items()
    ]


def own_models(module: Mapping[str, Any]) -> dict[str, SimulatedModel]:
    """Return the instruments that a module defines, by the names of their classes."""
    kinds: dict[type, Kind] = {OwnInstrument: "own", OwnBox: "box"}
    found: dict[str, SimulatedModel] = {}
    for made in module.values():
        kind = next((kinds[each] for each in getattr(made, "__mro__", ()) if each in kinds), None)
        if kind is not None and made.__module__ == module["__name__"]:
            found[made.__name__] = OwnModel(made.__name__, kind, "", made.wires, made=made)
    return found


def _placed(word: str, own: Mapping[str, SimulatedModel], taken: set[str]) -> Place:
    found = _WORD.fullmatch(word)
    if found is None:
        raise ValueError(f"expected a file.py or [NAME=]MODEL[:WIRE[+WIRE...]], got {word!r}")
    model = model_named(found["model"], own)
    usual = [model.name, *(f"{model.name}-{number}" for number in range(2, len(taken) + 2))]
    name = found["name"] or next(each for each in usual if each not in taken)
    if name in taken:
        raise ValueError(f"two instruments are called {name!r}")
    return Place(name, model).on((found["wires"] or "").split("+"))


def with_adapter(places: Sequence[Place]) -> tuple[Place, ...]:
    """Return places with the adapter, if one of them is behind it; ValueError where two are at one address."""
    addresses = [place.gpib for place in places if place.gpib is not None]
    if twice := [each for each in addresses if addresses.count(each) > 1]:
        raise ValueError(f"two instruments are at GPIB address {twice[0]}")
    if addresses and any(place.name == ADAPTER for place in places):
        raise ValueError(f"{ADAPTER!r} is the name of the GPIB adapter; choose another name for the instrument")
    model = SimulatedModel("GPIB-ETHERNET", "adapter", "gpib_adapter:GpibAdapter", ("TCP", "serial line"))
    return (*places, Place(ADAPTER, model)) if addresses else tuple(places)


def _wired(places: Iterable[Place]) -> tuple[Place, ...]:
    """Say of each terminal where it goes.

    The first supply is on the rails, the first generator on `input`, further outputs are on nodes of their own. Meters
    are on `output`, oscilloscopes on both.
    """
    seen: set[str] = set()
    wired = []
    for place in places:
        kind, first = place.model.kind, place.model.kind not in seen
        usual = {"channel_1": "input", "channel_2": "output", "channel_3": None, "channel_4": None}
        node = {each: usual.get(each, "output") for each in place.model.inputs}
        node |= {each: f"{place.name}.{each}" for each in place.model.outputs}
        if first and kind == "generator":
            node["output_1"] = "input"
        if first and kind == "supply":
            node |= {"output_2": "positive", "output_3": "negative"}
            node |= {each: f"-{node[each]}" for model, each in UPSIDE_DOWN if model == place.model.name}
        seen.add(kind)
        wired.append(replace(place, terminals=node))
    return tuple(wired)


DESK = (
    Place("power", model_named("E3631A"), resource="GPIB0::5::INSTR"),
    Place("generator", model_named("33220A"), resource="USB0::0x0957::0x0407::MY44021876::INSTR"),
    Place("multimeter", model_named("34401A"), resource="GPIB0::22::INSTR"),
    Place("oscilloscope", model_named("DSO7104B"), resource="USB0::0x0957::0x175D::MY49520121::INSTR"),
)


def circuit_in(file: Path) -> Circuit:
    """Return the value ``CIRCUIT`` that a Python file defines.

    Raises:
        ValueError: it defines none.
    """
    return _circuit(runpy.run_path(str(file)), str(file))


def _circuit(module: Mapping[str, Any], file: str) -> Circuit:
    found = module.get("CIRCUIT")
    if not isinstance(found, Circuit):
        raise ValueError(f"{file}: expected CIRCUIT = ..., a simrack.wired.Circuit, got {type(found).__name__}")  # noqa: TRY004  (what a user wrote)
    return found
