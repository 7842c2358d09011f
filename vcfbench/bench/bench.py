"""An open bench: every instrument opened, identified, within its limits, and made safe in any case."""

import sys
import warnings
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext, suppress
from functools import partial
from mmap import mmap
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import Any, Final, Self

from msgspec import Struct, field
from msgspec.structs import asdict

from vcfbench.bench.ground import Builder, UnopenedBench, check_simulation, require_instruments_apart, station
from vcfbench.bench.holding import Holding, SignalWatch
from vcfbench.bench.opening import open_role
from vcfbench.bench.simulated_instruments import simulated_roles
from vcfbench.clock import Clock
from vcfbench.drivers.calls import Calls, attended
from vcfbench.drivers.hands import Hands
from vcfbench.errors import Aborted, BenchError
from vcfbench.interfaces import (
    FunctionGenerator,
    Identity,
    Multimeter,
    Operator,
    Oscilloscope,
    PowerSupply,
    RateTable,
    SafeReport,
    TemperatureChamber,
)
from vcfbench.safety.roles import Role, absent, needed_roles, require_still, safe_action
from vcfbench.safety.signals import ControlClock, StopSignals
from vcfbench.safety.stack import SafetyStack
from vcfbench.safety.trust import Trust, require_library
from vcfbench.safety.watchdog import SILENT_S, Watchdog
from vcfbench.station.description import BenchDescription
from vcfbench.station.file import described
from vcfbench.station.limits import LimitChecks, LimitedChamber, LimitedGenerator, LimitedRateTable, LimitedSupply

_RESERVE: Final = 64 << 20
"""Bytes for the threads that make safe, where a program has run out of memory; not touched, they cost none."""


