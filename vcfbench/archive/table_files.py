"""Tables in files that are no text, as the text that is read of all others: one grammar of names, units and faults."""

import csv
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import date
from io import BytesIO, StringIO
from pathlib import Path
from typing import IO, Any, Final
from zipfile import BadZipFile

import numpy as np
from msgspec import structs

from vcfbench.analysis.csv_table import Layout
from vcfbench.archive.output_unit import unit_of_record
from vcfbench.errors import ConfigError
from vcfbench.extras import need
from vcfbench.files import opened, shown
from vcfbench.records.journal import read_header

_BEGIN: Final = 1 << 16


@contextmanager
def opened_table(path: Path | str) -> Iterator[IO[bytes]]:
    """Open a table that a user named as text: CSV and the like as they are, the others of `_READERS` as CSV.

    Raises:
        ConfigError: it is no such file, or has several tables.
    """
    read = _READERS.get(Path(path).suffix.lower())
    with opened(path, "a table") as raw:
        if read is None:
            yield _plain_text(raw, shown(path))
            return
        rows = read(raw, shown(path))
        text = StringIO(newline="")
        csv.writer(text, lineterminator="\n").writerows(rows)
    yield BytesIO(text.getvalue().encode())


def with_unit_of_record(path: Path, layout: Layout | None) -> Layout:
    """Return the layout, of the ``points.csv`` of a record with the unit of its output, unless another was given."""
    layout, journal = layout or Layout(), path.with_name("journal.jsonl")
    if path.name != "points.csv" or "output_v" in layout.units or not journal.is_file():
        return layout
    unit = unit_of_record(read_header(journal))
    return layout if unit == "V" else structs.replace(layout, units={**layout.units, "output_v": unit})


def _plain_text(raw: IO[bytes], name: str) -> IO[bytes]:
    """Return a text with line feeds, in bytes that go on as ASCII: spreadsheets write UTF-16, old ones CR."""
    begin = raw.read(_BEGIN)
    raw.seek(0)
    if begin.startswith((BOM_UTF16_LE, BOM_UTF16_BE)):
        try:
            text = raw.read().decode("utf-16")
        except UnicodeDecodeError as error:
            raise ConfigError(f"{name}: expected whole UTF-16 text, got {error.reason}") from error
        return _plain_text(BytesIO(text.encode()), name)
    only_returns = b"\r" in begin and b"\n" not in begin
    return BytesIO(raw.read().replace(b"\r", b"\n")) if only_returns else raw


def _of_columns(columns: dict[str, Sequence[Any]]) -> Iterator[Iterable[Any]]:
    yield columns
    yield from zip(*columns.values(), strict=True)


def _xlsx(raw: IO[bytes], name: str) -> Iterator[Iterable[Any]]:
    workbook = need("openpyxl", "export", f"{name}: a sheet")
    try:
        sheets = workbook.load_workbook(raw, read_only=True, data_only=True).worksheets
        tables = [(each.title, list(each.iter_rows(values_only=True))) for each in sheets]
    except Exception as error:  # openpyxl's, zipfile's, those of XML
        raise ConfigError(f"{name}: expected an xlsx workbook: {error}") from error
    filled = [(title, rows) for title, rows in tables if any(any(cell is not None for cell in row) for row in rows)]
    if len(filled) != 1:
        titles = ", ".join(title for title, _ in filled)
        raise ConfigError(f"{name}: expected one sheet with a table, got {titles or 'none'}", hint="save it as CSV")
    for row in filled[0][1]:
        yield [each.isoformat() if isinstance(each, date) else "" if each is None else each for each in row]


def _npy(raw: IO[bytes], name: str) -> Iterator[Iterable[Any]]:
    try:
        array = np.load(raw, allow_pickle=False)
        several = dict(array) if isinstance(array, np.lib.npyio.NpzFile) else None
    except (ValueError, OSError, EOFError, BadZipFile) as error:
        raise ConfigError(f"{name}: expected an array of numbers: {error}") from error
    if several is not None:
        return _variables({key: value[:, None] if value.ndim == 1 else value for key, value in several.items()}, name)
    if array.dtype.names:
        return _of_columns({each: array[each].tolist() for each in array.dtype.names})
    if array.dtype.kind not in "iuf" or array.ndim not in {1, 2}:
        raise ConfigError(f"{name}: expected columns of real numbers, got {array.dtype} of the shape {array.shape}")
    return iter(array.reshape(len(array), -1).tolist())


