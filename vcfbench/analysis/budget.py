"""Uncertainty budgets after the GUM: sources, a model of results, combined and expanded uncertainties, contributions.

The derivatives are those of the package ``uncertainties``; variances, correlations and the effective degrees of freedom
of Welch and Satterthwaite follow from them here. The propagation is of first order; where that matters
the tests check it by Monte Carlo (JCGM 101). Lack of fit is no uncertainty and has no place among the sources.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Self, TypeAlias

import numpy as np
from msgspec import Struct
from uncertainties import ufloat

from vcfbench.analysis.arrays import Floats
from vcfbench.errors import ConfigError
from vcfbench.values.quantile import t_quantile

_ONLY_DERIVATIVES = 1.0
"""Uncertainty of a quantity in a model: any but 0, because only its derivatives are read."""

Model: TypeAlias = Callable[[Mapping[Any, Any]], Mapping[str, Any]]
"""From the quantities by name to the results by name, with + - * / ** and functions that take uncertain numbers."""
Correlations: TypeAlias = Mapping[tuple[str, str], float]
"""Correlation coefficients of pairs of sources; pairs that are not named are uncorrelated."""


_CELLS = 3**8
"""An odd number, so that one is in the middle, and one that suits the Fourier transform."""
_NEARLY_NORMAL = 0.05
"""Share of the variance from sources within limits up to which the sum is as normal as can be told."""
_LEFT_OUT = 1e-5
"""Probability of the normal part that may lie outside the grid."""


class Source(Struct, frozen=True):
    """One input quantity: best value, standard uncertainty, degrees of freedom and distribution.

    It is `rectangular`, or normal, with finite degrees of freedom Student's t.
    """

    name: str
    value: float
    u: float
    unit: str = ""
    dof: float = math.inf
    rectangular: bool = False

    @classmethod
    def within(cls, name: str, value: float, half_width: float, unit: str = "") -> Self:
        """Return a source that lies within `half_width` of its value, as data sheets state it."""
        return cls(name, value, half_width / math.sqrt(3.0), unit, rectangular=True)

    @property
    def possible(self) -> bool:
        """Return True if value and uncertainty are finite, and the uncertainty is not negative."""
        return math.isfinite(self.value) and 0.0 <= self.u < math.inf and self.dof > 0.0


class Contribution(Struct, frozen=True):
    """Contribution of one source to one result."""

    source: str
    u_source: float
    dof: float
    sensitivity: float
    """Derivative of the result by the source."""
    u: float
    """Sensitivity times uncertainty, sign kept: two results with opposite signs get closer or part together."""
    share: float
    """Share of the result's variance; correlated sources halve their common part, so it may be negative."""


class Result(Struct, frozen=True):
    """One output quantity; the contributions are in the order of their size."""

    name: str
    value: float
    u: float
    """Combined standard uncertainty."""
    dof: float
    """Effective degrees of freedom."""
    confidence: float
    coverage_factor: float
    contributions: tuple[Contribution, ...]

    @property
    def expanded_u(self) -> float:
        """Half width of the interval that holds the true value with `confidence`."""
        return self.coverage_factor * self.u


class Budget(Struct, frozen=True):
    """All results of one model, with the correlation that their common sources make."""

    sources: tuple[Source, ...]
    results: tuple[Result, ...]
    correlation: Floats
    """Correlation coefficients of the results, in their order."""

    def result(self, name: str) -> Result:
        """Return one result; raises ConfigError for a name that the model does not have."""
        for result in self.results:
            if result.name == name:
                return result
        raise ConfigError(f"the budget has no result {name}, only {', '.join(r.name for r in self.results)}")


