"""Checksums of table languages, by the names that a profile gives them; each is bytes, as sent."""

from __future__ import annotations

import zlib
from types import MappingProxyType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping


def _crc(data: bytes, polynomial: int, start: int, width: int) -> int:
    """Return a CRC, most significant bit first."""
    top, mask, value = 1 << (width - 1), (1 << width) - 1, start
    for byte in data:
        value ^= byte << (width - 8)
        for _ in range(8):
            value = (value << 1 ^ (polynomial if value & top else 0)) & mask
    return value


def _crc_reflected(data: bytes, polynomial: int, start: int) -> int:
    """Return a CRC, least significant bit first."""
    value = start
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (polynomial if value & 1 else 0)
    return value


def _xor(data: bytes) -> int:
    value = 0
    for byte in data:
        value ^= byte
    return value


_HEX = frozenset({"lrc_hex", "sum_hex", "nmea_xor_hex"})
_WIDTHS: Mapping[str, int] = MappingProxyType({"crc16_modbus": 2, "crc16_ccitt": 2, "crc32": 4})

_VALUES: Mapping[str, Callable[[bytes], int]] = MappingProxyType(
    {
        "sum8": lambda data: sum(data) % 256,
        "neg_sum8": lambda data: -sum(data) % 256,
        "xor8": _xor,
        "lrc_hex": lambda data: -sum(data) % 256,
        "sum_hex": lambda data: sum(data) % 256,
        "nmea_xor_hex": _xor,
        "crc8": lambda data: _crc(data, 0x07, 0x00, 8),
        "crc16_modbus": lambda data: _crc_reflected(data, 0xA001, 0xFFFF),
        "crc16_ccitt": lambda data: _crc(data, 0x1021, 0xFFFF, 16),
        "crc32": zlib.crc32,
    }
)

CHECKSUMS = tuple(_VALUES)
"""The names there are; those in ``_hex`` are two upper-case hexadecimal digits."""


def checksum_length(name: str) -> int:
    """Return how many bytes the checksum `name` takes as sent."""
    return 2 if name in _HEX else _WIDTHS.get(name, 1)


def checksum(name: str, data: bytes, *, order: str = "little") -> bytes:
    """Return the checksum `name` of `data` as sent; `order` is that of checksums of several bytes.

    `crc8` has the polynomial 07, `crc16_modbus` A001 reflected from FFFF, `crc16_ccitt` 1021 from FFFF, `crc32` is
    IEEE 802.3's.
    """
    value = _VALUES[name](data)
    if name in _HEX:
        return f"{value:02X}".encode("ascii")
    return value.to_bytes(checksum_length(name), "big" if order == "big" else "little")
