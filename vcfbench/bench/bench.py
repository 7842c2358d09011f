"""An open bench: every instrument opened, identified, within its limits, and made safe whatever happens."""

from __future__ import annotations

import warnings
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from vcfbench.bench.file import described
from vcfbench.bench.holding import Holding, Watch
from vcfbench.bench.limits import LimitChecks, LimitedGenerator, LimitedRateTable, LimitedSupply
from vcfbench.bench.opening import open_role
from vcfbench.bench.roles import filled_roles, require_still, safe_action
from vcfbench.bench.signals import ControlClock, StopSignals
from vcfbench.bench.station import station
from vcfbench.errors import BenchError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path
    from types import TracebackType
    from typing import Self

    from vcfbench.bench.description import BenchDescription
    from vcfbench.bench.safety import SafetyStack
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


@dataclass(frozen=True, slots=True, repr=False, eq=False)
class Bench:
    """The instruments of an open bench by role, each within the bench's limits.

    `clock` is bench time with a safe point at every wait; `identities` says by role who answered; `safe_reports`
    fills when the bench is left: at the end of a ``with``, by :meth:`close`, or when Python ends.
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
    holding: Holding
    vibration_source: FunctionGenerator | None = None

    @property
    def simulated(self) -> bool:
        """Tell whether the bench is simulated."""
        return self.description.simulated

    @property
    def safe_reports(self) -> list[SafeReport]:
        """What making safe came to, once the bench was left."""
        return self.holding.reports

    @property
    def closed(self) -> bool:
        """Tell whether the bench was left."""
        return self.holding.closed

    def close(self) -> None:
        """Make everything safe and close it; does nothing when that is done already.

        Raises:
            NotSafe: something could not be made safe.
        """
        self.holding.leave()

    def __enter__(self) -> Self:
        self.holding.watch()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.holding.leave(error)

    def __repr__(self) -> str:
        return f"<Bench {self.description.name}, {'closed' if self.closed else 'open'}>"

    def __del__(self) -> None:
        """Make safe what nobody can command any more."""
        if not self.holding.closed:
            try:
                words = f"{self!r} was never closed; it is made safe now"
                warnings.warn(words, ResourceWarning, stacklevel=2, source=self)
            finally:  # a warning may be an error
                self.holding.abandon("nothing referred to it any more")


def open_bench(
    bench: BenchDescription | Path | str | None = None,
    *,
    seed: int | None = None,
    speed: str | float | None = None,
    signals: StopSignals | None = None,
    build: Builder | None = None,
) -> Bench:
    """Open every instrument of the bench; everything is made safe when it is left, however it is left.

    To be used in a ``with``, or left by its `close`; what is still open when Python ends is made safe then.

    `bench` is a description, a bench file, or the name of an embedded bench; None is the simulated paper bench.
    `seed` and `speed` are for simulated benches: by default the seed of the bench file, and as fast as it goes.
    While it opens, and inside of a ``with``, SIGINT and SIGTERM raise Aborted at the next safe point, a second one at
    once. Outside of a ``with``, SIGINT is Python's, and SIGTERM ends Python with code 4, the bench made safe. Who
    watches for them already, before and after, hands over his `signals`. `build` builds what a simulated bench stands
    on, in place of `SimulatedBench.build`: to put something between its instruments and their drivers, or to look
    behind them.

    Raises:
        ConfigError: the bench file cannot be used, or a real bench was asked for a speed.
        BenchError: the bench is in use, or instruments did not open; the message names them all.
        InterlockError: the table was found turning.
        NotSafe: something was found on, or turning, and could not be made safe.
    """
    description = described(bench)
    stops = signals or StopSignals()
    holding: Holding | None = None
    with ExitStack() as stack:
        watch = Watch(None if signals else stops)
        stack.callback(watch.end)
        watch.begin()
        stand = stack.enter_context(station(description, seed, speed, build))
        holding = Holding(description.name, stand, stops, watch, stack.pop_all())
    try:
        opened = _open_all(description, stand, holding.safety, stops)
        require_still(opened.instruments["rate_table"])
        opened_bench = _bench(description, ControlClock(stand.clock, stops), stand.seed, opened, holding)
        watch.end()
    except BaseException as error:
        holding.leave(error)
        raise
    return opened_bench


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


def _bench(description: BenchDescription, clock: Clock, seed: int | None, opened: _Opened, holding: Holding) -> Bench:
    checks, instruments = LimitChecks.of(description), opened.instruments
    vibration = instruments.get("vibration_source")
    return Bench(
        description=description,
        clock=clock,
        seed=seed,
        identities=opened.identities,
        power=LimitedSupply(instruments["power"], checks),
        rate_source=LimitedGenerator(instruments["rate_source"], checks),
        multimeter=instruments["multimeter"],
        oscilloscope=instruments["oscilloscope"],
        rate_table=LimitedRateTable(instruments["rate_table"], checks),
        holding=holding,
        vibration_source=None if vibration is None else LimitedGenerator(vibration, checks),
    )
