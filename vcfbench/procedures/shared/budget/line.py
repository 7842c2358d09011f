"""A least-squares line of outputs against rates, and the sources of its errors: readings, meter, table, Earth."""

from collections.abc import Mapping
from typing import Any, Self

import numpy as np
from msgspec import Struct

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.budget import Source
from vcfbench.procedures.shared.sweep.schedule import earth_left_deg_s
from vcfbench.procedures.shared.sweep.windows import OutputSum, Sweep
from vcfbench.station.settings import ProcedureSettings, Sources

TILT = "Earth's rate by the axis' tilt"


class Line(Struct, frozen=True):
    """A least-squares line as sums over windows."""

    rate_deg_s: Floats
    output_v: Floats
    scale_factor: float
    bias_v: float
    derivative: Floats
    """Slope of the curve through the outputs at each rate, V/(deg/s)."""

    mixing: Floats
    """Weights of all windows' outputs in the outputs of the line: the windows' own, less a drift of zeros."""

    @classmethod
    def of(cls, sweep: Sweep) -> Self:
        """Return the line of the windows of a sweep."""
        rate = np.array([point.rate_deg_s for point in sweep.points])
        output = np.array([point.output_v for point in sweep.points])
        scale_factor, bias_v = np.polynomial.Polynomial.fit(rate, output, 1).convert().coef[::-1]
        order = 3 if len(set(rate.tolist())) > 4 else 1
        derivative = np.polynomial.Polynomial.fit(rate, output, order).deriv()(rate)
        return cls(rate, output, float(scale_factor), float(bias_v), np.asarray(derivative), sweep.mixing)

    @property
    def slope_weights(self) -> Floats:
        """Weights of the outputs in the slope, 1/(deg/s)."""
        off = self.rate_deg_s - self.rate_deg_s.mean()
        return np.asarray(off / float(off @ off))

    @property
    def bias_weights(self) -> Floats:
        """Weights of the outputs in the intercept."""
        return np.asarray(1.0 / self.rate_deg_s.size - self.rate_deg_s.mean() * self.slope_weights)


def line_sums(name: str, line: Line) -> list[OutputSum]:
    """Return slope and bias of a line as sums of the outputs of all windows."""
    return [
        OutputSum(f"{name} slope", line.slope_weights @ line.mixing, "V/(deg/s)"),
        OutputSum(f"{name} bias", line.bias_weights @ line.mixing, "V", steady=True),
    ]


def noises_of(name: str, q: Mapping[str, Any]) -> Any:
    """Return the contribution of readings and flicker to a sum of outputs."""
    return q[f"readings: {name}"] + q[f"flicker: {name}"]


def limited(name: str, limit: float | None, unit: str, sigmas: float | None = None) -> Source:
    """Return a source within a limit: normal with so many sigmas, else rectangular; not known: none."""
    if limit is None or sigmas is not None:
        return Source(name, 0.0, (limit or 0.0) / (sigmas or 1.0), unit)
    return Source.within(name, 0.0, limit, unit)


def table_values(line: Line, q: Mapping[str, Any]) -> dict[str, Any]:
    """Return scale factor and bias of the line on the table as the sources `q` move them."""
    gain = 1.0 + q["meter gain"]
    slope = (line.scale_factor - noises_of("table slope", q)) / gain / (1.0 + q["table rate"])
    bias = (line.bias_v - noises_of("table bias", q) - q["meter offset"] - q.get(TILT, 0.0)) / gain
    return {"scale_factor": slope, "bias": bias, "bias_deg_s": bias / slope}


def instrument_sources(known: Sources) -> list[Source]:
    """Return the contributions of multimeter and table to every line."""
    return [
        limited("meter gain", known.meter_gain, "1", known.meter_sigmas),
        limited("meter offset", known.meter_offset_v, "V", known.meter_sigmas),
        limited("table rate", known.table_rate, "1"),
    ]


def earth_sources(settings: ProcedureSettings, scale_factor: float) -> list[Source]:
    """Return the residual of the Earth's rate where it was added to the rates."""
    left_deg_s = earth_left_deg_s(settings)
    return [] if left_deg_s is None else [Source.within(TILT, 0.0, abs(scale_factor) * left_deg_s, "V")]
