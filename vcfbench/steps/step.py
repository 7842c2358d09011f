"""Steps: frozen values that can describe themselves, be predicted, be held against limits and be performed.

A procedure is a generator that yields steps and is sent their results (:data:`Plan`). Since a step is a value, a plan
can be walked without a bench: dry run, estimate of the time and limits read the same steps that the executor performs.
A custom step is a subclass in the file of its procedure, without any registration.
"""

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache, partial
from importlib import import_module
from itertools import chain
from types import NoneType
from typing import Any, ClassVar, Final, Self, TypeVar, get_args, get_origin

from msgspec import Struct, field, to_builtins
from msgspec.structs import force_setattr, replace

from vcfbench.arguments import UNIONS, hints_of, require
from vcfbench.bench.bench import Bench
from vcfbench.errors import BenchError, FramingError, MeasurementError, PlanError
from vcfbench.interfaces import Instrument, Operator, nobody
from vcfbench.records.schema import CHUNK_READINGS, CHUNK_S, Point
from vcfbench.station.limits import LimitChecks
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.station.settings import Sources
from vcfbench.steps.scatter import NoiseSeen
from vcfbench.typed import unboxed

_T = TypeVar("_T")

LOOK_AT_SIGNALS = (
    "check the leads of the output, of V_Vc and of the oscilloscope, the carrier, the demodulator and the rails "
    "at the PCB"
)
"""The hint of a measurement that finds nothing to measure."""


class Effect(Enum):
    """Effect of a step: sets something, lets time pass, measures, checks the bench, or nothing at all.

    What was measured stands for ever; what was only checked is checked once more when a run is resumed.
    """

    SETS = "sets"
    WAITS = "waits"
    MEASURES = "measures"
    CHECKS = "checks"
    NOTHING = "nothing"


class Reading(Struct, frozen=True):
    """One reading of the multimeter: bench time at which it was asked for (s) and voltage (V)."""

    t_s: float
    voltage_v: float

    def corrected(self, known: Sources) -> Self:
        return replace(self, voltage_v=known.corrected(self.voltage_v))


def _nowhere(readings: Sequence[Reading], device: str = "") -> None:
    """Keep readings nowhere: nobody writes a journal."""


class Context(Struct):
    """Context of a step while it is performed: the bench, and the places for readings and doubts.

    `hear` is called with every reading as it comes. `readings` holds those of the step under way that are not yet
    written down, so that a window that fails leaves them behind: at most one chunk. `chunks` counts those that `keep`
    has written; where nothing does, in a pause, all readings of a window stay together. `operator` is who does what
    only hands can do. `asked_again` says what was answered, in the step under way, that could not be believed, so that
    it was asked once more. `noise` is the scatter that the run has seen so far. `outputs` are those of the supply that
    feed the rails, once they were read back. What is done in `undivided` no signal breaks off.

    >>> context = vcfbench.Context(bench, hear=print, readings=[])
    >>> vcfbench.Settle(2.0, "after the ramp").perform(context)
    Done()
    """

    bench: Bench
    hear: Callable[[Reading], None]
    readings: list[Reading] = field(default_factory=list)
    asked_again: list[str] = field(default_factory=list)
    noise: NoiseSeen | None = None
    outputs: tuple[str, ...] = ()
    keep: Callable[..., None] = _nowhere
    chunks: int = 0
    operator: Operator = nobody
    undivided: Callable[[], AbstractContextManager[None]] = nullcontext
    devices: dict[str, "Context"] = field(default_factory=dict)
    """Of a bench with several gyroscopes: that of each."""

    def of_device(self, name: str) -> "Context":
        """Return the context of one of several gyroscopes: its output, its readings, its noise."""
        if name not in self.devices:
            heard = self.hear if not self.devices else lambda _: None  # one is shown
            own = Context(self.bench.seen_by(name), heard, operator=self.operator, undivided=self.undivided)
            self.devices[name] = own
            own.begin(_nowhere if self.keep is _nowhere else partial(self._keep_of, name))
        return self.devices[name]

    def _keep_of(self, device: str, readings: Sequence[Reading]) -> None:
        self.keep(readings, device)
        self.chunks += 1

    def begin(self, keep: Callable[..., None] = _nowhere) -> None:
        """Clear the readings of the step before; `keep` writes down each chunk of readings of the step that begins."""
        self.readings.clear()
        self.asked_again.clear()
        self.keep, self.chunks = keep, 0
        for name, each in self.devices.items():
            each.begin(_nowhere if keep is _nowhere else partial(self._keep_of, name))

    def take(self, reading: Reading) -> tuple[Reading, ...]:
        """Keep a reading and pass it on; return the chunk before it, if one had to be closed to make room.

        A chunk has at most `CHUNK_READINGS`, over at most `CHUNK_S`. Closed, it is on the disk and no longer in memory.
        """
        readings = self.readings
        full = len(readings) >= CHUNK_READINGS or (readings and reading.t_s - readings[0].t_s >= CHUNK_S)
        closed = self._close() if full and self.keep is not _nowhere else ()
        readings.append(reading)
        self.hear(reading)
        return closed

    def rest(self) -> tuple[Reading, ...]:
        """Return the readings that are in no chunk yet: all of a short window; of a long one the last chunk, closed."""
        return self._close() if self.chunks and self.readings else tuple(self.readings)

    def _close(self) -> tuple[Reading, ...]:
        closed = tuple(self.readings)
        with self.undivided():
            self.keep(closed)
            self.chunks += 1
            self.readings.clear()
        return closed

    def believable(self, ask: Callable[[], _T], doubt: Callable[[_T], str] = lambda _: "") -> _T:
        """Ask, and once more where the answer is none or `doubt` says something against it; that is written down.

        Asking again moves nothing: `ask` reads, or sets what is set already. The second answer is as it is: whoever
        asked says what is wrong with it.
        """
        try:
            answer = ask()
        except FramingError as error:
            self.asked_again.append(str(error))
            return ask()
        if said := doubt(answer):
            self.asked_again.append(said)
            return ask()
        return answer


