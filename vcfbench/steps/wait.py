"""Steps that set nothing: headings, checks that are left out, and waiting."""

from msgspec import Struct

from vcfbench.bench.bench import Bench
from vcfbench.clock import sleep
from vcfbench.steps.step import Effect, Step, does


class Note(Step, Struct, frozen=True):
    """A heading of the work instruction; nothing is done.

    >>> vcfbench.Note("Step 1: by the table").describe()
    'Step 1: by the table'
    """

    text: str

    def describe(self) -> str:
        """Return the heading."""
        return self.text

    def command(self, bench: Bench) -> None:
        """Do nothing."""


class NotChecked(Step, Struct, frozen=True):
    """Replaces a check that this bench does not allow; it only records that."""

    what: str
    reason: str

    def describe(self) -> str:
        return f"NOT CHECKED: {self.not_checked}"

    @property
    def not_checked(self) -> str:
        return f"{self.what}: {self.reason}"

    def command(self, bench: Bench) -> None:
        """Do nothing."""


@does(Effect.WAITS)
class Settle(Step, Struct, frozen=True):
    """Wait for the bench to come to rest.

    >>> vcfbench.Settle(2.0, "after the ramp").describe()
    'wait 2 s: after the ramp'
    """

    seconds: float
    reason: str

    def describe(self) -> str:
        """Say the time for which and the reason."""
        return f"wait {self.seconds:g} s: {self.reason}"

    def command(self, bench: Bench) -> None:
        """Wait."""
        sleep(bench.clock, self.seconds)

    @property
    def physical_s(self) -> float:
        """The wait itself, s."""
        return self.seconds
