"""Makes a bench safe from any state: after a crash, or before a person goes to it.

Everything that drives something is told to stop or to switch off upon connecting, before it is asked who it is; only
then it is opened properly, made safe and proved. What does not answer keeps nothing else from being told and proved.
"""

import signal
import socket
from collections.abc import Collection, Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, Final

from msgspec import Struct, field
from msgspec.structs import replace

from vcfbench.bench.ground import UnopenedBench, station, table_port
from vcfbench.bench.opening import open_role
from vcfbench.clock import WallClock, sleep
from vcfbench.drivers.rate_table.dialect import TableDialect
from vcfbench.drivers.rate_table.line import TableLine
from vcfbench.drivers.registry import find_driver
from vcfbench.drivers.session import Session
from vcfbench.errors import BenchError, ConnectFailed, NotSafe
from vcfbench.interfaces import Operator, SafeReport, UnprovedCommand
from vcfbench.safety.lock import InUse, LockUnusable, Owner, owners_of
from vcfbench.safety.processes import KILL, end
from vcfbench.safety.roles import STILL_DEG_S, Role, driving_roles, safe_action
from vcfbench.safety.signals import LeaveNow, StopSignals
from vcfbench.safety.stack import SafetyStack, Stage, not_safe
from vcfbench.station.description import BenchDescription
from vcfbench.station.file import described

_LOOK_S: Final = 0.25
"""Longest time for which looking at the outputs may keep back the words that switch them off, s."""
_HURRY_S: Final = 0.5
"""Longest time for which an instrument that does not answer may keep the next from being told, s."""
_STOPPING_S: Final = 10.0
"""Longest time in which a process that is told to stop may let its bench go, s."""
_FREEING_S: Final = 20.0
"""Longest time in which one that was ended, and its watchdog, may let the bench go, s."""
_DYING_S: Final = 1.0
"""Longest time for which the locks of a dead one may keep what is free from being made safe, s."""
_LET_GO_S: Final = 0.05
"""Between two looks at the locks of one that is dying, s."""
_SUPPLY: Final = {output: f"MEAS:VOLT? {output}" for output in ("P6V", "P25V", "N25V")}
_FLOW: Final = 1 << 5
"""Bit of AUXC? of a stream of air."""
_GENERATOR: Final = {"level": "VOLT:OFFS?"}


class Safed(Struct, frozen=True):
    """One instrument: its state before (None: unknown), True if it is proved safe, and the proof."""

    role: str
    resource: str
    found: str | None
    safe: bool
    detail: str


class MadeSafe(Struct, frozen=True):
    """Result of making a bench safe, in the order in which it was done.

    `unlocked` says why the instruments could not be locked meanwhile; None where nothing kept them from it. `left_to`
    are by role the other processes that have an instrument, `ended` the processes that were ended. `signalled`: a
    person, or a program, has meanwhile wanted an end of it.

    >>> made_safe = vcfbench.safe_bench("ideal")
    >>> all(report.safe for report in made_safe.reports), made_safe.failure()
    (True, None)
    """

    instruments: tuple[Safed, ...]
    reports: tuple[SafeReport, ...]
    unlocked: str | None = None
    left_to: Mapping[str, InUse] = field(default_factory=dict)
    ended: tuple[str, ...] = ()
    signalled: bool = False

    def unsafe_beside(self, by_hand: Collection[str]) -> bool:
        """Return True if an unproved actuator can be commanded again, unlike a person who does not answer."""
        return any(not report.safe and report.instrument not in by_hand for report in self.reports)

    def failure(self) -> BenchError | None:
        """Return the error that names the instruments not proved safe, or else left to others; None when all are."""
        error = not_safe(self.reports)
        if error is not None:
            error.reports = self.reports
            return error
        return next(iter(self.left_to.values()), None)


