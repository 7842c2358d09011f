"""What a record is made of."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["FORMAT", "Point", "Status"]

FORMAT = 1
"""Version of the journal's layout; raised when a reader of the old one would misread the new one."""


class Status(Enum):
    """How a run ended. A journal without its last line is `INCOMPLETE`, whatever is in it."""

    COMPLETE = "complete"
    ABORTED = "aborted"
    INCOMPLETE = "incomplete"


@dataclass(frozen=True, slots=True)
class Point:
    """One averaged point: step, rate (deg/s), V_Vc (V), mean output (V), its scatter (V), count.

    `step` is the number of the procedure's step. `rate_deg_s` is the table's rate; in step 4 of the virtual Coriolis
    calibration it is K_Vc V_Vc, the rate that V_Vc stands for. `std_v` is the sample standard deviation of the `n`
    readings, not of their mean.
    """

    step: int
    rate_deg_s: float
    v_vc_v: float
    output_v: float
    std_v: float
    n: int

    def as_json(self) -> dict[str, float | int]:
        """Return the point with the names of the command's JSON output."""
        return {
            "step": self.step,
            "rate_deg_s": self.rate_deg_s,
            "v_vc_v": self.v_vc_v,
            "output_v": self.output_v,
            "std_v": self.std_v,
            "n": self.n,
        }

    @classmethod
    def from_json(cls, values: Mapping[str, float]) -> Point:
        """Return the point that :meth:`as_json` wrote."""
        return cls(
            int(values["step"]),
            float(values["rate_deg_s"]),
            float(values["v_vc_v"]),
            float(values["output_v"]),
            float(values["std_v"]),
            int(values["n"]),
        )
