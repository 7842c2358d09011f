"""The table of a study: a row a run, sorted by case and seed, as CSV or Parquet; the same runs give the same bytes."""

import csv
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from msgspec import Struct

from vcfbench.errors import BenchError, ConfigError
from vcfbench.extras import need
from vcfbench.files import shown
from vcfbench.studies.one_run import RunRow

Kind = Literal["int", "float", "bool", "str"]


class ColumnOf(Struct, frozen=True):
    """A column: its values are of `kind`, or None where a run has none."""

    name: str
    kind: Kind
    values: tuple[Any, ...]


def columns_of(rows: Sequence[RunRow], varied: Sequence[Mapping[str, Any]]) -> tuple[ColumnOf, ...]:
    """Return the columns of `rows`: case, seed, varied values (by label, a mapping a row), status, metrics."""
    labels = list(dict.fromkeys(label for values in varied for label in values))
    metrics = list(dict.fromkeys(name for row in rows for name in row.metrics))
    return (
        ColumnOf("case", "int", tuple(row.case for row in rows)),
        ColumnOf("seed", "int", tuple(row.seed for row in rows)),
        *(_column(label, [values.get(label) for values in varied]) for label in labels),
        ColumnOf("status", "str", tuple(row.status for row in rows)),
        ColumnOf("message", "str", tuple(row.message for row in rows)),
        ColumnOf("verdict", "str", tuple(row.verdict for row in rows)),
        ColumnOf("bench_seconds", "float", tuple(row.bench_seconds for row in rows)),
        *(_column(name, [row.metrics.get(name) for row in rows]) for name in metrics),
    )


def _column(name: str, values: Sequence[Any]) -> ColumnOf:
    kinds = {type(value) for value in values if value is not None}
    if kinds == {bool}:
        return ColumnOf(name, "bool", tuple(values))
    if kinds == {int}:
        return ColumnOf(name, "int", tuple(values))
    if kinds <= {int, float}:
        return ColumnOf(name, "float", tuple(None if value is None else float(value) for value in values))
    return ColumnOf(name, "str", tuple(None if value is None else in_words(value) for value in values))


def in_words(value: Any) -> str:
    """Return a value of a study file as a text: texts as they are, all else as JSON."""
    return value if isinstance(value, str) else json.dumps(value)


def require_writable(path: Path) -> None:
    """Make sure that a table can be written in the format of `path`'s suffix, before anything runs.

    Raises:
        ConfigError: the suffix is unknown, there is no such directory, or what is needed is not installed.
    """
    if path.suffix not in {".csv", ".parquet"}:
        raise ConfigError(f"-o {shown(path)}: expected a name that ends in .parquet or .csv")
    if not path.parent.is_dir():
        raise ConfigError(f"-o {shown(path)}: there is no directory {shown(path.parent)}")
    if path.suffix == ".parquet":
        try:
            need("pyarrow.parquet", "study", "a table in Parquet")
        except ConfigError as error:
            error.hint = f"{error.hint}, or -o {shown(path.with_suffix('.csv'))}"
            raise


def write_table(path: Path, columns: Sequence[ColumnOf]) -> None:
    """Write the table in the format of `path`'s suffix; errors as :func:`require_writable`, BenchError of the disk."""
    data = io.BytesIO()
    if path.suffix == ".parquet":  # which holds neither a time nor a name of the computer
        pyarrow, parquet = (need(name, "study", "a table in Parquet") for name in ("pyarrow", "pyarrow.parquet"))
        types = {"int": pyarrow.int64(), "float": pyarrow.float64(), "bool": pyarrow.bool_(), "str": pyarrow.string()}
        arrays = [pyarrow.array(column.values, types[column.kind]) for column in columns]
        parquet.write_table(pyarrow.table(arrays, [column.name for column in columns]), data, compression="zstd")
    else:
        text = io.TextIOWrapper(data, "utf-8", newline="", write_through=True)
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow([column.name for column in columns])
        writer.writerows(zip(*([_cell(value) for value in column.values] for column in columns), strict=True))
    written(path, data.getvalue())


def written(path: Path, data: bytes) -> None:
    """Write a file that is there whole or not at all; raises BenchError when the disk does not take it."""
    beside = path.with_name(f".{path.name}.part")
    try:
        beside.write_bytes(data)
        beside.replace(path)
    except OSError as error:
        raise BenchError(f"{shown(path)} cannot be written: {error.strerror}") from error


def _cell(value: Any) -> str:
    if value is None or isinstance(value, str):
        return value or ""
    return str(value).lower() if isinstance(value, bool) else repr(value)
