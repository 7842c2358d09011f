"""Keysight 34461A and 34465A multimeters, after the Truevolt Series Operating and Service Guide.

They speak the 34401A's words but for those that stand here as data. INITiate is overlapped: FETCh? waits for the
reading and may be asked again, for it stays in memory (users' drivers, after the guide).
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import ClassVar

from vcfbench.drivers.hp34401a import Hp34401A
from vcfbench.drivers.scpi_instrument import Left

REAR, MAINS = (
    "the front panel's switch selects other terminals",
    "mains_hz of the bench file is not what the meter sees",
)


class Truevolt(Hp34401A):
    """A meter of the series, with the numbers of its row; every function has its own autozero (guide p. 223)."""

    makers: ClassVar[tuple[str, ...]] = ("KEYSIGHT",)
    autozero: ClassVar[str] = "VOLT:DC:ZERO:AUTO"
    impedance: ClassVar[str] = "VOLT:DC:IMP:AUTO"
    fast_apertures_s: ClassVar[Mapping[float, float]] = MappingProxyType({})
    memory_readings: ClassVar[int] = 10_000
    abort_words: ClassVar[tuple[str, ...]] = ("ABOR",)
    """A raw socket has no device clear, and *OPC? waits for a measurement that is under way."""
    left: ClassVar[tuple[Left, ...]] = (
        Left("ROUT:TERM", "FRON", "ROUTe subsystem", REAR),
        Left("SYST:LFR", "{mains}", "SYSTem subsystem", MAINS),
        Left("FORM", "ASC", "FORMat subsystem"),
        Left("CALC:SCAL:STAT", "OFF", "CALCulate:SCALe"),
        Left("CALC:SMO:STAT", "OFF", "CALCulate:SMOothing, 34465A"),
        Left("{header}:NULL", "OFF", "p. 223, and CONFigure"),
        Left("SAMP:SOUR", "IMM", "SAMPle subsystem, 34465A"),
        Left("SAMP:COUN:PRET", "0", "SAMPle subsystem, 34465A"),
    )
