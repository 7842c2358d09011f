"""A bench that another process simulates: its instruments are on real wires, and its clock is there too.

:func:`build_served` is the other side: what that process serves.

Everything that waits is given that clock, so that a run takes no longer than its exchanges do, and gives the results of
the same run on a bench simulated in this process, to the last digit.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from types import MappingProxyType
from typing import Any

from msgspec import Struct, structs
from simrack.serve import Control, ControlError, RemoteClock, ServedBench, ServedClock
from simrack.serve.lockstep_port import LockstepPort
from simrack.wires import serial_backend

from vcfbench.errors import ConfigError, ConnectFailed, LinkLost
from vcfbench.models import find_model
from vcfbench.sim.simulation import chosen_seed
from vcfbench.station.description import BenchDescription, Served

_CONTROL = "control port"


class LockstepClock:
    """The clock of the served bench, with the bench's own errors: a `vcfbench.clock.Clock`."""

    __slots__ = ("_address", "_remote")

    def __init__(self, remote: RemoteClock, address: str) -> None:
        self._remote = remote
        self._address = address

    def now(self) -> float:
        """Return the bench time, s."""
        try:
            return self._remote.now()
        except ControlError as error:
            raise LinkLost(str(error), instrument=_CONTROL, resource=self._address) from error

    def sleep_until(self, instant_s: float) -> None:
        """Advance bench time to `instant_s`."""
        try:
            self._remote.sleep_until(instant_s)
        except ControlError as error:
            raise LinkLost(str(error), instrument=_CONTROL, resource=self._address) from error


class Lockstep(Struct, frozen=True):
    """A served bench whose time this program controls."""

    clock: LockstepClock
    seed: int | None
    """Seed that it was built from."""
    rate_table: str | None
    """The port of its table, for pyserial; None when it has none."""
    adjust: Callable[[str, Any], None]
    """Changes something of its world, as ``vcfbench sim ctl set`` does."""
    streams: Mapping[str, str] = MappingProxyType({})
    """The ports of its gyroscopes that speak numbers, by their resources."""


@contextmanager
def lockstep_bench(
    served: Served, rate_table: str | None, streams: Mapping[str, str] = MappingProxyType({})
) -> Iterator[Lockstep]:
    """Lead the time of a served bench whose table is at the resource `rate_table`, None: it has none.

    `streams` are the resources of its streams by their roles.

    Raises:
        ConnectFailed: no bench is served there, or another program leads its time: one run at a time.
    """
    host, port = served.address()
    try:
        control = Control(port, host)
    except ControlError as error:
        raise ConnectFailed(str(error), hint="start it with vcfbench sim serve") from error
    with control:
        try:
            status = control.request("status")
            wanted = {"rate_table": rate_table, **streams}
            wires = {role: status["instruments"].get(role, {}) for role in wanted}
            known = {
                role: where
                for role, where in wanted.items()
                if where is not None and where in {wires[role].get("tcp"), wires[role].get("pty")}
            }
            awaits = all(known.get(role) == where for role, where in wanted.items())
            remote, seed = RemoteClock(control, awaits=awaits), status["seed"]
        except ControlError as error:
            raise ConnectFailed(str(error), instrument=_CONTROL, resource=served.control) from error
        clock = LockstepClock(remote, served.control)

        def adjust(name: str, value: Any) -> None:
            try:
                control.request("set", name=name, value=value)
            except ControlError as error:
                raise ConfigError(f"{name}: {error}", instrument=_CONTROL, resource=served.control) from error

        with ExitStack() as stack:
            url = {role: stack.enter_context(_led_port(control, clock, role, at)) for role, at in known.items()}
            led = {where: url[role] for role, where in streams.items() if role in url}
            yield Lockstep(clock, seed, url.get("rate_table", rate_table), adjust, led)


