"""True values of a calibration of a simulated gyroscope, in closed form.

Lines through the true outputs of the warm gyroscope (docs/theory.md), K_Vc where two outputs are equal, a meter that
does not load the gyroscope, rails as the run set them. So they hold for runs that let the gyroscope warm up
(`warm_up_s`, six of its time constants), and say nothing of the instruments' errors: those are what uncertainties are
about.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from msgspec import Struct

from vcfbench.archive.run import Run
from vcfbench.procedures.virtual_coriolis.results import NullVirtualCoriolisResult, VirtualCoriolisResult
from vcfbench.sim.simulation import true_output
from vcfbench.station.description import BenchDescription

Output = Callable[[float, float | None], float]


class Rates(Struct, frozen=True):
    """Settings of a four-step calibration: rates of the table, levels of V_Vc, rates at which V_Vc was matched."""

    table_deg_s: Sequence[float]
    levels_v: Sequence[float]
    matched_deg_s: Sequence[float]


def truth_of(run: Run, description: BenchDescription) -> Mapping[str, float]:
    """Return the true values of the results of `run` that have an uncertainty, by name; none without a closed form.

    The bench is that of `description`, which is simulated.
    """
    if run.procedure == "turntable":
        rates = [point.rate_deg_s for point in run.points if point.step == 1]
        return turntable_truth(true_output(description, rails_v=_rails_v(run)), rates)
    if not isinstance(run.results, VirtualCoriolisResult):
        return {}
    driven = [point for point in run.points if point.step == 4]
    measured = [point.v_vc_measured_v for point in driven]
    levels = [point.v_vc_v if seen is None else seen for point, seen in zip(driven, measured, strict=True)]
    matched = [run.results.match_rate_deg_s]
    if isinstance(run.results, NullVirtualCoriolisResult):
        matched = [pair.rate_deg_s for pair in run.results.pairs]
    table = [point.rate_deg_s for point in run.points if point.step == 3]
    output = true_output(description, at_input=None not in measured, rails_v=_rails_v(run))
    return four_step_truth(output, Rates(table, levels, matched))


def _rails_v(run: Run) -> tuple[float, float]:
    settings = run.header["settings"]
    return settings["positive_rail_v"], settings["negative_rail_v"]


def turntable_truth(output: Output, rates_deg_s: Sequence[float]) -> dict[str, float]:
    """Return scale factor, bias and non-linearity of the line through the true outputs at the table's rates."""
    on_table = [output(rate, None) for rate in rates_deg_s]
    slope, bias = _line(rates_deg_s, on_table)
    nonlinearity = _nonlinearity_ppm(rates_deg_s, on_table)
    return {"scale_factor": slope, "bias": bias, "bias_deg_s": bias / slope, "nonlinearity": nonlinearity}


def four_step_truth(output: Output, at: Rates) -> dict[str, float]:
    """Return the true values of the four steps: K_Vc, both lines, and how they differ.

    From one rate K_Vc is rate over V_Vc, from two the slope between them, from more a cubic, whose constant counts not.
    V_Vc is what `output` takes it for: the level of the open generator, or that at the input, where a meter sees it.
    """
    table = turntable_truth(output, at.table_deg_s)
    curve = _matched(output, at.matched_deg_s)
    rates = [sum(c * v ** (place + 1) for place, c in enumerate(curve)) for v in at.levels_v]
    driven = [output(0.0, v) for v in at.levels_v]
    slope, bias = _line(rates, driven)
    return {
        "k_vc": curve[0],
        **{f"turntable.{name}": value for name, value in table.items()},
        "virtual.scale_factor": slope,
        "virtual.bias": bias,
        "virtual.bias_deg_s": bias / slope,
        "virtual.nonlinearity": _nonlinearity_ppm(rates, driven),
        "scale_factor_error_percent": 100.0 * (slope / table["scale_factor"] - 1.0),
        "bias_difference_v": bias - table["bias"],
    }


def _matched(output: Output, rates_deg_s: Sequence[float]) -> list[float]:
    """Return the rate that V_Vc stands for as coefficients of its powers, the first one first."""

    def matched_v(rate_deg_s: float) -> float:
        span = output(rate_deg_s, None) - output(0.0, None)
        slope = (output(0.0, 1e-3) - output(0.0, 0.0)) / 1e-3
        return _root(lambda volts: output(0.0, volts) - output(0.0, 0.0) - span, 0.0, 2.0 * span / slope)

    pairs_v = [matched_v(rate) for rate in rates_deg_s]
    order = 3 if len(pairs_v) > 2 else 1
    powers = np.power.outer(np.asarray(pairs_v), np.arange(0 if len(pairs_v) > 1 else 1, order + 1))
    found = np.linalg.lstsq(powers, np.asarray(rates_deg_s), rcond=None)[0][-order:]
    return [float(each) for each in found]


def _nonlinearity_ppm(x: Sequence[float], y: Sequence[float]) -> float:
    """Return the largest distance from the line over its span, ppm."""
    slope, intercept = _line(x, y)
    largest = max(abs(out - slope * at - intercept) for at, out in zip(x, y, strict=True))
    return 1e6 * largest / (abs(slope) * (max(x) - min(x)))


def _line(x: Sequence[float], y: Sequence[float]) -> tuple[float, float]:
    slope, intercept = np.polyfit(x, y, 1)
    return float(slope), float(intercept)


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """Return where `function` is zero between `low` and `high`, by bisection."""
    rising = function(high) > function(low)
    for _ in range(100):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if (function(middle) > 0.0) == rising else (middle, high)
    return 0.5 * (low + high)
