"""Reads tables and logs from text files, without guessing, skipping or filling in values.

A line with the names of the columns, then a line for each reading. Commas, semicolons, tabs or spaces separate; with
any but the comma the decimals may have one. What stands before the names (``--skip``), names and units that a file
lacks, and which columns are meant are told by :class:`Layout`. Columns that nobody asks for may hold anything.

Numbers are read in pieces of some megabytes by NumPy, straight into one array. A piece with anything unusual in it is
read again cell by cell, and what cannot be read is told with its line and column.
"""

import csv
import io
import re
from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from textwrap import shorten
from typing import IO

import numpy as np
from msgspec import Struct
from msgspec.structs import force_setattr, replace

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.cells import (
    NO_VALUE,
    alike,
    clock_s,
    decimals,
    is_any_number,
    is_clock,
    is_day,
    is_number,
    is_number_or_unit,
    number,
    time_apart,
)
from vcfbench.analysis.column_names import ColumnName, column_name, unit_of, with_unit
from vcfbench.arguments import require_fields
from vcfbench.errors import ConfigError

_HEAD = 1 << 16
_PIECE = 1 << 20
_SAMPLE = 400
"""Lines that tell how decimals are written."""
_FORMULA = "=+-@"
"""First characters that spreadsheets take for a formula: names of columns go on into files that others open."""
_BRACKETS = "[](){} "
_UNITS = {"unit", "units", "einheit"}
"""Names of columns that have the unit of the one before."""
_END_OF_HEADER = "***End_of_Header***"
_COMMENTS = ("#", "%", "//")
_SEPARATORS = {"comma": ",", "semicolon": ";", "tab": "\t", "space": " ", ",": ",", ";": ";", "\t": "\t", " ": " "}
_DECIMALS = {"comma": ",", "point": ".", ",": ",", ".": "."}
_TWO_NUMBERS = re.compile(r"[\d.+-]+\s*([^\w\s.,+-])\s*[\d.+-]+")
_LATIN = b"\xb0\xb2\xb3\xb5\xb7\xba\xc4\xd6\xdc\xdf\xe4\xf6\xfc\xe9"
"""Bytes that stand in the names of columns of files in Latin-1: a degree sign, a micro."""
_LIKE_NUMBER = re.compile(r"[-+.,\u2212\u2013]?([\d.,]|nan|inf)", re.IGNORECASE)
_U_ALONE = re.compile(r"u[_ ]", re.IGNORECASE)
_CUT_OFF = re.compile(rb"[.eE+-]\s*$")


class Layout(Struct, frozen=True):
    """Properties of a file that it does not state itself; all may be left out.

    >>> layout = vcfbench.Layout(columns=("gz",), units={"gz": "mdps"}, time="none")
    >>> vcfbench.analyze_record("imu.csv", rate_hz=100.0, layout=layout).taken_as
    'a rate in mdps, 0.001 deg/s each'
    """

    columns: tuple[str, ...] = ()
    """Those that are meant, by name, the rate of a table first; of a file without names the names of all."""
    skip: int = 0
    """Lines before the one with the names."""
    units: dict[str, str] = {}
    """Units by column; under the name ``""`` that of the one that is analysed."""
    time: str | None = None
    """The column of times; ``"none"``: they are not looked at."""
    separator: str | None = None
    decimal: str | None = None
    rows: tuple[str, str] | None = None
    """A column and the word in it of the lines that are meant, where a file has those of several sensors."""

    def __post_init__(self) -> None:
        """Refuse words that mean nothing."""
        if isinstance(self.columns, list):
            force_setattr(self, "columns", tuple(self.columns))
        require_fields(self, *self.__struct_fields__)
        if self.rows is not None and len(self.rows) != 2:
            raise ConfigError(f"rows: expected a column and a word, got {self.rows!r}")
        for what, given, known in (("separator", self.separator, _SEPARATORS), ("decimal", self.decimal, _DECIMALS)):
            if given is not None and given not in known and (what == "decimal" or len(given) != 1):
                words = ", ".join(each for each in known if len(each) > 1)
                raise ConfigError(f"--{what}: expected one of {words}, or the sign itself, got {given!r}")


