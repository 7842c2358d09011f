"""Evaluation of the points of a run: results, the verdict on them, and the report."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from msgspec import Struct

from vcfbench.errors import BenchError, ConfigError
from vcfbench.records.plain import plain, read_only
from vcfbench.reports.document import Report, Text
from vcfbench.reports.generic import generic_report, points_table
from vcfbench.station.acceptance import judged

if TYPE_CHECKING:
    from collections.abc import Sequence

    from vcfbench.procedures.procedure import AnyProcedure
    from vcfbench.records.schema import Point
    from vcfbench.station.acceptance import Acceptance
    from vcfbench.station.settings import Limit
    from vcfbench.steps.measured import Measured


class Evaluation(Struct, frozen=True):
    """Evaluation of the points of a run; `results` None where there are none."""

    results: Any
    verdict: Acceptance | None
    report: Report
    measured: Any = None
    """Measured data of the results, where they were computed: a journal of a million readings is not read once more."""


def nothing(points: Sequence[Point]) -> Evaluation:
    """Return the evaluation of a run without results: its points."""
    return Evaluation(None, None, Report([points_table(points)]))


def evaluate(procedure: AnyProcedure, settings: Any, limits: Sequence[Limit], measured: Measured) -> Evaluation:
    """Compute the results of `procedure`, judge them by `limits`, and make their report.

    Raises:
        BenchError: the points give no result, or one that cannot be written.
    """
    try:
        taken = measured.corrected(settings.station.sources)  # points that are kept are as they were read
        results = read_only(procedure.results(settings, taken))
        plain(results)  # what cannot be written is no result
        verdict = judged(limits, results, measured)
    except BenchError:
        raise
    except Exception as error:  # the arithmetic is anybody's
        raise ConfigError(_mistake_in(error)) from error
    return Evaluation(results, verdict, _report(procedure, settings, taken, results), measured)


def _report(procedure: AnyProcedure, settings: Any, measured: Measured, results: Any) -> Report:
    """Return the report of the procedure; where it fails, the points and results with the reason."""
    try:
        made = procedure.report(settings, measured, results)
        if isinstance(made, Report):
            return made
        failed = f"it returned a {type(made).__name__}"
    except Exception as error:  # noqa: BLE001  # it is anybody's, and the results are there
        failed = _mistake_in(error)
    notice = Text(f"the report of {procedure.name} failed: {failed}")
    return Report([*generic_report(settings, measured, results).parts, notice])


def _mistake_in(error: BaseException) -> str:
    from vcfbench.procedures.own_code import mistake_in  # noqa: PLC0415  # most make none

    return mistake_in(error)