def problem(instrument: Instrument, what: str, hint: str | None = None) -> MeasurementError:
    """Return a MeasurementError at `instrument`, with its words."""
    return MeasurementError(what, instrument=instrument.name, resource=instrument.resource, hint=hint)


_OURS: Final = f"{__name__.partition('.')[0]}."
_OF_PROCEDURES: Final = frozenset(
    {
        *("AtTemperature", "BeginPart", "CaptureDecay", "CaptureFar", "CaptureSense", "DriveDecay", "MeasureRails"),
        *("RailOnAndLog", "RailsDrawn", "RailsLogged", "ReleaseDrive"),
        *("SenseDecay", "SuppliedAndLogged", "SwitchOnAndLog", "SwitchedOn"),
    }
)
"""Steps and results that come along beside `vcfbench.steps`, in modules that are loaded when they are needed."""


def _make_known(kinds: dict[str, type[_T]], kind: type[_T]) -> None:
    """Register `kind` by its name in records; a custom one that is defined again replaces the earlier one."""
    name = kind.__name__
    if not kind.__module__.startswith(_OURS):
        import_module("vcfbench.steps")  # by name, for they import this; all that come along are known then
        if name in _OF_PROCEDURES or (name in kinds and kinds[name].__module__.startswith(_OURS)):
            raise PlanError(
                f"{kind.__module__}: {name} is the name of a built-in step or result",
                hint="rename your class: records know it by its name",
            )
    kinds[name] = kind


