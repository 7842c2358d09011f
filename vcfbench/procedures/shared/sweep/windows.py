"""The windows of a sweep as results see them: the drift of the zeros taken off, the Earth's rate added.

What is taken off is a weighted sum of zeros, so a corrected output is a weighted sum of the outputs of all windows. The
weights go with it, and noise and flicker go through them with all their correlations: neighbours share a zero.
"""

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from vcfbench.analysis.arrays import Floats
from vcfbench.errors import ConfigError
from vcfbench.procedures.shared.sweep.schedule import ZERO_DRIVEN, ZERO_TABLE, SweepSettings, window_grid
from vcfbench.records.schema import Point
from vcfbench.station.settings import ProcedureSettings


class Sweep(Struct, frozen=True):
    """The windows of one step: their places among all windows, and their points as the results take them.

    The points have the drift of the zeros taken off and the Earth's rate added, where that was asked. `mixing`, (n, N),
    makes their outputs of the outputs of all N windows.
    """

    step: int
    places: tuple[int, ...]
    points: tuple[Point, ...]
    mixing: Floats

    @property
    def noise_gains(self) -> list[float]:
        """Noise of each output over that of its window alone: the zeros' noise comes to it."""
        return [math.sqrt(row) for row in np.square(self.mixing).sum(axis=1).tolist()]

    def u_v(self, u_output_v: float) -> float | list[float]:
        """Return the standard uncertainty of the outputs, V, one for all if they agree; `u_output_v` is a window's."""
        return u_output_v if set(gains := self.noise_gains) == {1.0} else [gain * u_output_v for gain in gains]


def drift_weights(at_s: Floats, zeros_at_s: Floats) -> Floats:
    """Return the weights of the zeros, (m,), in the drift at the times `at_s`, (n,): (n, m), each row adds up to 0.

    The zero is interpolated in time between those before and after, and its mean over all of them taken off, so that
    what is subtracted is the drift and not the bias. ConfigError: a time does not lie between two zeros.
    """
    if zeros_at_s.size < 2 or at_s.min() < zeros_at_s[0] or at_s.max() > zeros_at_s[-1]:
        raise ConfigError("a window has no zero before or after it")
    interpolated = np.array([np.interp(at_s, zeros_at_s, each) for each in np.eye(zeros_at_s.size)]).T
    return np.asarray(interpolated - 1.0 / zeros_at_s.size)


def sweep_of(settings: ProcedureSettings, points: Sequence[Point], step: int) -> Sweep:
    """Return the windows of `step` as the results take them."""
    places = tuple(place for place, point in enumerate(points) if point.step == step)
    outputs = np.array([point.output_v for point in points])
    mixing = np.eye(len(points))[list(places)]
    zeros = zero_places(points, step)
    if zeros:
        begin, end = window_times(settings, points)
        middle = 0.5 * (begin + end)
        mixing[:, zeros] -= drift_weights(middle[list(places)], middle[zeros])
    corrected = mixing @ outputs if zeros else outputs[list(places)]
    added = settings.earth_rate_deg_s if isinstance(settings, SweepSettings) else 0.0
    made = zip((points[place] for place in places), corrected.tolist(), strict=True)
    own = tuple(replace(point, rate_deg_s=point.rate_deg_s + added, output_v=output_v) for point, output_v in made)
    return Sweep(step, places, own, mixing)


def zero_places(points: Sequence[Point], step: int) -> list[int]:
    """Return the places of the zeros about the windows of `step`."""
    number = ZERO_DRIVEN if step == 4 else ZERO_TABLE
    return [place for place, point in enumerate(points) if point.step == number]


def window_times(settings: ProcedureSettings, points: Sequence[Point]) -> tuple[Floats, Floats]:
    """Return when each window began and ended, s from the first: ramps and waits as they are set."""
    begin, end, now, rate = [], [], 0.0, points[0].rate_deg_s
    for number, point in enumerate(points):
        table = 0.0 if point.step in {2, 4, 7} else point.rate_deg_s
        now += (settings.settle_s + abs(table - rate) / settings.acceleration_deg_s2) if number else 0.0
        begin.append(now)
        now += window_grid(settings, table).interval_s * point.n
        end.append(now)
        rate = table
    return np.array(begin), np.array(end)
