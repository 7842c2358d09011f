"""The uncertainty budget of a four-step calibration: K_Vc by one match or by null comparisons, both lines, E_n."""

import math
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np
from msgspec.structs import replace

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.budget import Source
from vcfbench.procedures.virtual_coriolis.matching import Matching
from vcfbench.procedures.virtual_coriolis.null_matching import NullMatching
from vcfbench.records.schema import Point
from vcfbench.station.settings import Match, ProcedureSettings
from vcfbench.uncertainty import line as lines
from vcfbench.uncertainty.known_levels import KnownLevels, LevelEffects, known_levels
from vcfbench.uncertainty.nonlinearity import CurvedLine, line_statement, warming_v
from vcfbench.uncertainty.of_range import scale_factor_of_range
from vcfbench.uncertainty.statement import Circumstances, Statement
from vcfbench.uncertainty.windows import OutputSum, WindowNoise, sweep_of
from vcfbench.values.sources import (
    CARRIER_PHASE,
    DEMODULATOR_PHASE,
    METER_GAIN,
    METER_OFFSET,
    TABLE_RATE,
    TEMPERATURE,
    TILT,
    ZEROS_APART,
    Errors,
    noise_of,
)

MEANINGS = MappingProxyType(
    {
        "k_vc": ("(deg/s)/V", "rate over V_Vc at the match rate and its level of V_Vc, not at small levels"),
        "turntable.scale_factor": ("V/(deg/s)", "slope of the line through the outputs on the table at these rates"),
        "turntable.bias": ("V", "intercept of that line, with Earth's rate, mean over horizon_h"),
        "turntable.bias_deg_s": ("deg/s", "that bias as a rate"),
        "virtual.scale_factor": ("V/(deg/s)", "slope of the line of outputs against K_Vc V_Vc at these levels of V_Vc"),
        "virtual.bias": ("V", "intercept of that line, generator on, with Earth's rate, mean over horizon_h"),
        "virtual.bias_deg_s": ("deg/s", "that bias as a rate"),
        "scale_factor_error_percent": ("%", "slope of the virtual line relative to the slope on the table"),
        "bias_difference_v": ("V", "intercept of the virtual line minus the intercept on the table"),
    }
)
"""Unit of each value, and which value it is."""

_OF_PAIR: Mapping[str, str] = {
    "k_vc": "half the difference of the rates over V_Vc at both signs of the match rate, free of the quadratic term"
}
_OF_ABSOLUTE: Mapping[str, str] = {
    "k_vc": "rate over V_Vc at the match rate by outputs as they are: the generator's shift of the zero is in u",
}
_OF_CURVE: Mapping[str, str] = {
    "k_vc": "rate over V_Vc at small levels: c1 of the curve through the matches",
    "virtual.scale_factor": "slope of the line of outputs against the curve's rates at these levels of V_Vc",
}
_RANGES_ARE_LEFT = "the curve corrects the modulator, the rest is from the generator's ranges"

_Found: TypeAlias = tuple[LevelEffects, list[OutputSum], Callable[[Errors], tuple[Any, Any, Any]], CurvedLine]
"""Errors of V_Vc, noise of the matches, K_Vc, slope and bias of the virtual line by both, its non-linearity."""


def four_step_statement(
    settings: ProcedureSettings, points: Sequence[Point], matching: Matching | NullMatching
) -> Statement:
    """Return the budget of a four-step calibration: K_Vc, both lines, and their difference."""
    sweeps = [sweep_of(settings, points, step) for step in (3, 4)]
    table, virtual = map(lines.Line.of, sweeps)
    known, around = settings.station.sources, Circumstances.of(settings)
    on_levels = known_levels(points, known)
    if isinstance(matching, Matching):
        levels, matches, found, curve = _by_match(points, virtual, matching, on_levels)
        of = _OF_ABSOLUTE if matching.match is Match.ABSOLUTE else {}
    else:
        level_v = np.array([point.v_vc_v for point in sweeps[1].points])
        levels, matches, found, curve = _by_nulls(level_v, virtual, matching, on_levels)
        of = _OF_CURVE if matching.curve is not None else _OF_PAIR

    def model(q: Errors) -> Mapping[str, Any]:
        of_table, (k_vc, slope, bias) = lines.table_values(table, q, settings.null_v), found(q)
        values = {
            "k_vc": k_vc,
            **{f"turntable.{name}": value for name, value in of_table.items()},
            "virtual.scale_factor": slope,
            "virtual.bias": bias,
            "virtual.bias_deg_s": (bias - settings.null_v) / slope,
            "scale_factor_error_percent": 100.0 * (slope / of_table["scale_factor"] - 1.0),
            "bias_difference_v": bias - of_table["bias"],
        }
        return {**around.applied(values, q), **zeros_apart(around, values, q)}

    stated = line_statement(
        settings,
        [*lines.instrument_sources(known), *levels.sources, *lines.earth_sources(settings, table.scale_factor)],
        [*lines.line_sums("table", table), *lines.line_sums("virtual", virtual), *matches],
        model=model,
        around=around,
        noise=WindowNoise.of(settings, points, table.scale_factor),
        meanings={name: (unit, of.get(name, words)) for name, (unit, words) in MEANINGS.items()},
        warming=warming_v(settings, points, table),
        curved=[CurvedLine.of("turntable.nonlinearity", table), curve],
        difference="scale_factor_error_percent",
        levels_by=levels.by,
    )
    of_range = scale_factor_of_range(settings, points, 3, stated.value("turntable.scale_factor"))
    return replace(stated, bounds=(*of_range, *stated.bounds))


