"""Statement of a calibration: values with their combined uncertainty, its contributions, and its omissions.

Model, contributions and what is left out are described in docs/uncertainty.md. Linear sums over the windows (slopes,
intercepts, the match of step 2) are weights; readings' scatter and flicker go through them with their correlations, and
the rest is a model for :mod:`~vcfbench.analysis.budget`.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Self

from msgspec import Struct, structs

from vcfbench.analysis.budget import Budget, Model, Result, Source, convolved_coverage_factor, evaluate
from vcfbench.instructions.schedule import earth_left_deg_s
from vcfbench.records.stated import BEYOND_SHEETS
from vcfbench.station.settings import ProcedureSettings
from vcfbench.uncertainty.measurand import finite
from vcfbench.uncertainty.phases import PhaseErrors
from vcfbench.uncertainty.windows import Flicker
from vcfbench.values.kinds import kind_of
from vcfbench.values.sources import CARRIER_PHASE, DEMODULATOR_PHASE, MISALIGNMENT, TEMPERATURE, WARM_UP, Errors
from vcfbench.values.value import Measurand, UncertaintyPart, Value


class StatedContribution(UncertaintyPart, frozen=True):
    """Contribution of one source to one value: `sensitivity` times `u_source`, which is in `unit`.

    `share` is that of the variance.
    """

    u_source: float = 0.0
    unit: str = ""
    sensitivity: float = 0.0
    share: float = 0.0

    def in_results(self) -> dict[str, Any]:
        """Return it as the results in ``result.json`` have it."""
        of_source = {"distribution": _KINDS[self.rectangular], "u_source": self.u_source, "unit": self.unit}
        effect = {"sensitivity": self.sensitivity, "u": self.u, "share": self.share}
        return {"source": self.source, **of_source, "dof": self.dof, **effect}


class StatedValue(Measurand, frozen=True):
    """A value of a statement, with its contributions."""

    if TYPE_CHECKING:
        parts: tuple[StatedContribution, ...] = ()

    def in_results(self) -> dict[str, Any]:
        """Return it as the results in ``result.json`` have it."""
        found = {"name": self.name, "value": self.value, "unit": self.unit, "u": self.u, "dof": self.dof}
        covers = {"coverage_factor": self.coverage_factor, "u95": self.u95, "of": self.of}
        return {**found, **covers, "contributions": self.parts, "complete": not self.missing, "missing": self.missing}


class Statement(Struct, frozen=True):
    """All values with an uncertainty, their correlations, and the omissions of the uncertainties."""

    values: tuple[StatedValue, ...]
    correlation: tuple[tuple[float, ...], ...]
    e_n: float | None
    """Difference of the methods' scale factors over its expanded uncertainty, correlations included; above 1 they
    disagree. None where there is one method."""
    not_in_u: tuple[str, ...]
    known_from: tuple[str, ...] = ()
    """Origin of the quantities that the budget takes for known."""
    complete: bool = True
    missing: tuple[str, ...] = ()
    """Contributions that `u` of some of them lacks."""
    bounds: tuple[Value, ...] = ()
    """Values that errors alone may have made: what is known is below what they are. And the scale factor of the range
    that the device is declared to have, which no model of this budget gives."""

    def stated(self) -> Iterator[Value]:
        """Yield the values, of a declared range first, bounds last; those that V_Vc gave are of a kind of their own."""
        yield from (each for each in self.bounds if each.kind == "scale_factor_of_range")
        yield from self.values
        yield from (each for each in self.bounds if each.kind != "scale_factor_of_range")
        if self.e_n is not None:
            yield Value("e_n", self.e_n, kind="e_n", missing=self.missing)

    def value(self, name: str) -> StatedValue:
        """Return one value; KeyError when it has no uncertainty."""
        for each in self.values:
            if each.name == name:
                return each
        raise KeyError(name)


def statement(
    settings: ProcedureSettings,
    sources: Sequence[Source],
    model: Model,
    correlations: Mapping[tuple[str, str], float],
    meanings: Mapping[str, tuple[str, str]],
    *,
    difference: str | None = None,
    levels_by: str = "",
    flicker: Flicker | None = None,
) -> Statement:
    """Return the statement of the values that `model` makes of `sources`, whose `correlations` are by their names.

    `meanings` are unit and meaning of each value; E_n is over the expanded uncertainty of `difference`; V_Vc is known
    by `levels_by`, where there is any; `flicker` is that which the sources hold.
    """
    budget, cannot_be = budget_of(sources, model, correlations)
    # With the Earth's rate added to the table's, none of it is in the bias
    earth = "with Earth's rate", "with Earth's rate" if earth_left_deg_s(settings) is None else "without Earth's rate"
    null = f", from {settings.null_v:g} {settings.station.output_unit} at no rate" if settings.null_v else ""
    if not (settings.rails or settings.station.stream or settings.null_v):  # a device that feeds itself tells no rail
        null = ", from 0 V at no rate (assumed: no gyro.null_v)"
    unit_and_meaning = {
        name: (unit, words.replace(*earth) + null * name.endswith("bias_deg_s"))
        for name, (unit, words) in meanings.items()
    }
    known = settings.station.sources
    values = tuple(
        stated_value(
            *(result, budget, *unit_and_meaning[result.name]),
            (*known.missing(result.name.rpartition(".")[2]), *cannot_be.get(result.name, ())),
        )
        for result in budget.results
    )
    missing = tuple(dict.fromkeys(name for each in values for name in each.missing))
    ratio = None
    if difference is not None and (stated := next(v for v in values if v.name == difference)).u95 > 0.0:
        ratio = abs(stated.value) / stated.u95
    correlation = tuple(tuple(float(each) for each in row) for row in budget.correlation)
    kinds = {result.name.rpartition(".")[2] for result in budget.results}
    not_in_u = [f"MISSING {gap.words}" for gap in known.gaps() if any(map(gap.leaves_out, kinds))]
    not_in_u += [*_OUTSIDE[:2], _RAILS if settings.rails else _OWN_SUPPLY, *_OUTSIDE[2:]]
    if earth_left_deg_s(settings) is None:
        not_in_u.append("Earth's rate: contained in the bias")
    known_from = [f"multimeter: {known.meter_age_days:g} days after calibration ({known.meter_age_from})"]
    if settings.station.stream:
        known_from = [known.meter_age_from]
    if levels_by == "V_Vc meter":
        age_days, whence = known.v_vc_meter_age_days, known.v_vc_meter_age_from
        known_from.append(f"meter on V_Vc: {age_days:g} days after calibration ({whence})")
    if levels_by == "generator" and known.generator_gain is not None and not known.generator_ranges_v:
        known_from.append("ranges of the generator: not known, the worst for each value are assumed")
    if flicker is not None:
        known_from.append(f"flicker: B {flicker.deg_h:.3g} deg/h ({flicker.said})")
    apart = {
        "bias_instability_deg_h",
        "k_vc_drift_ppm_per_year",
        "k_vc_on_the_way_ppm",
    }  # said above; of what rests on an older K_Vc
    known_from += [words for key, words in known.assumed.items() if key not in apart]
    return Statement(values, correlation, ratio, tuple(not_in_u), tuple(known_from), not missing, missing)


def budget_of(
    sources: Sequence[Source], model: Model, correlations: Mapping[tuple[str, str], float]
) -> tuple[Budget, Mapping[str, tuple[str, ...]]]:
    """Return the budget, and by result the sources that cannot be: they cost those that depend on them, no others."""
    words = {each.name: f"{each.name}, which cannot be (u {each.u:.3g})" for each in sources if not each.possible}
    known = [Source(each.name, 0.0, 0.0, each.unit) if each.name in words else each for each in sources]
    pairs = {pair: each for pair, each in correlations.items() if not words.keys() & {*pair}}
    budget, cannot_be = evaluate(known, model, pairs), dict[str, tuple[str, ...]]()
    if words:
        reached = evaluate([structs.replace(each, u=float(each.name in words)) for each in known], model)
        cannot_be = {
            of.name: tuple(words[line.source] for line in of.contributions if line.u) for of in reached.results
        }
    return budget, cannot_be


class Circumstances(Struct, frozen=True):
    """Effects of temperature, mounting and phases on the values, from the bench file."""

    sources: tuple[Source, ...]
    scale_factor_per_k: float
    bias_deg_s_per_k: float
    phases: PhaseErrors

    @classmethod
    def of(cls, settings: ProcedureSettings) -> Self:
        """Return the known effects; the warm-up as far as it is to go when the first window begins."""
        known, sources = settings.station.sources, []
        if known.scale_factor_ppm_k is not None and known.bias_deg_h_k is not None:
            if known.temperature_k:
                sources.append(Source.within(TEMPERATURE, 0.0, known.temperature_k, "K"))
            if known.warm_up_k:
                left_k = known.warm_up_k * math.exp(-settings.start_up_s / known.warm_up_time_s)
                sources.append(Source.within(WARM_UP, 0.0, left_k, "K"))
        if known.misalignment_deg:
            tilted = 1.0 - math.cos(math.radians(known.misalignment_deg))
            sources.append(Source.within(MISALIGNMENT, 0.0, tilted, "1"))
        phases = PhaseErrors.of(known)
        scale_factor_per_k, bias_per_k = 1e-6 * (known.scale_factor_ppm_k or 0.0), (known.bias_deg_h_k or 0.0) / 3600.0
        return cls((*sources, *phases.sources), scale_factor_per_k, bias_per_k, phases)

    def applied(self, values: Mapping[str, Any], q: Errors) -> Mapping[str, Any]:
        """Return the values at the stated temperature and phases, about the gyroscope's own axis (U4)."""
        if not self.sources:
            return values
        away_k = q.get(TEMPERATURE, 0.0) + q.get(WARM_UP, 0.0)
        k_vc, scale_factor = (1.0 + self.phases.effect(value, q) for value in ("k_vc", "scale_factor"))
        mounted = 1.0 + q.get(MISALIGNMENT, 0.0)
        drifted = self.bias_deg_s_per_k * away_k + self.phases.effect("bias_deg_s", q)
        found = dict(values)
        for name, value in values.items():
            column, _, kind = name.rpartition(".")
            if kind == "k_vc":
                found[name] = value / mounted / k_vc
            elif kind == "scale_factor":
                found[name] = value * mounted / (1.0 + self.scale_factor_per_k * away_k) / scale_factor
            elif kind == "bias":
                found[name] = value - drifted * values[f"{column}.scale_factor" if column else "scale_factor"]
            elif kind == "bias_deg_s":
                found[name] = (value - drifted) / mounted
        return found

    def of_a_volt(self, q: Errors) -> Any:
        """Return by how much the sources move what a volt at the modulator does, with the signs that a bias has."""
        per_k = math.copysign(self.scale_factor_per_k, self.bias_deg_s_per_k)
        of, found = self.phases.per_deg, per_k * q.get(TEMPERATURE, 0.0)
        for name in (CARRIER_PHASE, DEMODULATOR_PHASE):
            moved = abs(of["k_vc"][name] + of["scale_factor"].get(name, 0.0))
            found = found + math.copysign(moved, of["bias_deg_s"].get(name, 0.0)) * q.get(name, 0.0)
        return found


