"""Calibrations under each other: those of a batch, with yield and spread, and those of one gyroscope, with drift."""

import math
from collections.abc import Container, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from statistics import mean, stdev
from types import MappingProxyType
from typing import Any, Final

from msgspec import Struct, structs

from vcfbench.archive.compared import difference
from vcfbench.archive.recorded import load_run
from vcfbench.archive.summary import RunSummary, run_summaries
from vcfbench.archive.value_columns import SLOPES, ValueColumn, columns_of
from vcfbench.archive.written import write_document
from vcfbench.errors import ConfigError
from vcfbench.extras import need
from vcfbench.files import failing_as, shown
from vcfbench.records.schema import Status
from vcfbench.reports.document import Column, Heading, Notice, Part, Report, Table, Text, heads
from vcfbench.values.kinds import limit_words
from vcfbench.values.printing import shorthand
from vcfbench.values.value import Value

_DRIFT: Final = "drift of the scale factor since the device's last complete run of the procedure in ppm, ± 2 u"
_LAST: Final = heads("drift (E_n) | verdict")


class SheetRow(Struct, frozen=True, kw_only=True):
    """One run of a device on the sheet.

    `verdict` is that on the acceptance limits, None where nothing was judged; `limits` are these in words, `not_kept`
    those that the device did not keep, or is too near to. `missing` is what U95 of a value or the guard band of a limit
    is incomplete without. `drift_ppm` is the change of the scale factor since the last complete run of the same device
    and procedure (on a batch sheet, outside of the batch), on real benches or on simulated ones as it is itself,
    `u_drift_ppm` its standard uncertainty, `e_n` its normalised error. `why_none` says why there are no results; `run`
    is empty of a device that has no record.
    """

    device: str
    procedure: str
    run: str
    started: datetime
    operator: str | None
    simulated: bool
    status: Status
    verdict: str | None
    limits: tuple[str, ...] = ()
    not_kept: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    values: tuple[Value, ...] = ()
    """What the run states, without the parts of its uncertainties."""
    drift_ppm: float | None = None
    u_drift_ppm: float | None = None
    e_n: float | None = None
    why_none: str | None = None

    @property
    def scale_factor(self) -> Value | None:
        """Its scale factor: that on the table, else that of small signals, else that by V_Vc."""
        return next((each for each in self.values if each.kind in SLOPES), None)

    @property
    def passed(self) -> bool:
        """Tell whether the run is complete and kept every limit, those with a guard band too."""
        return self.status is Status.COMPLETE and self.verdict in {None, "pass"}

    @property
    def waits(self) -> bool:
        """Tell whether nobody has tried to measure the device yet."""
        return not (self.run or self.why_none)


def sheet_rows(batch: str, runs: str | Path = "runs", left_out: Container[str] | None = None) -> tuple[SheetRow, ...]:
    """Return the last run of each device and procedure with the tag ``batch=BATCH``, complete ones first.

    Args:
        batch: name of the batch.
        runs: directory of the records.
        left_out: names of the records that do not count; None: those of simulated benches, where there are real ones.
    """
    left_out = rehearsals(batch, runs) if left_out is None else left_out
    known = run_summaries(runs)
    inside = [each for each in known if each.tags.get("batch") == batch and each.run not in left_out]
    outside = [each for each in known if each.tags.get("batch") != batch]
    return tuple(_row(each, _before(each, outside)) for each in last_runs(inside).values())


def last_runs(found: Sequence[RunSummary]) -> dict[tuple[str, str], RunSummary]:
    """Return the last of the records, oldest first, by device and procedure; complete ones go before others."""
    chosen: dict[tuple[str, str], RunSummary] = {}
    for each in found:
        key = (str(each.dut), str(each.procedure))
        if key not in chosen or each.status is Status.COMPLETE or chosen[key].status is not Status.COMPLETE:
            chosen[key] = each
    return {key: each for key, each in chosen.items() if each.dut and each.procedure}


def rehearsals(batch: str, runs: str | Path = "runs") -> dict[str, str]:
    """Return by name, with the reason, the simulated records of a batch that has real ones too."""
    known = run_summaries(runs, tags={"batch": batch})
    if all(each.simulated for each in known):
        return {}
    return {each.run: f"{each.dut}, {each.procedure}: on a simulated bench" for each in known if each.simulated}


def device_rows(serial: str, runs: str | Path = "runs") -> tuple[SheetRow, ...]:
    """Return the complete runs of a device that gave a scale factor, oldest first.

    Args:
        serial: serial number of the device.
        runs: directory of the records.
    """
    known = run_summaries(runs, dut=serial, status=Status.COMPLETE)
    rows = (_row(each, _before(each, known)) for each in known)
    return tuple(each for each in rows if each.scale_factor is not None)


def _before(run: RunSummary, known: Sequence[RunSummary]) -> RunSummary | None:
    """Return the last complete run before it of the same device and procedure, real or simulated as it is."""
    same = (
        each
        for each in known
        if (each.dut, each.procedure, each.simulated) == (run.dut, run.procedure, run.simulated)
        and each.status is Status.COMPLETE
        and each.started < run.started
    )
    return max(same, key=lambda each: each.started, default=None)


