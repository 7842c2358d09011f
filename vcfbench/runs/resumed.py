"""Resumed runs: the same procedure, settings and bench, and a new record."""

from collections.abc import Iterator, Sequence
from datetime import datetime
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

from msgspec import Struct, ValidationError, to_builtins
from msgspec.json import decode, encode
from msgspec.structs import replace

from vcfbench.archive.recorded import directory_of
from vcfbench.archive.run import Run
from vcfbench.bench.bench import Bench
from vcfbench.bench.ground import checked_pace
from vcfbench.clock import utc_now
from vcfbench.errors import BenchError, ConfigError, SettingChanged
from vcfbench.files import dotted, shown
from vcfbench.instructions.procedure import AnyProcedure
from vcfbench.interfaces import Operator
from vcfbench.procedures import catalogue
from vcfbench.procedures.bench_file import described
from vcfbench.procedures.layers import recorded_settings, with_settings
from vcfbench.records.amendments import amended, amendments_of
from vcfbench.records.directory import RunDirectory
from vcfbench.records.journal import JournalRecord
from vcfbench.records.metadata import metadata_from
from vcfbench.records.schema import Point, Status
from vcfbench.runs.conduct import conduct
from vcfbench.runs.needs import require_needs, with_duts
from vcfbench.runs.request import DryRun, OneDevice, Prepared, Request, blamed_on
from vcfbench.runs.under_way import profile_of
from vcfbench.safety.control import RunControl
from vcfbench.safety.signals import StopSignals
from vcfbench.safety.trust import Trust, require_trust
from vcfbench.station.description import CALIBRATION_KEYS, BenchDescription
from vcfbench.station.file import EMBEDDED
from vcfbench.station.limits import LimitChecks
from vcfbench.station.settings import ProcedureSettings
from vcfbench.steps.dry_run import PlannedStep, dry_run
from vcfbench.steps.events import Observer
from vcfbench.steps.executor import Execution, Executor
from vcfbench.steps.replay import TakenOver, is_left, rest_of, start_up_again, taken_over
from vcfbench.steps.step import Effect, Plan, Routine
from vcfbench.typed import typed
from vcfbench.version import other_versions

_MAY_DIFFER = {
    *("title", "procedure", "visa_library", "served.control", "rate_table.baud_rate", "laboratory", "notify", "safety"),
    *("resource", "timeout_s", "serial", "serial_pause_s", *CALIBRATION_KEYS),
}
"""Keys of a bench file that no measured value depends on: by path, or by key in the table of a role. The settings of
procedures are those of the record."""


def resume(
    run: str | Path | Run,
    bench: BenchDescription | Path | str | None = None,
    *,
    procedure: str | Path | AnyProcedure | None = None,
    runs: str | Path = "runs",
    observers: Sequence[Observer] = (),
    speed: str | float | None = None,
    operator: Operator | None = None,
    control: RunControl | None = None,
    trust: Trust = False,
) -> Run:
    """Go on with a run that failed, or was stopped or killed, where its record ends; it gets a new record.

    What was measured is not measured again. The bench is first brought to where it was. A simulated bench begins anew.

    Args:
        run: its directory, its name under `runs` (or the beginning or end of it, or ``"last"``), or itself.
        bench: the bench as it is now, if its addresses have changed; None is the bench of the record.
        procedure: needed for your own procedure if it is no longer in the file named in the record.
        runs: directory of the records; the new one lies beside the old one.
        observers: as of :func:`vcfbench.run`.
        speed: as of :func:`vcfbench.run`.
        operator: as of :func:`vcfbench.run`.
        control: as of :func:`vcfbench.run`.
        trust: as of :func:`vcfbench.run`, of the programs that the record names too: the file of its procedure.

    Raises:
        ConfigError: there is no such record, nothing of it is left to be done, or the bench is another.
        PlanError: the procedure or its settings were changed since.
        BenchError: as of :func:`vcfbench.run`.

    >>> print(stopped.status, vcfbench.resume(stopped).status)
    aborted complete
    """
    broken = broken_off(run, runs)
    if procedure is None:
        broken.require_trust(trust)
    request = Request(
        broken.procedure if procedure is None else procedure,
        bench,
        runs=broken.directory.path.parent,
        speed=speed,
        observers=observers,
        operator=operator,
        options={"resume": shown(broken.directory.path), "speed": speed},
        control=control,
        trust=trust,
    )
    with broken.directory.alone(), StopSignals() as signals:
        return conduct(request, signals, partial(Resumed, broken))


