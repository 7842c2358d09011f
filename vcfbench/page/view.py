"""View of one run: filled in by a follower, read by the page, each in a thread of its own."""

from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vcfbench.records.schema import Point
from vcfbench.reports.bench_state import BenchState
from vcfbench.reports.plot import line_of, thinned
from vcfbench.safety.control import RunState
from vcfbench.steps import NotChecked, Note
from vcfbench.steps.events import Event, Paused, ReadingTaken, StepFailed, StepFinished, StepStarted, WentOn
from vcfbench.steps.step import Effect
from vcfbench.values.printing import in_unit


@dataclass(slots=True)
class BrowserPosition:
    """Position of one browser in a view: the part that it has received."""

    version: int = -1
    introduced: bool = False
    steps: int = 0
    points: int = 0
    log: int = 0


@dataclass(slots=True)
class View:
    """View of one run. Lists only ever grow, so that readers need no lock: entries stay as they are.

    `about` says which run it is; `planned_s` is the estimate of its bench time, None where none is known; `headings`
    are those of the plan. `version` rises with everything that is told. `t_s` is the bench time, `began_s` that at
    which the first step began that was seen; a pause puts it off. `control` is how the run is (running, pausing,
    paused, stopping), empty where nobody knows. `end` is what it came to, None while it goes.
    """

    about: Mapping[str, Any] = field(default_factory=dict)
    planned_s: float | None = None
    headings: Sequence[str] = ()
    version: int = 0
    steps: list[dict[str, Any]] = field(default_factory=list)
    points: list[Point] = field(default_factory=list)
    log: list[dict[str, Any]] = field(default_factory=list)
    doing: dict[str, Any] | None = None
    state: BenchState = field(default_factory=BenchState)
    t_s: float = 0.0
    began_s: float | None = None
    control: str = ""
    end: Mapping[str, Any] | None = None
    _reading_t_s: "array[float]" = field(default_factory=lambda: array("d"))
    _reading_v: "array[float]" = field(default_factory=lambda: array("d"))

    def handle(self, event: Event) -> None:
        """Take in an event of the run; its step and result may be of kinds that are not known here."""
        self.t_s = event.t_s
        match event:
            case ReadingTaken(t_s, reading):
                self.read([t_s], [reading.voltage_v])
            case StepStarted(number, t_s, step):
                self.began_s = t_s if self.began_s is None else self.began_s
                self.state = self.state.begun(step)
                self.doing = {"n": number, "t_s": t_s, "what": step.describe(), "duration_s": step.duration_s}
            case StepFinished(number, t_s, step, result, again):
                self.doing, self.state = None, self.state.after(step, result)
                unit = str(self.about.get("unit", "V"))
                what, found = in_unit(step.describe(), unit), in_unit(result.describe(), unit)
                kind = "heading" if isinstance(step, Note) else "done"
                self.steps.append({"n": number, "t_s": t_s, "what": what, "result": found, "kind": kind})
                left_out = [what] if isinstance(step, NotChecked) else []
                for said in (*(f"query repeated: {each}" for each in again), *left_out):
                    self.say(t_s, said, "warning")
                several = getattr(result, "recorded_points", {})  # of which the first is shown
                point = next(iter(several.values()), None) or getattr(result, "recorded_point", None)
                if point is not None:
                    self.points.append(point)
                elif getattr(step, "effect", None) in {Effect.MEASURES, Effect.CHECKS} and found:
                    self.say(t_s, f"{what}: {found}", "result")
            case StepFailed(number, t_s, step, error):
                self.doing, said = None, str(error)
                self.steps.append({"n": number, "t_s": t_s, "what": step.describe(), "result": said, "kind": "failed"})
                self.say(t_s, said, "error")
            case Paused(_, t_s, by):
                self.doing = None
                self.say(t_s, f"paused ({by}): table at rest, V_Vc off, power on", "warning")
            case WentOn():
                self.began_s = None if self.began_s is None else self.began_s + event.pause_s
                self.say(event.t_s, event.describe(), "warning")
        self.version += 1

    def read(self, t_s: Sequence[float], voltage_v: Sequence[float]) -> None:
        """Take in readings of the multimeter, each at its bench time, s."""
        self._reading_v.extend(voltage_v)
        self._reading_t_s.extend(t_s)
        self.t_s = max(self.t_s, t_s[-1])
        self.version += 1

    def hear(self, state: RunState, by: str) -> None:
        """Take in a wish to stop, pause or go on."""
        self.control = state.value
        if state in {RunState.PAUSING, RunState.STOPPING}:
            self.say(self.t_s, f"{state.value}, as {by} requested", "warning")
        self.version += 1

    def say(self, t_s: float, words: str, kind: str) -> None:
        """Write a line of the log."""
        self.log.append({"t_s": t_s, "what": words, "kind": kind})
        self.version += 1

    def finished(self, end: Mapping[str, Any]) -> None:
        """Take in that the run is over, and its end."""
        self.doing, self.end = None, end
        self.version += 1

    @property
    def readings(self) -> int:
        """Number of readings."""
        return len(self._reading_t_s)

    def drawn(self, first_s: float | None, last_s: float | None, most: int) -> dict[str, Any]:
        """Return the readings from `first_s` to `last_s` (bench time, s; None: all), of many `most` extremes."""
        count = self.readings
        t_s, value = np.array(self._reading_t_s[:count]), np.array(self._reading_v[:count])
        low = 0 if first_s is None else int(np.searchsorted(t_s, first_s))
        high = count if last_s is None else int(np.searchsorted(t_s, last_s, side="right"))
        t_s, value = t_s[low:high], value[low:high]
        few = thinned(t_s, value, most // 2)
        shown_t_s, shown_v = (t_s.tolist(), value.tolist()) if few is None else few
        shown = {"t_s": [round(each, 4) for each in shown_t_s], "v": shown_v, "shown": high - low}
        return {**shown, "count": count, "all": few is None}

    def news(self, seen: BrowserPosition) -> dict[str, Any] | None:
        """Return the news since `seen`, which is brought up to date, or None."""
        version = self.version
        if version == seen.version:
            return None
        first = seen.version < 0
        steps, points, log = len(self.steps), len(self.points), len(self.log)
        news: dict[str, Any] = {
            "t_s": self.t_s,
            "began_s": self.began_s or 0.0,
            "doing": self.doing,
            "bench": {"table": self.state.table(), "rails": self.state.supplied(), "v_vc": self.state.driven()},
            "readings": self.readings,
            "last_v": self._reading_v[-1] if self.readings else None,
            "steps": self.steps[seen.steps : steps],
            "log": self.log[seen.log : log],
            "control": self.control,
            "end": self.end,
        }
        if self.about and not seen.introduced:
            news |= {"about": self.about, "planned_s": self.planned_s, "headings": list(self.headings)}
            seen.introduced = True
        if first or points > seen.points:
            news |= {"points": [each.as_json() for each in self.points[:points]], "lines": self._lines(points)}
        seen.version, seen.steps, seen.points, seen.log = version, steps, points, log
        return news

    def _lines(self, count: int) -> list[dict[str, Any]]:
        """Return the line through the points of each step that has one, with the residual of every point, V."""
        points, lines = self.points[:count], []
        for step in dict.fromkeys(each.step for each in points):
            numbers, line = line_of(points, step)
            if line is not None:
                lines.append(
                    {
                        "step": step,
                        "scale_factor": line.scale_factor,
                        "bias": line.bias,
                        "points": numbers,
                        "residuals_v": line.residuals_v.tolist(),
                    }
                )
        return lines
