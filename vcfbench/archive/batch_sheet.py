"""Calibrations under each other: those of a batch, with yield and spread, and those of one gyroscope, with drift."""

from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from functools import partial
from io import BytesIO
from pathlib import Path
from statistics import mean, stdev
from types import MappingProxyType
from typing import Any, Final

from msgspec import Struct, field, structs

from vcfbench.archive.change import Coefficients, Compared, Difference, Pair
from vcfbench.archive.keeping import not_withdrawn
from vcfbench.archive.recorded import load_run
from vcfbench.archive.run import Run
from vcfbench.archive.summary import RunSummary, run_summaries
from vcfbench.archive.value_columns import SLOPES, ValueColumn, columns_of, of_one_definition
from vcfbench.archive.written import write_document
from vcfbench.extras import need
from vcfbench.files import replaced
from vcfbench.records.schema import Status
from vcfbench.reports.document import Column, Heading, Notice, Part, Report, Table, Text, heads
from vcfbench.station.acceptance import Acceptance
from vcfbench.values.definition import Conditions
from vcfbench.values.printing import shorthand
from vcfbench.values.value import Value

_DRIFT: Final = "drift of the scale factor since the device's last complete run of the procedure in ppm, ± U95"


class SheetRow(Struct, frozen=True, kw_only=True):
    """One run of a device on the sheet.

    `verdict` is that on the acceptance limits, None where nothing was judged; `limits` are these in words, `not_kept`
    those that the device did not keep, or is too near to. `missing` is what U95 of a value or the guard band of a limit
    is incomplete without. `drift_ppm` is the change of the scale factor since the last complete run of the same device
    and procedure (on a batch sheet, outside of the batch), on real benches or on simulated ones as it is itself,
    `u_drift_ppm` its standard uncertainty, `u95_drift_ppm` the expanded one, `e_n` its normalised error; `drift_note`
    says how it was found where the two were not subtracted, or why there is none. `since_first_ppm` is the change since
    the device's first run with a scale factor of this kind, None where it cannot be stated. `why_none` says why there
    are no results; `run` is empty of a device that has no record.
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
    u95_drift_ppm: float | None = None
    e_n: float | None = None
    drift_note: str = ""
    since_first_ppm: float | None = None
    why_none: str | None = None
    copies: tuple[str, ...] = ()
    """Other directories with the same record, which counts once."""

    @property
    def scale_factor(self) -> Value | None:
        """Its scale factor: that on the table, else that of small signals, else that by V_Vc."""
        return _slope(self.values)

    @property
    def passed(self) -> bool:
        """Return True if the run is complete and kept every limit, those with a guard band too."""
        return self.status is Status.COMPLETE and self.verdict in {None, "pass"}

    @property
    def waits(self) -> bool:
        """Return True before the first attempt to measure the device."""
        return not (self.run or self.why_none)


def sheet_rows(
    batch: str,
    runs: str | Path = "runs",
    left_out: Container[str] | None = None,
    devices: str | Path = "devices",
) -> tuple[SheetRow, ...]:
    """Return the last run of each device and procedure with the tag ``batch=BATCH``, complete ones first.

    Args:
        batch: name of the batch.
        runs: directory of the records.
        left_out: names of the records that do not count; None: those of simulated benches, where there are real ones.
        devices: directory of the device history.
    """
    left_out = rehearsals(batch, runs) if left_out is None else left_out
    known = run_summaries(runs)
    inside = [each for each in known if each.tags.get("batch") == batch and each.run not in left_out]
    serials = {each.dut for each in inside}
    outside = [each for each in known if each.dut in serials and each.tags.get("batch") != batch]
    history = _History(not_withdrawn(outside, devices), devices)
    return tuple(history.row(each) for each in last_runs(inside).values())


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


def device_rows(serial: str, runs: str | Path = "runs", devices: str | Path = "devices") -> tuple[SheetRow, ...]:
    """Return the complete runs of a device that gave a scale factor, oldest first, and whose entry still counts.

    Args:
        serial: serial number of the device.
        runs: directory of the records.
        devices: directory of the device history.
    """
    known = not_withdrawn(run_summaries(runs, dut=serial, status=Status.COMPLETE), devices)
    history = _History(known, devices)
    rows = (history.row(each) for each in known if _may_have_slope(each))
    return tuple(each for each in rows if each.scale_factor is not None)


class _History(Struct, frozen=True):
    """The runs from which changes are counted; each is read once."""

    known: Sequence[RunSummary]
    devices: str | Path
    read: dict[Path, Compared] = field(default_factory=dict)

    def compared(self, summary: RunSummary) -> Compared:
        """Return a run in the form of a comparison."""
        if summary.directory not in self.read:
            self.read[summary.directory] = Compared(load_run(str(summary.directory)))
        return self.read[summary.directory]

    def earlier(self, run: RunSummary) -> list[RunSummary]:
        """Return the earlier runs of the same device with a scale factor, real or simulated like the run."""
        same = [
            each
            for each in self.known
            if (each.dut, each.simulated, each.status) == (run.dut, run.simulated, Status.COMPLETE)
            and each.started < run.started
            and _may_have_slope(each)
        ]
        return sorted(same, key=lambda each: each.started)

    def changes(self, summary: RunSummary, scale: Value) -> dict[str, Any]:
        """Return the notes of a row on the change of the scale factor since earlier runs."""
        earlier, now, found = self.earlier(summary), self.compared(summary), dict[str, Any]()
        witness = next((run for each in reversed(earlier) if (run := self.compared(each)).tells_curve), None)
        known = partial(Coefficients.kept, [now.run], self.devices)

        def since(before: Compared | None) -> Difference | None:
            then = None if before is None else _slope(before.run.values.values(), scale.kind)
            if before is None or then is None or not then.value:
                return None
            witnesses = [] if witness is None else [witness]
            change = Pair(before, now, known, witnesses).change(then, scale)
            ppm = 1e6 / then.value
            sized = [None if each is None else abs(ppm) * each for each in (change.u, change.u95)]
            value = None if change.value is None else ppm * change.value
            return structs.replace(change, value=value, u=sized[0], u95=sized[1])

        same = [self.compared(each) for each in reversed(earlier) if each.procedure == summary.procedure]
        slopes = [(each, slope) for each in same if (slope := _slope(each.run.values.values())) is not None]
        alike = [each for each, slope in slopes if slope.unit == scale.unit] or [each for each, _ in slopes]
        if (last := since(next(iter(alike), None))) is not None:
            found |= {"drift_ppm": last.value, "u_drift_ppm": last.u, "u95_drift_ppm": last.u95, "e_n": last.e_n}
            found["drift_note"] = last.reason or last.note
        of_first = (self.compared(each) for each in earlier)
        first = next(
            (run for run in of_first if (of := _slope(run.run.values.values(), scale.kind)) and of.unit == scale.unit),
            None,
        )
        change = since(first)
        return found | {"since_first_ppm": 0.0 if first is None else None if change is None else change.value}

    def row(self, summary: RunSummary) -> SheetRow:
        """Return the row of a run."""
        run = self.compared(summary).run
        values = run.values
        scale = _slope(values.values())
        return _row(summary, run, {} if scale is None else self.changes(summary, scale))


def _may_have_slope(summary: RunSummary) -> bool:
    """Return True if a run may have a scale factor: records of before list some of their values, without conditions."""
    values = summary.results.values()
    return _slope(values) is not None or all(each.conditions == Conditions() for each in values)


def _slope(values: Iterable[Value], *kinds: str) -> Value | None:
    """Return the first scale factor, of these kinds or any."""
    return next((each for each in values if each.kind in (kinds or SLOPES)), None)


def _row(summary: RunSummary, run: Run, found: Mapping[str, Any]) -> SheetRow:
    values = run.values
    verdict = run.verdict or Acceptance(())
    judged = [each for each in verdict.limits if each.measured]
    limits = [(verdict.named(each), each) for each in judged]
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
        copies=summary.copies,
        **found,
    )


def batch_sheet(batch: str, rows: Sequence[SheetRow], left_out: Mapping[str, str] = MappingProxyType({})) -> Report:
    """Return the sheet of a batch, with errors of runs without results, and the remaining runs, below.

    A device is good if it has passed every procedure on the sheet. `left_out` are records that do not
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
        notes = _letters(of_procedure)
        several = len({each.operator for each in of_procedure}) > 1
        operator = [Column("operator", align="left", verbatim=True)] * several
        groups = _of_one_definition(of_procedure)
        parts.append(Heading(name, 2))
        for of in groups:
            own = columns_of([each.values for each in of])
            cells = [[each.device, *_cells(own, each, notes), *[each.operator or "-"] * several] for each in of]
            columns = [Column("device", align="left", verbatim=True), *_heads(own), *operator]
            parts += [*([_said(own)] if own else []), Table(columns, cells)]
        parts += _footnotes(of_procedure, notes)
        if limits := dict.fromkeys(limit for each in of_procedure for limit in each.limits):
            not_kept = [f"{each.device} ({', '.join(each.not_kept)})" for each in of_procedure if each.not_kept]
            parts.append(
                Text("\n".join([f"Limits: {'; '.join(limits)}.", *(f"Not kept: {each}." for each in not_kept)]))
            )
        parts += [said for of in groups for said in _spread(of)]
    failed = [
        f"{each.device}, {f'{each.procedure}: ' if each.run else ''}{each.why_none}" for each in rows if each.why_none
    ]
    if failed:
        parts += [Heading("Without results", 2), Text("\n".join(failed), verbatim=True)]
    return Report(parts)


