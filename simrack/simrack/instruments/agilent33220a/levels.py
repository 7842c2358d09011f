"""Amplitude and offset of a 33220A: kept as open-circuit volts, shown for the load that OUTPut:LOAD says."""

from __future__ import annotations

import math
from collections.abc import Callable

from simrack.instruments.agilent33220a.arbitrary import ArbitraryMemory, crest
from simrack.instruments.agilent33220a.settings import (
    MAX_PEAK_V,
    SOURCE_OHM,
    GeneratorErrors,
    GeneratorSettings,
    conflict,
)
from simrack.scpi import Limits, ScpiError, clip

_ROUND_OFF = 1 + 1e-12


class Levels:
    """The rules between amplitude, offset, load and unit, and the attenuator range in use."""

    def __init__(
        self,
        settings: GeneratorSettings,
        errors: GeneratorErrors,
        memory: ArbitraryMemory,
        report: Callable[[ScpiError], None],
    ) -> None:
        self._settings = settings
        self._errors = errors
        self._memory = memory
        self._report = report

    @property
    def share(self) -> float:
        """The part of the open-circuit voltage that the assumed load sees."""
        load: float = self._settings.load_ohm
        return 1.0 if math.isinf(load) else load / (load + SOURCE_OHM)

    def max_v(self) -> float:
        """Return the largest peak voltage as shown."""
        return MAX_PEAK_V * self.share

    def peak_v(self) -> float:
        """Return the peak alternating voltage into an open circuit; direct voltage has none."""
        return 0.0 if self._settings.function == "DC" else float(self._settings.vpp) / 2.0

    def room_v(self) -> float:
        """Return the room that the amplitude leaves for the offset, open circuit."""
        return MAX_PEAK_V - self.peak_v()

    def rounded(self, shown_v: float) -> float:
        """Return a setting at the resolution of the instrument."""
        digits = self._errors.setting_digits
        return float(f"{shown_v:.{digits - 1}e}") if digits else shown_v

    def amplitude_vpp(self) -> float:
        """Return the amplitude as shown, Vpp."""
        return float(self._settings.vpp * self.share)

    def offset_v(self) -> float:
        """Return the offset as shown."""
        return float(self._settings.offset_v * self.share)

    def set_amplitude(self, shown_vpp: float) -> None:
        """Set the amplitude, Vpp as shown; an offset that no longer fits is moved (-221)."""
        self._settings.vpp = shown_vpp / self.share
        self.move_offset("offset changed due to amplitude")

    def move_offset(self, words: str) -> None:
        """Move an offset that does not fit the amplitude, with `words`."""
        offset = self._settings.offset_v
        if abs(offset) > self.room_v() * _ROUND_OFF:
            self._settings.offset_v = math.copysign(self.room_v(), offset)
            self._report(conflict(words))

    def set_offset(self, shown_v: float) -> None:
        """Set the offset as shown; one that does not fit the amplitude is clipped (-222)."""
        room = self.room_v() * self.share
        if abs(shown_v) > room * _ROUND_OFF:
            shown_v = self.clipped(shown_v, Limits(-room, room), "offset")
        self._settings.offset_v = shown_v / self.share

    def set_high_and_low(self, high: float, low: float) -> None:
        """Set both levels as shown."""
        self._settings.vpp = (high - low) / self.share
        self._settings.offset_v = (high + low) / 2.0 / self.share

    def clipped(self, value: float, limits: Limits, name: str) -> float:
        """Return `value` clipped, with the error that says so."""
        violation = clip(value, limits, name)
        self._report(violation.error)
        assert violation.value is not None  # noqa: S101  (clipping always has a value)
        return violation.value

    def in_unit(self, vpp: float, unit: str) -> float:
        """Return an amplitude in `unit`."""
        rms = vpp / self._vpp_per_vrms()
        if unit == "DBM":
            return 10.0 * math.log10(rms**2 / self._settings.load_ohm * 1e3)
        return rms if unit == "VRMS" else vpp

    def in_vpp(self, value: float, unit: str) -> float:
        """Return an amplitude given in `unit` in Vpp."""
        if unit == "DBM":
            return math.sqrt(1e-3 * 10.0 ** (value / 10.0) * self._settings.load_ohm) * self._vpp_per_vrms()
        return value * self._vpp_per_vrms() if unit == "VRMS" else value

    def _vpp_per_vrms(self) -> float:
        """Return Vpp per Vrms of the function (noise: unverified)."""
        if self._settings.function == "USER":
            return 2.0 * (crest(self._memory.points(self._settings.user)) or 1.0)
        factors = {"SIN": 2.0 * math.sqrt(2.0), "RAMP": 2.0 * math.sqrt(3.0), "TRI": 2.0 * math.sqrt(3.0)}
        factors["NOIS"] = 6.6
        return factors.get(self._settings.function, 2.0)

    def direct_v(self) -> float:
        """Return the offset through converter and attenuator of the range in use, open circuit."""
        settings, ranges = self._settings, self._errors.ranges
        reach = abs(settings.offset_v) + self.peak_v()
        fitting = next((index for index, each in enumerate(ranges) if reach <= each.upper_v), len(ranges) - 1)
        # with autorange off the range is held; it is left only for a larger one that the output needs (unverified)
        index = fitting if settings.range_auto else max(fitting, settings.range)
        settings.range = index
        used = ranges[index]
        volts = settings.offset_v
        bits = self._errors.dac_bits
        step = 2.0 * used.upper_v / 2**bits
        return (round(volts / step) * step if bits else volts) * (1.0 + used.gain_error) + used.offset_error_v
