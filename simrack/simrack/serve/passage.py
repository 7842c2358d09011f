"""Passing of bench time behind served wires, and the instruments that do something by itself meanwhile."""

from __future__ import annotations

import math
import sys
import traceback
from collections.abc import Callable

from simrack.serve.clock import ServedClock
from simrack.serve.instrument import ServedInstrument

_NOTHING = math.inf
_PATIENCE_S = 0.005
"""Wall time without a word from anybody after which a lockstep clock goes on to the next status that comes unasked."""


def _worked(instrument: ServedInstrument) -> bool:
    """Let `instrument` work out a slice; return True if there is more, which one that makes a mistake does not have."""
    try:
        return instrument.work()
    except Exception:  # noqa: BLE001  (as in the loop)
        traceback.print_exc(file=sys.stderr)
        instrument.device.clear()
        return False


class AttendedPassage:
    """Lets bench time pass, and looks in on the devices at the instants at which they do something by themselves."""

    def __init__(self, clock: ServedClock) -> None:
        self.clock = clock
        self.instruments: list[ServedInstrument] = []
        self.next_due_s = _NOTHING
        self.working: list[ServedInstrument] = []
        """Those that work something out, one after the other a slice a turn: bench time does not jump meanwhile."""
        self.tells = False
        """Whether who leads the clock tells when it waits for what comes unasked, so that nobody need guess."""
        self.errands: list[tuple[float, Callable[[], None]]] = []
        """Other things to do at bench times, in order (scheduled faults)."""

    def add(self, instrument: ServedInstrument) -> None:
        """Look in on `instrument` too."""
        self.instruments.append(instrument)
        instrument.passage = self
        instrument.touched()

    def restart(self) -> None:
        """Forget every pending action; time starts at 0, at once if a client is connected."""
        self.errands.clear()
        self.clock.restart()
        if any(client.comes_and_goes for each in self.instruments for client in each.clients):
            self.clock.start()
        elif any(each.speaks and each.clients for each in self.instruments):
            self.clock.run_ahead()
        self.next_due_s = _NOTHING
        for each in self.instruments:
            each.touched()

    def at(self, instant_s: float, action: Callable[[], None]) -> None:
        """Do `action` at bench time `instant_s`."""
        self.errands.append((instant_s, action))
        self.errands.sort(key=lambda errand: errand[0])
        self.next_due_s = min(self.next_due_s, instant_s)

    def tick(self) -> None:
        """Bring bench time up to date with the wall clock."""
        reached = self.clock.catch_up(self.next_due_s)
        if reached >= self.next_due_s:
            self.pass_to(reached)

    def wait_s(self) -> float:
        """Return the wall seconds until the next action; jump there instead if the clock does and a client waits.

        Whoever has spoken has been dealt with by now, so a slice is worked out here: nobody waits for two of them.
        """
        if self.working:
            if _worked(each := self.working[0]):
                self.working.append(each)
            del self.working[0]
            return 0.0
        if self.next_due_s == _NOTHING:
            return _NOTHING
        if self.clock.jumps:
            due = min((each.due_s for each in self.instruments if each.awaited), default=_NOTHING)
            if due < _NOTHING:
                self.jump_to(due)
                return 0.0
            if self._next_unasked_s() < _NOTHING:
                return _PATIENCE_S
        return self.clock.wall_until(self.next_due_s)

    def idle(self) -> None:
        """Go on to the next unasked status, if the leader of the clock seems to wait for it."""
        due = self._next_unasked_s()
        if self.clock.jumps and due < _NOTHING:
            self.jump_to(due)

    def _next_unasked_s(self) -> float:
        if not self.clock.lockstep or self.tells:
            return _NOTHING
        return min((each.due_s for each in self.instruments if each.listened_to), default=_NOTHING)

    def jump_to(self, instant_s: float) -> None:
        """Let time jump to `instant_s`, stopping wherever something is due; no further than where work comes up."""
        while not self.working and (due := self._earliest()) <= instant_s:
            self._arrive(due)
        self.clock.sleep_until(self.clock.now() if self.working else instant_s)

    def pass_to(self, instant_s: float) -> None:
        """Let time pass until `instant_s`."""
        while (due := self._earliest()) <= instant_s:
            self._arrive(due)
        self.clock.move(instant_s)

    def pass_until(self, done: Callable[[], bool], instant_s: float, most: int) -> bool:
        """Let time jump from one thing that is due to the next until `done`, or `instant_s`.

        False after `most`, or when something is to be worked out first.
        """
        for _ in range(most):
            if self.working:
                break
            if done():
                instant_s = self.clock.now()
            elif (due := self._earliest()) <= instant_s:
                self._arrive(due)
                continue
            self.clock.sleep_until(instant_s)
            return True
        self.clock.sleep_until(self.clock.now())
        return False

    def _arrive(self, due_s: float) -> None:
        """Do everything due."""
        self.clock.move(due_s)
        while self.errands and self.errands[0][0] <= due_s:
            self.errands.pop(0)[1]()
        for each in self.instruments:
            if each.due_s <= due_s:
                try:
                    each.serve()
                except Exception:  # noqa: BLE001  (left alone until somebody speaks to it; the others go on)
                    traceback.print_exc(file=sys.stderr)
                    each.due_s = _NOTHING

    def _earliest(self) -> float:
        due = min((each.due_s for each in self.instruments), default=_NOTHING)
        if self.errands:
            due = min(due, self.errands[0][0])
        self.next_due_s = due
        return due
