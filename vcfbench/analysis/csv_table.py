"""Strict reading of calibration tables kept as CSV text: nothing is guessed, skipped or filled in.

Two layouts are read: a table whose first column is ``rate_deg_s`` and whose other columns are outputs in volts, and the
``points.csv`` of a vcfbench record, which has one line a point.
"""

import csv
import io
import math
import re
from textwrap import shorten

from msgspec import Struct

from vcfbench.errors import ConfigError

RATE_COLUMN = "rate_deg_s"
POINT_COLUMNS = ("step", "rate_deg_s", "v_vc_v", "output_v", "std_v", "n")
"""Header of a record's ``points.csv``."""

V_VC_COLUMNS = ("v_vc_measured_v", "v_vc_std_v")
"""Optional columns, present when V_Vc was measured; empty cells at a point without."""

_SERIES_OF_STEP = {3: "turntable", 4: "virtual"}
_FEWEST_POINTS = 3
_FORMULA = "=+-@"
"""First characters that spreadsheets take for a formula: names of columns go on into files that others open."""
_OVERLOAD = 9.9e37
"""Reading of a SCPI instrument that cannot measure (overload)."""
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+", re.ASCII)


class Series(Struct, frozen=True):
    """One output against the rate; `u_output_v` is the standard uncertainty of each output where the file tells it."""

    rate_deg_s: tuple[float, ...]
    output_v: tuple[float, ...]
    u_output_v: tuple[float, ...] | None = None


def decode(raw: bytes, name: str) -> str:
    """Return the text of a UTF-8 file, with or without byte order mark; raises ConfigError for anything else."""
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise ConfigError(f"{name}, line {line}: this is not UTF-8 text; save the table as UTF-8 CSV") from error
    if "\0" in text:
        raise ConfigError(f"{name}, line {text.count(chr(10), 0, text.index(chr(0))) + 1}: this is not a text file")
    return text


def parse_table(text: str, name: str) -> dict[str, Series]:
    """Return the series of a CSV table by column; `name` is the file's, for messages.

    Raises:
        ConfigError: one sentence with file, line and column, for anything that is not a complete table of numbers.
    """
    rows = _rows(text, name)
    if not rows:
        raise ConfigError(f"{name}: the file is empty; the first line must be the header, {RATE_COLUMN},...")
    header = _header(*rows[0])
    if header == (*POINT_COLUMNS, *V_VC_COLUMNS):
        rows, header = [rows[0], *(_set_point(*row) for row in rows[1:])], POINT_COLUMNS
    cells = [_values(*row, header) for row in rows[1:]]
    if header == POINT_COLUMNS:
        # A series for every step of a record that has enough points for a line
        groups: dict[float, list[tuple[float, ...]]] = {}
        for row in cells:
            groups.setdefault(row[0], []).append(row)
        series = {}
        for step, taken in sorted(groups.items()):
            _, rates, _, output, std, counts = zip(*taken, strict=True)
            if len(taken) >= _FEWEST_POINTS and len(set(rates)) > 1:
                u = tuple(s / math.sqrt(max(n, 1.0)) for s, n in zip(std, counts, strict=True))
                series[_SERIES_OF_STEP.get(int(step), f"step_{step:g}")] = Series(rates, output, u)
        if not series:
            raise ConfigError(f"{name}: no step has {_FEWEST_POINTS} points at different rates")
        return series
    if len(cells) < _FEWEST_POINTS:
        raise ConfigError(f"{name}: at least {_FEWEST_POINTS} points are needed, the file has {len(cells)}")
    rate, *outputs = zip(*cells, strict=True)
    if len(set(rate)) == 1:
        raise ConfigError(f"{name}, column {RATE_COLUMN}: every rate is {rate[0]:g}, so there is no scale factor")
    return {column: Series(rate, output) for column, output in zip(header[1:], outputs, strict=True)}


def parse_columns(text: str, name: str) -> dict[str, tuple[float, ...]]:
    """Return the columns of numbers of a CSV text by the names in its first line, one line a reading.

    Raises:
        ConfigError: one sentence with file, line and column, for anything that is not a complete table of numbers.
    """
    rows = _rows(text, name)
    if len(rows) < 2:
        raise ConfigError(f"{name}: expected a first line with the names of the columns, and a line for each reading")
    header = _named(*rows[0])
    cells = [_values(*row, header) for row in rows[1:]]
    return dict(zip(header, zip(*cells, strict=True), strict=True))


