"""Differences between the 34461A and the 34465A, as data (Truevolt Series Operating and Service Guide).

The options DIG and MEM and the current ranges that a 34401A has not are not simulated. No probe and no capacitor is on
the terminals: temperature and capacitance are overloads.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from msgspec import Struct, field
from msgspec.structs import replace

from simrack import specifications
from simrack.instruments.hp34401a.functions import BY_NAME, Function
from simrack.specifications import VoltmeterSpecification

_DIGITISING = 0.02
"""Power line cycles below this are an option (guide p. 329)."""

NOTHING_THERE = {
    "TEMP": Function("TEMP", "TEMPerature", ("TEMPerature",), (), "C", overload_bit=1 << 4),
    "CAP": Function("CAP", "CAPacitance", ("CAPacitance",), (), "F", overload_bit=1 << 10, lowest=1e-9, highest=1e-4),
}
"""What there is nothing to measure of (bits of an overload from memory, unverified)."""


class MeterKind(Struct, frozen=True):
    """A model of the series.

    Args:
        model: its name.
        firmware: the last field of ``*IDN?``; its form is that of the guide's p. 270, its numbers are users'.
        sheet: its data sheet.
        memory: readings it can store (p. 306).
        most_readings: the largest sample count and trigger count (p. 306).
        fast_apertures_s: integration times that do not depend on the line, by power line cycles (p. 452).
        apertures_s: least and most of an integration time in seconds, None where there is none (p. 346).
    """

    model: str
    firmware: str
    sheet: VoltmeterSpecification
    memory: int
    most_readings: int
    fast_apertures_s: Mapping[float, float] = field(default_factory=lambda: MappingProxyType({}))
    apertures_s: tuple[float, float] | None = None

    def functions(self) -> Mapping[str, Function]:
        """Return the measurement functions by name: those of the 34401A with the finer resolutions of the model."""
        fractions = {nplc: part for nplc, part in self.sheet.resolution.items() if nplc >= _DIGITISING}
        fine = MappingProxyType(fractions)
        functions = {
            name: replace(function, fractions=fine) if function.integrating else function
            for name, function in BY_NAME.items()
        }
        return MappingProxyType(functions | NOTHING_THERE)


_34461A = MeterKind(
    "34461A",
    "A.02.17-02.40-02.17-00.52-03-01",
    specifications.KEYSIGHT_34461A,
    memory=10_000,
    most_readings=1_000_000,
    fast_apertures_s=MappingProxyType({0.02: 0.3e-3, 0.2: 3e-3}),
)

_34465A = MeterKind(
    "34465A",
    "A.02.17-02.40-02.17-00.52-03-01",
    specifications.KEYSIGHT_34465A,
    memory=50_000,
    most_readings=1_000_000_000,
    apertures_s=(200e-6, 1.0),
)

KINDS = {kind.model: kind for kind in (_34461A, _34465A)}
