"""True values of a calibration of a simulated gyroscope, in closed form.

Lines through the true outputs of the warm gyroscope (docs/theory.md), K_Vc where two outputs are equal, a meter that
does not load the gyroscope, rails as the run set them. So they hold for runs that let the gyroscope warm up
(`warm_up_s`, six of its time constants), and say nothing of the instruments' errors: those are what uncertainties are
about.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from statistics import fmean

import numpy as np

from vcfbench.archive.run import Run
from vcfbench.instructions.schedule import EARTH_DEG_S
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.layers import recorded_settings
from vcfbench.procedures.virtual_coriolis.results import NullVirtualCoriolisResult, VirtualCoriolisResult
from vcfbench.sim.simulation import true_output
from vcfbench.station.description import BenchDescription

Output = Callable[[float, float | None], float]


def truth_of(run: Run, description: BenchDescription) -> Mapping[str, float]:
    """Return the true values of the results of `run` that have an uncertainty, by name; none without a closed form.

    The bench is that of `description`, which is simulated.
    """
    if run.procedure not in {"turntable", "kvc", "self-calibration", "virtual-coriolis"}:
        return {}
    settings = recorded_settings(PROCEDURES[run.procedure], run.header["settings"])
    if run.procedure == "turntable":
        rates = [point.rate_deg_s for point in run.points if point.step == 1]
        output = true_output(description, rails_v=settings.rails_v)
        return turntable_truth(output, rates, earth_deg_s=_earth_deg_s(run), null_v=settings.null_v)
    if run.procedure in {"kvc", "self-calibration"}:
        return small_signal_truth(true_output(description, at_input=True, rails_v=settings.rails_v))
    results = run.results
    if not isinstance(results, VirtualCoriolisResult):
        return {}
    driven = [point for point in run.points if point.step == 4]
    measured = [point.v_vc_measured_v for point in driven]
    levels = [point.v_vc_v if seen is None else seen for point, seen in zip(driven, measured, strict=True)]
    matched = [results.match_rate_deg_s]
    if isinstance(results, NullVirtualCoriolisResult):
        matched = [pair.rate_deg_s for pair in results.pairs]
    table = [point.rate_deg_s for point in run.points if point.step == 3]
    output = true_output(description, at_input=None not in measured, rails_v=settings.rails_v)
    at_zero = [point.v_vc_measured_v for point in run.points if point.step == 2 and not point.v_vc_v]
    zeros_v = [each for each in at_zero if each is not None]
    return four_step_truth(
        output,
        table_deg_s=table,
        levels_v=levels,
        matched_deg_s=matched,
        earth_deg_s=_earth_deg_s(run),
        zero_level_v=fmean(zeros_v) if zeros_v else 0.0,
        null_v=settings.null_v,
    )


def _earth_deg_s(run: Run) -> float:
    """Return the Earth's rate that the run added to its rates, deg/s."""
    settings = run.header["settings"]
    if settings.get("earth", "bias") == "bias":
        return 0.0
    return EARTH_DEG_S * math.sin(math.radians(settings["station"]["latitude_deg"]))


def turntable_truth(
    output: Output, rates_deg_s: Sequence[float], *, earth_deg_s: float = 0.0, null_v: float = 0.0
) -> dict[str, float]:
    """Return scale factor, bias and non-linearity of the line through the true outputs at the table's rates.

    `earth_deg_s` is added to these, so that the bias is without it; as a rate it counts from the output `null_v`.
    """
    return _line([rate + earth_deg_s for rate in rates_deg_s], [output(rate, None) for rate in rates_deg_s], null_v)


def small_signal_truth(output: Output) -> dict[str, float]:
    """Return bias, V, scale factor and K_Vc at rest, of small signals, for an `output` as a function of V_Vc."""
    slope = (output(0.01, None) - output(-0.01, None)) / 0.02
    per_volt = (output(0.0, 1e-4) - output(0.0, -1e-4)) / 2e-4
    return {"bias": output(0.0, None), "scale_factor": slope, "k_vc": per_volt / slope}


def four_step_truth(
    output: Output,
    *,
    table_deg_s: Sequence[float],
    levels_v: Sequence[float],
    matched_deg_s: Sequence[float],
    earth_deg_s: float = 0.0,
    zero_level_v: float = 0.0,
    null_v: float = 0.0,
) -> dict[str, float]:
    """Return the true values of the four steps: K_Vc, both lines, and their difference.

    From one rate K_Vc is rate over V_Vc, from two the slope between them, from more a cubic, whose constant counts not.
    Outputs count from their own zeros, however they were matched: what a match of the outputs as they are leaves of
    both zeros' difference is its error.
    V_Vc is what `output` takes it for: the level of the open generator, or that at the input, where a meter sees it.

    Args:
        output: true output, V, of a rate and a V_Vc.
        table_deg_s: rates of the table.
        levels_v: levels of V_Vc.
        matched_deg_s: rates at which V_Vc was matched.
        earth_deg_s: added to the rates of both columns.
        zero_level_v: V_Vc from which the matched levels count: that of a generator set to 0 V.
        null_v: output from which a bias counts as a rate.
    """
    curve = _matched(output, matched_deg_s, zero_level_v)
    rates = [earth_deg_s + sum(c * v ** (place + 1) for place, c in enumerate(curve)) for v in levels_v]
    table, virtual = (
        turntable_truth(output, table_deg_s, earth_deg_s=earth_deg_s, null_v=null_v),
        _line(rates, [output(0.0, v) for v in levels_v], null_v),
    )
    return {
        "k_vc": curve[0],
        **{f"turntable.{name}": value for name, value in table.items()},
        **{f"virtual.{name}": value for name, value in virtual.items()},
        "scale_factor_error_percent": 100.0 * (virtual["scale_factor"] / table["scale_factor"] - 1.0),
        "bias_difference_v": virtual["bias"] - table["bias"],
    }


def _matched(output: Output, rates_deg_s: Sequence[float], zero_level_v: float) -> list[float]:
    """Return the rate that V_Vc stands for as coefficients of its powers, the first one first."""
    zero_v = output(0.0, zero_level_v)
    slope = (output(0.0, zero_level_v + 1e-3) - zero_v) / 1e-3

    def matched_v(rate_deg_s: float) -> float:
        aim_v, level_v = zero_v + output(rate_deg_s, None) - output(0.0, None), zero_level_v
        for _ in range(100):  # nearly a line: each step leaves a small part of what is missing
            level_v += (aim_v - output(0.0, level_v)) / slope
        return level_v - zero_level_v

    pairs_v = [matched_v(rate) for rate in rates_deg_s]
    order = 3 if len(pairs_v) > 2 else 1
    powers = np.power.outer(np.asarray(pairs_v), np.arange(0 if len(pairs_v) > 1 else 1, order + 1))
    found = np.linalg.lstsq(powers, np.asarray(rates_deg_s), rcond=None)[0][-order:]
    return [float(each) for each in found]


def _line(rates_deg_s: Sequence[float], output_v: Sequence[float], null_v: float) -> dict[str, float]:
    """Return the line through true outputs, and the largest distance from it over its span, ppm."""
    slope, bias = map(float, np.polyfit(rates_deg_s, output_v, 1))
    largest_v = max(abs(out - slope * rate - bias) for rate, out in zip(rates_deg_s, output_v, strict=True))
    bend_ppm = 1e6 * largest_v / (abs(slope) * (max(rates_deg_s) - min(rates_deg_s)))
    return {"scale_factor": slope, "bias": bias, "bias_deg_s": (bias - null_v) / slope, "nonlinearity": bend_ppm}
