"""What a procedure is: one object, from which come its command, its settings in the bench file, its record."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from vcfbench.interfaces import (
    FunctionGenerator,
    MeasuresWaveforms,
    Multimeter,
    Oscilloscope,
    PowersRails,
    PowerSupply,
    RateTable,
    ReadsVoltage,
    Rotates,
    SetsVoltage,
)
from vcfbench.report.generic import generic_report

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from vcfbench.procedures.step import Plan
    from vcfbench.record.schema import Point
    from vcfbench.report.document import Report

S = TypeVar("S")
R = TypeVar("R")

PAPER_BENCH: Mapping[str, type] = MappingProxyType(
    {
        "power": PowerSupply,
        "rate_source": FunctionGenerator,
        "multimeter": Multimeter,
        "oscilloscope": Oscilloscope,
        "rate_table": RateTable,
    }
)
"""The paper's five instruments by their roles, and what each must be able to do."""

CALIBRATION_NEEDS: Mapping[str, type] = MappingProxyType(
    {"power": PowersRails, "rate_source": SetsVoltage, "multimeter": ReadsVoltage, "rate_table": Rotates}
)
"""What both calibrations of the paper cannot do without."""

CALIBRATION_USES: Mapping[str, type] = MappingProxyType({"oscilloscope": MeasuresWaveforms})
"""What they look at the drive signal with; without it they say that it was not checked."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Procedure(Generic[S, R]):
    """One calibration: what it is called, what it is told, what it does, what comes of it, what it needs.

    Args:
        name: of its command, of its table in the bench file and in its records: ``turntable``.
        title: one line, the help of its command.
        settings: the class of its settings, each with its range and its default.
        plan: makes the plan, a generator of steps, from the settings.
        results: makes the results from settings and points; pure, so that a record gives the same results again.
            Any frozen dataclass or msgspec struct will do: its fields are what is written.
        report: makes the report from settings, points and results; without it points and fields of the results.
        needs: the roles that must be on the bench, and what the instrument in each must be able to do.
        uses: the roles that it makes use of where the bench has them, likewise.
    """

    name: str
    title: str
    settings: type[S]
    plan: Callable[[S], Plan]
    results: Callable[[S, Sequence[Point]], R]
    report: Callable[[S, Sequence[Point], R], Report] = generic_report
    needs: Mapping[str, type] = field(default_factory=lambda: PAPER_BENCH)
    uses: Mapping[str, type] = field(default_factory=lambda: MappingProxyType({}))

    def __repr__(self) -> str:
        return f"<Procedure {self.name}>"


AnyProcedure = Procedure[Any, Any]
"""A procedure of whatever settings and results."""
