"""Batch of gyroscopes: devices one after another, with the same runs for each."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any
from zlib import crc32

from msgspec import Meta, Struct, field

from vcfbench.archive.batch_sheet import SheetRow, sheet_rows
from vcfbench.archive.summary import run_summaries
from vcfbench.clock import utc_now
from vcfbench.errors import BenchError, ConfigError
from vcfbench.files import dotted, parse_toml, read_text, shown
from vcfbench.procedures import catalogue
from vcfbench.procedures.bench_file import described
from vcfbench.procedures.catalogue import is_file
from vcfbench.procedures.procedure import AnyProcedure
from vcfbench.records.metadata import RunMetadata
from vcfbench.records.schema import Status
from vcfbench.runs.request import Request, prepare
from vcfbench.station.description import BenchDescription
from vcfbench.station.file import EMBEDDED
from vcfbench.station.layering import Layer
from vcfbench.strict import converted

TAG = "batch"  # Key of the tag by which the records of a batch are known

_Words = Annotated[str, Meta(min_length=1, max_length=200)]


class _RunOfFile(Struct, frozen=True, forbid_unknown_fields=True):
    """``[[runs]]``."""

    procedure: Annotated[str, Meta(min_length=1)]
    settings: dict[str, Any] = field(default_factory=dict)


class _File(Struct, frozen=True, forbid_unknown_fields=True):
    """A batch file."""

    name: _Words
    runs: Annotated[tuple[_RunOfFile, ...], Meta(min_length=1, max_length=20)]
    devices: tuple[_Words, ...] = ()
    bench: Annotated[str, Meta(min_length=1)] = "paper"
    operator: _Words | None = None


class BatchRun(Struct, frozen=True):
    """One run of each device: the procedure and its settings."""

    procedure: AnyProcedure
    settings: Layer


class Batch(Struct, frozen=True):
    """Plan of a batch: `devices` by their serial numbers, none where they are asked for one by one.

    `name` is the value of the tag of its records, `bench` a bench file or the name of an embedded bench.
    """

    name: str
    devices: tuple[str, ...]
    bench: Path | str
    description: BenchDescription
    operator: str | None
    runs: tuple[BatchRun, ...]

    def request(self, run: BatchRun, serial: str, runs: Path, speed: str | None = None) -> Request:
        """Return one run of a device. On a simulated bench the serial number stands for a specimen: it is the seed."""
        metadata = RunMetadata(dut=serial, operator=self.operator, tags={TAG: self.name})
        seeded = self.description.simulation is not None and self.description.served is None
        seed = crc32(serial.encode()) if seeded else None
        return Request(run.procedure, self.bench, seed, run.settings, runs, speed, metadata=metadata)

    def check(self, serial: str, runs: Path) -> None:
        """Walk the plans of all runs of a device against the limits of the bench; nothing is opened.

        Raises:
            BenchError: a run cannot be as planned; the words name procedure and device.
        """
        for each in self.runs:
            try:
                prepare(self.request(each, serial, runs)).planned()
            except BenchError as error:
                error.hint = "; ".join(filter(None, [error.hint, f"{each.procedure.name} of device {serial}"]))
                raise

    def left(self, serial: str, runs: Path) -> tuple[BatchRun, ...]:
        """Return the runs of a device of which there is no complete record yet."""
        found = run_summaries(runs, dut=serial, status=Status.COMPLETE, tags={TAG: self.name})
        done = {each.procedure for each in found}
        return tuple(each for each in self.runs if each.procedure.name not in done)

    def rows(self, runs: Path, why: Mapping[str, str]) -> tuple[SheetRow, ...]:
        """Return the rows of the sheet in the order of the plan, devices without a record last; `why` some failed."""
        places = {device: place for place, device in enumerate(self.devices)}
        found = sorted(sheet_rows(self.name, runs), key=lambda each: places.get(each.device, len(places)))
        without = dict.fromkeys([*self.devices, *why])
        for each in found:
            without.pop(each.device, None)
        return *found, *(
            SheetRow(
                device=serial,
                procedure=self.runs[0].procedure.name,
                run="",
                started=utc_now(),
                operator=self.operator,
                simulated=self.description.simulated,
                status=Status.INCOMPLETE,
                verdict=None,
                why_none=why.get(serial),
            )
            for serial in without
        )


def read_batch(file: Path | str, operator: str | None = None) -> Batch:
    """Return the batch that a TOML file describes; files that it names are looked for beside it.

    `operator` is another one than it names.

    Raises:
        ConfigError: it cannot be read, a key is unknown, a device or a procedure stands in it twice.
        PlanError: there is no such procedure.
    """
    path, source = Path(file), shown(file)
    said = converted(parse_toml(read_text(path, "a batch file"), source), _File, lambda k: f"{source}: {dotted(k)}")
    bench = (
        said.bench if said.bench in EMBEDDED and not (path.parent / said.bench).is_file() else path.parent / said.bench
    )
    runs = []
    for number, each in enumerate(said.runs):
        named = path.parent / each.procedure if is_file(each.procedure) else each.procedure
        where = f"{source}: runs[{number}].settings"
        layer = Layer(each.settings, lambda keys, where=where: f"{where}.{dotted(keys)}")  # type: ignore[misc]
        runs.append(BatchRun(catalogue.procedure(named), layer))
    _require_once([each.procedure.name for each in runs], f"{source}: runs")
    _require_once(said.devices, f"{source}: devices")
    return Batch(said.name, said.devices, bench, described(bench), operator or said.operator, tuple(runs))


def _require_once(names: tuple[str, ...] | list[str], where: str) -> None:
    """Refuse a name that stands there twice: by it one tells what is done."""
    if twice := next((each for each in names if names.count(each) > 1), None):
        raise ConfigError(f"{where}: {twice} stands there twice")
