"""VOLTage:LIMit of the Trueform series: no level leaves it while it is on (33500 Series guide, VOLTage subsystem)."""

from __future__ import annotations

from msgspec import field

from simrack.instruments.agilent33220a.levels import Levels
from simrack.instruments.agilent33220a.settings import GeneratorSettings, Keying, conflict

_ROUND_OFF = 1e-12


class TrueformSettings(GeneratorSettings):
    """Settings of the series; limits are open-circuit volts."""

    limit_on: bool = False
    limit_high_v: float = 10.0
    limit_low_v: float = -10.0
    sample_rate_hz: float = 40e3
    filter: str = "STEP"
    advance: str = "SRAT"
    bit_rate_hz: float = 1e3
    sequence: str = "PN7"
    continuous: bool = True
    frequency_mode: str = "CW"
    trigger_count: float = 1.0
    timer_s: float = 1.0
    bpsk: Keying = field(default_factory=Keying)
    bpsk_phase_deg: float = 180.0
    sum: Keying = field(default_factory=lambda: Keying(frequency_hz=100.0))
    sum_percent: float = 0.1
    suppressed: bool = False
    hold_s: float = 0.0
    return_s: float = 0.0
    noise_hz: float = 100e3
    gating: str = "NORM"
    combined: str = "NONE"
    tracking: str = "OFF"
    levels_coupled: bool = False
    frequencies_coupled: bool = False


class LimitedLevels(Levels):
    """Levels that are clipped to the limits, with a settings conflict. Its further words are unverified.

    The limits are kept as open-circuit volts, as the levels are.
    """

    _settings: TrueformSettings

    def within_limits(self) -> bool:
        """Return True if the levels that are set lie within the limits, whether those are on or not."""
        settings, peak = self._settings, self.peak_v()
        high, low = settings.offset_v + peak, settings.offset_v - peak
        return bool(high <= settings.limit_high_v + _ROUND_OFF and low >= settings.limit_low_v - _ROUND_OFF)

    def set_amplitude(self, shown_vpp: float) -> None:
        """Set the amplitude, Vpp as shown; one that leaves the limits is clipped."""
        super().set_amplitude(shown_vpp)
        settings = self._settings
        room = min(settings.limit_high_v - settings.offset_v, settings.offset_v - settings.limit_low_v)
        if settings.limit_on and self.peak_v() > room + _ROUND_OFF:
            settings.vpp = 2.0 * max(room, 0.0)
            self._report(conflict("amplitude has been limited by output limits"))

    def set_offset(self, shown_v: float) -> None:
        """Set the offset as shown; one that leaves the limits is clipped."""
        super().set_offset(shown_v)
        settings, peak = self._settings, self.peak_v()
        low, high = settings.limit_low_v + peak, settings.limit_high_v - peak
        clipped = min(max(settings.offset_v, low), high)
        if settings.limit_on and abs(clipped - settings.offset_v) > _ROUND_OFF:
            settings.offset_v = clipped
            self._report(conflict("offset has been limited by output limits"))

    def set_high_and_low(self, high: float, low: float) -> None:
        """Set both levels as shown; those that leave the limits are clipped."""
        settings = self._settings
        if settings.limit_on:
            most, least = settings.limit_high_v * self.share, settings.limit_low_v * self.share
            if high > most + _ROUND_OFF or low < least - _ROUND_OFF:
                high, low = min(high, most), max(low, least)
                self._report(conflict("levels have been limited by output limits"))
        super().set_high_and_low(high, low)
