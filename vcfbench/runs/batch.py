"""Batch of gyroscopes: devices one after another, with the same runs for each."""

from collections.abc import Container, Mapping
from pathlib import Path
from typing import Annotated, Any, Final
from zlib import crc32

from msgspec import Meta, Struct, field, to_builtins
from msgspec.json import decode, encode
from msgspec.structs import replace

from vcfbench.archive.batch_sheet import SheetRow, last_runs, sheet_rows
from vcfbench.archive.keeping import not_withdrawn
from vcfbench.archive.summary import RunSummary, run_summaries
from vcfbench.clock import utc_now
from vcfbench.devices.device import KnownDeviceSettings
from vcfbench.errors import BenchError, ConfigError
from vcfbench.files import dotted, parse_toml, read_text, shown
from vcfbench.instructions.procedure import AnyProcedure
from vcfbench.procedures import catalogue
from vcfbench.procedures.bench_file import described
from vcfbench.procedures.catalogue import is_file
from vcfbench.procedures.layers import settings_of
from vcfbench.procedures.own_code import file_of
from vcfbench.records.devices import require_serial
from vcfbench.records.journal import read_header
from vcfbench.records.metadata import RunMetadata
from vcfbench.records.schema import Status
from vcfbench.runs.request import Request, prepare
from vcfbench.station.description import BenchDescription
from vcfbench.station.file import EMBEDDED
from vcfbench.station.layering import Layer, merged
from vcfbench.strict import converted

_CERTIFIES: Final = frozenset({"kvc", "characterize"})
"""Procedures that make a certificate, by which later runs of the same device go."""
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

    `name` is the value of the tag of its records, `bench` a bench file or the name of an embedded bench, `store` the
    directory of the devices where it is another than the settings have.
    """

    name: str
    devices: tuple[str, ...]
    bench: Path | str
    description: BenchDescription
    operator: str | None
    runs: tuple[BatchRun, ...]
    store: Path | None = None

    def _layer(self, run: BatchRun, serial: str) -> Layer:
        """Return the settings of one run of a device: those of the plan, and where the device is kept."""
        keys = run.procedure.settings.keys_of_device(serial, None if self.store is None else str(self.store))
        return Layer(merged(run.settings.values, keys), run.settings.naming)

    @property
    def kept_in(self) -> Path:
        """Directory of the devices of its runs, as far as one is stated."""
        settings = (settings_of(each.procedure, self.description, each.settings, recalled=False) for each in self.runs)
        return self.store or Path(next((each.devices for each in settings if hasattr(each, "devices")), "devices"))

    def request(self, run: BatchRun, serial: str, runs: Path, speed: str | None = None) -> Request:
        """Return one run of a device; on a simulated bench the serial number is the seed."""
        metadata = RunMetadata(dut=serial, operator=self.operator, tags={TAG: self.name})
        seeded = self.description.simulation is not None and self.description.served is None
        seed = crc32(serial.encode()) if seeded else None
        return Request(run.procedure, self.bench, seed, self._layer(run, serial), runs, speed, metadata=metadata)

    def check(self, serial: str, runs: Path) -> None:
        """Check the plans of all runs of a device against the limits of the bench, without opening it.

        What a device has passed is not walked where it cannot be any more: its certificate may be out of date by now.

        Raises:
            BenchError: a run cannot be as planned; the words name procedure and device.
        """
        certified = False
        for each in self.runs:
            request = self.request(each, serial, runs)
            if certified and issubclass(each.procedure.settings, KnownDeviceSettings):
                request = replace(request, settings=self._foreseen(each, self._layer(each, serial)))
            certified |= each.procedure.name in _CERTIFIES and each in self.left(serial, runs)
            try:
                prepare(request).planned()
            except BenchError as error:
                if each not in self.left(serial, runs):
                    continue
                error.hint = "; ".join(filter(None, [error.hint, f"{each.procedure.name} of device {serial}"]))
                raise

    def _foreseen(self, run: BatchRun, asked: Layer) -> Layer:
        """Return the request of a run whose certificate an earlier run will make: K_Vc is the bench's expectation."""
        settings = settings_of(run.procedure, self.description, asked, recalled=False)
        return Layer(merged({"k_vc": f"{settings.expected_gyro().k_vc!r}"}, asked.values), asked.naming)

    def left(self, serial: str, runs: Path) -> tuple[BatchRun, ...]:
        """Return the runs of a device without a complete record that fits the plan."""
        last = last_runs([each for each, other in self._found(runs, serial) if not other])
        return tuple(each for each in self.runs if not _passed(last.get((serial, each.procedure.name))))

    def left_out(self, runs: Path, serial: str | None = None) -> dict[str, str]:
        """Return the records with the tag, of a device or of all, that do not fit the plan: name and reason."""
        return {each.run: other for each, other in self._found(runs, serial) if other}

    def _found(self, runs: Path, serial: str | None) -> list[tuple[RunSummary, str]]:
        """Return the records with the tag, oldest first, each with its difference from the plan."""
        found = [each for each in run_summaries(runs, dut=serial, tags={TAG: self.name}) if each.dut and each.procedure]
        counting = not_withdrawn(found, self.kept_in) if found else []
        gone = "its entry in the history of the device was withdrawn"
        return [
            (each, self._other(each) if each in counting else f"{each.dut}, {each.procedure}: {gone}") for each in found
        ]

    def _other(self, found: RunSummary) -> str:
        """Return the difference of a record from the run of the plan; empty if there is none.

        Values that the plan leaves to what is known of the device are not compared; a run that went by what was known
        of another device than it is of now, by an amendment, is that other device's.
        """
        run = next((each for each in self.runs if each.procedure.name == found.procedure), None)
        if run is None:
            return f"{found.dut}: the plan has no {found.procedure}"
        header = read_header(found.directory / "journal.jsonl")
        recorded = _stated(header)
        if (header.get("settings") or {}).get("station", {}).get("known") is None:
            recorded["dut"] = found.dut
        layer = self._layer(run, str(found.dut))
        settings = settings_of(run.procedure, self.description, layer, recalled=False)
        asked = {
            "bench": to_builtins(self.description),
            "simulated": self.description.simulated,
            "settings": to_builtins(settings),
            "procedure_file": None if run.procedure.name in catalogue.PROCEDURES else file_of(run.procedure),
        }
        expected = {**_stated(decode(encode(asked))), "dut": found.dut}
        for key, value in expected.items():
            looked_up = value is None and key in run.procedure.settings.of_device
            if not looked_up and recorded.get(key) != value:
                return f"{found.dut}, {found.procedure}: {key} {recorded.get(key)}, the plan asks for {value}"
        return ""

    def rows(self, runs: Path, why: Mapping[str, str], left_out: Container[str] | None = None) -> tuple[SheetRow, ...]:
        """Return the rows of the sheet in the order of the plan, runs without a record last; `why` some failed.

        `left_out` are the names of records that do not count; None: those that are not what the plan asks.
        """
        left_out = self.left_out(runs) if left_out is None else left_out
        places = {device: place for place, device in enumerate(self.devices)}
        found = sorted(
            sheet_rows(self.name, runs, left_out, self.kept_in), key=lambda each: places.get(each.device, len(places))
        )
        done = {(each.device, each.procedure) for each in found}
        devices = dict.fromkeys([*self.devices, *why, *(each.device for each in found)])
        names = [each.procedure.name for each in self.runs]
        without = [(device, name) for device in devices for name in names if (device, name) not in done]
        return *found, *(
            SheetRow(
                device=device,
                procedure=name,
                run="",
                started=utc_now(),
                operator=self.operator,
                simulated=self.description.simulated,
                status=Status.INCOMPLETE,
                verdict=None,
                why_none=None if device in {each.device for each in found} else why.get(device),
            )
            for device, name in without
        )


