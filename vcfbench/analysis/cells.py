"""Cells of tables and logs as numbers and times; what may be read in two ways is asked about."""

import math
import re
from collections.abc import Sequence
from contextlib import suppress
from datetime import datetime
from textwrap import shorten

from vcfbench.analysis.column_names import unit_of
from vcfbench.errors import ConfigError

NO_VALUE = 9.9e37 * (1.0 - 1e-9)
"""From this magnitude on a number is an instrument's word for none (SCPI-99 vol. 1, 7.2.1.4: 9.9E37, 9.91E37)."""

_DAY_S = 86400.0
_OR_POINT = "--decimal comma, or point"
_TAKE_OUT = "take the line out, if times tell of the gap"
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_WITH_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?", re.ASCII)
_THOUSANDS = {
    ",": re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+(\.\d*)?", re.ASCII),
    ".": re.compile(r"[+-]?[1-9]\d{0,2}(\.\d{3})+(,\d*)?", re.ASCII),
}
"""Numbers of which the sign may separate thousands."""
_FORTRAN = re.compile(r"[+-]?\d*\.?\d+[dD][+-]?\d+", re.ASCII)
_WITH_UNIT = re.compile(r"[+-]?[\d.,]+(?:[eE][+-]?\d+)?\s*([^\d\s.,+-].*)")
_HEX = re.compile(r"0x[0-9a-f]+|(?=\d*[a-f])[0-9a-f]{4,8}|(?=\d*[a-f])[0-9a-f]+h", re.IGNORECASE | re.ASCII)
_CLOCK = re.compile(
    r"(?:(\S*\d[./-]\S*\d)[T ,]+)?(\d{1,2}):(\d\d)(?::(\d\d)(?:[.,:](\d+))?|[.,](\d+))?(?:\s?([ap])\.?m\.?)?"
    r"(?:\s?(?:Z|UTC|[+-]\d\d:?\d\d))?",
    re.IGNORECASE | re.ASCII,
)
"""Date, hours, minutes, seconds and their fraction; without seconds a fraction makes minutes and seconds of the two."""
_NO_NUMBER = re.compile(r"[-+]?[^\W\d_]|[-+]?1?\.?#|[^\d(]*$")
"""Cells that have no value: words, dashes, 1.#QNAN, #N/A."""
_DAY = re.compile(r"\d{1,4}[-./]\d{1,2}[-./]\d{1,4}", re.ASCII)
_MONITOR = re.compile(r"(\d\d:\d\d:\d\d\.\d{3}) -> (\S[^\r\n]*)")
"""A line of the Arduino's serial monitor with its time."""
_ISO = re.compile(r"\d{4}-\d\d-\d\d[T ].*")


def is_number(cell: str) -> bool:
    """Return True for a number with a decimal point, or none."""
    return _NUMBER.fullmatch(cell) is not None


def is_any_number(cell: str) -> bool:
    """Return True for a number with a decimal point, or a comma."""
    return is_number(cell) or _WITH_COMMA.fullmatch(cell) is not None


def is_number_or_unit(cell: str) -> bool:
    """Return True for a cell that may stand below the name of a column: a number, or its unit, in brackets or not."""
    return is_any_number(cell) or unit_of(cell.strip("[](){} ")) is not None


def alike(first: str, second: str) -> bool:
    """Return True if two lines differ in their digits alone."""
    bare, other = (re.sub(r"-?\d+", "0", text) for text in (first, second))
    return bare == other and first != second


def is_clock(cell: str) -> bool:
    """Return True for a time of day, with a date before it or not."""
    return _CLOCK.fullmatch(cell) is not None


def is_day(cell: str) -> bool:
    """Return True for a date without a time."""
    return _DAY.fullmatch(cell) is not None


def clock_period_s(cell: str) -> float | None:
    """Return after which time such cells begin anew, half a day or an hour; None for ISO dates.

    A date in another form has no certain order of day and month, so the time of day alone is read.
    """
    found = _CLOCK.fullmatch(cell)
    if found is None or _ISO.fullmatch(cell):
        return None
    return 3600.0 if found[6] else 0.5 * _DAY_S


def fraction_digits(cell: str) -> int:
    """Return the number of digits behind the second of a time."""
    found = _CLOCK.fullmatch(cell)
    return len((found[5] or found[6] or "") if found else "")


def clock_s(cell: str, where: str) -> float:
    """Return a time in s, from a midnight of which only differences count."""
    found, when = _CLOCK.fullmatch(cell), None
    if found is not None and _ISO.fullmatch(cell):
        with suppress(ValueError):
            when = datetime.fromisoformat(cell)
    if found is None or (when is None and _ISO.fullmatch(cell)):
        raise ConfigError(
            f"{where}: expected a date such as 2026-11-29T10:00:00.5, or a time of day, got {shorten(cell, 40)!r}"
        )
    if when is not None:
        apart = when.replace(tzinfo=None) - datetime(2000, 1, 1)  # noqa: DTZ001  # differences alone count
        shift_s = offset.total_seconds() if (offset := when.utcoffset()) is not None else 0.0
        return apart.days * _DAY_S + apart.seconds + apart.microseconds * 1e-6 - shift_s
    hours, minutes, seconds = int(found[2]), int(found[3]), int(found[4] or 0)
    if found[6]:
        hours, minutes, seconds = 0, hours, minutes
    if half := found[7]:
        hours = hours % 12 + (12 if half.lower() == "p" else 0)
    return 3600.0 * hours + 60.0 * minutes + seconds + float(f"0.{found[5] or found[6] or 0}")


