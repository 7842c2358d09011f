"""The uncertainty budget of a calibration on the rate table: scale factor, bias and non-linearity of its line."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

from vcfbench.procedures.shared.budget import line as lines
from vcfbench.procedures.shared.budget.nonlinearity import CurvedLine, ValueModel, with_nonlinearity
from vcfbench.procedures.shared.budget.statement import Statement, statement
from vcfbench.procedures.shared.sweep.window_noise import WindowNoise
from vcfbench.procedures.shared.sweep.windows import sweep_of
from vcfbench.records.schema import Point
from vcfbench.station.settings import ProcedureSettings

_MEANINGS = MappingProxyType(
    {
        "scale_factor": (
            "V/(deg/s)",
            "slope of the least-squares line through the outputs on the table at these rates",
        ),
        "bias": ("V", "intercept of that line, Earth's rate in it, mean of the horizon"),
        "bias_deg_s": ("deg/s", "the same as a rate"),
    }
)


def turntable_statement(settings: ProcedureSettings, points: Sequence[Point], step: int = 1) -> Statement:
    """Return the budget of a calibration on the table: scale factor and bias of its line."""
    line = lines.Line.of(sweep_of(settings, points, step))
    known = settings.station.sources
    sums = lines.line_sums("table", line)
    noise = WindowNoise.of(settings, points, line.scale_factor)
    sources, correlations = noise.sources(sums)
    sources += [*lines.instrument_sources(known), *lines.earth_sources(settings, line.scale_factor)]

    def model(q: Mapping[str, Any]) -> Mapping[str, Any]:
        return table_values(line, q)

    stated = statement(settings, sources, model, correlations, _MEANINGS, flicker=noise.flicker)
    budget = ValueModel(sources, sums, model, noise)
    return with_nonlinearity(settings, stated, budget, [CurvedLine.of("nonlinearity", line)])


def table_values(line: lines.Line, q: Mapping[str, Any]) -> dict[str, Any]:
    """Return scale factor and bias of the line on the table as the sources `q` move them."""
    gain = 1.0 + q["meter gain"]
    slope = (line.scale_factor - lines.noises_of("table slope", q)) / gain / (1.0 + q["table rate"])
    bias = (line.bias_v - lines.noises_of("table bias", q) - q["meter offset"] - q.get(lines.TILT, 0.0)) / gain
    return {"scale_factor": slope, "bias": bias, "bias_deg_s": bias / slope}
