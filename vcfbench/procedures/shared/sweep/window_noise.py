"""Joint variation of the outputs of all windows of a run, and its contribution to weighted sums of them."""

import math
from collections.abc import Sequence
from itertools import combinations, pairwise
from typing import Self

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.budget import Source
from vcfbench.analysis.phase_noise import PhaseNoise
from vcfbench.procedures.shared.sweep.schedule import ZERO_DRIVEN, ZERO_TABLE
from vcfbench.procedures.shared.sweep.windows import window_times
from vcfbench.records.schema import Point
from vcfbench.station.settings import ProcedureSettings

ENOUGH_DOF = 10.0
"""Degrees of freedom of B by a run's own zeros from which it replaces the stated one: Student's factor is within 14 %
of the normal one. Differences of some seconds are half white noise, so that 18 zeros have 5."""


class OutputSum(Struct, frozen=True):
    """A weighted sum of the outputs of all windows, V or V/(deg/s); `steady` when the weights add up to 1, not 0."""

    name: str
    weights: Floats
    unit: str
    steady: bool = False


class Flicker(Struct, frozen=True):
    """The coefficient B of the gyroscope's flicker, deg/h, how well it is known, and where from."""

    deg_h: float
    dof: float
    """Effective degrees of freedom of its square; infinite for one stated without an uncertainty."""
    said: str


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
        known, successive = settings.station.sources, weights
        stated = known.bias_instability_deg_h
        if stated == 0.0 or (stated is None and not successive.size):
            return white
        begin, end = window_times(settings, points)
        middle, half = float(begin[0] + end[-1]) / 2.0, known.horizon_h * 1800.0
        begin, end = np.append(begin, middle - half), np.append(end, middle + half)
        times = np.concatenate([end, begin])
        lags = times[:, None] - times
        lagged = PhaseNoise(flicker=abs(scale_factor) / 3600.0).covariance(lags.ravel()).reshape(lags.shape)
        unit = replace(white, length_s=end - begin, lagged=lagged)
        stated_dof = math.inf if known.bias_instability_dof is None else known.bias_instability_dof
        flicker = None if stated is None else Flicker(stated, stated_dof, known.bias_instability_from)
        if successive.size:
            stated_by_device = None if "bias_instability_deg_h" in known.assumed else flicker
            own = unit.own_flicker(successive, np.array([point.output_v for point in points]), stated_by_device)
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
        sources, correlations = _jointly("readings", sums, self.by_readings(weights), self.dof)
        flicker = self.by_flicker(weights, [each.steady for each in sums])
        more, also = _jointly("flicker", sums, flicker, self.flicker_dof)
        return sources + more, correlations | also


_LEAST_DOF = 2.0
"""Below that an interval of 95 % would say nothing."""


def _jointly(
    kind: str, sums: Sequence[OutputSum], covariance: Floats, dof: float
) -> tuple[list[Source], dict[tuple[str, str], float]]:
    u = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    sources = [Source(f"{kind}: {each.name}", 0.0, float(u[n]), each.unit, dof=dof) for n, each in enumerate(sums)]
    pairs = {
        (sources[a].name, sources[b].name): float(np.clip(covariance[a, b] / (u[a] * u[b]), -1.0, 1.0))
        for a, b in combinations(range(len(sums)), 2)
        if u[a] and u[b] and abs(covariance[a, b]) > 1e-9 * u[a] * u[b]
    }
    return sources, pairs
