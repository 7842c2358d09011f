"""The whole report of a run, for its customer: persons, device, equipment, method and results.

It is made of nothing but the run and its record, so the same record gives the same report.
"""

import shlex
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from hashlib import file_digest, sha256
from itertools import chain
from typing import Any, Final

import msgspec
import numpy as np

from vcfbench.archive.front_page import BLANK, MOST, checked, front_page, values_table
from vcfbench.archive.output_unit import unit_of_record
from vcfbench.archive.results import STORED_SETTINGS
from vcfbench.archive.run import Run, clock
from vcfbench.archive.unseen import unseen_in_short, unseen_of, unseen_parts
from vcfbench.errors import ConfigError
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.records.metadata import Equipment
from vcfbench.records.plain import plain
from vcfbench.reports.document import Axis, Column, Figure, Heading, Part, Report, Series, Table, Text, facts, texts
from vcfbench.reports.generic import results_table
from vcfbench.reports.plot import DRAWN, thinned
from vcfbench.station.parts import absent_rail_keys
from vcfbench.station.writing import nested_tables, value_text
from vcfbench.values.kinds import in_words
from vcfbench.version import installed_version

_RESIDUALS: Final = "Residuals of"  # Beginning of the title of a figure on the first page
_OF_ROLES: Final = {
    "rate_source": ("generator_",),
    "oscilloscope": ("oscilloscope_", "exchanged_"),
    "multimeter": ("meter_", "output_ohm"),
    "v_vc_meter": ("v_vc_meter_",),
    "rate_table": ("table_",),
}
"""Beginnings of the keys of [uncertainty] that are for an instrument."""
_LONG: Final = 50  # A window of so many readings is drawn reading by reading


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
    left_unseen = unseen_of(run)
    remarks: list[Part] = [Text(f"query repeated: {each}") for each in run.asked_again]
    remarks += [Text(f"observer left out: {each}") for each in run.observers_lost]
    return Report(
        [
            *front_page(run, title or title_of(run), words, first, unseen_in_short(run, left_unseen)),
            *(Heading("Method", 2), Text(method_of(run))),
            *(Heading("Conditions", 2), _conditions(run, header)),
            *_equipment(run.equipment),
            *(Heading("Results", 2), *_results(run, [part for part in found if part is not first], first)),
            *([Heading("Undetected faults", 2), *not_seen] if (not_seen := unseen_parts(run, left_unseen)) else []),
            *([Heading("Remarks", 2), *remarks] if remarks else []),
            *_settings(header),
            *(Heading("Record", 2), *_record(run)),
            *(Heading("Provenance", 2), *_provenance(run, header)),
        ]
    )


def title_of(run: Run) -> str:
    """Return the title of the report of `run`."""
    device = "" if run.metadata.dut is None else f" of {run.metadata.dut}"
    return f"Calibration report: {run.procedure}{device}"


def _known(rows: Sequence[tuple[str, Any]]) -> list[tuple[str, str]]:
    """Return names and values that are known, as texts."""
    return [(name, str(value)) for name, value in rows if value is not None]


def _record(run: Run) -> Iterator[Part]:
    last = run.amendments[-1] if run.amendments else None
    rows = [
        ("run", run.name or "not recorded"),
        ("status", run.status.value),
        ("revision", "1" if last is None else f"{last.revision}, of {clock(last.utc)}: amended since the run"),
        ("checked by", checked(run)),
        *((f"tag {key}", value) for key, value in run.metadata.tags.items()),
    ]
    yield facts(_known(rows))
    if run.metadata.note is not None:
        yield Text(f"Note: {run.metadata.note}", verbatim=True)
    if run.amendments:
        names = texts("revision", "field", "was", "is", "by", "on (UTC)", "reason", verbatim=True)
        changes = [
            (str(each.revision), change.field, change.was, change.now, each.by, each.utc[:10], each.reason)
            for each in run.amendments
            for change in each.changes
        ]
        yield Table(names, changes, "Amended since the run")


