"""Faults of a served bench: their beginning and end, on the wires of this server and at the instruments."""

from __future__ import annotations

import random
import socket
from collections.abc import Iterable, Mapping, Sequence

from simrack.bench_faults import begin_on_bench, require_possible
from simrack.faults import CUTTING, UNREACHABLE, Fault, FaultScript, Ongoing, spoiled, spoils
from simrack.serve.instrument import ServedInstrument
from simrack.serve.passage import AttendedPassage
from simrack.serve.wire import Listener


def require_roles(instruments: Mapping[str, ServedInstrument], roles: Iterable[str], what: str) -> None:
    """Raise ValueError if one of `roles` is none of the bench's."""
    unknown = [role for role in roles if role not in instruments]
    if unknown:
        raise ValueError(f"{what}: the bench has no {unknown[0]!r}, only {', '.join(instruments)}")


class ServedFaults:
    """The faults of a bench, those that go on and those that are to come.

    Args:
        instruments: by role.
        listeners: the sockets on which each instrument takes connections.
        passage: bench time.
        script: what goes wrong from the start, and the seed of the noise.
        apart: those that are on no wire of their own.
    """

    def __init__(
        self,
        instruments: Mapping[str, ServedInstrument],
        listeners: Mapping[str, Sequence[Listener]],
        passage: AttendedPassage,
        script: FaultScript,
        apart: frozenset[str] = frozenset(),
    ) -> None:
        self._instruments = instruments
        self._apart = apart
        self._listeners = listeners
        self._passage = passage
        self._script = script
        self._planned: list[Fault] = []
        self._ongoing: dict[str, list[Ongoing]] = {role: [] for role in instruments}
        self._dead: dict[Ongoing, list[socket.socket]] = {}
        """Connections that nobody serves any more, and the fault that has done that."""
        self._noise = {role: random.Random(f"{script.seed}/{role}") for role in instruments}  # noqa: S311  # no secrets
        for fault in script.faults:
            self._require_possible(fault)

    def begin(self) -> None:
        """Plan the faults of the script."""
        for role, noise in self._noise.items():
            noise.seed(f"{self._script.seed}/{role}")
        for fault in self._script.faults:
            self._plan(fault)

    def kinds(self, role: str) -> list[str]:
        """Return the kinds of faults under way at an instrument."""
        return [each.fault.kind for each in self._ongoing[role]]

    def add(self, fault: Fault) -> None:
        """Let something go wrong at its time, now if that has passed.

        Raises:
            ValueError: the bench has no such instrument, or the instrument cannot suffer that.
        """
        self._require_possible(fault)
        if fault.at_s <= self._passage.clock.now():
            self._begin(fault)
        else:
            self._plan(fault)

    def end(self, role: str | None = None) -> None:
        """End the faults of an instrument, or of all, and forget those that are planned."""
        if role is not None:
            require_roles(self._instruments, [role], "fault")
        for each in self._instruments if role is None else [role]:
            self._planned = [fault for fault in self._planned if fault.instrument != each]
            for ongoing in reversed(tuple(self._ongoing[each])):
                self._end(ongoing)

    def close(self) -> None:
        """Close the connections that are no longer served."""
        for dead in self._dead.values():
            for connection in dead:
                connection.close()
        self._dead.clear()

    def _require_possible(self, fault: Fault) -> None:
        require_roles(self._instruments, [fault.instrument], "fault")
        require_possible(self._instruments[fault.instrument].device, fault)
        on_wire = spoils(fault) or fault.kind in {*CUTTING, *UNREACHABLE, "power_cycle"}
        if on_wire and fault.instrument in self._apart:
            raise ValueError(
                f"fault: {fault.instrument} is behind an adapter; give the fault {fault.kind!r} to the adapter"
            )

    def _plan(self, fault: Fault) -> None:
        def begin() -> None:
            if any(planned is fault for planned in self._planned):  # else it has been forgotten
                self._planned.remove(fault)
                self._begin(fault)

        self._planned.append(fault)
        self._passage.at(fault.at_s, begin)

    def _begin(self, fault: Fault) -> None:
        instrument = self._instruments[fault.instrument]
        if fault.kind == "error":
            instrument.complain(fault.number)
            return
        if fault.kind in CUTTING:
            self._cut(instrument)
        if fault.kind == "disconnect":
            return
        ongoing = Ongoing(fault, begin_on_bench(instrument.device, fault), None, fault.count)
        instrument.touched()
        if fault.kind == "power_cycle":
            if fault.duration_s is None:
                return
            instrument.power(on=False)
        if fault.kind == "half_open":
            self._dead[ongoing] = [dead for client in tuple(instrument.clients) for dead in client.freeze()]
        self._ongoing[fault.instrument].append(ongoing)
        self._apply(fault.instrument)
        if fault.duration_s is not None:
            self._passage.at(self._passage.clock.now() + fault.duration_s, lambda: self._end(ongoing))

    def _end(self, ongoing: Ongoing) -> None:
        role = ongoing.fault.instrument
        if ongoing not in self._ongoing[role]:
            return
        self._ongoing[role].remove(ongoing)
        ongoing.undo()
        if ongoing.fault.kind == "power_cycle":
            self._instruments[role].power(on=True)
        for connection in self._dead.pop(ongoing, ()):
            connection.close()
        self._apply(role)

    def _apply(self, role: str) -> None:
        instrument, ongoing = self._instruments[role], self._ongoing[role]
        spoiling = [each for each in ongoing if spoils(each.fault)]
        instrument.fault = (lambda data, end: self._spoil(role, spoiling, data, end=end)) if spoiling else None
        for listener in self._listeners[role]:
            listener.refusing = any(each.fault.kind in UNREACHABLE for each in ongoing)
        instrument.touched()

    def _spoil(self, role: str, spoiling: list[Ongoing], data: bytes, *, end: bool) -> tuple[bytes, bool, float]:
        left = spoiled(spoiling, self._noise[role], data, end=end)
        for each in [each for each in spoiling if each.over]:
            self._end(each)
        return left

    @staticmethod
    def _cut(instrument: ServedInstrument) -> None:
        """Cut the connections to an instrument; a pseudo-terminal stays, as a serial cable does."""
        for client in tuple(instrument.clients):
            client.cut()
