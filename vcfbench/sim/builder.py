"""Builds a simulated bench behind its resources: one World, and the instruments that look at it.

Every random stream comes from the seed and the name of what draws from it, so that an instrument more or less
changes nothing for the others.
"""

import inspect
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import chain, count
from threading import Lock
from typing import Any, cast

from msgspec import Struct, to_builtins
from numpy.random import Generator, SeedSequence, default_rng
from simrack.attendance import AttendedClock
from simrack.device import Device
from simrack.leads import Leads, LoadingLeads
from simrack.scpi.dialect import LAN
from simrack.scpi.twin import tell_apart
from simrack.wires import serial_backend
from simrack.wires.handshake_line import line_of
from simrack.wires.serial_line import CharacterFrame, ThreeWireLine

from vcfbench.clock import Clock
from vcfbench.errors import ConfigError
from vcfbench.models import find_model
from vcfbench.sim.simulation import physical_parameters, simulation_of, twins
from vcfbench.sim.world import World
from vcfbench.station.description import BenchDescription, SerialSettings
from vcfbench.station.overrides import overridden, part_way

_STREAMS = {
    "world": 0,
    "power": 1,
    "rate_source": 2,
    "multimeter": 3,
    "oscilloscope": 4,
    "rate_table": 5,
    "vibration_source": 6,
    "v_vc_meter": 7,
    "chamber": 8,
}
"""Number of each random stream; numbers are never given again, so that a seed keeps its meaning."""

_DRIVES = {"rate_source": "v_vc", "vibration_source": "vibration"}
"""What the output of each generator is wired to."""


def instrument_errors(description: BenchDescription, seed: int) -> dict[str, Any]:
    """Return the imperfections of every simulated instrument, as the bench file asks for them."""
    asked = simulation_of(description).errors
    known = description.uncertainty.generator_ranges_v
    return {
        role: _errors(
            twin.errors_class,
            getattr(asked, role),
            default_rng(_sequence(seed, role)),
            known if role == "rate_source" else None,
        )
        for role, twin in twins(description).items()
    }