def safe_bench(
    bench: BenchDescription | Path | str,
    *,
    force: bool = False,
    end_owner: bool = False,
    operator: Operator | None = None,
) -> MadeSafe:
    """Make every actuator of the bench safe, in any state, and return the states found.

    An instrument that another process has is left to it. With `end_owner` that process is ended before: told by SIGTERM
    to stop, by SIGKILL where it has not let go within 10 s. With `force` nobody is asked; who has the bench may switch
    things on again. Locks that cannot be used keep nothing from being made safe.
    `operator` is asked to switch off what is done by hand.

    Raises:
        InUse: other processes have all of it.
        ConnectFailed: a served bench is not served, or another connection controls its time.
        BenchError: the process that has it cannot be ended from here.
        NotSafe: it was broken off by a third signal.

    >>> for report in vcfbench.safe_bench("ideal").reports:
    ...     print(report.instrument, report.safe)
    rate_table True
    rate_source True
    power True
    """
    description = described(bench)
    with StopSignals() as signals, ExitStack() as stack:
        ended = _end_owners(description) if end_owner else ()
        held = _held(description, stack, force=force, patience_s=_FREEING_S if ended else 0.0)
        signals.unwind()  # nothing here can be stopped half-way and be called safe
        try:
            signals.allow_end()
            held.stand.hands.operator = operator
            done = _made_safe(description, held)
            return replace(done, unlocked=held.unlocked, left_to=held.left_to, ended=ended, signalled=signals.came)
        except LeaveNow:
            raise NotSafe(
                "NOT SAFE: making safe was ended by a third signal", hint="go and look at every instrument"
            ) from None
        finally:
            signals.close()


class _Held(Struct, frozen=True):
    """The bench to be opened, its free instruments that drive something, and by role the owners of the rest."""

    stand: UnopenedBench
    roles: tuple[Role, ...]
    left_to: Mapping[str, InUse] = field(default_factory=dict)
    unlocked: str | None = None


def _held(description: BenchDescription, stack: ExitStack, *, force: bool, patience_s: float) -> _Held:
    """Take the free instruments that drive something: the wires of nobody else, and all of nobody's.

    An owner is waited for until `patience_s`, for it or its watchdog may be making the bench safe, and at least for as
    long as one that is just dying may take.
    """
    clock, driving = WallClock(), driving_roles(description)
    left_to: dict[str, InUse] = {}
    while True:
        roles = tuple(role for role in driving if role.name not in left_to)
        try:
            stand = stack.enter_context(station(description, None, None, roles=[role.name for role in roles]))
            return _Held(stand, roles, left_to)
        except LockUnusable as error:  # a disk that is read-only by now, or what somebody has laid there
            return _Held(_unlocked(description), driving, unlocked=str(error))
        except (InUse, ConnectFailed) as error:
            if force:
                return _Held(_unlocked(description), driving)
            owner = error.owner if isinstance(error, InUse) else None
            dying_s = 0.0 if owner is None else _HURRY_S if owner.alive() else _DYING_S
            if clock.now() < max(patience_s, dying_s):
                left_to.clear()  # it gives its locks back one by one
                sleep(clock, _LET_GO_S)
                continue
            if not isinstance(error, InUse):
                raise
            error.hint = f"end it with --end-owner, it makes its bench safe; or --force speaks beside it; {error.hint}"
            left_to[str(error.instrument)] = error
            if len(left_to) == len(driving):
                raise next(iter(left_to.values())) from None


def _unlocked(description: BenchDescription) -> UnopenedBench:
    return UnopenedBench(WallClock(), description.visa_library, table_port(description))


def _end_owners(description: BenchDescription) -> tuple[str, ...]:
    """End the processes that have an instrument of the bench that drives; return their names.

    Each is told to stop, which makes its bench safe, and is killed where it does not; then its watchdog does that, or
    who comes next.

    Raises:
        BenchError: one belongs to another user, or runs on another computer.
    """
    resources = [description.owned(role.name) for role in driving_roles(description)]
    found = owners_of(resources)
    for owner in found.values():
        _signal(owner, signal.SIGTERM)
    clock = WallClock()
    while (left := found.keys() & owners_of(resources)) and clock.now() < _STOPPING_S:
        sleep(clock, _LET_GO_S)
    for pid in left:
        _signal(found[pid], KILL)
    return tuple(map(str, found.values()))


def _signal(owner: Owner, number: int) -> None:
    if owner.host != socket.gethostname():
        raise BenchError(f"{owner} cannot be ended from here", hint="end it where it runs; it makes its bench safe")
    try:
        end(owner.pid, owner.mark, number)
    except OSError as error:
        raise BenchError(
            f"{owner} cannot be ended: {error.strerror}", hint="a user with the right to do so must end it"
        ) from None


