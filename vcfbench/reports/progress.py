"""Progress of a run: measured points, the step, and the time left."""

from typing import Self, TextIO

from vcfbench.reports.outlet import Outlet
from vcfbench.reports.shielded import NoProgress
from vcfbench.safety.control import RunState
from vcfbench.steps import Note
from vcfbench.steps.events import Event, Paused, StepFailed, StepFinished, StepStarted, WentOn
from vcfbench.values.printing import in_unit

HOW_ON = "p or Enter goes on, Ctrl-C stops"


def wanted_words(by: str) -> str:
    """Say that a pause is wanted."""
    return f"pause requested by {by}: after the step under way"


def paused_words(event: Paused) -> str:
    """Say that the run pauses."""
    return f"paused after step {event.number} ({event.by}): table at rest, V_Vc off, power on"


class LineProgress(NoProgress):
    """One plain line a step, when it is done: bench time, time left, step, result."""

    def __init__(self, stream: TextIO, estimate_s: float, unit: str = "V") -> None:
        self._outlet = Outlet(stream)
        self._unit = unit
        self._estimate_s = estimate_s
        self._begin_s: float | None = None  # bench time goes on in a run that is resumed

    def __enter__(self) -> Self:
        self._outlet.open()
        return self

    def __exit__(self, *error: object) -> None:
        """Let the rest be written."""
        self._outlet.close()

    def handle(self, event: Event) -> None:
        """Print a line when a step is done or has failed."""
        if self._begin_s is None:
            self._begin_s = event.t_s if isinstance(event, StepStarted) else 0.0
        match event:
            case StepFinished(step=Note()):
                self._say(event.t_s, f"* {event.step.describe()}")
            case StepFinished():
                words = event.result.describe()
                self._say(event.t_s, f"{event.step.describe()}{f' -> {words}' if words else ''}")
                for said in event.asked_again:
                    self._say(event.t_s, f"query repeated: {said}")
            case StepFailed():
                self._say(event.t_s, f"FAILED: {event.error}")
            case Paused():
                self._say(event.t_s, f"{paused_words(event)}. {HOW_ON}")
            case WentOn():
                self._begin_s += event.pause_s
                self._say(event.t_s, event.describe())
            case _:
                pass

    def hear(self, state: RunState, by: str) -> None:
        """Say that a pause is wanted."""
        if state is RunState.PAUSING:
            self._outlet.write(f"{wanted_words(by)}\n")

    def _say(self, t_s: float, text: str) -> None:
        left_s = max(0.0, self._estimate_s - (t_s - (self._begin_s or 0.0)))
        self._outlet.write(f"{t_s:8.1f} s  {left_s:6.0f} s left  {in_unit(text, self._unit)}\n")