@contextmanager
def _led_port(control: Control, clock: LockstepClock, role: str, resource: str) -> Iterator[str]:
    """Yield the URL of a port at `resource` that tells the server when it is waited on."""
    handle = resource.removeprefix("socket://")
    serial_backend.register_port(handle, LockstepPort(control, clock, role, resource))
    try:
        yield f"sim://{handle}"
    finally:
        serial_backend.unregister(handle)


def build_served(description: BenchDescription, seed: int | None, clock: ServedClock) -> ServedBench:
    """Build the served part of a simulated bench, from `seed` or the bench file's; its clock can reset it."""
    from vcfbench.sim.builder import SimulatedBench, part_of  # noqa: PLC0415  (there may be no simulation)

    used = chosen_seed(description, seed)
    built = SimulatedBench.build(description, used, clock)
    parts = {role: part_of(description, role) for role in built.devices}
    models = {role: str(part.dialect if role == "rate_table" else part.model) for role, part in parts.items()}
    # The interfaces of the real box of each role that a model fills
    rows = {role: find_model(part.like or part.model) for role, part in parts.items() if role != "rate_table"}
    wires = {role: row.wires for role, row in rows.items() if row is not None}

    def rebuild(seed: int | None) -> ServedBench:
        return build_served(description, seed, clock)

    return ServedBench(built.world, built.devices, models, used, rebuild, wires)


def served_places(control: str) -> tuple[str, dict[str, str]]:
    """Ask the control port `control` (``20220``, or with its host) for the served places.

    Return its address, as bench files have it, and the roles by their resources on TCP.

    Raises:
        ConfigError: it is no port.
        ConnectFailed: nobody serves there.
    """
    port = control.rpartition(":")[2]
    if not (port.isdigit() and 0 < int(port) < 65536):
        raise ConfigError(f"{control}: expected the control port that `vcfbench sim serve` has printed, as in 20220")
    try:
        with Control(int(port)) as session:
            instruments = session.request("status")["instruments"]
    except ControlError as error:
        raise ConnectFailed(f"no bench is served there: {error}", instrument=_CONTROL, resource=control) from error
    return f"127.0.0.1:{port}", {wires["tcp"]: role for role, wires in instruments.items() if wires["tcp"]}


def served_wires(control: str) -> list[str]:
    """Ask the control port as :func:`served_places` does; return all places of all instruments, on any wire."""
    try:
        with Control(int(control.rpartition(":")[2])) as session:
            instruments = session.request("status")["instruments"]
    except (ControlError, ValueError) as error:
        raise ConnectFailed(f"no bench is served there: {error}", instrument=_CONTROL, resource=control) from error
    return [str(where) for wires in instruments.values() for where in wires.values() if where]


def on_wires(description: BenchDescription, resources: Mapping[str, str], control: str) -> BenchDescription:
    """Return the bench of `description` with the resources of its wires, for other processes.

    Args:
        description: the simulated bench.
        resources: resource string of each role.
        control: host and port of the control port.
    """
    if description.several:
        parts = []
        common = {role: where for role, where in resources.items() if not role.startswith("multimeter")}
        for number, each in enumerate(description.each, 1):
            own = next(
                (role for role, where in description.stream_resources.items() if where == each.output_resource),
                "multimeter" if number == 1 else f"multimeter-{number}",
            )
            parts.append(on_wires(each, {**common, "multimeter": resources[own]}, control))
        return parts[0].with_devices(description.several, parts)
    roles = {role: structs.replace(getattr(description, role), resource=where) for role, where in resources.items()}
    for role, where in resources.items():  # a simulated serial line needs no pauses, and they would shift the readings
        if where.startswith("ASRL"):
            roles[role] = structs.replace(roles[role], serial_pause_s=0.0)
    gyro = description.gyro
    if description.stream and "multimeter" in resources:
        stream = structs.replace(description.stream, resource=resources["multimeter"])
        gyro = structs.replace(gyro, stream=stream)
    return structs.replace(
        description,
        **roles,
        gyro=gyro,
        title=f"{description.title}, served",
        simulation=None,
        served=Served(control=control),
    )
