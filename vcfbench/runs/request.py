"""Request of a run, checked against its bench before anything is opened."""

from __future__ import annotations

import warnings
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from msgspec import Struct, field
from msgspec.structs import replace

from vcfbench.bench.ground import checked_pace
from vcfbench.errors import ConfigError, PlanError
from vcfbench.files import dotted, shown
from vcfbench.procedures import bench_file, catalogue
from vcfbench.procedures.layers import asked_in_python, settings_of, with_settings
from vcfbench.records.metadata import RunMetadata, metadata_of
from vcfbench.reports.shielded import NoProgress
from vcfbench.runs.needs import require_ambient, require_needs
from vcfbench.station.description import whole_seed
from vcfbench.station.layering import Layer, merged
from vcfbench.station.limits import LimitChecks
from vcfbench.steps.dry_run import dry_run as walked

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from contextlib import AbstractContextManager

    from vcfbench.bench.bench import Bench
    from vcfbench.bench.ground import Builder
    from vcfbench.procedures.procedure import AnyProcedure
    from vcfbench.records.schema import Point
    from vcfbench.runs.expected import Expectation
    from vcfbench.safety.control import RunControl
    from vcfbench.safety.trust import Trust
    from vcfbench.station.description import BenchDescription
    from vcfbench.station.settings import ProcedureSettings
    from vcfbench.steps.dry_run import PlannedStep
    from vcfbench.steps.executor import Execution, Executor, Observer
    from vcfbench.steps.step import Operator, Plan

    Display = Callable[["Beginning"], AbstractContextManager[Observer]]
    """Makes a display, told what is about to begin."""


def warned(words: str) -> None:
    """Warn as Python does."""
    warnings.warn(words, UserWarning, stacklevel=2)


class Request(Struct, frozen=True):
    """Request of a run; `settings` with the words for errors, `options` are its words that the record keeps.

    `operator` does what only hands can do, on any bench; `person` is asked where there are real hands only.
    `metadata` is what the record shall say of the run beside what is measured. `warn` tells in a line what keeps no run
    from beginning.
    `runs` is where the record goes; None keeps none, on a simulated bench. `build` is as of `open_bench`. `control` is
    what stops it and has it pause. `trust` is whether programs that data files name may run, or who is asked.
    """

    procedure: str | Path | AnyProcedure
    bench: BenchDescription | Path | str | None = None
    seed: int | None = None
    settings: Layer | None = None
    runs: Path | None = Path("runs")
    speed: str | float | None = None
    observers: Sequence[Observer] = ()
    display: Display = lambda _: NoProgress()
    operator: Operator | None = None
    person: Operator | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    metadata: RunMetadata = field(default_factory=RunMetadata)
    warn: Callable[[str], None] = warned
    build: Builder | None = None
    control: RunControl | None = None
    trust: Trust = False


class Beginning(Struct, frozen=True):
    """Facts for a display before the bench is opened.

    `planned` are the steps that are still to be done, `points` those that were measured before the run was broken off.
    """

    procedure: AnyProcedure
    description: BenchDescription
    planned: DryRun
    directory: Path | None
    points: tuple[Point, ...] = ()


class Checked(Struct):
    """The request, as far as it has been checked: bench and seed are told also where the rest cannot be.

    `name` is that of the procedure; until that is found, what was asked for.
    """

    name: str = ""
    description: BenchDescription | None = None
    seed: int | None = None
    metadata: RunMetadata = field(default_factory=RunMetadata)


class Prepared(Struct, frozen=True):
    """All that a run needs to begin: the bench, the procedure, its settings.

    `began_s` is the bench time at which its plan began, None as long as it has not.
    """

    description: BenchDescription
    procedure: AnyProcedure
    settings: ProcedureSettings
    began_s: float | None = None

    def plan(self) -> Plan:
        """Return the plan, from its beginning."""
        plan = self.procedure.plan(self.settings)
        if not isinstance(plan, Generator):
            raise PlanError(f"procedure {self.procedure.name!r}: expected a plan that yields steps, came {plan!r}")
        return plan

    def planned(self) -> DryRun:
        """Walk the plan; raises LimitError when a step of it would leave a limit of the bench."""
        with blamed_on(self.procedure):
            steps = walked(self.plan(), self.settings.expected_gyro(), LimitChecks.of(self.description))
        return DryRun(self.procedure.name, tuple(steps), self)

    def now_s(self) -> float | None:
        """Return the bench time at this moment, None where it is for the bench to begin one."""
        return None

    def require_bench(self, bench: Bench) -> None:
        """See that the open bench is the one that is meant."""

    def points(self) -> tuple[Point, ...]:
        """Return the points that were measured before."""
        return ()

    def header_entries(self) -> dict[str, Any]:
        """Return the additional entries of the header: the file of a procedure of one's own."""
        if self.procedure.name in catalogue.PROCEDURES:
            return {}
        from vcfbench.procedures.own_code import file_of  # noqa: PLC0415  # few are one's own

        return {"procedure_file": file_of(self.procedure)}

    def perform(self, executor: Executor) -> Execution:
        """Let `executor` carry out the plan, on the open bench."""
        return executor.execute(self.plan())