def _row(summary: RunSummary, before: RunSummary | None) -> SheetRow:
    run = load_run(str(summary.directory))
    values = run.values
    scale = next((each for each in values.values() if each.kind in SLOPES), None)
    found: dict[str, Any] = {}
    earlier = None if before is None else load_run(str(before.directory))
    if earlier is not None and scale is not None:
        then = earlier.values.get(scale.name)
        if then is not None and then.kind == scale.kind and then.value and scale.value:
            drift = difference(then, scale)
            found |= {"drift_ppm": 1e6 * drift.value / then.value, "e_n": drift.e_n}
            found["u_drift_ppm"] = None if drift.u is None else 1e6 * drift.u / abs(then.value)
    judged = [] if run.verdict is None else [each for each in run.verdict.limits if each.measured]
    limits = [(limit_words(each.key), each) for each in judged]
    shown = [column.example.missing for column in columns_of([list(values.values())])]
    lacks = [*shown, *(each.missing for each in judged)]
    return SheetRow(
        device=str(summary.dut),
        procedure=str(summary.procedure),
        run=summary.run,
        started=summary.started,
        operator=summary.operator,
        simulated=bool(run.simulated),
        status=summary.status,
        verdict=summary.verdict,
        limits=tuple(
            f"{of.words} {of.factor * each.low:g} to {of.factor * each.high:g} {of.unit}".strip() for of, each in limits
        ),
        not_kept=tuple(f"{of.words}: {each.word}" for of, each in limits if each.word != "pass"),
        missing=tuple(dict.fromkeys(name for each in lacks for name in each)),
        values=tuple(structs.replace(each, parts=()) for each in values.values()),
        why_none=None if values else str(run.error or run.no_results),
        **found,
    )


def batch_sheet(batch: str, rows: Sequence[SheetRow], left_out: Mapping[str, str] = MappingProxyType({})) -> Report:
    """Return the sheet of a batch; errors of runs without results, and what is still to be measured, stand below.

    A device is good if it has passed every procedure that stands on the sheet. `left_out` are records that do not
    count, by name with the reason.
    """
    asked = {each.procedure for each in rows}
    unmeasured = [each for each in rows if each.waits]
    rows = [each for each in rows if not each.waits]
    said_left_out = "\n".join(f"Left out: {run}, {why}." for run, why in left_out.items())
    beside = [Text(said_left_out, verbatim=True)] if left_out else []
    if not rows:
        return Report([Heading(f"Batch {batch}"), Text("No device has been measured yet."), *beside])
    days = sorted({f"{each.started:%Y-%m-%d}" for each in rows})
    operators = ", ".join(sorted({each.operator for each in rows if each.operator})) or "not stated"
    simulated = any(each.simulated for each in rows)
    devices = sorted({each.device for each in rows})
    passed = {(each.device, each.procedure) for each in rows if each.passed}
    bad = [device for device in devices if any((device, procedure) not in passed for procedure in asked)]
    waiting = dict.fromkeys(
        f"{each.device} ({each.procedure})" if each.device in devices else each.device for each in unmeasured
    )
    good = len(devices) - len(bad)
    said = f"Yield: {good} of {len(devices)} devices ({100.0 * good / len(devices):.0f} %)"
    parts: list[Part] = [
        Heading(f"Batch {batch}"),
        Text(f"Measured {' to '.join(dict.fromkeys((days[0], days[-1])))} (UTC); operator: {operators}."),
        *([Notice("Measured on a simulated bench: no device stands behind these numbers.")] if simulated else []),
        Notice(f"{said}; not good: {', '.join(bad)}." if bad else f"{said}.", "fail" if bad else "pass"),
        *([Text(f"Not measured yet: {', '.join(waiting)}.")] if waiting else []),
        *beside,
    ]
    for name in dict.fromkeys(each.procedure for each in rows):
        of_procedure = [each for each in rows if each.procedure == name]
        own = columns_of([each.values for each in of_procedure])
        columns = [Column("device", align="left", verbatim=True), *_heads(own)]
        several = len({each.operator for each in of_procedure}) > 1
        if several:
            columns.append(Column("operator", align="left", verbatim=True))
        cells = [
            [each.device, *_cells(own, each), *([each.operator or "-"] if several else [])] for each in of_procedure
        ]
        parts += [Heading(name, 2), _said(own), Table(columns, cells), *_footnote(of_procedure)]
        if limits := dict.fromkeys(limit for each in of_procedure for limit in each.limits):
            not_kept = [f"{each.device} ({', '.join(each.not_kept)})" for each in of_procedure if each.not_kept]
            parts.append(
                Text("\n".join([f"Limits: {'; '.join(limits)}.", *(f"Not kept: {each}." for each in not_kept)]))
            )
        found = (each.scale_factor for each in of_procedure)
        scales = [1e3 * each.value for each in found if each is not None and each.value is not None]
        if len(scales) > 1:
            middle, spread = mean(scales), stdev(scales)
            relative = f" ({1e6 * spread / abs(middle):.3g} ppm)" if middle else ""
            stated = shorthand(middle, spread / math.sqrt(len(scales)))
            of_all = f"mean {stated} mV/(deg/s), standard deviation {spread:.2g} mV/(deg/s){relative}"
            parts.append(Text(f"Scale factor of {len(scales)} devices: {of_all}."))
    failed = [
        f"{each.device}, {f'{each.procedure}: ' if each.run else ''}{each.why_none}" for each in rows if each.why_none
    ]
    if failed:
        parts += [Heading("Without results", 2), Text("\n".join(failed), verbatim=True)]
    return Report(parts)


