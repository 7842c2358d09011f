"""The uncertainty budget of a four-step calibration: K_Vc by one match or by null comparisons, both lines, E_n."""

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from msgspec.structs import replace

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.budget import Source
from vcfbench.procedures.shared.budget import line as lines
from vcfbench.procedures.shared.budget.known_levels import KnownLevels, LevelEffects, known_levels
from vcfbench.procedures.shared.budget.nonlinearity import CurvedLine, ValueModel, line_statement
from vcfbench.procedures.shared.budget.statement import Statement
from vcfbench.procedures.shared.sweep.windows import OutputSum, WindowNoise, sweep_of
from vcfbench.procedures.virtual_coriolis.matching import Matching
from vcfbench.procedures.virtual_coriolis.null_matching import NullMatching
from vcfbench.records.schema import Point
from vcfbench.station.settings import ProcedureSettings

MEANINGS = MappingProxyType(
    {
        "k_vc": ("(deg/s)/V", "rate over V_Vc at the match rate, at that level of V_Vc and not at small ones"),
        "turntable.scale_factor": ("V/(deg/s)", "slope of the line through the outputs on the table at these rates"),
        "turntable.bias": ("V", "intercept of that line, Earth's rate in it, mean of the horizon"),
        "turntable.bias_deg_s": ("deg/s", "the same as a rate"),
        "virtual.scale_factor": ("V/(deg/s)", "slope of the line of outputs against K_Vc V_Vc at these levels of V_Vc"),
        "virtual.bias": ("V", "intercept of that line, generator on, Earth's rate in it, mean of the horizon"),
        "virtual.bias_deg_s": ("deg/s", "the same as a rate"),
        "scale_factor_error_percent": ("%", "slope of the virtual line against that of the table's"),
        "bias_difference_v": ("V", "intercept of the virtual line less that of the table's"),
    }
)
"""Unit of each value, and which value it is."""
DIFFERENCE = "scale_factor_error_percent"
"""The value that E_n judges."""


def four_step_statement(settings: ProcedureSettings, points: Sequence[Point], matching: Matching) -> Statement:
    """Return the budget of a four-step calibration by one match: K_Vc, both lines, and how they differ."""
    table, virtual = (lines.Line.of(sweep_of(settings, points, step)) for step in (3, 4))
    known, k_vc = settings.station.sources, matching.k_vc
    # The windows of steps 1 and 2 make the difference left between the two outputs
    zeros = 0.0 if matching.match.value == "absolute" else 1.0
    groups = {
        (1, matching.rate_deg_s, 0.0): -1.0,
        (1, 0.0, 0.0): zeros,
        (2, 0.0, matching.best.v_vc_v): 1.0,
        (2, 0.0, matching.zero_virtual.v_vc_v): -zeros,
    }
    keys = [(point.step, point.rate_deg_s, point.v_vc_v) for point in points]
    readings = {key: sum(p.n for p, k in zip(points, keys, strict=True) if k == key) for key in groups}
    weights = [groups.get(k, 0.0) * p.n / readings.get(k, 1) for p, k in zip(points, keys, strict=True)]
    match = OutputSum("match", np.array(weights), "V")
    sums = [*lines.line_sums("table", table), *lines.line_sums("virtual", virtual), match]
    levels = _match_levels(virtual, k_vc, matching, known_levels(points, known))
    sources = [*lines.instrument_sources(known), *levels.sources, *lines.earth_sources(settings, table.scale_factor)]
    span_v = matching.slope * matching.level_v

    def model(q: Mapping[str, Any]) -> Mapping[str, Any]:
        of_table = lines.table_values(table, q)
        gain, rate = 1.0 + q["meter gain"], 1.0 + q["table rate"]
        matched = 1.0 + lines.noises_of("match", q) / span_v  # level that was found, over the one that gives the output
        level = 1.0 + levels.through("match", q)  # at the match, over its known value
        slope = virtual.scale_factor - lines.noises_of("virtual slope", q) - levels.through("virtual slope", q)
        bias = virtual.bias_v - lines.noises_of("virtual bias", q) - q["meter offset"]
        bias = bias - levels.through("virtual bias", q) - q.get(lines.TILT, 0.0)
        virtual_slope = slope / gain / rate * level * matched
        return four_step_values(k_vc * rate / level / matched, of_table, virtual_slope, bias / gain)

    budget = ValueModel(sources, sums, model, WindowNoise.of(settings, points, table.scale_factor))
    curved = [
        CurvedLine.of("turntable.nonlinearity", table),
        CurvedLine.of("virtual.nonlinearity", virtual).with_levels(k_vc, known_levels(points, known)),
    ]
    return line_statement(settings, budget, MEANINGS, curved, difference=DIFFERENCE, levels_by=levels.by)


