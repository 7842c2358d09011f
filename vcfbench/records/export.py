"""Exports of a journal: CSV files for other programs, and the result as one JSON object."""

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec

from vcfbench.errors import BenchError
from vcfbench.records.schema import PAUSE_COLUMNS, POINT_COLUMNS, V_VC_COLUMNS, Point


def point_columns(points: Sequence[Point]) -> tuple[str, ...]:
    """Return the columns that these points need."""
    measured = any(point.v_vc_measured_v is not None for point in points)
    columns = (*POINT_COLUMNS, *V_VC_COLUMNS) if measured else POINT_COLUMNS
    return (*columns, *PAUSE_COLUMNS) if any(point.moved_u_v for point in points) else columns


def points_csv(points: Sequence[Point]) -> str:
    """Return every point on a line of its own, full precision."""
    columns = point_columns(points)
    rows = (point.as_json() for point in points)
    lines = (",".join(repr(row[name]) if name in row else "" for name in columns) for row in rows)
    return "\n".join([",".join(columns), *lines, ""])


def result_text(values: Mapping[str, Any]) -> str:
    """Return the result as JSON for people: indented, keys in the order given, the same bytes for the same values."""
    return msgspec.json.format(msgspec.json.encode(values), indent=2).decode() + "\n"


def write_text(path: Path, text: str) -> None:
    """Write a derived file, complete or not at all, without changing newlines.

    That holds for a power cut too: its bytes are on the disk before its name is.

    Raises:
        BenchError: the file cannot be written; the journal is not concerned.
    """
    draft = path.with_name(f".{path.name}.part")
    try:
        draft.write_bytes(text.encode())
        with draft.open("r+b") as file:
            os.fsync(file.fileno())
        draft.replace(path)
    except OSError as error:
        with suppress(OSError):
            draft.unlink()
        raise BenchError(
            f"{path} cannot be written: {error.strerror}", hint="the journal is complete: free space, then export again"
        ) from error