def device_parts(rows: Sequence[SheetRow]) -> list[Part]:
    """Return the runs of one device, a row each, in a table for each kind of scale factor."""
    mixed = len({each.simulated for each in rows}) > 1
    parts: list[Part] = [Heading("Runs with this device", 2)]
    for kind in dict.fromkeys(each.scale_factor.kind for each in rows if each.scale_factor is not None):
        of_kind = [each for each in rows if each.scale_factor is not None and each.scale_factor.kind == kind]
        own = columns_of([each.values for each in of_kind])
        names = (f"{each.procedure}{' (simulated)' * (mixed and each.simulated)}" for each in of_kind)
        both = zip(of_kind, names, strict=True)
        cells = [[f"{each.started:%Y-%m-%d}", name, *_cells(own, each)] for each, name in both]
        parts += [_said(own), Table([*heads("day (UTC) | <procedure"), *_heads(own)], cells)]
    return [*parts, *_footnote(rows)]


def _said(columns: Sequence[ValueColumn]) -> Text:
    """Say what the columns are of, and in which units."""
    words = "; ".join([*(column.said for column in columns), _DRIFT])
    return Text(f"{words[:1].upper()}{words[1:]}.")


def _heads(columns: Sequence[ValueColumn]) -> list[Column]:
    return [*(head for column in columns for head in column.heads), *_LAST]


def _cells(columns: Sequence[ValueColumn], row: SheetRow) -> list[Any]:
    drift = "-" if row.drift_ppm is None else f"{row.drift_ppm:+.0f}" if round(row.drift_ppm) else "0"
    drift += "" if row.u_drift_ppm is None else f"±{2.0 * row.u_drift_ppm:.0f}"
    mark = "*" * bool(row.missing)
    unjudged = "no record" if not row.run else "-" if row.status is Status.COMPLETE else row.status.value
    return [
        *(cell for column in columns for cell in column.cells(row.values, mark)),
        drift if row.e_n is None else f"{drift} ({row.e_n:.2f})",
        row.verdict.upper() + mark if row.verdict else unjudged,
    ]


def _footnote(rows: Sequence[SheetRow]) -> list[Part]:
    """Say what the U95 that are marked, and of verdicts that are, are incomplete without."""
    missing = dict.fromkeys(name for each in rows for name in each.missing)
    return [Text(f"* U95 is incomplete: without {', '.join(missing)}.")] if missing else []


def write_sheet(
    batch: str, rows: Sequence[SheetRow], path: Path, left_out: Mapping[str, str] = MappingProxyType({})
) -> tuple[Path, ...]:
    """Write the sheet of a batch: ``.html``, ``.pdf``, ``.md``, or ``.xlsx`` with full precision.

    Raises:
        ConfigError: the suffix is none of these, a library is missing, or the file cannot be written.
    """
    if path.suffix.lower() != ".xlsx":
        return write_document(batch_sheet(batch, rows, left_out), f"Batch {batch}", batch, path)
    book = need("openpyxl", "export", "a batch sheet as a spreadsheet").Workbook()
    book.active.title = "batch"
    columns = list({(each.key, each.unit): each for row in rows for each in map(ValueColumn.of, row.values)}.values())
    names = [name for name in SheetRow.__struct_fields__ if name != "values"]
    heads_of = [f"{each.key} / {each.unit}" if each.unit else each.key for each in columns]
    book.active.append([*names, *(head for of in heads_of for head in (of, f"U95, {of}", f"stated, {of}"))])
    for each in rows:
        values = {**structs.asdict(each), "started": each.started.isoformat(), "status": each.status.value}
        values |= {name: "; ".join(values[name]) for name in ("limits", "not_kept", "missing")}
        own = [column.value(each.values) for column in columns]
        stated = [(None,) * 3 if of is None else (of.value, of.u95, of.figure()) for of in own]
        book.active.append([*(values[name] for name in names), *(cell for three in stated for cell in three)])
        for cell in book.active[book.active.max_row]:
            cell.data_type = "s" if isinstance(cell.value, str) else cell.data_type  # a text is no formula
    with failing_as(ConfigError, f"{shown(path)}: cannot be written"):
        book.save(path)
    return (path,)
