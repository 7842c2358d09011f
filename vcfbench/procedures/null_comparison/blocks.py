"""Results of chopped blocks: their noise, the V_Vc of equal outputs, the output at rest."""

import math
from collections.abc import Sequence

import numpy as np

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.chopped import CHOPPED, Block, BlockNoise, block_noise, polynomial_through_zero
from vcfbench.errors import ConfigError, MeasurementError
from vcfbench.instructions.v_vc import KnownVvcSettings, levels_by_hand, measured_level, v_vc_error
from vcfbench.procedures.null_comparison.plan import block
from vcfbench.records.schema import Point, pooled_std_v
from vcfbench.station.settings import ProcedureSettings
from vcfbench.uncertainty.at_rest import about_horizon, flicker_counted, flicker_part, parts_at_rest
from vcfbench.uncertainty.measurand import finite, measurand
from vcfbench.uncertainty.windows import Flicker, window_times
from vcfbench.values.value import Measurand, UncertaintyPart


def nulled_levels(v_vc_v: Floats, zero_v_vc_v: float, driven_v: Floats, left_v: Floats) -> tuple[Floats, Floats]:
    """Return the V_Vc of the null, V, and the slope of the output there, V/V.

    Along a smooth curve through all outputs, with its slope halfway: what was left is a thousandth, or some per cent
    where a generator changes its range, and the slope is good to some parts in a thousand. V_Vc moved the output by
    `driven_v` from the zeros; `left_v` is that less what the table moved it by.
    """
    at = v_vc_v - zero_v_vc_v
    response, _, _ = polynomial_through_zero(at, driven_v, np.eye(at.size), min(5, at.size - 1))
    slopes = derivative_of(response)
    matched: Floats = at
    for _ in range(3):
        matched = at - left_v / np.polynomial.polynomial.polyval(0.5 * (at + matched), slopes)
    per_v = np.polynomial.polynomial.polyval(matched, slopes)
    return matched + zero_v_vc_v, np.asarray(per_v)


def derivative_of(from_first: Floats) -> Floats:
    """Return the derivative of a polynomial without a constant."""
    return np.asarray(np.polynomial.polynomial.polyder(np.array([0.0, *from_first])))


def bias_at_rest(
    settings: KnownVvcSettings, points: Sequence[Point], step: int, noise: BlockNoise, scale_factor: float
) -> Measurand:
    """Return the mean output of the windows of `step` at rest, the generator off, V, as that of the horizon.

    `points` are all of the run, in the order of time; the `scale_factor` is in V/(deg/s).
    """
    places = [place for place, point in enumerate(points) if point.step == step and point.rate_deg_s == 0.0]
    begin, end = (each[places] for each in window_times(settings, points))
    zeros = np.array([points[place].output_v for place in places])
    # The flicker that counts in a run whose own blocks know it badly; the density is B^2 / (pi f)
    per_v2 = math.pi * (3600.0 / scale_factor) ** 2
    known = settings.station.sources
    stated = None if "bias_instability_deg_h" in known.assumed else Flicker.stated(known)  # a guess tells nothing
    flicker = flicker_counted(stated, per_v2 * noise.flicker_v2, per_v2 * noise.u_flicker_v2, "blocks of this run")
    per_b = abs(scale_factor) / 3600.0 * about_horizon(begin, end, settings.station.sources.horizon_h)
    mean_v = float(zeros.mean())
    parts = [
        UncertaintyPart("readings at rest", noise.white_v / math.sqrt(zeros.size), finite(noise.dof)),
        flicker_part(flicker, per_b),
        *parts_at_rest(settings, mean_v, scale_factor, float(end[-1] - begin[0])),
    ]
    return measurand(mean_v, "V", parts, settings.station.sources.missing("bias"), "bias_at_rest")


def block_covariance(noise: BlockNoise, blocks: int, cycles: int) -> Floats:
    """Return the covariance of the differences of `blocks` blocks, each the mean of `cycles`, V^2: +, -, +, -, ..."""
    return np.asarray(np.kron(np.eye(blocks), np.array(noise.covariance_v2)) / cycles)


def blocks_of(points: Sequence[Point]) -> list[Sequence[Point]]:
    """Return the points in blocks; ConfigError: they are no whole blocks."""
    size = len(CHOPPED)
    blocks = [points[at : at + size] for at in range(0, len(points), size)]
    if not blocks or len(blocks[-1]) != size:
        raise ConfigError(f"expected whole blocks of {size} windows, got {len(points)} windows")
    return blocks