class SimulatedBench(Struct, frozen=True):
    """World and instruments of a simulated bench; `devices` by role."""

    description: BenchDescription
    world: World
    devices: Mapping[str, Device]

    @classmethod
    def build(cls, description: BenchDescription, seed: int, clock: Clock) -> "SimulatedBench":
        """Build the bench on `clock`; the same seed gives the same bench."""
        attended = AttendedClock(clock)
        world = World(attended, physical_parameters(description), _integer(_sequence(seed, "world")))
        errors = instrument_errors(description, seed)
        # The World as the instruments see it that have leads, or an input of their own
        wiring, caught = description.wiring, world.mains
        channels = wiring.oscilloscope.channels()
        seen: dict[str, Any] = {
            "multimeter": Leads(world, "multimeter", {"input": wiring.multimeter}, caught.in_meter_leads),
            "oscilloscope": Leads(world, "oscilloscope", {f"channel_{n}": node for n, node in channels.items()}),
        }
        if description.v_vc_meter is not None:
            seen["v_vc_meter"] = LoadingLeads(
                world,
                "v_vc_meter",
                {"input": wiring.v_vc_meter},
                caught.in_v_vc_meter_leads,
                load_ohm=getattr(errors["v_vc_meter"], "input_ohm", math.inf),
            )
        devices: dict[str, Device] = {}
        outputs = description.each
        leads = [seen["multimeter"]]
        for number, own in enumerate(outputs[1:], 2):
            noise = _integer(_sequence(seed, "world", number))
            beside = World(attended, physical_parameters(own), noise, beside=world)
            leads.append(Leads(beside, f"multimeter-{number}", {"input": wiring.multimeter}, caught.in_meter_leads))
        if description.power is None:  # the device feeds itself, and is on
            own_v = physical_parameters(description).supply.nominal_v
            world.set_rail("positive", own_v)
            world.set_rail("negative", -own_v)  # of one supply nobody looks at it
        for role, twin in twins(description).items():
            kind, around = twin, _surroundings(role, description, seed)
            if role == "multimeter":
                around |= {"axes": _axes(outputs, 0, leads)}
            devices[role] = _made(kind, seen.get(role, world), errors[role], around)
        for number, own in enumerate(outputs[1:], 2):
            if any(own.output_resource == each.output_resource for each in outputs[: number - 1]):
                continue  # an axis of a stream that is there
            kind, asked = twins(own)["multimeter"], simulation_of(own).errors.multimeter
            drawn = _errors(kind.errors_class, asked, default_rng(_sequence(seed, "multimeter", number)))
            around = _surroundings("multimeter", own, seed, number) | {"axes": _axes(outputs, number - 1, leads)}
            devices[f"multimeter-{number}"] = _made(kind, leads[number - 1], drawn, around)
        tell_apart(devices.values())
        attended.attend(*devices.values())
        return cls(description, world, devices)

    @property
    def clock(self) -> Clock:
        """The clock that everything on this bench waits on."""
        return self.world.clock

    def stream_resources(self) -> dict[str, str]:
        """Return the resources of the streams, by the role of the device that sends each."""
        return self.description.stream_resources

    def visa_devices(self) -> dict[str, Device]:
        """Return the devices on VISA by the resource names of the bench file; a serial one at the end of its line."""
        apart = {"rate_table", *self.stream_resources()}
        parts = {role: part_of(self.description, role) for role in self.devices if role not in apart}
        devices = {part.resource: self.devices[role] for role, part in parts.items()}
        for part in parts.values():  # a converter gives a box without RS-232 a serial port, which knows no exchanges
            engine = getattr(devices[part.resource], "engine", None)  # one's own instrument may speak no SCPI
            if engine is not None and part.resource.upper().startswith("ASRL") and not _is_serial(part):
                engine.interface = LAN
        for part in filter(_is_serial, parts.values()):  # its line is set on its front panel as the bench file has it
            line = SerialSettings() if part.serial is None else part.serial
            frame = CharacterFrame(float(line.baud_rate), line.data_bits, line.parity, float(line.stop_bits))
            device: Any = devices[part.resource]
            devices[part.resource] = line_of(device.engine.dialect)(device, self.clock, frame, by_message=True)
        return devices

    def table_port(self) -> Device:
        """Return the device behind the port of the rate table: at the end of its line, if the bench file names one."""
        table = self.devices["rate_table"]
        named = self.description.rate_table
        if named is None or "://" in named.resource:  # a URL of pyserial's is no port
            return table
        frame = getattr(table, "frame", CharacterFrame(stop_bits=1.0))
        line = ThreeWireLine(table, self.clock, frame, by_message=True)
        cast("AttendedClock", self.clock).attend(line)  # each message arrives at its own instant
        return line

    @contextmanager
    def registered(self) -> Iterator[str]:
        """Make the instruments reachable for PyVISA and pyserial; yield the handle.

        The library is ``{handle}@vcfbench``, the rate table's port ``sim://{handle}``.
        """
        from simrack.wires.visa_backend import SimVisaLibrary  # noqa: PLC0415 - a served bench needs no PyVISA

        with _own_handle(self.description.name) as handle:
            try:
                SimVisaLibrary.register(handle, self.visa_devices(), self.clock)
            except ValueError as error:
                raise ConfigError(f"{self.description.name}: a resource is not a VISA resource name: {error}") from None
            if "rate_table" in self.devices:
                serial_backend.register(handle, self.table_port(), self.clock)
            for role in self.stream_resources():
                serial_backend.register(f"{handle}-{role}", self.devices[role], self.clock)
            try:
                yield handle
            finally:
                serial_backend.unregister(handle)
                for role in self.stream_resources():
                    serial_backend.unregister(f"{handle}-{role}")
                SimVisaLibrary.unregister(handle)


def part_of(description: BenchDescription, role: str) -> Any:
    """Return the part of the bench file that a simulated instrument is of, of several outputs by their number."""
    name, _, number = role.partition("-")
    return (description.devices or ())[int(number) - 1].multimeter if number else getattr(description, name)