def _spread(rows: Sequence[SheetRow]) -> Iterator[Text]:
    """Yield mean and spread of the scale factors, where there are two at least.

    The u of the mean is that of errors that all have in common: table, meter and room are the same.
    """
    known = [each.scale_factor for each in rows if each.scale_factor is not None]
    scales = [value.named.factor * value.value for value in known if value.value is not None]
    if len(scales) < 2:
        return
    middle, spread, unit = mean(scales), stdev(scales), known[0].named.unit
    relative = f" ({1e6 * spread / abs(middle):.3g} ppm)" if middle else ""
    sizes = [abs(value.named.factor) * value.u for value in known if value.value is not None and value.u is not None]
    stated = shorthand(middle, mean(sizes) if len(sizes) == len(scales) else None)
    of_all = f"mean {stated} {unit} (errors as common to all), standard deviation {spread:.2g} {unit}{relative}"
    yield Text(f"Scale factor of {len(scales)} devices: {of_all}.")


def device_parts(rows: Sequence[SheetRow]) -> list[Part]:
    """Return the runs of one device, a row each, in a table for each kind and definition of scale factor."""
    mixed, notes = len({each.simulated for each in rows}) > 1, _letters(rows)
    parts: list[Part] = [Heading("Runs with this device", 2)]
    kinds = dict.fromkeys(each.scale_factor.kind for each in rows if each.scale_factor is not None)
    of_kinds = ([each for each in rows if each.scale_factor and each.scale_factor.kind == kind] for kind in kinds)
    for of in (of for of_kind in of_kinds for of in _of_one_definition(of_kind)):
        own = columns_of([each.values for each in of])
        names = (f"{each.procedure}{' (simulated)' * (mixed and each.simulated)}" for each in of)
        both = zip(of, names, strict=True)
        cells = [[f"{each.started:%Y-%m-%d}", name, *_cells(own, each, notes)] for each, name in both]
        parts += [_said(own), Table([*heads("day (UTC) | <procedure"), *_heads(own)], cells)]
    return [*parts, *_footnotes(rows, notes)]