def mean_differences(
    points: Sequence[Point], step: int, cycles: int, magnitudes: int
) -> tuple[list[Sequence[Point]], list[Block], Floats]:
    """Return the windows of `step` in blocks, their differences, and the means over the cycles, +, -, +, ..., V.

    ConfigError: they are not as many as cycles and rates make.
    """
    windows = blocks_of([point for point in points if point.step == step])
    if len(windows) != cycles * magnitudes:
        raise ConfigError(f"expected {cycles} times {magnitudes} blocks, got {len(windows)}")
    blocks = [block(each) for each in windows]
    return windows, blocks, np.array([each.differences_v for each in blocks]).reshape(cycles, -1).mean(axis=0)


def levels_of(
    settings: KnownVvcSettings, points: Sequence[Point], driven: Sequence[Sequence[Point]], rates_deg_s: Sequence[float]
) -> tuple[Floats, float]:
    """Return V_Vc of the `driven` blocks of a run, V: at the zeros, then at each rate, +, -; and its u by scatter, V.

    ConfigError: V_Vc was not measured, and its setting was not said to be believed.
    """
    by_hand = levels_by_hand(settings, points)
    _require_read_alike(settings, [point for each in driven for point in each])
    levels_v = [measured_level([point for each in driven for point in (each[0], each[-1])], by_hand)]
    for place, rate in enumerate(rates_deg_s):
        of_rate = [point for each in driven[place :: len(rates_deg_s)] for point in each]
        levels_v += [
            measured_level([p for p in of_rate if p.rate_deg_s == sign * rate], by_hand) for sign in (1.0, -1.0)
        ]
    scatter = [p.v_vc_std_v for each in driven for p in each if p.v_vc_std_v is not None]
    readings = 2 * settings.cycles * settings.samples
    u_v = math.sqrt(math.fsum(s * s for s in scatter) / len(scatter) / readings) if scatter else 0.0
    return np.array(levels_v), u_v


_ALIKE = 3.0
"""Times a meter's uncertainty of a year, which it is not off by from one window to the next."""


def _require_read_alike(settings: KnownVvcSettings, points: Sequence[Point]) -> None:
    """See that a meter beside the output reads V_Vc alike wherever it is set alike; MeasurementError: it does not."""
    seen: dict[float, list[tuple[float, float]]] = {}
    for point in points:
        if (volts := point.v_vc_measured_v) is not None:
            seen.setdefault(point.v_vc_v, []).append((volts, (point.v_vc_std_v or 0.0) / math.sqrt(point.n)))
    meter = v_vc_error(settings)
    for set_v, read in seen.items():
        low_v, high_v = min(volts for volts, _ in read), max(volts for volts, _ in read)
        noise_v = math.sqrt(math.fsum(u * u for _, u in read) / len(read))
        may_be_v = _ALIKE * (meter.u_gain * abs(set_v) + meter.u_offset_v + 2.0 * math.sqrt(2.0) * noise_v)
        if high_v - low_v > may_be_v:
            raise MeasurementError(
                f"V_Vc was set to {set_v:.6g} V each time and was read from {low_v:.6g} to {high_v:.6g} V, "
                f"{1e3 * (high_v - low_v):.2g} mV apart where {1e3 * may_be_v:.2g} mV may be",
                instrument=settings.v_vc_role,
                hint="check the meter on V_Vc and the generator: one of them drifts",
            )


def noise_of(settings: ProcedureSettings, blocks: Sequence[Block], points: Sequence[Point]) -> BlockNoise:
    """Return the noise of a run from its blocks, the scatter within all of its windows, and the flicker that is known.

    Known is what static record or bench file tell, else the worst of the class: knowing less makes nothing smaller.
    """
    window_s = settings.samples * settings.sample_interval_s
    readings = min(point.n for point in points)
    resolved_v = settings.meter_resolution_v / math.sqrt(12.0)  # as all readings of a window, where noise is small
    std_v = math.hypot(pooled_std_v(points), math.sqrt(readings) * resolved_v)
    per_deg_s = float(np.polyfit([p.rate_deg_s for p in points], [p.output_v for p in points], 1)[0])
    stated = Flicker.stated(settings.station.sources) or Flicker(0.0, math.inf, "nothing known")
    return block_noise(
        blocks,
        std_v,
        readings,
        window_s,
        window_s + settings.settle_s,
        known_flicker_v2=(per_deg_s * stated.deg_h / 3600.0) ** 2 / math.pi,  # the density is B^2 / (pi f)
        known_dof=stated.dof,
    )
