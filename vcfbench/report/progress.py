"""What is said while a run goes: what was measured, the step, and how long it will still take."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self, TextIO

from vcfbench.clock import WallClock, utc_now
from vcfbench.plans.executor import ReadingTaken, StepFailed, StepFinished, StepStarted
from vcfbench.plans.steps import (
    Acquire,
    DriveReading,
    Note,
    RailsReading,
    Window,
)
from vcfbench.report.outlet import Outlet

if TYPE_CHECKING:
    from types import TracebackType

    from rich.text import Text

    from vcfbench.plans.executor import Event

__all__ = ["LineProgress", "LiveProgress", "NoProgress"]

_REDRAW_S = 0.1


class NoProgress:
    """Says nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Nothing to end."""

    def handle(self, event: Event) -> None:
        """Take no notice."""


class LineProgress(NoProgress):
    """One plain line a step, when it is done: bench time, time left, step, result."""

    def __init__(self, stream: TextIO, estimate_s: float) -> None:
        self._outlet = Outlet(stream)
        self._estimate_s = estimate_s
        self._begin_s: float | None = None  # bench time goes on in a run that is resumed

    def __enter__(self) -> Self:
        self._outlet.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Let what is left be written."""
        self._outlet.close()

    def handle(self, event: Event) -> None:
        """Print a line when a step is done or has failed."""
        if self._begin_s is None:
            self._begin_s = event.t_s if isinstance(event, StepStarted) else 0.0
        match event:
            case StepFinished(step=Note()):
                self._say(event.t_s, f"* {event.step.describe()}")
            case StepFinished():
                told = event.result.describe()
                self._say(event.t_s, f"{event.step.describe()}{f' -> {told}' if told else ''}")
            case StepFailed():
                self._say(event.t_s, f"FAILED: {event.error}")
            case _:
                pass

    def _say(self, t_s: float, text: str) -> None:
        left_s = max(0.0, self._estimate_s - (t_s - (self._begin_s or 0.0)))
        self._outlet.write(f"{t_s:8.1f} s  {left_s:6.0f} s left  {text}\n")


class LiveProgress(NoProgress):
    """What was measured, line after line, and below it two lines in place: what is done, and how long it will take.

    The times are those of the wall: a simulated bench may be faster than its own clock.
    """

    def __init__(self, stream: TextIO, estimate_s: float) -> None:
        from rich.console import Console  # noqa: PLC0415  # only where somebody looks
        from rich.live import Live  # noqa: PLC0415

        self._estimate_s = estimate_s
        self._outlet = Outlet(stream)
        self._console = Console(file=self._outlet, highlight=False)  # type: ignore[arg-type]  # all of a file it needs
        self._clock = WallClock()
        self._drawn_s = 0.0
        self._t_s = 0.0
        self._begin_s: float | None = None
        self._doing = ""
        self._acquiring: Acquire | None = None
        self._readings = 0
        self._live = Live(
            console=self._console,
            get_renderable=self._render,
            auto_refresh=False,
            transient=True,
            redirect_stdout=False,
            redirect_stderr=False,
        )

    def __enter__(self) -> Self:
        self._outlet.open()
        self._clock = WallClock()
        self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Take the two lines away; what was measured stays."""
        self._live.stop()
        self._outlet.close()

    def handle(self, event: Event) -> None:
        """Show what was measured, and where the run is."""
        if self._begin_s is None:
            self._begin_s = event.t_s if isinstance(event, StepStarted) else 0.0
        self._t_s = event.t_s - self._begin_s
        match event:
            case StepStarted(step=Note()):
                self._print(event.step.describe(), "bold")
            case StepStarted():
                self._doing, self._readings = event.step.describe(), 0
                self._acquiring = event.step if isinstance(event.step, Acquire) else None
                self._draw()
            case ReadingTaken():
                self._take(event.reading.voltage_v)
                self._draw()
            case StepFinished(step=Acquire() as step, result=Window() as window):
                self._print(_point(step, window), "cyan")
            case StepFinished(result=RailsReading() | DriveReading()):
                self._print(f"  {event.result.describe()}", "")
            case StepFailed():
                self._print(f"FAILED: {event.error}", "bold red")
            case _:
                pass

    def _take(self, voltage_v: float) -> None:
        """Put rate and reading first: a narrow terminal cuts off what comes last."""
        if self._acquiring is not None:
            self._readings += 1
            self._doing = (
                f"{_rate(self._acquiring)}  {voltage_v:+10.5f} V  reading {self._readings} of {self._acquiring.samples}"
            )

    def _print(self, line: str, style: str) -> None:
        from rich.text import Text  # noqa: PLC0415

        if line.startswith("FAILED"):  # the one line that must be read to its end
            self._console.print(Text(line, style=style))
        else:
            self._console.print(Text(line, style=style), no_wrap=True, overflow="crop")

    def _draw(self) -> None:
        """Draw the two lines anew, if that was not just done and the terminal takes it."""
        now_s = self._clock.now()
        if now_s - self._drawn_s >= _REDRAW_S and not self._outlet.behind:
            self._drawn_s = now_s
            self._live.refresh()

    def _render(self) -> Text:
        from datetime import timedelta  # noqa: PLC0415

        from rich.text import Text  # noqa: PLC0415

        left_s = self._left_s()
        ends = (utc_now() + timedelta(seconds=left_s)).astimezone()
        done = min(1.0, self._t_s / self._estimate_s) if self._estimate_s else 1.0
        text = Text(f"{self._doing}\n", no_wrap=True, overflow="crop")
        return text.append(f"{100 * done:3.0f} %  {_span(left_s)} left, ends {ends:%H:%M}", style="bold green")

    def _left_s(self) -> float:
        """Time left on the wall's clock, at the pace that the bench has gone so far."""
        left_s = max(0.0, self._estimate_s - self._t_s)
        elapsed_s = self._clock.now()
        return left_s * elapsed_s / self._t_s if self._t_s > 1.0 else left_s


def _rate(step: Acquire) -> str:
    return f"{step.rate_deg_s:+9.6g} deg/s"


def _point(step: Acquire, window: Window) -> str:
    return f"{_rate(step)}  {window.mean_v:+10.5f} V  s {window.std_v:.1e} V  V_Vc {step.v_vc_v:+.6g} V"


def _span(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"
