"""Reads typed messages: headers, paths, parameters, numbers with units.

It is stricter than instruments are (IEEE 488.2, 7.3 to 7.7; ACL manual, section 2): what it cannot read is refused,
never guessed.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

_HEADER = re.compile(r"\s*(:?)(\*?[A-Za-z][A-Za-z0-9_]*(?::[A-Za-z][A-Za-z0-9_]*)*)(\??)(?:\s+(.*?))?\s*", re.DOTALL)
_QUANTITY = re.compile(r"([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)\s*([A-Za-z]*)")
_OUTSIDE = re.compile(r"\"[^\"]*\"|'[^']*'|[;,]")
_STRING = re.compile(r"(?:\"[^\"]*\")+|(?:'[^']*')+")
_MNEMONIC = re.compile(r"([A-Z]+)([a-z]*)")

VOLT: Mapping[str, float] = MappingProxyType({"": 1.0, "V": 1.0, "MV": 1e-3, "UV": 1e-6, "KV": 1e3})
AMPERE: Mapping[str, float] = MappingProxyType({"": 1.0, "A": 1.0, "MA": 1e-3, "UA": 1e-6, "KA": 1e3})
VPP: Mapping[str, float] = MappingProxyType({"": 1.0, "VPP": 1.0, "MVPP": 1e-3})
OHM: Mapping[str, float] = MappingProxyType({"": 1.0, "OHM": 1.0, "KOHM": 1e3, "MOHM": 1e6})


class Unreadable(ValueError):
    """The text does not read as a message, or a parameter not as its kind; the words say why."""


@dataclass(frozen=True, slots=True)
class MessagePart:
    """One command of a message: its whole path in capitals, whether it asks, its parameters as typed."""

    path: str
    query: bool
    arguments: tuple[str, ...]

    def argument(self, index: int) -> str:
        """Return a parameter in capitals; Unreadable when it is not there."""
        try:
            return self.arguments[index].upper()
        except IndexError:
            raise Unreadable(f"{self.path} lacks a parameter") from None

    def require(self, count: int) -> None:
        """Raise Unreadable unless there are `count` parameters."""
        if len(self.arguments) != count:
            raise Unreadable(f"{self.path} takes {count} parameters, not {len(self.arguments)}")


def read_message(text: str) -> tuple[MessagePart, ...]:
    """Return the commands of a message; raises Unreadable."""
    if not text.isascii() or not text.isprintable():
        raise Unreadable("only printable ASCII can be judged")
    parts: list[MessagePart] = []
    path: tuple[str, ...] = ()
    for piece in _split(text, ";"):
        if piece.strip():
            part, path = _part(piece, path)
            parts.append(part)
    return tuple(parts)


def _part(piece: str, path: tuple[str, ...]) -> tuple[MessagePart, tuple[str, ...]]:
    found = _HEADER.fullmatch(piece)
    if found is None or "#" in (found[4] or ""):
        raise Unreadable(f"{piece.strip()!r} is not understood")
    arguments = tuple(each.strip() for each in _split(found[4], ",")) if found[4] else ()
    if any(("'" in each or '"' in each) and not _STRING.fullmatch(each) for each in arguments):
        raise Unreadable(f"{piece.strip()!r} has a quotation mark inside a parameter")
    nodes = tuple(found[2].upper().split(":"))
    if nodes[0].startswith("*"):
        return MessagePart(found[2].upper(), bool(found[3]), arguments), path
    whole = nodes if found[1] else path + nodes
    return MessagePart(":".join(whole), bool(found[3]), arguments), whole[:-1]


def _split(text: str, separator: str) -> list[str]:
    """Split outside quotes."""
    if sum(text.count(quote) for quote in "\"'") % 2:
        raise Unreadable("a quotation mark is missing")
    pieces, start = [], 0
    for found in _OUTSIDE.finditer(text):
        if found[0] == separator:
            pieces.append(text[start : found.start()])
            start = found.end()
    return [*pieces, text[start:]]


@cache
def header_pattern(spelling: str) -> re.Pattern[str]:
    """Return a pattern for a header as manuals print it: ``[SOURce:]VOLTage[:LEVel]``; ``...`` is anything below it."""
    below = spelling.endswith("...")
    text = spelling.removesuffix("...").replace("*", r"\*").replace("[", "(?:").replace("]", ")?")
    text = _MNEMONIC.sub(lambda found: f"{found[1]}(?:{found[2].upper()})?" if found[2] else found[1], text)
    return re.compile(text + (r"(?::.*)?" if below else ""))


def quantity(text: str, units: Mapping[str, float], words: Mapping[str, float] = MappingProxyType({})) -> float:
    """Return a number with its unit, or the value of one of the `words` (MIN, MAX, DEF); raises Unreadable."""
    wanted = text.strip().upper()
    for word, value in words.items():
        if header_pattern(word).fullmatch(wanted):
            return value
    found = _QUANTITY.fullmatch(text.strip())
    if found is None or found[2].upper() not in units:
        raise Unreadable(f"{text!r} cannot be judged, give a number in {' or '.join(filter(None, units))}")
    value = float(found[1]) * units[found[2].upper()]
    if not math.isfinite(value):
        raise Unreadable(f"{text!r} is not finite")
    return value


def switch(text: str) -> bool:
    """Return a switch: ON, OFF, 1 or 0; raises Unreadable."""
    try:
        return {"ON": True, "1": True, "OFF": False, "0": False}[text.upper()]
    except KeyError:
        raise Unreadable(f"{text!r} is neither ON nor OFF") from None
