"""Ground of a bench: clock, wires, and the right to use them. Real and simulated differ here and nowhere else."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Protocol

from msgspec import Struct, field

from vcfbench.bench.simulated_instruments import require_all_served
from vcfbench.clock import Clock, PacedClock, VirtualClock, WallClock
from vcfbench.drivers.hands import Hands
from vcfbench.errors import ConfigError
from vcfbench.safety.lock import instrument_locks
from vcfbench.safety.roles import filled_roles
from vcfbench.station.description import BenchDescription, Served
from vcfbench.station.resources import require_apart

if TYPE_CHECKING:
    from vcfbench.sim.builder import SimulatedBench

FASTEST = "max"
_SLOWEST = 0.001


class Builder(Protocol):
    """Builds a simulated bench, as :meth:`vcfbench.sim.builder.SimulatedBench.build` does."""

    def __call__(self, description: BenchDescription, seed: int, clock: Clock, /) -> SimulatedBench:
        """Build the bench on `clock`; the same seed gives the same bench."""


class UnopenedBench(Struct, frozen=True):
    """A bench before its instruments are opened.

    `rate_table` is the port of the table, None on a bench that has none. `patience` is how many seconds of wall time a
    second of bench time may take; `seed` is None on a real bench. `adjust` changes the simulated world by hand, name
    and value as ``vcfbench sim ctl set`` takes them; None on a real bench, where hands do that. `left_by` says by role
    who died with an instrument and left it as it was. `hands` are those of the person at the bench.
    """

    clock: Clock
    visa_library: str
    rate_table: str | None
    seed: int | None = None
    patience: float = 1.0
    adjust: Callable[[str, Any], None] | None = None
    left_by: Mapping[str, str] = MappingProxyType({})
    hands: Hands = field(default_factory=Hands)
    streams: Mapping[str, str] = MappingProxyType({})
    """Where the streams of simulated gyroscopes are, by their resources; of others the bench file says it."""


def station(
    description: BenchDescription,
    seed: int | None,
    speed: str | float | None,
    build: Builder | None = None,
    *,
    roles: Collection[str] | None = None,
) -> AbstractContextManager[UnopenedBench]:
    """Return the context in which the bench's instruments can be opened; `build` as of `open_bench`.

    The instruments are locked for it, of a real bench and of a served one: all, or those of `roles`.

    Raises:
        ConfigError: `speed` is invalid, or the bench has its own.
        BenchError: another process has the bench, or nobody serves it.
    """
    pace = checked_pace(description, speed)
    if description.served is not None and description.steered:
        return _served(description, description.served, roles)
    return _real(description, roles) if description.simulation is None else _simulated(description, seed, pace, build)


def check_simulation(description: BenchDescription, source: str) -> None:
    """Check the simulated part of a bench file, named `source` in errors; raises ConfigError."""
    if description.simulation is not None:
        from vcfbench.sim.consistency import check_simulation as check  # noqa: PLC0415  # real benches load none of it

        check(description, source)


def check_instruments_apart(description: BenchDescription, source: str) -> None:
    """Check a bench file, named `source` in errors, as `require_instruments_apart` does, without the network."""
    try:
        _require_apart(description, ask=False)
    except ConfigError as error:
        raise ConfigError(f"{source}: {error}") from None


def require_instruments_apart(description: BenchDescription) -> None:
    """Check that no instrument has two roles.

    Making safe does without: whatever the bench file says, something may turn.

    Raises:
        ConfigError: one has, under two names.
    """
    _require_apart(description, ask=description.simulation is None)


def _require_apart(description: BenchDescription, *, ask: bool) -> None:
    resources = {each.name: getattr(description, each.name).resource for each in filled_roles(description)}
    require_apart(resources | outputs_of(description), ask=ask)


def outputs_of(description: BenchDescription) -> dict[str, str]:
    """Return the resources of the outputs of the further gyroscopes, by names like those of roles."""
    found = {each.multimeter.resource: f"multimeter of {each.name}" for each in reversed(description.devices or ())}
    return {role: resource for resource, role in found.items() if resource != description.output_resource}


def _locks(description: BenchDescription, roles: Collection[str] | None) -> AbstractContextManager[Mapping[str, str]]:
    locked = [each.name for each in filled_roles(description)] if roles is None else roles
    owned = {each: description.owned(each) for each in locked}
    return instrument_locks(description.name, owned | (outputs_of(description) if "multimeter" in locked else {}))


@contextmanager
def _real(description: BenchDescription, roles: Collection[str] | None) -> Iterator[UnopenedBench]:
    with _locks(description, roles) as left_by:
        yield UnopenedBench(WallClock(), description.visa_library, table_port(description), left_by=left_by)


def table_port(description: BenchDescription) -> str | None:
    """Return the place of the rate table in the bench file, or None."""
    return None if description.rate_table is None else description.rate_table.resource


@contextmanager
def _served(description: BenchDescription, served: Served, roles: Collection[str] | None) -> Iterator[UnopenedBench]:
    from vcfbench.sim.served import lockstep_bench  # noqa: PLC0415

    streams = description.stream_resources
    with _locks(description, roles) as left_by, lockstep_bench(served, table_port(description), streams) as lockstep:
        require_all_served(description, roles)
        yield UnopenedBench(
            lockstep.clock,
            description.visa_library,
            lockstep.rate_table,
            lockstep.seed,
            adjust=lockstep.adjust,
            left_by=left_by,
            streams=lockstep.streams,
        )


@contextmanager
def _simulated(
    description: BenchDescription, seed: int | None, pace: float | None, build: Builder | None
) -> Iterator[UnopenedBench]:
    from vcfbench.sim.builder import SimulatedBench  # noqa: PLC0415
    from vcfbench.sim.simulation import chosen_seed  # noqa: PLC0415

    used = chosen_seed(description, seed)
    clock = VirtualClock() if pace is None else PacedClock(pace)
    bench = (build or SimulatedBench.build)(description, used, clock)
    with bench.registered() as handle:
        patience = 1.0 if pace is None else max(1.0, 1.0 / pace)
        port = None if description.rate_table is None else f"sim://{handle}"
        wires, adjust = f"{handle}@vcfbench", partial(_adjust, bench)
        streams = {where: f"sim://{handle}-{role}" for role, where in bench.stream_resources().items()}
        yield UnopenedBench(bench.clock, wires, port, used, patience, adjust, streams=streams)


def _adjust(bench: SimulatedBench, name: str, value: Any) -> None:
    """Change the world of a bench that is simulated in this process."""
    from simrack.serve.adjust import adjustments_of  # noqa: PLC0415

    known = adjustments_of(bench.world, bench.devices)
    change = known[name].write if name in known else None
    if change is None:
        raise ConfigError(f"{name}: the simulated bench has no such quantity to change by hand")
    try:
        change(value)
    except ValueError as error:
        raise ConfigError(f"{name}: {error}") from error


def checked_pace(description: BenchDescription, speed: str | float | None) -> float | None:
    """Return the number of times that real time to run at, None for as fast as it goes.

    Raises:
        ConfigError: `speed` is invalid, or given for a real bench, which has its own, or of a served one, whose time
            jumps to what the run waits for.
    """
    if speed is not None and not description.steered:
        raise ConfigError(f"--speed {speed}: {description.name} has no [simulation], only such a bench has a speed")
    if description.served is not None and speed not in {None, FASTEST}:
        raise ConfigError(f"--speed {speed}: {description.name} is a served bench, which a run always takes at max")
    return None if speed is None or speed == FASTEST else pace_of(speed, f"--speed {speed}")


def pace_of(speed: str | float, where: str) -> float:
    """Return a speed as a number; ConfigError, which begins with `where`, when it is none, or too slow."""
    try:
        pace = float(speed)
    except ValueError:
        pace = math.nan
    if not _SLOWEST <= pace < math.inf:
        raise ConfigError(f"{where}: expected a number of at least {_SLOWEST:g}, or {FASTEST!r}")
    return pace
