"""A run for scripts and notebooks."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple
from zlib import crc32

from msgspec import Struct, field
from msgspec.structs import astuple

from vcfbench.errors import BenchError, ConfigError
from vcfbench.records.amendments import Amendment
from vcfbench.records.damage import own_readings
from vcfbench.records.export import point_columns
from vcfbench.records.journal import lines_of, read_header, read_journal
from vcfbench.records.metadata import Equipment, RunMetadata
from vcfbench.records.plain import plain
from vcfbench.records.schema import Point, Status
from vcfbench.records.stated import values_of
from vcfbench.reports.document import Part, Report, Text
from vcfbench.reports.generic import verdict_table
from vcfbench.station.acceptance import Acceptance
from vcfbench.steps.measured import Measured
from vcfbench.values.value import Value


class RawReading(NamedTuple):
    """One recorded reading of the multimeter; a tuple, of which pandas makes a row with these names.

    `number` is that of the step that was performed, from 1; `step` is the procedure's step (1 to 4), as in a point.
    `t_s` is bench time, s. `voltage_v` is the reading, V. `table_rate_deg_s` is what the table read back at the end of
    the reading's window, deg/s, None where the window failed before that, or used no table. `v_vc_v` is what the meter
    on V_Vc read at the same time, V, None where there was none.

    >>> reading = run.readings[0]
    >>> f"{reading.t_s:.1f} s: {reading.voltage_v:+.3f} V at {reading.table_rate_deg_s:+.1f} deg/s"
    '5.3 s: -0.042 V at +0.0 deg/s'
    """

    number: int
    step: int
    t_s: float
    voltage_v: float
    table_rate_deg_s: float | None
    v_vc_v: float | None = None


class Run(Struct, frozen=True, eq=False):
    """Outcome of a run: its points, results, verdict and record.

    `procedure` is its name. `status` says how it ended (``run.status == "complete"``). `points` are the averaged points
    that were measured. `results` are what the procedure made of them (``run.results.k_vc.value``), None if there are
    none. If the procedure of a record is not known here, they are a read-only mapping of what is stored in
    ``result.json``. `no_results` says why in both cases. `error` is what ended the run, None if nothing did. `verdict`
    is that on the limits of ``[acceptance]``, None if there are none. `directory` is where the record is, None if
    nothing was recorded. `bench` is its name; `seed` that of a simulated bench. `bench_seconds` is how long it took in
    bench time. `physical_minimum_s` is how much of it is windows, ramps and settling, None if no step was performed.
    `asked_again` names answers that could not be believed, `observers_lost` observers that failed and were left out.
    `not_checked` says what the procedure would have checked on a bench with more instruments. `device_entry` is the
    file in the device store that the run added, None if it added none. `resumed` says, for each time that the run was
    broken off and resumed, what had been measured before; `pauses`, for each time that it paused, after which step, how
    long, and by how much the output moved. `metadata` is which device it was of, who did it and under
    what conditions (``run.metadata.dut``), `equipment` the instruments that it opened, with the dates of their
    calibration. `amendments` say what was amended since, by whom and why; `metadata` has the amended words.

    >>> print(run.status, run.metadata.dut, run.values["scale_factor"])
    complete G-0042 -12.5630(29) mV/(deg/s)
    """

    procedure: str
    status: Status
    points: tuple[Point, ...] = ()
    results: Any = None
    no_results: str | None = None
    error: BenchError | None = None
    verdict: Acceptance | None = None
    directory: Path | None = None
    bench: str | None = None
    simulated: bool | None = None
    seed: int | None = None
    bench_seconds: float | None = None
    physical_minimum_s: float | None = None
    asked_again: tuple[str, ...] = ()
    observers_lost: tuple[str, ...] = ()
    damage: str | None = None
    not_checked: tuple[str, ...] = ()
    device_entry: Path | None = None
    metadata: RunMetadata = field(default_factory=RunMetadata)
    equipment: tuple[Equipment, ...] = ()
    resumed: tuple[str, ...] = ()
    amendments: tuple[Amendment, ...] = ()
    pauses: tuple[str, ...] = ()
    devices: tuple["Run", ...] = ()
    """Of a run of several devices: that of each."""
    _own_report: Report = Report()
    _measured: Any = None
    _header: Mapping[str, Any] = field(default_factory=dict)
    _values: tuple[Value, ...] | None = None

    @property
    def revision(self) -> int:
        """1, and one more for each time that the record was amended."""
        return len(self.amendments) + 1

    @property
    def measured(self) -> Measured:
        """Measured data from which results are computed; readings are read from the record at first use."""
        if self._measured is not None:
            kept: Measured = self._measured
            return kept
        if self.directory is None:
            return Measured(self.points)
        return Measured(self.points, partial(lines_of, self.directory / "journal.jsonl"))

    @property
    def name(self) -> str | None:
        """Name of the record, or None without a record."""
        return None if self.directory is None else self.directory.name

    @property
    def header(self) -> Mapping[str, Any]:
        """Header of the record: operator, procedure, bench, identities, settings, versions; read when asked for.

        For a run without a record the header that it would have, empty where the bench was not opened.

        Raises:
            ConfigError: the record cannot be read any more.
        """
        return self._header if self.directory is None else read_header(self.directory / "journal.jsonl")

    @property
    def readings(self) -> tuple[RawReading, ...]:
        """Every raw reading, in the order of time; read from the record when asked for.

        ``pandas.DataFrame(run.readings)`` makes a table of them.

        Raises:
            ConfigError: the record cannot be read any more, or is of several devices: each of `devices` has its own.
        """
        if self.directory is None:
            return ()
        if "devices" in self.header:
            raise ConfigError(f"{self.name} is of several devices, each of which has readings of its own")
        record = read_journal(self.directory / "journal.jsonl")
        found = []
        try:
            tables = {line["n"]: line["result"].get("table_rate_deg_s") for line in record.steps}
            for line in (*record.chunks, *record.steps, *record.errors):  # windows whole or in chunks, and those cut
                number, table_deg_s = line["n"], tables.get(line["n"])
                for reading in own_readings(line):
                    seen = (reading["t_s"], reading["voltage_v"], table_deg_s, reading.get("v_vc_v"))
                    found.append(RawReading(number, line["step"]["step"], *seen))
        except (AttributeError, KeyError, TypeError) as error:
            raise ConfigError(f"this version cannot read the readings: {error!r}") from error
        return tuple(sorted(found, key=lambda each: each.t_s))

    def table(self) -> Any:
        """Return the points as a pandas DataFrame, a row each, with the columns of ``points.csv``.

        Raises:
            ImportError: pandas is not installed.
        """
        try:
            import pandas as pd  # type: ignore[import-untyped, import-not-found, unused-ignore] # noqa: PLC0415
        except ImportError as error:
            raise ImportError("Run.table needs pandas, which is not installed: pip install pandas") from error

        return pd.DataFrame([point.as_json() for point in self.points], columns=list(point_columns(self.points)))

    @property
    def values(self) -> dict[str, Value]:
        """The values that the results state, by name, in their order, with definitions and conditions."""
        return values_of(self.results) if self._values is None else {each.name: each for each in self._values}

    def as_json(self) -> dict[str, Any]:
        """Return the output of ``vcfbench run --json``; a failed run has its error next to its points."""
        answer: dict[str, Any] = {
            "run": self.name,
            "procedure": self.procedure,
            "status": self.status.value,
            "bench": self.bench,
            "simulated": self.simulated,
            "seed": self.seed,
            "metadata": self.metadata.as_json(),
            "equipment": [each.as_json() for each in self.equipment],
            "bench_seconds": self.bench_seconds or 0.0,
            "points": [point.as_json() for point in self.points],
            "results": {} if self.results is None else plain(self.results),
            "values": [each.as_json() for each in self.values.values()],
            "acceptance": None if self.verdict is None else self.verdict.as_json(),
            "asked_again": list(self.asked_again),
            **({"not_checked": list(self.not_checked)} if self.not_checked else {}),
            **({"resumed": list(self.resumed)} if self.resumed else {}),
            **({"pauses": list(self.pauses)} if self.pauses else {}),
            **({"devices": [each.as_json() for each in self.devices]} if self.devices else {}),
            **({} if self.device_entry is None else {"device_entry": str(self.device_entry)}),
            **({"revision": self.revision, "amendments": plain(self.amendments)} if self.amendments else {}),
        }
        error = self.error
        return answer if error is None else {**answer, "error": str(error), "exit_code": error.exit_code}

    def __eq__(self, other: object) -> bool:
        """Return True if all but the measured data is the same: a run of a record reads that when it is asked for."""
        return isinstance(other, Run) and astuple(self)[:-3] == astuple(other)[:-3]

    def __hash__(self) -> int:
        return hash(astuple(self)[:-3])

    def __repr__(self) -> str:
        return f"<Run {self.name or self.procedure}: {self.status.value}, {len(self.points)} points>"

    def report(self) -> Report:
        """Return the outcome as a report: its own, breaks and pauses, checks left out, the verdict."""
        return Report([*self._own_report.parts, *self.remarks])

    @property
    def remarks(self) -> list[Part]:
        """Breaks, pauses, checks left out, and the verdict, for a report."""
        broken: list[Part] = [Text(f"resumed: {each}") for each in self.resumed]
        broken += [Text(f"paused {each}") for each in self.pauses]
        left_out = [Text(f"not checked: {each}") for each in self.not_checked]
        verdict = [] if self.verdict is None else [verdict_table(self.verdict)]
        return [*broken, *left_out, *verdict]

    def _repr_html_(self) -> str:
        """Show the run in a notebook: its end, and its report with its figures."""
        from vcfbench.reports.html_page import piece_of  # noqa: PLC0415  # loads Matplotlib

        said = [Text(f"{self.name or self.procedure}: {self.status.value}")]
        if self.error is not None:
            said.append(Text(str(self.error)))
        name = (self.name or self.procedure).encode()  # a directory may be called anything
        return piece_of(Report([*said, *self.report().parts]), f"r{crc32(name):08x}")


def breaks(header: Mapping[str, Any], points: int) -> tuple[str, ...]:
    """Return for each break in the run of `header` in words which of its `points` were measured before it."""
    resumed_from = header.get("resumed_from")
    if not isinstance(resumed_from, dict):
        return ()
    earlier = resumed_from.get("before", [])
    if not isinstance(earlier, list) or not all(isinstance(each, dict) for each in earlier):
        raise ConfigError(f"resumed_from: expected the earlier breaks as a list, got {str(earlier)[:60]}")
    in_process = header.get("simulated") and header.get("bench", {}).get("served") is None
    anew = "; the simulated world began anew" if in_process else ""
    said = []
    for each in (*earlier, resumed_from):
        some = f"of {points} points {each.get('points')} were measured"
        taken = some if points else f"{each.get('measurements')} records were taken"
        said.append(
            f"{taken} before the break of {clock(each.get('ended_utc'))}, in {each.get('run')}; "
            f"the bench was started up again at {clock(each.get('resumed_utc'))}{anew}"
        )
    return tuple(said)


def clock(utc: object) -> str:
    """Return a time of day of a record to the second."""
    return f"{str(utc)[:19].replace('T', ' ')} UTC"
