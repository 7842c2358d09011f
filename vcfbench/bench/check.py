"""Tries every instrument of a bench and reports the problems of each."""

from collections.abc import Iterator
from typing import cast

from msgspec import Struct
from msgspec.structs import replace

from vcfbench.bench.ground import UnopenedBench, require_instruments_apart, station
from vcfbench.bench.opening import open_role
from vcfbench.clock import WallClock, today
from vcfbench.drivers.calls import Calls
from vcfbench.drivers.scpi_instrument import ScpiInstrument
from vcfbench.errors import BenchError, InterlockError
from vcfbench.interfaces import Identity, Operator, RateTable, SafeReport
from vcfbench.models import own_watchdog
from vcfbench.records.metadata import Equipment
from vcfbench.safety.roles import Role, filled_roles, require_still, safe_action
from vcfbench.safety.signals import StopSignals
from vcfbench.safety.stack import SafetyStack, Stage, not_safe
from vcfbench.safety.trust import Trust, require_library
from vcfbench.safety.watchdog import Watchdog
from vcfbench.station.description import BenchDescription
from vcfbench.station.equipment import equipment_on


class CheckedInstrument(Struct, frozen=True):
    """One instrument: its identity (None: no answer), its problem (None: no problem), and its calibration.

    `answers` are those to the questions that runs depend on, each in the form that they demand.
    """

    role: str
    resource: str
    identity: Identity | None
    problem: str | None
    equipment: Equipment
    answers: dict[str, str]

    @property
    def called(self) -> str:
        """Its role in words: the output may be a stream."""
        return self.role.replace("multimeter", "stream") if self.equipment.model == "stream" else self.role


class CheckedWatchdog(Struct, frozen=True):
    """The watchdog process, started once, and notes on watchdogs in the instruments, by role; none is armed.

    `ready_s` is how long after its start it watches, wall time; None on a bench that is simulated in this process and
    needs none, and where it has a `problem`.
    """

    ready_s: float | None
    problem: str | None
    instruments: dict[str, str]


class BenchCheck(Struct, frozen=True):
    """All instruments of a bench, its watchdogs, and the outcome of switching it off afterwards."""

    instruments: list[CheckedInstrument]
    watchdog: CheckedWatchdog
    safe_reports: list[SafeReport]

    def failure(self) -> BenchError | None:
        """Return the error that the check amounts to: NotSafe before all else, None when all is well."""
        bad = [each.called for each in self.instruments if each.problem is not None]
        bad += ["watchdog"] * bool(self.watchdog.problem)
        return not_safe(self.safe_reports) or (BenchError(f"not ready: {', '.join(bad)}") if bad else None)

    def not_ready(self) -> list[str]:
        """Return the roles that have a problem, and the watchdog if it has."""
        bad = [each.role for each in self.instruments if each.problem is not None]
        return [*bad, "watchdog"] if self.watchdog.problem else bad


def check_bench(description: BenchDescription, *, trust: Trust = False, operator: Operator | None = None) -> BenchCheck:
    """Open every instrument, read identity, errors, a table's faults and what runs depend on; then make all safe.

    `trust` and `operator` are as of :func:`open_bench`.

    Raises:
        ConfigError: one instrument has two roles, or the bench names a program that nobody trusts.
        BenchError: another process has the bench.
        NotSafe: making it safe was ended by a third signal.
    """
    require_instruments_apart(description)
    require_library(description, trust)
    watchdog = _check_watchdog(description)
    with StopSignals() as signals, station(description, None, None) as stand:
        stand.hands.operator = operator
        safety = SafetyStack(stand.clock, patience=stand.patience)
        checked: list[CheckedInstrument] = []
        reports: list[SafeReport] = []
        try:
            for role in filled_roles(description):
                for name, own in _places(role, description):
                    signals.safe_point()
                    checked.append(replace(_check(role, own, stand, safety), role=name))
        finally:
            signals.unwind()
            try:
                reports += safety.make_safe_until_ended(signals)
            finally:
                safety.close()
    return BenchCheck(checked, watchdog, reports)


def _places(role: Role, description: BenchDescription) -> Iterator[tuple[str, BenchDescription]]:
    """Yield the bench for each instrument of a role: of several gyroscopes each output, once a connection."""
    if role.name != "multimeter" or not description.several:
        yield role.name, description
        return
    known = set[str]()
    for name, own in zip(description.several, description.each, strict=True):
        if own.output_resource not in known:
            known.add(own.output_resource)
            yield f"{role.name} of {name}", own


def _check_watchdog(description: BenchDescription) -> CheckedWatchdog:
    driving = [each.name for each in filled_roles(description) if each.stage is not Stage.REST]
    parts = {role: getattr(description, role) for role in driving}
    known = {
        role: own_watchdog(part.dialect if role == "rate_table" else part.model, getattr(part, "like", None))
        for role, part in parts.items()
    }
    if description.simulation is not None:
        return CheckedWatchdog(None, None, known)
    wall = WallClock()
    try:
        watchdog = Watchdog(description, lambda _why: None, Calls(), lambda _why: None)
        try:
            watchdog.require_ready()
            ready_s = wall.now()
        finally:
            watchdog.leave(safe=True)
    except (BenchError, OSError) as error:
        return CheckedWatchdog(None, str(error), known)
    return CheckedWatchdog(ready_s, None, known)


def _check(role: Role, description: BenchDescription, stand: UnopenedBench, safety: SafetyStack) -> CheckedInstrument:
    identity: Identity | None = None
    problem: str | None = None
    answers: dict[str, str] = {}
    try:
        instrument, identity = open_role(role.name, description, stand)
        safety.register(safe_action(role, instrument, description))
        instrument.check_errors()
        if isinstance(instrument, ScpiInstrument):
            answers = instrument.answers()
        if role.stage is Stage.MOTION:
            table = cast("RateTable", instrument)
            if fault := table.fault():
                raise InterlockError(fault, instrument=table.name, resource=table.resource)
            require_still(table)
    except BenchError as error:
        problem = str(error)
    known = {} if identity is None else {role.name: identity}
    [equipment] = equipment_on(today(), description, [role.name], known)
    return CheckedInstrument(role.name, equipment.resource, identity, problem, equipment, answers)