def _made(kind: Any, world: Any, errors: Any, around: Mapping[str, Any]) -> Any:
    """Return a simulated instrument, given those of its surroundings that it takes."""
    takes = inspect.signature(kind).parameters
    taken = {name: value for name, value in around.items() if name in takes and value is not None}
    return kind(world, errors=errors, **taken)


def _axes(outputs: Sequence[BenchDescription], first: int, leads: Sequence[Leads]) -> list[tuple[Leads, Any]]:
    """Return the further fields of the stream of the device numbered `first`, with the output that each has."""
    where = outputs[first].output_resource
    later = list(zip(outputs, leads, strict=True))[first + 1 :]
    streams = [(lead, own.stream) for own, lead in later if own.output_resource == where]
    return [(lead, to_builtins(stream.value)) for lead, stream in streams if stream]


def _is_serial(part: Any) -> bool:
    """Return True if an instrument that has RS-232 is on a serial port."""
    row = find_model(part.like or part.model)
    return row is not None and row.rs232 and part.resource.upper().startswith("ASRL")


def _surroundings(role: str, description: BenchDescription, seed: int, number: int = 1) -> dict[str, Any]:
    """Return the settings that the instrument of `role` may take from its bench."""
    part, wiring = getattr(description, role), description.wiring
    noise_seed = _integer(_sequence(seed, role, number))
    if role == "rate_table":
        # The header of a simulated table's replies: error code and length, as on every byte stream. Which of the two
        # words' byte orders a real one has is unknown; a driver on `auto` takes either
        header = "u32le2" if part.reply_header == "auto" else part.reply_header
        return {"axis": part.axis, "header": header, "microsteps_per_deg": part.steps_per_deg, "noise_seed": noise_seed}
    return {
        "rails": {wiring.rails.positive: "positive"}
        | ({} if wiring.rails.single else {wiring.rails.negative: "negative"}),
        "node": _DRIVES.get(role, "input"),
        "channels": {n: f"channel_{n}" for n in wiring.oscilloscope.channels()},
        "mains_hz": float(description.site.mains_hz),
        "interface": "rs232" if _is_serial(part) else None,
        "noise_seed": noise_seed,
        "model": part.model,
        "stream": to_builtins(description.stream),
    }


def _errors(
    kind: Any, asked: str | dict[str, Any], random: Generator, ranges_v: tuple[float, ...] | None = None
) -> Any:
    """Return the imperfections that were asked for; those drawn have the ranges that the bench file knows, if any."""
    single = {name: value for name, value in asked.items() if name != "drawn"} if isinstance(asked, dict) else {}
    share = asked.get("drawn", 0.0) if isinstance(asked, dict) else float(asked == "drawn")
    if not share:
        return overridden(kind.none(), single)
    specimens = kind.none(), kind.drawn(random)
    if ranges_v is not None:
        specimens = specimens[0].with_ranges(sorted(ranges_v)), specimens[1].with_ranges(sorted(ranges_v))
    return overridden(specimens[1] if share == 1.0 else part_way(*specimens, share), single)


def _sequence(seed: int, name: str, number: int = 1) -> SeedSequence:
    return SeedSequence(seed, spawn_key=(_STREAMS[name], *([number] if number > 1 else [])))


def _integer(sequence: SeedSequence) -> int:
    return int(sequence.generate_state(1)[0])


_HANDLES: set[str] = set()  # PyVISA and pyserial find a bench by name alone, so names in use must be known here
_RESERVING = Lock()


@contextmanager
def _own_handle(name: str) -> Iterator[str]:
    """Reserve `name`, or the first of ``name-2``, ``name-3``... that is free."""
    numbered = chain([name], (f"{name}-{number}" for number in count(2)))
    with _RESERVING:
        handle = next(free for free in numbered if free.lower() not in _HANDLES)
        _HANDLES.add(handle.lower())
    try:
        yield handle
    finally:
        _HANDLES.discard(handle.lower())