def evaluate(
    sources: Sequence[Source], model: Model, correlations: Correlations | None = None, confidence: float = 0.95
) -> Budget:
    """Propagate the sources through `model` (U9 of docs/uncertainty.md).

    Args:
        sources: the input quantities; names must differ.
        model: from the quantities by name to the results by name; differences of results belong into it, so that what
            both share cancels.
        correlations: coefficients of pairs of sources. Correlated sources of finite degrees of freedom were observed
            together and have the same number of them.
        confidence: of the expanded uncertainties.

    Raises:
        ConfigError: sources or correlations that cannot be.
    """
    pairs = {} if correlations is None else dict(correlations)
    check_sources(sources, pairs)
    quantities = {source.name: ufloat(source.value, _ONLY_DERIVATIVES) for source in sources}
    outputs = model(quantities)
    slopes = np.zeros((len(outputs), len(sources)))  # 0 for a source without uncertainty
    for row, output in enumerate(outputs.values()):
        found = {} if isinstance(output, int | float) else output.derivatives
        slopes[row] = [found.get(quantities[each.name], 0.0) if each.u > 0.0 else 0.0 for each in sources]
    places = {source.name: place for place, source in enumerate(sources)}
    matrix = np.eye(len(sources))
    for (first, second), coefficient in pairs.items():
        matrix[places[first], places[second]] = matrix[places[second], places[first]] = coefficient
    u_source = np.array([source.u for source in sources])
    covariance, groups = u_source[:, None] * matrix * u_source, correlated_groups(sources, pairs)
    results = []
    for (name, output), slope in zip(outputs.items(), slopes, strict=True):
        u, lines = _contributions(sources, slope, slope * (covariance @ slope))
        share = {line.source: line.share for line in lines}  # sources observed together count as one
        dof = _effective_dof([(math.fsum(share[each.name] for each in group), group[0].dof) for group in groups])
        value = float(output if isinstance(output, int | float) else output.nominal_value)
        results.append(Result(name, value, u, dof, confidence, t_quantile(1.0 - confidence, dof), lines))
    of_results = slopes @ covariance @ slopes.T
    root = np.sqrt(np.maximum(np.diag(of_results), 0.0))
    product = np.outer(root, root)
    correlation = np.divide(of_results, product, out=np.zeros_like(of_results), where=product > 0.0)
    np.fill_diagonal(correlation, 1.0)  # a result without variance is correlated with itself only
    return Budget(tuple(sources), tuple(results), correlation)


def summed(sources: Sequence[Source], value: float, confidence: float = 0.95) -> Result:
    """Return `value` with the uncertainties of independent sources added to it: :func:`evaluate` of their sum.

    Raises:
        ConfigError: sources that cannot be.
    """
    check_sources(sources, {})
    slopes = np.array([float(source.u > 0.0) for source in sources])
    u, lines = _contributions(sources, slopes, slopes * [source.u**2 for source in sources])
    share = {line.source: line.share for line in lines}
    dof = _effective_dof([(share[source.name], source.dof) for source in sources])
    return Result("value", value, u, dof, confidence, t_quantile(1.0 - confidence, dof), lines)


def _effective_dof(shares: Iterable[tuple[float, float]]) -> float:
    """Return the degrees of freedom after Welch and Satterthwaite, by shares of the variance with theirs."""
    terms = math.fsum(share**2 / dof for share, dof in shares)
    return 1.0 / terms if terms > 0.0 else math.inf


def check_sources(sources: Sequence[Source], correlations: Correlations) -> None:
    """Refuse sources that are ambiguous or impossible.

    Raises:
        ConfigError: a name twice, an uncertainty below zero or not finite, a correlation of what is not there.
    """
    names = [source.name for source in sources]
    if len(set(names)) < len(names):
        twice = sorted(name for name in set(names) if names.count(name) > 1)
        raise ConfigError(f"expected a different name of each source, got twice: {', '.join(twice)}")
    for source in sources:
        if not source.possible:
            stated = f"value {source.value}, u {source.u}, {source.dof} degrees of freedom"
            raise ConfigError(f"source {source.name} cannot be: {stated}")
    for (first, second), coefficient in correlations.items():
        if first not in names or second not in names or first == second or not -1.0 <= coefficient <= 1.0:
            raise ConfigError(f"correlation {coefficient} of {first} and {second}: no such pair of sources")
    for group in correlated_groups(sources, correlations):
        if len({source.dof for source in group}) > 1:
            raise ConfigError(
                f"correlated sources must have equal degrees of freedom, not {[source.dof for source in group]}: "
                f"{', '.join(source.name for source in group)}"
            )


