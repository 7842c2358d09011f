"""Parts of a record."""

import math
from collections.abc import Mapping, Sequence
from enum import StrEnum
from typing import Annotated, Final, Literal, Self

from msgspec import Meta, Struct
from msgspec.structs import asdict, replace

from vcfbench.errors import ConfigError
from vcfbench.typed import typed

FORMAT = 3
"""Version of the journal's layout (docs/records.md); raised when a reader of the old one would misread the new one."""

LineKind = Literal[
    "header",
    "step",
    "readings",
    "restored",
    "paused",
    "went_on",
    "error",
    "watchdog",
    "footer",
    "amendment",
    "signature",
]
"""Types of the lines of a journal."""

CHUNK_READINGS = 1000
CHUNK_S = 60.0
"""Readings of one step are written as soon as there are so many, or the first is so old (s of bench time)."""


def fits_one_chunk(count: int, interval_s: float) -> bool:
    """Return True if `count` readings, one every `interval_s`, stay together in the line of their step."""
    return count <= CHUNK_READINGS and (count - 1) * interval_s < CHUNK_S


class Status(StrEnum):
    """Status of a run.

    A journal without its last line is `RUNNING` while its run goes on, else `INCOMPLETE`, one that was changed since
    `DAMAGED`, one that is no journal `UNREADABLE`.

    >>> run.status == "complete", run.status is vcfbench.Status.COMPLETE
    (True, True)
    """

    COMPLETE = "complete"
    ABORTED = "aborted"
    RUNNING = "running"
    INCOMPLETE = "incomplete"
    DAMAGED = "damaged"
    UNREADABLE = "unreadable"


_LARGEST = 1e15
_Count = Annotated[int, Meta(ge=0, le=10**9)]
_Number = Annotated[float, Meta(ge=-_LARGEST, le=_LARGEST)]
"""No table turns so many deg/s, no wire carries so many volts, no word has so many steps, and squares stay finite."""


class Point(Struct, frozen=True):
    """One averaged point: step, rate (deg/s), V_Vc (V), mean output (V), its scatter (V), count.

    `step` is the number of the procedure's step. `rate_deg_s` is the table's rate; in step 4 of the virtual Coriolis
    calibration it is K_Vc V_Vc, the rate that V_Vc stands for. `std_v` is the sample standard deviation of the `n`
    readings, not of their mean. `v_vc_v` is the generator's setting as it reads it back. Where V_Vc was measured,
    `v_vc_measured_v` is the mean of what the meter on it read meanwhile, and `v_vc_std_v` is the standard deviation of
    one such reading. `moved_v` is by how much the output at rest had moved in pauses of the run before, in V, with its
    standard uncertainty `moved_u_v`: results count from the first reference, `output_v` is as it was read.

    >>> point = run.points[0]
    >>> f"{point.output_v:+.3f} V at {point.rate_deg_s:+g} deg/s, mean of {point.n}"
    '-0.167 V at +10 deg/s, mean of 3'
    """

    step: _Count
    rate_deg_s: _Number
    v_vc_v: _Number
    output_v: _Number
    std_v: _Number
    n: _Count
    v_vc_measured_v: _Number | None = None
    v_vc_std_v: _Number | None = None
    moved_v: _Number = 0.0
    moved_u_v: _Number = 0.0

    def __post_init__(self) -> None:
        if self.step < 0:
            raise ConfigError(f"step: expected a whole number from 0, got {self.step}")
        for name in self.__struct_fields__:
            value = getattr(self, name)
            if value is not None and not abs(value) <= _LARGEST:
                raise ConfigError(f"{name}: expected a number within +-{_LARGEST:g}, got {value:g}")

    def referred(self) -> Self:
        """Return the point as it would be, had the output not moved in pauses; `moved_u_v` stays."""
        return replace(self, output_v=self.output_v - self.moved_v, moved_v=0.0) if self.moved_v else self

    def moved(self, output_v: float, v_vc_v: float) -> Self:
        """Return the point as it would be with so much more output, V, and more V_Vc where that was measured, V."""
        measured_v = self.v_vc_measured_v
        also_v = None if measured_v is None else measured_v + v_vc_v
        return replace(self, output_v=self.output_v + output_v, v_vc_measured_v=also_v)

    def as_json(self) -> dict[str, float | int]:
        """Return the point with the names of the command's JSON output; V_Vc's readings only where it was measured."""
        point = asdict(self)
        left_out = ("v_vc_measured_v", "v_vc_std_v") if None in (self.v_vc_measured_v, self.v_vc_std_v) else ()
        for name in (*left_out, *(() if self.moved_u_v else ("moved_v", "moved_u_v"))):
            del point[name]
        return point

    @classmethod
    def from_json(cls, values: Mapping[str, float]) -> Self:
        """Return the point that :meth:`as_json` wrote; ValueError if it did not."""
        return typed(values, cls)


POINT_COLUMNS: Final = Point.__struct_fields__[:6]  # Columns of ``points.csv``, which ``vcfbench analyze`` reads back
V_VC_COLUMNS: Final = Point.__struct_fields__[6:8]
"""Further columns where V_Vc was measured; empty in the lines of points where it was not."""
PAUSE_COLUMNS: Final = Point.__struct_fields__[8:]
"""Further columns of a run that paused; empty in the lines of points before."""


def pooled_std_v(points: Sequence[Point]) -> float:
    """Return the standard deviation of one reading, V, from all windows: ten readings know theirs to a quarter.

    Raises:
        ConfigError: no window has two readings.
    """
    degrees = sum(point.n - 1 for point in points)
    if degrees < 1:
        raise ConfigError("the noise is unknown: no window has two readings or more")
    return math.sqrt(math.fsum((point.n - 1) * point.std_v**2 for point in points) / degrees)
