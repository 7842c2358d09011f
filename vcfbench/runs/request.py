"""Request of a run, and the run made ready by it: checked against its bench before anything is opened."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from msgspec import Struct, field, to_builtins
from msgspec.structs import replace

from vcfbench.bench.bench import Bench
from vcfbench.bench.ground import Builder, checked_pace
from vcfbench.drivers.together import Outputs
from vcfbench.errors import ConfigError, PlanError
from vcfbench.files import shown
from vcfbench.instructions.procedure import AnyProcedure
from vcfbench.interfaces import Identity, Operator
from vcfbench.procedures import bench_file, catalogue
from vcfbench.procedures.layers import asked_in_python, of_device, settings_of, with_settings
from vcfbench.procedures.own_code import file_of, mistake_of
from vcfbench.records.directory import RunDirectory
from vcfbench.records.metadata import RunMetadata, metadata_of
from vcfbench.records.schema import Point
from vcfbench.reports.shielded import NoProgress
from vcfbench.runs.needs import require_ambient, require_needs, require_several, with_duts
from vcfbench.safety.control import RunControl
from vcfbench.safety.trust import Trust
from vcfbench.station.description import BenchDescription, Simulation, whole_seed
from vcfbench.station.layering import Layer
from vcfbench.station.limits import LimitChecks
from vcfbench.station.linear_gyro import LinearGyro, LinearGyros
from vcfbench.station.settings import ProcedureSettings
from vcfbench.steps import AskOperator
from vcfbench.steps.dry_run import PlannedStep
from vcfbench.steps.dry_run import dry_run as walked
from vcfbench.steps.each import EachOf
from vcfbench.steps.events import Observer
from vcfbench.steps.executor import Execution, Executor
from vcfbench.steps.step import Plan
from vcfbench.steps.together import together

if TYPE_CHECKING:
    from vcfbench.runs.expected import Expectation


def warned(words: str) -> None:
    """Warn as Python does."""
    warnings.warn(words, UserWarning, stacklevel=2)


class Request(Struct, frozen=True):
    """Request of a run; `settings` with the words for errors, `options` are its words that the record keeps.

    `operator` does what only hands can do, on any bench; `person` is asked where there are real hands only.
    `metadata` is what the record shall say of the run beside what is measured. `warn` tells in a line what keeps no run
    from beginning.
    `runs` is where the record goes; None keeps none, on a simulated bench. `build` is as of `open_bench`. `control` is
    what stops it and has it pause. `trust` is whether programs that data files name may run, or who is asked. `display`
    makes what shows the run, told which one is about to begin.
    """

    procedure: str | Path | AnyProcedure
    bench: BenchDescription | Path | str | None = None
    seed: int | None = None
    settings: Layer | None = None
    runs: Path | None = Path("runs")
    speed: str | float | None = None
    observers: Sequence[Observer] = ()
    display: Callable[[Prepared], AbstractContextManager[Observer]] = lambda _: NoProgress()
    operator: Operator | None = None
    person: Operator | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    metadata: RunMetadata = field(default_factory=RunMetadata)
    warn: Callable[[str], None] = warned
    build: Builder | None = None
    control: RunControl | None = None
    trust: Trust = False


class OneDevice(Struct, frozen=True):
    """One of several gyroscopes of a run: its bench, its settings, and the metadata of its record."""

    name: str
    description: BenchDescription
    settings: ProcedureSettings
    metadata: RunMetadata


class Prepared:
    """A run prepared from its request; bench, seed and device are set even if the rest fails.

    `name` is that of the procedure; until that is found, what was asked for. `began_s` is the bench time at which its
    plan began, None as long as it has not; `directory` that of its record. There is no `description` of the bench, no
    `procedure` and no `settings` before :meth:`make_ready` has found them.
    """

    description: BenchDescription
    procedure: AnyProcedure
    settings: ProcedureSettings

    def __init__(self, request: Request) -> None:
        self.request = request
        self.name = getattr(request.procedure, "name", str(request.procedure))
        self.metadata = request.metadata
        self.seed: int | None = None
        self.simulated: bool | None = None
        self.began_s: float | None = None
        self.directory: RunDirectory | None = None
        self.devices: tuple[OneDevice, ...] = ()
        """Of a bench with several gyroscopes all of them; the first stands for what they share."""
        self._planned: DryRun | None = None

    def make_ready(self) -> None:
        """Read the bench file and check the request against it, without opening the bench."""
        request = self.request
        self.description = description = bench_file.described(request.bench)
        self.simulated = description.simulated
        self.procedure = chosen = catalogue.procedure(request.procedure)
        self.name = chosen.name
        self.seed = self._seed()
        checked_pace(description, request.speed)
        require_needs(chosen, description)
        metadata = request.metadata
        require_ambient(metadata, description)
        description = with_duts(description, metadata.dut)
        if not description.several:
            self.description, self.settings, self.metadata = self._settled(description, metadata)
            return
        require_several(chosen, description)
        made = ((name, replace(metadata, dut=name), description.of_device(name)) for name in description.several)
        self.devices = tuple(OneDevice(name, *self._settled(own, of)) for name, of, own in made)
        self.settings = self.devices[0].settings
        self.description = with_settings(description, self.settings)
        operator = metadata.operator or description.laboratory.operator
        self.metadata = replace(metadata, dut=",".join(description.several), operator=operator)

    def _settled(
        self, description: BenchDescription, metadata: RunMetadata
    ) -> tuple[BenchDescription, ProcedureSettings, RunMetadata]:
        """Return bench, settings and metadata of the one device of `description`."""
        request, chosen = self.request, self.procedure
        with blamed_on(chosen):
            source = shown(request.bench) if isinstance(request.bench, str | Path) else None
            settings = settings_of(chosen, description, of_device(chosen, request.settings, metadata.dut), source)
        if None not in (metadata.dut, settings.named_device) and metadata.dut != settings.named_device:
            raise ConfigError(
                f"dut: expected one device, got {metadata.dut}, and {settings.named_device} in the settings"
            )
        operator = metadata.operator or description.laboratory.operator
        metadata = replace(metadata, dut=metadata.dut or settings.named_device, operator=operator)
        return with_settings(description, settings), settings, metadata

    def _seed(self) -> int | None:
        """Return the seed that the run will have, as far as it is known before the bench is opened."""
        seed, description = self.request.seed, self.description
        if seed is None:
            return None if description.simulation is None else description.simulation.seed
        if description.served is not None:
            raise ConfigError(f"--seed {seed}: {description.name} is served, its server was given the seed")
        if description.simulation is None:
            raise ConfigError(f"--seed {seed}: {description.name} has no [simulation], only such a bench has a seed")
        return whole_seed(seed)

    def asked(self) -> dict[str, Any]:
        """Return the settings that were asked for, as the record keeps them."""
        return {} if self.request.settings is None else dict(self.request.settings.values)

    def left_out(self) -> list[str]:
        """Say which entries of the device do not count, because they are from benches of the other kind."""
        serial, root = self.settings.named_device, getattr(self.settings, "devices", None)
        if serial is None or root is None:
            return []
        from vcfbench.records.devices import DeviceStore  # noqa: PLC0415  # few runs are of a device

        said = DeviceStore(Path(root), self.description.simulated).left_out(serial)
        return [said] if said else []

    def plan(self) -> Plan:
        """Return the plan, from its beginning; of several devices all of them together."""
        if self.devices:
            return together({each.name: partial(self._plan_by, each.settings) for each in self.devices})
        return self._plan_by(self.settings)

    def gyro(self) -> LinearGyro:
        """Return the gyroscope on paper that answers a dry run."""
        if not self.devices:
            return self.settings.expected_gyro()
        return LinearGyros.together({each.name: each.settings.expected_gyro() for each in self.devices})

    def _plan_by(self, settings: ProcedureSettings) -> Plan:
        try:
            plan = self.procedure.plan(settings)
        except TypeError as error:
            said = PlanError(f"procedure {self.procedure.name!r}: expected a plan that takes the settings: {error}")
            raise mistake_of(self.procedure, error) or said from error
        if not isinstance(plan, Generator):
            raise PlanError(f"procedure {self.procedure.name!r}: expected a plan that yields steps, got {plan!r}")
        return plan

    def planned(self) -> DryRun:
        """Walk the plan, once; raises LimitError when a step of it would leave a limit of the bench."""
        if self._planned is None:
            self._planned = self._walked()
        return self._planned

    def _walked(self) -> DryRun:
        with blamed_on(self.procedure):
            steps = walked(self.plan(), self.gyro(), LimitChecks.of(self.description))
        return DryRun(self.procedure.name, tuple(steps), (self.procedure, self.settings, self.description.simulation))

    def require_operator(self) -> None:
        """Check the plan; PlanError if it has manual steps and no operator is there."""
        by_hand = [f"set and read the {role.replace('_', ' ')} by hand" for role in self.description.by_hand]
        by_hand += [each.step.words for each in self.planned().steps if isinstance(each.step, AskOperator)]
        somebody = self.description.steered or self.request.operator is not None or self.request.person is not None
        if by_hand and not somebody:
            more = "" if len(by_hand) == 1 else f", and {len(by_hand) - 1} more"
            raise PlanError(
                f"{self.name} asks a person to {by_hand[0]}{more}, but no operator can be asked",
                hint="run it at a terminal, or with --yes if all is done as asked; from Python with an operator",
            )

    def now_s(self) -> float | None:
        """Return the bench time at this moment, None where it is for the bench to begin one."""
        return None

    def take_bench(self, bench: Bench) -> None:
        """Note the seed and the identities of the open bench.

        Real ones are by the serial numbers that they answered. Simulated ones answer one and the same, whichever
        specimen the seed has drawn: there the seed tells. What a server draws of its bench it does not say, so all of
        its instruments go by its seed.
        """
        self.seed = bench.seed
        if roles := bench.simulated_roles:
            self._believe_simulated(" and ".join(roles))
        self.settings = self._placed(self.settings, bench, bench.identities)
        outputs = bench.instruments.get("multimeter")
        own = outputs.identities if isinstance(outputs, Outputs) else {}
        identities = {name: {**bench.identities, "multimeter": each} for name, each in own.items()}
        self.devices = tuple(
            replace(each, settings=self._placed(each.settings, bench, identities.get(each.name, {})))
            for each in self.devices
        )

    def _believe_simulated(self, roles: str) -> None:
        """Have the run count as simulated; ConfigError where it is of a device, and has recalled real entries."""
        words = f"the bench file is of a real bench, but {roles} are simulated: they have made-up serial numbers, or a "
        words += "server on this computer knows them"
        if any(each.named_device for each in (self.settings, *(own.settings for own in self.devices))):
            raise ConfigError(words, hint="[served] control = HOST:PORT in the bench file, as `sim serve` writes it")
        self.request.warn(f"{words}; the run counts as simulated")
        self.simulated = True

    def _placed(self, of: ProcedureSettings, bench: Bench, identities: Mapping[str, Identity]) -> ProcedureSettings:
        """Return settings with the instruments of `bench` told apart."""
        station, simulation = of.station, self.description.simulation
        placed = dict(station.instruments)
        for role, each in station.instruments.items():
            if not self.description.steered:
                if role in identities:
                    placed[role] = each.answering(identities[role].serial)
            elif simulation is None or "drawn" in getattr(simulation.errors, role, ()):
                placed[role] = each.drawn_by(bench.seed)
        return replace(of, station=replace(station, instruments=placed))

    def take_metadata(self, metadata: RunMetadata) -> None:
        """Note the conditions that the bench reads; they are common to all devices."""
        self.metadata = metadata
        self.devices = tuple(replace(each, metadata=replace(metadata, dut=each.metadata.dut)) for each in self.devices)

    def points(self) -> tuple[Point, ...]:
        """Return the points that were measured before."""
        return ()

    def header_entries(self) -> dict[str, Any]:
        """Return the additional entries of the header: the file of a custom procedure, the several devices."""
        own = {} if self.name in catalogue.PROCEDURES else {"procedure_file": file_of(self.procedure)}
        devices = [{"name": each.name, "settings": to_builtins(each.settings)} for each in self.devices]
        return {**own, **({"devices": devices} if devices else {})}

    def perform(self, executor: Executor) -> Execution:
        """Execute the plan on the open bench."""
        return executor.execute(self.plan())


Preparing = Callable[[Request], Prepared]  # Makes the run of a request, which is not ready yet


def prepare(request: Request) -> Prepared:
    """Prepare the run of a request, without opening the bench."""
    prepared = Prepared(request)
    prepared.make_ready()
    return prepared


class DryRun(Struct, frozen=True):
    """A plan that was walked without a bench: each step with its number, its time and its description.

    >>> plan = vcfbench.dry_run("turntable")
    >>> [f"{value.name}: U95 {value.u95:.0e} {value.unit}" for value in plan.expected.values][:2]
    ['scale_factor: U95 6e-07 V/(deg/s)', 'bias: U95 7e-05 V']
    """

    procedure: str
    steps: tuple[PlannedStep, ...]
    _planned_by: tuple[AnyProcedure, ProcedureSettings, Simulation | None] | None = None

    @property
    def expected(self) -> Expectation:
        """Expected statement of the run: U95 of every result and its largest causes; worked out when asked for."""
        from vcfbench.runs.expected import Expectation, expectation  # noqa: PLC0415  # loads numpy

        if self._planned_by is None:
            return Expectation((), "", "it goes on with another run")
        steps = [each.step.first if isinstance(each.step, EachOf) else each.step for each in self.steps]
        return expectation(*self._planned_by, steps)

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

    >>> plan = vcfbench.dry_run("turntable", settings={"samples": 20})
    >>> f"{plan.bench_seconds / 60:.0f} min"
    '7 min'
    """
    described, asked_of = metadata_of(metadata), asked_in_python(settings or {})
    return prepare(Request(procedure, bench, seed, asked_of, speed=speed, metadata=described)).planned()


@contextmanager
def blamed_on(procedure: AnyProcedure) -> Iterator[None]:
    """Raise mistakes in the code of a procedure that did not come along as PlanError, with file and line."""
    try:
        yield
    except Exception as error:
        if (mistake := mistake_of(procedure, error)) is not None:
            raise mistake from error
        raise
