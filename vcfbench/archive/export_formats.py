"""Tables of a run for other programs, and their writers, one a file format; a library is imported for its own."""

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from importlib import import_module
from io import BytesIO
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from vcfbench.archive.output_unit import unit_of_record
from vcfbench.errors import ConfigError
from vcfbench.extras import need
from vcfbench.records.damage import own_readings
from vcfbench.records.export import point_columns
from vcfbench.records.journal import lines_of, read_header
from vcfbench.records.schema import Point

_UNITS: Final = {"_deg_s": "deg/s", "_v": "V", "t_s": "s"}
_COUNTS: Final = frozenset({"number", "step", "n"})
_READING: Final = (
    *("number", "step", "t_s", "voltage_v", "table_rate_deg_s", "rate_deg_s", "v_vc_set_v", "v_vc_measured_v"),
)
_MEANINGS: Final = {
    "number": "number of the step in the run, from 1",
    "step": "step of the procedure, as in a point",
    "t_s": "bench time at which the reading was asked for, since the bench was opened",
    "voltage_v": "reading of the multimeter",
    "table_rate_deg_s": "rate that the table read back at the end of the window",
    "rate_deg_s": "rate that the point stands for",
    "v_vc_set_v": "setting of V_Vc",
    "v_vc_v": "setting of V_Vc as the generator reads it back",
    "output_v": "mean output",
    "std_v": "standard deviation of one reading",
    "n": "readings of the mean",
    "v_vc_measured_v": "V_Vc as it was measured at the same time",
    "v_vc_std_v": "standard deviation of one such reading",
    "moved_v": "by how much the output at rest had moved in pauses before",
    "moved_u_v": "its standard uncertainty",
}
_AT_ONCE: Final = 10_000  # Rows that are made into text together
_LARGEST_ATTRIBUTE: Final = 60_000  # Bytes: an attribute of HDF5 takes 64 kB with its name
_XLSX_ROWS: Final = 1_048_576  # Most rows of a sheet, its head included


class ExportColumn(Struct, frozen=True, eq=False):
    """One quantity: its name, which ends in its unit, the unit, its meaning, and its values, shape (n,).

    Counts are whole numbers; in a quantity nan is a missing value.
    """

    name: str
    unit: str
    meaning: str
    values: NDArray[np.float64] | NDArray[np.int64]


class ExportTable(Struct, frozen=True, eq=False):
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


def points(journal: Path) -> tuple[ExportColumn, ...]:
    """Return the points of a record, in the columns of ``points.csv``."""
    lines = lines_of(journal)
    found = [Point.from_json(line["point"]) for line in lines if line.get("type") == "step" and "point" in line]
    rows = [point.as_json() for point in found]
    unit = unit_of_record(read_header(journal))
    return _columns({name: [row.get(name) for row in rows] for name in point_columns(found)}, unit)


def readings(journal: Path) -> tuple[ExportColumn, ...]:
    """Return every reading in the order of time, window after window: pieces of arrays, so that many need no more."""
    header = read_header(journal)
    pieces = list(_pieces(lines_of(journal), float(header.get("began_s", 0.0))))
    table = np.concatenate([np.empty((0, len(_READING))), *pieces])
    del pieces
    table = table[np.argsort(table[:, _READING.index("t_s")], kind="stable")]
    measured = table.shape[1] - int(np.isnan(table[:, -1]).all())  # columns: the last is left out where V_Vc was not
    return _columns(dict(zip(_READING[:measured], table.T, strict=False)), unit_of_record(header))


def _columns(values: Mapping[str, Iterable[Any]], of_output: str) -> tuple[ExportColumn, ...]:
    columns = []
    for name, given in values.items():
        array: Any = np.ascontiguousarray(given, dtype=np.float64)
        if name in _COUNTS:
            array = array.astype(np.int64)
        unit = next((unit for end, unit in _UNITS.items() if name.endswith(end)), "1")
        if unit == "V" and not name.startswith("v_vc_"):
            unit = of_output
        columns.append(ExportColumn(name, unit, _MEANINGS[name], array))
    return tuple(columns)


def _pieces(lines: Iterable[Mapping[str, Any]], began_s: float) -> Iterator[NDArray[np.float64]]:
    """Yield the readings of each step as rows; the table's readback is known when the step is done."""
    pieces: list[NDArray[np.float64]] = []
    for line in lines:
        if line.get("type") not in {"readings", "step", "error"}:
            continue
        own, result = own_readings(line), line.get("result", {})
        v_vc_v = [each.get("v_vc_v") for each in own]
        pieces.append(_table(line, [each["t_s"] for each in own], [each["voltage_v"] for each in own], v_vc_v))
        if line["type"] != "readings":
            pieces += [_table(line, *each) for each in _records(line, result, began_s)]
            for piece in pieces if result.get("table_rate_deg_s") is not None else ():
                piece[:, 4] = result["table_rate_deg_s"]
            yield from pieces
            pieces = []
    yield from pieces  # the run was cut within the step


