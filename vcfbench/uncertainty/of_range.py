"""The scale factor of the declared range of a device, for any rates of the run."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from msgspec.structs import replace

from vcfbench.analysis.shared_curve import Windows, slopes_over
from vcfbench.records.schema import Point
from vcfbench.station.settings import ProcedureSettings
from vcfbench.uncertainty.statement import StatedValue
from vcfbench.uncertainty.windows import WindowNoise, line_weights, sweep_of
from vcfbench.values.definition import Definition
from vcfbench.values.value import UncertaintyPart, Value

_REACHED: Final = 0.9
"""Part of the range that a run must reach on both sides."""
_LEAST_LEVELS: Final = 5


def windows_of(settings: ProcedureSettings, points: Sequence[Point], step: int) -> Windows:
    """Return the windows of a line on the table, over the slope of that line."""
    sweep = sweep_of(settings, points, step)
    rate = np.array([point.rate_deg_s for point in sweep.points])
    output = np.array([point.output_v for point in sweep.points])
    slope = float(line_weights(rate)[0] @ output)
    noise = WindowNoise.of(settings, points, slope)
    white = noise.by_readings(sweep.mixing)
    covariance = white + noise.by_flicker(sweep.mixing, [True] * rate.size)
    mean = math.sqrt(float(np.diag(white).mean())) / abs(slope)
    return Windows(rate, output / slope, covariance / slope**2, mean)


def scale_factor_of_range(
    settings: ProcedureSettings, points: Sequence[Point], step: int, line: StatedValue
) -> tuple[Value, ...]:
    """Return the scale factor over the declared range, half of it and rest, by the curve of the run.

    None where no range is declared, or where the run did not reach nine tenths of it at five rates or more.
    """
    range_deg_s = settings.station.gyro.range_deg_s
    rates = [point.rate_deg_s for point in points if point.step == step]
    if range_deg_s is None or not (min(rates) <= -_REACHED * range_deg_s < _REACHED * range_deg_s <= max(rates)):
        return ()
    if len(set(rates)) < _LEAST_LEVELS:
        return ()
    over = Definition.of([range_deg_s * each for each in (1.0, 0.5, 0.0, -0.5, -1.0)])
    slopes = slopes_over([rate for rate, _ in over.levels_deg_s], [windows_of(settings, points, step)])
    ratio, own = float(slopes.values[0]), abs(line.value) * math.sqrt(float(slopes.covariance[0, 0]))
    noise = [part for part in line.parts if part.source.startswith(("readings", "flicker"))]
    dof = min((part.dof or math.inf for part in noise), default=math.inf)
    parts = [UncertaintyPart(part.source, ratio * part.u, part.dof) for part in line.parts if part not in noise]
    parts.append(UncertaintyPart("readings, flicker and the curve", own, dof if math.isfinite(dof) else None))
    u = math.hypot(*(part.u for part in parts))
    of = f"slope of the least-squares line over {over.levels_words}, the declared range, by the curve of this run"
    freedom, name = u**4 / own**4 * dof if own and math.isfinite(dof) else None, "scale_factor_of_range"
    found = Value(name, ratio * line.value, line.unit, u, freedom, kind=name, of=of, parts=parts, definition=over)
    return (replace(found, missing=line.missing),)
