"""The windows of a sweep for results, the drift of the zeros subtracted, and their covariances.

What is taken off is a weighted sum of zeros, so a corrected output is a weighted sum of the outputs of all windows. The
weights go with it, and noise and flicker go through them with all their correlations: neighbours share a zero.
"""

import math
from collections.abc import Callable, Sequence
from itertools import combinations, pairwise
from typing import Self

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.budget import Source
from vcfbench.analysis.phase_noise import PhaseNoise
from vcfbench.errors import ConfigError
from vcfbench.instructions.schedule import ZERO_DRIVEN, ZERO_TABLE, SweepSettings
from vcfbench.records.schema import Point
from vcfbench.station.settings import ProcedureSettings, Sources
from vcfbench.values.sources import SourceName, by_flicker, by_readings

ENOUGH_DOF = 10.0
"""Degrees of freedom of B by a run's own zeros from which it replaces the stated one: Student's factor is within 14 %
of the normal one. Differences of some seconds are half white noise, so that 18 zeros have 5."""
_LEAST_DOF = 2.0
"""Below that an interval of 95 % would say nothing."""


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


def line_weights(rate: Floats) -> tuple[Floats, Floats]:
    """Return the weights of the outputs in slope, 1/(deg/s), and intercept of their least-squares line."""
    off = rate - rate.mean()
    slope = np.asarray(off / float(off @ off))
    return slope, np.asarray(1.0 / rate.size - rate.mean() * slope)


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
        now += settings.sample_interval_s * point.n
        end.append(now)
        rate = table
    return np.array(begin), np.array(end)


class OutputSum(Struct, frozen=True):
    """A weighted sum of the outputs of all windows, V or V/(deg/s); `steady` when the weights add up to 1, not 0."""

    name: str
    weights: Floats
    unit: str
    steady: bool = False


class Flicker(Struct, frozen=True):
    """The coefficient B of the gyroscope's flicker, deg/h, its degrees of freedom, and its source."""

    deg_h: float
    dof: float
    """Effective degrees of freedom of its square; infinite for one stated without an uncertainty."""
    said: str

    @classmethod
    def stated(cls, known: Sources) -> Self | None:
        """Return the flicker from static record or bench file, or None."""
        if known.bias_instability_deg_h is None:
            return None
        dof = math.inf if known.bias_instability_dof is None else known.bias_instability_dof
        return cls(known.bias_instability_deg_h, dof, known.bias_instability_from)


