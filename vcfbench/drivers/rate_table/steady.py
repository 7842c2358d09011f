"""Rate-based tests of "at rate" and "at rest", for dialects whose tables know less than an ACL controller does."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from msgspec import Struct

from vcfbench.clock import sleep
from vcfbench.errors import InterlockError

if TYPE_CHECKING:
    from vcfbench.clock import Deadline
    from vcfbench.drivers.rate_table.line import TableLine

REST_DEG_S = 0.1
"""Above this rate a servo is not opened: the table would coast."""

_QUIET_S = 0.2
"""Silence after which a line counts as drained, s."""


class SteadyRate(Struct):
    """Stands in for an at-rate flag: so many readings in a row within a tolerance of the demand."""

    tolerance_deg_s: float = 0.02
    relative: float = 1e-4
    polls: int = 3
    demanded_deg_s: float = 0.0
    _good: int = 0

    def demand(self, rate_deg_s: float) -> None:
        """Begin anew with another demand."""
        self.demanded_deg_s, self._good = rate_deg_s, 0

    def reached(self, rate_deg_s: float) -> bool:
        """Take a reading; tell whether enough of the latest are good."""
        allowed = self.tolerance_deg_s + self.relative * abs(self.demanded_deg_s)
        self._good = self._good + 1 if abs(rate_deg_s - self.demanded_deg_s) <= allowed else 0
        return self._good >= self.polls


def on_grid(rate_deg_s: float, quantum_deg_s: float) -> float:
    """Return the multiple of the step of a table's rates that is nearest."""
    return round(rate_deg_s / quantum_deg_s) * quantum_deg_s


def require_rest(line: TableLine, rate_deg_s: float) -> None:
    """Raise InterlockError when the servo must not be opened because the table turns."""
    if not abs(rate_deg_s) < REST_DEG_S:
        raise InterlockError(f"it still turns at {rate_deg_s:g} deg/s, the servo was not opened", **located(line))


def drain(line: TableLine, deadline: Deadline) -> None:
    """Drop all until nothing comes; answers that look alike cannot be told from late ones otherwise."""
    line.take_unasked()
    while not deadline.expired():
        sleep(line.clock, min(_QUIET_S, deadline.remaining()))
        if not line.take_unasked():
            return


def located(line: TableLine) -> dict[str, Any]:
    """Return the names of instrument and resource, for errors."""
    return {"instrument": line.name, "resource": line.resource}
