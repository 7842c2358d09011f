"""The procedures that this version knows, by the names of the command line."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vcfbench.errors import PlanError
from vcfbench.procedures.turntable import TURNTABLE
from vcfbench.procedures.virtual_coriolis import VIRTUAL_CORIOLIS

if TYPE_CHECKING:
    from vcfbench.procedures.procedure import AnyProcedure

__all__ = ["PROCEDURES", "procedure"]


PROCEDURES: dict[str, AnyProcedure] = {each.name: each for each in (TURNTABLE, VIRTUAL_CORIOLIS)}
"""Every known procedure by name."""


def procedure(name: str) -> AnyProcedure:
    """Return the procedure called `name`.

    Raises:
        PlanError: there is none; the words list those that there are.
    """
    try:
        return PROCEDURES[name]
    except KeyError:
        raise PlanError(f"there is no procedure {name!r}; known are {', '.join(PROCEDURES)}") from None
