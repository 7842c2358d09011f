"""The table of points that grows while they are measured: as many columns as there is room for."""

from collections import defaultdict
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from msgspec import Struct

from vcfbench.analysis.regression import LineFit, line_so_far
from vcfbench.records.schema import Point
from vcfbench.steps import Window

_GAP = "  "
_LEAST_MV = 1e-3


class PointsSoFar:
    """The points of a run by the step that they are of, each a calibration with a line of its own."""

    def __init__(self, points: Iterable[Point] = ()) -> None:
        self._of_step: dict[int, list[Point]] = defaultdict(list)
        for point in points:
            self._of_step[point.step].append(point)

    def add(self, point: Point) -> float | None:
        """Take in a point; return its residual, V, from the line through all of its step; None while there is none."""
        self._of_step[point.step].append(point)
        line = self.line(point.step)
        return None if line is None else float(line.residuals_v[-1])

    def line(self, step: int) -> LineFit | None:
        """Return the line through the points of `step`; None while they have fewer than three rates."""
        points = self._of_step.get(step, [])
        return line_so_far([each.rate_deg_s for each in points], [each.output_v for each in points])

    def steps(self) -> tuple[int, ...]:
        """Return the steps that have points, in the order of their first ones."""
        return tuple(self._of_step)

    def line_words(self, step: int) -> str:
        """Describe the line through the points of `step`; empty while there is none."""
        line = self.line(step)
        if line is None:
            return ""
        points = self._of_step[step]
        worst = max(range(len(points)), key=lambda number: abs(line.residuals_v[number]))
        return (
            f"line through {len(points)} points: {1e3 * line.scale_factor:.5f} mV/(deg/s), {1e3 * line.bias:+.3f} mV; "
            f"largest residual {1e3 * line.residuals_v[worst]:+.3f} mV at {points[worst].rate_deg_s:+.6g} deg/s"
        )


class PointRow(Struct, frozen=True):
    """A window as it stands in the table: bench time of its end (s), the window, and its residual (V) if it has one."""

    t_s: float
    window: Window
    residual_v: float | None

    @property
    def point(self) -> Point:
        """Point of its readings."""
        return self.window.point


class _Column(NamedTuple):
    """Heading in two lines (name, unit), width, text, and rank: the highest goes first where room is short."""

    name: str
    unit: str
    width: int
    text: Callable[[PointRow], str]
    rank: int


def _scatter(row: PointRow) -> str:
    std_mv = 1e3 * row.point.std_v
    return f"{std_mv:.3f}" if std_mv == 0.0 or std_mv >= _LEAST_MV else f"{std_mv:.0e}"


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


_COLUMNS = (
    _Column("time", "", 7, lambda row: span(row.t_s), 4),
    _Column("step", "", 4, lambda row: str(row.point.step), 5),
    _Column("rate", "deg/s", 9, lambda row: f"{row.point.rate_deg_s:+.6g}", 0),
    _Column("V_Vc", "V", 9, lambda row: f"{row.point.v_vc_v:+.5f}", 3),
    _Column("output", "V", 9, lambda row: f"{row.point.output_v:+.5f}", 1),
    _Column("s", "mV", 7, _scatter, 6),
    _Column("n", "", 5, lambda row: str(row.point.n), 7),
    _Column("residual", "mV", 9, lambda row: "-" if row.residual_v is None else f"{1e3 * row.residual_v:+.3f}", 2),
    _Column("table reads", "deg/s", 11, lambda row: _number(row.window.table_rate_deg_s, "+.4f"), 8),
)


_V_VC_MEASURED = _Column("V_Vc measured", "V", 13, lambda row: _number(row.point.v_vc_measured_v, "+.6f"), 9)


def _columns(row: PointRow, width: int) -> tuple[_Column, ...]:
    """Return the columns that have room in `width` characters, by rank; rate and output always."""
    known = _COLUMNS if row.point.v_vc_measured_v is None else (*_COLUMNS, _V_VC_MEASURED)
    chosen: list[_Column] = []
    for column in sorted(known, key=lambda each: each.rank):
        needed = sum(each.width + len(_GAP) for each in chosen) + column.width
        if column.rank <= 1 or needed <= width:
            chosen.append(column)
    return tuple(column for column in known if column in chosen)


def head(row: PointRow, width: int) -> tuple[str, str]:
    """Return the two lines that stand above a row: names and units."""
    columns = _columns(row, width)
    return _line(columns, lambda each: each.name), _line(columns, lambda each: each.unit)


def row_text(row: PointRow, width: int) -> str:
    """Return a row in the columns that have room."""
    return _line(_columns(row, width), lambda each: each.text(row))


def _line(columns: Iterable[_Column], text: Callable[[Any], str]) -> str:
    return _GAP.join(f"{text(column):>{column.width}}" for column in columns).rstrip()


def span(seconds: float) -> str:
    """Return a time as m:ss or h:mm:ss."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"
