"""The non-linearity of lines with its uncertainty: the largest residual, or a bound where errors alone may make it.

A residual is a linear functional of the outputs, the largest of several is not. Where more than one may be it, trials
(JCGM 101) around what was found tell how far it moves. They lie higher than it, since errors make one residual or
another the largest; what was found lies higher than the truth for the same reason, and u and U95 hold that as well.

A value is stated only where it is larger than errors make it. Of runs whose errors happened to add to a small
non-linearity more are stated than of others: :func:`u95_beyond` makes U95 hold the truth in those that are.
"""

import math
from collections.abc import Mapping, Sequence
from statistics import NormalDist
from typing import Any, Self, TypeAlias

import numpy as np
from msgspec import Struct, field, structs
from numpy.typing import NDArray

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.budget import Model, Source
from vcfbench.records.schema import Point
from vcfbench.station.settings import ProcedureSettings
from vcfbench.uncertainty.known_levels import KnownLevels
from vcfbench.uncertainty.line import Line
from vcfbench.uncertainty.statement import (
    Circumstances,
    StatedValue,
    Statement,
    budget_of,
    stated_value,
    statement,
)
from vcfbench.uncertainty.windows import OutputSum, WindowNoise, window_times
from vcfbench.values.sources import WARM_UP, Errors, SourceName, noise_of
from vcfbench.values.value import Value

Places: TypeAlias = "NDArray[np.intp]"

_TRIALS = 2000
_ONE_RATE = 1e-5
"""Share of the span within which two levels are one: V_Vc that is measured differs by its noise."""
_ROUNDING = 1e-12
"""Share of the largest variance up to which one is left by rounding."""
_K95 = NormalDist().inv_cdf(0.975)
_FAR = 10.0
"""Standard deviations that no interval with a value in its middle has."""
_MAY_BE_LARGEST = 3.0
"""Standard deviations of its distance from the largest within which a residual may truly be the largest."""


class LargestResidual(Struct, frozen=True):
    """Uncertainty of the largest of several residuals, ppm."""

    u: float
    u95: float
    by_errors: float
    """Limit of the largest by errors alone with 95 %, where there is no non-linearity."""


class ResidualSpread(Struct, frozen=True):
    """Joint uncertainty of the residuals, ppm; `residuals` (n,) as found."""

    residuals: Floats
    scattered: Floats
    """(n, n): covariance by readings' scatter, ppm^2, with `dof` degrees of freedom."""
    dof: float
    normal: Floats
    """(n, n): covariance by flicker and by each level's own error of V_Vc, ppm^2."""
    common: Floats
    """(m, n): change of the residuals by one standard uncertainty of each source that all share, ppm."""
    rectangular: NDArray[np.bool_]
    """(m,): whether that source is; else it is normal."""

    @property
    def covariance(self) -> Floats:
        """Covariance of the residuals by all sources, (n, n), ppm^2."""
        return np.asarray(self.scattered + self.normal + self.common.T @ self.common)

    def near_largest(self) -> Places:
        """Return the places of the residuals that may truly be the largest, that which was found among them."""
        covariance = self.covariance
        sign = np.sign(self.residuals)
        variance, size = np.diag(covariance), np.abs(self.residuals)
        k = int(size.argmax())
        apart = np.sqrt(np.maximum(variance + variance[k] - 2.0 * sign * sign[k] * covariance[k], 0.0))
        near = size[k] - size <= _MAY_BE_LARGEST * apart
        near[k] = True
        return np.flatnonzero(near)

    def largest(self) -> LargestResidual:
        """Return the amount by which the largest of all moves, by trials (JCGM 101) of a fixed seed."""
        rng = np.random.default_rng(0)
        errors = _normal(rng, self.scattered) * np.sqrt(self.dof / rng.chisquare(self.dof, (_TRIALS, 1)))
        errors += _normal(rng, self.normal)
        sizes = rng.standard_normal((_TRIALS, self.rectangular.size))
        flat = rng.uniform(-np.sqrt(3.0), np.sqrt(3.0), sizes.shape)
        errors = errors + np.where(self.rectangular, flat, sizes) @ self.common
        moved = np.abs(self.residuals - errors).max(axis=1) - np.abs(self.residuals).max()
        u95, by_errors = (float(np.quantile(np.abs(each), 0.95)) for each in (moved, np.abs(errors).max(axis=1)))
        return LargestResidual(float(np.sqrt(np.mean(moved**2))), u95, by_errors)