_KINDS = ("normal", "rectangular")


def stated_value(result: Result, budget: Budget, unit: str, of: str, missing: tuple[str, ...] = ()) -> StatedValue:
    """Return the stated value of a result of a budget; `missing` are the contributions that it lacks."""
    sources = {source.name: source for source in budget.sources}
    factor = convolved_coverage_factor(result, sources.values())
    lines = tuple(
        StatedContribution(
            *(line.source, abs(line.u), finite(line.dof), None, sources[line.source].rectangular),
            *(line.u_source, sources[line.source].unit, line.sensitivity, line.share),
        )
        for line in result.contributions
        if line.u
    )
    column, _, last = result.name.rpartition(".")
    return StatedValue(
        *(result.name, result.value, unit, result.u, finite(result.dof), factor * result.u),
        kind=(_BY_V_VC.get(last, "") if column == "virtual" else "") or kind_of(result.name, unit),
        of=of,
        parts=lines,
        missing=missing,
    )


_BY_V_VC = {
    "scale_factor": "scale_factor_by_v_vc",
    "bias": "bias_by_v_vc",
    "bias_deg_s": "bias_by_v_vc_deg_s",
    "nonlinearity": "nonlinearity_by_v_vc",
}
_RAILS = "changes of the rails: scale factor and bias hold at the rails of the run (rail_tolerance_v)"
_OWN_SUPPLY = "changes of the device's own supply: not measured"
_OUTSIDE = (
    BEYOND_SHEETS,
    "deviation from the line: stated as non-linearity",
    "turn-on to turn-on and remounting: one power-on, one mounting",
    "acceleration (g), vibration, magnetic fields: as in this run",
    "any change of the gyroscope after the run",
)
