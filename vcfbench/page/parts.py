"""A report as plain values for a page, which draws it with its own means: no HTML is made of a record's words."""

from typing import Any

from vcfbench.archive.run import Run
from vcfbench.reports.document import Figure, Heading, Notice, Part, Report, Table, Text


def parts_of(report: Report) -> list[dict[str, Any]]:
    """Return the parts one after the other; numbers of tables as they are printed, those of figures as they are."""
    return [_part(part) for part in report.parts]


def end_of(run: Run) -> dict[str, Any]:
    """Return the end of a run, as a page tells it."""
    return {
        "status": run.status.value,
        "error": None if run.error is None else str(run.error),
        "verdict": None if run.verdict is None else run.verdict.word,
        "record": None if run.directory is None else str(run.directory),
        "parts": parts_of(run.report()),
    }


def _part(part: Part) -> dict[str, Any]:
    match part:
        case Heading():
            return {"kind": "heading", "text": part.text, "level": part.level}
        case Table():
            columns = [{"head": column.head, "align": column.align} for column in part.columns]
            return {"kind": "table", "title": part.title, "columns": columns, "rows": part.printed()}
        case Text():
            return {"kind": "text", "text": part.text}
        case Notice():
            return {"kind": "notice", "text": part.text, "means": part.kind}
        case Figure():
            return {
                "kind": "figure",
                "title": part.title,
                "x": {"title": part.x.title, "log": part.x.scale == "log"},
                "y": {"title": part.y.title, "log": part.y.scale == "log"},
                "series": [{"label": s.label, "x": s.x, "y": s.y, "kind": s.kind} for s in part.series],
            }
