"""Results of the points of a run, the verdict on them, and the report: computed, computed again, or as stored."""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

import msgspec
from msgspec import Raw, Struct, structs

from vcfbench.archive.output_unit import in_output_unit, report_in_output_unit
from vcfbench.errors import BenchError, ConfigError
from vcfbench.files import MOST_TABLE, read_file, shown
from vcfbench.instructions.procedure import AnyProcedure
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.definition import defined
from vcfbench.procedures.own_code import mistake_in
from vcfbench.records.amendments import amended, amendments_of
from vcfbench.records.directory import RunDirectory
from vcfbench.records.journal import JournalRecord, lines_of
from vcfbench.records.metadata import RunMetadata, metadata_from
from vcfbench.records.outline import Outline
from vcfbench.records.plain import plain, read_only
from vcfbench.records.schema import Point, Status
from vcfbench.records.stated import values_of
from vcfbench.reports.document import Report, Text, report_from
from vcfbench.reports.generic import generic_report, points_table, results_table
from vcfbench.reports.text import printable
from vcfbench.station.acceptance import Acceptance, judged
from vcfbench.station.settings import Limit
from vcfbench.steps.measured import Measured
from vcfbench.steps.no_result import is_arithmetic, no_result
from vcfbench.steps.stream import StreamSeen
from vcfbench.steps.stream_latency import LatencySeen
from vcfbench.typed import decoder_of, typed
from vcfbench.values.value import Value

STORED_SETTINGS: Final = "settings"  # Title of the table of settings below results that are shown as they were stored


class Evaluation(Struct, frozen=True):
    """Evaluation of the points of a run; `results` is None without results."""

    results: Any
    verdict: Acceptance | None
    report: Report
    values: tuple[Value, ...] = ()
    measured: Any = None
    """Measured data of the results, where they were computed: a journal of a million readings is not read once more."""


def nothing(points: Sequence[Point]) -> Evaluation:
    """Return the evaluation of a run without results: its points."""
    return Evaluation(None, None, generic_report(None, points, None))


def evaluate(
    procedure: AnyProcedure,
    settings: Any,
    limits: Sequence[Limit],
    measured: Measured,
    metadata: RunMetadata = RunMetadata(),  # noqa: B008  # frozen
) -> Evaluation:
    """Compute the results of `procedure`, judge them by `limits`, and make their report; `metadata` has conditions.

    Where the report fails, points and results are shown with the reason.

    Raises:
        BenchError: the points give no result, or one that cannot be written.
    """
    from vcfbench.devices.drive import drive_of, drive_remarks  # noqa: PLC0415  # NumPy, and no list needs it

    try:
        taken = measured.corrected(settings.station.sources)  # points that are kept are as they were read
        unit = settings.station.output_unit
        results = read_only(in_output_unit(procedure.results(settings, taken), unit))
        plain(results)  # what cannot be written is no result
        drive = drive_of(settings, measured)
        values = tuple(defined(values_of(results).values(), settings, metadata, drive))  # nor are there two of one name
        verdict = judged(limits, results, measured)
    except BenchError:
        raise
    except Exception as error:  # the arithmetic is anybody's
        if is_arithmetic(error):
            raise no_result(error, "the readings") from error
        raise ConfigError(mistake_in(error)) from error
    try:
        report = procedure.report(settings, taken, results)
        failed = "" if isinstance(report, Report) else f"it returned a {type(report).__name__}"
    except Exception as error:  # noqa: BLE001  # it is anybody's, and the results are there
        failed = mistake_in(error)
    if failed:
        notice = Text(f"the report of {procedure.name} failed: {failed}")
        report = Report([*generic_report(settings, taken, results).parts, notice])
    if taken.growth > 1.0:
        said = f"each reading remembers the one before: u of means is {math.sqrt(taken.growth):.2g} times as large"
        report = Report([*report.parts, Text(f"{said} as of independent ones; a longer sample_interval_s helps")])
    report = report_in_output_unit(report, unit)
    report = Report([*report.parts, *map(Text, drive_remarks(settings, measured, drive))])
    if seen := measured.found(StreamSeen):
        late = [f"; {each.describe()}" for _, each in measured.found(LatencySeen)[-1:]]
        report = Report([*report.parts, Text(f"the stream: {seen[-1][1].describe()}{''.join(late)}")])
    return Evaluation(results, verdict, report, values, measured)


def of_several(header: Mapping[str, Any]) -> str | None:
    """Say of the record of several devices why it has no results; None of any other."""
    devices = header.get("devices")
    if not isinstance(devices, list):
        return None
    return f"it is of {len(devices)} devices, each of which has a record of its own"