def broken_off(run: str | Path | Run, runs: str | Path = "runs") -> "BrokenOff":
    """Return the run named as for :func:`resume`; ConfigError without one, or if it cannot be resumed."""
    path = run if isinstance(run, str | Path) else run.directory
    if path is None:
        raise ConfigError("the run has no record, so it cannot be resumed")
    directory = directory_of(path, runs)
    record = directory.read()
    if record.damage is not None:
        raise ConfigError(
            f"{shown(directory.journal)}: the record is damaged, so it cannot be resumed: {record.damage}"
        )
    if isinstance(several := record.header.get("several"), dict):
        raise ConfigError(
            f"{directory.run} is of one of several devices: it cannot be resumed by itself",
            hint=f"if their run was broken off: vcfbench resume {several.get('run')}",
        )
    if record.status is Status.RUNNING:
        raise ConfigError(f"{directory.run} is still running: resume it after its end")
    if record.status is Status.COMPLETE:
        raise ConfigError(f"{directory.run} is complete: there is nothing to resume")
    error = (record.footer or {}).get("error") or {}
    if error.get("kind") == SettingChanged.__name__:
        raise ConfigError(
            f"{directory.run} cannot be resumed: which of its readings are spoilt is unknown: {error.get('what')}",
            hint="run it anew",
        )
    if not record.header:
        raise ConfigError(f"{shown(directory.journal)}: the record has no whole line, so it cannot be resumed")
    before = record.header.get("resumed_from")
    if isinstance(before, dict) and len(record.steps) < before.get("steps", 0):  # it was cut while it took that over
        earlier = Path(str(before.get("directory")))
        if (earlier / "journal.jsonl").is_file():  # which has more
            return broken_off(earlier)
    return BrokenOff(directory, record)


class BrokenOff(Struct, frozen=True):
    """The record of a run that did not come to its end."""

    directory: RunDirectory
    record: JournalRecord

    @property
    def procedure(self) -> str | Path:
        """Its name, or the file that defines it, which must be that of the record to the byte.

        Raises:
            ConfigError: it is not.
        """
        file = self.record.header.get("procedure_file")
        if not isinstance(file, dict):
            return str(self.record.header.get("procedure"))

        path = Path(str(file.get("path")))
        hint = "give the file with --procedure; it must ask for the same steps up to here"
        if not path.is_file():
            raise ConfigError(f"{shown(path)}: the procedure of {self.directory.run} no longer exists", hint=hint)
        if sha256(path.read_bytes()).hexdigest() != file.get("sha256"):
            raise ConfigError(f"{shown(path)} was changed since {self.directory.run} began", hint=hint)
        return path

    def require_trust(self, trust: Trust) -> None:
        """Raise ConfigError if the record names a procedure's file that is not confirmed to run."""
        if isinstance(self.procedure, Path):
            what = f"{self.directory.run} is of a custom procedure, the program"
            require_trust(what, self.procedure, trust, f"--procedure {shown(self.procedure)}, ")

    def bench(self, asked: BenchDescription | Path | str | None, settings: ProcedureSettings) -> BenchDescription:
        """Return the bench of the record, or the `asked` one if they differ only in addresses and time-outs."""
        header = self.record.header
        try:
            description = replace(typed(header.get("bench"), BenchDescription), notify=None)  # a record names none
        except ValidationError as error:
            raise ConfigError(f"this version cannot read the bench of the record: {error}") from None
        if asked is None and not description.steered:  # its limits count, whatever the record says of them
            asked = self._file_of_station()
        if asked is not None:
            names = ",".join(each["name"] for each in header.get("devices", ()))
            description = with_settings(with_duts(described(asked), names or None), settings)
            now = decode(encode(to_builtins(description)))  # as a header has it
            differing = list(_differences(header.get("bench"), now))
            if differing:
                raise ConfigError(f"the bench differs from the bench of {self.directory.run}: {'; '.join(differing)}")
        if profile_of(description).get("table_profile") != header.get("table_profile"):
            raise ConfigError(f"the profile of the rate table has changed since {self.directory.run}")
        return description

    def _file_of_station(self) -> Path | None:
        """Return the bench file that the run was given; None where a script gave it a description."""
        options = self.record.header.get("options")
        given = options.get("bench") if isinstance(options, dict) else None
        if not isinstance(given, str) or given in EMBEDDED:
            return None
        if not Path(given).is_file():
            raise ConfigError(
                f"{shown(given)}: the bench file of the run is missing, and its limits are needed",
                hint="name it: vcfbench resume RUN --bench FILE",
            )
        return Path(given)

    def require_readable(self) -> None:
        """Raise ConfigError if the header, which is not trusted, cannot be resumed."""
        journal, header = shown(self.directory.journal), self.record.header
        identities, before = header.get("identities", {}), header.get("resumed_from") or {}
        earlier = before.get("before", []) if isinstance(before, dict) else None
        if not isinstance(identities, dict) or not all(isinstance(each, dict) for each in identities.values()):
            raise ConfigError(f"{journal}: identities: expected a table of each role, got {str(identities)[:60]}")
        if not isinstance(earlier, list) or not all(isinstance(each, dict) for each in earlier):
            raise ConfigError(f"{journal}: resumed_from: expected the earlier breaks as a list, got {str(before)[:60]}")


