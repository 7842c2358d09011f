"""The measurement functions of the 34401A: ranges, resolutions, delays (User's Guide p. 51-61, 81, 217-221)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from msgspec import Struct, field

from simrack.scpi import ScpiError

RESOLUTIONS = MappingProxyType({0.02: 1e-4, 0.2: 1e-5, 1.0: 3e-6, 10.0: 1e-6, 100.0: 3e-7})
"""Power line cycles to resolution as a fraction of the range (p. 55)."""
APERTURES_S = MappingProxyType({0.01: 1e-4, 0.1: 1e-5, 1.0: 1e-6})
"""Gate times of frequency and period to resolution as a fraction of the reading (p. 61: 4.5, 5.5, 6.5 digits)."""
AUTO_DELAY_S = MappingProxyType({3.0: 7.0, 20.0: 1.0, 200.0: 0.6})
"""Automatic delay of ac functions from remote, by filter (p. 81)."""

_VOLTAGE_OVERLOAD = 1
_CURRENT_OVERLOAD = 2
_OHMS_OVERLOAD = 512


class Function(Struct, frozen=True):
    """A measurement function.

    Args:
        name: short form as in replies. header: as after CONFigure: and MEASure:. spellings: as in FUNCtion "...".
        ranges: full scales, empty where there is one. unit: of range and reading.
        over_range: highest reading as a multiple of the top range; lower ranges have 1.2.
        overload_bit: QUEStionable bit of an overload.
        integrating: the aperture is set by power line cycles. gated: by a gate time.
        lowest, highest: limits of what may be expected where there is one range.
        voltage_ranges: of the signal, for frequency and period.
        fractions: power line cycles, rising, to resolution as a fraction of the range.
    """

    name: str
    header: str
    spellings: tuple[str, ...]
    ranges: tuple[float, ...]
    unit: str
    over_range: float = 1.2
    overload_bit: int = _VOLTAGE_OVERLOAD
    integrating: bool = False
    gated: bool = False
    lowest: float = 0.0
    highest: float = 0.0
    voltage_ranges: tuple[float, ...] = ()
    fractions: Mapping[float, float] = field(default_factory=lambda: RESOLUTIONS)

    @property
    def default_range(self) -> float:
        """The range after *RST: autorange starts on the one that suits most signals (unverified)."""
        if self.voltage_ranges:
            return self.voltage_ranges[1]
        if not self.ranges:
            return self.highest
        return {"V": 10.0, "A": self.ranges[-1], "OHM": 1e3}[self.unit]

    @property
    def slowest(self) -> float:
        """The slowest signal of frequency (Hz) or period (s): the range in CONFigure?, as the E1412A answers it."""
        return self.lowest if self.unit == "HZ" else self.highest

    @property
    def alternating(self) -> bool:
        """True if it goes through the ac path."""
        return not self.integrating and not self.fixed

    @property
    def fixed(self) -> bool:
        """True if it has one range and one integration time: continuity and diode test (p. 51)."""
        return not self.ranges and not self.gated

    @property
    def voltage_ranged(self) -> Function:
        """The function whose ranges RANGe sets: for frequency and period that of the signal, an ac voltage."""
        return BY_NAME["VOLT:AC"] if self.voltage_ranges else self

    @property
    def resolutions(self) -> tuple[float, ...]:
        """The resolutions to be had, as fractions of the range; ac readings only mask digits (p. 57)."""
        return tuple(self.fractions.values()) if self.integrating else (1e-4, 1e-5, 1e-6)

    def fraction_of(self, nplc: float) -> float:
        """Return the resolution, as a fraction of the range; between the power line cycles of the table by a power."""
        if nplc in self.fractions:
            return self.fractions[nplc]
        below = max((each for each in self.fractions if each < nplc), default=min(self.fractions))
        above = min((each for each in self.fractions if each > nplc), default=max(self.fractions))
        if below == above:
            return self.fractions[below]
        share = math.log(nplc / below) / math.log(above / below)
        return float(self.fractions[below] ** (1.0 - share) * self.fractions[above] ** share)

    @property
    def autorange_s(self) -> float:
        """Time an automatic change of range takes at most (p. 217, 219, 221)."""
        return 0.03 if self.integrating else 0.6 if self.gated else 0.8

    def range_for(self, value: float) -> float:
        """Return the lowest range that holds `value`, over-range included (unverified); -222 above the top."""
        for candidate in self.ranges:
            if abs(value) <= candidate * self.over_range_of(candidate):
                return candidate
        raise ScpiError(-222)

    def over_range_of(self, range_: float) -> float:
        """Return the highest reading on `range_` as a multiple of it: 20 % over-range but for the limited top ones."""
        return self.over_range if self.ranges and range_ == self.ranges[-1] else 1.2

    def nplc_for(self, resolution: float) -> float:
        """Return the power line cycles that go with a resolution."""
        if not self.integrating:
            return 10.0
        return next(cycles for cycles, fraction in self.fractions.items() if fraction <= resolution)

    def auto_delay_s(self, nplc: float, bandwidth_hz: float, range_: float) -> float:
        """Return the automatic trigger delay (p. 81)."""
        if self.gated:
            return 1.0
        if not self.integrating and self.ranges:
            return AUTO_DELAY_S[bandwidth_hz]
        if self.unit == "OHM" and range_ >= 1e7:
            return 0.1
        if self.unit == "OHM" and range_ >= 1e6:
            return 0.015 if nplc >= 1.0 else 0.010
        return 0.0015 if nplc >= 1.0 else 0.001


_VOLTS = (0.1, 1.0, 10.0, 100.0, 1000.0)
_AC_VOLTS = (0.1, 1.0, 10.0, 100.0, 750.0)
_OHMS = (1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8)

_DIRECT: dict[str, Any] = {"over_range": 1.0, "integrating": True}
_OHM: dict[str, Any] = {"overload_bit": _OHMS_OVERLOAD, "integrating": True}
_GATED: dict[str, Any] = {"gated": True, "voltage_ranges": _AC_VOLTS}
_AMPS: dict[str, Any] = {"over_range": 1.0, "overload_bit": _CURRENT_OVERLOAD}

BY_NAME = MappingProxyType(
    {
        function.name: function
        for function in (
            Function("VOLT", "VOLTage[:DC]", ("VOLTage", "VOLTage:DC"), _VOLTS, "V", **_DIRECT),
            Function("VOLT:RAT", "VOLTage[:DC]:RATio", ("VOLTage:RATio", "VOLTage:DC:RATio"), _VOLTS, "V", **_DIRECT),
            Function("VOLT:AC", "VOLTage:AC", ("VOLTage:AC",), _AC_VOLTS, "V", over_range=1.0),
            Function(
                "CURR", "CURRent[:DC]", ("CURRent", "CURRent:DC"), (0.01, 0.1, 1.0, 3.0), "A", integrating=True, **_AMPS
            ),
            Function("CURR:AC", "CURRent:AC", ("CURRent:AC",), (1.0, 3.0), "A", **_AMPS),
            Function("RES", "RESistance", ("RESistance",), _OHMS, "OHM", **_OHM),
            Function("FRES", "FRESistance", ("FRESistance",), _OHMS, "OHM", **_OHM),
            Function("FREQ", "FREQuency", ("FREQuency",), (), "HZ", lowest=3.0, highest=3e5, **_GATED),
            Function("PER", "PERiod", ("PERiod",), (), "S", lowest=1 / 3e5, highest=1 / 3.0, **_GATED),
            Function("CONT", "CONTinuity", ("CONTinuity",), (), "OHM", overload_bit=_OHMS_OVERLOAD, highest=1e3),
            Function("DIOD", "DIODe", ("DIODe",), (), "V", highest=1.0),
        )
    }
)
