"""A run for other programs: its points or every raw reading, a column a quantity, with the facts of its record."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import msgspec

from vcfbench.archive.export_formats import WRITERS, ExportColumn, ExportTable
from vcfbench.archive.recorded import directory_of
from vcfbench.archive.run import Run
from vcfbench.errors import ConfigError
from vcfbench.files import shown
from vcfbench.records.amendments import amended, amendments_at
from vcfbench.records.damage import own_readings
from vcfbench.records.export import point_columns
from vcfbench.records.journal import lines_of, read_header
from vcfbench.records.metadata import equipment_of, metadata_from
from vcfbench.records.outline import outline_of
from vcfbench.records.schema import Point

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    import numpy as np
    from numpy.typing import NDArray

    from vcfbench.records.directory import RunDirectory

FORMATS: Final = ("csv", "parquet", "hdf5", "xlsx", "mat")
_SUFFIXES: Final = {
    ".csv": "csv",
    ".parquet": "parquet",
    ".h5": "hdf5",
    ".hdf5": "hdf5",
    ".xlsx": "xlsx",
    ".mat": "mat",
}
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
}


@dataclass(frozen=True, slots=True)
class Exported:
    """Written export: the file, its format, its table, its columns and the number of rows."""

    file: Path
    format: str
    table: str
    columns: tuple[str, ...]
    rows: int


def export_run(
    run: str | Path | Run,
    file: str | Path | None = None,
    *,
    format: str | None = None,  # noqa: A002 - the word of the command
    raw: bool = False,
    runs: str | Path = "runs",
    progress: Callable[[int, int], None] | None = None,
) -> Exported:
    """Write the points of a run, or every raw reading, for other programs; a file of that name is replaced, whole.

    Args:
        run: its directory, its name under `runs` (or the beginning or end of it, or ``"last"``), or itself.
        file: where to; None is ``RUN-points.csv`` or the like in the working directory.
        format: ``"csv"``, ``"parquet"``, ``"hdf5"``, ``"xlsx"`` or ``"mat"``; None goes by the suffix of `file`.
        raw: every reading instead of the points.
        runs: directory of the records.
        progress: is called with the rows written and all of them, while a table is written as CSV or xlsx.

    Raises:
        ConfigError: there is no such record, it is damaged, the format is unknown or needs the extra ``export``, the
            table is too long for it, or the file cannot be written.
    """
    directory = _directory(run, runs)
    if format is not None and format not in FORMATS:
        raise ConfigError(f"format: expected one of {', '.join(FORMATS)}, came {format!r}")
    by_suffix = None if file is None else _SUFFIXES.get(Path(file).suffix.lower())
    found = format or by_suffix
    if found is None:
        raise ConfigError(f"which format is not known: expected one of {', '.join(FORMATS)}", hint="--format FORMAT")
    written_as = found
    table = replace((_readings if raw else _points)(directory), progress=progress)
    path = Path(f"{directory.run}-{table.name}.{written_as}" if file is None else file)
    if path.exists() and not path.is_file():  # replacing it would take a device away
        raise ConfigError(f"{shown(path)}: expected a file to write, this is none")
    draft = path.with_name(f".{path.name}.draft")
    try:
        try:
            WRITERS[written_as](table, draft)
            draft.replace(path)
        finally:
            draft.unlink(missing_ok=True)
    except OSError as error:
        raise ConfigError(f"{shown(path)}: it cannot be written: {error.strerror or error}") from error
    return Exported(path, written_as, table.name, tuple(each.name for each in table.columns), table.rows)


def _directory(run: str | Path | Run, runs: str | Path) -> RunDirectory:
    where = run.directory if isinstance(run, Run) else run
    if where is None:
        raise ConfigError("the run has no record, so there is nothing to export")
    directory = directory_of(where, runs)
    if outline_of(directory.journal) is None and (damage := directory.read().damage) is not None:
        raise ConfigError(f"{shown(directory.journal)}: the record is damaged, nothing is exported: {damage}")
    return directory


def _points(directory: RunDirectory) -> ExportTable:
    """Return the points, in the columns of ``points.csv``."""
    lines = lines_of(directory.journal)
    points = [Point.from_json(line["point"]) for line in lines if line.get("type") == "step" and "point" in line]
    rows = [point.as_json() for point in points]
    names = point_columns(points)
    return ExportTable("points", _columns({name: [row.get(name) for row in rows] for name in names}), _about(directory))


def _readings(directory: RunDirectory) -> ExportTable:
    """Return every reading in the order of time, window after window: pieces of arrays, so that many need no more."""
    import numpy as np  # noqa: PLC0415  # not for the points

    pieces = list(_pieces(lines_of(directory.journal), float(read_header(directory.journal).get("began_s", 0.0))))
    table = np.concatenate([np.empty((0, len(_READING))), *pieces])
    del pieces
    table = table[np.argsort(table[:, _READING.index("t_s")], kind="stable")]
    measured = table.shape[1] - int(np.isnan(table[:, -1]).all())  # columns: the last is left out where V_Vc was not
    return ExportTable("readings", _columns(dict(zip(_READING[:measured], table.T, strict=False))), _about(directory))


def _columns(values: Mapping[str, Iterable[Any]]) -> tuple[ExportColumn, ...]:
    import numpy as np  # noqa: PLC0415  # as above

    columns = []
    for name, given in values.items():
        array: Any = np.ascontiguousarray(given, dtype=np.float64)
        if name in _COUNTS:
            array = array.astype(np.int64)
        unit = next((unit for end, unit in _UNITS.items() if name.endswith(end)), "1")
        columns.append(ExportColumn(name, unit, _MEANINGS[name], array))
    return tuple(columns)


def _pieces(lines: Iterable[Mapping[str, Any]], began_s: float) -> Iterator[NDArray[np.float64]]:
    """Yield the readings of each step as rows; the table's readback is known when the step is done."""
    chunks: list[NDArray[np.float64]] = []
    for line in lines:
        if line.get("type") == "readings":
            chunks.append(_rows(line, line["readings"]))
        elif line.get("type") in ("step", "error"):
            result = line.get("result", {})
            done = [*chunks, _rows(line, own_readings(line)), *_records(line, result, began_s)]
            chunks = []
            table_deg_s = result.get("table_rate_deg_s")
            for piece in done:
                if table_deg_s is not None:
                    piece[:, 4] = table_deg_s
                yield piece
    yield from chunks  # the run was cut within the step