def _of_one_definition(rows: Sequence[SheetRow]) -> list[list[SheetRow]]:
    """Return the rows whose columns hold values of one definition together."""
    return [[rows[place] for place in places] for places in of_one_definition([each.values for each in rows])]


def _said(columns: Sequence[ValueColumn]) -> Text:
    """Return the definition and units of the columns."""
    words = "; ".join([*(column.said for column in columns), *([_DRIFT] if _has_drift(columns) else [])])
    return Text(f"{words[:1].upper()}{words[1:]}.")


def _heads(columns: Sequence[ValueColumn]) -> list[Column]:
    own = (head for column in columns for head in column.heads)
    return [*own, *heads("drift (E_n) | verdict" if _has_drift(columns) else "verdict")]


def _has_drift(columns: Sequence[ValueColumn]) -> bool:
    return any(each.is_slope for each in columns)


def _cells(columns: Sequence[ValueColumn], row: SheetRow, notes: Mapping[str, str] = MappingProxyType({})) -> list[Any]:
    drift = "-" if row.drift_ppm is None else f"{row.drift_ppm:+.0f}" if round(row.drift_ppm) else "0"
    drift += "" if row.u95_drift_ppm is None else f"±{row.u95_drift_ppm:.0f}"
    drift += "" if row.e_n is None else f" ({row.e_n:.2f})"
    mark = "*" * bool(row.missing)
    unjudged = "no record" if not row.run else "-" if row.status is Status.COMPLETE else row.status.value
    return [
        *(cell for column in columns for cell in column.cells(row.values, mark)),
        *([f"{drift} {notes[row.drift_note]}" if row.drift_note else drift] if _has_drift(columns) else []),
        row.verdict.upper() + mark if row.verdict else unjudged,
    ]


