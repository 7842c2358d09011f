"""Reports as plain values and back: the form in records, whose procedure may not be there later."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from vcfbench.errors import ConfigError
from vcfbench.records.plain import plain
from vcfbench.reports.document import Axis, Cell, Column, Figure, Heading, Notice, Report, Series, Table, Text

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from vcfbench.reports.document import Part


def plain_report(report: Report) -> list[dict[str, Any]]:
    """Return the parts of `report` as JSON has them: the fields of each, and which it is.

    Raises:
        ConfigError: a number in it is not finite.
    """
    return [{"part": type(part).__name__.lower(), **plain(part, "report")} for part in report.parts]


def report_from(parts: Sequence[Mapping[str, Any]]) -> Report:
    """Return the report that :func:`plain_report` wrote.

    Raises:
        ConfigError: it did not.
    """
    try:
        return Report([_part(dict(part)) for part in parts])
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise ConfigError(f"the report that is kept is none of this program: {error!r}") from error


def _part(stored: dict[str, Any]) -> Part:
    match stored.pop("part"):
        case "heading":
            return Heading(**stored)
        case "text":
            return Text(**stored)
        case "notice":
            return Notice(**stored)
        case "table":
            rows = [[Cell(**each) if isinstance(each, dict) else each for each in row] for row in stored["rows"]]
            return Table([Column(**each) for each in stored["columns"]], rows, stored["title"])
        case "figure":
            axes = Axis(**stored["x"]), Axis(**stored["y"])
            return Figure(stored["title"], *axes, [Series(**each) for each in stored["series"]], stored["caption"])
        case other:
            raise ValueError(f"there is no part {other!r}")