def _made_safe(description: BenchDescription, held: _Held) -> MadeSafe:
    roles, stand = held.roles, held.stand
    first = {role.name: _command_first(role, description, stand) for role in roles}
    safety = SafetyStack(stand.clock, patience=stand.patience)
    reports: dict[str, SafeReport] = {}
    for role in roles:
        found: dict[str, float] = {}
        if role.stage is Stage.MOTION and role.name not in description.by_hand:
            found["found_deg_s"] = description.limits.of(
                "max_rate_deg_s"
            )  # whatever is read, it may have been told that
        try:
            instrument, _ = open_role(role.name, description, stand, **found)
        except BenchError as error:
            resource = getattr(description, role.name).resource
            reports[role.name] = SafeReport(role.name, resource, False, str(error), first[role.name])  # noqa: FBT003
        else:
            safety.register(safe_action(role, instrument, description))
    try:
        reports |= {report.instrument: report for report in safety.make_safe()}
    finally:
        safety.close()
    ordered = [reports[role.name] for role in roles]
    safed = (
        Safed(
            *(each.instrument, each.resource, first[each.instrument].last_read, each.safe),
            each.detail if each.unproved is None else f"{each.unproved}; {each.detail}",
        )
        for each in ordered
    )
    return MadeSafe(tuple(safed), tuple(ordered))


class _Commanded(Exception):
    """The instrument was told; that is all that its connection was for."""


def _command_first(role: Role, description: BenchDescription, stand: UnopenedBench) -> UnprovedCommand:
    """Connect, tell the instrument to stop or to switch off; return True if it was told, and its state before."""
    moves = role.stage is Stage.MOTION
    words = "to stop" if moves else "to switch off"
    if role.name in description.by_hand:
        return UnprovedCommand(words, sent=False)
    hurry_s = min(_HURRY_S, getattr(description, role.name).timeout_s)
    found: list[str] = []
    sent: list[bool] = []

    def table_connected(line: TableLine, dialect: TableDialect) -> None:
        sent.append(line.say_blind(dialect.stop_words(None), dialect.gap_s))
        raise _Commanded

    def session_connected(session: Session, words: Sequence[str]) -> None:
        session.declare_safe(
            *(("SYST:REM",) if session.interface == "asrl" else ()), *words
        )  # in local it hears nothing
        with suppress(BenchError):  # it does not say what is on; it may hear all the same
            part = getattr(description, role.name)
            found.append(_look(role, find_driver(part.model, part.like).driver_class, session))
        sent.append(session.command_safe())
        raise _Commanded

    connected = table_connected if moves else session_connected
    with suppress(_Commanded, BenchError):  # who cannot be connected to is named when it is to be proved
        open_role(role.name, description, stand, timeout_s=hurry_s, upon_connecting=connected)
    if moves:
        table: Any
        with suppress(BenchError):  # its rate just after it was told to stop: it takes its time to come to rest
            table, _ = open_role(role.name, description, stand, timeout_s=hurry_s)
            try:
                rate_deg_s = table.rate_deg_s()
            finally:
                table.close()
            still = abs(rate_deg_s) <= STILL_DEG_S
            found.append("at rest" if still else f"turning at {rate_deg_s:.3g} deg/s, already told to stop")
    return UnprovedCommand(words, any(sent), found[0] if found else None)


def _look(role: Role, driver: type, session: Session) -> str:
    """Ask for the outputs that are on, before they are switched off; volts only if any answers."""
    if role.name == "chamber":
        return "air flows" if session.query_int("AUXC?", session.deadline(_LOOK_S)) & _FLOW else "off"
    if not any(session.query_numbers(getattr(driver, "switch_question", "OUTP?"), session.deadline(_LOOK_S))):
        return "off"
    asked = getattr(driver, "look", _SUPPLY if role.stage is Stage.POWER else _GENERATOR)
    volts = {what: session.query_number(question, session.deadline(_LOOK_S)) for what, question in asked.items()}
    return f"on, {', '.join(f'{what} {volt:.3g} V' for what, volt in volts.items())}"
