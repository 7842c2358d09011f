"""What the ACUTROL3000 measures of its axis, as the host reads it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simrack.rate_tables.acl.replies import ACCELERATION, ANGLE, RATE

if TYPE_CHECKING:
    from simrack.rate_tables.acl.arguments import Query
    from simrack.rate_tables.acl.drive import AclDrive
    from simrack.rate_tables.acl.profiler import Profiler
    from simrack.rate_tables.acl.replies import StateFormat


class Readback:
    """Read and all below it."""

    def __init__(self, drive: AclDrive, profiler: Profiler, states: StateFormat) -> None:
        self._axis = drive.axis
        self._profiler = profiler
        self._states = states

    def queries(self) -> dict[str, Query]:
        """Return what can be read."""
        of_axis = self._states.of_axis
        return {
            "Read:Position": lambda a: of_axis(a, self._position()),
            "Read:Rate": lambda a: of_axis(a, self._rate()),
            "Read:Acceleration": lambda a: of_axis(a, self._acceleration()),
            "Read:Vector": lambda a: of_axis(a, self._position(), self._rate(), self._acceleration()),
            "Read:ShortVector": lambda a: of_axis(a, self._position(), self._rate()),
        }

    def _position(self) -> tuple[float, float]:
        return round(self._axis.angle_deg() % 360.0, 5) % 360.0, ANGLE

    def _rate(self) -> tuple[float, float]:
        return self._axis.rate_deg_s(), RATE

    def _acceleration(self) -> tuple[float, float]:
        return self._profiler.acceleration_deg_s2(), ACCELERATION
