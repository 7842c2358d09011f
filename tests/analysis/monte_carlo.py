"""Propagation of distributions by Monte Carlo (JCGM 101:2008), to check a budget of first order."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from vcfbench.analysis.budget import check_sources, correlated_groups
from vcfbench.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from vcfbench.analysis.budget import Correlations, Model, Result, Source

Floats: TypeAlias = "NDArray[np.float64]"


@dataclass(frozen=True, slots=True)
class Propagated:
    """The distribution of one result."""

    name: str
    value: float
    """Mean of the trials."""
    u: float
    """Their standard deviation."""
    low: float
    """Coverage interval with equal tails."""
    high: float
    shortest_low: float
    """The shortest interval of that coverage."""
    shortest_high: float


@dataclass(frozen=True, slots=True)
class Agreement:
    """A budget's interval against that of the trials (JCGM 101, clause 8)."""

    low_apart: float
    high_apart: float
    tolerance: float
    """Half of the last of two significant digits of the standard uncertainty."""

    @property
    def holds(self) -> bool:
        """True if first-order propagation is good enough here."""
        return max(self.low_apart, self.high_apart) <= self.tolerance


def propagate(
    sources: Sequence[Source],
    model: Model,
    correlations: Correlations | None = None,
    *,
    trials: int = 200_000,
    seed: int = 0,
    confidence: float = 0.95,
) -> tuple[Propagated, ...]:
    """Draw the sources and return the distributions of the results; `model` gets arrays of `trials` values.

    Correlated sources are drawn from a joint normal distribution, or t with finite degrees of freedom.

    Raises:
        ConfigError: sources or correlations that cannot be, or too few trials for the interval.
    """
    if trials * (1.0 - confidence) < 100.0:
        raise ConfigError(f"{trials} trials are too few for an interval of {100.0 * confidence:g} %")
    pairs = {} if correlations is None else dict(correlations)
    check_sources(sources, pairs)
    rng = np.random.default_rng(seed)
    drawn: dict[str, Floats] = {}
    for group in correlated_groups(sources, pairs):
        drawn.update(_drawn(group, pairs, trials, rng))
    outputs = model({source.name: drawn[source.name] for source in sources})
    return tuple(_summary(name, np.broadcast_to(value, trials), confidence) for name, value in outputs.items())


def _drawn(group: list[Source], pairs: Correlations, trials: int, rng: np.random.Generator) -> dict[str, Floats]:
    if len(group) == 1:
        (source,) = group
        return {source.name: source.value + source.u * _standard(source, trials, rng)}
    if any(source.rectangular for source in group):
        raise ConfigError(f"correlated sources must be normal: {', '.join(source.name for source in group)}")
    places = {source.name: place for place, source in enumerate(group)}
    matrix = np.eye(len(group))
    for (first, second), coefficient in pairs.items():
        if first in places and second in places:
            matrix[places[first], places[second]] = matrix[places[second], places[first]] = coefficient
    sizes, axes = np.linalg.eigh(matrix)
    if sizes[0] < -1e-9:
        raise ConfigError(f"the correlations of {', '.join(places)} contradict each other")
    values = rng.standard_normal((trials, len(group))) @ (axes * np.sqrt(np.maximum(sizes, 0.0))).T
    if math.isfinite(group[0].dof):
        values *= np.sqrt(group[0].dof / rng.chisquare(group[0].dof, (trials, 1)))
    return {source.name: source.value + source.u * values[:, places[source.name]] for source in group}


def _standard(source: Source, trials: int, rng: np.random.Generator) -> Floats:
    """Draw from the source's distribution with mean 0 and standard deviation 1 (a t keeps its scale of 1)."""
    if source.rectangular:
        return rng.uniform(-math.sqrt(3.0), math.sqrt(3.0), trials)
    return rng.standard_t(source.dof, trials) if math.isfinite(source.dof) else rng.standard_normal(trials)


def _summary(name: str, values: Floats, confidence: float) -> Propagated:
    ordered = np.sort(values)
    held = math.floor(confidence * ordered.size)
    widths = ordered[held:] - ordered[:-held]
    start = int(widths.argmin())
    tail = (ordered.size - held) // 2
    return Propagated(
        name=name,
        value=float(ordered.mean()),
        u=float(ordered.std(ddof=1)),
        low=float(ordered[tail]),
        high=float(ordered[tail + held]),
        shortest_low=float(ordered[start]),
        shortest_high=float(ordered[start + held]),
    )


def agreement(result: Result, propagated: Propagated) -> Agreement:
    """Compare a budget's result with the trials'."""
    low, high = result.value - result.expanded_u, result.value + result.expanded_u
    digits = math.floor(math.log10(propagated.u)) - 1 if propagated.u > 0.0 else 0
    return Agreement(abs(low - propagated.low), abs(high - propagated.high), 0.5 * 10.0**digits)