def correlated_groups(sources: Sequence[Source], correlations: Correlations) -> list[list[Source]]:
    """Return the sources in groups that are correlated among each other; most are alone."""
    leader = {source.name: source.name for source in sources}
    for (first, second), coefficient in correlations.items():
        if coefficient:
            old, new = leader[first], leader[second]
            leader = {name: new if head == old else head for name, head in leader.items()}
    groups: dict[str, list[Source]] = {}
    for source in sources:
        groups.setdefault(leader[source.name], []).append(source)
    return list(groups.values())


def _contributions(sources: Sequence[Source], slopes: Floats, parts: Floats) -> tuple[float, tuple[Contribution, ...]]:
    """Return the combined uncertainty of one result and its contributions, the largest first; `parts` of variance."""
    variance = max(0.0, math.fsum(parts))
    shares = parts / variance if variance > 0.0 else np.zeros(len(sources))
    lines = [
        Contribution(source.name, source.u, source.dof, float(slope), float(slope) * source.u, float(share))
        for source, slope, share in zip(sources, slopes, shares, strict=True)
    ]
    return math.sqrt(variance), tuple(sorted(lines, key=lambda line: -abs(line.u)))


def convolved_coverage_factor(result: Result, sources: Iterable[Source]) -> float:
    """Return the half width of the interval of ``result.confidence`` over its u, to 0.1 %.

    The result is taken as its sensitivities say, a sum. Its sources within limits keep their distributions; the normal
    ones make up the rest of its variance, as one Student's t with the degrees of freedom that remain. Where these
    nearly make it all, or there is no uncertainty, its factor is kept.
    """
    rectangular = {source.name for source in sources if source.rectangular}
    bounded = [line for line in result.contributions if line.source in rectangular and line.u]
    if math.fsum(line.share for line in bounded) <= _NEARLY_NORMAL:
        return result.coverage_factor
    half_widths = [math.sqrt(3.0) * abs(line.u) for line in bounded]
    normal = (line.share for line in result.contributions if line.source not in rectangular)
    rest_share = max(0.0, math.fsum(normal))
    rest_u = result.u * math.sqrt(rest_share)
    rest_dof = result.dof * rest_share**2 if rest_share else math.inf  # Welch and Satterthwaite backwards
    reach = math.fsum(half_widths) + rest_u * t_quantile(_LEFT_OUT, rest_dof)
    edges = np.linspace(-reach, reach, _CELLS + 1)
    # The same of the normal or t part, by its density in the middles
    middles = 0.5 * (edges[1:] + edges[:-1])
    if rest_u < edges[1] - edges[0]:  # narrower than a cell
        density = (np.arange(middles.size) == middles.size // 2).astype(float)
    elif math.isinf(rest_dof):
        density = np.exp(-0.5 * (middles / rest_u) ** 2)
    else:
        density = np.exp(-0.5 * (rest_dof + 1.0) * np.log1p((middles / rest_u) ** 2 / rest_dof))
    together = np.fft.rfft(np.asarray(np.fft.ifftshift(density / density.sum())))
    half_a_cell = float(edges[_CELLS // 2 + 1])
    for half_width in half_widths:
        if half_width > half_a_cell:  # what stays within the middle cell moves nothing
            # The probability of each cell, the middle one first
            first = int(edges.searchsorted(-half_width, "right")) - 1
            stop = int(edges.searchsorted(half_width)) + 1
            x = np.clip(edges[first:stop] / half_width, -1.0, 1.0)
            middle = edges.size // 2 - 1
            inside, cells = np.diff(0.5 * x), np.zeros(edges.size - 1)
            cells[: stop - 1 - middle] = inside[middle - first :]
            cells[first - middle :] = inside[: middle - first]
            together = together * np.fft.rfft(cells)
    # The upper end of the interval with equal tails about the middle
    below = np.concatenate([[0.0], np.cumsum(np.fft.fftshift(np.fft.irfft(together, _CELLS)))])
    return float(np.interp(0.5 * (1.0 + result.confidence), below, edges)) / result.u
