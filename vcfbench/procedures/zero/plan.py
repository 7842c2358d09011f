"""The static record: the output at rest for an hour or more, its noise and its bias.

The multimeter decides what the record shows. One reading a second that averages 0.2 s of it sees white noise as
strongly as 0.2 s do: sqrt(5) times too much at 1 s, and 2.6 times behind a sense mode whose split lets more through.
So there are three modes: the record as it stands, the same corrected for its dead time, and readings without gaps.
"""

from datetime import timedelta
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from vcfbench import steps
from vcfbench.instructions import routines
from vcfbench.instructions.kept import conditions_of
from vcfbench.instructions.procedure import Procedure, Provenance, roles
from vcfbench.instructions.scale_factor import rates_by
from vcfbench.procedures.zero.results import (
    Mode,
    ZeroResult,
    ZeroSettings,
    foreseen_zero,
    zero_report,
    zero_results,
)
from vcfbench.records import device_values, devices
from vcfbench.steps.measured import Foreseen, Measured
from vcfbench.steps.step import answer
from vcfbench.steps.stream import StreamSeen

MOST_LOST = 1e-3
"""Share of the frames of a stream that may be missing: a mean with gaps passes more of the noise at the split (ours).

1 % of 50 frames each makes N of the paper's gyroscope 5 % too large.
"""


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
    """Return the results of the record, or the expectation of a dry run."""
    if isinstance(measured, Foreseen):
        return foreseen_zero(settings, measured[0].output_v, measured.white_v_sqrt_s)
    return _of_record(settings, measured)


def _of_record(settings: ZeroSettings, measured: Measured) -> ZeroResult:
    (window,), scale = measured.readings.windows, routines.scale_factor_seen(settings, measured)
    seen = [each for _, each in measured.found(StreamSeen)]
    lost = max(((each.dropped + 2.0 * each.u_dropped + each.bad) / max(1, each.frames) for each in seen), default=0.0)
    if lost <= MOST_LOST or settings.passed_hz is None:
        return zero_results(settings, scale, window.voltage_v, window.t_s)
    found = zero_results(replace(settings, noise_bandwidth_hz=0.0), scale, window.voltage_v, window.t_s)
    most = "up to " if any(each.u_dropped for each in seen) else ""
    said = (
        f"{most}{100.0 * lost:.2g} % of the frames are missing: what noise passes the gaps is not known, "
        "N has a bound alone"
    )
    return replace(found, remarks=(*found.remarks, said))


def entry(settings: ZeroSettings, found: ZeroResult, made: Provenance) -> devices.NewEntry | None:
    """Return the entry of the device that was named; None where the record shows no flicker, or nothing its rate.

    The degrees of freedom of B squared are those that its u stands for: 2 / dof is the relative variance of the square.
    """
    if settings.dut is None or found.flicker is None or not routines.can_answer(settings):
        return None
    value, u = found.flicker
    scale_factor = found.scale_factor_v_per_deg_s
    record = devices.StaticNoise(
        serial=settings.dut,
        done=made.finished,
        valid_until=made.finished + timedelta(days=settings.validity_days),
        procedure="zero",
        bias_instability_deg_h=device_values.Measured(value=value, u=u, dof=0.5 * (value / u) ** 2),
        duration_s=settings.duration_s,
        conditions=conditions_of(settings, made),
        remarks=(f"mode {found.mode}", rates_by(scale_factor.value, scale_factor.source)),
    )
    return devices.NewEntry(record, Path(settings.devices))


ZERO = Procedure(
    name="zero",
    method=(
        "After the wait under power the output is recorded at rest, without V_Vc and the table, where there is "
        "one, held under servo. Overlapping Allan deviations with 95 % confidence intervals give the noise "
        "coefficients by a weighted fit; means and slope give bias stability and trend."
    ),
    settings=ZeroSettings,
    plan=zero,
    results=results,
    report=zero_report,
    entry=entry,
    streams=True,
    several=True,
    needs=roles("multimeter"),
    uses=roles("power", "oscilloscope", "rate_source", "rate_table"),
)
