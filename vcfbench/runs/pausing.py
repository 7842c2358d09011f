"""Pauses of a run on an open bench: the wish for one, its length, and the time meanwhile."""

from __future__ import annotations

from typing import TYPE_CHECKING

from msgspec import Struct

from vcfbench.bench.ground import checked_pace
from vcfbench.clock import WallClock, sleep
from vcfbench.procedures.shared.pause import AroundPause

if TYPE_CHECKING:
    from collections.abc import Sequence
    from collections.abc import Set as AbstractSet

    from vcfbench.bench.bench import Bench
    from vcfbench.runs.request import Prepared
    from vcfbench.safety.control import RunControl
    from vcfbench.steps import Window
    from vcfbench.steps.executor import Moved
    from vcfbench.steps.step import Routine, Step


class Pausing(Struct, frozen=True):
    """Pauses of an executor, by a run's control.

    `pace` is how many seconds a second of the wall is on a bench whose time does not go on by itself. On a simulated
    bench that is as fast as it goes (0) bench time stands still in a pause, else it goes on as the wall does.
    """

    control: RunControl
    bench: Bench
    around: AroundPause
    pace: float

    @classmethod
    def of(cls, control: RunControl, bench: Bench, prepared: Prepared, speed: str | float | None) -> Pausing:
        """Return it for a run that was `prepared`, on the open `bench`."""
        pace = checked_pace(prepared.description, speed) or 0.0
        return cls(control, bench, AroundPause(prepared.settings, bool(prepared.procedure.in_one_piece)), pace)

    @property
    def by(self) -> str:
        """Name of the person asking for a pause; empty: nobody."""
        return self.control.pause_by

    def wait(self) -> tuple[str, float]:
        """Wait until somebody wants the run to go on; return that name and the time waited, s of wall time."""
        waited = WallClock()
        by = self.control.wait()
        waited_s = waited.now()
        if self.pace:
            sleep(self.bench.clock, waited_s * self.pace)
        return by, waited_s

    def to_rest(self, done: Sequence[Step]) -> Routine[Window | None]:
        """Bring the bench to rest."""
        return self.around.to_rest(done)

    def looked_at(self, done: Sequence[Step]) -> Routine[Window]:
        """Look at the output again."""
        return self.around.looked_at(done)

    def moved(self, done: Sequence[Step], before: Window, after: Window) -> Moved:
        """Return by how much it moved."""
        return self.around.moved(done, before, after)

    def as_before(self, done: Sequence[Step], disturbed: AbstractSet[str]) -> Routine[None]:
        """Bring the bench to where it was."""
        return self.around.as_before(done, disturbed)