def four_step_values(k_vc: Any, of_table: Mapping[str, Any], slope: Any, bias: Any) -> dict[str, Any]:
    """Return the values of :data:`MEANINGS` from K_Vc, the table's values, and slope and bias of the virtual line."""
    return {
        "k_vc": k_vc,
        **{f"turntable.{name}": value for name, value in of_table.items()},
        "virtual.scale_factor": slope,
        "virtual.bias": bias,
        "virtual.bias_deg_s": bias / slope,
        "scale_factor_error_percent": 100.0 * (slope / of_table["scale_factor"] - 1.0),
        "bias_difference_v": bias - of_table["bias"],
    }


def _match_levels(line: lines.Line, k_vc: float, matching: Matching, known: KnownLevels) -> LevelEffects:
    """Return the effects of the errors of V_Vc on the match and the virtual line: gain and offset of each range."""
    level_v, absolute = line.rate_deg_s / k_vc, matching.match.value == "absolute"
    sloping, shifting = line.slope_weights * line.derivative, line.bias_weights * line.derivative
    # each output is taken from its own zero, which the generator's 0 V makes
    match_v = np.array([matching.v_vc_equal_v, 0.0])
    of_match = np.array([1.0, 0.0 if absolute else -1.0]) / matching.v_vc_equal_v
    moved = {
        "match": (match_v, of_match),
        "virtual slope": (level_v, k_vc * sloping),
        "virtual bias": (level_v, k_vc * shifting),
    }
    sources, effects = known.errors(moved)
    besides = f"{known.by} {known.besides}"
    u_v = np.array([known.u_besides_v(volts) for volts in level_v])
    zero = 0.0 if absolute else 1.0 / matching.zero_virtual.n
    u_match = known.u_mean_v(matching.v_vc_equal_v, 1.0 / matching.best.n + zero) / abs(matching.level_v)
    spread = k_vc * np.array([np.linalg.norm(sloping * u_v), np.linalg.norm(shifting * u_v)])
    sources += [
        Source(f"{besides}: virtual slope", 0.0, float(spread[0]), "V/(deg/s)"),
        Source(f"{besides}: virtual bias", 0.0, float(spread[1]), "V"),
        lines.limited(f"{besides}: match", math.sqrt(3.0) * u_match, "1")
        if known.besides == "resolution"
        else Source(f"{besides}: match", 0.0, u_match, "1"),
    ]
    for value, found in effects.items():
        found[f"{besides}: {value}"] = 1.0
    return LevelEffects(tuple(sources), known.by, effects)


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
    level_v, on_levels = np.array([p.v_vc_v for p in sweeps[1].points]), known_levels(points, known)
    levels, matches = _null_levels(virtual, level_v, matching, on_levels)
    sums = [*lines.line_sums("table", table), *lines.line_sums("virtual", virtual), *matches]
    sources = [*lines.instrument_sources(known), *levels.sources, *lines.earth_sources(settings, table.scale_factor)]

    def model(q: Mapping[str, Any]) -> Mapping[str, Any]:
        of_table = lines.table_values(table, q)
        gain, rate = 1.0 + q["meter gain"], 1.0 + q["table rate"]
        k_vc = (matching.k_vc - lines.noises_of("match", q) - levels.through("k_vc", q)) * rate
        slope = virtual.scale_factor - lines.noises_of("virtual slope", q) + lines.noises_of("match slope", q)
        bias = virtual.bias_v - lines.noises_of("virtual bias", q) + lines.noises_of("match bias", q)
        bias = bias - q["meter offset"] - q.get(lines.TILT, 0.0) - levels.through("bias", q)
        return four_step_values(k_vc, of_table, (slope - levels.through("slope", q)) / gain / rate, bias / gain)

    of = _OF_CURVE if matching.curve is not None else _OF_PAIR
    meanings = {name: (unit, of.get(name, words)) for name, (unit, words) in MEANINGS.items()}
    budget = ValueModel(sources, sums, model, WindowNoise.of(settings, points, table.scale_factor))
    # The virtual line with errors of V_Vc, in itself and in the matches, and noise of the matches
    line = CurvedLine.of("virtual.nonlinearity", virtual)
    by_level = line.residuals.of_outputs * line.derivative * matching.slope_of(level_v)
    moved = line.residuals.of_rates @ level_v[:, None] ** np.arange(1, matching.coefficients.size + 1)
    by_pair = moved @ (matching.weights * matching.slope_of(matching.v_vc_v))
    every_v, u_pair = np.concatenate([matching.taken_v, level_v]), _u_pair(matching, on_levels).tolist()
    through = line.with_errors(on_levels, every_v, np.hstack([by_pair, by_level]), u_pair)
    set_by_curve = matching.curve is not None and on_levels.reading_v is None
    only_bound = _RANGES_ARE_LEFT if set_by_curve else through.only_bound
    through = replace(through, weights=line.weights + moved @ matching.noise_weights, only_bound=only_bound)
    curved = [CurvedLine.of("turntable.nonlinearity", table), through]
    return line_statement(settings, budget, meanings, curved, difference=DIFFERENCE, levels_by=levels.by)


