"""The procedures that this version knows, by the names of the command line."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from vcfbench.errors import PlanError
from vcfbench.procedures.results import turntable_results, virtual_coriolis_results
from vcfbench.procedures.turntable import turntable
from vcfbench.procedures.virtual_coriolis import virtual_coriolis

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from vcfbench.procedures.settings import CalibrationSettings
    from vcfbench.procedures.steps import Plan
    from vcfbench.record.schema import Point

__all__ = ["PROCEDURES", "Procedure", "procedure"]


@dataclass(frozen=True, slots=True)
class Procedure:
    """A procedure: its name, what it is for, its plan and the arithmetic from its points to its results."""

    name: str
    title: str
    plan: Callable[[CalibrationSettings], Plan]
    results: Callable[[CalibrationSettings, Sequence[Point]], dict[str, Any]]


def _turntable(settings: CalibrationSettings, points: Sequence[Point]) -> dict[str, Any]:
    return turntable_results(points, settings.meter_resolution_v)


def _virtual_coriolis(settings: CalibrationSettings, points: Sequence[Point]) -> dict[str, Any]:
    return virtual_coriolis_results(points, settings.match, settings.match_rate_deg_s, settings.meter_resolution_v)


PROCEDURES = {
    each.name: each
    for each in (
        Procedure("turntable", "calibration on the rate table", turntable, _turntable),
        Procedure("virtual-coriolis", "the paper's four-step calibration", virtual_coriolis, _virtual_coriolis),
    )
}
"""Every known procedure by name."""


def procedure(name: str) -> Procedure:
    """Return the procedure called `name`.

    Raises:
        PlanError: there is none; the words list those that there are.
    """
    try:
        return PROCEDURES[name]
    except KeyError:
        raise PlanError(f"there is no procedure {name!r}; known are {', '.join(PROCEDURES)}") from None
