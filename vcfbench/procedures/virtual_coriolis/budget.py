"""The uncertainty budget of a four-step calibration: K_Vc from one match, both lines, and how they differ."""

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, Self

import numpy as np
from msgspec import Struct

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.budget import Source
from vcfbench.procedures.shared.budget.known_levels import KnownLevels, known_levels
from vcfbench.procedures.shared.budget.line import (
    TILT,
    Line,
    earth_sources,
    instrument_sources,
    limited,
    line_sums,
    noises_of,
)
from vcfbench.procedures.shared.budget.nonlinearity import CurvedLine, ValueModel, with_nonlinearity
from vcfbench.procedures.shared.budget.statement import Statement, statement
from vcfbench.procedures.shared.budget.turntable import table_values
from vcfbench.procedures.shared.sweep.window_noise import OutputSum, WindowNoise
from vcfbench.procedures.shared.sweep.windows import sweep_of
from vcfbench.procedures.virtual_coriolis.matching import Matching
from vcfbench.records.schema import Point
from vcfbench.station.settings import ProcedureSettings

MEANINGS = MappingProxyType(
    {
        "k_vc": (
            "(deg/s)/V",
            "rate over V_Vc at the match rate, at that level of V_Vc and not at small ones",
        ),
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


def four_step_statement(settings: ProcedureSettings, points: Sequence[Point], matching: Matching) -> Statement:
    """Return the budget of a four-step calibration by one match: K_Vc, both lines, and how they differ."""
    table, virtual = (Line.of(sweep_of(settings, points, step)) for step in (3, 4))
    known, k_vc = settings.station.sources, matching.k_vc
    match = OutputSum("match", _match_weights(points, matching), "V")
    sums = [*line_sums("table", table), *line_sums("virtual", virtual), match]
    noise = WindowNoise.of(settings, points, table.scale_factor)
    sources, correlations = noise.sources(sums)
    levels = _Levels.of(virtual, k_vc, matching, known_levels(points, known))
    sources += [*instrument_sources(known), *levels.sources, *earth_sources(settings, table.scale_factor)]
    span_v = matching.slope * matching.level_v

    def model(q: Mapping[str, Any]) -> Mapping[str, Any]:
        of_table = table_values(table, q)
        gain, rate = 1.0 + q["meter gain"], 1.0 + q["table rate"]
        matched = 1.0 + noises_of("match", q) / span_v  # level that was found, over the one that gives the output
        level = 1.0 + levels.through("match", q)  # at the match, over its known value
        slope = virtual.scale_factor - noises_of("virtual slope", q) - levels.through("virtual slope", q)
        bias = virtual.bias_v - noises_of("virtual bias", q) - q["meter offset"] - levels.through("virtual bias", q)
        bias = bias - q.get(TILT, 0.0)
        virtual_slope = slope / gain / rate * level * matched
        return four_step_values(k_vc * rate / level / matched, of_table, virtual_slope, bias / gain)

    stated = statement(
        settings,
        sources,
        model,
        correlations,
        MEANINGS,
        difference="scale_factor_error_percent",
        levels_by=levels.by,
        flicker=noise.flicker,
    )
    budget = ValueModel(sources, sums, model, noise)
    curved = [
        CurvedLine.of("turntable.nonlinearity", table),
        CurvedLine.of("virtual.nonlinearity", virtual).with_levels(k_vc, known_levels(points, known)),
    ]
    return with_nonlinearity(settings, stated, budget, curved)


def four_step_values(k_vc: Any, of_table: Mapping[str, Any], slope: Any, bias: Any) -> dict[str, Any]:
    """Return the values of :data:`MEANINGS` from K_Vc, the table's values, and slope and bias of the virtual line."""
    return {
        "k_vc": k_vc,
        "turntable.scale_factor": of_table["scale_factor"],
        "turntable.bias": of_table["bias"],
        "turntable.bias_deg_s": of_table["bias_deg_s"],
        "virtual.scale_factor": slope,
        "virtual.bias": bias,
        "virtual.bias_deg_s": bias / slope,
        "scale_factor_error_percent": 100.0 * (slope / of_table["scale_factor"] - 1.0),
        "bias_difference_v": bias - of_table["bias"],
    }


def _match_weights(points: Sequence[Point], matching: Matching) -> Floats:
    """Return the weights of the windows of steps 1 and 2 in the difference left between the two outputs."""
    zeros = 0.0 if matching.match.value == "absolute" else 1.0
    groups = {
        (1, matching.rate_deg_s, 0.0): -1.0,
        (1, 0.0, 0.0): zeros,
        (2, 0.0, matching.best.v_vc_v): 1.0,
        (2, 0.0, matching.zero_virtual.v_vc_v): -zeros,
    }
    keys = [(point.step, point.rate_deg_s, point.v_vc_v) for point in points]
    readings = {key: sum(p.n for p, k in zip(points, keys, strict=True) if k == key) for key in groups}
    return np.array([groups.get(k, 0.0) * p.n / readings.get(k, 1) for p, k in zip(points, keys, strict=True)])


class _Levels(Struct, frozen=True):
    """Effects of the errors of V_Vc on the match and the virtual line: gain and offset of each range."""

    sources: tuple[Source, ...]
    by: str
    effects: Mapping[str, Mapping[str, float]]
    """Effect of each source on each value, per unit of the source."""

    @classmethod
    def of(cls, line: Line, k_vc: float, matching: Matching, known: KnownLevels) -> Self:
        level_v, absolute = line.rate_deg_s / k_vc, matching.match.value == "absolute"
        sloping, shifting = line.slope_weights * line.derivative, line.bias_weights * line.derivative
        # each output is taken from its own zero, which the generator's 0 V makes
        match_v = np.array([matching.v_vc_equal_v, 0.0])
        of_match = np.array([1.0, 0.0 if absolute else -1.0]) / matching.v_vc_equal_v
        sources, effects = known.errors(
            {
                "match": (match_v, of_match),
                "virtual slope": (level_v, k_vc * sloping),
                "virtual bias": (level_v, k_vc * shifting),
            }
        )
        besides = f"{known.by} {known.besides}"
        u_v = np.array([known.u_besides_v(volts) for volts in level_v])
        zero = 0.0 if absolute else 1.0 / matching.zero_virtual.n
        u_match = known.u_mean_v(matching.v_vc_equal_v, 1.0 / matching.best.n + zero) / abs(matching.level_v)
        spread = k_vc * np.array([np.linalg.norm(sloping * u_v), np.linalg.norm(shifting * u_v)])
        sources += [
            Source(f"{besides}: virtual slope", 0.0, float(spread[0]), "V/(deg/s)"),
            Source(f"{besides}: virtual bias", 0.0, float(spread[1]), "V"),
            limited(f"{besides}: match", math.sqrt(3.0) * u_match, "1")
            if known.besides == "resolution"
            else Source(f"{besides}: match", 0.0, u_match, "1"),
        ]
        for value, found in effects.items():
            found[f"{besides}: {value}"] = 1.0
        return cls(tuple(sources), known.by, effects)

    def through(self, value: str, q: Mapping[str, Any]) -> Any:
        """Return the effect of the errors of V_Vc on a value."""
        return sum(size * q[name] for name, size in self.effects[value].items())
