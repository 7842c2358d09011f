"""Keysight (Agilent) 33500B and 33600A function generators (Trueform series).

They speak the 33220A's words but for what stands here. Sources: single pages of the 33500 Series Operating and Service
Guide (p. 62), a driver made from the maker's SCPI description of the 33500B, users' records of replies. Highest
frequencies are those that the models are sold by.
"""

from typing import ClassVar

from vcfbench.clock import Deadline
from vcfbench.drivers import replies
from vcfbench.drivers.agilent33220a import Agilent33220A
from vcfbench.drivers.scpi_instrument import Left


class Trueform(Agilent33220A):
    """A generator of the series: its first channel drives V_Vc; tracking of a second channel is off."""

    number_form: ClassVar[replies.NumberForm] = replies.nr3()  # 13 decimals of levels, 15 of the rest (users' records)
    questions: ClassVar[tuple[tuple[str, replies.NumberForm], ...]] = (
        ("OUTP1?", replies.ANY_NUMBER),
        ("SOUR1:FREQ?", number_form),
        ("SOUR1:VOLT?", number_form),
        ("SOUR1:VOLT:OFFS?", number_form),
    )
    safe_words: ClassVar[tuple[str, ...]] = ("OUTP1 OFF",)
    source: ClassVar[str] = "SOUR1:"
    output: ClassVar[str] = "OUTP1"
    least_vpp: ClassVar[float] = 2e-3  # 1 mVpp into 50 ohm (users' tests)

    left: ClassVar[tuple[Left, ...]] = (
        *(
            Left(f"SOUR1:{mode}:STAT", "OFF", f"{mode} subsystem")
            for mode in ("AM", "FM", "PM", "FSK", "BPSK", "PWM", "SUM", "SWE", "BURS")
        ),
        Left("SOUR1:FREQ:MODE", "CW", "FREQuency subsystem: no list, no sweep"),
        # With voltage limits on, the termination cannot be changed and levels are cut (guide p. 62)
        Left("SOUR1:VOLT:LIM:STAT", "OFF", "VOLTage subsystem"),
        Left("SOUR1:VOLT:RANG:AUTO", "ON", "VOLTage subsystem"),
        Left("SOUR1:VOLT:UNIT", "VPP", "VOLTage subsystem"),
        Left("OUTP1:POL", "NORM", "OUTPut subsystem"),
        Left("OUTP1:MODE", "NORM", "OUTPut subsystem: not gated"),
        # What ties the channels together; a model of one has no such words
        Left("SOUR1:COMB:FEED", "NONE", "COMBine subsystem"),
        Left("SOUR1:TRAC", "OFF", "TRACk command"),
        Left("SOUR2:TRAC", "OFF", "TRACk command"),
        Left("SOUR1:VOLT:COUP:STAT", "OFF", "VOLTage subsystem"),
        Left("SOUR1:FREQ:COUP:STAT", "OFF", "FREQuency subsystem"),
    )

    def _take_remote(self, deadline: Deadline) -> None:
        """Send nothing: the series has no SYSTem:COMMunicate:RLSTate (the maker's SCPI description)."""
