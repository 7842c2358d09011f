"""Keysight (Agilent) 33500B and 33600A function generators (Trueform series).

They speak the 33220A's words but for what stands here. Sources: single pages of the 33500 Series Operating and Service
Guide (p. 62), a driver made from the maker's SCPI description of the 33500B, users' records of replies. Highest
frequencies are those that the models are sold by.
"""

from typing import ClassVar

from vcfbench.clock import Deadline
from vcfbench.drivers import replies
from vcfbench.drivers.agilent33220a import OPEN_OHM, Agilent33220A


class Trueform(Agilent33220A):
    """A generator of the series, of which the first channel drives V_Vc; a second one is never spoken to."""

    number_form: ClassVar[replies.NumberForm] = replies.nr3()  # 13 decimals of levels, 15 of the rest (users' records)
    safe_words: ClassVar[tuple[str, ...]] = ("OUTP1 OFF",)
    source: ClassVar[str] = "SOUR1:"
    output: ClassVar[str] = "OUTP1"
    least_vpp: ClassVar[float] = 2e-3  # 1 mVpp into 50 ohm (users' tests)

    def _take_remote(self, deadline: Deadline) -> None:
        """Send nothing: the series has no SYSTem:COMMunicate:RLSTate (the maker's SCPI description)."""

    def _select_open_circuit(self) -> None:
        # With voltage limits on, the termination cannot be changed (guide p. 62): it is left alone where it is right.
        if self._session.query_number(f"{self.output}:LOAD?") < OPEN_OHM:
            super()._select_open_circuit()