def _conditions(run: Run, header: Mapping[str, Any]) -> Table:
    bench, settings = header.get("bench", {}), header.get("settings", {})
    took_s = run.bench_seconds
    waits = [settings[key] for key in ("warm_up_s", "powered_s") if settings.get(key) is not None]
    began = "after power-on" if bench.get("power") else "before the first reading"
    rows = [
        ("began", None if header.get("utc") is None else clock(header["utc"])),
        ("took", None if took_s is None else f"{took_s:.0f} s ({took_s / 3600.0:.2f} h) of bench time"),
        ("bench", run.bench),
        ("station", bench.get("title") or None),
        ("latitude", _with_unit(bench.get("site", {}).get("latitude_deg"), "deg")),
        ("temperature of the room", _with_unit(run.metadata.ambient_temperature_c, "degC") or BLANK),
        ("relative humidity", _with_unit(run.metadata.humidity_percent, "%") or BLANK),
        (f"wait {began}", _with_unit(max(waits, default=None), "s")),
    ]
    return Table(texts("", ""), _known(rows))


def _with_unit(value: float | None, unit: str) -> str | None:
    return None if value is None else f"{value:g} {unit}"


def _equipment(equipment: Sequence[Equipment]) -> Iterator[Part]:
    if not equipment:
        return
    rows = []
    for each in equipment:
        due, who = None if each.calibration_due is None else str(each.calibration_due), each.identity
        model = each.model if who is None else f"{who.maker} {who.model}"
        numbers = ", ".join(filter(None, (each.serial_number, each.inventory_number))) or None
        calibrated = None if each.calibrated is None else str(each.calibrated)
        due = f"{due} OVERDUE" if each.overdue else due
        rows.append((each.title, model, numbers, calibrated, due, each.certificate))
    yield Heading("Equipment", 2)
    yield Table(texts("role", "instrument", "serial number", "calibrated", "due", "certificate"), rows)


def method_of(run: Run) -> str:
    """Return the method in words, from the record, else from the procedure that is known here, else the title."""
    method, name = run.header.get("method"), run.procedure
    if not method:  # records of before do not say it
        with suppress(ConfigError):  # the procedure's package cannot be loaded; the title says something
            method = PROCEDURES[name].method if name in PROCEDURES else ""
    return str(method or run.header.get("title") or f"The procedure {name}, of which the record says no more.")


def _results(run: Run, found: Sequence[Part], first: Figure | None) -> Iterator[Part]:
    if first is not None and first.title.startswith(_RESIDUALS):
        # the numbers of the figure: each point with its uncertainty, a table for each line
        columns = (Column(first.x.label, first.x.unit, "g"), Column("residual", first.y.unit, ".0f"))
        for each in first.series:
            u = [None] * len(each.y) if each.u_y is None else [2.0 * u for u in each.u_y]
            rows = list(zip(each.x, each.y, u, strict=True))
            yield Table((*columns, Column("U = 2 u", first.y.unit, ".2g")), rows, f"{first.title}: {each.label}")
    if len(run.values) > MOST and (every := values_table(run)) is not None:
        yield every
    *parts, last = found or (Text("nothing"),)
    yield from parts if run.verdict is not None else [*parts, last]
    if run.no_results is not None:
        stored = "no results" if run.results is None else "results as they were stored with the run"
        yield Text(f"{stored}: {run.no_results}")
    windows = [each for each in run.measured.readings.windows if len(each.t_s) >= _LONG]
    if windows:
        t_s = np.concatenate([each.t_s for each in windows]) - windows[0].t_s[0]
        output_v = np.concatenate([each.voltage_v for each in windows])
        few = thinned(t_s, output_v)  # here already: a million numbers as a series take a quarter of a second
        x, y = (t_s.tolist(), output_v.tolist()) if few is None else few
        said = "" if few is None else f"{len(t_s)} readings; {DRAWN}"
        series = Series("readings", x, y, kind="line")
        axes = Axis("time", "s"), Axis("output", unit_of_record(run.header))
        yield Figure("Record of the raw readings", *axes, [series], said)
    if run.verdict is not None:
        yield Heading("Verdict", 2)
        yield last


