"""Progress of a study: a line now and then."""

from vcfbench.clock import WallClock
from vcfbench.reports.outlet import Outlet
from vcfbench.studies.conduct import Progress
from vcfbench.studies.one_run import RunRow

_LINE_S = 10.0


class StudyLineProgress(Progress):
    """A plain line when runs begin, every ten seconds, and at the end. `kept` runs of `total` are done."""

    def __init__(self, outlet: Outlet) -> None:
        self._outlet = outlet
        self._clock = WallClock()
        self._said_s = 0.0
        self._had = self._broken = 0
        self.kept = self.total = 0

    def say(self, words: str) -> None:
        """Print a line."""
        self._outlet.write(f"{words}\n")

    def checked(self, done: int, total: int) -> None:
        """Say now and then how many cases have been checked: a thousand take some time."""
        if self._clock.now() - self._said_s >= _LINE_S and done < total:
            self._said_s = self._clock.now()
            self.say(f"{done} of {total} cases checked")

    def begun(self, had: int, total: int) -> None:
        """Say how many runs there are."""
        self._had = self.kept = had
        self.total = total
        self._clock, self._said_s = WallClock(), 0.0
        self.say(f"{total} runs{f', {had} of them done before' if had else ''}")

    def done(self, row: RunRow) -> None:
        """Say how far it is, now and then."""
        self.kept += 1
        self._broken += row.status != "complete"
        if self._clock.now() - self._said_s >= _LINE_S or self.kept == self.total:
            self._said_s = self._clock.now()
            left_s = self._clock.now() * (self.total - self.kept) / max(1, self.kept - self._had)
            broken = f", {self._broken} failed" if self._broken else ""
            self.say(f"{self.kept} of {self.total} runs, {left_s:.0f} s left{broken}")
