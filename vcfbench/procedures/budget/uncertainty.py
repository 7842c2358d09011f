"""Uncertainty budgets of the two calibrations: one combined standard uncertainty for each value, and what it holds.

Model, contributions and what is left out are described in docs/uncertainty.md. Linear sums over the windows (slopes,
intercepts, the match of step 2) are weights; readings' scatter and flicker go through them with their correlations, and
the rest is a model for :mod:`~vcfbench.analysis.budget`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from vcfbench.analysis.budget import Distribution, Source, evaluate
from vcfbench.analysis.convolution import convolved_coverage_factor
from vcfbench.bench.settings import V_VC_RANGE_V
from vcfbench.procedures.budget.worst_residual import Residuals, Spread
from vcfbench.procedures.sweep.schedule import earth_left_deg_s
from vcfbench.procedures.sweep.window_noise import OutputSum, WindowNoise
from vcfbench.procedures.sweep.windows import sweep_of
from vcfbench.procedures.virtual_coriolis.matching import Matching

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    from vcfbench.analysis.budget import Budget, Model, Result
    from vcfbench.bench.settings import ProcedureSettings, Sources
    from vcfbench.procedures.budget.worst_residual import Largest
    from vcfbench.procedures.sweep.windows import Sweep
    from vcfbench.procedures.virtual_coriolis.null_matching import NullMatching
    from vcfbench.record.schema import Point

__all__ = [
    "Line",
    "StatedContribution",
    "StatedValue",
    "Statement",
    "four_step_statement",
    "turntable_statement",
]

Floats: TypeAlias = "NDArray[np.float64]"

_NEARLY_NORMAL = 0.05
"""Share of the variance from sources that are not normal up to which Student's t gives the coverage factor."""


@dataclass(frozen=True, slots=True)
class StatedContribution:
    """What one source adds to one value."""

    source: str
    distribution: str
    u_source: float
    unit: str
    dof: float | None
    """None: infinite, for what is known beforehand."""
    sensitivity: float
    u: float
    """Sensitivity times `u_source`, in the unit of the value."""
    share: float
    """Of the variance."""


@dataclass(frozen=True, slots=True)
class StatedValue:
    """A value with its combined standard uncertainty and what that is made of; `of` says which value it is."""

    name: str
    value: float
    unit: str
    u: float
    dof: float | None
    """Effective degrees of freedom; None: infinite."""
    coverage_factor: float
    u95: float
    """Half width of the interval that holds the true value with 95 %."""
    of: str
    contributions: tuple[StatedContribution, ...]


@dataclass(frozen=True, slots=True)
class Statement:
    """All values with an uncertainty, their correlations, and what the uncertainties do not hold."""

    values: tuple[StatedValue, ...]
    correlation: tuple[tuple[float, ...], ...]
    e_n: float | None
    """Difference of the methods' scale factors over its expanded uncertainty, correlations included; above 1 they
    disagree. None where there is one method."""
    not_in_u: tuple[str, ...]

    def value(self, name: str) -> StatedValue:
        """Return one value; KeyError when it has no uncertainty."""
        for each in self.values:
            if each.name == name:
                return each
        raise KeyError(name)


@dataclass(frozen=True, slots=True)
class Line:
    """A least-squares line as sums over windows."""

    rate_deg_s: Floats
    output_v: Floats
    scale_factor: float
    bias_v: float
    derivative: Floats
    """Slope of the curve through the outputs at each rate, V/(deg/s)."""

    mixing: Floats
    """What makes the outputs of the line of those of all windows: the windows' own, less a drift of zeros."""

    @classmethod
    def of(cls, sweep: Sweep) -> Line:
        """Return the line of the windows of a sweep."""
        rate = np.array([point.rate_deg_s for point in sweep.points])
        output = np.array([point.output_v for point in sweep.points])
        scale_factor, bias_v = np.polynomial.Polynomial.fit(rate, output, 1).convert().coef[::-1]
        order = 3 if np.unique(rate).size > 4 else 1
        derivative = np.polynomial.Polynomial.fit(rate, output, order).deriv()(rate)
        return cls(rate, output, float(scale_factor), float(bias_v), np.asarray(derivative), sweep.mixing)

    @property
    def slope_weights(self) -> Floats:
        """Weights of the outputs in the slope, 1/(deg/s)."""
        off = self.rate_deg_s - self.rate_deg_s.mean()
        return np.asarray(off / float(off @ off))

    @property
    def bias_weights(self) -> Floats:
        """Weights of the outputs in the intercept."""
        return np.asarray(1.0 / self.rate_deg_s.size - self.rate_deg_s.mean() * self.slope_weights)


