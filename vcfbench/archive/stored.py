"""Stored results of a record: shown where they cannot be computed again, and in lists of runs."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any, Final

import msgspec
from msgspec import Raw, Struct

from vcfbench.archive.results import Evaluation
from vcfbench.errors import ConfigError
from vcfbench.files import MOST_TABLE, read_file, shown
from vcfbench.records.outline import Mark  # noqa: TC001  # msgspec reads the annotation
from vcfbench.records.plain import read_only
from vcfbench.reports.document import Report
from vcfbench.reports.generic import points_table, results_table
from vcfbench.reports.kept import report_from
from vcfbench.station.acceptance import Acceptance, Verdict
from vcfbench.typed import decoder_of

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from msgspec.json import Decoder

    from vcfbench.records.directory import RunDirectory
    from vcfbench.records.journal import JournalRecord
    from vcfbench.records.outline import Outline

STORED_SETTINGS: Final = "settings"
"""Title of the table of settings below results that are shown as they were stored."""


def stored(directory: RunDirectory, record: JournalRecord) -> Evaluation:
    """Return the stored results of a record, where they cannot be computed again.

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
    try:
        answer = _decoder().decode(read_file(path, "the result of a run", MOST_TABLE))
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
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
    """Stored file of results: the marks of its run, the verdict on it, and the results undecoded."""

    procedure: str
    points: tuple[Mark, ...]
    results: dict[str, Raw]
    bench_seconds: float = 0.0
    acceptance: dict[str, Any] | None = None


def _decoded(path: Path) -> dict[str, Any]:
    try:
        return msgspec.json.decode(read_file(path, "the result of a run", MOST_TABLE), type=dict[str, Any])
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
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
