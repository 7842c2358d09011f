"""A report as plain values, without HTML, which the page draws by itself."""

from typing import Any

from msgspec import to_builtins

from vcfbench.archive.run import Run
from vcfbench.reports.document import Figure, Report, Table


def parts_of(report: Report) -> list[dict[str, Any]]:
    """Return the parts one after the other; numbers of tables as they are printed, those of figures as they are."""
    parts = []
    for part in report.parts:
        shown: dict[str, Any] = to_builtins(part)
        if isinstance(part, Table):
            columns = [{"head": column.head, "align": column.align} for column in part.columns]
            shown |= {"columns": columns, "rows": part.printed()}
        elif isinstance(part, Figure):
            axes = (("x", part.x), ("y", part.y))
            shown |= {name: {"title": axis.title, "log": axis.scale == "log"} for name, axis in axes}
        parts.append(shown)
    return parts


def end_of(run: Run) -> dict[str, Any]:
    """Return the end of a run for the page."""
    return {
        "status": run.status.value,
        "error": None if run.error is None else str(run.error),
        "verdict": None if run.verdict is None else run.verdict.word,
        "record": None if run.directory is None else str(run.directory),
        "parts": parts_of(run.report()),
    }
