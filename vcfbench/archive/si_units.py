r"""Units of results in the notation of D-SI: ``V/(deg/s)`` is ``\volt\degree\tothe{-1}\second``.

Source: D-SI, Brochure of the Digital System of Units, SmartCom 2020: names behind backslashes, powers by ``\tothe``.
"""

import ast
import re
from typing import Final

_WORDS: Final = {
    "V": (1.0, r"\volt"),
    "mV": (1.0, r"\milli\volt"),
    "uV": (1.0, r"\micro\volt"),
    "A": (1.0, r"\ampere"),
    "mA": (1.0, r"\milli\ampere"),
    "W": (1.0, r"\watt"),
    "deg": (1.0, r"\degree"),
    "s": (1.0, r"\second"),
    "ms": (1.0, r"\milli\second"),
    "h": (1.0, r"\hour"),
    "min": (1.0, r"\minute"),
    "Hz": (1.0, r"\hertz"),
    "kHz": (1.0, r"\kilo\hertz"),
    "K": (1.0, r"\kelvin"),
    "degC": (1.0, r"\degreecelsius"),
    "percent": (1.0, r"\percent"),
    "ppm": (1e-6, ""),
    "LSB": (1.0, ""),
}
"""Factor of a value, and the name in D-SI, which has none for parts per million and steps of a converter."""


def in_si(unit: str) -> tuple[float, str] | None:
    """Return the factor of a value in `unit` and the unit it then has in D-SI; None for an unknown unit."""
    powers: dict[str, float] = {}
    try:
        written = ast.parse(
            re.sub(r"[ *]+", "*", unit.strip() or "1").replace("^", "**").replace("%", "percent"), mode="eval"
        )
        scale = _read(written.body, 1.0, powers)
    except (KeyError, SyntaxError, ValueError):
        return None
    words = [
        f"{word}\\tothe{{{power:g}}}" if power != 1.0 else word for word, power in powers.items() if word and power
    ]
    return scale, "".join(words) or r"\one"


def _read(written: ast.expr, power: float, powers: dict[str, float]) -> float:
    """Add the units of an expression to `powers`; return the factor of values; KeyError: it is of something else."""
    match written:
        case ast.BinOp(left, ast.Mult() | ast.Div() as sign, right):
            other = power if isinstance(sign, ast.Mult) else -power
            return _read(left, power, powers) * _read(right, other, powers)
        case ast.BinOp(left, ast.Pow(), exponent):
            return _read(left, power * int(ast.unparse(exponent)), powers)
        case ast.Call(ast.Name("sqrt"), [inside]):
            return _read(inside, power / 2.0, powers)
        case ast.Name(name):
            times, word = _WORDS[name]
            powers[word] = powers.get(word, 0.0) + power
            return float(times**power)
        case ast.Constant(1):
            return 1.0
    raise KeyError(ast.unparse(written))
