r"""Units as results have them, in the words of D-SI: ``V/(deg/s)`` is ``\volt\degree\tothe{-1}\second``.

Source: D-SI, Brochure of the Digital System of Units, SmartCom 2020: names behind backslashes, powers by ``\tothe``.
"""

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
    "%": (1.0, r"\percent"),
    "1": (1.0, ""),
    "": (1.0, ""),
    "ppm": (1e-6, ""),
}
"""Factor of a value, and the name in D-SI, which has none for parts per million."""


def in_si(unit: str) -> tuple[float, str] | None:
    """Return the factor of a value in `unit` and the unit it then has in D-SI; None for an unknown unit."""
    powers: dict[str, float] = {}
    scale = _read(unit.strip(), 1.0, powers)
    parts = [
        word if power == 1.0 else f"{word}\\tothe{{{power:g}}}" for word, power in powers.items() if word and power
    ]
    return None if scale is None else (scale, "".join(parts) or r"\one")


def _read(text: str, sign: float, powers: dict[str, float]) -> float | None:
    """Add the units of `text`, to the power `sign`, to `powers`; return the factor of values."""
    scale = 1.0
    for place, part in enumerate(_split(text, "/")):
        for factor in _split(part, " *"):
            times = _factor(factor, sign if place == 0 else -sign, powers)
            if times is None:
                return None
            scale *= times
    return scale


def _factor(text: str, power: float, powers: dict[str, float]) -> float | None:
    """Add one unit, the units in brackets, or a root of them."""
    if text.startswith("sqrt(") and text.endswith(")"):
        return _read(text[5:-1], power / 2.0, powers)
    if text.startswith("(") and text.endswith(")"):
        return _read(text[1:-1], power, powers)
    name, _, exponent = text.partition("^")
    if name not in _WORDS or not re.fullmatch(r"|-?\d", exponent):
        return None
    times, word = _WORDS[name]
    total = power * float(exponent or 1)
    powers[word] = powers.get(word, 0.0) + total
    return float(times**total)


def _split(text: str, signs: str) -> list[str]:
    """Split at any of `signs` that stand in no brackets."""
    parts, depth = [""], 0
    for each in text:
        depth += (each == "(") - (each == ")")
        if each in signs and depth == 0:
            parts.append("")
        else:
            parts[-1] += each
    return [part for part in parts if part or len(parts) == 1]