class Bench(Struct, frozen=True, eq=False):
    """The instruments of an open bench by role, each within the bench's limits.

    `instruments` has those that were opened. Asking for another is a ConfigError that says what the bench file lacks.
    `clock` is bench time with a safe point at every wait. `identities` says by role who answered. `safe_reports` is
    filled when the bench is left: at the end of a ``with``, by `close`, or when Python ends. `adjust` changes a
    simulated world as hands would, by the names of ``vcfbench sim ctl``; None on a real bench. `left_by` says by
    role who died with an instrument before, and left it as it was. `hands` are those of the person at the bench.

    >>> with vcfbench.open_bench("ideal") as bench:
    ...     bench.multimeter.configure_dc_voltage(range_v=10.0, nplc=10.0)
    ...     print(f"{bench.multimeter.read_voltage_v():.2f} V")
    0.00 V
    """

    description: BenchDescription
    clock: Clock
    seed: int | None
    identities: Mapping[str, Identity]
    instruments: Mapping[str, Any]
    holding: Holding
    adjust: Callable[[str, Any], None] | None = None
    left_by: Mapping[str, str] = MappingProxyType({})
    hands: Hands = field(default_factory=Hands)

    @property
    def power(self) -> PowerSupply:
        """The supply of the PCB's rails."""
        return self._instrument("power")  # type: ignore[no-any-return]

    @property
    def rate_source(self) -> FunctionGenerator:
        """The generator of V_Vc."""
        return self._instrument("rate_source")  # type: ignore[no-any-return]

    @property
    def multimeter(self) -> Multimeter:
        """The voltmeter of the output."""
        return self._instrument("multimeter")  # type: ignore[no-any-return]

    @property
    def oscilloscope(self) -> Oscilloscope:
        """The oscilloscope on drive and carrier."""
        return self._instrument("oscilloscope")  # type: ignore[no-any-return]

    @property
    def rate_table(self) -> RateTable:
        """The table."""
        return self._instrument("rate_table")  # type: ignore[no-any-return]

    @property
    def vibration_source(self) -> FunctionGenerator:
        """The generator of the virtual vibration."""
        return self._instrument("vibration_source")  # type: ignore[no-any-return]

    @property
    def v_vc_meter(self) -> Multimeter:
        """The second voltmeter, connected to the V_Vc input."""
        return self._instrument("v_vc_meter")  # type: ignore[no-any-return]

    @property
    def chamber(self) -> TemperatureChamber:
        """Temperature chamber of the gyroscope."""
        return self._instrument("chamber")  # type: ignore[no-any-return]

    def _instrument(self, role: str) -> Any:
        """Return the instrument of `role`; ConfigError when the bench has none, or it was not opened."""
        try:
            return self.instruments[role]
        except KeyError:
            raise absent(role, self.description) from None

    @property
    def simulated(self) -> bool:
        """Return True if the bench is simulated, by its file or by its instruments."""
        return self.description.simulated or bool(self.simulated_roles)

    @property
    def simulated_roles(self) -> tuple[str, ...]:
        """Roles of instruments that are known to be simulated though the bench file says nothing of it."""
        return () if self.description.simulated else simulated_roles(self.description, self.identities)

    @property
    def by_hand(self) -> tuple[str, ...]:
        """Roles that a person performs."""
        return self.description.by_hand

    @property
    def safe_reports(self) -> list[SafeReport]:
        """Reports of making safe, once the bench was left."""
        return self.holding.reports

    @property
    def watchdog(self) -> Watchdog | None:
        """The process that makes the bench safe when this one dies; None on a bench that dies with it."""
        return self.holding.watchdog

    @property
    def closed(self) -> bool:
        """Return True if the bench was left."""
        return self.holding.closed

    def disbelieve(self, instrument: str, why: str) -> None:
        """Exclude read-backs of `instrument` from the proof of safety, because the run ends by a wrong one."""
        self.holding.safety.disbelieved[instrument] = why

    def seen_by(self, device: str) -> "Bench":
        """Return the bench as one of its several gyroscopes has it: the output is its own; raises what kept it shut."""
        instruments = {**self.instruments, "multimeter": self.multimeter.of(device)}  # type: ignore[attr-defined]
        return _SeenBench(**{**asdict(self), "instruments": instruments})

    def close(self) -> None:
        """Make everything safe and close it; a second call does nothing.

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
        """Make a bench safe that nobody can command any more."""
        if not self.holding.closed:
            try:
                words = f"{self!r} was never closed; it is made safe now"
                warnings.warn(words, ResourceWarning, stacklevel=2, source=self)
            finally:  # a warning may be an error
                self.holding.abandon("its last reference is gone")


class _SeenBench(Bench, frozen=True, eq=False):
    """A bench as one of its gyroscopes has it; the bench itself sees to it that it is left safe."""

    def __del__(self) -> None:
        """Leave it to the bench."""


def open_bench(
    bench: BenchDescription | Path | str | None = None,
    *,
    seed: int | None = None,
    speed: str | float | None = None,
    signals: StopSignals | None = None,
    build: Builder | None = None,
    needs: Collection[str] | None = None,
    now_s: float | None = None,
    trust: Trust = False,
    operator: Operator | None = None,
) -> Bench:
    """Open the instruments of the bench; everything is made safe when it is left, however it is left.

    To be used in a ``with``, or left by its `close`; what is still open when Python ends is made safe then.

    `bench` is a description, a bench file, or the name of an embedded bench; None is the simulated paper bench. `seed`
    and `speed` are for simulated benches. By default they are the seed of the bench file, and as fast as possible.

    While it opens, and inside of a ``with``, SIGINT and SIGTERM raise Aborted at the next safe point, a second one at
    once. Outside of a ``with``, SIGINT is Python's, and SIGTERM ends Python with code 4, the bench made safe; at a
    prompt or in a notebook, where an interrupt ends nothing, it brings the table to rest and leaves the bench open. A
    caller that watches for signals already, before and after, passes its own `signals`.

    `build` replaces `SimulatedBench.build`, to put something between simulated instruments and their drivers, or to
    look behind them. `needs` are the roles that are needed, all by default. Other roles that drive nothing are left
    closed, and free for other programs. `now_s` is the bench time to begin with, for a run that goes on where it was
    broken off; by default bench time begins. `trust` is as of :func:`vcfbench.run`. `operator` sets, reads and switches
    off what the bench file says is done by hand.

    Raises:
        ConfigError: the bench file cannot be used, names a program that nobody trusts, has no instrument for a role
            that is needed, or one for two roles, or a real bench was asked for a speed.
        BenchError: the bench is in use, or instruments did not open; the message names them all.
        InterlockError: the table was found turning.
        NotSafe: something was found on, or turning, and could not be made safe.

    >>> with vcfbench.open_bench("ideal", needs=["rate_table"]) as bench:
    ...     print(bench.rate_table.identify().model)
    Acutrol3000
    """
    description = described(bench, check_simulation)
    roles = needed_roles(description, needs)
    require_instruments_apart(description)
    require_library(description, trust)
    stops = signals or StopSignals()
    holding: Holding | None = None
    with ExitStack() as stack:
        watch = SignalWatch(None if signals else stops)
        stack.callback(watch.end)
        watch.begin()
        stand = stack.enter_context(station(description, seed, speed, build, roles=[each.name for each in roles]))
        if description.simulation is not None:
            stand.clock.asleep = stops.asleep  # type: ignore[attr-defined]  # a simulated bench is on an attended clock
        stand.hands.operator = operator
        holding = Holding(description.name, stand, stops, watch, stack.pop_all())
    ahead_s = 0.0 if now_s is None else now_s - stand.clock.now()
    try:
        opening: AbstractContextManager[None] = nullcontext()
        if description.simulation is None:
            calls, holding.reserve = Calls(), mmap(-1, _RESERVE)
            silent_s = SILENT_S if signals else description.safety.script_silent_s
            lost = partial(_without_watchdog, description, stops)
            holding.watchdog = Watchdog(description, lost, calls, stops.stop, silent_s)
            opening = attended(calls)
        with opening:
            opened = _open_all(roles, description, stand, holding.safety, stops)
        if "rate_table" in opened:
            require_still(opened["rate_table"][0])
        if holding.watchdog is not None:
            holding.watchdog.require_ready()
            calls.spoken.clear()
        checks = LimitChecks.of(description)
        instruments = {
            role: (_LIMITED[role](each, checks) if role in _LIMITED else each) for role, (each, _) in opened.items()
        }
        opened_bench = Bench(
            description,
            ControlClock(stand.clock, stops, ahead_s),
            stand.seed,
            {role: identity for role, (_, identity) in opened.items()},
            instruments,
            holding,
            stand.adjust,
            _left_by(stand),
            stand.hands,
        )
        fastest_deg_s2 = description.limits.max_acceleration_deg_s2
        if "rate_table" in instruments and fastest_deg_s2 is not None:
            holding.stop_table = partial(instruments["rate_table"].stop, fastest_deg_s2)
        watch.end()
    except BaseException as error:
        if isinstance(error, BenchError) and (left := _left_by(stand)):
            died = f"{', '.join(sorted(set(left.values())))} died with this bench, which stayed live"
            error.hint = f"{error.hint}; {died}" if error.hint else died
        holding.leave(error)
        raise
    return opened_bench


def _without_watchdog(description: BenchDescription, stops: StopSignals, why: str) -> None:
    """Act on the death or the silence of the watchdog as the bench file says."""
    if description.safety.watchdog_lost == "stop":
        stops.stop(why)
        return
    with suppress(OSError, ValueError, AttributeError):  # nobody may be there to read it
        sys.stderr.write(
            f"vcfbench: {why} of bench {description.name}; it goes on as its bench file says: "
            "if this program dies too, the bench stays live\n"
        )
        sys.stderr.flush()


def _open_all(
    roles: Sequence[Role],
    description: BenchDescription,
    stand: UnopenedBench,
    safety: SafetyStack,
    signals: StopSignals,
) -> dict[str, tuple[Any, Identity]]:
    """Open all of `roles`; try them all before giving up, so that all that is wrong is told at once."""
    opened: dict[str, tuple[Any, Identity]] = {}
    failures: list[BenchError] = []
    for role in roles:
        signals.safe_point()
        try:
            instrument, identity = open_role(role.name, description, stand)
        except BenchError as error:
            if (stop := Aborted.behind(error)) is not None:
                raise stop from None
            failures.append(error)
            continue
        safety.register(safe_action(role, instrument, description))
        opened[role.name] = instrument, identity
    if failures:
        failure = failures[0]
        if len(failures) > 1:
            failure = BenchError(f"{len(failures)} instruments did not open: {'; '.join(map(str, failures))}")
        failure.step = "opening the bench"
        raise failure
    return opened


def _left_by(stand: UnopenedBench) -> dict[str, str]:
    """Return by role the process that died with an actuator; an instrument that only listens is never left on."""
    return {role: who for role, who in stand.left_by.items() if role in _LIMITED}


_LIMITED: Mapping[str, Callable[[Any, LimitChecks], Any]] = MappingProxyType(
    {
        "power": LimitedSupply,
        "rate_source": LimitedGenerator,
        "vibration_source": LimitedGenerator,
        "rate_table": LimitedRateTable,
        "chamber": LimitedChamber,
    }
)
"""Wrapper that holds the limits of an instrument that drives something, by its role."""
