"""Progress of a run on a terminal, drawn in place: the table of its points, the step, and the time left."""

from collections.abc import Callable, Sequence
from datetime import timedelta
from typing import Any, NamedTuple, Self, TextIO

from msgspec import Struct
from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from vcfbench.clock import WallClock, utc_now
from vcfbench.records.schema import Point
from vcfbench.reports.bench_state import BenchState
from vcfbench.reports.outlet import Outlet
from vcfbench.reports.plot import line_of
from vcfbench.reports.progress import HOW_ON, paused_words, wanted_words
from vcfbench.reports.shielded import NoProgress
from vcfbench.reports.text import printable
from vcfbench.safety.control import RunState
from vcfbench.steps import Acquire, Note, Window
from vcfbench.steps.events import Event, Paused, ReadingTaken, StepFailed, StepFinished, StepStarted, WentOn
from vcfbench.steps.step import Effect, Step, StepResult
from vcfbench.values.kinds import slope_unit
from vcfbench.values.printing import in_unit

_GAP = "  "
_LEAST_MV = 1e-3


class _PointRow(Struct, frozen=True):
    """A window as it stands in the table: bench time of its end (s), the window, and its residual (V) if it has one."""

    t_s: float
    window: Window
    residual_v: float | None


class _Column(NamedTuple):
    """Heading in two lines (name, unit), width, text, and rank: the highest goes first where room is short."""

    name: str
    unit: str
    width: int
    text: Callable[[_PointRow], str]
    rank: int


def _scatter(row: _PointRow) -> str:
    std_mv = 1e3 * row.window.point.std_v
    return f"{std_mv:.3f}" if std_mv == 0.0 or std_mv >= _LEAST_MV else f"{std_mv:.0e}"


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


_COLUMNS: tuple[_Column, ...] = (
    _Column("time", "", 7, lambda row: span(row.t_s), 4),
    _Column("step", "", 4, lambda row: str(row.window.point.step), 5),
    _Column("rate", "deg/s", 9, lambda row: f"{row.window.point.rate_deg_s:+.6g}", 0),
    _Column("V_Vc", "V", 9, lambda row: f"{row.window.point.v_vc_v:+.5f}", 3),
    _Column("output", "V", 9, lambda row: f"{row.window.point.output_v:+.5f}", 1),
    _Column("s", "mV", 7, _scatter, 6),
    _Column("n", "", 5, lambda row: str(row.window.point.n), 7),
    _Column("residual", "mV", 9, lambda row: "-" if row.residual_v is None else f"{1e3 * row.residual_v:+.3f}", 2),
    _Column("table reads", "deg/s", 11, lambda row: _number(row.window.table_rate_deg_s, "+.4f"), 8),
)


_V_VC_MEASURED = _Column("V_Vc measured", "V", 13, lambda row: _number(row.window.point.v_vc_measured_v, "+.6f"), 9)


def _columns_of(unit: str) -> tuple[_Column, ...]:
    """Return the columns of an output in its own unit: no V_Vc, no thousandths."""
    texts: dict[str, Callable[[_PointRow], str]] = {
        "output": lambda row: f"{row.window.point.output_v:+.5f}",
        "s": lambda row: f"{row.window.point.std_v:.1e}",
        "residual": lambda row: _number(row.residual_v, "+.2g"),
    }
    own = (each._replace(unit=unit, text=texts[each.name]) if each.name in texts else each for each in _COLUMNS)
    return tuple(each for each in own if each.name != "V_Vc")


def _in_columns(row: _PointRow, width: int, unit: str) -> list[str]:
    """Return names, units and texts of the columns that have room in `width`, by rank; rate and output always have."""
    known = _COLUMNS if row.window.point.v_vc_measured_v is None else (*_COLUMNS, _V_VC_MEASURED)
    known = known if unit == "V" else _columns_of(unit)
    chosen: list[_Column] = []
    for column in sorted(known, key=lambda each: each.rank):
        needed = sum(each.width + len(_GAP) for each in chosen) + column.width
        if column.rank <= 1 or needed <= width:
            chosen.append(column)
    cells = [[f"{said:>{e.width}}" for said in (e.name, e.unit, e.text(row))] for e in known if e in chosen]
    return [_GAP.join(line).rstrip() for line in zip(*cells, strict=True)]


