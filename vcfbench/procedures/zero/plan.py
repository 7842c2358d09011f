"""The static record: the output at rest for an hour or more, its noise and its bias.

The multimeter decides what the record shows. One reading a second that averages 0.2 s of it sees white noise as
strongly as 0.2 s do: sqrt(5) times too much at 1 s, and 2.6 times behind a sense mode whose split lets more through.
So there are three modes: the record as it stands, the same corrected for its dead time, and readings without gaps.
"""

import math
from collections.abc import Iterator
from datetime import timedelta
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, Literal

from msgspec import Meta

from vcfbench import steps
from vcfbench.analysis.allan import Sampling, block_means
from vcfbench.procedures.procedure import Procedure, Provenance, roles
from vcfbench.procedures.shared import routines
from vcfbench.procedures.shared.kept import KeptSettings, conditions_of
from vcfbench.procedures.shared.known.scale_factor import AtRestSettings, scale_factor_used
from vcfbench.procedures.zero.results import ForeseenZero, ZeroResult, foreseen_zero, zero_report, zero_results
from vcfbench.records import devices
from vcfbench.station.bounds import ranged, said
from vcfbench.station.invalid_value import InvalidValue
from vcfbench.steps.measured import Foreseen, Measured
from vcfbench.steps.step import answer

_LEAST_READINGS = 200
"""Fewer have no averaging times for four coefficients."""
_EXACTLY = 1e-6
_Q_LIMIT = 0.3
"""Assumed limit of a gyroscope's Q about that of its kind, relative: ours, no data sheet of one says it."""


class Mode(Enum):
    """Treatment of the time between readings."""

    DEAD_TIME = "dead-time"
    CORRECTED = "corrected"
    GAPLESS = "gapless"


class ZeroSettings(KeptSettings, AtRestSettings, frozen=True, kw_only=True):
    """Settings of the static record, beside those of all procedures."""

    powered_s: Annotated[float, ranged(0.0, 86_400.0, "time under power before the record, at least warm_up_s")] = (
        1800.0
    )
    duration_s: Annotated[float, ranged(10.0, 864_000.0, "length of the record")] = 3600.0
    mode: Annotated[
        Mode, said("time between readings: as it is, corrected for, or none, the meter sampling by itself", option=True)
    ] = Mode.CORRECTED
    noise_bandwidth_hz: Annotated[
        float,
        ranged(0.0, 1e4, "noise bandwidth of one reading, where a split lets more through; 0: not known, N is bounded"),
    ] = 0.0
    u_noise_bandwidth_hz: Annotated[
        Annotated[float, ranged(0.0, 1e4)] | None,
        said(
            "standard uncertainty of noise_bandwidth_hz; None: what a split lets through is known to 30 %, "
            "which is assumed"
        ),
    ] = None
    noise_bandwidth_nplc: Annotated[
        Literal[1, 10, 100],
        said("integration time for which noise_bandwidth_hz holds; with another nplc it is not known"),
    ] = 10
    burst_readings: Annotated[int, ranged(10, 50_000, "readings without gaps that the meter's memory holds")] = 500

    validity_days: Annotated[float, Meta(gt=0.0, le=36_500.0, description="of the flicker that is kept, days")] = 365.0

    @property
    def start_up_s(self) -> float:
        """Wait after power-on, s."""
        return max(self.powered_s, self.warm_up_s, self.settle_s)

    @property
    def aperture_s(self) -> float:
        """Integration time of the meter, s."""
        return self.nplc / self.station.mains_hz

    @property
    def passed_hz(self) -> float | None:
        """Noise bandwidth of one reading at this integration time, Hz; None where it is not known."""
        return self.noise_bandwidth_hz or None if self.nplc == self.noise_bandwidth_nplc else None

    @property
    def u_passed_hz(self) -> float:
        """Standard uncertainty of that, Hz; where it is not stated, `_Q_LIMIT` of the part that the split lets through.

        What is above the bandwidth of a mere mean is proportional to the sense mode's Q.
        """
        if self.u_noise_bandwidth_hz is not None:
            return self.u_noise_bandwidth_hz
        excess_hz = max(0.0, self.noise_bandwidth_hz - 0.5 / self.aperture_s)
        return _Q_LIMIT * excess_hz / math.sqrt(3.0)

    @property
    def readings_a_mean(self) -> int:
        """Number of readings without gaps that make one mean over the interval."""
        return max(1, round(self.sample_interval_s / self.aperture_s))

    @property
    def readings(self) -> int:
        """Number of readings that the meter takes."""
        means = round(self.duration_s / self.sample_interval_s)
        return means * self.readings_a_mean if self.mode is Mode.GAPLESS else means

    def contradictions(self) -> Iterator[InvalidValue]:
        yield from super().contradictions()
        if self.duration_s < _LEAST_READINGS * self.sample_interval_s * (1.0 - _EXACTLY):
            least_s = _LEAST_READINGS * self.sample_interval_s
            expected = f"at least {least_s:g} s, {_LEAST_READINGS} times sample_interval_s"
            yield InvalidValue("duration_s", expected, self.duration_s)
        if self.duration_s > 1e6 * self.aperture_s:
            expected = f"at most {1e6 * self.aperture_s:g} s, a million integration times"
            yield InvalidValue("duration_s", expected, self.duration_s)
        least_hz = 0.5 / self.aperture_s
        if self.mode is Mode.CORRECTED and (self.passed_hz or least_hz) < 0.99 * least_hz:
            expected = f"at least the {least_hz:g} Hz of an integration time of {self.aperture_s:g} s, or 0: not known"
            yield InvalidValue("noise_bandwidth_hz", expected, self.noise_bandwidth_hz)
        whole_s = self.readings_a_mean * self.aperture_s
        if self.mode is Mode.GAPLESS and abs(whole_s - self.sample_interval_s) > _EXACTLY * whole_s:
            expected = f"a whole number of integration times of {self.aperture_s:g} s, without gaps"
            yield InvalidValue("sample_interval_s", expected, self.sample_interval_s)
        if self.mode is Mode.GAPLESS and self.readings_a_mean > self.burst_readings:
            expected = f"at least the {self.readings_a_mean} readings of one interval"
            yield InvalidValue("burst_readings", expected, self.burst_readings)


