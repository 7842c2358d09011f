"""Events of a run, which its observers get: steps and readings, failures and pauses."""

from typing import Protocol

from msgspec import Struct

from vcfbench.errors import BenchError
from vcfbench.steps.step import Reading, Step, StepResult


class StepStarted(Struct, frozen=True):
    """Step `number` begins at bench time `t_s` (s since the run began).

    >>> started = next(event for event in events if isinstance(event, vcfbench.StepStarted))
    >>> f"{started.number}, {started.t_s:.1f} s: {started.step.describe()}"
    '1, 0.0 s: Start-up'
    """

    number: int
    t_s: float
    step: Step


class ReadingTaken(Struct, frozen=True):
    """The multimeter gave a reading.

    >>> taken = next(event for event in events if isinstance(event, vcfbench.ReadingTaken))
    >>> f"{taken.t_s:.1f} s: {taken.reading.voltage_v:+.3f} V"
    '5.7 s: -0.042 V'
    """

    t_s: float
    reading: Reading


class StepFinished(Struct, frozen=True):
    """Step `number` is done and on the disk; `asked_again` says which answers in it could not be believed.

    >>> finished = next(event for event in events if isinstance(event, vcfbench.StepFinished))
    >>> finished.number, finished.step.describe()
    (1, 'Start-up')
    """

    number: int
    t_s: float
    step: Step
    result: StepResult
    asked_again: tuple[str, ...] = ()


class StepFailed(Struct, frozen=True):
    """Step `number` failed; the plan now brings the bench to rest.

    >>> class Tells:
    ...     def handle(self, event):
    ...         if isinstance(event, vcfbench.StepFailed):
    ...             print(f"step {event.number} failed: {event.error}")
    """

    number: int
    t_s: float
    step: Step
    error: BenchError


class Moved(Struct, frozen=True):
    """Amount by which the output at rest moved in a pause: read before and after, V; `u_v` is the u of the difference.

    More than `allowed_v` is no drift; None where the procedure is about drift itself, and nothing ends it.
    """

    before_v: float
    after_v: float
    u_v: float
    allowed_v: float | None

    @property
    def moved_v(self) -> float:
        """After less before, V."""
        return self.after_v - self.before_v

    @property
    def is_reference(self) -> bool:
        """True if noise and drift alone moved it, and later measurements count from where it is now."""
        return self.allowed_v is not None and abs(self.moved_v) <= self.allowed_v

    def describe(self) -> str:
        return (
            f"the output at rest moved by {self.moved_v:+.2g} V, {abs(self.moved_v) / self.u_v:.1f} u "
            f"(from {self.before_v:+.6g} to {self.after_v:+.6g} V)"
        )


class Paused(Struct, frozen=True):
    """After step `number` the run pauses, as `by` wanted: table at rest, V_Vc 0, rails on.

    >>> class Tells:
    ...     def handle(self, event):
    ...         if isinstance(event, vcfbench.Paused):
    ...             print(f"paused by {event.by} after step {event.number}")
    >>> Tells().handle(vcfbench.Paused(20, t_s=61.5, by="the technician"))
    paused by the technician after step 20
    """

    number: int
    t_s: float
    by: str


class WentOn(Struct, frozen=True):
    """The run goes on, requested by `by`; the state before the pause is restored.

    `waited_s` is how long somebody had it wait, wall time, `pause_s` what all of the pause took, bench time. `moved` is
    None where nothing had been measured that would show it.

    >>> vcfbench.WentOn(20, t_s=91.5, by="the technician", waited_s=12.0, pause_s=30.0, moved=None).describe()
    'goes on (the technician) after 12 s; nothing had been measured to compare'
    """

    number: int
    t_s: float
    by: str
    waited_s: float
    pause_s: float
    moved: Moved | None

    def describe(self) -> str:
        """Name the person, the time waited, and the shift of the output."""
        moved = "nothing had been measured to compare" if self.moved is None else self.moved.describe()
        return f"goes on ({self.by}) after {self.waited_s:.0f} s; {moved}"


Event = StepStarted | ReadingTaken | StepFinished | StepFailed | Paused | WentOn
"""Events that observers are told.

>>> sorted({type(event).__name__ for event in events})
['ReadingTaken', 'StepFinished', 'StepStarted']
"""


class Observer(Protocol):
    """Gets the events of a run, as a progress line or a page does.

    >>> class Counts:
    ...     steps = 0
    ...     def handle(self, event):
    ...         self.steps += isinstance(event, vcfbench.StepFinished)
    >>> counts = Counts()
    >>> stopped = vcfbench.resume(stopped, observers=[counts])
    """

    def handle(self, event: Event) -> None:
        """Take notice; an OSError (a closed terminal) drops the observer, nothing else may be raised."""