class DryRun(Struct, frozen=True):
    """A plan that was walked without a bench: each step with its number, its time and its description."""

    procedure: str
    steps: tuple[PlannedStep, ...]
    _prepared: Prepared | None = None

    @property
    def expected(self) -> Expectation:
        """Expected statement of the run: U95 of every result and its largest causes; worked out when asked for."""
        from vcfbench.runs.expected import Expectation, expectation  # noqa: PLC0415  # loads numpy

        if self._prepared is None:
            return Expectation((), "", "it goes on with another run")
        return expectation(self._prepared.procedure, self._prepared.settings, [each.step for each in self.steps])

    @property
    def bench_seconds(self) -> float:
        """Estimate of the bench time, s."""
        return self.steps[-1].t_s + self.steps[-1].step.duration_s if self.steps else 0.0

    @property
    def physical_minimum_s(self) -> float:
        """Time of windows, ramps and settling, s."""
        return sum(each.step.physical_s for each in self.steps)

    def __repr__(self) -> str:
        return f"<DryRun {self.procedure}: {len(self.steps)} steps, {self.bench_seconds:.0f} s of bench time>"


def dry_run(
    procedure: str | Path | AnyProcedure,
    bench: BenchDescription | Path | str | None = None,
    *,
    seed: int | None = None,
    settings: Mapping[str, Any] | None = None,
    speed: str | float | None = None,
    metadata: Mapping[str, Any] | RunMetadata | None = None,
) -> DryRun:
    """Walk the plan of `procedure` with answers predicted, each step held against the limits of the bench.

    Nothing is opened or sent. The arguments are those of :func:`vcfbench.run`.

    Raises:
        ConfigError: the bench file, a setting, seed or speed cannot be used.
        PlanError: there is no such procedure.
        LimitError: a step would leave a limit of the bench; it names step, limit and the time in the plan.
    """
    described, asked_of = metadata_of(metadata), asked_in_python(settings or {})
    return prepare(Request(procedure, bench, seed, asked_of, speed=speed, metadata=described), Checked()).planned()


def prepare(request: Request, checked: Checked) -> Prepared:
    """Read the bench file and check the request against it; nothing is opened.

    Findings are put into `checked` as they become known.
    """
    checked.name = getattr(request.procedure, "name", str(request.procedure))
    checked.metadata = request.metadata
    checked.description = description = bench_file.described(request.bench)
    chosen = catalogue.procedure(request.procedure)
    checked.name = chosen.name
    checked.seed = _seed(description, request.seed)
    checked_pace(description, request.speed)
    require_needs(chosen, description)
    require_ambient(request.metadata, description)
    with blamed_on(chosen):
        settings = settings_of(chosen, description, _with_device(request, chosen), _source(request.bench))
    metadata = request.metadata
    if None not in (metadata.dut, settings.named_device) and metadata.dut != settings.named_device:
        raise ConfigError(
            f"dut: the device is {metadata.dut}, and {settings.named_device} in the settings: which is it?"
        )
    checked.metadata = replace(
        metadata,
        dut=metadata.dut or settings.named_device,
        operator=metadata.operator or description.laboratory.operator,
    )
    return Prepared(with_settings(description, settings), chosen, settings)


@contextmanager
def blamed_on(procedure: AnyProcedure) -> Iterator[None]:
    """Raise mistakes in the code of a procedure that did not come along as PlanError, with file and line."""
    from vcfbench.procedures.own_code import mistake_of  # noqa: PLC0415  # now: later there may be no file left

    try:
        yield
    except Exception as error:
        if (mistake := mistake_of(procedure, error)) is not None:
            raise mistake from error
        raise


def _with_device(request: Request, procedure: AnyProcedure) -> Layer | None:
    """Return the requested settings, with the device for a procedure that uses the device's history."""
    of_device = {} if request.metadata.dut is None else procedure.settings.keys_of_device(request.metadata.dut)
    if not of_device or request.settings is None:
        return Layer(of_device, dotted) if of_device else request.settings
    return Layer(merged(of_device, request.settings.values), request.settings.naming)


def _source(bench: BenchDescription | Path | str | None) -> str | None:
    return shown(bench) if isinstance(bench, str | Path) else None


def _seed(description: BenchDescription, seed: int | None) -> int | None:
    """Return the seed that the run will have, as far as it is known before the bench is opened."""
    if seed is None:
        return None if description.simulation is None else description.simulation.seed
    if description.served is not None:
        raise ConfigError(f"--seed {seed}: {description.name} is served, its server was given the seed")
    if description.simulation is None:
        raise ConfigError(f"--seed {seed}: {description.name} is a real bench, only simulated ones have a seed")

    return whole_seed(seed)
