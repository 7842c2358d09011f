"""Results of the order of rates in a sweep: repeatability, hysteresis, drift of the zero."""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from msgspec import Struct

from vcfbench.instructions import schedule
from vcfbench.records.schema import Point
from vcfbench.uncertainty.measurand import finite, measurand
from vcfbench.uncertainty.windows import Sweep, WindowNoise, line_weights, zero_places
from vcfbench.values.quantile import t_of_largest
from vcfbench.values.value import Measurand, UncertaintyPart


class Repeatability(Struct, frozen=True):
    """Scatter of a value from series to series, within one run: standard deviation `sd` with `dof`, and its `u`.

    `noise` is the standard deviation that the readings and the flicker of the zero record alone explain.
    """

    name: str
    unit: str
    sd: float
    u: float
    dof: int
    noise: float
    values: tuple[float, ...]


class Hysteresis(Struct, frozen=True):
    """The largest difference of the output between the ways up and down at one rate, of all in the loop."""

    difference: Measurand
    """Up less down at that rate, % of full scale: the scale factor times the largest rate, one-sided."""
    rate_deg_s: float
    by_noise_percent: float
    """Limit of the largest of so many differences with 95 % where there is no hysteresis."""
    seen: bool
    """True if it is more than that."""
    differences_percent: tuple[tuple[float, float], ...]
    """Rate and difference, each rate of the loop, falling."""
    holds_not: tuple[str, ...]


class SweepFound(Struct, frozen=True, kw_only=True):
    """Results of the order in which the rates were visited; None if the order gives none."""

    order: schedule.Order
    zeros: schedule.Zeros
    repeat: int
    windows: int
    """Number of windows at rates, zeros apart."""
    zero_drift_v: float | None
    """Last zero less the first; with a linear drift in between it is in no value."""
    earth_rate_deg_s: float
    """Rate of the Earth added to the rates."""
    repeatability: tuple[Repeatability, ...]
    hysteresis: Hysteresis | None


def sweep_found(settings: schedule.SweepSettings, points: Sequence[Point], sweep: Sweep) -> SweepFound:
    """Return the results of the order, the zeros and the repeats of a sweep."""
    zeros = zero_places(points, sweep.step)
    return SweepFound(
        order=settings.order,
        zeros=settings.zeros,
        repeat=settings.repeat,
        windows=len(sweep.places),
        zero_drift_v=points[zeros[-1]].output_v - points[zeros[0]].output_v if zeros else None,
        earth_rate_deg_s=settings.earth_rate_deg_s,
        repeatability=tuple(_repeatability(settings, points, sweep)) if settings.repeat > 1 else (),
        hysteresis=_hysteresis(settings, points, sweep) if settings.order is schedule.Order.LOOP else None,
    )


def _repeatability(settings: schedule.SweepSettings, points: Sequence[Point], sweep: Sweep) -> Iterator[Repeatability]:
    """Yield the scatter of slope and intercept from series to series."""
    size = len(sweep.points) // settings.repeat
    rates = np.array([point.rate_deg_s for point in sweep.points]).reshape(settings.repeat, size)
    outputs = np.array([point.output_v for point in points])
    made = [line_weights(each) for each in rates]
    mixing = sweep.mixing.reshape(settings.repeat, size, len(points))
    slopes, biases = (
        np.array([each[kind] @ through for each, through in zip(made, mixing, strict=True)]) for kind in (0, 1)
    )
    noises = WindowNoise.of(settings, points, float((slopes @ outputs).mean()))
    for name, unit, weights in (("scale_factor", "V/(deg/s)", slopes), ("bias", "V", biases)):
        values, dof = weights @ outputs, settings.repeat - 1
        steady = [name == "bias"] * settings.repeat
        both = noises.by_readings(weights) + noises.by_flicker(weights, steady)
        noise = math.sqrt(max(0.0, float(np.trace(both) - both.mean() * settings.repeat)) / dof)
        sd = float(np.std(values, ddof=1))
        yield Repeatability(name, unit, sd, sd / math.sqrt(2.0 * dof), dof, noise, tuple(values.tolist()))


def _hysteresis(settings: schedule.SweepSettings, points: Sequence[Point], sweep: Sweep) -> Hysteresis:
    """Return the largest difference between up and down, with the noise of that difference."""
    ways = np.tile(schedule.loop_directions(settings.rates_deg_s), settings.repeat)
    nominal = np.tile(settings.series_deg_s, settings.repeat)
    rates = sorted(set(settings.rates_deg_s), reverse=True)
    up, down = ([(nominal == rate) & (sign * ways > 0) for rate in rates] for sign in (1, -1))
    weights = np.array([plus / plus.sum() - minus / minus.sum() for plus, minus in zip(up, down, strict=True)])
    weights = weights @ sweep.mixing
    slope, _ = line_weights(np.array([point.rate_deg_s for point in sweep.points]))
    outputs = np.array([point.output_v for point in points])
    scale_factor = float(slope @ sweep.mixing @ outputs)
    percent = 100.0 / (abs(scale_factor) * max(map(abs, rates)))
    noise = WindowNoise.of(settings, points, scale_factor)
    white, flicker = noise.by_readings(weights), noise.by_flicker(weights, [False] * len(weights))
    differences = percent * (weights @ outputs)
    u = percent * np.sqrt(np.diag(white + flicker))
    most = int(np.abs(differences).argmax())
    parts = [
        UncertaintyPart("readings", percent * math.sqrt(white[most, most]), noise.dof),
        UncertaintyPart("flicker", percent * math.sqrt(flicker[most, most]), finite(noise.flicker_dof)),
    ]
    largest = measurand(float(differences[most]), "%", parts)
    by_noise = t_of_largest(len(rates), math.inf) * float(u.max())
    holds_not = list(_DRIFT_IN_HYSTERESIS[settings.zeros])
    if noise.flicker is None:
        holds_not.append("flicker: no zero record is known (uncertainty.bias_instability_deg_h)")
    holds_not.append("hysteresis that is over before the averaging begins (settle_s)")
    return Hysteresis(
        largest,
        rates[most],
        by_noise,
        abs(largest.value) > by_noise,
        tuple(zip(rates, differences.tolist(), strict=True)),
        tuple(holds_not),
    )


_DRIFT_IN_HYSTERESIS = {
    schedule.Zeros.NONE: ["drift between up and down appears as hysteresis: no zeros were measured (zeros)"],
    schedule.Zeros.ENDS: ["drift that is not linear in time between the zeros appears as hysteresis"],
    schedule.Zeros.BRACKET: [],
}
