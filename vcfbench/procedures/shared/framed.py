"""Plans inside of routines that begin and end them."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

from vcfbench.procedures.shared.known.scale_factor import AtRestSettings, read_scale_factor
from vcfbench.station.settings import ProcedureSettings
from vcfbench.steps.step import Plan

S = TypeVar("S", bound=ProcedureSettings)


def framed(*frames: Callable[[Any, Plan], Plan]) -> Callable[[Callable[[S], Plan]], Callable[[S], Plan]]:
    """Have a plan done inside of `frames`, the first of which is the outermost: ``@framed(energised, at_rest)``."""

    def of(plan: Callable[[S], Plan]) -> Callable[[S], Plan]:
        @wraps(plan)
        def inside(settings: S) -> Plan:
            work = plan(settings)
            for frame in reversed(frames):
                work = frame(settings, work)
            return work

        return inside

    return of


def scale_factor_read(settings: AtRestSettings, work: Plan) -> Plan:
    """Read the scale factor where a record tells it, then do `work`."""
    yield from read_scale_factor(settings)
    return (yield from work)