def turntable_statement(settings: ProcedureSettings, points: Sequence[Point], step: int = 1) -> Statement:
    """Return the budget of a calibration on the table: scale factor and bias of its line."""
    line = Line.of(sweep_of(settings, points, step))
    known = settings.station.sources
    sums = _line_sums("table", line)
    noise = WindowNoise.of(settings, points, line.scale_factor)
    sources, correlations = noise.sources(sums)
    sources += [*_meter(known), *_table(known), *_earth(settings, line.scale_factor)]

    def model(q: Mapping[str, Any]) -> Mapping[str, Any]:
        return _table_values(line, q)

    stated = _statement(settings, sources, model, correlations)
    budget = _Model(sources, sums, model, noise)
    return _with_nonlinearity(settings, stated, budget, [_Curved.of("nonlinearity", line)])


def four_step_statement(
    settings: ProcedureSettings, points: Sequence[Point], matching: Matching | NullMatching
) -> Statement:
    """Return the budget of a four-step calibration: K_Vc, both lines, and how they differ."""
    if not isinstance(matching, Matching):
        return _null_statement(settings, points, matching)
    table, virtual = (Line.of(sweep_of(settings, points, step)) for step in (3, 4))
    known, k_vc = settings.station.sources, matching.k_vc
    match = OutputSum("match", _match_weights(points, matching), "V")
    sums = [*_line_sums("table", table), *_line_sums("virtual", virtual), match]
    noise = WindowNoise.of(settings, points, table.scale_factor)
    sources, correlations = noise.sources(sums)
    levels = _Levels.of(virtual, k_vc, matching, _known_levels(points, known))
    sources += [*_meter(known), *_table(known), *levels.sources, *_earth(settings, table.scale_factor)]
    span_v = matching.slope * matching.level_v

    def model(q: Mapping[str, Any]) -> Mapping[str, Any]:
        of_table = _table_values(table, q)
        gain, rate = 1.0 + q["meter gain"], 1.0 + q["table rate"]
        matched = 1.0 + _noises("match", q) / span_v  # level that was found, over the one that gives the output
        level = levels.matched(q)
        slope = virtual.scale_factor - _noises("virtual slope", q) - levels.slope(q)
        bias = virtual.bias_v - _noises("virtual bias", q) - q["meter offset"] - levels.bias(q) - q.get(_TILT, 0.0)
        virtual_slope = slope / gain / rate * level * matched
        return _four_step_values(k_vc * rate / level / matched, of_table, virtual_slope, bias / gain)

    stated = _statement(
        settings, sources, model, correlations, difference="scale_factor_error_percent", levels_by=levels.by
    )
    budget = _Model(sources, sums, model, noise)
    curved = [
        _Curved.of("turntable.nonlinearity", table),
        _Curved.of("virtual.nonlinearity", virtual).with_levels(k_vc, _known_levels(points, known)),
    ]
    return _with_nonlinearity(settings, stated, budget, curved)


