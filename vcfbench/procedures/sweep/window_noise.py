"""How the outputs of all windows of a run vary together, and what that puts into weighted sums of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from vcfbench.analysis.budget import Source
from vcfbench.analysis.phase_noise import PhaseNoise
from vcfbench.procedures.sweep.windows import window_times

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from vcfbench.bench.settings import ProcedureSettings
    from vcfbench.record.schema import Point

__all__ = ["OutputSum", "WindowNoise"]

Floats: TypeAlias = "NDArray[np.float64]"


@dataclass(frozen=True, slots=True)
class OutputSum:
    """A weighted sum of the outputs of all windows, V or V/(deg/s); `steady` when the weights add up to 1, not 0."""

    name: str
    weights: Floats
    unit: str
    steady: bool = False


@dataclass(frozen=True, slots=True)
class WindowNoise:
    """Scatter of the readings, pooled over all windows, and flicker, whose covariances are worked out once."""

    readings: Floats
    """(n,): how many each window has."""
    variance_v2: float
    """Of one reading."""
    dof: float
    length_s: Floats
    """(n + 1,): of each window, and of the horizon that a bias is the mean of."""
    lagged: Floats | None
    """(2n + 2, 2n + 2): covariances of the ends and beginnings of these by flicker; None where none is known."""

    @classmethod
    def of(cls, settings: ProcedureSettings, points: Sequence[Point], scale_factor: float) -> WindowNoise:
        """Return that of the windows of a run; the flicker is a rate, seen by `scale_factor`, V/(deg/s)."""
        readings = np.array([point.n for point in points])
        dof = sum(point.n - 1 for point in points)
        pooled = math.fsum((point.n - 1) * point.std_v**2 for point in points) / dof
        known = settings.station.sources
        if not known.bias_instability_deg_h:
            return cls(readings, pooled, float(dof), np.empty(0), None)
        begin, end = window_times(settings, points)
        middle, half = float(begin[0] + end[-1]) / 2.0, known.horizon_h * 1800.0
        begin, end = np.append(begin, middle - half), np.append(end, middle + half)
        noise = PhaseNoise(flicker=abs(scale_factor) * known.bias_instability_deg_h / 3600.0)
        times = np.concatenate([end, begin])
        lags = times[:, None] - times
        lagged = noise.covariance(lags.ravel()).reshape(lags.shape)
        return cls(readings, pooled, float(dof), end - begin, lagged)

    def by_readings(self, weights: Floats) -> Floats:
        """Return the covariance of sums by the scatter of readings; each row of `weights`, (m, n), is a sum."""
        return np.asarray(self.variance_v2 * (weights / self.readings) @ weights.T)

    def by_flicker(self, weights: Floats, steady: Sequence[bool]) -> Floats:
        """Return that by flicker; what is `steady` is compared with the mean over the horizon about the run."""
        if self.lagged is None:
            return np.zeros((len(weights), len(weights)))
        horizon = np.where(steady, -1.0, 0.0)[:, None]
        share = np.hstack([weights, horizon]) / self.length_s
        share = np.concatenate([share, -share], axis=1)
        return np.asarray(share @ self.lagged @ share.T)

    def sources(self, sums: Sequence[OutputSum]) -> tuple[list[Source], dict[tuple[str, str], float]]:
        """Return what varies from window to window as sources of these sums, and how the sums share it."""
        weights = np.array([each.weights for each in sums])
        sources, correlations = _jointly("readings", sums, self.by_readings(weights), self.dof)
        flicker = self.by_flicker(weights, [each.steady for each in sums])
        more, also = _jointly("flicker", sums, flicker, math.inf)
        return sources + more, correlations | also


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
