"""An open bench: every instrument opened, identified, within its limits, and made safe whatever happens."""

from __future__ import annotations

from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from vcfbench.bench.limits import LimitedGenerator, LimitedRateTable, LimitedSupply
from vcfbench.bench.opening import open_role
from vcfbench.bench.roles import filled_roles, require_still, safe_action
from vcfbench.bench.safety import LeaveNow, SafetyStack, not_safe
from vcfbench.bench.signals import ControlClock, StopSignals
from vcfbench.bench.station import station
from vcfbench.errors import BenchError, NotSafe

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from vcfbench.bench.description import BenchDescription
    from vcfbench.bench.station import Builder, Station
    from vcfbench.clock import Clock
    from vcfbench.interfaces import (
        FunctionGenerator,
        Identity,
        Multimeter,
        Oscilloscope,
        PowerSupply,
        RateTable,
        SafeReport,
    )

__all__ = ["Bench", "open_bench"]


@dataclass(frozen=True, slots=True)
class Bench:
    """The instruments of an open bench by role, each within the bench's limits.

    `clock` is bench time with a safe point at every wait; `identities` says by role who answered; `safe_reports`
    fills when the bench is left.
    """

    description: BenchDescription
    clock: Clock
    seed: int | None
    identities: Mapping[str, Identity]
    power: PowerSupply
    rate_source: FunctionGenerator
    multimeter: Multimeter
    oscilloscope: Oscilloscope
    rate_table: RateTable
    vibration_source: FunctionGenerator | None = None
    safe_reports: list[SafeReport] = field(default_factory=list)

    @property
    def simulated(self) -> bool:
        """Tell whether the bench is simulated."""
        return self.description.simulated


@contextmanager
def open_bench(
    description: BenchDescription,
    *,
    seed: int | None = None,
    speed: str | float | None = None,
    signals: StopSignals | None = None,
    build: Builder | None = None,
) -> Iterator[Bench]:
    """Open every instrument of the bench; make everything safe when left, however it is left.

    `seed` and `speed` are for simulated benches: by default the seed of the bench file, and as fast as it goes.
    SIGINT and SIGTERM raise Aborted at the next safe point, a second one at once. Who watches for them already, before
    and after, hands over his `signals`. `build` builds what a simulated bench stands on, in place of
    `SimulatedBench.build`: to put something between its instruments and their drivers, or to look behind them.

    Raises:
        ConfigError: a real bench was asked for a speed.
        BenchError: the bench is in use, or instruments did not open; the message names them all.
        InterlockError: the table was found turning.
        NotSafe: on leaving, something could not be made safe.
    """
    with nullcontext(signals) if signals else StopSignals() as stops, station(description, seed, speed, build) as stand:
        safety = SafetyStack(stand.clock, patience=stand.patience)
        reports: list[SafeReport] = []
        under_way: BaseException | None = None
        try:
            try:
                opened = _open_all(description, stand, safety, stops)
                require_still(opened.instruments["rate_table"])
                yield _bench(description, ControlClock(stand.clock, stops), stand.seed, opened, reports)
            except BaseException as error:
                under_way = error
                raise
            finally:
                stops.unwind()
        finally:
            _leave(safety, stops, reports, under_way)


@dataclass(frozen=True, slots=True)
class _Opened:
    """What was opened, by role."""

    instruments: dict[str, Any] = field(default_factory=dict)
    identities: dict[str, Identity] = field(default_factory=dict)


def _open_all(description: BenchDescription, stand: Station, safety: SafetyStack, signals: StopSignals) -> _Opened:
    """Open every role; try them all before giving up, so that all that is wrong is told at once."""
    opened = _Opened()
    failures: list[BenchError] = []
    for role in filled_roles(description):
        signals.safe_point()
        try:
            instrument, opened.identities[role.name] = open_role(role.name, description, stand)
        except BenchError as error:
            failures.append(error)
            continue
        safety.register(safe_action(role, instrument, description))
        opened.instruments[role.name] = instrument
    if failures:
        raise _all(failures)
    return opened


def _all(failures: list[BenchError]) -> BenchError:
    """Return one error for `failures`: itself if there is one, else one that tells them all."""
    error = failures[0]
    if len(failures) > 1:
        error = BenchError(f"{len(failures)} instruments did not open: {'; '.join(map(str, failures))}")
    error.step = "opening the bench"
    return error


def _bench(
    description: BenchDescription, clock: Clock, seed: int | None, opened: _Opened, reports: list[SafeReport]
) -> Bench:
    limits, instruments = description.limits, opened.instruments
    vibration = instruments.get("vibration_source")
    return Bench(
        description=description,
        clock=clock,
        seed=seed,
        identities=opened.identities,
        power=LimitedSupply(instruments["power"], limits, description.wiring.rails),
        rate_source=LimitedGenerator(instruments["rate_source"], limits),
        multimeter=instruments["multimeter"],
        oscilloscope=instruments["oscilloscope"],
        rate_table=LimitedRateTable(instruments["rate_table"], limits),
        vibration_source=None if vibration is None else LimitedGenerator(vibration, limits),
        safe_reports=reports,
    )


def _leave(
    safety: SafetyStack, signals: StopSignals, reports: list[SafeReport], under_way: BaseException | None
) -> None:
    """Make everything safe, close it, and raise NotSafe from what is under way if something is not."""
    signals.unwind()
    try:
        reports += safety.make_safe()
        error = not_safe(reports)
    except LeaveNow:
        error = NotSafe("NOT SAFE: making safe was ended by a third signal", hint="look at every instrument")
    signals.close()
    safety.close()
    if error is None:
        return
    if isinstance(under_way, BenchError):
        error.hint = f"{error.hint}; before that: {under_way}"
    raise error from under_way
