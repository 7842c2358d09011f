"""The mean of the output amplifier's voltage while the filtered signal moves, noise and clipping included.

Exact where the amplifier is linear. Its curvature takes the mean with it: of what the signal does by itself to 1e-9 V
by quadrature, of the noise by its variance within the time, so that one and the same direct voltage reads alike with
every aperture. Where the output clips, time is cut at the crossings first; that leaves 1e-6 V for a peak that reaches
over the limit for less than `LOOK_S`, and of the noise about the crossings its square over their slope, 1e-7 V on a
bench as noisy as the paper's. What rests within the noise of a limit is averaged over the noise. Limits that move with
the rails are clipped at as they move.
"""

import math
from collections.abc import Callable
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vcfbench.sim.gyro.electronics import OutputLimits, amplify, curved
from vcfbench.sim.gyro.signals import ExponentialSum
from vcfbench.sim.parameters import OutputStage

STEADY_V = 1e-3
PANEL_S = 0.02
PANEL_NODES = 16
LOOK_S = 1e-4
LEAST_BEND_V = 1e-8
"""What noise and curvature together shift below this, a hundredth of a meter's last digit, is left out."""
FAR = 8.0
"""Standard deviations of the noise from which on a limit is out of its reach."""
HALVINGS = 50
UNLIMITED = (-math.inf, math.inf)


def output_integral(
    limits: OutputLimits, filtered: ExponentialSum, duration_s: float, noise_mean_v: float, noise_variance_v2: float
) -> float:
    """Return the integral of the output over `duration_s` from the signal's origin on, V s.

    `noise_mean_v` is the mean of the filtered noise over that time, `noise_variance_v2` its variance about that mean.
    """
    stage, tightest_v = limits.stage, limits.tightest(duration_s)
    mean_v = filtered.integral(duration_s).real / duration_s + noise_mean_v
    middle_v = curved(stage, mean_v)
    moved_v = abs(stage.gain) * (filtered.swing() + abs(filtered.slope) * duration_s)
    noise_v = abs(_tangent(stage, mean_v)) * math.sqrt(noise_variance_v2)
    # Noise moves the mean by half of the second derivative of the output by the filtered signal
    u, orders = stage.gain * mean_v, enumerate(stage.orders[2:])
    bent_per_v = stage.gain**2 * sum([(k + 1) * (k + 2) // 2 * u**k * order for k, order in orders])
    bend_v = bent_per_v * noise_variance_v2
    middle_v = middle_v + bend_v if abs(bend_v) >= LEAST_BEND_V else middle_v
    reach_v = 1.5 * moved_v + FAR * noise_v
    if not tightest_v[0] + reach_v < middle_v < tightest_v[1] - reach_v:
        if moved_v < STEADY_V and not limits.moving:
            return duration_s * _limited_mean(middle_v, noise_v, tightest_v)
        return _clipped(limits, filtered, duration_s, noise_mean_v)
    if moved_v < STEADY_V:
        return duration_s * middle_v
    times, weights = _nodes(0.0, duration_s)
    values = filtered.at(times).real + noise_mean_v
    bent = amplify(stage, values, UNLIMITED) - curved(stage, mean_v) - _tangent(stage, mean_v) * (values - mean_v)
    return duration_s * (middle_v + float(weights @ bent))


def _clipped(limits: OutputLimits, filtered: ExponentialSum, duration_s: float, noise_mean_v: float) -> float:
    """Return the integral where the output may reach a limit."""

    def unlimited(times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        return amplify(limits.stage, filtered.at(times_s).real + noise_mean_v, UNLIMITED)

    cuts = {0.0, duration_s, *limits.cuts_s(duration_s)}
    for side in (0, 1):
        cuts.update(_crossings(unlimited, limits, side, duration_s))
    total = 0.0
    for start, stop in pairwise(sorted(cuts)):
        times, weights = _nodes(start, stop)
        total += (stop - start) * float(weights @ np.clip(unlimited(times), *limits.at(times)))
    return total


def _crossings(
    signal: Callable[[NDArray[np.float64]], NDArray[np.float64]], limits: OutputLimits, side: int, stop_s: float
) -> list[float]:
    """Return when a signal crosses the lowest (side 0) or highest voltage (1) before `stop_s`."""
    looks = np.linspace(0.0, stop_s, max(2, math.ceil(stop_s / LOOK_S) + 1))
    above = signal(looks) > limits.at(looks)[side]
    places = np.flatnonzero(above[1:] != above[:-1])
    early, late, first = looks[places], looks[places + 1], above[places]
    for _ in range(HALVINGS if len(places) else 0):
        middle = 0.5 * (early + late)
        same = (signal(middle) > limits.at(middle)[side]) == first
        early, late = np.where(same, middle, early), np.where(same, late, middle)
    return [float(each) for each in 0.5 * (early + late)]


def _limited_mean(mean_v: float, deviation_v: float, limits_v: tuple[float, float]) -> float:
    """Return the mean of Gaussian noise about `mean_v` between limits."""
    if deviation_v == 0.0:
        return min(max(mean_v, limits_v[0]), limits_v[1])

    def beyond(limit: float) -> float:
        x = (mean_v - limit) / deviation_v
        return deviation_v * (
            0.5 * x * math.erfc(-x / math.sqrt(2.0)) + math.exp(-0.5 * x * x) / math.sqrt(2.0 * math.pi)
        )

    low, high = limits_v
    return low + beyond(low) - beyond(high)


def _tangent(stage: OutputStage, filtered_v: float) -> float:
    """Return the derivative of the output by the filtered signal."""
    u, orders = stage.gain * filtered_v, enumerate(stage.orders[2:])
    return stage.gain * (1 + u * sum([(k + 2) * u**k * order for k, order in orders]))


@cache
def _panel() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    nodes, weights = np.polynomial.legendre.leggauss(PANEL_NODES)
    return (nodes + 1) / 2, weights / 2


def _nodes(start_s: float, stop_s: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return Gauss-Legendre nodes in [start_s, stop_s], 16 each 20 ms, and weights that sum to 1."""
    count = max(1, math.ceil((stop_s - start_s) / PANEL_S))
    nodes, weights = _panel()
    starts = np.arange(count)[:, None]
    return start_s + ((starts + nodes) * ((stop_s - start_s) / count)).ravel(), np.tile(weights / count, count)
