"""Simulated benches for tests: open on virtual time, or served on real wires; their physics and their faults at hand.

::

    with open_simulated(simulated(load_bench("lab.toml")), seed=3) as lab:
        lab.bench.power.enable_outputs()
        lab.fault("multimeter", "overload", at_s=20.0)
        assert lab.world.value_v("rail_positive") > 9.9
"""

import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

from msgspec import Struct, structs
from msgspec.structs import replace
from simrack.attendance import AttendedClock
from simrack.faults import Fault, FaultScript
from simrack.faulty_device import FaultInjector
from simrack.serve import MAX_SPEED, BenchServer, Control, ServedClock, ServerSettings, Wires

from vcfbench.bench.bench import Bench, open_bench
from vcfbench.clock import Clock
from vcfbench.errors import ConfigError
from vcfbench.files import dotted, parse_toml
from vcfbench.procedures.bench_file import described
from vcfbench.sim.builder import SimulatedBench
from vcfbench.sim.consistency import check_simulation
from vcfbench.sim.fault_scripts import parse_script, read_script
from vcfbench.sim.served import build_served, on_wires
from vcfbench.sim.simulation import chosen_seed
from vcfbench.sim.world import World
from vcfbench.station.consistency import invalid_values
from vcfbench.station.description import BenchDescription, Simulation, SimulationErrors
from vcfbench.station.layering import merged
from vcfbench.strict import converted

_GIVING_UP_S = 10.0


def simulated(
    bench: BenchDescription | Path | str | None = None,
    *,
    parameters: str | None = None,
    errors: str | None = None,
    overrides: Mapping[str, Any] | str | None = None,
) -> BenchDescription:
    """Return a bench to be simulated: a real station's file keeps its limits, wiring and procedure settings.

    Args:
        bench: a description, a bench file, or the name of an embedded bench; None is the paper's.
        parameters: ``paper`` or ``ideal`` gyroscope and PCB; None leaves what the file says.
        errors: ``none`` or ``drawn`` for every instrument; None leaves what the file says.
        overrides: single physical parameters by name (``vcfbench sim show``), dotted or nested, or as TOML text.

    Raises:
        ConfigError: the file cannot be used, or a value is not one.
    """
    description = described(bench)
    simulation = description.simulation or Simulation()
    given = parse_toml(overrides, "overrides") if isinstance(overrides, str) else overrides or {}
    override = simulation.override
    for name, value in given.items():
        table: Any = value
        for key in reversed(name.split(".")):
            table = {key: table}
        within = table.get("override")  # as `sim show` names them
        override = merged(override, within if isinstance(within, Mapping) else table)
    asked = {**structs.asdict(simulation), "override": override}
    if parameters is not None:
        asked["parameters"] = parameters
    if errors is not None:
        asked["errors"] = dict.fromkeys(SimulationErrors.__struct_fields__, errors)
    description = structs.replace(description, simulation=converted(asked, Simulation, dotted))
    for invalid_value in invalid_values(description):
        raise ConfigError(f"{invalid_value.path}: expected {invalid_value.expected}, got {invalid_value.came!r}")
    check_simulation(description, description.name)
    return description


class SimulatedLab(Struct, frozen=True):
    """An open simulated bench: the bench as procedures see it, the physics behind it, its faults."""

    bench: Bench
    world: World
    faults: FaultInjector

    def fault(self, instrument: str, kind: Any, **when: Any) -> None:
        """Start a fault now, or at `at_s`; further fields as of :class:`~simrack.faults.Fault`."""
        self.faults.add(Fault(instrument, kind, **{"at_s": self.bench.clock.now(), **when}))

    def play(self, script: Path | str) -> None:
        """Start all faults of a script: a file, or TOML text."""
        self.faults.play(_script(script))


def _script(script: Path | str) -> FaultScript:
    return read_script(script) if isinstance(script, Path) else parse_script(script, "fault script")


