"""The table of a study as CSV: a row a run, sorted by case and seed; the same runs give the same bytes."""

import csv
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from vcfbench.errors import ConfigError
from vcfbench.files import shown
from vcfbench.records.export import write_text
from vcfbench.studies.one_run import RunRow

Columns = Mapping[str, tuple[Any, ...]]
"""Values by the name of their column, None where a run has none; of one kind each."""


def columns_of(rows: Sequence[RunRow], varied: Sequence[Mapping[str, Any]]) -> Columns:
    """Return the columns of `rows`: case, seed, varied values (by label, a mapping a row), status, metrics."""
    labels = dict.fromkeys(label for values in varied for label in values)
    metrics = dict.fromkeys(name for row in rows for name in row.metrics)
    return {
        "case": tuple(row.case for row in rows),
        "seed": tuple(row.seed for row in rows),
        **{label: _alike([values.get(label) for values in varied]) for label in labels},
        "status": tuple(row.status for row in rows),
        "message": tuple(row.message for row in rows),
        "verdict": tuple(row.verdict for row in rows),
        "bench_seconds": tuple(row.bench_seconds for row in rows),
        **{name: _alike([row.metrics.get(name) for row in rows]) for name in metrics},
    }


def _alike(values: Sequence[Any]) -> tuple[Any, ...]:
    """Return values of one kind: whole numbers among others become floats, and of all else texts are made."""
    kinds = {type(value) for value in values if value is not None}
    if kinds <= {bool} or kinds <= {int}:
        return tuple(values)
    made = float if kinds <= {int, float} else in_words
    return tuple(None if value is None else made(value) for value in values)


def in_words(value: Any) -> str:
    """Return a value of a study file as a text: texts as they are, all else as JSON."""
    return value if isinstance(value, str) else json.dumps(value)


def require_writable(path: Path) -> None:
    """Make sure that a table can be written, before anything runs.

    Raises:
        ConfigError: the suffix is another, or there is no such directory.
    """
    if path.suffix != ".csv":
        raise ConfigError(f"-o {shown(path)}: expected a name that ends in .csv")
    if not path.parent.is_dir():
        raise ConfigError(f"-o {shown(path)}: the directory {shown(path.parent)} does not exist")


def write_table(path: Path, columns: Columns) -> None:
    """Write the table; BenchError: the disk does not take it."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    cells = ([str(each).lower() if isinstance(each, bool) else each for each in values] for values in columns.values())
    writer.writerows(zip(*cells, strict=True))
    write_text(path, text.getvalue())
