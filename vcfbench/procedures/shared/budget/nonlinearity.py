"""The non-linearity of lines with its uncertainty: the largest residual, or a bound where errors alone may make it."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, Self

import numpy as np
from msgspec import Struct, structs

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.budget import Distribution, Model, Source, evaluate
from vcfbench.procedures.shared.budget.known_levels import KnownLevels
from vcfbench.procedures.shared.budget.line import Line, noises_of
from vcfbench.procedures.shared.budget.statement import Circumstances, StatedValue, Statement, stated_value, statement
from vcfbench.procedures.shared.budget.worst_residual import LargestResidual, Residuals, ResidualSpread
from vcfbench.procedures.shared.sweep.windows import OutputSum, WindowNoise
from vcfbench.station.settings import ProcedureSettings

_RANGES_UNKNOWN = "nobody knows where the generator's ranges end, whose steps stand out of a line too"


class CurvedLine(Struct, frozen=True):
    """The non-linearity of one line: its residuals, and the effects of outputs and V_Vc on each of them."""

    name: str
    residuals: Residuals
    rate_deg_s: Floats
    derivative: Floats
    weights: Floats
    """(n, N): change of each residual by a volt at the output of each of all windows, ppm/V."""
    effects: Mapping[str, Floats]
    """Change of each residual by one unit of each source shared with others, ppm."""
    own: Mapping[str, Floats]
    """Change of each residual by each level's own standard uncertainty: (n, m), ppm."""
    only_bound: str = ""
    """Reason for having a bound only, whatever is found; empty where there may be a value."""

    @classmethod
    def of(cls, name: str, line: Line) -> Self:
        """Return that of a line whose rates are known but for a common factor, which cancels."""
        residuals = Residuals.of(line)
        return cls(name, residuals, line.rate_deg_s, line.derivative, residuals.of_outputs @ line.mixing, {}, {})

    def with_levels(self, k_vc: float, known: KnownLevels) -> Self:
        """Return it with errors of V_Vc; that of the one match scales all rates and cancels."""
        through = self.residuals.of_outputs * self.derivative * k_vc
        return self.with_errors(known, self.rate_deg_s / k_vc, through)

    def with_errors(self, known: KnownLevels, volts: Floats, through: Floats, u_before: Sequence[float] = ()) -> Self:
        """Return it with errors of the levels `volts`, which move the residuals by `through`, ppm/V.

        The first levels have a standard uncertainty of their own, `u_before`, V.
        """
        effects: dict[str, Floats] = {}
        u_v = np.array([*u_before, *(known.u_besides_v(each) for each in volts[len(u_before) :])])
        own = {f"{known.by} {known.besides}": through * u_v}
        if not known.ranges_v:
            largest = int(np.abs(self.residuals.ppm).argmax())
            for kind, weights in (("gain", through * volts), ("offset", through)):
                ranges = known.shared(kind, volts, weights[largest])
                columns = [limit / math.sqrt(3.0) * weights[:, here].sum(axis=1) for _, here, limit in ranges]
                own[f"{known.by} {kind}"] = np.column_stack(columns)
            return structs.replace(self, own=own, only_bound=_RANGES_UNKNOWN)
        for name, here, _ in known.shared("gain", volts, volts):
            effects[f"{known.by} gain, {name}"] = (through * volts)[:, here].sum(axis=1)
            effects[f"{known.by} offset, {name}"] = through[:, here].sum(axis=1)
        return structs.replace(self, effects=effects, own=own)


class ValueModel(Struct, frozen=True):
    """Inputs of the values of a statement: `sources` are those beside the noise of the windows."""

    sources: Sequence[Source]
    sums: Sequence[OutputSum]
    model: Model
    noise: WindowNoise