def _records(line: Mapping[str, Any], result: Mapping[str, Any], began_s: float) -> Iterator[tuple[Any, Any, Any]]:
    """Yield times and lists of volts in a result: samples of a sine, of output and V_Vc, of V_Vc alone."""
    match line.get("result_kind"):
        case "SineResponse":  # nothing tells when each was taken but the interval, and when the step began
            volts = result["voltages_v"]
            yield began_s + line["t_s"] + result["interval_s"] * np.arange(len(volts)), volts, np.nan
        case "ModulatedRecord":
            for name, at in (("output_v", "output_t_s"), ("v_vc_v", "v_vc_t_s")):
                volts = result.get(name) or []
                times_s = (result[at] or 0.0) + result["interval_s"] * np.arange(len(volts))
                yield times_s, *((volts, np.nan) if name == "output_v" else (np.nan, volts))
        case "VvcMeasured":
            taken = result["v_vc"]
            yield [each["t_s"] for each in taken], np.nan, [each["voltage_v"] for each in taken]


def _table(line: Mapping[str, Any], t_s: Any, voltage_v: Any, v_vc_v: Any) -> NDArray[np.float64]:
    """Return a row for each time: of output and V_Vc lists, or nan where nothing read them."""
    step = line["step"]
    table = np.full((len(t_s), 8), np.nan)
    table[:, 0] = line["n"]
    table[:, 1] = step.get("step", 0)
    table[:, 2] = t_s
    table[:, 3] = voltage_v
    for column, name in ((5, "rate_deg_s"), (6, "v_vc_v")):
        if isinstance(step.get(name), int | float):
            table[:, column] = step[name]
    table[:, 7] = v_vc_v
    return table


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
        arrow.field(
            each.name, arrow.from_numpy_dtype(each.values.dtype), metadata={"unit": each.unit, "meaning": each.meaning}
        )
        for each in table.columns
    ]
    texts = {key: str(value).lower() if isinstance(value, bool) else str(value) for key, value in table.about.items()}
    schema = arrow.schema(fields, metadata=texts)
    arrays = [arrow.array(each.values, from_pandas=True) for each in table.columns]
    parquet.write_table(arrow.Table.from_arrays(arrays, schema=schema), str(path))


def _hdf5(table: ExportTable, path: Path) -> None:
    """Write a data set a column, unit and meaning in its attributes, and the record's facts in those of the file."""
    h5py = need("h5py", "export", "an export to HDF5")
    with h5py.File(data := BytesIO(), "w") as file:
        for key, value in table.about.items():
            if isinstance(value, str) and len(value.encode()) > _LARGEST_ATTRIBUTE:
                file[f"about/{key}"] = value
            else:
                file.attrs[key] = value
        group = file.create_group(table.name)
        for each in table.columns:
            packed = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if table.rows else {}
            column = group.create_dataset(each.name, data=each.values, **packed)
            column.attrs.update({"unit": each.unit, "meaning": each.meaning})
    path.write_bytes(data.getbuffer())


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
    book.save(data := BytesIO())  # on a full disk its own errors say less
    path.write_bytes(data.getbuffer())


_LONGEST_CELL: Final = 32_767


def _as_text(openpyxl: Any, sheet: Any, value: str | float) -> Any:
    """Return a cell; a text that begins with = is none of the formulas that a spreadsheet would reckon."""
    cell = openpyxl.cell.WriteOnlyCell(sheet, value[:_LONGEST_CELL] if isinstance(value, str) else value)
    if isinstance(value, str):
        cell.data_type = "s"
    return cell


def _mat(table: ExportTable, path: Path) -> None:
    """Write a struct of columns, one of their units, and one of the facts of the record (MATLAB 5)."""
    about = dict[str, str | float]()
    for key, value in table.about.items():
        name = re.sub("[^A-Za-z0-9]", "_", key)[:63]
        if name in about:  # a_b beside a-b: MATLAB's names are fewer than tags
            ends = (f"_{number}" for number in range(2, len(table.about) + 2))
            name = next(each for end in ends if (each := name[: 63 - len(end)] + end) not in about)
        about[name] = value
    units = {each.name: each.unit for each in table.columns}
    columns = {each.name: each.values for each in table.columns}
    import_module("scipy.io").savemat(  # it takes a while to load
        str(path),
        {table.name: columns, "units": units, "about": about},
        appendmat=False,
        do_compression=True,
        oned_as="column",
        long_field_names=True,
    )


def _rows(table: ExportTable) -> Iterator[Iterator[tuple[float | int | None, ...]]]:
    """Yield the rows, so many at a time, as numbers of Python; None is a missing value."""
    for first in range(0, table.rows, _AT_ONCE):
        listed = []
        for each in table.columns:
            values = each.values[first : first + _AT_ONCE]
            numbers = values.tolist()
            missing = values.dtype.kind == "f" and bool(np.isnan(values).any())
            listed.append([None if math.isnan(one) else one for one in numbers] if missing else numbers)
        yield zip(*listed, strict=True)
        if table.progress is not None:
            table.progress(min(first + _AT_ONCE, table.rows), table.rows)


WRITERS: Mapping[str, Callable[[ExportTable, Path], None]] = MappingProxyType(
    {"csv": _csv, "parquet": _parquet, "hdf5": _hdf5, "xlsx": _xlsx, "mat": _mat}
)
"""Writers of a table, by the name of the format."""