def _passed(found: RunSummary | None) -> bool:
    return found is not None and found.status is Status.COMPLETE and found.verdict in {None, "pass"}


def _stated(header: Mapping[str, Any]) -> dict[str, Any]:
    """Return the properties by which runs differ: bench, its kind, limits of the verdict, settings."""
    bench, settings = header.get("bench") or {}, header.get("settings") or {}
    own = {key: value for key, value in settings.items() if key not in {"station", "devices"}}
    served = "served, " if bench.get("served") is not None else ""
    return {
        "bench": bench.get("name"),
        "kind of bench": f"{served}simulated" if header.get("simulated") else "real",
        "acceptance": settings.get("station", {}).get("acceptance"),
        "its file's SHA-256": (header.get("procedure_file") or {}).get("sha256"),
        **own,
    }


def read_batch(file: Path | str, operator: str | None = None, store: Path | None = None) -> Batch:
    """Return the batch of a TOML file; the files that it names are next to it.

    `operator` is another one than it names, `store` another directory of the devices than the settings have.

    Raises:
        ConfigError: it cannot be read, a key is unknown, a device or a procedure stands in it twice, or its
            bench has several devices.
        PlanError: there is no such procedure.
    """
    path, source = Path(file), shown(file)
    said = converted(parse_toml(read_text(path, "a batch file"), source), _File, lambda k: f"{source}: {dotted(k)}")
    bench = (
        said.bench if said.bench in EMBEDDED and not (path.parent / said.bench).is_file() else path.parent / said.bench
    )
    description = described(bench)
    if description.several:
        raise ConfigError(
            f"{source}: bench: expected a bench with one gyroscope, {bench} has several ([[device]])",
            hint="a batch mounts one after another: `vcfbench run --dut A,B` measures them together",
        )
    for place, serial in enumerate(said.devices):
        try:
            require_serial(serial)
        except ConfigError as error:
            raise ConfigError(f"{source}: devices[{place}]: {error.what}") from None
    runs = []
    for number, each in enumerate(said.runs):
        named = path.parent / each.procedure if is_file(each.procedure) else each.procedure
        where = f"{source}: runs[{number}].settings"
        layer = Layer(each.settings, lambda keys, where=where: f"{where}.{dotted(keys)}")  # type: ignore[misc]
        runs.append(BatchRun(catalogue.procedure(named), layer))
    _require_once([each.procedure.name for each in runs], f"{source}: runs")
    _require_once(said.devices, f"{source}: devices")
    return Batch(said.name, said.devices, bench, description, operator or said.operator, tuple(runs), store)


def _require_once(names: tuple[str, ...] | list[str], where: str) -> None:
    """Refuse a name that stands there twice."""
    if twice := next((each for each in names if names.count(each) > 1), None):
        raise ConfigError(f"{where}: {twice} is listed twice")