def _mat(raw: IO[bytes], name: str) -> Iterator[Iterable[Any]]:
    matlab = need("scipy.io", "export", f"{name}: a .mat file")
    try:
        found = matlab.loadmat(raw)
    except Exception as error:  # SciPy's own, zlib's, and what comes of bytes that are none
        raise ConfigError(f"{name}: expected a .mat file up to version 7: {error}", hint="save it with -v7") from error
    return _variables(found, name)


def _variables(found: Mapping[str, Any], name: str) -> Iterator[Iterable[Any]]:
    """Return the arrays of numbers of a file, which have one length, each as columns by its name."""
    columns = dict[str, Sequence[Any]]()
    for key, value in found.items():
        array = np.asarray(value)
        if key.startswith("__") or array.dtype.kind not in "iuf" or array.ndim != 2 or array.size < 2:
            continue
        array = array.T if array.shape[0] == 1 else array
        names = [key] if array.shape[1] == 1 else [f"{key}_{place}" for place in range(1, array.shape[1] + 1)]
        columns |= dict(zip(names, array.T.tolist(), strict=True))
    lengths = {key: len(column) for key, column in columns.items()}
    if len(set(lengths.values())) != 1:
        came = ", ".join(f"{key} of {length}" for key, length in lengths.items())
        structs = [key for key, value in found.items() if np.asarray(value).dtype.names]
        cure = f"save the fields of {', '.join(structs)} as variables, as by save -struct" if structs else None
        raise ConfigError(f"{name}: expected variables of one length, got {came or 'none'}", hint=cure)
    return _of_columns(columns)


def _parquet(raw: IO[bytes], name: str) -> Iterator[Iterable[Any]]:
    parquet = need("pyarrow.parquet", "export", f"{name}: a table of Parquet")
    try:
        columns = parquet.read_table(raw).to_pydict()
    except Exception as error:  # those of Arrow
        raise ConfigError(f"{name}: expected a Parquet table: {error}") from error
    plain: dict[str, Sequence[Any]] = {
        key: [each.isoformat() if isinstance(each, date) else "" if each is None else each for each in column]
        for key, column in columns.items()
    }
    return _of_columns(plain)


def _tdms(raw: IO[bytes], name: str) -> Iterator[Iterable[Any]]:
    """Read the channels of LabVIEW's file, each with its ``unit_string``; a waveform's interval makes the times."""
    tdms = need("nptdms", "export", f"{name}: a TDMS file")
    try:
        groups = [each for each in tdms.TdmsFile.read(raw).groups() if any(len(channel) for channel in each.channels())]
        filled = [(each.name, [channel for channel in each.channels() if len(channel)]) for each in groups]
        cells = [[each[:] for each in channels] for _, channels in filled]
    except Exception as error:  # npTDMS's own, struct's, NumPy's
        raise ConfigError(f"{name}: expected a TDMS file: {error}") from error
    if len(filled) != 1:
        came = ", ".join(group for group, _ in filled) or "none"
        raise ConfigError(f"{name}: expected one group with channels, got {came}", hint="export the group as CSV")
    (_, channels), (values,) = filled[0], cells
    lengths = {each.name: len(each) for each in channels}
    intervals = {each.properties.get("wf_increment") for each in channels}
    if len(set(lengths.values())) != 1 or len(intervals) != 1:
        came = ", ".join(f"{each.name} of {len(each)} by {each.properties.get('wf_increment')} s" for each in channels)
        raise ConfigError(f"{name}: expected channels of one length and interval, got {came}")
    columns = dict[str, Sequence[Any]]()
    if (interval_s := intervals.pop()) is not None:
        start_s = channels[0].properties.get("wf_start_offset", 0.0)
        columns["t [s]"] = [start_s + place * interval_s for place in range(len(channels[0]))]
    for channel, column in zip(channels, values, strict=True):
        unit = channel.properties.get("unit_string")
        array = np.asarray(column)
        text = array.dtype.kind == "M"
        columns[f"{channel.name} [{unit}]" if unit else channel.name] = (array.astype(str) if text else array).tolist()
    return _of_columns(columns)


_READERS: Final[dict[str, Callable[[IO[bytes], str], Iterator[Iterable[Any]]]]] = {
    ".xlsx": _xlsx,
    ".npy": _npy,
    ".npz": _npy,
    ".mat": _mat,
    ".parquet": _parquet,
    ".tdms": _tdms,
}
