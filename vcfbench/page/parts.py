"""A report as plain values for a page, which draws it with its own means: no HTML is made of a record's words."""

from typing import Any

from msgspec import to_builtins

from vcfbench.archive.run import Run
from vcfbench.reports.document import Figure, Part, Report, Table


def parts_of(report: Report) -> list[dict[str, Any]]:
    """Return the parts one after the other; numbers of tables as they are printed, those of figures as they are."""
    return [{**to_builtins(part), **_shown(part)} for part in report.parts]


def end_of(run: Run) -> dict[str, Any]:
    """Return the end of a run, as a page tells it."""
    return {
        "status": run.status.value,
        "error": None if run.error is None else str(run.error),
        "verdict": None if run.verdict is None else run.verdict.word,
        "record": None if run.directory is None else str(run.directory),
        "parts": parts_of(run.report()),
    }


def _shown(part: Part) -> dict[str, Any]:
    """Return what a page has otherwise than the part itself."""
    match part:
        case Table():
            columns = [{"head": column.head, "align": column.align} for column in part.columns]
            return {"columns": columns, "rows": part.printed()}
        case Figure():
            return {
                name: {"title": axis.title, "log": axis.scale == "log"} for name, axis in (("x", part.x), ("y", part.y))
            }
    return {}
