"""Progress of a study: a bar on a terminal, a line now and then elsewhere."""

from typing import Self

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

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        """Nothing to end."""

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


class BarProgress(StudyLineProgress):
    """A bar with the time that is left; it goes when all is done."""

    def __init__(self, outlet: Outlet) -> None:
        from rich.console import Console  # noqa: PLC0415  # only where somebody looks
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn  # noqa: PLC0415

        super().__init__(outlet)
        console = Console(file=outlet, highlight=False)  # type: ignore[arg-type]  # all of a file it needs
        shown = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        self._bar = Progress(*shown, console=console, transient=True, redirect_stdout=False, redirect_stderr=False)
        self._task = self._bar.add_task("checking", total=None)

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *error: object) -> None:
        """Take the bar away."""
        self._bar.stop()

    def say(self, words: str) -> None:
        """Print a line above the bar."""
        self._bar.console.print(words)

    def checked(self, done: int, total: int) -> None:
        """Move the bar."""
        self._bar.update(self._task, description="cases checked", completed=done, total=total)

    def begun(self, had: int, total: int) -> None:
        """Begin with the runs."""
        self._had = self.kept = had
        self.total = total
        self._bar.update(self._task, description="runs", completed=had, total=total)
        self._bar.reset(self._task, completed=had, total=total)

    def done(self, row: RunRow) -> None:
        """Move the bar."""
        self.kept += 1
        self._broken += row.status != "complete"
        failed = f"runs, {self._broken} failed" if self._broken else "runs"
        self._bar.update(self._task, description=failed, completed=self.kept)