def line_statement(
    settings: ProcedureSettings,
    budget: ValueModel,
    meanings: Mapping[str, tuple[str, str]],
    curved: Sequence[CurvedLine],
    *,
    difference: str | None = None,
    levels_by: str = "",
) -> Statement:
    """Return the statement of lines with the non-linearities that stand above errors, and a bound for the others.

    `meanings`, `difference` and `levels_by` are those of :func:`.statement`. The budget is done a second time with one
    more sum for each non-linearity, so that what stood there keeps its last digit.
    """
    noise, correlations = budget.noise.sources(budget.sums)
    stated = statement(
        *(settings, [*noise, *budget.sources], budget.model, correlations, meanings),
        difference=difference,
        levels_by=levels_by,
        flicker=budget.noise.flicker,
    )
    curved = [each for each in curved if each.residuals.ppm.size > 2]  # two points lie on any line
    around, known = Circumstances.of(settings), {source.name: source for source in budget.sources}
    worst = [WorstResidual.of(each, known, budget.noise) for each in curved]
    noise, correlations = budget.noise.sources([*budget.sums, *(each.sum for each in worst)])
    own = [source for each in worst for source in each.own]

    def model(q: Mapping[str, Any]) -> Mapping[str, Any]:
        return {**around.applied(budget.model(q), q), **{each.sum.name: each.value(q) for each in worst}}

    every = evaluate([*noise, *budget.sources, *own, *around.sources], model, correlations)
    values, said, kept = list(stated.values), list(stated.not_in_u), list(range(len(stated.values)))
    for number, each in enumerate(worst, len(stated.values)):
        value = each.moved(stated_value(every.results[number], every, "ppm", _LARGEST))
        by_errors = each.by_errors_ppm(value)
        why = each.only_bound or ("" if value.value > by_errors else "errors alone may make as much")
        if why:  # no truth is further from what is found than the largest error of a residual
            said.append(f"{value.name}: {why}; it is below {value.value + by_errors:.2g} ppm (95 %)")
        else:
            values.append(value)
            kept.append(number)
    correlation = every.correlation[np.ix_(kept, kept)].tolist()
    for row, old in zip(correlation, stated.correlation, strict=False):
        row[: len(old)] = old
    return structs.replace(
        stated, values=tuple(values), correlation=tuple(map(tuple, correlation)), not_in_u=tuple(said)
    )


_LARGEST = "largest |residual| of that line over its span (max_span; of the mean where a rate has several windows)"


class WorstResidual(Struct, frozen=True):
    """The largest residual of a line: a linear functional where one alone may be it, else by trials."""

    size_ppm: float
    sum: OutputSum
    """The largest residual, as a sum of outputs."""
    own: tuple[Source, ...]
    effects: Mapping[str, float]
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
        common = np.array([curved.effects[each.name] * each.u for each in shared]).reshape(-1, len(steady))
        rectangular = np.array([each.distribution is Distribution.RECTANGULAR for each in shared], dtype=bool)
        white = noise.by_readings(curved.weights)
        spread = ResidualSpread(curved.residuals.ppm, white, noise.dof, normal, common, rectangular)
        places, k = spread.near_largest(), int(np.abs(curved.residuals.ppm).argmax())
        sign = float(np.sign(curved.residuals.ppm[k]))
        own = [
            Source(f"{name}: {curved.name}", 0.0, float(np.linalg.norm(by_level[k])), "ppm")
            for name, by_level in curved.own.items()
        ]
        effects = {name: sign * float(effect[k]) for name, effect in curved.effects.items()}
        return cls(
            float(np.abs(curved.residuals.ppm[k])),
            OutputSum(curved.name, sign * curved.weights[k], "ppm"),
            tuple(own),
            effects | {source.name: 1.0 for source in own},
            tuple(curved.residuals.rate_deg_s[places].tolist()),
            spread.largest() if places.size > 1 else None,
            curved.only_bound,
        )

    def value(self, q: Mapping[str, Any]) -> Any:
        """Return it as the sources move it, ppm."""
        return self.size_ppm - noises_of(self.sum.name, q) - sum(size * q[name] for name, size in self.effects.items())

    def moved(self, value: StatedValue) -> StatedValue:
        """Return the value with the u and U95 of trials where several residuals may be the largest."""
        if self.by_trials is None or not self.by_trials.u:
            return value
        u, u95 = self.by_trials.u, self.by_trials.u95
        at = ", ".join(f"{rate:+.4g}" for rate in self.rates_deg_s)
        of = f"{value.of}, at one of {at} deg/s; u by trials, contributions of the one found"
        return structs.replace(value, u=u, u95=u95, coverage_factor=u95 / u, of=of)

    def by_errors_ppm(self, value: StatedValue) -> float:
        """Return the largest residual by errors alone, without non-linearity, ppm (95 %)."""
        return value.u95 if self.by_trials is None else self.by_trials.by_errors