def u95_beyond(limit: float, value: float, u95: float) -> float:
    """Return U95 of a value that is stated because it lies above a limit; infinite where it does not.

    With d and a, the distances of the value from the limit and from the lower end of its interval in standard
    deviations, the chance of an error above a is that of 2.5 % of the errors above a - d, with which the lower end
    would be stated at all: Q(a) = 0.025 Q(a - d).
    """
    beyond, a, before = (value - limit) / (u95 / _K95), _K95, 0.0
    while a - before > 1e-9:
        if beyond <= 0.0 or a > _FAR:
            return math.inf
        before, a = a, -NormalDist().inv_cdf(0.0125 * math.erfc((a - beyond) / math.sqrt(2.0)))
    return u95 / _K95 * a


def _normal(rng: np.random.Generator, covariance: Floats) -> Floats:
    # The symmetric root: eigenvectors alone have signs and turns that each processor's linear algebra chooses
    sizes, axes = np.linalg.eigh(covariance)
    root = (axes * np.sqrt(np.where(sizes > _ROUNDING * sizes.max(), sizes, 0.0))) @ axes.T
    return np.asarray(rng.standard_normal((_TRIALS, sizes.size)) @ root)


_RANGES_UNKNOWN = "the ends of the generator's ranges are unknown, and their steps also deviate from a line"


class CurvedLine(Struct, frozen=True):
    """The non-linearity of a line: its residuals over its span, ppm, and the effects of errors on each of them.

    Windows at one rate have one residual, that of their mean: the largest of many windows would grow with their number.
    """

    name: str
    rate_deg_s: Floats
    """(m,): each rate once, in the order of the windows."""
    ppm: Floats
    """(m,)."""
    of_outputs: Floats
    """(m, n): change of each residual by a volt at the output of each window of the line, ppm/V."""
    of_rates: Floats
    """(m, n): change of each residual by 1 deg/s of each rate, outputs as they were, ppm/(deg/s)."""
    weights: Floats
    """(m, N): change of each residual by a volt at the output of each of all windows, ppm/V."""
    effects: Mapping[SourceName, Floats] = field(default_factory=dict)
    """Change of each residual by one unit of each source shared with others, ppm."""
    own: Mapping[str, Floats] = field(default_factory=dict)
    """Change of each residual by each level's own standard uncertainty: (m, levels), ppm."""
    only_bound: str = ""
    """Reason for having a bound only, whatever is found; empty where there may be a value."""

    @classmethod
    def of(cls, name: str, line: Line) -> Self:
        """Return that of a line whose rates are known but for a common factor, which cancels."""
        rate, slope = line.rate_deg_s, line.scale_factor
        to_ppm = 1e6 / (abs(slope) * float(np.ptp(rate)))
        left = np.eye(rate.size) - np.outer(rate, line.slope_weights) - line.bias_weights
        residual_v = line.output_v - slope * rate - line.bias_v
        of_span = np.outer(residual_v / slope, line.slope_weights)  # it moves with the slope
        # The weights (m, n) of the windows in the means at each rate; rates that differ by a hair are one
        steps = np.round(rate / (_ONE_RATE * float(np.ptp(rate))))
        members = (steps == np.array(list(dict.fromkeys(steps.tolist())))[:, None]).astype(np.float64)
        mean = np.asarray(members / members.sum(axis=1, keepdims=True))
        ppm, of_outputs = to_ppm * (mean @ residual_v), to_ppm * (mean @ (left - of_span))
        return cls(name, mean @ rate, ppm, of_outputs, -to_ppm * slope * (mean @ left), of_outputs @ line.mixing)

    def with_warm_up(self, by_factor_v: Floats, by_bias_v: Floats) -> Self:
        """Return it with what a kelvin from warm does, `warming_v`: the worst of all ways for the largest residual."""
        worst = int(np.abs(self.ppm).argmax())
        of_factor, of_bias = self.weights @ by_factor_v, self.weights @ by_bias_v
        signs = np.where(of_factor[worst] * of_bias[worst] < 0.0, -1.0, 1.0)  # sizes are told, not their signs
        ways = of_factor + signs * of_bias
        effect = ways[:, int(np.abs(ways[worst]).argmax())]
        return structs.replace(self, effects={**self.effects, WARM_UP: effect})

    def with_errors(self, known: KnownLevels, volts: Floats, through: Floats, u_before: Sequence[float] = ()) -> Self:
        """Return it with errors of the levels `volts`, which move the residuals by `through`, ppm/V.

        The first levels have a standard uncertainty of their own, `u_before`, V.
        """
        u_v = np.array([*u_before, *(known.u_besides_v(each) for each in volts[len(u_before) :])])
        own = {f"{known.by} {known.besides}": through * u_v}
        shared = list(known.shared(volts, through, int(np.abs(self.ppm).argmax())))
        if known.ranges_v:
            effects = {SourceName(error.name): effect for _, _, effect, error in shared}
            return structs.replace(self, effects=effects, own=own)
        for kind in ("gain", "offset"):
            columns = [effect * error.u for of, _, effect, error in shared if of == kind]
            own[f"{known.by} {kind}"] = np.column_stack(columns)
        return structs.replace(self, own=own, only_bound=_RANGES_UNKNOWN)


