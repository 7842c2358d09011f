"""Keysight 34461A and 34465A multimeters, after the Truevolt Series Operating and Service Guide.

They speak the 34401A's words but for those that stand here as data. INITiate is overlapped: FETCh? waits for the
reading and may be asked again, for it stays in memory (users' drivers, after the guide).
"""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, ClassVar

from vcfbench.drivers.hp34401a import Hp34401A

if TYPE_CHECKING:
    from collections.abc import Mapping


class Keysight34461A(Hp34401A):
    """The 34461A: every function has an autozero of its own (guide, Agilent's edition, p. 223)."""

    model: ClassVar[str] = "34461A"
    makers: ClassVar[tuple[str, ...]] = ("KEYSIGHT", "AGILENT")
    autozero_on: ClassVar[str] = "VOLT:DC:ZERO:AUTO ON"
    autozero_once: ClassVar[str] = "VOLT:DC:ZERO:AUTO ONCE"
    fast_apertures_s: ClassVar[Mapping[float, float]] = MappingProxyType({0.02: 0.3e-3, 0.2: 3e-3})
    """Guide p. 452."""
    memory_readings: ClassVar[int] = 10_000
    """Guide p. 306."""
    abort_words: ClassVar[tuple[str, ...]] = ("ABOR",)
    """A raw socket has no device clear, and *OPC? waits for a measurement that is under way."""


class Keysight34465A(Keysight34461A):
    """The 34465A: more integration times (guide p. 329); it refuses the three fastest without its option DIG."""

    model: ClassVar[str] = "34465A"
    makers: ClassVar[tuple[str, ...]] = ("KEYSIGHT",)
    fast_apertures_s: ClassVar[Mapping[float, float]] = MappingProxyType({})
    memory_readings: ClassVar[int] = 50_000
    integration_times_nplc: ClassVar[tuple[float, ...]] = (0.001, 0.002, 0.006, 0.02, 0.06, 0.2, 1.0, 10.0, 100.0)