@contextmanager
def open_simulated(
    bench: BenchDescription | Path | str | None = None, *, seed: int | None = None, speed: str | float | None = None
) -> Iterator[SimulatedLab]:
    """Open a simulated bench on virtual time; leaving it runs the safety stack, as on a real one.

    Raises:
        NotSafe: on leaving, something could not be made safe, for instance because a fault keeps its link down.
    """
    behind = _Behind()
    with open_bench(described(bench), seed=seed, speed=speed, build=behind) as opened:
        yield SimulatedLab(opened, behind.world, behind.faults)


class _Behind:
    """Builds a bench with a fault injector before its instruments, and keeps the physics behind them."""

    world: World
    faults: FaultInjector

    def __call__(self, description: BenchDescription, seed: int, clock: Clock, /) -> SimulatedBench:
        built = SimulatedBench.build(description, seed, clock)
        self.world, self.faults = built.world, FaultInjector(built.devices, built.clock, seed)
        attended = cast("AttendedClock", built.clock)
        attended.attend(*self.faults.devices.values())  # what is planned must happen at its own instant
        return replace(built, devices=self.faults.devices)


class ServedLab(Struct, frozen=True):
    """A simulated bench on real wires: its description, ready resource strings, and its control port."""

    description: BenchDescription
    seed: int
    wires: Mapping[str, Wires]
    control_port: int

    def resource(self, role: str, interface: str = "tcp") -> str:
        """Return the resource string of an instrument on ``tcp``, ``vxi11``, ``hislip`` or ``pty``.

        Raises:
            ConfigError: it is not offered there.
        """
        found = getattr(self.wires[role], interface, None) if role in self.wires else None
        if found is None:
            raise ConfigError(f"{role} is not served on {interface}")
        return str(found)

    def control(self) -> Control:
        """Return a connection to the control port, to be closed: ``with served_bench.control() as control``."""
        return Control(self.control_port)

    def ask(self, do: str, **arguments: Any) -> Any:
        """Put one request to the control port: ``ask("set", name="applied_rate_deg_s", value=10.0)``."""
        with self.control() as control:
            return control.request(do, **arguments)

    def fault(self, instrument: str, kind: str, **when: Any) -> None:
        """Start a fault now, or at `at_s`; further fields as of :class:`~simrack.faults.Fault`."""
        self.ask("fault", instrument=instrument, kind=kind, **when)

    def reset(self, seed: int | None = None) -> None:
        """Reset the bench, with the same seed or another; time starts at 0, connections stay."""
        self.ask("reset", **({} if seed is None else {"seed": seed}))

    def on_wires(self) -> BenchDescription:
        """Return the bench as a run of this program opens it from outside: over TCP, led by its clock."""
        resources = {role: str(wires.tcp) for role, wires in self.wires.items()}
        return on_wires(self.description, resources, f"127.0.0.1:{self.control_port}")


@contextmanager
def serve_simulated(
    bench: BenchDescription | Path | str | None = None,
    *,
    seed: int | None = None,
    speed: float | None = None,
    faults: Path | str | None = None,
) -> Iterator[ServedLab]:
    """Serve a simulated bench from a thread of this process; `faults` is a fault script, a file or TOML text.

    Without `speed` (times real time) bench time jumps to whatever a client waits for.
    """
    script = FaultScript(()) if faults is None else _script(faults)
    settings = ServerSettings(control_port=0, faults=script)  # a free one: at 20220 others may look for a bench
    description = described(bench)
    used = chosen_seed(description, seed)
    clock = ServedClock(MAX_SPEED if speed is None else speed)
    with BenchServer(build_served(description, used, clock), clock, settings) as server:
        worker = threading.Thread(target=server.run, daemon=True)
        worker.start()
        try:
            yield ServedLab(description, used, server.wires, server.control.port)
        finally:
            server.stop()
            worker.join(_GIVING_UP_S)