def line_statement(
    settings: ProcedureSettings,
    sources: Sequence[Source],
    sums: Sequence[OutputSum],
    *,
    model: Model,
    around: Circumstances,
    noise: WindowNoise,
    meanings: Mapping[str, tuple[str, str]],
    curved: Sequence[CurvedLine],
    warming: tuple[Floats, Floats],
    difference: str | None = None,
    levels_by: str = "",
) -> Statement:
    """Return the statement of lines with the non-linearities beyond their errors, and a bound for the others.

    `sources` are those beside the `noise` of the windows and the circumstances `around`; `warming` is that of
    :func:`warming_v`; `meanings`, `difference` and `levels_by` are those of :func:`.statement`. The budget is done a
    second time with one more sum for each non-linearity, so that what stood there keeps its last digit.
    """
    windows, correlations = noise.sources(sums)
    stated = statement(
        *(settings, [*windows, *sources, *around.sources], model, correlations, meanings),
        difference=difference,
        levels_by=levels_by,
        flicker=noise.flicker,
    )
    curved = [each for each in curved if each.ppm.size > 2]  # two points lie on any line
    known = {source.name: source for source in (*sources, *around.sources)}
    if WARM_UP in known:
        curved = [each.with_warm_up(*warming) for each in curved]
    worst = [WorstResidual.of(each, known, noise) for each in curved]
    windows, correlations = noise.sources([*sums, *(each.sum for each in worst)])
    own = [source for each in worst for source in each.own]

    def both(q: Errors) -> Mapping[str, Any]:
        return {**model(q), **{each.sum.name: each.value(q) for each in worst}}

    every, cannot_be = budget_of([*windows, *sources, *own, *around.sources], both, correlations)
    values, kept, bounds = list(stated.values), list(range(len(stated.values))), list[Value]()
    for number, each in enumerate(worst, len(stated.values)):
        result = every.results[number]
        value = each.moved(stated_value(result, every, "ppm", _LARGEST, cannot_be.get(result.name, ())))
        by_errors = value.u95 if each.by_trials is None else each.by_trials.by_errors
        u95 = u95_beyond(by_errors, value.value, value.u95) if value.u95 else 0.0
        why = each.only_bound or ("" if value.value > u95 else "within the errors of the measurement")
        if why:  # no truth is further from what is found than the largest error of a residual
            most, of = value.value + by_errors, f"{value.of}; {why}"
            bounds.append(value.bound("below", most, of))
        else:
            values.append(structs.replace(value, u95=u95))
            kept.append(number)
    correlation = every.correlation[np.ix_(kept, kept)].tolist()
    for row, old in zip(correlation, stated.correlation, strict=False):
        row[: len(old)] = old
    return structs.replace(
        stated, values=tuple(values), correlation=tuple(map(tuple, correlation)), bounds=tuple(bounds)
    )


