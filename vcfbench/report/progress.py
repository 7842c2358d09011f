"""What is said while a run goes: step, latest reading and time left, in bench time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self, TextIO

from vcfbench.procedures.executor import ReadingTaken, StepFailed, StepFinished, StepStarted
from vcfbench.procedures.steps import (
    DriveReading,
    Note,
    RailsReading,
    RateReading,
    StepResult,
    VvcSetting,
    Window,
)

if TYPE_CHECKING:
    from types import TracebackType

    from rich.live import Live
    from rich.text import Text

    from vcfbench.procedures.executor import Event

__all__ = ["LineProgress", "LiveProgress", "NoProgress", "describe_result"]


def describe_result(result: StepResult) -> str:
    """Say in a few words what a step gave; empty when it gave nothing."""
    match result:
        case Window():
            return f"{result.mean_v:+.5f} V, s {result.std_v:.1e} V"
        case RailsReading():
            return ", ".join(f"{rail.rail} {rail.voltage_v:+.3f} V {rail.current_a:.4f} A" for rail in result.rails)
        case DriveReading():
            return f"{result.frequency_hz:.2f} Hz, {result.amplitude_v:.4g} V, {result.phase_deg:+.2f} deg"
        case RateReading():
            return f"reads {result.rate_deg_s:+.4f} deg/s"
        case VvcSetting():
            return f"reads {result.v_vc_v:+.6g} V"
        case _:
            return ""


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
        self._stream = stream
        self._estimate_s = estimate_s

    def handle(self, event: Event) -> None:
        """Print a line when a step is done or has failed."""
        match event:
            case StepFinished(step=Note()):
                self._say(event.t_s, f"* {event.step.describe()}")
            case StepFinished():
                told = describe_result(event.result)
                self._say(event.t_s, f"{event.step.describe()}{f' -> {told}' if told else ''}")
            case StepFailed():
                self._say(event.t_s, f"FAILED: {event.error}")
            case _:
                pass

    def _say(self, t_s: float, text: str) -> None:
        left_s = max(0.0, self._estimate_s - t_s)
        print(f"{t_s:8.1f} s  {left_s:6.0f} s left  {text}", file=self._stream, flush=True)


class LiveProgress(NoProgress):
    """Two lines in place on a terminal; drawn some times a second, whatever the speed of the bench."""

    def __init__(self, stream: TextIO, estimate_s: float) -> None:
        from rich.console import Console  # noqa: PLC0415  # only where somebody looks
        from rich.live import Live  # noqa: PLC0415

        self._estimate_s = estimate_s
        self._heading = self._step = self._reading = ""
        self._t_s = 0.0
        self._live: Live = Live(
            console=Console(file=stream), get_renderable=self._render, refresh_per_second=8, transient=True
        )

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Take the lines away."""
        self._live.stop()

    def handle(self, event: Event) -> None:
        """Note what there is to show; drawing is done at its own pace."""
        self._t_s = event.t_s
        match event:
            case StepStarted(step=Note()):
                self._heading = event.step.describe()
            case StepStarted():
                self._step = event.step.describe()
            case ReadingTaken():
                self._reading = f"{event.reading.voltage_v:+.5f} V"
            case _:
                pass

    def _render(self) -> Text:
        from rich.text import Text  # noqa: PLC0415

        left_s = max(0.0, self._estimate_s - self._t_s)
        text = Text(f"{self._heading}\n", style="bold", no_wrap=True, overflow="ellipsis")
        return text.append(
            f"{self._t_s:8.1f} s  {left_s:5.0f} s left  {self._reading:>12}  {self._step}", style="not bold"
        )