def _null_levels(
    line: lines.Line, level_v: Floats, matching: NullMatching, known: KnownLevels
) -> tuple[LevelEffects, list[OutputSum]]:
    """Return the effects of errors of V_Vc, in the null comparisons and the virtual line, and the matches' noise."""
    sloping, shifting = line.slope_weights * line.derivative, line.bias_weights * line.derivative
    powers = level_v[:, None] ** np.arange(1, matching.coefficients.size + 1)
    of_match = matching.weights * matching.slope_of(matching.v_vc_v)  # coefficients per volt of each pair
    grows = matching.slope_of(level_v)
    by_pair = {"k_vc": of_match[0], "slope": -sloping @ powers @ of_match, "bias": -shifting @ powers @ of_match}
    by_level = {"k_vc": 0.0 * level_v, "slope": sloping * grows, "bias": shifting * grows}
    u_pair, u_level = _u_pair(matching, known), np.array([known.u_besides_v(volts) for volts in level_v])
    every_v = np.concatenate([matching.taken_v, level_v])  # what is left is interpolated, and has no such error
    moved = {value: (every_v, np.concatenate([by_pair[value], by_level[value]])) for value in by_pair}
    sources, effects = known.errors(moved)
    for value, unit in (("k_vc", "(deg/s)/V"), ("slope", "V/(deg/s)"), ("bias", "V")):
        spread = math.hypot(np.linalg.norm(by_pair[value] * u_pair), np.linalg.norm(by_level[value] * u_level))
        name = f"{known.by} {known.besides}: {value}"
        sources.append(Source(name, 0.0, spread, unit))
        effects[value][name] = 1.0
    noise = matching.noise_weights
    sums = [
        OutputSum("match", noise[0], "(deg/s)/V"),
        OutputSum("match slope", sloping @ powers @ noise, "V/(deg/s)"),
        OutputSum("match bias", shifting @ powers @ noise, "V"),
    ]
    return LevelEffects(tuple(sources), known.by, effects), sums


def _u_pair(matching: NullMatching, known: KnownLevels) -> Floats:
    """Return the standard uncertainty of V_Vc of each pair by errors of its own, V."""
    per_reading = float((np.maximum(matching.left_weights, 0.0) ** 2 / matching.readings).sum(axis=1).max())
    return np.array([known.u_mean_v(volts, per_reading) for volts in matching.taken_v])