def warming_v(settings: ProcedureSettings, points: Sequence[Point], line: Line) -> tuple[Floats, Floats]:
    """Return by how much a kelvin from warm at the first window moves each of them, V: by scale factor, and by bias.

    Columns are ways to become warm, (n, k): the exponential, or steps where nobody tells the time, of which whatever
    falls from 1 to 0 is made. The exponential happens as a whole, only its sign is not known: no rectangle's share.
    """
    known, (begin_s, end_s) = settings.station.sources, window_times(settings, points)
    if "warm_up_time_s" in known.assumed:
        left = np.tri(len(points)).T
    else:
        left = math.sqrt(3.0) * np.exp(-(0.5 * (begin_s + end_s) - begin_s[0]) / known.warm_up_time_s)[:, None]
    driven_v = np.array([point.output_v for point in points]) - line.bias_v
    by_factor = 1e-6 * (known.scale_factor_ppm_k or 0.0) * driven_v[:, None] * left
    return by_factor, (known.bias_deg_h_k or 0.0) / 3600.0 * line.scale_factor * left


_LARGEST = "largest |residual| of that line over its span (max_span; of the mean if a rate has several windows)"


class WorstResidual(Struct, frozen=True):
    """The largest residual of a line: a linear functional where one alone may be it, else by trials."""

    size_ppm: float
    sum: OutputSum
    """The largest residual, as a sum of outputs."""
    own: tuple[Source, ...]
    effects: Mapping[SourceName, float]
    rates_deg_s: tuple[float, ...]
    """Rates at which the largest may be."""
    by_trials: LargestResidual | None
    """None where it is one alone."""
    only_bound: str

    @classmethod
    def of(cls, curved: CurvedLine, sources: Mapping[str, Source], noise: WindowNoise) -> Self:
        """Return that of a line."""
        steady = [False] * len(curved.weights)
        normal = noise.by_flicker(curved.weights, steady) + sum(each @ each.T for each in curved.own.values())
        shared = [sources[name] for name in curved.effects]
        common = np.array([effect * sources[name].u for name, effect in curved.effects.items()])
        common = common.reshape(-1, len(steady))
        rectangular = np.array([each.rectangular for each in shared], dtype=bool)
        white = noise.by_readings(curved.weights)
        spread = ResidualSpread(curved.ppm, white, noise.dof, normal, common, rectangular)
        places, k = spread.near_largest(), int(np.abs(curved.ppm).argmax())
        sign = float(np.sign(curved.ppm[k]))
        own = [
            Source(f"{name}: {curved.name}", 0.0, float(np.linalg.norm(by_level[k])), "ppm")
            for name, by_level in curved.own.items()
        ]
        effects = {name: sign * float(effect[k]) for name, effect in curved.effects.items()}
        return cls(
            float(np.abs(curved.ppm[k])),
            OutputSum(curved.name, sign * curved.weights[k], "ppm"),
            tuple(own),
            effects | {SourceName(source.name): 1.0 for source in own},
            tuple(curved.rate_deg_s[places].tolist()),
            spread.largest() if places.size > 1 else None,
            curved.only_bound,
        )

    def value(self, q: Errors) -> Any:
        """Return it, the errors `q` taken out, ppm (U8)."""
        return self.size_ppm - noise_of(self.sum.name, q) - sum(size * q[name] for name, size in self.effects.items())

    def moved(self, value: StatedValue) -> StatedValue:
        """Return the value with the u and U95 of trials where several residuals may be the largest, never with less."""
        if self.by_trials is None or not self.by_trials.u:
            return value
        u, u95 = max(value.u, self.by_trials.u), max(value.u95, self.by_trials.u95)
        at = ", ".join(f"{rate:+.4g}" for rate in self.rates_deg_s)
        of = f"{value.of}, at one of {at} deg/s; u by trials, contributions of the one found"
        return structs.replace(value, u=u, u95=u95, of=of)
