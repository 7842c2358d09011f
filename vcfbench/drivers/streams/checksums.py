"""Checksums of frames, by the names that data sheets and catalogues of CRCs use."""

import zlib
from collections.abc import Callable, Mapping
from functools import reduce
from operator import add, xor
from types import MappingProxyType
from typing import Final, Literal

from msgspec import Struct

_Sum = Literal["none", "sum8", "sum16", "xor8"]
_Crc = Literal["crc16-ccitt-false", "crc16-xmodem", "crc16-kermit", "crc16-modbus", "crc32", "crc32-mpeg2"]
ChecksumName = Literal[_Sum, _Crc]


class Checksum(Struct, frozen=True):
    """A checksum: its length in bytes, and its function of the covered bytes."""

    size: int
    of: Callable[[bytes], int]


def _crc(width: int, poly: int, start: int, *, reflected: bool) -> Checksum:
    """Return a CRC by its catalogue numbers; nothing is added at its end."""
    mask, shift = (1 << width) - 1, width - 8
    turned = int(f"{poly:0{width}b}"[::-1], 2)

    def entry(byte: int) -> int:
        found = byte if reflected else byte << shift
        for _ in range(8):
            if reflected:
                found = found >> 1 ^ (turned if found & 1 else 0)
            else:
                found = (found << 1 ^ (poly if found >> width - 1 else 0)) & mask
        return found

    table = tuple(map(entry, range(256)))

    def of(data: bytes) -> int:
        found = start
        for byte in data:
            if reflected:
                found = found >> 8 ^ table[(found ^ byte) & 0xFF]
            else:
                found = (found << 8 & mask) ^ table[found >> shift ^ byte]
        return found

    return Checksum(width // 8, of)


CHECKSUMS: Final[Mapping[str, Checksum]] = MappingProxyType(
    {
        "none": Checksum(0, lambda _: 0),
        "sum8": Checksum(1, lambda data: reduce(add, data, 0) & 0xFF),
        "sum16": Checksum(2, lambda data: reduce(add, data, 0) & 0xFFFF),
        "xor8": Checksum(1, lambda data: reduce(xor, data, 0)),
        "crc16-ccitt-false": _crc(16, 0x1021, 0xFFFF, reflected=False),
        "crc16-xmodem": _crc(16, 0x1021, 0, reflected=False),
        "crc16-kermit": _crc(16, 0x1021, 0, reflected=True),
        "crc16-modbus": _crc(16, 0x8005, 0xFFFF, reflected=True),
        "crc32": Checksum(4, zlib.crc32),
        "crc32-mpeg2": _crc(32, 0x04C11DB7, 0xFFFFFFFF, reflected=False),
    }
)
