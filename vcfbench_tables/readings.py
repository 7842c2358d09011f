"""Rate and rest by what is read, for tables that have no word for them."""

from msgspec import Struct

from vcfbench.drivers.rate_table.line import TableLine
from vcfbench.errors import InterlockError

REST_DEG_S = 0.1
"""Above this rate a servo is not opened: the table would coast."""


class SteadyRate(Struct):
    """Replaces an at-rate flag: so many readings in a row within a tolerance of the demand."""

    tolerance_deg_s: float = 0.02
    relative: float = 1e-4
    polls: int = 3
    demanded_deg_s: float = 0.0
    _good: int = 0

    def __str__(self) -> str:
        return (
            f"{self.polls} readings in a row (polls) within {self.allowed_deg_s:.3g} deg/s (tolerance_deg_s, relative)"
        )

    def demand(self, rate_deg_s: float) -> None:
        """Start again with another demand."""
        self.demanded_deg_s, self._good = rate_deg_s, 0

    @property
    def allowed_deg_s(self) -> float:
        """Largest difference of a reading from the demand."""
        return self.tolerance_deg_s + self.relative * abs(self.demanded_deg_s)

    def reached(self, rate_deg_s: float) -> bool:
        """Take a reading; return True if enough of the latest are good."""
        self._good = self._good + 1 if abs(rate_deg_s - self.demanded_deg_s) <= self.allowed_deg_s else 0
        return self._good >= self.polls


def require_rest(line: TableLine, rate_deg_s: float) -> None:
    """Raise InterlockError when the servo must not be opened because the table turns."""
    if not abs(rate_deg_s) < REST_DEG_S:
        raise InterlockError(f"it still turns at {rate_deg_s:g} deg/s, the servo was not opened", **line.where)


def turned_deg_s(first_deg: float, then_deg: float, duration_s: float) -> float:
    """Return the rate from two angles, the shorter way round: right while it turned less than half a turn."""
    return ((then_deg - first_deg + 180.0) % 360.0 - 180.0) / duration_s
