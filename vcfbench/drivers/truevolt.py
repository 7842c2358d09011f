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
    dc_words: ClassVar[tuple[str, ...]] = (
        "CONF:VOLT:DC {range}",
        "VOLT:DC:NPLC {nplc}",
        "VOLT:DC:ZERO:AUTO ON",
        "TRIG:SOUR IMM",
    )
    sampling_words: ClassVar[tuple[str, ...]] = ("VOLT:DC:ZERO:AUTO ONCE", "SAMP:COUN {samples}", "TRIG:DEL {pause}")
    single_words: ClassVar[tuple[str, ...]] = ("SAMP:COUN 1", "TRIG:DEL:AUTO ON", "VOLT:DC:ZERO:AUTO ON")
    fast_apertures_s: ClassVar[Mapping[float, float]] = MappingProxyType({})
    memory_readings: ClassVar[int] = 10_000
    abort_words: ClassVar[tuple[str, ...]] = ("ABOR",)
    """A raw socket has no device clear, and *OPC? waits for a measurement that is under way."""
