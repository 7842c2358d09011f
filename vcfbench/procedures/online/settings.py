"""Settings of a calibration while the gyroscope measures."""

from collections.abc import Iterator
from typing import Annotated, ClassVar

from vcfbench.devices.device import KnownDeviceSettings, level_for
from vcfbench.station.bounds import Rate, ranged, said
from vcfbench.station.invalid_value import InvalidValue

_MEMORY = 512
"""Readings that every meter keeps (34401A)."""
_LEAST_READINGS = 8
"""A period, so that its third harmonic is held."""
_LEAST_PERIODS = 3.0
"""A window."""
_LEAST_BURST = 8.0
"""Least periods in a burst, so that the noise shows between its harmonics."""
_LEAST_BURSTS = 3


class OnlineSettings(KnownDeviceSettings, frozen=True, kw_only=True):
    """Settings of the calibration in addition to those of a self-calibration; the gyroscope is warm, as in service."""

    rates_key: ClassVar[str] = "virtual_rate_deg_s"

    warm_up_s: Annotated[float, ranged(0.0, 86_400.0, "wait after power-on")] = 1800.0
    modulation_hz: Annotated[float, ranged(0.02, 5.0, "frequency of the sine on V_Vc, far below the mode split")] = 0.25
    virtual_rate_deg_s: Annotated[float, ranged(0.1, 300.0, "amplitude of the rate that the sine stands for")] = 50.0
    window_s: Annotated[float, ranged(1.0, 102.4, "length of a window, which gives one scale factor")] = 20.0
    duration_s: Annotated[float, ranged(10.0, 1e6, "duration of the modulation, in whole bursts, at least three")] = (
        1800.0
    )
    rate_deg_s: Annotated[Rate, said("rate of the table during the modulation, if there is a table")] = 0.0
    split_hz: Annotated[
        float, ranged(1.0, 1000.0, "mode split, as `bandwidth` finds it, for the response to the sine")
    ] = 24.8
    u_split_hz: Annotated[float, ranged(0.0, 100.0, "standard uncertainty of the split")] = 0.5
    in_phase_split_hz: Annotated[float, ranged(10.0, 10_000.0, "drive minus in-phase sense frequency, roughly")] = 147.0
    in_phase_share: Annotated[
        float, ranged(-0.9, 0.9, "share of the in-phase mode in the response at rest, as `bandwidth` finds it")
    ] = 0.147

    @property
    def k_vc_looked_at(self) -> float | None:
        return None if self.known.issued else self.known.k_vc.coefficients[1]

    @property
    def magnitudes_deg_s(self) -> tuple[float, ...]:
        """The peak of the virtual rate."""
        return (self.virtual_rate_deg_s,)

    @property
    def aperture_s(self) -> float:
        """Integration time of a reading, s; the next begins when it ends."""
        return self.nplc / self.station.mains_hz

    @property
    def window_readings(self) -> int:
        """Readings a window."""
        return max(1, round(self.window_s / self.aperture_s))

    @property
    def windows_a_burst(self) -> int:
        """Windows that a meter takes at once."""
        return max(1, _MEMORY // self.window_readings)

    @property
    def burst_readings(self) -> int:
        """Readings that a meter takes at once, in whole windows."""
        return self.windows_a_burst * self.window_readings

    @property
    def bursts(self) -> int:
        """Number of bursts."""
        return max(_LEAST_BURSTS, round(self.duration_s / (self.burst_readings * self.aperture_s)))

    @property
    def amplitude_v(self) -> float:
        """Amplitude of the sine on V_Vc, V."""
        return abs(level_for(self.known.k_vc, self.virtual_rate_deg_s, self.rates_key))

    def contradictions(self) -> Iterator[InvalidValue]:
        yield from super().contradictions()
        most_hz = 1.0 / (_LEAST_READINGS * self.aperture_s)
        burst_s = self.burst_readings * self.aperture_s
        least_hz = max(_LEAST_PERIODS / self.window_s, _LEAST_BURST / burst_s)
        if not least_hz <= self.modulation_hz <= most_hz:
            expected = (
                f"{least_hz:.3g} to {most_hz:.3g} Hz: {_LEAST_PERIODS:g} periods a window and {_LEAST_BURST:g} a burst "
                f"of {burst_s:g} s, {_LEAST_READINGS} readings of {self.aperture_s:g} s a period (nplc)"
            )
            yield InvalidValue("modulation_hz", expected, self.modulation_hz)
        if self.window_readings > _MEMORY:
            yield InvalidValue("window_s", f"at most {_MEMORY} readings of {self.aperture_s:g} s", self.window_s)
        if self.modulation_hz > 0.1 * self.split_hz:
            yield InvalidValue(
                "modulation_hz", f"at most a tenth of split_hz, {self.split_hz:g} Hz", self.modulation_hz
            )
        if self.rate_deg_s and self.station.limits.max_rate_deg_s is None and self.station.instruments:
            yield InvalidValue("rate_deg_s", "0 on a bench without a rate table", self.rate_deg_s)
        yield from self.beyond_table("rate_deg_s", self.rate_deg_s)