def time_apart(text: str) -> str:
    """Return a line of a serial monitor with its time as one more column; any other as it is."""
    found = _MONITOR.search(text)
    if found is None:
        return text
    sign = next((each for each in "\t;, " if each in found[2]), ",")
    return f"{text[: found.start()]}{found[1]}{sign}{found[2]}{text[found.end() :]}"


def decimals(rows: Sequence[Sequence[str]], separator: str, stated: str | None, where: str) -> tuple[bool, bool]:
    """Return whether decimals stand behind a comma, and whether the other sign is known to separate thousands.

    `stated` is the sign that a person told. Numbers that may have decimals or thousands are refused.
    """
    if stated is not None or separator == ",":
        return stated == ",", stated == "," or (stated == "." and separator != ",")
    cells = [cell for row in rows for cell in row]
    commas = [cell for cell in cells if _WITH_COMMA.fullmatch(cell) or _THOUSANDS[","].fullmatch(cell)]
    if any(_sure(cell, ",") for cell in commas):
        return False, True
    # Points of thousands alone: below a thousand a number of such a column has none
    whole = [column for column in zip(*rows, strict=False) if any(cell.lstrip("+-").isdecimal() for cell in column)]
    pointed = [[cell for cell in column if "." in cell] for column in whole]
    points = next((each[0] for each in pointed if each and all(map(_THOUSANDS["."].fullmatch, each))), "")
    if not commas and any(_sure(cell, ".") for cell in cells):
        return True, True
    if points and not all(_THOUSANDS[","].fullmatch(cell) for cell in commas):
        return True, True
    if points or (commas and all(_THOUSANDS[","].fullmatch(cell) for cell in commas)):
        sign = "point" if points else "comma"
        raise ConfigError(
            f"{where}: {points or commas[0]!r} may be a decimal {sign}, or one of thousands", hint=_OR_POINT
        )
    return bool(commas), False


def _sure(cell: str, sign: str) -> bool:
    """Return True for a number in which the sign can but separate thousands."""
    found = _THOUSANDS[sign].fullmatch(cell)
    return found is not None and (found[2] is not None or cell.count(sign) > 1)


def number(cell: str, where: str, *, decimal_comma: bool, thousands: bool) -> float:
    """Return the number of a cell; raises ConfigError with what stands there, and what would cure it."""
    shown, sign, other = shorten(cell, 40), *((",", ".") if decimal_comma else (".", ","))
    text = cell.replace(",", ".") if decimal_comma and "." not in cell else cell
    if other in cell and (_sure(cell, other) or (thousands and _THOUSANDS[other].fullmatch(cell))):
        text = cell.replace(other, "").replace(sign, ".")
    elif decimal_comma and _THOUSANDS["."].fullmatch(cell):
        raise ConfigError(f"{where}: {shown!r} has a point of thousands, or a decimal one", hint=_OR_POINT)
    elif _FORTRAN.fullmatch(text):
        text = text.lower().replace("d", "e")
    if not _NUMBER.fullmatch(text):
        word = _NO_NUMBER.match(cell) and not _HEX.fullmatch(cell)
        hint = _OR_POINT if "," in cell else _TAKE_OUT if not cell or word else None
        raise ConfigError(f"{where}: {_fault(cell, shown)}", hint=hint)
    value = float(text)
    if not math.isfinite(value):
        raise ConfigError(f"{where}: {shown} is too large for a number")
    if abs(value) >= NO_VALUE:
        came = f"{shown} is an instrument's word for overload, not a measured value"
        raise ConfigError(f"{where}: {came}", hint=_TAKE_OUT)
    return value


def _fault(cell: str, shown: str) -> str:
    if not cell:
        return "the value is missing"
    if cell.lower().lstrip("+-") in {"nan", "inf", "infinity"}:
        return f"{shown} is not a measured value"
    if "\N{MINUS SIGN}" in cell or "\N{EN DASH}" in cell:
        return f"{shown!r} has a typographic minus sign; write it with a hyphen"
    if "," in cell:
        meant = "a comma of thousands, or a decimal one" if _THOUSANDS[","].fullmatch(cell) else "a decimal comma"
        return f"{shown!r} has {meant}; write a point, or no separator"
    hexadecimal = _HEX.fullmatch(cell)
    if not hexadecimal and (found := _WITH_UNIT.fullmatch(cell)) and unit_of(found[1]):
        return f"{shown!r} is not a number; write its unit {found[1]} into the name of the column"
    rest = ", but hexadecimal: write counts as decimals, with their sign" if hexadecimal else ""
    return f"{shown!r} is not a number{rest}"
