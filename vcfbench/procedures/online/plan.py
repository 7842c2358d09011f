"""Calibration while the gyroscope measures: a small sine on V_Vc, and its lock-in in the output.

The sine stands for a rate that is known by the device's K_Vc; what the output makes of it is the scale factor, window
after window. The true rate is the output with the sine taken out, and is compared with the output at rest of V_Vc
before and after. Neither a table nor an oscilloscope is needed; where there is a table it may turn meanwhile.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from msgspec import Meta

from vcfbench.bench.bounds import Rate  # noqa: TC001 - msgspec reads it
from vcfbench.bench.invalid_value import InvalidValue
from vcfbench.bench.settings import rate_words
from vcfbench.interfaces import FunctionGenerator, MeasuresWaveforms, PowersRails, Rotates, SamplesVoltage
from vcfbench.plans.steps import (
    CheckRails,
    ConfigureGenerator,
    Note,
    Outcome,
    Plan,
    SampleModulated,
    SetSine,
    Settle,
    move_leads,
)
from vcfbench.procedures.catalogue import BUILT_IN
from vcfbench.procedures.known.device import KnownDeviceSettings, level_for
from vcfbench.procedures.known.v_vc import ready_meters
from vcfbench.procedures.online.results import online_report, online_results
from vcfbench.procedures.procedure import Procedure
from vcfbench.procedures.routines import (
    energised,
    go_to_rate,
    look_at_drive,
    rails_of,
    under_servo,
    v_vc_on,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from vcfbench.plans.step import Routine

__all__ = ["ONLINE", "OnlineSettings", "online"]

_MEMORY = 512
"""Readings that every meter keeps (34401A)."""
_LEAST_READINGS = 8
"""A period, so that its third harmonic is held."""
_LEAST_PERIODS = 3.0
"""A window."""
_LEAST_BURST = 8.0
"""Periods of what is taken at once, so that the noise shows between its harmonics."""
_LEAST_BURSTS = 3


class OnlineSettings(KnownDeviceSettings, frozen=True, kw_only=True):
    """What the calibration is told beside what a self-calibration is; the gyroscope is warm, as in service."""

    rates_key: ClassVar[str] = "virtual_rate_deg_s"

    warm_up_s: Annotated[float, Meta(ge=0.0, le=86_400.0, description="wait after power-on")] = 1800.0
    modulation_hz: Annotated[
        float, Meta(ge=0.02, le=5.0, description="frequency of the sine on V_Vc, far below the mode split")
    ] = 0.25
    virtual_rate_deg_s: Annotated[
        float, Meta(ge=0.1, le=300.0, description="amplitude of the rate that the sine stands for")
    ] = 50.0
    window_s: Annotated[float, Meta(ge=1.0, le=102.4, description="a scale factor every so many seconds")] = 20.0
    duration_s: Annotated[
        float, Meta(ge=10.0, le=1e6, description="of the modulation, in whole bursts, at least three")
    ] = 1800.0
    rate_deg_s: Annotated[Rate, Meta(description="rate of the table meanwhile, where there is one")] = 0.0
    split_hz: Annotated[
        float, Meta(ge=5.0, le=1000.0, description="mode split, as `bandwidth` finds it, for the response to the sine")
    ] = 24.8
    u_split_hz: Annotated[float, Meta(ge=0.0, le=100.0, description="standard uncertainty of the split")] = 0.5
    in_phase_split_hz: Annotated[
        float, Meta(ge=10.0, le=2000.0, description="drive less in-phase sense frequency, roughly")
    ] = 147.0
    in_phase_share: Annotated[
        float, Meta(ge=0.0, le=0.9, description="of the in-phase mode in the response at rest, as `bandwidth` finds it")
    ] = 0.147

    @property
    def magnitudes_deg_s(self) -> tuple[float, ...]:
        """The peak of the virtual rate."""
        return (self.virtual_rate_deg_s,)

    @property
    def aperture_s(self) -> float:
        """How long a reading integrates, s; the next begins when it ends."""
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
        """How often they are taken."""
        return max(_LEAST_BURSTS, round(self.duration_s / (self.burst_readings * self.aperture_s)))

    @property
    def amplitude_v(self) -> float:
        """Amplitude of the sine on V_Vc, V."""
        return abs(level_for(self.known.k_vc, self.virtual_rate_deg_s, self.rates_key))

    def contradictions(self) -> Iterator[InvalidValue]:
        """Yield what the ranges cannot say."""
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
        limit_deg_s = self.station.limits.max_rate_deg_s
        if self.rate_deg_s and limit_deg_s is None and self.station.instruments:
            yield InvalidValue("rate_deg_s", "0 on a bench without a rate table", self.rate_deg_s)
        if limit_deg_s is not None and abs(self.rate_deg_s) > limit_deg_s:
            yield InvalidValue("rate_deg_s", rate_words(limit_deg_s), self.rate_deg_s)


def online(settings: OnlineSettings) -> Plan:
    """Calibrate while the gyroscope measures."""
    return (yield from energised(settings, _measuring(settings)))


def _measuring(settings: OnlineSettings) -> Routine[Outcome]:
    yield from look_at_drive(settings)
    yield from ready_meters(settings)
    if settings.station.limits.max_rate_deg_s is None:
        return (yield from _modulated(settings, None))
    return (yield from under_servo(settings, _turning(settings)))


def _turning(settings: OnlineSettings) -> Routine[Outcome]:
    """Turn the table at its rate, which may be none, all the while."""
    if settings.rate_deg_s:
        yield from go_to_rate(settings, settings.rate_deg_s, previous_deg_s=0.0)
    return (yield from _modulated(settings, settings.rate_deg_s))


def _modulated(settings: OnlineSettings, table_deg_s: float | None) -> Routine[Outcome]:
    """Take V_Vc at rest, the modulation, and V_Vc at rest again."""
    of: Literal["both", "output"] = "both" if settings.v_vc_role == "v_vc_meter" else "output"
    yield Note("V_Vc at rest: what the true rate reads without modulation")
    yield from v_vc_on()
    yield Settle(settings.settle_s, "gyro settles after the generator came on")
    yield from _sampled(settings, 0.0, of, table_deg_s)
    yield Note(f"The modulation, {settings.bursts} times {settings.burst_readings * settings.aperture_s:g} s")
    yield SetSine(settings.modulation_hz, settings.amplitude_v)
    yield Settle(settings.settle_s, "gyro settles after the sine came on")
    for _ in range(settings.bursts):
        yield from _sampled(settings, settings.amplitude_v, of, table_deg_s)
    yield Note("V_Vc at rest again")
    yield ConfigureGenerator(0.0)
    yield Settle(settings.settle_s, "gyro settles after the sine went off")
    yield from _sampled(settings, 0.0, of, table_deg_s)
    if settings.v_vc_role == "multimeter":
        yield from _by_hand(settings)
    return Outcome(f"{settings.bursts * settings.windows_a_burst} windows of {settings.window_s:g} s")


def _sampled(
    settings: OnlineSettings, amplitude_v: float, of: Literal["both", "output"], table_deg_s: float | None
) -> Routine[None]:
    """Take a record of the output, and read the rails back: the meter would not know that they fell."""
    yield _sample(settings, amplitude_v, of, table_deg_s)
    yield CheckRails(rails_of(settings), settings.rail_tolerance_v)


def _by_hand(settings: OnlineSettings) -> Routine[None]:
    """Have V_Vc measured by the one meter, whose leads a person moves there and back: at rest and the sine."""
    yield Note("V_Vc by the one multimeter")
    yield move_leads("multimeter", "v_vc")
    yield _sample(settings, 0.0, "v_vc", None)
    yield SetSine(settings.modulation_hz, settings.amplitude_v)
    yield Settle(settings.settle_s, "the generator settles")
    yield _sample(settings, settings.amplitude_v, "v_vc", None)
    yield move_leads("multimeter", "output")


def _sample(
    settings: OnlineSettings, amplitude_v: float, of: Literal["both", "output", "v_vc"], table_deg_s: float | None
) -> SampleModulated:
    return SampleModulated(
        settings.modulation_hz,
        amplitude_v,
        settings.burst_readings,
        settings.aperture_s,
        of,
        table_deg_s,
        settings.rate_tolerance_deg_s,
    )


ONLINE = Procedure(
    name="online",
    title=BUILT_IN["online"][1],
    method=(
        "While the gyroscope measures a true rate, a sine on V_Vc adds a known virtual one. Its lock-in in the output "
        "gives the scale factor window by window; the output with the sine taken out is the true rate."
    ),
    settings=OnlineSettings,
    plan=online,
    results=online_results,
    report=online_report,
    needs=MappingProxyType({"power": PowersRails, "rate_source": FunctionGenerator, "multimeter": SamplesVoltage}),
    uses=MappingProxyType({"oscilloscope": MeasuresWaveforms, "v_vc_meter": SamplesVoltage, "rate_table": Rotates}),
)
"""The calibration while the gyroscope measures."""
