"""A least-squares line of outputs against rates, and the sources of its errors: readings, meter, table, Earth."""

import math
from typing import Any, Self

import numpy as np
from msgspec import Struct

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.budget import Source
from vcfbench.instructions.schedule import earth_left_deg_s
from vcfbench.station.settings import ProcedureSettings, Sources
from vcfbench.uncertainty.windows import OutputSum, Sweep, line_weights
from vcfbench.values.sources import METER_GAIN, METER_OFFSET, TABLE_RATE, TILT, WARM_UP, Errors, noise_of

ASYMMETRY = "asymmetry"


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
        return line_weights(self.rate_deg_s)[0]

    @property
    def bias_weights(self) -> Floats:
        """Weights of the outputs in the intercept."""
        return line_weights(self.rate_deg_s)[1]


def line_sums(name: str, line: Line) -> list[OutputSum]:
    """Return slope and bias of a line as sums of the outputs of all windows."""
    return [
        OutputSum(f"{name} slope", line.slope_weights @ line.mixing, "V/(deg/s)"),
        OutputSum(f"{name} bias", line.bias_weights @ line.mixing, "V", steady=True),
    ]


class Asymmetry(Struct, frozen=True):
    """Difference of the slopes of both sides of zero, each with its own intercept, over their mean, ppm.

    The zero belongs to both. What is common to all outputs or all rates, gain, offset, table rate, cancels; a warm-up
    does not, since one side is taken after the other.
    """

    ppm: float
    of_outputs: Floats
    """Change by each output of the line, ppm/V."""
    ppm_per_k: float
    """Change by a kelvin that the gyroscope may be away from warm when its first window begins, ppm/K."""

    @classmethod
    def of(cls, settings: ProcedureSettings, line: Line) -> Self | None:
        """Return that of a line whose windows follow each other; None without two rates on either side of zero."""
        slopes, weights = [], []
        for side in (line.rate_deg_s >= 0.0, line.rate_deg_s <= 0.0):
            rate = line.rate_deg_s[side]
            if len(set(rate.tolist())) < 2:
                return None
            of_side = np.zeros_like(line.rate_deg_s)
            of_side[side] = (rate - rate.mean()) / float(np.square(rate - rate.mean()).sum())
            weights.append(of_side)
            slopes.append(float(of_side @ line.output_v))
        both, share = sum(slopes), (slopes[0] - slopes[1]) / sum(slopes)
        of_outputs = 2e6 / both * (weights[0] - weights[1] - share * (weights[0] + weights[1]))
        known = settings.station.sources
        ramps_s = np.abs(np.diff(line.rate_deg_s, prepend=line.rate_deg_s[0])) / settings.acceleration_deg_s2
        at_s = np.cumsum(settings.samples * settings.sample_interval_s + settings.settle_s + ramps_s)
        by_factor = 1e-6 * (known.scale_factor_ppm_k or 0.0) * line.scale_factor * line.rate_deg_s * of_outputs
        by_bias = (known.bias_deg_h_k or 0.0) / 3600.0 * line.scale_factor * of_outputs
        if "warm_up_time_s" in known.assumed:  # whatever falls from 1 to 0 is made of steps
            moved = sum(float(np.abs(np.cumsum(each)).max()) for each in (by_factor, by_bias))
        else:
            # all of it happens, and only its sign is not known: so its u is the whole, not a rectangle's share
            left = np.exp(-at_s / known.warm_up_time_s)
            moved = math.sqrt(3.0) * sum(abs(float(each @ left)) for each in (by_factor, by_bias))
        return cls(2e6 * share, np.asarray(of_outputs), moved)

    def value(self, q: Errors) -> Any:
        """Return the asymmetry corrected for the errors `q`, ppm (U3)."""
        return self.ppm - noise_of(ASYMMETRY, q) - self.ppm_per_k * q.get(WARM_UP, 0.0)


def limited(name: str, limit: float | None, unit: str, sigmas: float | None = None) -> Source:
    """Return a source within a limit: normal with so many sigmas, else rectangular; not known: none."""
    if limit is None or sigmas is not None:
        return Source(name, 0.0, (limit or 0.0) / (sigmas or 1.0), unit)
    return Source.within(name, 0.0, limit, unit)


def table_values(line: Line, q: Errors, null_v: float = 0.0) -> dict[str, Any]:
    """Return scale factor (U1) and bias (U2) of the line on the table, the errors `q` taken out.

    As a rate the bias counts from the output `null_v`.
    """
    gain = 1.0 + q[METER_GAIN]
    slope = (line.scale_factor - noise_of("table slope", q)) / gain / (1.0 + q[TABLE_RATE])
    bias = (line.bias_v - noise_of("table bias", q) - q[METER_OFFSET] - q.get(TILT, 0.0)) / gain
    return {"scale_factor": slope, "bias": bias, "bias_deg_s": (bias - null_v) / slope}


def instrument_sources(known: Sources) -> list[Source]:
    """Return the contributions of multimeter and table to every line."""
    return [
        limited(METER_GAIN, known.meter_gain, "1", known.meter_sigmas),
        limited(METER_OFFSET, known.meter_offset_v, "V", known.meter_sigmas),
        limited(TABLE_RATE, known.table_rate, "1"),
    ]


def earth_sources(settings: ProcedureSettings, scale_factor: float) -> list[Source]:
    """Return the residual of the Earth's rate where it was added to the rates."""
    left_deg_s = earth_left_deg_s(settings)
    return [] if left_deg_s is None else [Source.within(TILT, 0.0, abs(scale_factor) * left_deg_s, "V")]