def _null_statement(settings: ProcedureSettings, points: Sequence[Point], matching: NullMatching) -> Statement:
    """Return the budget where K_Vc is from null comparisons: what they share with the virtual line goes through both.

    A volt of noise in a match, or an error of the V_Vc of one of its ranges, changes the rates that all levels of the
    virtual line stand for; to first order that is one more sum of outputs, and of errors of ranges, for each value.
    """
    sweeps = [sweep_of(settings, points, step) for step in (3, 4)]
    table, virtual = map(Line.of, sweeps)
    known = settings.station.sources
    level_v = np.array([p.v_vc_v for p in sweeps[1].points])
    levels = _NullLevels.of(virtual, level_v, matching, points, known)
    sums = [*_line_sums("table", table), *_line_sums("virtual", virtual), *levels.sums]
    noise = WindowNoise.of(settings, points, table.scale_factor)
    sources, correlations = noise.sources(sums)
    sources += [*_meter(known), *_table(known), *levels.sources, *_earth(settings, table.scale_factor)]

    def model(q: Mapping[str, Any]) -> Mapping[str, Any]:
        of_table = _table_values(table, q)
        gain, rate = 1.0 + q["meter gain"], 1.0 + q["table rate"]
        k_vc = (matching.k_vc - _noises("match", q) - levels.through("k_vc", q)) * rate
        slope = virtual.scale_factor - _noises("virtual slope", q) + _noises("match slope", q)
        bias = virtual.bias_v - _noises("virtual bias", q) + _noises("match bias", q)
        bias = bias - q["meter offset"] - q.get(_TILT, 0.0) - levels.through("bias", q)
        return _four_step_values(k_vc, of_table, (slope - levels.through("slope", q)) / gain / rate, bias / gain)

    stated = _statement(
        settings,
        sources,
        model,
        correlations,
        difference="scale_factor_error_percent",
        levels_by=levels.by,
        meanings=_OF_CURVE if matching.curve is not None else _OF_PAIR,
    )
    budget = _Model(sources, sums, model, noise)
    curved = [
        _Curved.of("turntable.nonlinearity", table),
        _Curved.of("virtual.nonlinearity", virtual).with_matches(level_v, matching, _known_levels(points, known)),
    ]
    return _with_nonlinearity(settings, stated, budget, curved)


def _four_step_values(k_vc: Any, of_table: Mapping[str, Any], slope: Any, bias: Any) -> dict[str, Any]:
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