def _settings(header: Mapping[str, Any]) -> Iterator[Part]:
    of_run = header.get("settings", {})
    supplied = "power" in of_run.get("station", {}).get("instruments", {"power": None})  # else no rail is there
    single = of_run.get("station", {}).get("rails", {}).get("negative") == "none"
    without = {"station", "dut", *absent_rail_keys(supplied=supplied, single=single)}
    settings = {key: value for key, value in of_run.items() if key not in without}
    rows = []
    for table in results_table(settings, shown=None):
        for key, value, *_ in table.rows:
            words, unit = in_words(str(key))
            rows.append((words, value, unit, key))
    if settings:
        yield Heading("Settings", 2)
        yield Table([*texts("setting", "", "unit"), *texts("key", verbatim=True)], rows)
    bench = header.get("bench") or {}
    absent = tuple(key for role, keys in _OF_ROLES.items() if not bench.get(role) for key in keys)
    given = {key: each for key, each in (bench.get("uncertainty") or {}).items() if each is not None}
    known = {key: each for key, each in given.items() if not key.startswith(absent)}
    for table in results_table(known, "Inputs of the uncertainties that are not assumed, [uncertainty]", shown=None):
        yield Table(texts("key", "value", verbatim=True), [row[:2] for row in table.rows], table.title)


def _provenance(run: Run, header: Mapping[str, Any]) -> Iterator[Part]:
    versions = ", ".join(f"{name} {version}" for name, version in header.get("versions", {}).items())
    own, bench, record = header.get("procedure_file"), None, None
    if header.get("bench"):  # its values with their defaults, as the record has them: keys sorted, no spaces
        digest = sha256(msgspec.json.encode(plain(header["bench"]), order="sorted")).hexdigest()
        path = header.get("options", {}).get("bench")
        bench = f"{path or 'the one that comes along'}, its values SHA-256 {digest}"
    if run.directory is not None:
        with (run.directory / "journal.jsonl").open("rb") as file:
            record = f"journal.jsonl, SHA-256 {file_digest(file, 'sha256').hexdigest()}"
    rows = [
        ("measured with", versions or None),
        ("report made with", f"vcfbench {installed_version()}"),
        ("command", command_of(header)),
        ("bench simulated", None if run.simulated is None else "yes" if run.simulated else "no"),
        ("seed of its noise", run.seed),
        ("bench file", bench),
        ("procedure's file", f"{own['path']}, SHA-256 {own['sha256']}" if isinstance(own, dict) else None),
        ("record", record),
    ]
    yield facts(_known(rows))
    if run.equipment:
        columns = texts("role", "resource", "firmware", verbatim=True)
        answered = [(e.title, e.resource, None if e.identity is None else e.identity.firmware) for e in run.equipment]
        yield Table(columns, answered, "Where the instruments answered")


def command_of(header: Mapping[str, Any]) -> str | None:
    """Return the command that makes the record again, as it would be typed; defaults are left out.

    The seed is that of a bench simulated in the process, whether it was asked for or drawn.
    """
    options = header.get("options")
    if not isinstance(options, dict):
        return None
    own, bench, resumed = header.get("procedure_file"), header.get("bench") or {}, header.get("resumed_from")
    words = ["vcfbench", "run", str(own["path"] if isinstance(own, dict) else header.get("procedure"))]
    stated = {**options, "metadata": options.get("metadata") or header.get("metadata")}
    if header.get("simulated") and bench.get("served") is None:
        stated["seed"] = header.get("seed")
    if isinstance(resumed, dict):  # seed, settings and metadata are those of the record that is gone on with
        words = ["vcfbench", "resume", str(resumed.get("directory"))]
        stated = {
            key: value for key, value in stated.items() if key not in {"resume", "runs", "seed", "settings", "metadata"}
        }
    for key, value in stated.items():
        if key == "settings" and isinstance(value, dict):
            for path, keys in nested_tables(value):
                words += chain.from_iterable(
                    ("--set", f"{path}.{k}={value_text(v)}".lstrip(".")) for k, v in keys.items()
                )
        elif key == "metadata" and isinstance(value, dict):
            words += _of_metadata(value)
        elif value is True:
            words.append(_option(key))
        elif value not in (None, False, "") or (key == "seed" and value is not None):
            words += [_option(key), str(value)]
    return shlex.join(words)


def _of_metadata(said: Mapping[str, Any]) -> Iterator[str]:
    """Yield the options that state the metadata of a run; a temperature that was measured is measured again."""
    for name, value in said.items():
        if isinstance(value, dict):
            yield from chain.from_iterable(("--tag", f"{tag}={words}") for tag, words in value.items())
        elif name == "ambient_from":
            yield from ("--ambient-temperature-c", str(value))
        elif value is not None and not (name == "ambient_temperature_c" and said.get("ambient_from")):
            yield from (_option(name), str(value))


def _option(key: str) -> str:
    return f"--{key.replace('_', '-')}"
