"""The whole report of a run, for its customer: persons, device, equipment, method and results.

It is made of nothing but the run and its record, so the same record gives the same report.
"""

from __future__ import annotations

import hashlib
import shlex
from itertools import chain
from typing import TYPE_CHECKING, Any, Final

import msgspec

from vcfbench.archive.stored import STORED_SETTINGS
from vcfbench.errors import ConfigError
from vcfbench.records.amendments import check_of
from vcfbench.records.plain import plain
from vcfbench.records.schema import Status
from vcfbench.reports.document import Axis, Column, Figure, Heading, Notice, Report, Series, Table, Text
from vcfbench.reports.generic import results_table
from vcfbench.reports.thinning import DRAWN, thinned
from vcfbench.version import installed_version

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    import numpy as np
    from numpy.typing import NDArray

    from vcfbench.archive.run import Run
    from vcfbench.records.amendments import Amendment
    from vcfbench.records.metadata import Equipment
    from vcfbench.reports.document import Part
    from vcfbench.steps.measured import WindowReadings

_LONG: Final = 50
"""A window of so many readings is drawn reading by reading."""


def full_report(run: Run) -> Report:
    """Return the whole report of `run`; headings of level 2 begin its sections.

    Raises:
        ConfigError: the record cannot be read any more.
    """
    header = run.header
    return Report(
        [
            Heading(title_of(run)),
            *_notices(run),
            *_identification(run, header),
            *_conditions(run, header),
            *_equipment(run),
            *_method(run),
            *_results(run),
            *_remarks(run),
            *_settings(header),
            *_provenance(run, header),
        ]
    )


def title_of(run: Run) -> str:
    """Return the title of the report of `run`."""
    device = "" if run.metadata.dut is None else f" of {run.metadata.dut}"
    return f"Calibration report: {run.procedure}{device}"


def _notices(run: Run) -> Iterator[Notice]:
    """Yield the notices that nobody must overlook: a simulation, a run that is not whole, the verdict."""
    if run.simulated:
        seed = "" if run.seed is None else f" (seed {run.seed})"
        yield Notice(f"SIMULATED: instruments and gyroscope were simulated{seed}. Nothing here was measured.")
    if run.status is not Status.COMPLETE:
        why = "" if run.error is None else f": {run.error}"
        yield Notice(f"This run is not complete, its record is {run.status.value}{why}", "fail")
    for each in run.equipment:
        if each.overdue:
            yield Notice(f"OVERDUE: the calibration of {each.role} ({each.model}) was due {each.calibration_due}.")
    if run.verdict is not None:
        word = run.verdict.word
        yield Notice(f"Verdict: {word.upper()}", word)


def _pairs(rows: Sequence[tuple[str, Any]], *, verbatim: bool = False) -> Table:
    """Lay out names beside values; unknown values are left out."""
    known = [(name, str(value)) for name, value in rows if value is not None]
    return Table([Column("", align="left"), Column("", align="left", verbatim=verbatim)], known)


def _identification(run: Run, header: Mapping[str, Any]) -> Iterator[Part]:
    yield Heading("Identification", 2)
    metadata, laboratory = run.metadata, header.get("bench", {}).get("laboratory") or {}
    rows = [
        ("device under test", metadata.dut),
        ("run", run.name or "not recorded"),
        ("procedure", run.procedure),
        ("what it is", header.get("title")),
        ("status", run.status.value),
        ("revision", _revision(run)),
        ("checked by", _checked(run)),
        ("laboratory", ", ".join(filter(None, map(laboratory.get, ("name", "address", "email")))) or None),
        ("operator", metadata.operator),
        *((f"tag {key}", value) for key, value in metadata.tags.items()),
    ]
    yield _pairs(rows, verbatim=True)
    if metadata.note is not None:
        yield Text(f"Note: {metadata.note}", verbatim=True)
    if run.amendments:
        columns = [Column(name, align="left", verbatim=True) for name in _AMENDED]
        rows_of = [_amended_rows(each) for each in run.amendments]
        yield Table(columns, [row for rows in rows_of for row in rows], "Amended since the run")


_AMENDED: Final = ("revision", "field", "was", "is", "by", "on", "reason")


