"""The uncertainty budget of a four-step calibration whose K_Vc is from null comparisons at rates of both signs."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from msgspec.structs import replace

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.budget import Source
from vcfbench.procedures.shared.budget import line as lines
from vcfbench.procedures.shared.budget.known_levels import KnownLevels, known_levels
from vcfbench.procedures.shared.budget.nonlinearity import CurvedLine, ValueModel, with_nonlinearity
from vcfbench.procedures.shared.budget.statement import Statement, statement
from vcfbench.procedures.shared.budget.turntable import table_values
from vcfbench.procedures.shared.sweep.window_noise import OutputSum, WindowNoise
from vcfbench.procedures.shared.sweep.windows import sweep_of
from vcfbench.procedures.virtual_coriolis.budget import MEANINGS, four_step_values
from vcfbench.procedures.virtual_coriolis.null_matching import NullMatching
from vcfbench.records.schema import Point
from vcfbench.station.settings import ProcedureSettings, Sources

_OF_PAIR = {"k_vc": "rates over V_Vc at the match rate and its opposite, half the difference: no even order in it"}

_OF_CURVE = {
    "k_vc": "rate over V_Vc at small levels: c1 of the curve through the matches",
    "virtual.scale_factor": "slope of the line of outputs against the curve's rates at these levels of V_Vc",
}

_RANGES_ARE_LEFT = "the curve took the modulator out, what is left is the generator's ranges"


def null_statement(settings: ProcedureSettings, points: Sequence[Point], matching: NullMatching) -> Statement:
    """Return the budget of K_Vc by null comparisons: errors common with the virtual line go through both.

    A volt of noise in a match, or an error of the V_Vc of one of its ranges, changes the rates that all levels of the
    virtual line stand for; to first order that is one more sum of outputs, and of errors of ranges, for each value.
    """
    sweeps = [sweep_of(settings, points, step) for step in (3, 4)]
    table, virtual = map(lines.Line.of, sweeps)
    known = settings.station.sources
    level_v = np.array([p.v_vc_v for p in sweeps[1].points])
    levels = _NullLevels.of(virtual, level_v, matching, points, known)
    sums = [*lines.line_sums("table", table), *lines.line_sums("virtual", virtual), *levels.sums]
    noise = WindowNoise.of(settings, points, table.scale_factor)
    sources, correlations = noise.sources(sums)
    sources += [*lines.instrument_sources(known), *levels.sources, *lines.earth_sources(settings, table.scale_factor)]

    def model(q: Mapping[str, Any]) -> Mapping[str, Any]:
        of_table = table_values(table, q)
        gain, rate = 1.0 + q["meter gain"], 1.0 + q["table rate"]
        k_vc = (matching.k_vc - lines.noises_of("match", q) - levels.through("k_vc", q)) * rate
        slope = virtual.scale_factor - lines.noises_of("virtual slope", q) + lines.noises_of("match slope", q)
        bias = virtual.bias_v - lines.noises_of("virtual bias", q) + lines.noises_of("match bias", q)
        bias = bias - q["meter offset"] - q.get(lines.TILT, 0.0) - levels.through("bias", q)
        return four_step_values(k_vc, of_table, (slope - levels.through("slope", q)) / gain / rate, bias / gain)

    of = _OF_CURVE if matching.curve is not None else _OF_PAIR
    stated = statement(
        settings,
        sources,
        model,
        correlations,
        {name: (unit, of.get(name, words)) for name, (unit, words) in MEANINGS.items()},
        difference="scale_factor_error_percent",
        levels_by=levels.by,
        flicker=noise.flicker,
    )
    budget = ValueModel(sources, sums, model, noise)
    curved = [
        CurvedLine.of("turntable.nonlinearity", table),
        _with_matches(CurvedLine.of("virtual.nonlinearity", virtual), level_v, matching, known_levels(points, known)),
    ]
    return with_nonlinearity(settings, stated, budget, curved)


@dataclass(frozen=True, slots=True)
class _NullLevels:
    """Effects on each value of the null comparisons' noise, and of errors of V_Vc in them and in the virtual line."""

    sums: tuple[OutputSum, ...]
    sources: tuple[Source, ...]
    by: str
    effects: Mapping[str, Mapping[str, float]]
    """Effect of each source on each value, per unit of the source."""

    @classmethod
    def of(
        cls, line: lines.Line, level_v: Floats, matching: NullMatching, points: Sequence[Point], known: Sources
    ) -> Self:
        levels = known_levels(points, known)
        sloping, shifting = line.slope_weights * line.derivative, line.bias_weights * line.derivative
        powers = level_v[:, None] ** np.arange(1, matching.coefficients.size + 1)
        of_match = matching.weights * matching.slope_of(matching.v_vc_v)  # coefficients per volt of each pair
        grows = matching.slope_of(level_v)
        by_pair = {"k_vc": of_match[0], "slope": -sloping @ powers @ of_match, "bias": -shifting @ powers @ of_match}
        by_level = {"k_vc": 0.0 * level_v, "slope": sloping * grows, "bias": shifting * grows}
        per_reading = float((np.maximum(matching.left_weights, 0.0) ** 2 / matching.readings).sum(axis=1).max())
        u_pair = np.array([levels.u_mean_v(volts, per_reading) for volts in matching.taken_v])
        u_level = np.array([levels.u_besides_v(volts) for volts in level_v])
        every_v = np.concatenate([matching.taken_v, level_v])  # what is left is interpolated, and has no such error
        moved = {value: (every_v, np.concatenate([by_pair[value], by_level[value]])) for value in by_pair}
        sources, effects = levels.errors(moved)
        for value, unit in (("k_vc", "(deg/s)/V"), ("slope", "V/(deg/s)"), ("bias", "V")):
            spread = math.hypot(np.linalg.norm(by_pair[value] * u_pair), np.linalg.norm(by_level[value] * u_level))
            name = f"{levels.by} {levels.besides}: {value}"
            sources.append(Source(name, 0.0, spread, unit))
            effects[value][name] = 1.0
        noise = matching.noise_weights
        sums = (
            OutputSum("match", noise[0], "(deg/s)/V"),
            OutputSum("match slope", sloping @ powers @ noise, "V/(deg/s)"),
            OutputSum("match bias", shifting @ powers @ noise, "V"),
        )
        return cls(sums, tuple(sources), levels.by, effects)

    def through(self, value: str, q: Mapping[str, Any]) -> Any:
        """Return the effect of the errors of V_Vc on a value."""
        return sum(size * q[name] for name, size in self.effects[value].items())


def _with_matches(line: CurvedLine, level_v: Floats, matching: NullMatching, known: KnownLevels) -> CurvedLine:
    """Return a line with errors of V_Vc, in the line and in the matches, and noise of the matches."""
    powers = level_v[:, None] ** np.arange(1, matching.coefficients.size + 1)
    by_level = line.residuals.of_outputs * line.derivative * matching.slope_of(level_v)
    moved = line.residuals.of_rates @ powers
    by_pair = moved @ (matching.weights * matching.slope_of(matching.v_vc_v))
    per_reading = float((np.maximum(matching.left_weights, 0.0) ** 2 / matching.readings).sum(axis=1).max())
    u_pair = [known.u_mean_v(volts, per_reading) for volts in matching.taken_v]
    every_v = np.concatenate([matching.taken_v, level_v])
    through = line.with_errors(known, every_v, np.hstack([by_pair, by_level]), u_pair)
    set_by_curve = matching.curve is not None and known.reading_v is None
    return replace(
        through,
        weights=line.weights + moved @ matching.noise_weights,
        only_bound=_RANGES_ARE_LEFT if set_by_curve else through.only_bound,
    )