class Head(Struct, frozen=True):
    """The part of a file above its numbers, and the format of these."""

    file: str
    names: tuple[ColumnName, ...]
    sample: tuple[tuple[str, ...], ...]
    """Cells of the first lines of numbers."""
    line: int
    """Number of the first line of numbers, from 1."""
    offset: int
    """Byte at which it begins."""
    separator: str
    decimal_comma: bool
    thousands: bool
    """Whether the other sign is known to separate thousands."""
    given: bool = False
    """Whether a person gave the names, of which the file has none."""
    only: tuple[int, str] | None = None
    """The column, and the word in it, of the lines that are read."""

    def place(self, name: str) -> int:
        """Return which column has a name; raises ConfigError where none has it, or several."""
        found = [place for place, each in enumerate(self.names) if each.written == name]
        if len(found) != 1:
            known = ", ".join(each.written for each in self.names)
            which = f"has no column {name!r}, only {known}" if not found else f"has {len(found)} columns {name!r}"
            raise ConfigError(
                f"{self.file} {which}", hint="--columns with a new name for each column" if found else None
            )
        return found[0]

    def asked(self, layout: Layout) -> tuple[str, ...]:
        """Return the columns that were asked for by name; none where the names are those of all."""
        return () if layout.columns == tuple(each.written for each in self.names) else layout.columns

    def selects(self, layout: Layout) -> bool:
        """Return True if a person said which columns a table has."""
        return len(layout.columns) > 1 and not self.given

    def is_text(self, place: int) -> bool:
        """Return True if none of the first cells of a column begins as a number does, or they are dates."""
        cells = [row[place] for row in self.sample]
        return bool(cells) and (is_day(cells[0]) or not any(map(_LIKE_NUMBER.match, cells)))

    def is_clock(self, place: int) -> bool:
        """Return True if the first cell of a column is a date with a time, or a time of day."""
        return bool(self.sample) and is_clock(self.sample[0][place])


class Numbers(Struct, frozen=True):
    """Numbers of some columns, (lines, columns), and their lines in the file."""

    values: Floats
    first_line: int
    dropped: tuple[int, ...]
    """Rows before which a line stood that is not read, a comment or another sensor's, once for each."""

    def line(self, row: int) -> int:
        """Return the line of a row in the file."""
        return self.first_line + row + bisect_right(self.dropped, row)


