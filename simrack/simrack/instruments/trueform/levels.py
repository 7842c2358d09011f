"""VOLTage:LIMit of the Trueform series: no level leaves it while it is on (33500 Series guide, VOLTage subsystem)."""

from __future__ import annotations

from simrack.instruments.agilent33220a.levels import Levels
from simrack.instruments.agilent33220a.settings import conflict

_ROUND_OFF = 1e-12


class LimitedLevels(Levels):
    """Levels that are clipped to the limits, with a settings conflict. Its further words are unverified.

    The limits are kept as open-circuit volts, as the levels are.
    """

    def within_limits(self) -> bool:
        """Tell whether the levels that are set lie within the limits, whether those are on or not."""
        settings, peak = self._settings, self.peak_v()
        high, low = settings["offset"] + peak, settings["offset"] - peak
        return bool(high <= settings["limit_high"] + _ROUND_OFF and low >= settings["limit_low"] - _ROUND_OFF)

    def set_amplitude(self, shown_vpp: float) -> None:
        """Set the amplitude, Vpp as shown; one that leaves the limits is clipped."""
        super().set_amplitude(shown_vpp)
        settings = self._settings
        room = min(settings["limit_high"] - settings["offset"], settings["offset"] - settings["limit_low"])
        if settings["limit_on"] and self.peak_v() > room + _ROUND_OFF:
            settings["vpp"] = 2.0 * max(room, 0.0)
            self._report(conflict("amplitude has been limited by output limits"))

    def set_offset(self, shown_v: float) -> None:
        """Set the offset as shown; one that leaves the limits is clipped."""
        super().set_offset(shown_v)
        settings, peak = self._settings, self.peak_v()
        low, high = settings["limit_low"] + peak, settings["limit_high"] - peak
        clipped = min(max(settings["offset"], low), high)
        if settings["limit_on"] and abs(clipped - settings["offset"]) > _ROUND_OFF:
            settings["offset"] = clipped
            self._report(conflict("offset has been limited by output limits"))

    def set_high_and_low(self, high: float, low: float) -> None:
        """Set both levels as shown; those that leave the limits are clipped."""
        settings = self._settings
        if settings["limit_on"]:
            most, least = settings["limit_high"] * self.share, settings["limit_low"] * self.share
            if high > most + _ROUND_OFF or low < least - _ROUND_OFF:
                high, low = min(high, most), max(low, least)
                self._report(conflict("levels have been limited by output limits"))
        super().set_high_and_low(high, low)
