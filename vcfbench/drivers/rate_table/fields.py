"""Numbers in frames: the types that a profile can name, and the ways in which angles wrap."""

from __future__ import annotations

import struct
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal

from vcfbench.drivers import replies
from vcfbench.errors import FramingError

if TYPE_CHECKING:
    from collections.abc import Mapping

Order = Literal["little", "big"]
BinaryType = Literal["u8", "i8", "u16", "i16", "u24", "i24sm", "u32", "i32", "f32"]
TextType = Literal["decimal", "hex"]
Wrap = Literal["continuous", "0..360", "+-180", "over 360 minus 720"]
"""Wrapping of an angle in a reply: none, within a turn either way, or negative angles as 720 more."""

_STRUCTS: Mapping[str, str] = MappingProxyType(
    {"u8": "B", "i8": "b", "u16": "H", "i16": "h", "u32": "I", "i32": "i", "f32": "f"}
)
_WIDTHS: Mapping[str, int] = MappingProxyType(
    {"u8": 1, "i8": 1, "u16": 2, "i16": 2, "u24": 3, "i24sm": 3, "u32": 4, "i32": 4, "f32": 4}
)
BINARY_TYPES = tuple(_WIDTHS)
_SIGN = 1 << 23


def encode(kind: str, value: float, order: Order) -> bytes:
    """Return `value` as the bytes of a type; whole-number types round to the nearest.

    Raises:
        ValueError: it does not fit.
    """
    prefix = "<" if order == "little" else ">"
    if kind == "f32":
        try:
            return struct.pack(f"{prefix}f", value)
        except OverflowError as error:
            raise ValueError(f"{value:g} does not fit into {kind}") from error
    whole = round(value)
    try:
        if kind == "i24sm":
            return _magnitude(whole).to_bytes(3, order)
        if kind == "u24":
            return whole.to_bytes(3, order)
        return struct.pack(f"{prefix}{_STRUCTS[kind]}", whole)
    except (struct.error, OverflowError) as error:
        raise ValueError(f"{whole} does not fit into {kind}") from error


def _magnitude(whole: int) -> int:
    if abs(whole) >= _SIGN:
        raise OverflowError
    return abs(whole) | (_SIGN if whole < 0 else 0)


def decode(kind: str, data: bytes, at: int, order: Order) -> float:
    """Return the number of a type that begins at byte `at`; raises FramingError when it is not wholly there."""
    raw = data[at : at + _WIDTHS[kind]]
    if at < 0 or len(raw) != _WIDTHS[kind]:
        raise FramingError(f"a frame of {len(data)} bytes has no {kind} at byte {at}")
    if kind in ("u24", "i24sm"):
        word = int.from_bytes(raw, order)
        return float(word if kind == "u24" or not word & _SIGN else -(word ^ _SIGN))
    prefix = "<" if order == "little" else ">"
    return float(struct.unpack(f"{prefix}{_STRUCTS[kind]}", raw)[0])


def text_value(kind: TextType, text: str) -> float:
    """Return the number that a piece of text says; raises FramingError when it is none."""
    if kind == "decimal":
        return replies.number(text.strip())
    try:
        return float(int(text, 16))
    except ValueError:
        raise FramingError(f"expected a hexadecimal number, came {text[:60]!r}") from None


def unwrapped(angle: float, wrap: Wrap) -> float:
    """Return the angle that is meant by one told with `wrap`, deg."""
    match wrap:
        case "0..360":
            return angle % 360.0
        case "+-180":
            return (angle + 180.0) % 360.0 - 180.0
        case "over 360 minus 720":
            return angle - 720.0 if angle > 360.0 else angle
        case "continuous":
            return angle