def read_head(file: IO[bytes], name: str, layout: Layout) -> Head:
    """Return the names of the columns of a file and how its numbers are written; `name` is the file's, for messages.

    Raises:
        ConfigError: one sentence with file, line and the option that would tell what the file does not.
    """
    raw = file.read(_HEAD)
    lines = raw.split(b"\n")
    if len(raw) == _HEAD and len(lines) > 1:
        lines.pop()  # not whole
    texts = [_decoded(each, f"{name}, line {at}", at) for at, each in enumerate(lines, 1)]
    at, separator, comment = _first_row(texts, layout)
    if at >= len(texts):
        found = "has comments alone" if comment else "is empty"
        raise ConfigError(f"{name}: the file {found}; the first line must be the header, rate_deg_s,...")
    if "\r" in texts[at].rstrip("\r"):
        raise ConfigError(f"{name}: its lines end with a carriage return alone; save it with line feeds")
    separator = separator or _separator(texts[at], "".join(texts[at + 1 : at + 2]))
    first = _cells(texts[at], separator)
    header, at = _header(texts, at, separator, comment, layout, f"{name}, line {at + 1}")
    given = bool(layout.columns) and list(layout.columns) == list(header) != first
    names = _spreads_beside([column_name(cell) for cell in header], layout)
    if at < len(texts) and (units := _unit_row(_cells(texts[at], separator), names)):
        names = [_with_unit(each, unit, f"{name}, line {at + 1}") for each, unit in zip(names, units, strict=True)]
        at += 1
    while at < len(texts) - 1 and not texts[at].strip():  # above all numbers a blank line hides none
        at += 1
    for column, unit in layout.units.items():
        if column and column not in header:
            raise ConfigError(f"--unit {column}={unit}: {name} has no such column, only {', '.join(header)}")
    names = [with_unit(each, layout.units[each.written]) if each.written in layout.units else each for each in names]
    sample = [_cells(text, separator) for text in texts[at : at + _SAMPLE]]
    full = tuple(tuple(row) for row in sample if len(row) == len(header))
    names = units_beside(names, full, f"{name}, line {at + 1}")
    two = _TWO_NUMBERS.fullmatch(full[0][0]) if full and len(header) == 1 else None
    if two and two[1] in header[0]:
        raise ConfigError(f"{name}: {full[0][0]!r} is not a number", hint=f"--separator '{two[1]}'")
    stated = None if layout.decimal is None else _DECIMALS[layout.decimal]
    comma, thousands = decimals(full, separator, stated, f"{name}, line {at + 1}")
    before = sum(len(each) + 1 for each in lines[:at])
    head = Head(name, tuple(names), full, at + 1, before, separator, comma, thousands, given)
    if layout.rows is None:
        return head
    column, word = layout.rows
    place = head.place(column)
    return replace(head, only=(place, word), sample=tuple(row for row in full if row[place] == word))


def _spreads_beside(names: Sequence[ColumnName], layout: Layout) -> list[ColumnName]:
    """Return the names in which a u stands for an uncertainty only beside its column: alone it is a voltage.

    So is one that a person asks for.
    """
    asked = () if layout.columns == tuple(each.written for each in names) else layout.columns
    bases = {each.base for each in names if not each.spread}
    taken = [
        each.written
        for each in names
        if each.spread and (each.written in asked or (_U_ALONE.match(each.written) and each.base not in bases))
    ]
    return [column_name(each.written, spreads=each.written not in taken) for each in names]


def units_beside(names: Sequence[ColumnName], rows: Sequence[Sequence[str]], where: str) -> list[ColumnName]:
    """Return the names with the units that stand in a column of units behind theirs, as multimeters write them."""
    found = list(names)
    for place in range(1, len(found) if rows else 0):
        words, before = {row[place] for row in rows}, found[place - 1]
        unit = unit_of(words.pop()) if found[place].base in _UNITS and len(words) == 1 else None
        if unit is not None and before.kind in {None, unit.kind}:
            found[place - 1] = _with_unit(before, unit.written, where)
    return found


def _first_row(texts: Sequence[str], layout: Layout) -> tuple[int, str | None, str]:
    """Return the first line that is no comment, the separator if one is told, and the last comment before it."""
    separator, comment = _SEPARATORS.get(layout.separator or "", layout.separator), ""
    for at in range(layout.skip, len(texts)):
        text = texts[at].strip()
        if text.startswith("sep=") and len(texts[at].rstrip("\r")) == 5:
            separator = separator or texts[at][4]
        elif text.startswith(_COMMENTS):
            comment = text.lstrip("#%/ ")
        elif text:
            return at, separator, comment
    return len(texts), separator, comment


