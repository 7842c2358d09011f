"""Keysight (Agilent) 33500B and 33600A function generators (Trueform series).

They speak the 33220A's words but for what stands here. Sources: single pages of the 33500 Series Operating and Service
Guide (p. 62), a driver made from the maker's SCPI description of the 33500B, users' records of replies. Highest
frequencies are those that the models are sold by.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from vcfbench.drivers import replies
from vcfbench.drivers.agilent33220a import OPEN_OHM, Agilent33220A

if TYPE_CHECKING:
    from vcfbench.clock import Deadline

__all__ = [
    "Keysight33509B",
    "Keysight33510B",
    "Keysight33511B",
    "Keysight33512B",
    "Keysight33521B",
    "Keysight33522B",
    "Keysight33611A",
    "Keysight33612A",
    "Keysight33621A",
    "Keysight33622A",
    "Trueform",
]


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


class Keysight33509B(Trueform):
    """The 33509B, 20 MHz."""

    model: ClassVar[str] = "33509B"
    sine_hz: ClassVar[tuple[float, float]] = (1e-6, 20e6)


class Keysight33510B(Trueform):
    """The 33510B, 20 MHz."""

    model: ClassVar[str] = "33510B"
    sine_hz: ClassVar[tuple[float, float]] = (1e-6, 20e6)


class Keysight33511B(Trueform):
    """The 33511B, 20 MHz."""

    model: ClassVar[str] = "33511B"
    sine_hz: ClassVar[tuple[float, float]] = (1e-6, 20e6)


class Keysight33512B(Trueform):
    """The 33512B, 20 MHz."""

    model: ClassVar[str] = "33512B"
    sine_hz: ClassVar[tuple[float, float]] = (1e-6, 20e6)


class Keysight33521B(Trueform):
    """The 33521B, 30 MHz."""

    model: ClassVar[str] = "33521B"
    sine_hz: ClassVar[tuple[float, float]] = (1e-6, 30e6)


class Keysight33522B(Trueform):
    """The 33522B, 30 MHz."""

    model: ClassVar[str] = "33522B"
    sine_hz: ClassVar[tuple[float, float]] = (1e-6, 30e6)


class Keysight33611A(Trueform):
    """The 33611A, 80 MHz."""

    model: ClassVar[str] = "33611A"
    sine_hz: ClassVar[tuple[float, float]] = (1e-6, 80e6)


class Keysight33612A(Trueform):
    """The 33612A, 80 MHz."""

    model: ClassVar[str] = "33612A"
    sine_hz: ClassVar[tuple[float, float]] = (1e-6, 80e6)


class Keysight33621A(Trueform):
    """The 33621A, 120 MHz."""

    model: ClassVar[str] = "33621A"
    sine_hz: ClassVar[tuple[float, float]] = (1e-6, 120e6)


class Keysight33622A(Trueform):
    """The 33622A, 120 MHz."""

    model: ClassVar[str] = "33622A"
    sine_hz: ClassVar[tuple[float, float]] = (1e-6, 120e6)