def zeros_apart(around: Circumstances, values: Mapping[str, Any], q: Errors) -> dict[str, Any]:
    """Return the effect of the generator's offset on the zeros, at the stated temperature and phases (U7).

    Its volts go through the modulator, so the difference of both columns' zeros goes with what a volt of V_Vc does. The
    rest of a warm-up is too small for it.
    """
    if not any(source.name in {TEMPERATURE, CARRIER_PHASE, DEMODULATOR_PHASE} for source in around.sources):
        return {}
    of_phases = [1.0 + around.phases.effect(value, q) for value in ("k_vc", "scale_factor")]
    warmer = 1.0 + around.scale_factor_per_k * q.get(TEMPERATURE, 0.0)
    apart_v, slope, applied = values["bias_difference_v"], values["virtual.scale_factor"], around.applied(values, q)
    # What one source does adds to what it does to the table's zero: sizes are told, hardly their signs
    apart_deg_s = apart_v / slope
    sign = math.copysign(1.0, getattr(apart_deg_s, "nominal_value", apart_deg_s))
    also_deg_s = sign * apart_deg_s * around.of_a_volt(q)
    return {
        "bias_difference_v": apart_v + apart_v * (1.0 / (of_phases[0] * of_phases[1] * warmer) - 1.0),
        "virtual.bias": applied["virtual.bias"] - also_deg_s * slope,
        "virtual.bias_deg_s": applied["virtual.bias_deg_s"] - also_deg_s,
    }


def _by_match(points: Sequence[Point], line: lines.Line, matching: Matching, known: KnownLevels) -> _Found:
    """Return what makes K_Vc by one match (U5) and the virtual line (U6); V_Vc errs by range."""
    k_vc, absolute = matching.k_vc, matching.match.value == "absolute"
    # The windows of steps 1 and 2 make the difference left between the two outputs
    zeros = 0.0 if absolute else 1.0
    groups = {
        (1, matching.rate_deg_s, 0.0): -1.0,
        (1, 0.0, 0.0): zeros,
        (2, 0.0, matching.best.v_vc_v): 1.0,
        (2, 0.0, matching.zero_virtual.v_vc_v): -zeros,
    }
    keys = [(point.step, point.rate_deg_s, point.v_vc_v) for point in points]
    readings = {key: sum(p.n for p, k in zip(points, keys, strict=True) if k == key) for key in groups}
    weights = [groups.get(k, 0.0) * p.n / readings.get(k, 1) for p, k in zip(points, keys, strict=True)]
    level_v = line.rate_deg_s / k_vc
    sloping, shifting = line.slope_weights * line.derivative, line.bias_weights * line.derivative
    # each output is taken from its own zero, which the generator's 0 V makes
    match_v = np.array([matching.v_vc_equal_v, 0.0])
    of_match = np.array([1.0, 0.0 if absolute else -1.0]) / matching.v_vc_equal_v
    moved = {
        "match": (match_v, of_match),
        "virtual slope": (level_v, k_vc * sloping),
        "virtual bias": (level_v, k_vc * shifting),
    }
    u_v = np.array([known.u_besides_v(volts) for volts in level_v])
    zero = 0.0 if absolute else 1.0 / matching.zero_virtual.n
    u_match = known.u_mean_v(matching.v_vc_equal_v, 1.0 / matching.best.n + zero) / abs(matching.level_v)
    spread = abs(k_vc) * np.array([np.linalg.norm(sloping * u_v), np.linalg.norm(shifting * u_v)])
    own = {
        "virtual slope": (float(spread[0]), "V/(deg/s)"),
        "virtual bias": (float(spread[1]), "V"),
        "match": (u_match, "1", math.inf, known.besides == "resolution"),
    }
    levels, span_v = known.errors(moved, own), matching.slope * matching.level_v
    if absolute:
        levels = replace(levels, sources=(*levels.sources, _apart(matching, span_v)))

    def found(q: Errors) -> tuple[Any, Any, Any]:
        gain, rate = 1.0 + q[METER_GAIN], 1.0 + q[TABLE_RATE]
        # Level that was found, over the one that gives the output
        matched = 1.0 + noise_of("match", q) / span_v + q.get(ZEROS_APART, 0.0)
        level = 1.0 + levels.through("match", q)  # at the match, over its known value
        slope = line.scale_factor - noise_of("virtual slope", q) - levels.through("virtual slope", q)
        bias = line.bias_v - noise_of("virtual bias", q) - q[METER_OFFSET]
        bias = bias - levels.through("virtual bias", q) - q.get(TILT, 0.0)
        return k_vc * rate / level / matched, slope / gain / rate * level * matched, bias / gain

    curve = CurvedLine.of("virtual.nonlinearity", line)  # the error of the one match scales all rates and cancels
    curve = curve.with_errors(known, level_v, curve.of_outputs * line.derivative * k_vc)
    return levels, [OutputSum("match", np.array(weights), "V")], found, curve