def _header(  # noqa: PLR0917
    texts: Sequence[str], at: int, separator: str, comment: str, layout: Layout, where: str
) -> tuple[Sequence[str], int]:
    """Return the names of the columns, and the first line below them."""
    first = re.sub(r"\s+(?=[\[(])", "_", texts[at]) if separator == " " else texts[at]
    header, below = _cells(first, separator, where), _cells("".join(texts[at + 1 : at + 2]), separator)
    header = header[:-1] if header[-1:] == ["Comment"] and len(below) == len(header) - 1 else header  # LabVIEW's
    usual = Counter(len(_cells(text, separator)) for text in texts[at + 1 : at + _SAMPLE] if text.strip())
    numbers = any(map(is_any_number, header))
    beside = len(below) != len(header) or (not numbers and not any(map(is_number_or_unit, below)))
    named = not numbers and below and len({*header}) != len(below) == len(layout.columns)
    unlike = (
        beside
        or any(text.startswith(_END_OF_HEADER) for text in texts[at:])
        or (usual and usual.most_common(1)[0][0] != len(header))
    )
    if not named and unlike and (skipped := _preface(texts, at, separator)) is not None:
        raise ConfigError(f"{where}: expected the names of the columns above the numbers", hint=f"--skip {skipped}")
    if named:  # a name for each column, of which there were none, or doubled ones
        header = list(layout.columns)
    elif not numbers and at + 1 < len(texts) and alike(texts[at], texts[at + 1]):
        words = shorten(texts[at], 40)
        raise ConfigError(f"{where}: expected names above numbers alone, got {words!r}, as in the line below")
    elif numbers:
        names = _cells(comment, separator)
        if len(names) != len(header):
            names = list(layout.columns)
        if len(names) != len(header):
            raise ConfigError(
                f"{where}: expected the names of the columns, got numbers",
                hint=f"--columns with a name and unit for each of the {len(header)} columns",
            )
        header, at = names, at - 1
    for column, title in enumerate(header, 1):
        if title and (title[0] in _FORMULA or not title.isprintable()):
            raise ConfigError(
                f"{where}, column {column}: {shorten(ascii(title), 40)} is a spreadsheet formula or not printable",
                hint="rename the column",
            )
    return header, at + 1


def read_numbers(
    file: IO[bytes], head: Head, places: Sequence[int], progress: Callable[[float], None] | None = None
) -> Numbers:
    """Return the columns at `places`, one line a reading; a column of ISO dates in seconds.

    `progress` is told the part that is read.

    Raises:
        ConfigError: one sentence with file, line and column, for anything that is not a complete table of numbers.
    """
    file.seek(0, io.SEEK_END)
    left = max(1, file.tell() - head.offset)
    file.seek(head.offset)
    dates = any(map(head.is_clock, places))
    values = np.empty((0, len(places)))
    filled, line, blank, dropped = 0, head.line, 0, list[int]()
    for raw in _pieces(file):
        lines = raw.count(b"\n")
        body = raw.rstrip(b" \r\n")
        found = None if dates or blank or head.only else _plain(body, head, places)
        if found is None:
            found, more, blank = _cell_by_cell(raw, head, places, line, blank)
            dropped += [filled + row for row in more]
        else:
            blank = line + body.count(b"\n") + 1 if lines > body.count(b"\n") + 1 else 0
        line += lines
        if not lines and len(head.names) - 1 in places and _CUT_OFF.search(raw):
            raise ConfigError(f"{head.file}, line {line}: the file ends within a number")
        if filled + len(found) > len(values):
            room = filled + len(found)
            if not filled:  # as many lines a byte further on; memory that is never written costs nothing
                room = max(room, int(1.02 * len(found) * left / len(raw)))
            values.resize((max(room, len(values)), len(places)), refcheck=False)
        values[filled : filled + len(found)] = found
        filled += len(found)
        if progress:
            progress((file.tell() - head.offset) / left)
    if head.only and not filled:
        raise ConfigError(
            f"{head.file}, column {head.names[head.only[0]].written}: no line has {head.only[1]!r}",
            hint="--rows with a word as it stands there",
        )
    values.resize((filled, len(places)), refcheck=False)
    return Numbers(values, head.line, tuple(dropped))