class StepResult:
    """Result of a step. Records know your own subclass, a frozen dataclass or struct, by its name: one of its own.

    >>> @dataclass(frozen=True)
    ... class Humidity(vcfbench.StepResult):
    ...     humidity_percent: float
    >>> Humidity(41.0).as_json()
    {'humidity_percent': 41.0}
    """

    __slots__ = ()

    kinds: ClassVar[dict[str, "type[StepResult]"]] = {}

    def __init_subclass__(cls, **options: Any) -> None:
        """Make the kind known, so that a record can be read into values again; PlanError where its name is taken."""
        super().__init_subclass__(**options)
        _make_known(StepResult.kinds, cls)

    @property
    def recorded_point(self) -> Point | None:
        """The point that the step adds to the run, None when it adds none."""
        return None

    @property
    def recorded_points(self) -> Mapping[str, Point]:
        """The points of several devices that the step adds to the run, by the name of the device."""
        return {}

    def corrected(self, step: "Step", known: Sources) -> Self:
        """Return the result of `step` with the corrections of the meters' certificates to its direct voltages.

        The procedure's results are made of the corrected ones; the journal keeps the readings. By default nothing is
        corrected.
        """
        return self

    def moved(self, output_v: float, v_vc_v: float) -> Self:
        """Return the result with the output of its point moved, V, and its measured V_Vc, V."""
        return self

    def counted_from(self, moved_v: float, u_v: float) -> Self:
        """Return the same, measured since the output had moved by `moved_v` (V, with its u) in pauses of the run."""
        return self

    def referred(self) -> Self:
        """Return the result referred to the output before all pauses: plans and results go by that."""
        return self

    def as_json(self) -> dict[str, Any]:
        """Return the fields as they are in the journal."""
        return dict(to_builtins(self))

    def describe(self) -> str:
        """Summarize the result in a few words; empty when there is nothing to say."""
        return ""


class Done(StepResult, Struct, frozen=True):
    """A step was performed and gave nothing to look at."""


_SINGLE: Final[dict[Any, tuple[type, ...]]] = {
    **{kind: (kind,) for kind in (int, str, bool, NoneType)},
    float: (float, int),
}
"""What a field may be annotated with that is one number, text or truth value, with the types that are fine at once."""


@cache
def field_types(kind: type) -> tuple[tuple[str, Any, frozenset[type]], ...]:
    """Return the fields of a kind of step, each with its annotation and types if it is one number, text or truth value.

    Else its annotation is None: sequences may come as any.
    """
    hints, found = hints_of(kind), []
    for name in [each.name for each in fields(kind)] if is_dataclass(kind) else getattr(kind, "__struct_fields__", ()):
        parts = get_args(hints[name]) if get_origin(hints[name]) in UNIONS else (hints[name],)
        single = all(each in _SINGLE for each in parts)
        types = chain.from_iterable(_SINGLE[each] for each in parts) if single else ()
        found.append((name, hints[name] if single else None, frozenset(types)))
    return tuple(found)


