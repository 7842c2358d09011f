"""Digits of a value and its uncertainty in print (GUM 7.2.6): two of u, the value to the same place."""

import math
import re
from collections.abc import Sequence
from typing import Final

_SMALLEST_GROUPED = 1e-7  # Above that an uncertainty in words has none: its zeros stand in threes
_LARGEST_FIXED = 1e7  # Above that, too, where they have fewer digits
_SMALLEST_FIXED = 1e-4  # Below that numbers are printed with an exponent


def shorthand(value: float, u: float | None) -> str:
    """Return a value with its standard uncertainty in parentheses (GUM 7.2.2), digits in threes: ``-12.541 66(58)``.

    The parentheses hold u in units of the last digit; a u of 1 and more is written with its point.
    """
    if not u or not math.isfinite(u) or not math.isfinite(value):
        return in_threes(format(value, ".6g"))
    if second_digit(u) > 0:
        return f"{in_threes(f'{round(value, -second_digit(u)):z.0f}')}({in_digits(u, digits_of_u(u))})"
    figure, _, power = format(value, digits_of_value(value, u)).partition("e")
    if power and int(power) < second_digit(u):  # less than half a unit of the last digit of u
        figure, power = "0", f"{second_digit(u):03d}"
    places = -min(0, second_digit(u))  # 10.0**324 is beyond a double
    digits = format(u, ".1f") if places == 1 else f"{u * 10.0 ** min(places, 300) * 10.0 ** max(0, places - 300):.0f}"
    return f"{in_threes(figure)}({digits})" + (f"e{power}" if power else "")


def grouped(u: float) -> str:
    """Return an uncertainty in two digits, those in threes: ``0.000 59``, ``1200``."""
    fixed = _SMALLEST_GROUPED <= u < _SMALLEST_FIXED
    return in_threes(f"{u:.{-second_digit(u)}f}" if fixed else in_digits(u, digits_of_u(u)))


def in_digits(number: float, form: str) -> str:
    """Return a number by its format, one of 100 and more in few digits with zeros behind them: ``1200``."""
    figure = format(number, form)
    return format(float(figure), ".0f") if "e+" in figure and abs(number) < _LARGEST_FIXED else figure


def in_threes(figure: str) -> str:
    """Set spaces between groups of three digits where there are more than four on a side of the point (ISO 80000-1)."""
    whole, point, rest = figure.partition(".")
    if len(whole.lstrip("-+")) > 4 and "e" not in figure:
        whole = f"{int(whole):,}".replace(",", " ")
    if len(rest) > 4 and rest.isdigit():
        rest = " ".join(rest[place : place + 3] for place in range(0, len(rest), 3))
    return f"{whole}{point}{rest}"


_VOLTS: Final = re.compile(r"(?<=\d) V\b")


def in_unit(words: str, unit: str) -> str:
    """Return words about an output with its unit in place of volts, and without V_Vc where it is none."""
    return words if unit == "V" else _VOLTS.sub(f" {unit}", words.replace(", V_Vc +0 V", ""))


def incomplete(missing: Sequence[str]) -> str:
    """Say behind a value or a title which contributions its uncertainty lacks; nothing where none is missing."""
    return f"; INCOMPLETE without {', '.join(missing)}" if missing else ""


def digits_of_u(u: float) -> str:
    """Return the format, for :func:`in_digits`, of an uncertainty that has two digits, zeros too."""
    if not u:
        return ".2g"
    return ".0f" if second_digit(u) == 0 else "#.2g"


def digits_of_value(value: float, u: float) -> str:
    """Return the format, for :func:`in_digits`, of a value whose uncertainty is `u`; eight digits of one without."""
    if not u or not math.isfinite(u) or not math.isfinite(value):
        return ".8g"
    place = min(0, second_digit(u))
    if value and (digits := second_digit(value) + 2 - second_digit(u)) > 0 and second_digit(u) > 0:
        return f".{digits}g"
    if value and max(abs(value), u) < _SMALLEST_FIXED:
        return f".{max(0, math.floor(math.log10(abs(value))) - place)}e"
    return f"z.{-place}f"


def second_digit(u: float) -> int:
    """Return the power of ten of the second digit of `u` after rounding."""
    return int(f"{u:.1e}".partition("e")[2]) - 1 if u and math.isfinite(u) else 0