def _pieces(file: IO[bytes]) -> Iterator[bytes]:
    """Yield a file in pieces of whole lines."""
    rest = b""
    while piece := file.read(_PIECE):
        whole, newline, after = piece.rpartition(b"\n")
        if newline:
            yield rest + whole + newline
            rest = after
        else:
            rest += piece
    if rest:
        yield rest


def _plain(body: bytes, head: Head, places: Sequence[int]) -> Floats | None:
    """Return the numbers of a piece without anything unusual; None where there is something."""
    if any(sign in body for sign in (b'"', b"#", b"%", b"//", b"\0")) or not body:
        return None
    if head.separator == " ":
        body = re.sub(rb"[ \t]+", b" ", re.sub(rb"(?m)^[ \t]+|[ \t\r]+$", b"", body))
    lines = _linesalike(body, head)
    if not lines:
        return None
    if head.decimal_comma:
        if b"." in body:
            return None
        body = body.replace(b",", b".")
    try:
        found = _all_numbers(body, head, lines)[:, list(places)]
    except (ValueError, DeprecationWarning):  # of old and new NumPy: a column that holds something else
        try:
            text = io.TextIOWrapper(io.BytesIO(body), "ascii")
            found = np.loadtxt(text, delimiter=head.separator, usecols=list(places), ndmin=2, comments=None)
        except ValueError:
            return None
    largest = max(float(found.max()), -float(found.min()))  # NaN stays one
    return found if largest < NO_VALUE and len(found) == lines else None


def _linesalike(body: bytes, head: Head) -> int:
    """Return the number of lines; 0 if one is blank or has another number of cells than the names."""
    signs = np.frombuffer(body, np.uint8)
    ends = np.append(np.flatnonzero(signs == ord("\n")), signs.size)
    if (np.diff(ends, prepend=-1) <= 1).any():
        return 0
    if len(head.names) == 1:
        return 0 if head.separator.encode() in body else ends.size
    cells = np.searchsorted(np.flatnonzero(signs == ord(head.separator)), ends)
    return 0 if (np.diff(cells, prepend=0) != len(head.names) - 1).any() else ends.size


def _all_numbers(body: bytes, head: Head, lines: int) -> Floats:
    """Return the numbers of all columns, (lines, columns): a third faster than by lines. ValueError: they are not all.

    Between numbers NumPy takes any blanks for none, so their count tells whether a cell was empty.
    """
    flat = body if len(head.names) == 1 else body.replace(b"\n", head.separator.encode())
    return np.fromstring(flat, sep="\n" if flat is body else head.separator).reshape(lines, len(head.names))


def _cell_by_cell(
    raw: bytes, head: Head, places: Sequence[int], line: int, blank: int
) -> tuple[Floats, list[int], int]:
    """Return the numbers of a piece, the rows before which others stood, and the line of a blank one at its end."""
    rows, dropped, dates = list[list[float]](), list[int](), {place for place in places if head.is_clock(place)}
    comma = head.decimal_comma
    for at, each in enumerate(raw.removesuffix(b"\n").split(b"\n"), line):
        where = f"{head.file}, line {at}"
        text = _decoded(each, where, at).strip(" \r\n" if head.separator == "\t" else None)
        if not text:
            blank = blank or at
            continue
        if text.startswith(_COMMENTS):
            dropped.append(len(rows))
            continue
        if blank:
            raise ConfigError(f"{head.file}, line {blank}: the line is empty", hint="take it out")
        cells = _cells(text, head.separator, where)
        if head.only is not None and cells[head.only[0] : head.only[0] + 1] != [head.only[1]]:
            dropped.append(len(rows))
            continue
        if len(cells) != len(head.names):
            hint = "; are there decimal commas?" if len(cells) > len(head.names) else ""
            raise ConfigError(
                f"{where}: {len(head.names)} columns expected, got {len(cells)}, {shorten(text, 40)!r}{hint}"
            )
        here = [(cells[place], f"{where}, column {head.names[place].written}", place in dates) for place in places]
        rows.append(
            [
                clock_s(cell, at_) if date else number(cell, at_, decimal_comma=comma, thousands=head.thousands)
                for cell, at_, date in here
            ]
        )
    return np.array(rows, np.float64).reshape(-1, len(places)), dropped, blank


