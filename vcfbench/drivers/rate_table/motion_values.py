"""Rates and accelerations in the units of a table whose language a profile tells."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from vcfbench.drivers.rate_table.steady import located
from vcfbench.errors import LimitError

if TYPE_CHECKING:
    from vcfbench.drivers.rate_table.line import TableLine
    from vcfbench.drivers.rate_table.profile import Profile
    from vcfbench.drivers.rate_table.templates import Value


class MotionValues:
    """Values for the motion commands of one axis; those beyond the limits of `profile` are refused."""

    def __init__(self, profile: Profile, axis: int) -> None:
        self._profile = profile
        self._axis = axis

    @property
    def rate_quantum_deg_s(self) -> float:
        """Step of the commanded rate."""
        return self._profile.units.rate_quantum / self._rate_per_deg

    @property
    def sign(self) -> int:
        """Sign of the table's count against its turning: 1 or -1."""
        return self._profile.units.sign

    @property
    def _rate_per_deg(self) -> float:
        units = self._profile.units
        per = {"deg/s": 1.0, "deg/min": 60.0, "rpm": 1.0 / 6.0, "counts/s": units.counts_per_deg}
        return per[units.rate] * units.velocity_factor

    @property
    def _acceleration_per_deg(self) -> float:
        units = self._profile.units
        return self._rate_per_deg / units.velocity_factor * units.acceleration_factor

    def of(self, line: TableLine, rate_deg_s: float, acceleration_deg_s2: float) -> dict[str, Value]:
        """Return the values that templates of a motion command can name; raises LimitError before anything is sent."""
        rate = self._table_rate(line, rate_deg_s)
        values: dict[str, Value] = {
            "rate": rate,
            "abs_rate": abs(rate),
            "dir": self._profile.units.positive if rate >= 0.0 else self._profile.units.negative,
        }
        values |= {f"rate_{slot}": rate if slot == self._axis else 0.0 for slot in range(1, 7)}
        if acceleration_deg_s2 != math.inf:
            commanded = self.table_acceleration(acceleration_deg_s2)
            if commanded is None:
                what = f"an acceleration of {acceleration_deg_s2:g} deg/s2 is not one that its profile allows"
                raise limit_error(line, what)
            values["acc"] = commanded
        if self._profile.units.travel is not None:
            values["travel_end"] = self._profile.units.travel[1 if rate >= 0.0 else 0]
        return values

    def _table_rate(self, line: TableLine, rate_deg_s: float) -> float:
        units, highest = self._profile.units, self._profile.safety.max_rate_deg_s
        bound = min(highest, units.rate_max / self._rate_per_deg)
        if not abs(rate_deg_s) <= bound:
            raise limit_error(line, f"a rate of {rate_deg_s:g} deg/s is beyond the {bound:g} deg/s of its profile")
        rate = self.sign * round(rate_deg_s * self._rate_per_deg / units.rate_quantum) * units.rate_quantum
        if rate_deg_s and abs(rate) < max(units.rate_min, units.rate_quantum * 0.5):
            least = max(units.rate_min, units.rate_quantum) / self._rate_per_deg
            raise limit_error(
                line, f"a rate of {rate_deg_s:g} deg/s is below the least of its profile, {least:g} deg/s"
            )
        return rate

    def table_acceleration(self, acceleration_deg_s2: float) -> float | None:
        """Return the acceleration in the table's units, not above that demanded; None if it cannot be told that."""
        units, highest = self._profile.units, self._profile.safety.max_acceleration_deg_s2
        commanded = acceleration_deg_s2 * self._acceleration_per_deg
        if units.acceleration_quantum is not None and math.isfinite(commanded):
            commanded = math.floor(commanded / units.acceleration_quantum * (1.0 + 1e-12)) * units.acceleration_quantum
        bad = not 0.0 < acceleration_deg_s2 <= highest or not commanded > 0.0
        return None if bad or not units.acceleration_min <= commanded <= units.acceleration_max else commanded


def limit_error(line: TableLine, what: str) -> LimitError:
    """Return the error of a motion beyond a limit, which is not sent."""
    return LimitError(f"{what}, nothing was sent", **located(line))