class WindowNoise(Struct, frozen=True):
    """Scatter of the readings, pooled over all windows, and flicker, whose covariances are worked out once."""

    readings: Floats
    """(n,): how many each window has."""
    variance_v2: float
    """Variance of one reading."""
    dof: float
    length_s: Floats
    """(n + 1,): of each window, and of the horizon that a bias is the mean of."""
    lagged: Floats | None
    """(2n + 2, 2n + 2): covariances of the ends and beginnings of these by flicker; None where none is known."""
    flicker: Flicker | None = None
    referred_v2: Floats | None = None
    """(n, n): covariances by the references after pauses, which all windows after them share; None without a pause."""

    @classmethod
    def of(cls, settings: ProcedureSettings, points: Sequence[Point], scale_factor: float) -> Self:
        """Return that of the windows of a run; the flicker is a rate, seen by `scale_factor`, V/(deg/s).

        Its B is that of the run's own zeros where they are many enough, else what is told, else theirs all the same.
        """
        readings = np.array([point.n for point in points])
        dof = sum(point.n - 1 for point in points)
        pooled = math.fsum((point.n - 1) * point.std_v**2 for point in points) / dof
        if pooled < 0.25 * settings.meter_resolution_v**2:
            # Readings that scatter by less than half a digit are alike, and their mean is no better than one of them
            pooled = max(pooled, int(readings.max()) * settings.meter_resolution_v**2 / 12.0)
        referred = None  # two windows that are counted from references share those before the earlier one
        if any(point.moved_u_v for point in points):
            squares = np.square([point.moved_u_v for point in points])
            referred = np.minimum.outer(squares, squares)
        white = cls(readings, pooled, float(dof), np.empty(0), None, referred_v2=referred)
        # The weights (k, n) of the differences between each zero and the next one of the same kind
        pairs = [
            pair
            for step in (ZERO_TABLE, ZERO_DRIVEN)
            for pair in pairwise(place for place, point in enumerate(points) if point.step == step)
        ]
        weights = np.zeros((len(pairs), len(points)))
        for row, (before, after) in enumerate(pairs):
            weights[row, before], weights[row, after] = -1.0, 1.0
        known, flicker = settings.station.sources, Flicker.stated(settings.station.sources)
        if not (weights.size if flicker is None else flicker.deg_h):
            return white
        begin, end = window_times(settings, points)
        middle, half = float(begin[0] + end[-1]) / 2.0, known.horizon_h * 1800.0
        begin, end = np.append(begin, middle - half), np.append(end, middle + half)
        lagged = PhaseNoise(flicker=abs(scale_factor) / 3600.0).among(np.concatenate([end, begin]))
        unit = replace(white, length_s=end - begin, lagged=lagged)
        if weights.size:
            stated_by_device = None if "bias_instability_deg_h" in known.assumed else flicker
            own = unit.own_flicker(weights, np.array([point.output_v for point in points]), stated_by_device)
            flicker = flicker if own is None else own
        if flicker is None or not flicker.deg_h:
            return white
        return replace(unit, lagged=flicker.deg_h**2 * lagged, flicker=flicker)

    def own_flicker(self, successive: Floats, outputs_v: Floats, stated: Flicker | None) -> Flicker | None:
        """Return B by the differences of successive zeros, (k, n), whose covariances here are those of 1 deg/h.

        What is `stated` is kept where these would not know it with enough degrees of freedom.
        """
        white = self.by_readings(successive)
        unit = self.by_flicker(successive, [False] * len(successive))

        def dof(square: float) -> float:
            return float((square * np.trace(unit)) ** 2 / np.sum((white + square * unit) ** 2))

        if stated is not None and dof(stated.deg_h**2) < ENOUGH_DOF:
            return stated
        excess = float(np.sum((successive @ outputs_v) ** 2) - np.trace(white))
        square = max(excess, 0.0) / float(np.trace(unit))
        if (found := dof(square)) < _LEAST_DOF:
            return stated
        return Flicker(math.sqrt(square), found, f"{len(successive)} differences of this run's zeros, dof {found:.1f}")

    @property
    def flicker_dof(self) -> float:
        """Effective degrees of freedom of the flicker's variances."""
        return math.inf if self.flicker is None else self.flicker.dof

    def by_readings(self, weights: Floats) -> Floats:
        """Return the covariance of sums by the scatter of readings; each row of `weights`, (m, n), is a sum."""
        own = np.asarray(self.variance_v2 * (weights / self.readings) @ weights.T)
        return own if self.referred_v2 is None else np.asarray(own + weights @ self.referred_v2 @ weights.T)

    def by_flicker(self, weights: Floats, steady: Sequence[bool]) -> Floats:
        """Return the covariance by flicker; `steady` sums are compared with the mean over the horizon about the run."""
        if self.lagged is None:
            return np.zeros((len(weights), len(weights)))
        horizon = np.where(steady, -1.0, 0.0)[:, None]
        share = np.hstack([weights, horizon]) / self.length_s
        share = np.concatenate([share, -share], axis=1)
        return np.asarray(share @ self.lagged @ share.T)

    def sources(self, sums: Sequence[OutputSum]) -> tuple[list[Source], dict[tuple[str, str], float]]:
        """Return the variation from window to window as sources of these sums, with its correlations between sums."""
        weights = np.array([each.weights for each in sums])
        sources, correlations = _jointly(by_readings, sums, self.by_readings(weights), self.dof)
        flicker = self.by_flicker(weights, [each.steady for each in sums])
        more, also = _jointly(by_flicker, sums, flicker, self.flicker_dof)
        return sources + more, correlations | also


def _jointly(
    name_of: Callable[[str], SourceName], sums: Sequence[OutputSum], covariance: Floats, dof: float
) -> tuple[list[Source], dict[tuple[str, str], float]]:
    u = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    sources = [Source(name_of(each.name), 0.0, float(u[n]), each.unit, dof=dof) for n, each in enumerate(sums)]
    pairs = {
        (sources[a].name, sources[b].name): float(np.clip(covariance[a, b] / (u[a] * u[b]), -1.0, 1.0))
        for a, b in combinations(range(len(sums)), 2)
        if u[a] and u[b] and abs(covariance[a, b]) > 1e-9 * u[a] * u[b]
    }
    return sources, pairs