def _decoded(raw: bytes, where: str, line: int) -> str:
    """Return a line of text in UTF-8, with or without byte order mark; names of columns may have signs of Latin-1."""
    if b"\0" in raw and not raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise ConfigError(f"{where}: this is not a text file")
    try:
        text = raw.decode("utf-8-sig" if line == 1 else "utf-8")
        return time_apart(text) if " -> " in text else text
    except UnicodeDecodeError as error:
        foreign = raw.translate(None, bytes(range(0x80)))
        if line <= 2 and re.search(rb"[A-Za-z]{2}", raw) and not foreign.strip(_LATIN):
            return raw.decode("latin-1")
        raise ConfigError(f"{where}: this is not UTF-8 text; save the table as UTF-8 CSV") from error


def _separator(header: str, below: str) -> str:
    for sign in ("\t", ";", ","):
        if sign in header:
            return sign
    numbers = below.split()
    if len(numbers) > 1 and all(is_number(each) or is_clock(each) for each in numbers):
        return " "
    return ";" if ";" in below else ","


def _cells(text: str, separator: str, where: str | None = None) -> list[str]:
    """Return the cells of a line; of one that is no CSV the whole, or a ConfigError with where it stands."""
    if separator == " ":
        return text.split()
    if '"' in text:
        try:
            return [cell.strip() for cell in next(csv.reader([text.strip()], delimiter=separator, strict=True), [])]
        except csv.Error as error:
            if where is None:
                return [text]
            raise ConfigError(f"{where}: this is not CSV: {error}") from error
    return [cell.strip() for cell in text.strip("\r\n").split(separator)] if text.strip() else []


def _preface(texts: Sequence[str], at: int, separator: str) -> int | None:
    """Return the number of lines that stand before one of names that has numbers below it, None if none is found."""
    if ended := [place for place in range(at, len(texts)) if texts[place].startswith(_END_OF_HEADER)]:
        plain = [bool(text.strip()) and not text.strip("0123456789.,;+-eE \t\r") for text in texts]
        above = [place + 1 for place in ended if plain[place + 2 : place + 3] == [True]]
        return None if plain[at + 1 : at + 2] == [True] else [*above, ended[-1] + 1][0]  # the first of several
    for place in range(at + 1, min(len(texts) - 1, at + 60)):
        for sign in dict.fromkeys((separator, ",", ";", "\t")):
            names, numbers = _cells(texts[place], sign), _cells(texts[place + 1], sign)
            named = len(names) == len(numbers) and not any(map(is_any_number, names))
            after = _cells("".join(texts[place + 2 : place + 3]), sign) or numbers
            if named and all(sum(map(is_any_number, row)) * 3 > len(row) for row in (numbers, after)):
                return place
    return None


def _unit_row(cells: Sequence[str], names: Sequence[ColumnName]) -> list[str] | None:
    """Return the units in a line of their own below the names, None if the line is none."""
    bare = [cell.strip(_BRACKETS) for cell in cells]
    if len(bare) != len(names) or any(map(is_number, bare)) or not any(map(unit_of, bare)):
        return None
    return bare if all(not cell or cell == "-" or unit_of(cell) for cell in bare) else None


def _with_unit(name: ColumnName, written: str, where: str) -> ColumnName:
    unit = unit_of(written)
    if unit is None:
        return name
    if name.unit is not None and (name.unit.kind, name.unit.factor) != (unit.kind, unit.factor):
        raise ConfigError(f"{where}, column {name.written}: the name says {name.unit.written}, this line {written}")
    return replace(name, unit=unit, unknown="")