def _apart(matching: Matching, span_v: float) -> Source:
    """Return the effect of the difference of both zeros on a match of outputs as they are, relative.

    It is no limit but a known effect, so its u is the whole: that on K_Vc or on the slope, whichever is larger. Beyond
    the span of the match nothing can be said.
    """
    share = (matching.zero_virtual.output_v - matching.zero_table.output_v) / span_v
    effect = max(abs(share), abs(share) / (1.0 + share)) if share > -1.0 else math.inf
    return Source(ZEROS_APART, 0.0, effect, "1")


def _by_nulls(level_v: Floats, line: lines.Line, matching: NullMatching, known: KnownLevels) -> _Found:
    """Return what makes K_Vc by null comparisons and the virtual line (U5, U6): common errors go through both.

    A volt of noise in a match, or an error of the V_Vc of one of its ranges, changes the rates that all levels of the
    virtual line stand for; to first order that is one more sum of outputs, and of errors of ranges, for each value.
    """
    sloping, shifting = line.slope_weights * line.derivative, line.bias_weights * line.derivative
    powers = level_v[:, None] ** np.arange(1, matching.coefficients.size + 1)
    of_match = matching.weights * matching.slope_of(matching.v_vc_v)  # coefficients per volt of each pair
    grows, noise = matching.slope_of(level_v), matching.noise_weights
    by_pair = {"k_vc": of_match[0], "slope": -sloping @ powers @ of_match, "bias": -shifting @ powers @ of_match}
    by_level = {"k_vc": 0.0 * level_v, "slope": sloping * grows, "bias": shifting * grows}
    per_reading = float((np.maximum(matching.left_weights, 0.0) ** 2 / matching.readings).sum(axis=1).max())
    u_pair = np.array([known.u_mean_v(volts, per_reading) for volts in matching.taken_v])
    u_level = np.array([known.u_besides_v(volts) for volts in level_v])
    every_v = np.concatenate([matching.taken_v, level_v])  # what is left is interpolated, and has no such error
    own = {
        value: (math.hypot(np.linalg.norm(by_pair[value] * u_pair), np.linalg.norm(by_level[value] * u_level)), unit)
        for value, unit in (("k_vc", "(deg/s)/V"), ("slope", "V/(deg/s)"), ("bias", "V"))
    }
    levels = known.errors({v: (every_v, np.concatenate([by_pair[v], by_level[v]])) for v in by_pair}, own)
    sums = [
        OutputSum("match", noise[0], "(deg/s)/V"),
        OutputSum("match slope", sloping @ powers @ noise, "V/(deg/s)"),
        OutputSum("match bias", shifting @ powers @ noise, "V"),
    ]

    def found(q: Errors) -> tuple[Any, Any, Any]:
        gain, rate = 1.0 + q[METER_GAIN], 1.0 + q[TABLE_RATE]
        k_vc = (matching.k_vc - noise_of("match", q) - levels.through("k_vc", q)) * rate
        slope = line.scale_factor - noise_of("virtual slope", q) + noise_of("match slope", q)
        bias = line.bias_v - noise_of("virtual bias", q) + noise_of("match bias", q)
        bias = bias - q[METER_OFFSET] - q.get(TILT, 0.0) - levels.through("bias", q)
        return k_vc, (slope - levels.through("slope", q)) / gain / rate, bias / gain

    # The virtual line with errors of V_Vc, in itself and in the matches, and noise of the matches
    curve = CurvedLine.of("virtual.nonlinearity", line)
    moved = curve.of_rates @ powers
    through_v = np.hstack([moved @ of_match, curve.of_outputs * line.derivative * grows])
    through = curve.with_errors(known, every_v, through_v, u_pair.tolist())
    set_by_curve = matching.curve is not None and known.reading_v is None
    only_bound = _RANGES_ARE_LEFT if set_by_curve else through.only_bound
    return levels, sums, found, replace(through, weights=curve.weights + moved @ noise, only_bound=only_bound)
