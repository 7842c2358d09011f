"""The whole report of a run, for its customer: persons, device, equipment, method and results.

It is made of nothing but the run and its record, so the same record gives the same report.
"""

from __future__ import annotations

import hashlib
import shlex
from itertools import chain
from typing import TYPE_CHECKING, Any, Final

import msgspec

from vcfbench.archive.front_page import BLANK, checked, front_page
from vcfbench.archive.stored import STORED_SETTINGS
from vcfbench.errors import ConfigError
from vcfbench.records.plain import plain
from vcfbench.reports.document import Axis, Column, Figure, Heading, Report, Series, Table, Text
from vcfbench.reports.generic import results_table
from vcfbench.reports.names import in_words
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

_RESIDUALS: Final = "Residuals of"
"""Beginning of the title of a figure that stands on the first page."""
_LONG: Final = 50
"""A window of so many readings is drawn reading by reading."""


def full_report(run: Run, words: Mapping[str, str] | None = None, title: str = "") -> Report:
    """Return the whole report of `run`: its first page, and sections that headings of level 2 begin.

    Args:
        run: any run.
        words: what no measurement tells, by the fields of `CertificateWords`; blank lines stand for the rest.
        title: that of the first page; none for the usual one.

    Raises:
        ConfigError: the record cannot be read any more, or a word is none of a certificate.
    """
    header = run.header
    found = [part for part in run.report().parts if not (isinstance(part, Table) and part.title == STORED_SETTINGS)]
    figures = [part for part in found if isinstance(part, Figure)]
    first = next((each for each in figures if each.title.startswith(_RESIDUALS)), figures[0] if figures else None)
    return Report(
        [
            *front_page(run, title or title_of(run), words, first),
            *_method(run),
            *_conditions(run, header),
            *_equipment(run),
            *_results(run, [part for part in found if part is not first], first),
            *_remarks(run),
            *_settings(header),
            *_record(run),
            *_provenance(run, header),
        ]
    )


def title_of(run: Run) -> str:
    """Return the title of the report of `run`."""
    device = "" if run.metadata.dut is None else f" of {run.metadata.dut}"
    return f"Calibration report: {run.procedure}{device}"


def _pairs(rows: Sequence[tuple[str, Any]], *, verbatim: bool = False) -> Table:
    """Lay out names beside values; unknown values are left out."""
    known = [(name, str(value)) for name, value in rows if value is not None]
    return Table([Column("", align="left"), Column("", align="left", verbatim=verbatim)], known)


def _record(run: Run) -> Iterator[Part]:
    yield Heading("Record", 2)
    last = run.amendments[-1] if run.amendments else None
    rows = [
        ("run", run.name or "not recorded"),
        ("status", run.status.value),
        ("revision", "1" if last is None else f"{last.revision}, of {_clock(last.utc)}: amended since the run"),
        ("checked by", checked(run)),
        *((f"tag {key}", value) for key, value in run.metadata.tags.items()),
    ]
    yield _pairs(rows, verbatim=True)
    if run.metadata.note is not None:
        yield Text(f"Note: {run.metadata.note}", verbatim=True)
    if run.amendments:
        columns = [Column(name, align="left", verbatim=True) for name in _AMENDED]
        rows_of = [_amended_rows(each) for each in run.amendments]
        yield Table(columns, [row for rows in rows_of for row in rows], "Amended since the run")


_AMENDED: Final = ("revision", "field", "was", "is", "by", "on", "reason")


def _amended_rows(each: Amendment) -> list[tuple[str | None, ...]]:
    said = (each.by, each.utc[:10], each.reason)
    return [(str(each.revision), change.field, change.was, change.now, *said) for change in each.changes]


def _conditions(run: Run, header: Mapping[str, Any]) -> Iterator[Part]:
    yield Heading("Conditions", 2)
    bench, settings = header.get("bench", {}), header.get("settings", {})
    latitude = bench.get("site", {}).get("latitude_deg")
    took_s = run.bench_seconds
    rows = [
        ("began", _clock(header.get("utc"))),
        ("took", None if took_s is None else f"{took_s:.0f} s ({took_s / 3600.0:.2f} h) of bench time"),
        ("bench", run.bench),
        ("station", bench.get("title") or None),
        ("latitude", _with_unit(latitude, "deg")),
        ("temperature of the room", _with_unit(run.metadata.ambient_temperature_c, "degC") or BLANK),
        ("relative humidity", _with_unit(run.metadata.humidity_percent, "%") or BLANK),
        ("wait after power-on", _with_unit(settings.get("warm_up_s"), "s")),
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


def _results(run: Run, found: Sequence[Part], first: Figure | None) -> Iterator[Part]:
    yield Heading("Results", 2)
    yield from _numbers(first)
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


def _numbers(figure: Figure | None) -> Iterator[Table]:
    """Yield the numbers of the figure of residuals: each point with its uncertainty, a table for each line."""
    if figure is None or not figure.title.startswith(_RESIDUALS):
        return
    columns = (Column(figure.x.label, figure.x.unit, "g"), Column("residual", figure.y.unit, ".0f"))
    for each in figure.series:
        u = [None] * len(each.y) if each.u_y is None else [2.0 * u for u in each.u_y]
        rows = list(zip(each.x, each.y, u, strict=True))
        yield Table((*columns, Column("U = 2 u", figure.y.unit, ".2g")), rows, f"{figure.title}: {each.label}")


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
    settings = {key: value for key, value in header.get("settings", {}).items() if key not in {"station", "dut"}}
    if not settings:
        return
    rows = []
    for table in results_table(settings, shown=None):
        for key, value, *_ in table.rows:
            words, unit = in_words(str(key))
            rows.append((words, value, unit, key))
    yield Heading("Settings", 2)
    columns = (Column("setting", align="left"), Column("", align="left"), Column("unit", align="left"))
    yield Table((*columns, Column("key", align="left", verbatim=True)), rows)


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