def evaluation_of(directory: RunDirectory, record: JournalRecord) -> tuple[Evaluation, str | None]:
    """Compute the results again from the points; if that is impossible, return the stored ones, with the reason."""
    if record.status is not Status.COMPLETE:
        return nothing(record.points), f"the record is {record.status.value}"
    if said := of_several(record.header):
        return Evaluation(None, None, Report([Text(said)])), said
    try:
        return _computed(directory, record), None
    except BenchError as error:
        why = printable(error.what)
    try:
        return _stored(directory, record), why
    except ConfigError as error:
        return nothing(record.points), f"{why}; {error.what}"


def _computed(directory: RunDirectory, record: JournalRecord) -> Evaluation:
    """Compute the results again; BenchError: the procedure is not known here, or gives none of these points."""
    from vcfbench.procedures.layers import recorded_settings  # noqa: PLC0415  # complete records alone need it

    name = record.header.get("procedure")
    if not isinstance(name, str) or name not in PROCEDURES:
        raise ConfigError(f"the procedure {name!r} is not known here")
    settings = recorded_settings(PROCEDURES[name], record.header.get("settings"))
    measured = Measured(record.points, lambda: record.lines)  # they have been read: a million readings take a second
    try:
        metadata = amended(metadata_from(record.header), amendments_of(record.lines))
        return evaluate(PROCEDURES[name], settings, settings.acceptance, measured, metadata)
    except BenchError as error:
        raise ConfigError(f"the points give no result: {error.what}") from error
    finally:
        measured.read_again_from(partial(lines_of, directory.journal))  # and are not held in memory


def _stored(directory: RunDirectory, record: JournalRecord) -> Evaluation:
    """Return the stored results; ConfigError: there is no ``result.json``, or it is none of these points."""
    path = directory.path / "result.json"
    answer = _decoded(path, msgspec.json.Decoder(dict[str, Any]))
    points = record.points
    if (answer.get("procedure"), answer.get("points")) != (
        record.header.get("procedure"),
        [each.as_json() for each in points],
    ):
        raise ConfigError(f"{shown(path)}: expected the result of this run, got the result of another run")
    results = read_only(answer.get("results") or {})
    kept = answer.get("report")
    if isinstance(kept, list):
        parts = report_from(kept).parts
    else:
        parts = (points_table(points), *results_table(results, "results, as they were stored"))
    own = record.header.get("settings")
    if isinstance(own, dict):
        own = {key: each for key, each in own.items() if key != "station"}
    settings = results_table(own, STORED_SETTINGS, "setting")
    found = values_of(results)  # with their parts; bounds stand in the list of stated values alone
    for each in typed(answer.get("values") or [], tuple[Value, ...]):
        with_parts = found.get(each.name, each)
        found[each.name] = structs.replace(with_parts, definition=each.definition, conditions=each.conditions)
    stated = tuple(found.values())
    return Evaluation(results, _stored_verdict(answer.get("acceptance")), Report([*parts, *settings]), stated)


class _Stored(Struct, frozen=True):
    """Stored file of results: points and results undecoded, the verdict."""

    procedure: str
    points: tuple[Raw, ...]
    results: dict[str, Raw]
    bench_seconds: float = 0.0
    acceptance: dict[str, Any] | None = None
    values: tuple[Value, ...] | None = None
    """None in records of before."""


def stored_outcome(path: Path, outline: Outline) -> tuple[Acceptance | None, Sequence[Value]]:
    """Return the verdict in the ``result.json`` of a run, or None, and its stated values.

    Raises:
        ConfigError: there is no such file, or it is none of the run's points.
    """
    answer = _decoded(path, decoder_of(_Stored))
    of_run = (outline.procedure, outline.points, outline.bench_seconds or 0.0)
    if (answer.procedure, len(answer.points), answer.bench_seconds) != of_run:
        raise ConfigError(f"{shown(path)}: expected the result of this run, got the result of another run")
    if answer.values is not None:
        return _stored_verdict(answer.acceptance), answer.values
    decoded = {name: msgspec.json.decode(raw) for name, raw in answer.results.items()}
    results = {name: each for name, each in decoded.items() if isinstance(each, dict) and "value" in each}
    return _stored_verdict(answer.acceptance), list(values_of(results).values())


def _decoded(path: Path, decoder: msgspec.json.Decoder[Any]) -> Any:
    try:
        return decoder.decode(read_file(path, "the result of a run", MOST_TABLE))
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ConfigError(f"{shown(path)}: expected the result of a run, got no JSON object: {error}") from None


def _stored_verdict(acceptance: Any) -> Acceptance | None:
    """Return the verdict that was stored, None if there is none."""
    try:
        limits = [{**each, "word": each["verdict"]} for each in acceptance["limits"]]
        return typed({"limits": limits}, Acceptance)
    except (KeyError, TypeError, msgspec.ValidationError):
        return None