def _rows(text: str, name: str) -> list[tuple[str, list[str]]]:
    """Return the rows, each with where it stands; empty lines at the end do not count."""
    reader = csv.reader(io.StringIO(text.rstrip() + "\n" if text.strip() else ""), strict=True)
    try:
        return [(f"{name}, line {reader.line_num}", [cell.strip() for cell in row]) for row in reader]
    except csv.Error as error:
        raise ConfigError(f"{name}, line {reader.line_num}: this is not CSV: {error}") from error


def _header(where: str, header: list[str]) -> tuple[str, ...]:
    joined = "".join(header) if len(header) <= 1 else ""
    if word := "semicolons" if ";" in joined else "tabs" if "\t" in joined else "":
        raise ConfigError(f"{where}: the columns are separated by {word}; save with commas and decimal points")
    if tuple(header) in (POINT_COLUMNS, (*POINT_COLUMNS, *V_VC_COLUMNS)):
        return tuple(header)
    if not header or header[0] != RATE_COLUMN:
        first = header[0] if header else ""
        raise ConfigError(f"{where}, column 1: the header must begin with {RATE_COLUMN}, got {first!r}")
    if len(header) == 1:
        raise ConfigError(f"{where}: there is no output column beside {RATE_COLUMN}")
    return _named(where, header)


def _named(where: str, header: list[str]) -> tuple[str, ...]:
    """Return the names of the columns; refuse those that are missing, doubled or no names."""
    if any(_NUMBER.fullmatch(title) for title in header):
        raise ConfigError(f"{where}: expected the names of the columns, came numbers")
    for column, title in enumerate(header, 1):
        here = f"{where}, column {column}"
        if not title:
            raise ConfigError(f"{here}: the column has no name")
        if title[0] in _FORMULA or not title.isprintable():
            raise ConfigError(f"{here}: {shorten(ascii(title), 40)} is no name: it would act elsewhere")
        if title in header[: column - 1]:
            raise ConfigError(f"{here}: there is already a column {title}")
    return tuple(header)


def _set_point(where: str, row: list[str]) -> tuple[str, list[str]]:
    """Return a row without its measured V_Vc, to which no line is fitted: two numbers, or two empty cells."""
    columns, empty = (*POINT_COLUMNS, *V_VC_COLUMNS), row[len(POINT_COLUMNS) :] == ["", ""]
    _values(where, [cell or "0" for cell in row] if empty else row, columns)
    return where, row[: len(POINT_COLUMNS)]


def _values(where: str, row: list[str], header: tuple[str, ...]) -> tuple[float, ...]:
    if not row:
        raise ConfigError(f"{where}: the line is empty")
    if len(row) != len(header):
        hint = "; are there decimal commas?" if len(row) > len(header) else ""
        raise ConfigError(f"{where}: {len(header)} columns expected, got {len(row)}{hint}")
    return tuple(_number(cell, f"{where}, column {title}") for cell, title in zip(row, header, strict=True))


def _number(cell: str, where: str) -> float:
    shown = shorten(cell, 40)
    if not _NUMBER.fullmatch(cell):
        if not cell:
            raise ConfigError(f"{where}: the value is missing")
        if cell.lower().lstrip("+-") in {"nan", "inf", "infinity"}:
            raise ConfigError(f"{where}: {shown} is not a measured value")
        if "\N{MINUS SIGN}" in cell or "\N{EN DASH}" in cell:
            raise ConfigError(f"{where}: {shown!r} has a typographic minus sign; write it with a hyphen")
        if _DECIMAL_COMMA.fullmatch(cell):
            raise ConfigError(f"{where}: {shown!r} has a decimal comma; write it with a point")
        raise ConfigError(f"{where}: {shown!r} is not a number")
    value = float(cell)
    if not math.isfinite(value):
        raise ConfigError(f"{where}: {shown} is too large for a number")
    if math.isclose(abs(value), _OVERLOAD):
        raise ConfigError(f"{where}: {shown} is an instrument's word for overload, not a measured value")
    return value