def _amended_rows(each: Amendment) -> list[tuple[str | None, ...]]:
    said = (each.by, each.utc[:10], each.reason)
    return [(str(each.revision), change.field, change.was, change.now, *said) for change in each.changes]


def _revision(run: Run) -> str:
    last = run.amendments[-1] if run.amendments else None
    return "1" if last is None else f"{last.revision}, of {_clock(last.utc)}: amended since the run"


def _checked(run: Run) -> str | None:
    """Name the person that checked the run; later amendments are unchecked."""
    check = check_of(run.amendments)
    if check is None:
        return None
    since = "" if check.revision == run.revision else f"; revision {run.revision} is not checked"
    return f"{check.by}, {_clock(check.utc)}, revision {check.revision}{since}"


def _conditions(run: Run, header: Mapping[str, Any]) -> Iterator[Part]:
    yield Heading("Conditions", 2)
    bench, settings = header.get("bench", {}), header.get("settings", {})
    latitude = bench.get("site", {}).get("latitude_deg")
    warm_up_s = settings.get("warm_up_s")
    took_s = run.bench_seconds
    rows = [
        ("began", _clock(header.get("utc"))),
        ("took", None if took_s is None else f"{took_s:.0f} s ({took_s / 3600.0:.2f} h) of bench time"),
        ("bench", run.bench),
        ("station", bench.get("title") or None),
        ("latitude", _with_unit(latitude, "deg")),
        ("temperature of the room", _with_unit(run.metadata.ambient_temperature_c, "degC")),
        ("relative humidity", _with_unit(run.metadata.humidity_percent, "%")),
        ("wait after power-on", _with_unit(warm_up_s, "s")),
    ]
    yield _pairs(rows)


def _clock(utc: object) -> str | None:
    """Return a time of day of a record to the second."""
    return None if utc is None else f"{str(utc)[:19].replace('T', ' ')} UTC"


def _with_unit(value: float | None, unit: str) -> str | None:
    return None if value is None else f"{value:g} {unit}"


def _equipment(run: Run) -> Iterator[Part]:
    if not run.equipment:
        return
    yield Heading("Equipment", 2)
    names = ("role", "instrument", "serial number", "calibrated", "due", "certificate")
    yield Table([Column(name, align="left") for name in names], list(map(_instrument, run.equipment)))


def _instrument(each: Equipment) -> tuple[str | None, ...]:
    due = None if each.calibration_due is None else str(each.calibration_due)
    who = each.identity
    return (
        each.role.replace("_", " "),
        each.model if who is None else f"{who.maker} {who.model}",
        ", ".join(filter(None, (each.serial_number, each.inventory_number))) or None,
        None if each.calibrated is None else str(each.calibrated),
        f"{due} OVERDUE" if each.overdue else due,
        each.certificate,
    )


def _method(run: Run) -> Iterator[Part]:
    yield Heading("Method", 2)
    yield Text(method_of(run))


def method_of(run: Run) -> str:
    """Return the method in words, from the record, else from the procedure that is known here, else the title."""
    header = run.header
    method = header.get("method") or _method_known(run.procedure) or header.get("title")
    return str(method or f"The procedure {run.procedure}, of which the record says no more.")


def _method_known(name: str) -> str:
    """Return the method of the procedure, for records of before they said so."""
    from vcfbench.procedures.catalogue import PROCEDURES  # noqa: PLC0415

    try:
        return PROCEDURES[name].method if name in PROCEDURES else ""
    except ConfigError:  # its package cannot be loaded; the title says something
        return ""


def _results(run: Run) -> Iterator[Part]:
    yield Heading("Results", 2)
    found = [
        part for part in run.report().parts if not (isinstance(part, Table) and part.title == STORED_SETTINGS)
    ]  # they have a section of their own
    *parts, last = found or (Text("nothing"),)
    verdict = [last] if run.verdict is not None else []
    yield from parts if verdict else [*parts, last]
    if run.no_results is not None:
        stored = "no results" if run.results is None else "results as they were stored with the run"
        yield Text(f"{stored}: {run.no_results}")
    windows = [each for each in run.measured.readings.windows if len(each.t_s) >= _LONG]
    if windows:
        t_s, output_v = _joined(windows)
        few = thinned(t_s - t_s[0], output_v)  # here already: a million numbers as a series take a quarter of a second
        x, y = ((t_s - t_s[0]).tolist(), output_v.tolist()) if few is None else few
        said = "" if few is None else f"{len(t_s)} readings; {DRAWN}"
        series = Series("readings", x, y, kind="line")
        yield Figure("Record of the raw readings", Axis("time", "s"), Axis("output", "V"), [series], said)
    if verdict:
        yield Heading("Verdict", 2)
        yield from verdict


