"""Report of a procedure that has none of its own: its points, and its results by their names."""

from collections.abc import Iterator, Sequence
from typing import Any

from vcfbench.records.plain import plain
from vcfbench.records.schema import Point
from vcfbench.reports.document import Cell, Report, Table, Value, heads, texts
from vcfbench.station.acceptance import Acceptance
from vcfbench.values.printing import grouped, incomplete
from vcfbench.values.value import Value as Quantity

_QUANTITY = {*Quantity.__struct_fields__, "u_fit", "complete"}
_SHOWN = 4  # So many numbers of a list are printed; its length is said where there are more


def generic_report(_settings: object, points: Sequence[Point], results: object) -> Report:
    """Return the report of a procedure without one of its own: a table of points and one of the results' fields."""
    tables = [points_table(points)] if points else []
    return Report([*tables, *results_table(results)])


def points_table(points: Sequence[Point]) -> Table:
    """Return a row of each point, with set and measured V_Vc."""
    columns = heads("step | rate [deg/s]:.6g | V_Vc [V]:.6g | output [V]:.5f | s [V]:.1e | n")
    rows = [(p.step, p.rate_deg_s, p.v_vc_v, p.output_v, p.std_v, p.n) for p in points]
    if all(point.v_vc_measured_v is None for point in points):
        return Table(columns, rows)
    measured = heads("V_Vc measured [V]:.6f | its s [V]:.1e")
    seen = ((point.v_vc_measured_v, point.v_vc_std_v) for point in points)
    return Table((*columns, *measured), [(*row, *more) for row, more in zip(rows, seen, strict=True)])


def results_table(
    results: object, title: str = "", head: str = "result", shown: int | None = _SHOWN
) -> tuple[Table, ...]:
    """Return a table of all `results`, nested names joined by dots; empty without results.

    `shown` numbers of a list are printed; None for all.
    """
    value = plain(results)
    rows = [] if value is None else list(_rows(value, "" if _is_named(value) else head, shown))
    names = (head, "value", "u", "unit")[: max(map(len, rows), default=0)]
    padded = [(*row, *[""] * (len(names) - len(row))) for row in rows]
    return (Table(texts(*names), padded, title),) if rows else ()


def _rows(value: Any, name: str, shown: int | None) -> Iterator[tuple[Value | Cell, ...]]:
    if _is_named(value):
        for key, each in value.items():
            yield from _rows(each, f"{name}.{key}" if name else key, shown)
    elif isinstance(value, dict):
        yield (
            name,
            _figure(value["value"]),
            Cell(value.get("u"), ".2g") if value.get("u") is not None else "",
            value.get("unit", "") + incomplete(value.get("missing", ())),
        )
    elif isinstance(value, list) and any(isinstance(each, dict | list) for each in value):
        for place, each in enumerate(value):
            yield from _rows(each, f"{name}[{place}]", shown)
    else:
        yield name, _figure(value, shown)


def _is_named(value: Any) -> bool:
    """Return True if it holds values by name, and is no value with its uncertainty."""
    if not isinstance(value, dict):
        return False
    number = value.get("value", "")
    numeric = number is None or (
        isinstance(number, int | float) and ("u_fit" in value or isinstance(value.get("u", 0.0), int | float))
    )
    return not (numeric and value.keys() <= _QUANTITY and isinstance(value.get("unit", ""), str))


def _figure(value: Any, shown: int | None = None) -> Value | Cell:
    """Return one value or a list of plain ones as it is printed."""
    if isinstance(value, list):
        words = ", ".join(str(_words(each)) for each in value[:shown])
        return words if shown is None or len(value) <= shown else f"{words}, ... ({len(value)} in all)"
    return Cell(value, ".6g") if isinstance(value, float) else _words(value)


def _words(value: Any) -> Value:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return format(value, ".6g") if isinstance(value, float) else value


def verdict_table(acceptance: Acceptance) -> Table:
    """Return PASS, MARGINAL or FAIL, the parts that U95 lacks, and every limit with its value and its rule."""
    rows = []
    for each in acceptance.limits:
        of, value = acceptance.named(each), acceptance.judged(each)
        u95 = None if each.u95 is None else grouped(abs(of.factor) * each.u95)
        figure = "-" if value is None else value.figure(of.factor) + value.found_in_bound(of.factor)
        rows.append((of.words, figure, u95, of.factor * each.low, of.factor * each.high, of.unit, each.said, each.rule))
    columns = heads("<value judged | value | U95 | low:g | high:g | <unit | verdict | <rule")
    return Table(columns, rows, title=acceptance.said)