def _letters(rows: Sequence[SheetRow]) -> dict[str, str]:
    """Return the letters of the footnotes on drifts."""
    said = dict.fromkeys(each.drift_note for each in rows if each.drift_note)
    return {note: _letter(place) for place, note in enumerate(said)}


def _letter(place: int) -> str:
    return (_letter(place // 26 - 1) if place >= 26 else "") + chr(ord("a") + place % 26)


def _footnotes(rows: Sequence[SheetRow], notes: Mapping[str, str]) -> list[Part]:
    """Say how drifts were found, and what the U95 that are marked, and of verdicts that are, are incomplete without."""
    missing = dict.fromkeys(name for each in rows for name in each.missing)
    said = [f"{letter}  {note}" for note, letter in notes.items()]
    said += [f"* U95 is incomplete: without {', '.join(missing)}."] if missing else []
    said += [f"{', '.join(each.copies)}: copies of {each.run}, which counts once." for each in rows if each.copies]
    return [Text("\n".join(said))] if said else []


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
    columns: list[ValueColumn] = []
    for value in (value for row in rows for value in row.values):
        columns += [] if any(each.holds(value) for each in columns) else [ValueColumn.of(value)]
    several = [[each.key, each.unit] for each in columns]
    names = [name for name in SheetRow.__struct_fields__ if name != "values"]
    heads_of = [
        (f"{each.key} / {each.unit}" if each.unit else each.key)
        + f", {each.example.definition.words}" * (several.count([each.key, each.unit]) > 1)
        for each in columns
    ]
    book.active.append([*names, *(head for of in heads_of for head in (of, f"U95, {of}", f"stated, {of}"))])
    for each in rows:
        values = {**structs.asdict(each), "started": each.started.isoformat(), "status": each.status.value}
        values |= {name: "; ".join(values[name]) for name in ("limits", "not_kept", "missing", "copies")}
        own = [column.value(each.values) for column in columns]
        stated = [(None,) * 3 if of is None else (of.value, of.u95, of.figure()) for of in own]
        book.active.append([*(values[name] for name in names), *(cell for three in stated for cell in three)])
        for cell in book.active[book.active.max_row]:
            cell.data_type = "s" if isinstance(cell.value, str) else cell.data_type  # a text is no formula
    book.save(data := BytesIO())
    with replaced(path) as draft:
        draft.write_bytes(data.getbuffer())
    return (path,)
