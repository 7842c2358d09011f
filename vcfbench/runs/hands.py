"""Operator of the manual steps of a run: a person, or on a simulated bench the simulation."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vcfbench.errors import PlanError
from vcfbench.steps import AskOperator
from vcfbench.steps.operator import simulated_operator
from vcfbench.steps.step import nobody

if TYPE_CHECKING:
    from vcfbench.bench.bench import Bench
    from vcfbench.runs.request import DryRun, Request
    from vcfbench.station.description import BenchDescription
    from vcfbench.steps.step import Operator


def require_operator(request: Request, description: BenchDescription, planned: DryRun) -> None:
    """Raise PlanError when nobody is there for the plan's manual steps; known before anything is opened.

    Raises:
        PlanError: the bench is real and nobody is.
    """
    if description.simulated or request.operator is not None or request.person is not None:
        return
    requests = [each.step for each in planned.steps if isinstance(each.step, AskOperator)]
    if requests:
        more = "" if len(requests) == 1 else f", and {len(requests) - 1} more"
        raise PlanError(
            f"{planned.procedure} asks a person to {requests[0].words}{more}, and nobody is there to be asked",
            hint="run it at a terminal, or with --yes if all is done as asked; from Python with an operator",
        )


def operator_of(request: Request, bench: Bench) -> Operator:
    """Return the operator: the caller's own, on a simulated bench the simulation, else a person if any."""
    return request.operator or simulated_operator(bench) or request.person or nobody