def _differences(then: Any, now: Any, keys: tuple[str, ...] = ()) -> Iterator[str]:
    """Yield in words the differences of two bench files that matter."""
    if dotted(keys) in _MAY_DIFFER or (len(keys) == 2 and keys[1] in _MAY_DIFFER) or then == now:
        return
    if isinstance(then, dict) and isinstance(now, dict):
        for key in {**then, **now}:
            yield from _differences(then.get(key), now.get(key), (*keys, key))
    else:
        yield f"{dotted(keys)} was {then!r}, is {now!r}"


class Resumed(Prepared):
    """A run made ready to go on: the earlier one, and the steps taken over from it."""

    taken: tuple[TakenOver, ...]

    def __init__(self, earlier: BrokenOff, request: Request) -> None:
        super().__init__(request)
        self.earlier = earlier

    def make_ready(self) -> None:
        """Check the request against the record, without opening the bench."""
        header, run, asked = self.earlier.record.header, self.earlier.directory.run, self.request.procedure
        self.earlier.require_readable()
        self.name = str(header.get("procedure"))
        self.metadata = amended(metadata_from(header), amendments_of(self.earlier.record.lines))
        self.procedure = chosen = catalogue.procedure(asked)
        if chosen.name != self.name:
            raise ConfigError(f"{run} is a run of {self.name!r}, not of {chosen.name!r}")
        if chosen.in_one_piece:
            raise ConfigError(f"{run} cannot be resumed: {chosen.in_one_piece}", hint="run it anew")
        self.settings = recorded_settings(chosen, header.get("settings"))
        self.description = description = self.earlier.bench(self.request.bench, self.settings)
        self.simulated = description.simulated
        self.devices = tuple(
            OneDevice(
                each["name"],
                with_settings(description.of_device(each["name"]), settings),
                settings,
                replace(self.metadata, dut=each["name"]),
            )
            for each in header.get("devices", ())
            for settings in [recorded_settings(chosen, each["settings"])]
        )
        self.seed = header.get("seed") if description.simulation is not None else None
        checked_pace(description, self.request.speed)
        require_needs(chosen, description)
        if others := other_versions(header):
            self.request.warn(f"{run} began with other versions: {others}")
        try:
            self.taken = taken_over(self.earlier.record, run)
            self.began_s = float(header.get("began_s", 0.0)) if self.taken else None
        except (AttributeError, LookupError, TypeError, ValueError) as error:
            journal = shown(self.earlier.directory.journal)
            raise ConfigError(f"{journal}: no record of this program: {error!r}") from error

    def _walked(self) -> DryRun:
        """Return the steps still to come, as far as a plan without measured values tells; each within the limits.

        Raises:
            PlanError: the plan asks for other steps than the record has.
            ConfigError: the plan ends by itself where the record ends: what was measured is refused.
        """
        whole = super()._walked()
        if not self._is_left():
            return DryRun(whole.procedure, ())
        with blamed_on(self.procedure):
            gyro, limits = self.gyro(), LimitChecks.of(self.description)
            again = dry_run(self._start_up(), gyro, limits)
        came_s = again[-1].t_s + again[-1].step.duration_s if again else 0.0
        left = whole.steps[len(self.taken) :]
        later = (PlannedStep(each.number, came_s + each.t_s - left[0].t_s, each.step) for each in left)
        return DryRun(whole.procedure, (*again, *later))

    def points(self) -> tuple[Point, ...]:
        """Return the points that are taken over."""
        found = (each.result.recorded_point for each in self.taken)
        return tuple(point for point in found if point is not None)

    def now_s(self) -> float | None:
        """Return the bench time now: the break counts, unless the clock is the simulation's.

        Raises:
            ConfigError: the clock was set back since the record ended.
        """
        if not self.taken:
            return None
        last = self.taken[-1].line
        ended_s = (self.began_s or 0.0) + float(last["end_s"])
        if self.description.steered:
            return ended_s
        gone_s = (utc_now() - datetime.fromisoformat(last["utc"])).total_seconds()
        if gone_s < 0.0:
            raise ConfigError(
                f"{self.earlier.directory.run} ended at {last['utc']}, which is in the future: check the clock"
            )
        return ended_s + gone_s

    def take_bench(self, bench: Bench) -> None:
        """Take note of the open bench; ConfigError: its instruments, or the simulated gyroscope, are others."""
        super().take_bench(bench)
        header = self.earlier.record.header
        if bench.seed != header.get("seed"):
            raise ConfigError(f"the bench has the seed {bench.seed}, the record has {header.get('seed')}")
        known = header.get("identities", {})
        for role, identity in bench.identities.items():
            now, then = (identity.maker, identity.model, identity.serial), known.get(role)
            if then is not None and now != tuple(map(then.get, _WHO)):
                said = ", ".join(str(then.get(each)) for each in _WHO)
                raise ConfigError(f"another {role} is on the bench: {', '.join(now)}; the record has {said}")

    def header_entries(self) -> dict[str, Any]:
        """Return the additional entries of the header: the run that this one was resumed from."""
        earlier, taken = self.earlier.record, self.taken
        before = earlier.header.get("resumed_from")
        resumed_from = {
            "run": self.earlier.directory.run,
            "directory": str(self.earlier.directory.path.resolve()),
            "status": earlier.status.value,
            "seal": earlier.seal,
            "steps": len(taken),
            "measurements": sum(each.step.effect is Effect.MEASURES for each in taken),
            "points": sum(each.result.recorded_point is not None for each in taken),
            "ended_utc": taken[-1].line["utc"] if taken else earlier.header.get("utc"),
            "resumed_utc": utc_now().isoformat(timespec="microseconds"),
            "before": [*before.get("before", ()), {**before, "before": []}] if isinstance(before, dict) else [],
        }
        return {**super().header_entries(), "resumed_from": resumed_from}

    def perform(self, executor: Executor) -> Execution:
        """Copy the recorded steps, restore the state of the bench, and measure the rest."""
        executor.take_over(self.taken)
        if not self._is_left():
            return executor.execute(_nothing_left())
        executor.restore(self._start_up())
        return executor.execute(rest_of(self.plan(), self.taken))

    def _is_left(self) -> bool:
        rest = rest_of(self.plan(), self.taken)
        try:
            with blamed_on(self.procedure):
                return is_left(rest, self.gyro())
        except BenchError as error:
            raise ConfigError(
                f"{self.earlier.directory.run} cannot be resumed, it would end with the same error: {error}",
                hint="run it anew",
            ) from error

    def _start_up(self) -> Routine[None]:
        return start_up_again([each.step for each in self.taken], self.settings)


_WHO = ("maker", "model", "serial")


def _nothing_left() -> Plan:
    yield from ()
