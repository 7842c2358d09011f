"""A step of each of several devices, done together: a window is a window of each."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from msgspec import Struct, ValidationError, to_builtins
from msgspec.structs import force_setattr, replace

from vcfbench import errors
from vcfbench.bench.bench import Bench
from vcfbench.drivers.together import kept, read_together
from vcfbench.errors import BenchError
from vcfbench.records.schema import Point
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.steps.meter import Acquire, LookAtOutput, OutputSeen
from vcfbench.steps.step import Context, Effect, Reading, Step, StepResult, does
from vcfbench.steps.stream_latency import MeasureLatency
from vcfbench.typed import typed

_SHOWN = 3
"""Devices that are named in the words of a step."""


class EndedStep(Struct, frozen=True):
    """End of one device in a step of all: the kind of its error, its words, and the readings that were taken."""

    kind: str
    what: str
    readings: tuple[Reading, ...] = ()

    @classmethod
    def by(cls, error: BenchError, readings: Sequence[Reading] = ()) -> "EndedStep":
        """Return the end by an error."""
        return cls(type(error).__name__, str(error), tuple(readings))

    @property
    def error(self) -> BenchError:
        """The error, of its kind."""
        kind = getattr(errors, self.kind, None)
        is_one = isinstance(kind, type) and issubclass(kind, BenchError)
        return (kind if is_one else errors.MeasurementError)(self.what)  # type: ignore[misc]


class EachResult(StepResult, Struct, frozen=True):
    """Results of a step of several devices: the `kind` of all of them, each by the name of its device.

    `ended` are the devices that gave none.
    """

    kind: str
    results: dict[str, Any]
    ended: dict[str, EndedStep]

    def __post_init__(self) -> None:
        """Make results of those that come from a record; ValidationError: their kind is not known here."""
        force_setattr(self, "results", _made(StepResult.kinds, self.kind, self.results))

    @property
    def recorded_points(self) -> dict[str, Point]:
        found = {name: each.recorded_point for name, each in self.results.items()}
        return {name: each for name, each in found.items() if each is not None}

    def as_json(self) -> dict[str, Any]:
        """Return the results of each as they would be in a journal of its own."""
        of = {name: each.as_json() for name, each in self.results.items()}
        return {"kind": self.kind, "results": of, "ended": to_builtins(self.ended)}

    def describe(self) -> str:
        said = [f"{name} {each.describe()}" for name, each in self.results.items()]
        said = [said[0], f"and {len(said) - 1} more"] if len(said) > _SHOWN else said
        return "; ".join([*said, *(f"{name} ENDED: {each.what}" for name, each in self.ended.items())])


@does(Effect.MEASURES, "output")
class EachOf(Step, Struct, frozen=True):
    """One step of several devices: all of one `kind`, each by the name of its device."""

    kind: str
    steps: dict[str, Any]

    def __post_init__(self) -> None:
        """Make steps of those that come from a record; ValidationError: their kind is not known here."""
        force_setattr(self, "steps", _made(Step.kinds, self.kind, self.steps))

    @property
    def first(self) -> Step:
        """Step of the first device, for all that is common."""
        found: Step = next(iter(self.steps.values()))
        return found

    def describe(self) -> str:
        names = ", ".join(self.steps) if len(self.steps) <= _SHOWN else f"{len(self.steps)} devices"
        return f"{self.first.describe()} ({names})"

    @property
    def physical_s(self) -> float:
        return self.first.physical_s

    @property
    def duration_s(self) -> float:
        return self.first.duration_s

    def predict(self, gyro: LinearGyro) -> EachResult:
        found = {name: step.predict(gyro.of_device(name)) for name, step in self.steps.items()}
        return EachResult(type(next(iter(found.values()))).__name__, found, {})

    def recorded(self, result: Mapping[str, Any]) -> Mapping[str, Any]:
        of = result.get("results", {})
        return {**result, "results": {name: self.steps[name].recorded(each) for name, each in of.items()}}

    def perform(self, context: Context) -> EachResult:
        """Do the step of each together; one that fails ends for itself; where all do, that is an error."""
        contexts, missing = self.contexts(context)
        failed: dict[str, BenchError] = {}
        match self.first:
            case _ if not contexts:
                results: dict[str, StepResult] = {}
            case Acquire() as first:
                results = self._windows(first, contexts, failed)
            case LookAtOutput() as first:
                seen: dict[str, list[float]] = {name: [] for name in contexts}
                for _ in range(first.count):
                    for name, value_v in _read(contexts, failed).items():
                        seen[name].append(value_v)
                first.read_back(context)
                results = {name: OutputSeen(tuple(each)) for name, each in seen.items() if name not in failed}
            case MeasureLatency() as first:
                results = dict(first.of_all(contexts))
            case _:
                results = {}
                for name, step in self.steps.items():
                    with kept(failed, name):
                        results[name] = step.perform(contexts[name])
        for name, each in contexts.items():
            context.asked_again += (f"{name}: {said}" for said in each.asked_again)
        if not results:
            raise BenchError.joined(missing | failed)
        ended = {name: EndedStep.by(error) for name, error in missing.items()}
        ended |= {name: EndedStep.by(error, contexts[name].readings) for name, error in failed.items()}
        return EachResult(type(next(iter(results.values()))).__name__, results, ended)

    def contexts(self, context: Context) -> tuple[dict[str, Context], dict[str, BenchError]]:
        """Return the context of each device, and the error of each that has no output any more."""
        contexts: dict[str, Context] = {}
        missing: dict[str, BenchError] = {}
        for name in self.steps:
            with kept(missing, name):
                contexts[name] = context.of_device(name)
        return contexts, missing

    def _windows(
        self, first: Acquire, contexts: Mapping[str, Context], failed: dict[str, BenchError]
    ) -> dict[str, StepResult]:
        """Take the windows; instants, rate of the table and rails, which all share, are asked once."""
        context = next(iter(contexts.values()))
        clock, number = context.bench.clock, 0
        start_s = clock.now()
        tallies = {name: step.tallies() for name, step in self.steps.items()}
        while number < first.samples and len(failed) < len(contexts):
            left = replace(first, samples=first.samples - number)
            for t_s in left.instants_s(start_s + number * first.interval_s, context.bench):
                before, number = len(failed), number + 1
                for name, value_v in _read(contexts, failed, first.interval_s).items():
                    with kept(failed, name):
                        self.steps[name].take(Reading(t_s, value_v), tallies[name], contexts[name])
                if len(failed) > before:  # the time that one took to fail is not to be made up by the others
                    start_s = max(start_s, clock.now() - number * first.interval_s)
                    break
        if len(failed) == len(contexts):
            return {}
        read_back = first.read_back(context)
        results: dict[str, StepResult] = {}
        for name in contexts.keys() - failed.keys():
            with kept(failed, name):
                results[name] = self.steps[name].window(tallies[name], read_back, contexts[name])
        clock.sleep_until(start_s + first.physical_s)
        return {name: results[name] for name in contexts if name in results}


def _read(
    contexts: Mapping[str, Context], failed: dict[str, BenchError], within_s: float = math.inf
) -> dict[str, float]:
    """Read the outputs of all that have not failed, at the same time; return the readings that came `within_s`."""
    meters = {name: each.bench.multimeter for name, each in contexts.items() if name not in failed}
    bench = next(iter(contexts.values())).bench
    typed = "multimeter" in bench.by_hand  # a person takes the time that it takes
    found = read_together(meters, bench.clock, math.inf if typed else within_s)
    failed |= {name: each for name, each in found.items() if isinstance(each, BenchError)}
    return {name: each for name, each in found.items() if not isinstance(each, BenchError)}


class DeviceEnded(Step, Struct, frozen=True):
    """The error that ended one device; the other devices go on."""

    device: str
    kind: str
    what: str

    def describe(self) -> str:
        return f"ENDED: {self.device}: {self.what}"

    def command(self, bench: Bench) -> None:
        """Do nothing."""


def _made(kinds: Mapping[str, type], kind: str, of: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of `of` by device as values of `kind`, one that is known here; ValidationError: it is not."""
    if kind not in kinds:
        raise ValidationError(f"a {kind} is not known here")
    return {name: typed(each, kinds[kind]) if isinstance(each, Mapping) else each for name, each in of.items()}
