"""Reply formats: from a value to the characters of a response message."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

INFINITY = 9.9e37
NOT_A_NUMBER = 9.91e37
"""What stands for them on the wire (SCPI-99 vol. 1, 7.2.1.4)."""


def signed_integer(value: float) -> str:
    """Format an integer with its sign, `+1`."""
    return f"{int(value):+d}"


def bare_integer(value: float) -> str:
    """Format an integer without a plus sign, `1`."""
    return str(int(value))


def boolean(value: object) -> str:
    """Format a state: `0` or `1`."""
    return "1" if value else "0"


def quoted(value: str) -> str:
    """Format a string in double quotes, those inside doubled."""
    return '"' + value.replace('"', '""') + '"'


def real(decimals: int, exponent_digits: int = 2) -> Callable[[float], str]:
    """Return a formatter for NR3 with its sign: `real(8)` gives `+1.00000000E+01`; infinity is 9.9E+37."""
    pattern = f"%+.{decimals}E"
    if exponent_digits == 2:
        return lambda value: pattern % (value if _LEAST <= abs(value) < math.inf else _finite(value))
    return lambda value: _widen(pattern % _finite(value), exponent_digits)


def comma_list(item: Callable[[float], str]) -> Callable[[Iterable[float]], str]:
    """Return a formatter that joins values with commas, each formatted by `item`."""
    return lambda values: ",".join(map(item, values))


class Parts:
    """An answer in parts, which are put together once, when it is sent: a waveform has megabytes."""

    __slots__ = ("parts", "size")

    def __init__(self, parts: Iterable[bytes]) -> None:
        self.parts = tuple(parts)
        self.size = sum(map(len, self.parts))

    def __len__(self) -> int:
        """Return the number of bytes."""
        return self.size


def joined(replies: Iterable[str | bytes | Parts], end: bytes) -> bytes:
    """Return answers as they are sent, one behind the other, with their end; put together once."""
    pieces: list[bytes] = []
    for reply in replies:
        if pieces:
            pieces.append(b";")
        if isinstance(reply, str):
            pieces.append(reply.encode("latin-1"))
        else:
            pieces += reply.parts if isinstance(reply, Parts) else [reply]
    return b"".join([*pieces, end])


def block(data: bytes, digits: int | None = None) -> bytes:
    """Format a definite length block, with `digits` length digits or as many as needed."""
    return block_header(len(data), digits) + data


def block_header(size: int, digits: int | None = None) -> bytes:
    """Format the header of a definite length block of `size` bytes."""
    length = str(size) if digits is None else f"{size:0{digits}d}"
    return b"#%d%b" % (len(length), length.encode())


_LEAST = 1e-99
"""Below this an exponent of two digits cannot tell a number from zero; what rings down for ever comes there."""


def _finite(value: float) -> float:
    size = abs(value)
    if size < _LEAST:
        return 0.0
    if size < math.inf:
        return value
    return NOT_A_NUMBER if math.isnan(value) else math.copysign(INFINITY, value)


def _widen(text: str, exponent_digits: int) -> str:
    mantissa, exponent = text.split("E")
    return f"{mantissa}E{exponent[0]}{exponent[1:].zfill(exponent_digits)}"