@routines.framed(routines.energised, routines.drive_seen, routines.held_at_rest)
def zero(settings: ZeroSettings) -> steps.Plan:
    """Record the output at rest: V_Vc off, the table (where there is one) held still under servo."""
    yield steps.Note(f"The output at rest for {settings.duration_s:g} s")
    yield steps.Settle(settings.settle_s, "gyro settles, at rest")
    table_deg_s = None if settings.station.limits.max_rate_deg_s is None else 0.0
    window = {**routines.window_of(settings), "samples": settings.readings}
    if settings.mode is Mode.GAPLESS:
        burst = settings.burst_readings // settings.readings_a_mean * settings.readings_a_mean
        window |= {"interval_s": settings.aperture_s, "burst": burst}
        taken = yield steps.AcquireGapless(1, 0.0, 0.0, table_deg_s, **window)
    else:
        taken = yield steps.Acquire(1, 0.0, 0.0, table_deg_s, **window)
    routines.require_alive(settings, answer(taken, steps.Window).point)
    yield from routines.require_answer(settings)


def results(settings: ZeroSettings, measured: Measured) -> Any:
    """Return the results of the record, or what a dry run expects of it."""
    (window,) = measured.readings.windows
    scale = scale_factor_used(settings)
    if isinstance(measured, Foreseen):
        if measured.white_v_sqrt_s < settings.meter_resolution_v * settings.aperture_s**0.5:
            return ForeseenZero()
        gapless = settings.mode is Mode.GAPLESS
        foreseen = Sampling(settings.sample_interval_s, settings.sample_interval_s if gapless else settings.aperture_s)
        expected = measured[0].output_v, settings.duration_s, measured.white_v_sqrt_s
        return foreseen_zero(*expected, sampling=foreseen, scale=scale, settings=settings)
    mode, volts = settings.mode.value, window.voltage_v
    if settings.mode is Mode.GAPLESS:
        sampling, raw = Sampling.without_gaps(settings.sample_interval_s), (volts, settings.readings_a_mean)
        return zero_results(block_means(*raw), window.t_s, sampling, scale, mode, settings=settings, raw=raw)
    bandwidth_hz = settings.passed_hz if settings.mode is Mode.CORRECTED else None
    sampling = Sampling(settings.sample_interval_s, settings.aperture_s, bandwidth_hz)
    u_hz = 0.0 if bandwidth_hz is None else settings.u_passed_hz
    return zero_results(volts, window.t_s, sampling, scale, mode, settings=settings, u_bandwidth_hz=u_hz)


def entry(settings: ZeroSettings, found: ZeroResult, made: Provenance) -> devices.NewEntry | None:
    """Return the entry of the device that was named; None where the record shows no flicker.

    The degrees of freedom of B squared are those that its u stands for: 2 / dof is the relative variance of the square.
    """
    if settings.dut is None or found.flicker is None:
        return None
    value, u = found.flicker
    scale_factor = found.scale_factor_v_per_deg_s
    record = devices.StaticNoise(
        serial=settings.dut,
        done=made.finished,
        valid_until=made.finished + timedelta(days=settings.validity_days),
        procedure="zero",
        bias_instability_deg_h=devices.Measured(value=value, u=u, dof=0.5 * (value / u) ** 2),
        duration_s=settings.duration_s,
        conditions=conditions_of(settings, made),
        remarks=(f"mode {found.mode}", f"scale factor {scale_factor.value:.6g} V/(deg/s): {scale_factor.source}"),
    )
    return devices.NewEntry(record, Path(settings.devices))


ZERO = Procedure(
    name="zero",
    method=(
        "After the wait under power the output is recorded at rest, the generator off and the table, where there is "
        "one, held under servo. Overlapping Allan deviations with 95 % confidence intervals give the noise "
        "coefficients by a weighted fit; means and slope give bias stability and trend."
    ),
    settings=ZeroSettings,
    plan=zero,
    results=results,
    report=lambda own, _, results: zero_report(results, bandwidth_stated=own.passed_hz is not None),
    entry=entry,
    needs=roles("power", "multimeter"),
    uses=roles("oscilloscope", "rate_source", "rate_table"),
)