class Step:
    """Common base of all steps; each kind is its own frozen dataclass or msgspec struct.

    `subject` names what is set, waited for, checked or measured, ``"table rate"``. A step with a result has a
    `perform`; one that is only done has a `command`, and an `instruction` where its description is always the same.

    >>> step = vcfbench.dry_run("turntable").steps[5].step
    >>> step.describe(), step.duration_s
    ('supply N25V (negative rail): -10 V, limit 0.1 A', 0.05)
    """

    __slots__ = ()

    kinds: ClassVar[dict[str, "type[Step]"]] = {}
    effect: ClassVar[Effect] = Effect.NOTHING
    subject: ClassVar[str] = ""
    also: ClassVar[tuple[str, ...]] = ()
    """Subjects that it sets beside its own."""
    needs: ClassVar[str] = ""
    """Subject that must be set before it can be done."""
    follows_at_once: ClassVar[bool] = False
    """True if it measures what the step before it has begun: no pause comes between the two."""
    instruction: ClassVar[str] = ""
    overhead_s: ClassVar[float] = 0.0
    """Estimated time of the communication with the instruments, beside the physical time."""
    waits_for_person: ClassVar[bool] = False
    """True if a person does it, in any time."""

    def __init_subclass__(cls, **options: Any) -> None:
        """Make the kind known, so that a record can be read into values again; PlanError where its name is taken."""
        super().__init_subclass__(**options)
        _make_known(Step.kinds, cls)

    def __post_init__(self) -> None:
        """Take numpy's numbers as Python's: plans count with numpy, records and commands have plain numbers.

        Raises:
            ConfigError: a number, a text or a truth value is none, so that no record of it could be read.
        """
        kind: Any = type(self)
        for name, expected, types in field_types(kind):
            if type(value := getattr(self, name)) in types:
                continue
            plain = unboxed(value)
            if expected is not None and not (int in types and type(plain) is float and plain.is_integer()):
                require(f"{kind.__name__}: {name}", plain, expected)
            if plain is not value:
                put: Any = force_setattr if isinstance(self, Struct) else object.__setattr__
                put(self, name, plain)

    def describe(self) -> str:
        """Describe the action of the step, as the work instruction would."""
        return self.instruction

    def perform(self, context: Context) -> StepResult:
        """Do the step on the bench of `context`. Only the executor calls this.

        Raises:
            BenchError: the instrument, the wire or the bench did not let it be done.
        """
        self.command(context.bench)
        return Done()

    def command(self, bench: Bench) -> None:
        """Do a step that has no result; errors as of `perform`."""
        raise NotImplementedError

    def predict(self, gyro: LinearGyro) -> StepResult:
        """Return the result that the step would have with `gyro` on the bench; nothing is opened or sent.

        By default it is done, and there is nothing to look at.
        """
        return Done()

    def within(self, limits: LimitChecks) -> None:
        """Raise LimitError when the step would leave the limits of the bench. One that sets nothing cannot."""

    def recorded(self, result: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the fields of the step's result, from those that :meth:`StepResult.as_json` wrote."""
        return result

    def again(self) -> "tuple[Step, ...]":
        """Return the steps that repeat this one on a bench made safe meanwhile: by default the step itself."""
        return (self,)

    def recall(self, readings_v: Sequence[float], context: Context) -> None:
        """Take notice of one chunk of this step's readings before a run was broken off, V."""

    @property
    def sets(self) -> tuple[str, ...]:
        """Quantities that the step sets, by name: of all steps that set the same, the last one counts."""
        return (self.subject, *self.also) if self.effect is Effect.SETS else ()

    @property
    def key(self) -> str:
        """Name the step by its kind and parameters; the same in every run of the same plan."""
        return repr(self)

    @property
    def not_checked(self) -> str:
        """Checks that a run with this step leaves out, and the reason, for its answer. Empty: none."""
        return ""

    @property
    def physical_s(self) -> float:
        """Least time the step needs on any bench (ramp, settling, averaging window), s."""
        return 0.0

    @property
    def duration_s(self) -> float:
        """Estimate of the time the step takes, s."""
        return self.physical_s + self.overhead_s


_Kind = TypeVar("_Kind", bound=type[Step])


def does(
    effect: Effect, subject: str = "", instruction: str = "", *, overhead_s: float = 0.0, also: tuple[str, ...] = ()
) -> Callable[[_Kind], _Kind]:
    """Return in one line the purpose of a kind of step: the class attributes of these names."""

    def said(kind: _Kind) -> _Kind:
        kind.effect, kind.subject, kind.instruction, kind.overhead_s = effect, subject, instruction, overhead_s
        kind.also = also
        return kind

    return said


Plan = Generator[Step, StepResult, None]
"""A generator of steps, to which their results are sent back.

>>> def plan(settings) -> vcfbench.Plan:
...     yield vcfbench.Note("Zero")
...     yield vcfbench.Settle(settings.settle_s, "gyro settles")
>>> [step.describe() for step in plan(settings)]
['Zero', 'wait 2 s: gyro settles']
"""
Routine = Generator[Step, StepResult, _T]
"""Part of a plan, which returns its finding.

>>> def zero(settings) -> vcfbench.Routine[vcfbench.Point]:
...     return (yield from vcfbench.take(settings, 1, rate_deg_s=0.0, v_vc_v=0.0))
>>> next(zero(settings)).describe()
'average 10 readings, one every 1 s: +0 deg/s, V_Vc +0 V'
"""


class _Abandoned(BenchError):
    """Thrown into a plan that nobody performs any longer."""


def abandon(plan: Routine[object]) -> None:
    """Run an abandoned plan to its end, without performing its last steps."""
    with suppress(StopIteration, BenchError):
        while True:
            plan.throw(_Abandoned("the run was left"))


def answer(result: StepResult, kind: type[_T]) -> _T:
    """Return `result`, which the executor promises to be of `kind`."""
    if not isinstance(result, kind):
        raise TypeError(f"the step was answered with {type(result).__name__}, not {kind.__name__}")
    return result
