"""Uncertainty of single windows: of a sum of them, each with its weight, and of one output as the meter reads it."""

import math
from collections.abc import Iterator, Mapping, Sequence

from vcfbench.analysis.modulation import flicker_share
from vcfbench.instructions.scale_factor import AtRestSettings, scale_factor_used
from vcfbench.instructions.v_vc import meter_error
from vcfbench.records.schema import Point, fits_one_chunk, pooled_std_v
from vcfbench.station.invalid_value import InvalidValue
from vcfbench.station.settings import ProcedureSettings
from vcfbench.steps import Window
from vcfbench.uncertainty.measurand import measurand
from vcfbench.values.sources import METER_GAIN, METER_OFFSET
from vcfbench.values.value import Measurand, UncertaintyPart


def windows_without_times(settings: ProcedureSettings) -> Iterator[InvalidValue]:
    """Yield the windows without times, because their readings are in the journal alone."""
    if not fits_one_chunk(settings.samples, settings.sample_interval_s):
        yield InvalidValue("samples", "windows of 60 s and 1000 readings at most", settings.samples)


def noise_v(
    settings: AtRestSettings, windows: Sequence[Window], weights: Mapping[int, float], scattering: Sequence[Point]
) -> list[UncertaintyPart]:
    """Return the effect of readings, flicker and the last digit, V.

    `weights` are by the place in `windows` and add up to 0; the scatter of one reading is that of `scattering`.
    """
    known, lasts_s = settings.station.sources, settings.samples * settings.sample_interval_s
    size, begins_s = math.hypot(*weights.values()), [float(windows[each].readings[0].t_s) for each in weights]
    share = math.sqrt(flicker_share(begins_s, lasts_s, list(weights.values())))
    b_v = (known.bias_instability_deg_h or 0.0) / 3600.0 * abs(scale_factor_used(settings).value)
    readings_v = size * pooled_std_v(scattering) / math.sqrt(settings.samples)
    return [
        UncertaintyPart("readings", readings_v, sum(each.n - 1 for each in scattering)),
        UncertaintyPart("flicker", b_v * share, known.bias_instability_dof),
        UncertaintyPart("last digit", size * settings.meter_resolution_v / math.sqrt(12.0)),
    ]


def output_of(settings: ProcedureSettings, point: Point) -> Measurand:
    """Return the output of one window as the multimeter reads it, V; noise slower than the window is not in it."""
    meter = meter_error(settings, "multimeter")
    parts = [
        UncertaintyPart("readings", point.std_v / math.sqrt(point.n), point.n - 1),
        UncertaintyPart("last digit", settings.meter_resolution_v / math.sqrt(12.0)),
        UncertaintyPart(METER_GAIN, abs(point.output_v) * meter.u_gain, of=meter.owner),
        UncertaintyPart(METER_OFFSET, meter.u_offset_v, of=meter.owner),
    ]
    return measurand(point.output_v, "V", parts)