def span(seconds: float) -> str:
    """Return a time as m:ss or h:mm:ss."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


_REDRAW_S = 0.1
_REDRAWS_PER_S = 2.0  # So often the block is drawn anew while nothing happens: the time left goes on
_HALF_A_DAY_S = 43_200.0
_ECHO = 4
"""Columns left free behind the bar: a terminal writes ^C there, and in a line of its own it would leave some behind."""
_BAR_FROM = 60  # Columns of a terminal that has room for a bar beside the times


class LiveProgress(NoProgress):
    """The table of points, row after row, with other findings; below it in place the step and the time left.

    The table stays when the run ends, the block below goes. The times left are those of the wall: a simulated bench may
    be faster than its own clock. `points` are those that were measured before the run was broken off.
    """

    def __init__(self, stream: TextIO, estimate_s: float, points: Sequence[Point] = (), unit: str = "V") -> None:
        self._outlet = Outlet(stream)
        self._unit = unit
        self._console = Console(file=self._outlet, highlight=False)  # type: ignore[arg-type]  # all of a file it needs
        self._block = _Block(estimate_s, ("━", "─") if self._outlet.encoding.lower().startswith("utf") else ("#", "."))
        self._points = list(points)
        self._begin_s: float | None = None
        self._head: list[str] | None = None  # that stands above the last row
        self._drawn_s = 0.0
        self._live = _live(self._console, self._outlet, self._block)

    def __enter__(self) -> Self:
        self._outlet.open()
        self._block.begin()
        self._live.start()
        return self

    def __exit__(self, *error: object) -> None:
        """Take the block away; the table stays."""
        self._live.stop()
        self._outlet.close()

    def handle(self, event: Event) -> None:
        """Show the measured points, and the place of the run."""
        if self._begin_s is None:
            self._begin_s = event.t_s if isinstance(event, StepStarted) else 0.0
        if isinstance(event, WentOn):
            self._begin_s += event.pause_s
        self._block.take(event, event.t_s - self._begin_s)
        match event:
            case StepStarted(step=Note()):
                self._end_part()
                self._print(event.step.describe(), "bold", whole=True)
            case StepStarted() | ReadingTaken():
                self._draw()
            case StepFinished():
                self._tell(event.t_s, event.step, event.result)
                for said in event.asked_again:
                    self._print(f"query repeated: {said}", "yellow", whole=True)
            case StepFailed():
                self._print(f"FAILED: {event.error}", "bold red", whole=True)
            case Paused():
                self._print(paused_words(event), "bold yellow", whole=True)
                self._draw()
            case WentOn():
                self._print(event.describe(), "bold yellow", whole=True)

    def hear(self, state: RunState, by: str) -> None:
        """Say that a pause is wanted."""
        if state is RunState.PAUSING:
            self._print(wanted_words(by), "bold yellow", whole=True)

    def _tell(self, t_s: float, step: Step, result: StepResult) -> None:
        """Print the result of a step: a window as a row, any other measurement or check in its words."""
        if step.not_checked:
            self._print(step.describe(), "yellow", whole=True)
        elif isinstance(result, Window):
            point = result.recorded_point
            fit = None
            if point is not None:
                self._points.append(point)
                _, fit = line_of(self._points, point.step)
            row = _PointRow(t_s, result, None if fit is None else float(fit.residuals_v[-1]))
            *heads, cells = _in_columns(row, self._console.width, self._unit)
            if heads != self._head:  # a new part, or the window is wider or narrower than it was
                self._head = heads
                for line in heads:
                    self._print(line, "dim")
            self._print(cells, "cyan")
        elif step.effect in {Effect.MEASURES, Effect.CHECKS} and (words := result.describe()):
            self._print(f"  {words}", "")

    def _end_part(self) -> None:
        """Print the line through the points of the part that ends, and have the next begin with a heading."""
        points, begun, self._head = self._points, self._head is not None, None
        if not (begun and points):
            return
        numbers, line = line_of(points, [*dict.fromkeys(each.step for each in points)][-1])
        if line is None:
            return
        worst = max(range(len(numbers)), key=lambda place: abs(line.residuals_v[place]))
        factor, unit = (1e3, "mV") if self._unit == "V" else (1.0, self._unit)
        words = (
            f"  line through {len(numbers)} points: {factor * line.scale_factor:.5f} {slope_unit(unit)}, "
            f"{factor * line.bias:+.3f} {unit}; largest residual {factor * line.residuals_v[worst]:+.3f} {unit} "
            f"at {points[numbers[worst]].rate_deg_s:+.6g} deg/s"
        )
        self._print(words, "green", whole=True)

    def _print(self, line: str, style: str, *, whole: bool = False) -> None:
        """Print a line; one that must be read to its end goes on in the next where the terminal is narrow."""
        cropped: Any = {} if whole else {"no_wrap": True, "overflow": "crop"}
        self._console.print(Text(printable(in_unit(line, self._unit)), style=style), **cropped)

    def _draw(self) -> None:
        """Draw the block anew, if that was not just done and the terminal takes it."""
        now_s = self._block.clock.now()
        if now_s - self._drawn_s >= _REDRAW_S:
            self._drawn_s = now_s
            self._live.refresh()


def _live(console: Console, outlet: Outlet, block: "_Block") -> Any:
    """Return a display that draws `block` below all that is printed, as long as the terminal takes it."""

    class PatientLive(Live):
        def refresh(self) -> None:
            if not (self.is_started and outlet.behind):  # what nobody reads would pile up
                super().refresh()

    return PatientLive(
        console=console,
        get_renderable=lambda: block.lines(console.width),
        refresh_per_second=_REDRAWS_PER_S,
        transient=True,
        redirect_stdout=False,
        redirect_stderr=False,
    )


class _Block:
    """Block below the table: the step, the state of the bench, the progress of the run and its end."""

    def __init__(self, estimate_s: float, bar: tuple[str, str]) -> None:
        self.clock = WallClock()
        self._bar = bar
        self._estimate_s = estimate_s
        self._t_s = 0.0
        self._heard_s = 0.0
        self._away_s, self._paced = 0.0, 1.0  # of the wall, in pauses; the pace before them
        self._doing = ""
        self._step: Step | None = None
        self._readings = 0
        self._state = BenchState()

    def begin(self) -> None:
        """Begin to count the time of the wall."""
        self.clock = WallClock()

    def take(self, event: Event, t_s: float) -> None:
        """Take notice; `t_s` is the bench time since this display began, s."""
        self._t_s, self._heard_s = t_s, self.clock.now() - self._away_s
        match event:
            case StepStarted():
                self._step, self._doing, self._readings = event.step, event.step.describe(), 0
                self._state = self._state.begun(event.step)
            case ReadingTaken():
                self._readings += 1
                said = f"{event.reading.voltage_v:+.5f} V  reading {self._readings}"
                if isinstance(step := self._step, Acquire):  # a narrow terminal cuts off the end of a line
                    said = f"{step.rate_deg_s:+.6g} deg/s  {said} of {step.samples}"
                self._doing = said
            case StepFinished():
                self._state = self._state.after(event.step, event.result)
            case Paused():
                self._doing, self._step, self._paced = f"PAUSED. {HOW_ON}", None, self._now()[1]
            case WentOn():  # as if it had gone on at the pace of before
                self._away_s = self.clock.now() - self._paced * t_s
                self._heard_s = self._paced * t_s
            case _:
                pass

    def lines(self, width: int) -> Group:
        """Return the block for a terminal of `width` columns."""
        # `parts` side by side, in as few lines of `width` as they need
        parts = [*filter(None, (self._state.table(), self._state.supplied(), self._state.driven()))]
        lines: list[str] = []
        for part in parts:
            if lines and len(lines[-1]) + 3 + len(part) <= width:
                lines[-1] += f"   {part}"
            else:
                lines.append(part)
        texts = [Text(line, no_wrap=True, overflow="ellipsis", style="dim") for line in lines]
        doing = Text(self._doing, no_wrap=True, overflow="ellipsis")
        t_s, pace = self._now()
        left_s = max(0.0, self._estimate_s - t_s) * pace
        ends = (utc_now() + timedelta(seconds=left_s)).astimezone()
        done = min(1.0, t_s / self._estimate_s) if self._estimate_s else 1.0
        day = f"{ends:%a} " if left_s > _HALF_A_DAY_S else ""
        words = f"{100 * done:3.0f} %  {span(left_s)} left, ends {day}{ends:%H:%M}"
        times = Text(words, style="bold green", no_wrap=True, overflow="crop")
        if width >= _BAR_FROM:
            room = width - len(words) - len("  ") - _ECHO
            filled = round(done * room)
            full, rest = self._bar
            times.append(f"  {full * filled}").append(rest * (room - filled), style="dim")
        return Group(doing, *texts, times)

    def _now(self) -> tuple[float, float]:
        """Return the bench time at this moment, s, amid a step too, and how many seconds of the wall one takes."""
        now_s = self.clock.now() - self._away_s
        pace = self._heard_s / self._t_s if self._t_s > 1.0 else 1.0
        since_s = (now_s - self._heard_s) / pace if pace else 0.0
        return self._t_s + min(since_s, 0.0 if self._step is None else self._step.duration_s), pace