_OF_PAIR = {"k_vc": "rates over V_Vc at the match rate and its opposite, half the difference: no even order in it"}
_OF_CURVE = {
    "k_vc": "rate over V_Vc at small levels: c1 of the curve through the matches",
    "virtual.scale_factor": "slope of the line of outputs against the curve's rates at these levels of V_Vc",
}
_OF = {
    "scale_factor": ("V/(deg/s)", "slope of the least-squares line through the outputs on the table at these rates"),
    "bias": ("V", "intercept of that line, Earth's rate in it, mean of the horizon"),
    "bias_deg_s": ("deg/s", "the same as a rate"),
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


def _table_values(line: Line, q: Mapping[str, Any]) -> dict[str, Any]:
    gain = 1.0 + q["meter gain"]
    slope = (line.scale_factor - _noises("table slope", q)) / gain / (1.0 + q["table rate"])
    bias = (line.bias_v - _noises("table bias", q) - q["meter offset"] - q.get(_TILT, 0.0)) / gain
    return {"scale_factor": slope, "bias": bias, "bias_deg_s": bias / slope}


_TILT = "Earth's rate by the axis' tilt"


def _earth(settings: ProcedureSettings, scale_factor: float) -> list[Source]:
    """Return what is left of the Earth's rate where it was added to the rates."""
    left_deg_s = earth_left_deg_s(settings)
    return [] if left_deg_s is None else [Source.within(_TILT, 0.0, abs(scale_factor) * left_deg_s, "V")]


def _noises(name: str, q: Mapping[str, Any]) -> Any:
    return q[f"readings: {name}"] + q[f"flicker: {name}"]


def _line_sums(name: str, line: Line) -> list[OutputSum]:
    return [
        OutputSum(f"{name} slope", line.slope_weights @ line.mixing, "V/(deg/s)"),
        OutputSum(f"{name} bias", line.bias_weights @ line.mixing, "V", steady=True),
    ]


def _match_weights(points: Sequence[Point], matching: Matching) -> Floats:
    """Return the weights of the windows of steps 1 and 2 in what is left between the two outputs."""
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


def _limited(name: str, limit: float | None, unit: str, sigmas: float | None = None) -> Source:
    """Return a source within a limit: normal with so many sigmas, else rectangular; not known: none."""
    if limit is None or sigmas is not None:
        return Source(name, 0.0, (limit or 0.0) / (sigmas or 1.0), unit)
    return Source.within(name, 0.0, limit, unit)


def _meter(known: Sources) -> list[Source]:
    return [
        _limited("meter gain", known.meter_gain, "1", known.meter_sigmas),
        _limited("meter offset", known.meter_offset_v, "V", known.meter_sigmas),
    ]


def _table(known: Sources) -> list[Source]:
    return [_limited("table rate", known.table_rate, "1")]


@dataclass(frozen=True, slots=True)
class _KnownLevels:
    """What V_Vc is known by, and how well: gain and offset are the same at all levels of one of its ranges."""

    by: str
    ranges_v: tuple[float, ...]
    gain: float | None
    offset_v: float | None
    sigmas: float | None
    besides: str
    """What every level has of its own."""
    u_besides_v: Callable[[float], float]
    """Of one level of the virtual line, V."""
    reading_v: float | None
    """Scatter of one reading of V_Vc, V; None where it was set."""

    def range_of(self, level_v: float) -> int:
        """Return the place of the range that a level is on."""
        return next((n for n, upper in enumerate(self.ranges_v) if abs(level_v) <= upper), len(self.ranges_v) - 1)

    def u_mean_v(self, level_v: float, per_reading: float) -> float:
        """Return the standard uncertainty of what a level has of its own, V, the mean of 1 / `per_reading` readings."""
        return self.u_besides_v(level_v) if self.reading_v is None else self.reading_v * math.sqrt(per_reading)


def _known_levels(points: Sequence[Point], known: Sources) -> _KnownLevels:
    """Return what V_Vc is known by: the meter that measured it, else the generator that it was set on."""
    scatter_v = [point.v_vc_std_v for point in points if point.v_vc_std_v is not None]
    if not scatter_v:
        ranges = known.generator_ranges_v or (math.inf,)

        def resolved(level_v: float) -> float:
            upper_v = next((each for each in ranges if abs(level_v) <= each), ranges[-1])
            return _step_v(upper_v, known.generator_bits) / math.sqrt(12.0)

        gain, offset_v = known.generator_gain, known.generator_offset_v
        return _KnownLevels("generator", ranges, gain, offset_v, None, "resolution", resolved, None)
    pooled_v = math.sqrt(math.fsum(each**2 for each in scatter_v) / len(scatter_v))
    samples = min(point.n for point in points)
    return _KnownLevels(
        "V_Vc meter",
        (V_VC_RANGE_V,),
        known.v_vc_gain,
        known.v_vc_offset_v,
        known.v_vc_sigmas,
        "readings",
        lambda _level_v: pooled_v / math.sqrt(samples),
        pooled_v,
    )


@dataclass(frozen=True, slots=True)
class _Levels:
    """What the errors of V_Vc do to the match and to the virtual line: gain and offset of each range."""

    sources: tuple[Source, ...]
    by: str
    besides: str
    match_range: str
    absolute_v: float
    """What an offset is divided by in the match, V; infinite where each output is taken from its own zero."""
    gain_slope: Mapping[str, float]
    offset_slope: Mapping[str, float]
    gain_bias: Mapping[str, float]
    offset_bias: Mapping[str, float]

    @classmethod
    def of(cls, line: Line, k_vc: float, matching: Matching, known: _KnownLevels) -> _Levels:
        level_v = line.rate_deg_s / k_vc
        own, match = [known.range_of(volts) for volts in level_v], known.range_of(matching.v_vc_equal_v)
        sloping, shifting = line.slope_weights * line.derivative, line.bias_weights * line.derivative
        names = {n: f"{known.ranges_v[n]:g} V range" for n in sorted({*own, match})}

        def sums(values: Floats) -> dict[str, float]:
            return {
                name: float(sum(v for v, o in zip(values, own, strict=True) if o == n)) for n, name in names.items()
            }

        by, besides = known.by, f"{known.by} {known.besides}"
        u_v = np.array([known.u_besides_v(volts) for volts in level_v])
        spread = k_vc * np.array([np.linalg.norm(sloping * u_v), np.linalg.norm(shifting * u_v)])
        sources = [
            source
            for name in names.values()
            for source in (
                _limited(f"{by} gain, {name}", known.gain, "1", known.sigmas),
                _limited(f"{by} offset, {name}", known.offset_v, "V", known.sigmas),
            )
        ]
        zero = 0.0 if matching.match.value == "absolute" else 1.0 / matching.zero_virtual.n
        u_match = known.u_mean_v(matching.v_vc_equal_v, 1.0 / matching.best.n + zero) / abs(matching.level_v)
        sources += [
            Source(f"{besides}: virtual slope", 0.0, float(spread[0]), "V/(deg/s)"),
            Source(f"{besides}: virtual bias", 0.0, float(spread[1]), "V"),
            _limited(f"{besides}: match", math.sqrt(3.0) * u_match, "1")
            if known.besides == "resolution"
            else Source(f"{besides}: match", 0.0, u_match, "1"),
        ]
        absolute_v = matching.v_vc_equal_v if matching.match.value == "absolute" else math.inf
        by_gain, by_offset = line.rate_deg_s, k_vc
        return cls(
            tuple(sources),
            by,
            besides,
            names[match],
            absolute_v,
            sums(sloping * by_gain),
            sums(sloping * by_offset),
            sums(shifting * by_gain),
            sums(shifting * by_offset),
        )

    def matched(self, q: Mapping[str, Any]) -> Any:
        """Return the level at the match over what it is known as."""
        gain, offset = q[f"{self.by} gain, {self.match_range}"], q[f"{self.by} offset, {self.match_range}"]
        return 1.0 + gain + offset / self.absolute_v + q[f"{self.besides}: match"]

    def slope(self, q: Mapping[str, Any]) -> Any:
        """Return what the levels' errors add to the slope over known levels, V/(deg/s)."""
        return self._through(self.gain_slope, self.offset_slope, q) + q[f"{self.besides}: virtual slope"]

    def bias(self, q: Mapping[str, Any]) -> Any:
        """Return what they add to the intercept, V."""
        return self._through(self.gain_bias, self.offset_bias, q) + q[f"{self.besides}: virtual bias"]

    def _through(self, gains: Mapping[str, float], offsets: Mapping[str, float], q: Mapping[str, Any]) -> Any:
        by_gain = sum(size * q[f"{self.by} gain, {name}"] for name, size in gains.items())
        return by_gain + sum(size * q[f"{self.by} offset, {name}"] for name, size in offsets.items())


@dataclass(frozen=True, slots=True)
class _NullLevels:
    """What the noise of null comparisons, and the errors of V_Vc in them and in the virtual line, do to each value."""

    sums: tuple[OutputSum, ...]
    sources: tuple[Source, ...]
    by: str
    effects: Mapping[str, Mapping[str, float]]
    """Of each value: what each source adds to it, per unit of the source."""

    @classmethod
    def of(
        cls, line: Line, level_v: Floats, matching: NullMatching, points: Sequence[Point], known: Sources
    ) -> _NullLevels:
        levels = _known_levels(points, known)
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
        own = np.array([levels.range_of(volts) for volts in every_v])
        sources, effects = [], {value: dict[str, float]() for value in by_pair}
        for place in np.unique(own).tolist():
            here, name = own == place, f"{levels.ranges_v[place]:g} V range"
            gain, offset = f"{levels.by} gain, {name}", f"{levels.by} offset, {name}"
            sources += [
                _limited(gain, levels.gain, "1", levels.sigmas),
                _limited(offset, levels.offset_v, "V", levels.sigmas),
            ]
            for value, found in effects.items():
                both = np.concatenate([by_pair[value], by_level[value]])
                found |= {gain: float((both * every_v)[here].sum()), offset: float(both[here].sum())}
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
        """Return what the errors of V_Vc add to a value."""
        return sum(size * q[name] for name, size in self.effects[value].items())


@dataclass(frozen=True, slots=True)
class _Curved:
    """The non-linearity of one line: its residuals, and what outputs and V_Vc put into each of them."""

    name: str
    residuals: Residuals
    rate_deg_s: Floats
    derivative: Floats
    weights: Floats
    """(n, N): what a volt at the output of each of all windows puts into each residual, ppm/V."""
    effects: Mapping[str, Floats]
    """Of sources that others have too: what one unit puts into each residual, ppm."""
    own: Mapping[str, Floats]
    """Of what each level has of its own: (n, m), ppm by each level's standard uncertainty."""
    only_bound: str = ""
    """Why there is no value, whatever is found; empty where there may be one."""

    @classmethod
    def of(cls, name: str, line: Line) -> _Curved:
        """Return that of a line whose rates are known but for a common factor, which cancels."""
        residuals = Residuals.of(line)
        return cls(name, residuals, line.rate_deg_s, line.derivative, residuals.of_outputs @ line.mixing, {}, {})

    def with_levels(self, k_vc: float, known: _KnownLevels) -> _Curved:
        """Return it with errors of V_Vc; that of the one match scales all rates and cancels."""
        through = self.residuals.of_outputs * self.derivative * k_vc
        return self._with(known, self.rate_deg_s / k_vc, through)

    def with_matches(self, level_v: Floats, matching: NullMatching, known: _KnownLevels) -> _Curved:
        """Return it with errors of V_Vc, in the line and in the matches, and noise of the matches."""
        powers = level_v[:, None] ** np.arange(1, matching.coefficients.size + 1)
        by_level = self.residuals.of_outputs * self.derivative * matching.slope_of(level_v)
        moved = self.residuals.of_rates @ powers
        by_pair = moved @ (matching.weights * matching.slope_of(matching.v_vc_v))
        per_reading = float((np.maximum(matching.left_weights, 0.0) ** 2 / matching.readings).sum(axis=1).max())
        u_pair = [known.u_mean_v(volts, per_reading) for volts in matching.taken_v]
        every_v = np.concatenate([matching.taken_v, level_v])
        through = self._with(known, every_v, np.hstack([by_pair, by_level]), u_pair)
        set_by_curve = matching.curve is not None and known.reading_v is None
        return replace(
            through,
            weights=self.weights + moved @ matching.noise_weights,
            only_bound=_RANGES_ARE_LEFT if set_by_curve else "",
        )

    def _with(self, known: _KnownLevels, volts: Floats, through: Floats, u_before: Sequence[float] = ()) -> _Curved:
        own = np.array([known.range_of(each) for each in volts])
        effects: dict[str, Floats] = {}
        for place in np.unique(own).tolist():
            here, name = own == place, f"{known.ranges_v[place]:g} V range"
            effects[f"{known.by} gain, {name}"] = (through * volts)[:, here].sum(axis=1)
            effects[f"{known.by} offset, {name}"] = through[:, here].sum(axis=1)
        u_v = np.array([*u_before, *(known.u_besides_v(each) for each in volts[len(u_before) :])])
        return replace(self, effects=effects, own={f"{known.by} {known.besides}": through * u_v})


@dataclass(frozen=True, slots=True)
class _Model:
    """What the values of a statement were made of."""

    sources: Sequence[Source]
    sums: Sequence[OutputSum]
    model: Model
    noise: WindowNoise


def _with_nonlinearity(
    settings: ProcedureSettings, stated: Statement, budget: _Model, curved: Sequence[_Curved]
) -> Statement:
    """Return the statement with the non-linearities that stand above what errors make, and a bound for the others.

    The budget is done a second time with one more sum each, so that what stood there keeps its last digit.
    """
    curved = [each for each in curved if each.residuals.ppm.size > 2]  # two points lie on any line
    around, known = _Circumstances.of(settings), {source.name: source for source in budget.sources}
    worst = [_Worst.of(each, known, budget.noise) for each in curved]
    noise, correlations = budget.noise.sources([*budget.sums, *(each.sum for each in worst)])
    again = {source.name for source in noise}
    others = [source for source in budget.sources if source.name not in again]
    own = [source for each in worst for source in each.own]

    def model(q: Mapping[str, Any]) -> Mapping[str, Any]:
        return {**around.applied(budget.model(q), q), **{each.sum.name: each.value(q) for each in worst}}

    every = evaluate([*noise, *others, *own, *around.sources], model, correlations)
    values, said, kept = list(stated.values), list(stated.not_in_u), list(range(len(stated.values)))
    for number, each in enumerate(worst, len(stated.values)):
        value = each.moved(_stated(every.results[number], every, "ppm", _LARGEST))
        why = each.only_bound or ("" if value.value > each.by_errors_ppm(value) else "errors alone may make as much")
        if why:
            said.append(f"{value.name}: {why}; it is below {value.value + value.u95:.2g} ppm (95 %)")
        else:
            values.append(value)
            kept.append(number)
    correlation = every.correlation[np.ix_(kept, kept)].tolist()
    for row, old in zip(correlation, stated.correlation, strict=False):
        row[: len(old)] = old
    return replace(stated, values=tuple(values), correlation=tuple(map(tuple, correlation)), not_in_u=tuple(said))


_RANGES_ARE_LEFT = "the curve took the modulator out, what is left is the generator's ranges"
_LARGEST = "largest |residual| of that line over its span (max_span; of the mean where a rate has several windows)"


@dataclass(frozen=True, slots=True)
class _Worst:
    """The largest residual of a line: a linear functional where one alone may be it, else by trials."""

    size_ppm: float
    sum: OutputSum
    """Of the residual that is the largest."""
    own: tuple[Source, ...]
    effects: Mapping[str, float]
    rates_deg_s: tuple[float, ...]
    """Where the largest may be."""
    by_trials: Largest | None
    """None where it is one alone."""
    only_bound: str

    @classmethod
    def of(cls, curved: _Curved, sources: Mapping[str, Source], noise: WindowNoise) -> _Worst:
        """Return that of a line."""
        steady = [False] * len(curved.weights)
        normal = noise.by_flicker(curved.weights, steady) + sum(each @ each.T for each in curved.own.values())
        shared = [sources[name] for name in curved.effects]
        common = np.array([curved.effects[each.name] * each.u for each in shared]).reshape(-1, len(steady))
        rectangular = np.array([each.distribution is Distribution.RECTANGULAR for each in shared], dtype=bool)
        white = noise.by_readings(curved.weights)
        spread = Spread(curved.residuals.ppm, white, noise.dof, normal, common, rectangular)
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
        return self.size_ppm - _noises(self.sum.name, q) - sum(size * q[name] for name, size in self.effects.items())

    def moved(self, value: StatedValue) -> StatedValue:
        """Return the value with the u and U95 of trials where several residuals may be the largest."""
        if self.by_trials is None or not self.by_trials.u:
            return value
        u, u95 = self.by_trials.u, self.by_trials.u95
        at = ", ".join(f"{rate:+.4g}" for rate in self.rates_deg_s)
        of = f"{value.of}, at one of {at} deg/s; u by trials, contributions of the one found"
        return replace(value, u=u, u95=u95, coverage_factor=u95 / u, of=of)

    def by_errors_ppm(self, value: StatedValue) -> float:
        """Return what errors alone would make of no non-linearity, ppm (95 %)."""
        return value.u95 if self.by_trials is None else self.by_trials.by_errors


def _step_v(upper_v: float, bits: int) -> float:
    return 2.0 * upper_v / 2**bits if bits and math.isfinite(upper_v) else 0.0


def _statement(
    settings: ProcedureSettings,
    sources: Sequence[Source],
    model: Model,
    correlations: Mapping[tuple[str, str], float],
    *,
    difference: str | None = None,
    levels_by: str = "",
    meanings: Mapping[str, str] = MappingProxyType({}),
) -> Statement:
    around = _Circumstances.of(settings)
    budget = evaluate([*sources, *around.sources], lambda q: around.applied(model(q), q), correlations)
    unit_and_meaning = {
        name: (unit, _meaning(settings, meanings.get(name, words))) for name, (unit, words) in _OF.items()
    }
    values = tuple(_stated(result, budget, *unit_and_meaning[result.name]) for result in budget.results)
    ratio = None
    if difference is not None and (stated := next(v for v in values if v.name == difference)).u95 > 0.0:
        ratio = abs(stated.value) / stated.u95
    correlation = tuple(tuple(float(each) for each in row) for row in budget.correlation)
    return Statement(values, correlation, ratio, tuple(_not_in_u(settings, levels_by)))


def _meaning(settings: ProcedureSettings, words: str) -> str:
    """Say which value it is: with the Earth's rate added to the table's, none of it is in the bias."""
    return words if earth_left_deg_s(settings) is None else words.replace("Earth's rate in it", "without Earth's rate")


@dataclass(frozen=True, slots=True)
class _Circumstances:
    """What temperature and mounting do to all values alike, as far as the bench file knows it."""

    sources: tuple[Source, ...]
    scale_factor_per_k: float
    bias_deg_s_per_k: float

    @classmethod
    def of(cls, settings: ProcedureSettings) -> _Circumstances:
        """Return what is known; the warm-up as far as it is to go when the first window begins."""
        known, sources = settings.station.sources, []
        if known.scale_factor_ppm_k is not None and known.bias_deg_h_k is not None:
            if known.temperature_k is not None:
                sources.append(Source.within(_TEMPERATURE, 0.0, known.temperature_k, "K"))
            if known.warm_up_k is not None:
                left_k = known.warm_up_k * math.exp(-settings.start_up_s / known.warm_up_time_s)
                sources.append(Source.within(_WARM_UP, 0.0, left_k, "K"))
        if known.misalignment_deg is not None:
            tilted = 1.0 - math.cos(math.radians(known.misalignment_deg))
            sources.append(Source.within(_MISALIGNMENT, 0.0, tilted, "1"))
        return cls(tuple(sources), 1e-6 * (known.scale_factor_ppm_k or 0.0), (known.bias_deg_h_k or 0.0) / 3600.0)

    def applied(self, values: Mapping[str, Any], q: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the values of the stated temperature and the gyroscope's own axis."""
        if not self.sources:
            return values
        away_k = q.get(_TEMPERATURE, 0.0) + q.get(_WARM_UP, 0.0)
        mounted, drifted = 1.0 + q.get(_MISALIGNMENT, 0.0), self.bias_deg_s_per_k * away_k
        found = dict(values)
        for name, value in values.items():
            column, _, kind = name.rpartition(".")
            if kind == "k_vc":
                found[name] = value / mounted
            elif kind == "scale_factor":
                found[name] = value * mounted / (1.0 + self.scale_factor_per_k * away_k)
            elif kind == "bias":
                found[name] = value - drifted * values[f"{column}.scale_factor" if column else "scale_factor"]
            elif kind == "bias_deg_s":
                found[name] = (value - drifted) / mounted
        return found


_TEMPERATURE, _WARM_UP, _MISALIGNMENT = "temperature", "warm-up", "misalignment"


def _coverage_factor(result: Result, sources: Mapping[str, Source]) -> float:
    """Return the factor of 95 %: Student's t, or by convolution where sources that are not normal prevail."""
    kinds = {name: source.distribution for name, source in sources.items()}
    odd = math.fsum(line.share for line in result.contributions if kinds[line.source] is not Distribution.NORMAL)
    return convolved_coverage_factor(result, sources.values()) if odd > _NEARLY_NORMAL else result.coverage_factor


def _stated(result: Result, budget: Budget, unit: str, of: str) -> StatedValue:
    sources = {source.name: source for source in budget.sources}
    factor = _coverage_factor(result, sources)
    lines = tuple(
        StatedContribution(
            line.source,
            sources[line.source].distribution.value,
            line.u_source,
            sources[line.source].unit,
            _finite(line.dof),
            line.sensitivity,
            abs(line.u),
            line.share,
        )
        for line in result.contributions
        if line.u
    )
    return StatedValue(
        result.name, result.value, unit, result.u, _finite(result.dof), factor, factor * result.u, of, lines
    )


def _finite(dof: float) -> float | None:
    return dof if math.isfinite(dof) else None


def _not_in_u(settings: ProcedureSettings, levels_by: str) -> Iterable[str]:
    """Say what the uncertainties do not hold."""
    known = settings.station.sources
    if known.meter_gain is None:
        yield "the multimeter's accuracy: its data sheet has none for this range"
    if levels_by == "V_Vc meter" and known.v_vc_gain is None:
        yield "the accuracy of the meter on V_Vc: its data sheet has none for this range"
    if known.table_rate is None:
        yield "the table's accuracy: the bench file does not say it (uncertainty.table_rate_error)"
    if known.bias_instability_deg_h is None:
        yield "flicker: no zero record is known (uncertainty.bias_instability_deg_h)"
    yield "lack of fit: how far the outputs are from a line is in the non-linearity"
    if known.scale_factor_ppm_k is None or known.bias_deg_h_k is None:
        yield "temperature and warm-up: the values are those of the gyroscope as it was in the run"
    else:
        if known.temperature_k is None:
            yield "temperature: the values are those of the gyroscope as it was in the run (uncertainty.temperature_k)"
        if known.warm_up_k is None:
            yield "warm-up: the bench file does not say it (uncertainty.warm_up_k)"
    if known.misalignment_deg is None:
        yield "the angle between the gyroscope's axis and the table's: the values are those about the table's axis"
    if earth_left_deg_s(settings) is None:
        yield "Earth's rate: it is in the bias"
    yield "what the phase of the carrier does to K_Vc, and any change of the gyroscope after the run"
