"""What the points of a run come to: results, the verdict on them, and the report; or what is stored of them."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any, Final

from msgspec import Raw, Struct

from vcfbench.bench.acceptance import Acceptance, Verdict, judged
from vcfbench.errors import BenchError, ConfigError
from vcfbench.files import MOST_TABLE, read_file, shown
from vcfbench.procedures.own_code import mistake_in
from vcfbench.record.outline import Mark  # noqa: TC001  # msgspec reads the annotation
from vcfbench.record.plain import plain, read_only
from vcfbench.report.document import Report, Text
from vcfbench.report.generic import generic_report, points_table, results_table
from vcfbench.report.kept import report_from
from vcfbench.typed import decoder_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from msgspec.json import Decoder

    from vcfbench.bench.settings import Limit
    from vcfbench.plans.measured import Measured
    from vcfbench.procedures.procedure import AnyProcedure
    from vcfbench.record.directory import RunDirectory
    from vcfbench.record.journal import JournalRecord
    from vcfbench.record.outline import Outline
    from vcfbench.record.schema import Point


STORED_SETTINGS: Final = "settings"
"""Title of the table of settings below results that are shown as they were stored."""


class Evaluation(Struct, frozen=True):
    """What the points of a run came to; `results` None where they came to nothing."""

    results: Any
    verdict: Acceptance | None
    report: Report
    measured: Any = None
    """What they were made of, where they were computed: a journal of a million readings is not read once more."""


def nothing(points: Sequence[Point]) -> Evaluation:
    """Return what a run without results came to: its points."""
    return Evaluation(None, None, Report([points_table(points)]))


def come_to(procedure: AnyProcedure, settings: Any, limits: Sequence[Limit], measured: Measured) -> Evaluation:
    """Compute the results of `procedure`, judge them by `limits`, and make their report.

    Raises:
        BenchError: the points give no result, or one that cannot be written.
    """
    try:
        results = read_only(procedure.results(settings, measured))
        plain(results)  # what cannot be written is no result
        verdict = judged(limits, results, measured)
    except BenchError:
        raise
    except Exception as error:  # the arithmetic is anybody's
        raise ConfigError(mistake_in(error)) from error
    return Evaluation(results, verdict, _report(procedure, settings, measured, results), measured)


def _report(procedure: AnyProcedure, settings: Any, measured: Measured, results: Any) -> Report:
    """Return the report of the procedure; where it fails, points and results say as much, and what happened."""
    try:
        made = procedure.report(settings, measured, results)
        if isinstance(made, Report):
            return made
        failed = f"it returned a {type(made).__name__}"
    except Exception as error:  # noqa: BLE001  # it is anybody's, and the results are there
        failed = mistake_in(error)
    notice = Text(f"the report of {procedure.name} failed: {failed}")
    return Report([*generic_report(settings, measured, results).parts, notice])


def stored(directory: RunDirectory, record: JournalRecord) -> Evaluation:
    """Return what the record keeps of its results, where they cannot be computed again.

    Raises:
        ConfigError: there is no ``result.json`` in the record, or it is none of these points.
    """
    path = directory.path / "result.json"
    answer, points = _decoded(path), record.points
    if answer.get("procedure") != record.header.get("procedure") or answer.get("points") != [
        p.as_json() for p in points
    ]:
        raise ConfigError(f"{shown(path)}: expected the result of this run, it is that of another")
    results = read_only(answer.get("results") or {})
    kept = answer.get("report")
    if isinstance(kept, list):
        parts = report_from(kept).parts
    else:
        parts = (points_table(points), *results_table(results, "results, as they were stored"))
    kept_settings = record.header.get("settings")
    own = (
        {key: each for key, each in kept_settings.items() if key != "station"}
        if isinstance(kept_settings, dict)
        else kept_settings
    )
    settings = results_table(own, STORED_SETTINGS, "setting")
    return Evaluation(results, _stored_verdict(answer), Report([*parts, *settings]))


def stored_outcome(path: Path, outline: Outline) -> tuple[Acceptance | None, Mapping[str, Raw]]:
    """Return the verdict in the ``result.json`` of a run, None if there is none, and its results as they stand there.

    Raises:
        ConfigError: there is no such file, or it is none of the run's points.
    """
    import msgspec  # noqa: PLC0415  # as below

    try:
        answer = _decoder().decode(read_file(path, "the result of a run", MOST_TABLE))
    except (msgspec.DecodeError, RecursionError) as error:
        raise ConfigError(f"{shown(path)}: expected the result of a run: {error}") from None
    same = (
        (len(answer.points), answer.bench_seconds) == (outline.points, outline.bench_seconds or 0.0)
        if outline.marks is None
        else answer.points == outline.marks
    )
    if answer.procedure != outline.procedure or not same:
        raise ConfigError(f"{shown(path)}: expected the result of this run, it is that of another")
    return None if answer.acceptance is None else _stored_verdict({"acceptance": answer.acceptance}), answer.results


@cache
def _decoder() -> Decoder[_Stored]:
    return decoder_of(_Stored)


class _Stored(Struct, frozen=True):
    """What says whose result a file holds, the verdict on it, and the results undecoded."""

    procedure: str
    points: tuple[Mark, ...]
    results: dict[str, Raw]
    bench_seconds: float = 0.0
    acceptance: dict[str, Any] | None = None


def _decoded(path: Path) -> dict[str, Any]:
    import msgspec  # noqa: PLC0415  # it is needed for records of others alone

    try:
        return msgspec.json.decode(read_file(path, "the result of a run", MOST_TABLE), type=dict[str, Any])
    except (msgspec.DecodeError, RecursionError) as error:
        raise ConfigError(f"{shown(path)}: expected the result of a run, it is no JSON object: {error}") from None


def _stored_verdict(answer: Mapping[str, Any]) -> Acceptance | None:
    """Return the verdict that was stored, None if there is none."""
    acceptance = answer.get("acceptance")
    try:
        return None if acceptance is None else Acceptance(tuple(map(_stored_limit, acceptance["limits"])))
    except (KeyError, TypeError):
        return None


def _stored_limit(limit: Mapping[str, Any]) -> Verdict:
    measured = limit["verdict"] != "not measured"
    return Verdict(limit["key"], limit["value"], float(limit["low"]), float(limit["high"]), measured, limit.get("u95"))
