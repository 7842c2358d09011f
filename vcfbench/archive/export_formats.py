"""Writers of a table of a run, one a file format; each library is imported when its format is asked for."""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

from vcfbench.errors import ConfigError
from vcfbench.extras import need

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

_AT_ONCE: Final = 10_000
"""Rows that are made into text together."""
_LARGEST_ATTRIBUTE: Final = 60_000
"""Bytes: an attribute of HDF5 takes 64 kB with its name."""
_XLSX_ROWS: Final = 1_048_576
"""Most rows of a sheet, its head included."""


@dataclass(frozen=True, slots=True, eq=False)
class ExportColumn:
    """One quantity: its name, which ends in its unit, the unit, its meaning, and its values, shape (n,).

    Counts are whole numbers; in a quantity nan is a missing value.
    """

    name: str
    unit: str
    meaning: str
    values: NDArray[np.float64] | NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class ExportTable:
    """Columns of the same length; `name` is ``points`` or ``readings``, `about` the facts of the run by its record."""

    name: str
    columns: tuple[ExportColumn, ...]
    about: Mapping[str, str | float]
    progress: Callable[[int, int], None] | None = None
    """Callback with the numbers of rows written and of all rows, called by formats that take their time."""

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.columns[0].values)


def _csv(table: ExportTable, path: Path) -> None:
    """Write names and values, in full precision; missing values are empty."""
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write(",".join(each.name for each in table.columns) + "\n")
        for rows in _rows(table):
            file.writelines(",".join(["" if cell is None else repr(cell) for cell in row]) + "\n" for row in rows)


def _parquet(table: ExportTable, path: Path) -> None:
    """Write columns with unit and meaning in their metadata, the facts of the record in that of the schema."""
    arrow, parquet = (need(name, "export", "an export to Parquet") for name in ("pyarrow", "pyarrow.parquet"))
    fields = [
        arrow.field(each.name, arrow.from_numpy_dtype(each.values.dtype), metadata=_described(each.unit, each.meaning))
        for each in table.columns
    ]
    schema = arrow.schema(fields, metadata={key: str(value) for key, value in table.about.items()})
    arrays = [arrow.array(each.values, from_pandas=True) for each in table.columns]
    parquet.write_table(arrow.Table.from_arrays(arrays, schema=schema), str(path))


def _described(unit: str, meaning: str) -> dict[str, str]:
    return {"unit": unit, "meaning": meaning}


def _hdf5(table: ExportTable, path: Path) -> None:
    """Write a data set a column, unit and meaning in its attributes, and the record's facts in those of the file."""
    h5py = need("h5py", "export", "an export to HDF5")
    with h5py.File(path, "w") as file:
        for key, value in table.about.items():
            if isinstance(value, str) and len(value.encode()) > _LARGEST_ATTRIBUTE:
                file[f"about/{key}"] = value
            else:
                file.attrs[key] = value
        group = file.create_group(table.name)
        for each in table.columns:
            packed = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if table.rows else {}
            data = group.create_dataset(each.name, data=each.values, **packed)
            data.attrs.update(_described(each.unit, each.meaning))


def _xlsx(table: ExportTable, path: Path) -> None:
    """Write a sheet of values, one of the columns' meanings, and one of the facts of the record."""
    openpyxl = need("openpyxl", "export", "an export to a spreadsheet")
    if table.rows >= _XLSX_ROWS:
        raise ConfigError(
            f"{table.rows} rows do not fit on a sheet of a spreadsheet, which has {_XLSX_ROWS} with its head",
            hint="--format parquet, hdf5 or csv takes all of them; without --raw the points are written",
        )
    book = openpyxl.Workbook(write_only=True)
    sheet = book.create_sheet(table.name)
    sheet.append([each.name for each in table.columns])
    for rows in _rows(table):
        for row in rows:
            sheet.append(row)
    described = book.create_sheet("columns")
    described.append(["column", "unit", "meaning"])
    for each in table.columns:
        described.append([each.name, each.unit, each.meaning])
    about = book.create_sheet("about")
    for key, value in table.about.items():
        about.append([_as_text(openpyxl, about, key), _as_text(openpyxl, about, value)])
    book.save(path)


_LONGEST_CELL: Final = 32_767


def _as_text(openpyxl: Any, sheet: Any, value: str | float) -> Any:
    """Return a cell; a text that begins with = is none of the formulas that a spreadsheet would reckon."""
    cell = openpyxl.cell.WriteOnlyCell(sheet, value[:_LONGEST_CELL] if isinstance(value, str) else value)
    if isinstance(value, str):
        cell.data_type = "s"
    return cell


def _mat(table: ExportTable, path: Path) -> None:
    """Write a struct of columns, one of their units, and one of the facts of the record (MATLAB 5)."""
    from scipy.io import savemat  # noqa: PLC0415  # it takes a while to load

    about = {_matlab_name(key): value for key, value in table.about.items()}
    units = {each.name: each.unit for each in table.columns}
    columns = {each.name: each.values for each in table.columns}
    savemat(
        str(path),
        {table.name: columns, "units": units, "about": about},
        appendmat=False,
        do_compression=True,
        oned_as="column",
        long_field_names=True,
    )


def _matlab_name(key: str) -> str:
    """Return `key` as a name that a field of a struct can have."""
    return "".join(each if each.isascii() and each.isalnum() else "_" for each in key)[:63]


def _rows(table: ExportTable) -> Iterator[Iterator[tuple[float | int | None, ...]]]:
    """Yield the rows, so many at a time, as numbers of Python; None is a missing value."""
    for first in range(0, table.rows, _AT_ONCE):
        yield zip(*(_plain(each.values[first : first + _AT_ONCE]) for each in table.columns), strict=True)
        if table.progress is not None:
            table.progress(min(first + _AT_ONCE, table.rows), table.rows)


def _plain(values: Any) -> list[float | int | None]:
    listed: list[float | int | None] = values.tolist()
    if values.dtype.kind == "f" and bool((values != values).any()):  # noqa: PLR0124 - nan alone is not itself
        return [None if each is None or math.isnan(each) else each for each in listed]
    return listed


WRITERS: Mapping[str, Callable[[ExportTable, Path], None]] = MappingProxyType(
    {"csv": _csv, "parquet": _parquet, "hdf5": _hdf5, "xlsx": _xlsx, "mat": _mat}
)
"""Writers of a table, by the name of the format."""
