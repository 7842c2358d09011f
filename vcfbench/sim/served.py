"""A bench that another process simulates: its instruments are on real wires, and its clock is there too.

:func:`build_served` is the other side: what that process serves.

Everything that waits is given that clock, so that a run takes no longer than its exchanges do, and gives the results of
the same run on a bench simulated in this process, to the last digit.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from functools import partial
from typing import Any

from msgspec import Struct, structs
from simrack.serve import Control, RemoteClock, ServedBench, ServedClock

from vcfbench.errors import ConfigError, ConnectFailed, LinkLost
from vcfbench.models import Wire, find_model
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
        from simrack.serve import ControlError  # noqa: PLC0415

        try:
            return self._remote.now()
        except ControlError as error:
            raise LinkLost(str(error), instrument=_CONTROL, resource=self._address) from error

    def sleep_until(self, instant_s: float) -> None:
        """Let bench time jump to `instant_s`."""
        from simrack.serve import ControlError  # noqa: PLC0415

        try:
            self._remote.sleep_until(instant_s)
        except ControlError as error:
            raise LinkLost(str(error), instrument=_CONTROL, resource=self._address) from error


class Lockstep(Struct, frozen=True):
    """A served bench whose time this program leads."""

    clock: LockstepClock
    seed: int | None
    """Seed that it was built from."""
    rate_table: str | None
    """The port of its table, for pyserial; None when it has none."""
    adjust: Callable[[str, Any], None]
    """Changes something of its world, as ``vcfbench sim ctl set`` does."""


@contextmanager
def lockstep_bench(served: Served, rate_table: str | None) -> Iterator[Lockstep]:
    """Lead the time of a served bench whose table is at the resource `rate_table`; None when it has none.

    Raises:
        ConnectFailed: no bench is served there, or another program leads its time: one run at a time.
    """
    from simrack.serve import Control, ControlError, RemoteClock  # noqa: PLC0415

    host, port = served.address()
    try:
        control = Control(port, host)
    except ControlError as error:
        raise ConnectFailed(str(error), hint="start it with vcfbench sim serve") from error
    with control:
        try:
            status = control.request("status")
            wires = status["instruments"].get("rate_table", {})
            known = rate_table if rate_table in {wires.get("tcp"), wires.get("pty")} else None
            remote, seed = RemoteClock(control, awaits=known == rate_table), status["seed"]
        except ControlError as error:
            raise ConnectFailed(str(error), instrument=_CONTROL, resource=served.control) from error
        clock = LockstepClock(remote, served.control)
        with nullcontext(rate_table) if known is None else _led_port(control, clock, known) as url:
            yield Lockstep(clock, seed, url, partial(_adjust, control, served.control))


def _adjust(control: Control, address: str, name: str, value: Any) -> None:
    from simrack.serve import ControlError  # noqa: PLC0415

    try:
        control.request("set", name=name, value=value)
    except ControlError as error:
        raise ConfigError(f"{name}: {error}", instrument=_CONTROL, resource=address) from error


@contextmanager
def _led_port(control: Control, clock: LockstepClock, resource: str) -> Iterator[str]:
    """Yield the URL of a port at `resource` that tells the server when it is waited on."""
    from simrack.serve.lockstep_port import LockstepPort  # noqa: PLC0415
    from simrack.wires import serial_backend  # noqa: PLC0415

    handle = resource.removeprefix("socket://")
    serial_backend.register_port(handle, LockstepPort(control, clock, "rate_table", resource))
    try:
        yield f"sim://{handle}"
    finally:
        serial_backend.unregister(handle)


def build_served(description: BenchDescription, seed: int | None, clock: ServedClock) -> ServedBench:
    """Build the served part of a simulated bench, from `seed` or the bench file's; its clock can build it anew."""
    from simrack.serve import ServedBench  # noqa: PLC0415

    from vcfbench.sim.builder import SimulatedBench, chosen_seed  # noqa: PLC0415  (there may be no simulation)

    used = chosen_seed(description, seed)
    built = SimulatedBench.build(description, used, clock)
    models = {role: _model(description, role) for role in built.devices}

    def rebuild(seed: int | None) -> ServedBench:
        return build_served(description, seed, clock)

    return ServedBench(built.world, built.devices, models, used, rebuild, _wires(description, built.devices))


def _wires(description: BenchDescription, roles: Iterable[str]) -> dict[str, frozenset[Wire]]:
    """Return the interfaces of the real box of each role that a model fills."""
    parts = {role: getattr(description, role) for role in roles if role != "rate_table"}
    rows = {role: find_model(part.like or part.model) for role, part in parts.items()}
    return {role: row.wires for role, row in rows.items() if row is not None}


def _model(description: BenchDescription, role: str) -> str:
    part = getattr(description, role)
    return str(part.dialect if role == "rate_table" else part.model)


def served_places(control: str) -> tuple[str, dict[str, str]]:
    """Ask the control port `control` (``20220``, or with its host) for the served places.

    Return its address, as bench files have it, and the roles by their resources on TCP.

    Raises:
        ConfigError: it is no port.
        ConnectFailed: nobody serves there.
    """
    from simrack.serve import Control, ControlError  # noqa: PLC0415

    port = control.rpartition(":")[2]
    if not (port.isdigit() and 0 < int(port) < 65536):
        raise ConfigError(f"{control}: expected the control port that `vcfbench sim serve` has printed, as in 20220")
    try:
        with Control(int(port)) as session:
            instruments = session.request("status")["instruments"]
    except ControlError as error:
        raise ConnectFailed(f"nothing is served there: {error}", instrument=_CONTROL, resource=control) from error
    return f"127.0.0.1:{port}", {wires["tcp"]: role for role, wires in instruments.items() if wires["tcp"]}


def on_wires(description: BenchDescription, resources: Mapping[str, str], control: str) -> BenchDescription:
    """Return the bench of `description` as it is seen from outside the process that serves it.

    Args:
        description: the simulated bench.
        resources: resource string of each role.
        control: host and port of the control port.
    """
    roles = {role: _moved(getattr(description, role), resource) for role, resource in resources.items()}
    return structs.replace(
        description, **roles, title=f"{description.title}, served", simulation=None, served=Served(control=control)
    )


def _moved(role: Any, resource: str) -> Any:
    """Return `role` at `resource`; a simulated serial line needs no pauses, and they would shift the readings."""
    pause = {"serial_pause_s": 0.0} if resource.startswith("ASRL") else {}
    return structs.replace(role, resource=resource, **pause)
