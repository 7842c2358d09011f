"""Lists of all records under a directory: from an index where there is one, else from the records."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from vcfbench.archive.index import indexed
from vcfbench.archive.summary import RunSummary, ordered, selection_of, summary_of
from vcfbench.records.directory import recorded_runs

if TYPE_CHECKING:
    from collections.abc import Mapping
    from datetime import datetime


def run_summaries(
    runs: str | Path = "runs",
    *,
    dut: str | None = None,
    since: str | datetime | None = None,
    status: str | None = None,
    procedure: str | None = None,
    tags: Mapping[str, str] | None = None,
) -> tuple[RunSummary, ...]:
    """Return summaries of the records under `runs`, oldest first; those of :func:`list_runs`, far sooner.

    An index beside the records (``vcfbench runs index``) is brought up to date and asked instead of them.
    ``pandas.DataFrame(vcfbench.run_summaries())`` makes a table of them.

    Args:
        runs: directory of the records.
        dut: only those of this device.
        since: only those that began on this day (``"2026-01-15"``, UTC) or later, or from an instant on.
        status: only those that ended so.
        procedure: only those of this procedure.
        tags: only those that have all of them.

    Raises:
        ConfigError: there is no such status, or the date is none.
    """
    chosen = selection_of(dut=dut, since=since, status=status, procedure=procedure, tags=tags)
    if (Path(runs) / "index.sqlite").is_file():
        found = indexed(Path(runs), chosen)
        if found is not None:
            return found
    return ordered(each for each in map(summary_of, recorded_runs(Path(runs))) if chosen.takes(each))