def _rows(line: Mapping[str, Any], readings: Sequence[Mapping[str, float]]) -> NDArray[np.float64]:
    """Return readings of a window as rows of the table."""
    return _table(
        line,
        [each["t_s"] for each in readings],
        [each["voltage_v"] for each in readings],
        [each.get("v_vc_v") for each in readings],
    )


def _records(line: Mapping[str, Any], result: Mapping[str, Any], began_s: float) -> Iterator[NDArray[np.float64]]:
    """Yield the lists of volts in a result: samples of a sine, of output and V_Vc, of V_Vc alone."""
    match line.get("result_kind"):
        case "SineResponse":  # nothing tells when each was taken but the interval, and when the step began
            volts = result["voltages_v"]
            times_s = [began_s + line["t_s"] + place * result["interval_s"] for place in range(len(volts))]
            yield _table(line, times_s, volts, [None] * len(volts))
        case "ModulatedRecord":
            for name, at in (("output_v", "output_t_s"), ("v_vc_v", "v_vc_t_s")):
                volts = result.get(name) or []
                times_s = [(result[at] or 0.0) + place * result["interval_s"] for place in range(len(volts))]
                nothing = [None] * len(volts)
                yield _table(line, times_s, *((volts, nothing) if name == "output_v" else (nothing, volts)))
        case "VvcMeasured":
            taken = result["v_vc"]
            yield _table(line, [each["t_s"] for each in taken], [None] * len(taken), [e["voltage_v"] for e in taken])


def _table(
    line: Mapping[str, Any], t_s: Sequence[float], volts: Sequence[float | None], v_vc_v: Sequence[float | None]
) -> NDArray[np.float64]:
    import numpy as np  # noqa: PLC0415  # as above

    step = line["step"]
    table = np.full((len(t_s), 8), np.nan)
    table[:, 0] = line["n"]
    table[:, 1] = step.get("step", 0)
    table[:, 2] = t_s
    table[:, 3] = volts
    for column, name in ((5, "rate_deg_s"), (6, "v_vc_v")):
        if isinstance(step.get(name), int | float):
            table[:, column] = step[name]
    table[:, 7] = v_vc_v
    return table


def _about(directory: RunDirectory) -> dict[str, str | float]:
    """Return the facts of the run by its record, each a text or a number."""
    header = read_header(directory.journal)
    amendments = amendments_at(directory.journal)
    metadata = amended(metadata_from(header), amendments).as_json()
    tags = {f"tag.{key}": value for key, value in metadata.pop("tags", {}).items()}
    equipment = [each.as_json() for each in equipment_of(header)]
    bench = header.get("bench", {})
    plain = {
        "run": directory.run,
        "procedure": header.get("procedure"),
        "title": header.get("title"),
        "started_utc": header.get("utc"),
        "bench": bench.get("name"),
        "simulated": str(header.get("simulated")).lower(),
        "seed": header.get("seed"),
        **metadata,
        **tags,
        **({"revision": len(amendments) + 1} if amendments else {}),
        **({"amended": "\n".join(each.words() for each in amendments)} if amendments else {}),
        **{f"laboratory.{key}": value for key, value in (bench.get("laboratory") or {}).items()},
        "equipment": msgspec.json.encode(equipment).decode(),
        "settings": msgspec.json.encode(header.get("settings")).decode(),
        "versions": msgspec.json.encode(header.get("versions")).decode(),
    }
    return {key: value for key, value in plain.items() if value is not None}