def _joined(windows: Sequence[WindowReadings]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times and voltages of all windows, one after the other."""
    import numpy as np  # noqa: PLC0415  # few runs have long windows

    return np.concatenate([each.t_s for each in windows]), np.concatenate([each.voltage_v for each in windows])


def _remarks(run: Run) -> Iterator[Part]:
    asked = [f"asked again: {each}" for each in run.asked_again]
    lost = [f"observer left out: {each}" for each in run.observers_lost]
    if asked or lost:
        yield Heading("Remarks", 2)
        yield from (Text(each) for each in chain(asked, lost))


def _settings(header: Mapping[str, Any]) -> Iterator[Part]:
    settings = {key: value for key, value in header.get("settings", {}).items() if key != "station"}
    tables = results_table(settings, head="setting")
    if tables:
        yield Heading("Settings", 2)
        yield from tables


def _provenance(run: Run, header: Mapping[str, Any]) -> Iterator[Part]:
    yield Heading("Provenance", 2)
    versions = ", ".join(f"{name} {version}" for name, version in header.get("versions", {}).items())
    own = header.get("procedure_file")
    rows = [
        ("measured with", versions or None),
        ("report made with", f"vcfbench {installed_version()}"),
        ("command", command_of(header)),
        ("bench simulated", None if run.simulated is None else "yes" if run.simulated else "no"),
        ("seed of its noise", run.seed),
        ("bench file", _sha256_of_bench(header)),
        ("procedure's file", f"{own['path']}, SHA-256 {own['sha256']}" if isinstance(own, dict) else None),
        ("record", None if run.directory is None else f"journal.jsonl, SHA-256 {_sha256(run)}"),
    ]
    yield _pairs(rows, verbatim=True)
    if run.equipment:
        columns = [Column(name, align="left", verbatim=True) for name in ("role", "resource", "firmware")]
        answered = [(e.role, e.resource, None if e.identity is None else e.identity.firmware) for e in run.equipment]
        yield Table(columns, answered, "Where the instruments answered")


def command_of(header: Mapping[str, Any]) -> str | None:
    """Return the command that made the record, as it would be typed; defaults are left out."""
    options = header.get("options")
    if not isinstance(options, dict):
        return None
    words = ["vcfbench", "run", str(header.get("procedure"))]
    for key, value in options.items():
        name = f"--{key.replace('_', '-')}"
        if key == "settings" and isinstance(value, dict):
            words += chain.from_iterable(("--set", f"{each}={setting}") for each, setting in value.items())
        elif key == "metadata" and isinstance(value, dict):
            words += _metadata_words(value)
        elif value is True:
            words.append(name)
        elif value not in (None, False, (), [], {}):
            words += [name, str(value)]
    return shlex.join(words)


def _metadata_words(metadata: Mapping[str, Any]) -> Iterator[str]:
    for key, value in metadata.items():
        if isinstance(value, dict):
            yield from chain.from_iterable(("--tag", f"{tag}={words}") for tag, words in value.items())
        else:
            yield from (f"--{key.replace('_', '-')}", str(value))


def _sha256_of_bench(header: Mapping[str, Any]) -> str | None:
    """Return the SHA-256 of the bench's values with their defaults, as the record has them: keys sorted, no spaces."""
    if not header.get("bench"):
        return None
    path = header.get("options", {}).get("bench")
    digest = hashlib.sha256(msgspec.json.encode(plain(header["bench"]), order="sorted")).hexdigest()
    return f"{path or 'the one that comes along'}, its values SHA-256 {digest}"


def _sha256(run: Run) -> str:
    assert run.directory is not None  # noqa: S101  # asked before
    with (run.directory / "journal.jsonl").open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
