"""The phase of the rate response, where the oscilloscope sees both V_Vc and the output: one sine through both records.

Both channels are sampled at the same instants, so nothing has to be known of when the generator or a meter began.
"""

import math
from collections.abc import Callable, Sequence
from statistics import fmean, stdev

from msgspec import Struct

from vcfbench import steps
from vcfbench.procedures.shared.measurand import Measurand, UncertaintyPart, measurand
from vcfbench.procedures.shared.routines import set_sine
from vcfbench.reports.document import Axis, Figure, Series, Table, heads
from vcfbench.station.settings import ProcedureSettings
from vcfbench.steps.measured import Measured
from vcfbench.steps.step import Routine

RECORDS = 4
_PERIODS = 4.0
"""A record, at least."""
_DIVISIONS_WIDE = 10.0
_ROOM = 1.1


class PhasePoint(Struct, frozen=True):
    """Phase of the output against V_Vc at one frequency, deg, that at rest (0 or half a turn) taken off.

    The low-pass filter is in it. Phases go on from one frequency to the next, beyond half a turn above the split.
    """

    frequency_hz: float
    phase_deg: Measurand


def phase_channels(settings: ProcedureSettings) -> tuple[int, int] | None:
    """Return the oscilloscope's channels that see V_Vc and the output; None where it does not see both."""
    wiring = settings.station.oscilloscope
    if wiring is None:
        return None
    v_vc, output = wiring.channel_of("v_vc"), wiring.channel_of("output")
    return None if v_vc is None or output is None else (v_vc, output)


def phases_of(
    settings: ProcedureSettings, amplitude_v: float, found: Sequence[tuple[float, steps.SineResponse]]
) -> Routine[None]:
    """Capture V_Vc and output at each frequency; the meter's samples `found` there tell the output's size."""
    channels = phase_channels(settings)
    if channels is None:
        return
    yield steps.Note("V_Vc and output on the oscilloscope: the phase between them")
    for frequency_hz, response in sorted(found, key=lambda each: each[0]):
        largest_v = _ROOM * max(*map(abs, response.voltages_v), settings.meter_resolution_v)
        lasts_s = _PERIODS / frequency_hz
        yield from set_sine(settings, frequency_hz, amplitude_v)
        yield steps.ConfigureScope(lasts_s / _DIVISIONS_WIDE, channels[0])
        expected = steps.SineRecord(frequency_hz, (amplitude_v, largest_v), (0.0, 0.0))
        yield steps.CaptureSines(channels, (_ROOM * amplitude_v, largest_v), RECORDS, expected, lasts_s)


def measured_phases(
    settings: ProcedureSettings, measured: Measured, expected_deg: Callable[[float], float]
) -> tuple[PhasePoint, ...]:
    """Return the phases that were measured, in the order of their frequencies; none where none were.

    `expected_deg` tells about where the first one is, since output and V_Vc are in phase or opposed at rest, as the
    signs of scale factor and K_Vc have it.
    """
    channels = phase_channels(settings)
    points: list[PhasePoint] = []
    at_rest_deg = 0.0
    for step, taken in measured.found(steps.SineRecords):
        if channels is None or taken.channels != channels or not isinstance(step, steps.CaptureSines):
            continue
        frequency_hz, seen = step.expected.frequency_hz, [each.phases_deg[1] for each in taken.records]
        if points:
            near_deg = points[-1].phase_deg.value
        else:
            near_deg = expected_deg(frequency_hz)
            at_rest_deg = 180.0 * round(math.remainder(seen[0] - near_deg, 360.0) / 180.0)
        turned = [near_deg + math.remainder(each - at_rest_deg - near_deg, 360.0) for each in seen]
        u_deg = stdev(turned) / math.sqrt(len(turned))
        parts = [UncertaintyPart("scatter of the records", u_deg, len(turned) - 1.0)]
        points.append(PhasePoint(frequency_hz, measurand(fmean(turned), "deg", parts)))
    return tuple(points)


def phase_parts(points: Sequence[PhasePoint]) -> list[Table | Figure]:
    """Lay out the phases, and draw them."""
    if not points:
        return []
    columns = heads("frequency [Hz]:.4g | phase [deg] | u [deg] | U95 [deg]")
    rows = [(each.frequency_hz, *each.phase_deg.printed()) for each in points]
    at_hz, phases = [each.frequency_hz for each in points], [each.phase_deg for each in points]
    series = Series("measured", at_hz, [each.value for each in phases], [each.u for each in phases])
    title = "Phase of the output against V_Vc, the low-pass filter in it"
    return [Table(columns, rows, title), Figure(title, Axis("frequency", "Hz", "log"), Axis("phase", "deg"), [series])]
