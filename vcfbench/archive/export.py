"""A run for other programs: its points or every raw reading, a column a quantity, with the facts of its record."""

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

import msgspec
from msgspec import Struct

from vcfbench.archive.recorded import directory_of
from vcfbench.archive.results import of_several
from vcfbench.archive.run import Run
from vcfbench.archive.summary import summary_of
from vcfbench.errors import ConfigError
from vcfbench.files import replaced, shown
from vcfbench.records.amendments import amended, amendments_at
from vcfbench.records.directory import RunDirectory
from vcfbench.records.journal import read_header
from vcfbench.records.metadata import equipment_of, metadata_from
from vcfbench.records.outline import outline_of

FORMATS: Final = ("csv", "parquet", "hdf5", "xlsx", "mat")
_SUFFIXES: Final = {".h5": "hdf5", **{f".{each}": each for each in FORMATS}}


class Exported(Struct, frozen=True):
    """Written export: the file, its format, its table, its columns and the number of rows.

    >>> vcfbench.export_run(run, "points.csv").rows
    3
    """

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
        ConfigError: there is no such record, it is damaged or of several devices, the format is unknown or needs the
            extra ``export``, the table is too long for it, or the file cannot be written.

    >>> vcfbench.export_run("last", "points.csv").columns
    ('step', 'rate_deg_s', 'v_vc_v', 'output_v', 'std_v', 'n')
    """
    where = run.directory if isinstance(run, Run) else run
    if where is None:
        raise ConfigError("the run has no record to export")
    directory = directory_of(where, runs)
    if outline_of(directory.journal) is None and (damage := directory.read().damage) is not None:
        raise ConfigError(f"{shown(directory.journal)}: the record is damaged, so it is not exported: {damage}")
    if (several := of_several(read_header(directory.journal))) is not None:
        raise ConfigError(f"{directory.run} is not exported: {several}")
    if format is not None and format not in FORMATS:
        raise ConfigError(f"format: expected one of {', '.join(FORMATS)}, got {format!r}")
    written_as = format or (None if file is None else _SUFFIXES.get(Path(file).suffix.lower()))
    if written_as is None:
        raise ConfigError(f"which format is not known: expected one of {', '.join(FORMATS)}", hint="--format FORMAT")
    from vcfbench.archive.export_formats import WRITERS, ExportTable, points, readings  # noqa: PLC0415  # loads numpy

    columns = (readings if raw else points)(directory.journal)
    table = ExportTable("readings" if raw else "points", columns, _about(directory), progress)
    path = Path(f"{directory.run}-{table.name}.{written_as}" if file is None else file)
    with replaced(path) as draft:
        WRITERS[written_as](table, draft)
    return Exported(path, written_as, table.name, tuple(each.name for each in table.columns), table.rows)


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
        "simulated": header.get("simulated"),
        "seed": header.get("seed"),
        **metadata,
        **tags,
        **({"revision": len(amendments) + 1} if amendments else {}),
        **({"amended": "\n".join(each.words() for each in amendments)} if amendments else {}),
        **{f"laboratory.{key}": value for key, value in (bench.get("laboratory") or {}).items()},
        "equipment": msgspec.json.encode(equipment).decode(),
        "settings": msgspec.json.encode(header.get("settings")).decode(),
        "versions": msgspec.json.encode(header.get("versions")).decode(),
        **dict(_stated(directory)),
    }
    return {key: value for key, value in plain.items() if value is not None}


def _stated(directory: RunDirectory) -> Iterator[tuple[str, str | float]]:
    """Yield the stated values, in SI units: numbers, nan where there is none; of a bound its ends are what is said."""
    for name, each in summary_of(directory).results.items():
        low, high = each.ends
        numbers = {"": each.value, ".u": each.u, ".u95": each.u95, ".low": low, ".high": high}
        for key, number in numbers.items():
            yield f"value.{name}{key}", math.nan if number is None else number
        yield f"value.{name}.unit", each.unit
        yield f"value.{name}.form", each.form
        yield f"value.{name}.missing", ", ".join(each.missing)
