"""Templates of a profile's messages: text in Python's format language, or bytes with typed places.

Text: ``3{dir}{acc:04d}{abs_rate:09.4f}``. Bytes: ``01 0C {rate:i32*1e5} {acc:i32*1e5}``, hexadecimal, each place with
its type and the factor to its whole numbers. Only the names of `NAMES` can stand in a template.
"""

from __future__ import annotations

import math
import re
import string
from typing import TYPE_CHECKING, Final

from vcfbench.drivers.rate_table.fields import BINARY_TYPES, Order, encode

if TYPE_CHECKING:
    from collections.abc import Mapping

Value = float | int | str

_SLOTS = 6
NAMES: Final = (
    *("rate", "abs_rate", "dir", "acc", "axis", "seq", "position", "travel_end"),
    *(f"rate_{slot}" for slot in range(1, _SLOTS + 1)),
    *(f"on_{slot}" for slot in range(1, _SLOTS + 1)),
)
"""rate, abs_rate, acc, position: in the table's units. dir: the direction's digit. axis: the bench's. seq: a counter.
travel_end: the end of travel that lies in the rate's direction. rate_1...: the rate of our axis, 0 for the others.
on_1...: 1 for our axis, 0 for the others."""

_HEX_BYTES = re.compile(r"(?:[0-9A-Fa-f]{2})+")
_FORM = re.compile(r"(?:.?[<>=^])?[+\- ]?#?0?[1-9]?\d?(?:\.[0-2]?\d)?[bdeEfFgGosxX]?", re.DOTALL)
"""Part of Python's format language that a table can want: at most 99 characters, 29 of them decimals."""
_PLACE = re.compile(r"\{(?P<name>\w+):(?P<kind>\w+)(?:\*(?P<factor>[0-9.eE+-]+))?\}")


def sample_values() -> dict[str, Value]:
    """Return a value for each name, to try templates with."""
    values: dict[str, Value] = dict.fromkeys(NAMES, 1)
    return values | {"dir": "1"}


def fill_text(template: str, values: Mapping[str, Value]) -> str:
    """Return a text template with its values.

    Raises:
        ValueError: it is no template, or asks for what there is not; the words say what.
    """
    parts = []
    for literal, name, form, conversion in string.Formatter().parse(template):
        parts.append(literal)
        if name is None:
            continue
        if conversion is not None:
            raise ValueError(f"conversion !{conversion} is not known here")
        parts.append(_formatted(_value(name, values), form or ""))
    return "".join(parts)


def _value(name: str, values: Mapping[str, Value]) -> Value:
    if name not in NAMES:
        raise ValueError(f"unknown name {name!r}")
    if name not in values:
        raise ValueError(f"{name!r} has no value in this command")
    return values[name]


def _formatted(value: Value, form: str) -> str:
    if not _FORM.fullmatch(form):
        raise ValueError(f"{form[:20]!r} is no form of at most 99 characters and 29 decimals")
    if isinstance(value, float):
        if not math.isfinite(value):
            raise ValueError(f"{value} cannot be sent")
        value += 0.0  # no table need know a negative zero
        if form.endswith(("d", "x", "X")):
            value = round(value)
    return format(value, form)


def fill_bytes(template: str, values: Mapping[str, Value], order: Order) -> bytes:
    """Return a template of bytes with its values; raises ValueError like :func:`fill_text`."""
    return b"".join(_token(token, values, order) for token in template.split())


def _token(token: str, values: Mapping[str, Value], order: Order) -> bytes:
    if _HEX_BYTES.fullmatch(token):
        return bytes.fromhex(token)
    place = _PLACE.fullmatch(token)
    if place is None:
        raise ValueError(f"{token!r} is neither hexadecimal bytes nor {{name:type}} or {{name:type*factor}}")
    if place["kind"] not in BINARY_TYPES:
        raise ValueError(f"unknown type {place['kind']!r}, there are {', '.join(BINARY_TYPES)}")
    value = float(_value(place["name"], values))
    if not math.isfinite(value):
        raise ValueError(f"{value} cannot be sent")
    text = place["factor"]
    factor = float(text or 1.0)
    if not 1e-12 <= abs(factor) <= 1e12:
        raise ValueError(f"a factor is from 1e-12 to 1e12 either sign, not {text}")
    return encode(place["kind"], value * factor, order)
