"""Pauses of a run on an open bench: the wish for one, its length, and the time meanwhile."""

from typing import Self

from vcfbench.bench.bench import Bench
from vcfbench.bench.ground import checked_pace
from vcfbench.clock import WallClock, sleep
from vcfbench.procedures.shared.pause import AroundPause
from vcfbench.runs.request import Prepared
from vcfbench.safety.control import RunControl


class Pausing(AroundPause, frozen=True, kw_only=True):
    """Pauses of an executor, by a run's control.

    `pace` is how many seconds a second of the wall is on a bench whose time does not go on by itself. On a simulated
    bench that is as fast as it goes (0) bench time stands still in a pause, else it goes on as the wall does.
    """

    control: RunControl
    bench: Bench
    pace: float

    @classmethod
    def of(cls, control: RunControl, bench: Bench, prepared: Prepared) -> Self:
        """Return it for a run that was `prepared`, on the open `bench`."""
        pace = checked_pace(prepared.description, prepared.request.speed) or 0.0
        drifts = bool(prepared.procedure.in_one_piece)
        return cls(prepared.settings, drifts, control=control, bench=bench, pace=pace)

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
