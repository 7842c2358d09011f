"""Keysight 34461A and 34465A multimeters, after the Truevolt Series Operating and Service Guide.

They speak the 34401A's words but for those that stand here as data. INITiate is overlapped: FETCh? waits for the
reading and may be asked again, for it stays in memory (users' drivers, after the guide).
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import ClassVar

from vcfbench.drivers.hp34401a import Hp34401A


class Truevolt(Hp34401A):
    """A meter of the series, made of its row's numbers: every function has an autozero of its own (guide p. 223)."""

    makers: ClassVar[tuple[str, ...]] = ("KEYSIGHT",)
    autozero: ClassVar[str] = "VOLT:DC:ZERO:AUTO"
    fast_apertures_s: ClassVar[Mapping[float, float]] = MappingProxyType({})
    memory_readings: ClassVar[int] = 10_000
    abort_words: ClassVar[tuple[str, ...]] = ("ABOR",)
    """A raw socket has no device clear, and *OPC? waits for a measurement that is under way."""
