"""K_Vc as a curve: the V_Vc that gives the same output as the table, at rates of both signs; a device's certificate.

At each rate the output is chopped, 0, +, -, -, + and 0, first on the table with the generator off, then at rest with
V_Vc on: what drifts linearly cancels in each block, what is added to the output (bias, the Earth's rate along the axis,
the modulator's leakage) in the difference from the block's own zeros. Both differences are equal but for a rest of a
thousandth, so the multimeter's errors cancel too: it only compares. Rates of both signs keep the modulator's even order
out of K_Vc (one point at +10 deg/s: +0.094 %), and several rates its odd order (the paper's one point: +2 % at 200).
V_Vc is measured; the paper takes the generator's setting, which is good to 2 % and 4 mV.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from datetime import timedelta
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct, structs

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.chopped import BlockNoise, polynomial_through_zero
from vcfbench.analysis.k_vc_curve import (
    Curvature,
    KVcCurve,
    coefficient_weights,
    covariance_of,
    covariance_parts,
    fit_k_vc_curve,
)
from vcfbench.belief.jumps import watched
from vcfbench.devices.certificate import lists_of_omissions
from vcfbench.devices.device import UNSEEN
from vcfbench.devices.k_vc_change import at_temperature, k_vc_sensitivities, sensitivity_table
from vcfbench.devices.k_vc_since import days_until, drift_words
from vcfbench.instructions import v_vc
from vcfbench.instructions.kept import conditions_of
from vcfbench.instructions.procedure import Procedure, Provenance, Watched, roles
from vcfbench.instructions.routines import framed, powered
from vcfbench.instructions.scale_factor import require_as_used, tells_scale_factor
from vcfbench.instructions.schedule import EARTH_DEG_S
from vcfbench.instructions.v_vc import K_VC_UNIT, KnownVvcSettings, measured_levels
from vcfbench.procedures.health.found import beside, health_of, with_output_curve
from vcfbench.procedures.health.plan import EXCHANGE, HEALTH, examined
from vcfbench.procedures.null_comparison import blocks as null_blocks
from vcfbench.procedures.null_comparison.plan import invalid_match_rates, nulled
from vcfbench.records.device_values import Characteristics, Sensitivity
from vcfbench.records.device_values import Measured as Kept
from vcfbench.records.devices import Certificate, CurveShare, KvcCurve, NewEntry
from vcfbench.records.schema import Point
from vcfbench.records.stated import BEYOND_SHEETS
from vcfbench.reports.document import Axis, Figure, Report, Series, Table, Text, heads
from vcfbench.station.bounds import Rate, ranged, said, several
from vcfbench.station.invalid_value import InvalidValue
from vcfbench.steps import Plan, Settle
from vcfbench.steps.measured import Measured
from vcfbench.typed import typed
from vcfbench.uncertainty.known_levels import known_levels
from vcfbench.uncertainty.measurand import as_kept, budget_table, finite, measurand, quotient, said_of
from vcfbench.uncertainty.phases import PhaseErrors
from vcfbench.values.sources import (
    METER_GAIN,
    MISALIGNMENT,
    RESOLUTION,
    TABLE_RATE,
    TILT,
    V_VC_GAIN,
    V_VC_NOISE,
    V_VC_OFFSET,
)
from vcfbench.values.value import Measurand, UncertaintyPart


class KVcSettings(KnownVvcSettings, frozen=True, kw_only=True):
    """Settings of the calibration of K_Vc, in addition to those of all procedures."""

    match_rates_deg_s: Annotated[
        tuple[Rate, ...], several(3, 100, "rates at which V_Vc is matched, each with both signs")
    ] = (10.0, 20.0, 50.0, 100.0, 200.0)
    match_iterations: Annotated[int, ranged(2, 100, "most settings of V_Vc that a search takes")] = 5
    curve_order: Annotated[int, ranged(3, 7, "order of the curve")] = 3
    validity_days: Annotated[float, Meta(gt=0.0, le=36_500.0, description="validity of the certificate, days")] = 365.0
    wanted_u95_ppm: Annotated[
        float, Meta(gt=0.0, le=1e6, description="U95 of K_Vc at which the device should come back to a table, ppm")
    ] = 500.0
    health: Annotated[bool, said(HEALTH, option=True)] = True
    exchange: Annotated[bool, said(EXCHANGE)] = True
    axis_tilt_deg: Annotated[float, ranged(0.0, 90.0, "largest tilt of the table's axis")] = 0.5

    @property
    def early_look(self) -> tuple[str, ...]:
        """The table, where the bench file expects a scale factor."""
        return ("rate_table",) if tells_scale_factor(self) else ()

    def require_known_answer(self, slope: float, within: float, *, by_v_vc: bool) -> None:
        """See that the output answers as the bench file expects."""
        require_as_used(self, slope, within, by_v_vc=by_v_vc)

    @property
    def fastest_deg_s(self) -> float:
        return max(map(abs, self.match_rates_deg_s))

    @property
    def magnitudes_deg_s(self) -> tuple[float, ...]:
        """The rates without sign, each once, rising: the search goes on from the result at the rate before."""
        return tuple(sorted({abs(rate) for rate in self.match_rates_deg_s}))

    def contradictions(self) -> Iterator[InvalidValue]:
        yield from super().contradictions()
        yield from invalid_match_rates(self, self.match_rates_deg_s, self.curve_order)
        largest_v = self.fastest_deg_s / max(abs(self.k_vc_guess_deg_s_per_v), 1e-9)
        yield from self.beyond_range(largest_v, self.fastest_deg_s)


TABLE, SEARCH, DRIVEN = 1, 2, 3
"""The steps, as in its points: the table's blocks, the search for V_Vc, the blocks of V_Vc."""


class MatchedPair(Struct, frozen=True):
    """A rate of the table, and the V_Vc with the same zero-subtracted output."""

    rate_deg_s: float
    v_vc_v: float
    u_v_vc_v: float
    """Standard uncertainty of that V_Vc from noise and flicker alone, V."""
    residual_deg_s: float
    """Rate less curve."""
    left_v: float
    """Difference left between the two outputs, V; it is interpolated."""


class KVcResult(Struct, frozen=True, kw_only=True):
    """Result of the calibration of K_Vc."""

    k_vc: Measurand
    """Rate that one volt of V_Vc stands for, of small signals: k1 of the curve, (deg/s)/V."""
    curve: KVcCurve
    """The rate against V_Vc; k0 holds the offsets of generator and meter at a setting of 0 V."""
    curve_parts: Mapping[str, tuple[tuple[float, ...], ...]]
    """Contributions of each source to the covariance of the curve."""
    curvature: Curvature
    """The modulator's curve."""
    pairs: tuple[MatchedPair, ...]
    scale_factor: Measurand
    """On the table, of small signals, V/(deg/s)."""
    bias: Measurand
    """Output at rest, generator off, V; the Earth's rate is in it."""
    bias_deg_s: Measurand
    """The same as a rate."""
    noise: BlockNoise
    characteristics: Characteristics
    """Known characteristics that K_Vc depends on."""
    sensitivities: tuple[Sensitivity, ...]
    """By how much."""
    days_to_wanted_u95: float | None
    """Days until U95 of K_Vc reaches the wanted value; None where it is beyond that already, or never will be."""
    v_vc_by: str
    """Source of the V_Vc values."""
    holds_not: tuple[str, ...]
    """Sources that are in no uncertainty, with the reasons."""


_HOLDS_NOT = (
    BEYOND_SHEETS,
    "gain and offset of the multimeter, for K_Vc: it compares two equal outputs, so they cancel",
    "the Earth's rate about the table's axis: it is in both zeros; the effect of a tilted axis is in the budget",
    "remounting, turn-on to turn-on, acceleration (g), vibration, magnetic fields, the rails: as in this run",
    "later changes of temperature: the curve holds at temperature_c, its temperature coefficient is stated apart",
    "deviation from the curve: reported apart",
)


def _holds_not(settings: KVcSettings) -> Iterator[str]:
    """Yield what no uncertainty of K_Vc contains."""
    for each in _HOLDS_NOT:
        yield each if settings.rails else each.replace("the rails", "its own supply")
    for gap in settings.station.sources.gaps():
        yield f"MISSING {gap.words}"


_FAR_DAYS = 365_000.0
"""No certificate dates a U95 later than that: a thousand years."""

READ_TABLE, READ_DRIVEN = "readings on the table", "readings with V_Vc"


def k_vc_results(settings: KVcSettings, points: Measured) -> KVcResult:
    """Return K_Vc, its curve and its uncertainty from the blocks."""
    rate, table_v, driven_v, levels_v, u_v_vc_v, of_blocks = _levels(settings, points)
    left_v = driven_v - table_v
    matched_v, per_v = null_blocks.nulled_levels(levels_v[1:], float(levels_v[0]), driven_v, left_v)
    noise = null_blocks.block_covariance(of_blocks, rate.size // 2, settings.cycles)
    slopes, of_slopes, _ = polynomial_through_zero(rate, table_v, noise, 3)
    per_deg_s = np.polynomial.polynomial.polyval(rate, null_blocks.derivative_of(slopes))
    in_rate = noise / np.outer(per_deg_s, per_deg_s)
    phases = PhaseErrors.of(settings.station.sources)
    # The largest residual of the Earth's horizontal rate in a zero that is taken at one heading
    u_earth_deg_s = EARTH_DEG_S * math.sin(math.radians(settings.axis_tilt_deg)) / math.sqrt(2.0)
    of_rate = {
        READ_TABLE: in_rate,
        READ_DRIVEN: in_rate,
        TABLE_RATE: covariance_of(rate, 0.0, v_vc.table_rate_error(settings)),
        MISALIGNMENT: covariance_of(rate, 0.0, v_vc.alignment_error(settings)),
        TILT: covariance_of(rate, 0.0, 0.0, u_earth_deg_s),
        **{name: covariance_of(rate, 0.0, u) for name, u in phases.u("k_vc").items()},
    }
    error = v_vc.v_vc_error(settings)
    of_v_vc: dict[str, Floats] = {
        V_VC_GAIN: covariance_of(matched_v, 0.0, error.u_gain),
        V_VC_OFFSET: covariance_of(matched_v, 0.0, 0.0, error.u_offset_v),
        V_VC_NOISE: covariance_of(matched_v, u_v_vc_v),
    }
    curve = fit_k_vc_curve(rate, matched_v, sum(of_rate.values()), sum(of_v_vc.values()), settings.curve_order)
    parts = covariance_parts(curve, matched_v, of_rate, of_v_vc)
    if settings.v_vc_role is None:
        curve, parts = _as_set(settings, curve, matched_v, of_rate, of_v_vc)
    u_matched = np.sqrt(2.0 * np.diag(noise)) / np.abs(per_v)
    scale_factor = _scale_factor(settings, of_blocks, slopes, of_slopes, len(points))
    bias = null_blocks.bias_at_rest(settings, points, TABLE, of_blocks, scale_factor.value)
    pairs = zip(rate, matched_v, u_matched, curve.residuals_deg_s, left_v, strict=True)
    ranges = parts.keys() - {*of_rate, *of_v_vc, RESOLUTION}  # errors within the limits of each
    of_k_vc = [
        UncertaintyPart(
            *(name, math.sqrt(max(0.0, float(part[1, 1])))),
            finite(of_blocks.dof) if name in {READ_TABLE, READ_DRIVEN} else None,
            error.owner if name in {V_VC_GAIN, V_VC_OFFSET, *ranges} else None,
            rectangular=name in ranges,
        )
        for name, part in parts.items()
    ]
    today = [structs.replace(part, u=1e6 * part.u / curve.k_vc) for part in of_k_vc]
    days = days_until(settings.wanted_u95_ppm, today, settings.station.sources.k_vc_drift_ppm_per_year)
    seen = with_output_curve(_characteristics(settings, points, curve.curvature()), slopes, of_slopes)
    return KVcResult(
        k_vc=measurand(curve.k_vc, K_VC_UNIT, of_k_vc, settings.station.sources.missing("k_vc")),
        characteristics=seen,
        sensitivities=k_vc_sensitivities(seen),
        days_to_wanted_u95=None if days is None or math.isinf(days) else days,
        curve=curve,
        curve_parts={name: tuple(map(tuple, part.tolist())) for name, part in parts.items()},
        curvature=curve.curvature(),
        pairs=tuple(MatchedPair(*map(float, pair)) for pair in pairs),
        scale_factor=scale_factor,
        bias=bias,
        bias_deg_s=quotient(bias, scale_factor, "deg/s", "bias_at_rest_deg_s", less=settings.null_v),
        noise=of_blocks,
        v_vc_by=_V_VC_BY[settings.v_vc_role].format(error.name),
        holds_not=tuple(_holds_not(settings)),
    )


def _as_set(
    settings: KVcSettings, curve: KVcCurve, v_vc_v: Floats, of_rate: Mapping[str, Floats], of_v_vc: Mapping[str, Floats]
) -> tuple[KVcCurve, dict[str, Floats]]:
    """Return curve and parts where V_Vc is believed as it was set: a generator has ranges, each with its own errors.

    The fit stays as it is; the errors of the ranges that make K_Vc least certain go through it, unless they are known.
    """
    derivative = np.polynomial.polynomial.polyder(np.array(curve.coefficients))
    slope = np.polynomial.polynomial.polyval(v_vc_v, derivative)
    fitted = sum(of_rate.values()) + sum(of_v_vc.values()) * np.outer(slope, slope)
    making = coefficient_weights(curve, v_vc_v, fitted)
    per_v, known = making * slope, known_levels((), settings.station.sources)
    own = per_v * np.array([known.u_besides_v(volts) for volts in v_vc_v])
    parts = {name: making @ part @ making.T for name, part in of_rate.items()}
    parts[RESOLUTION] = own @ own.T
    for kind, where, effect, range_error in known.shared(v_vc_v, per_v, 1):
        name = V_VC_GAIN if kind == "gain" else V_VC_OFFSET
        parts[f"{name}, {where}"] = range_error.u**2 * np.outer(effect, effect)
    together = np.sum(list(parts.values()), axis=0)
    return structs.replace(curve, covariance=tuple(map(tuple, together.tolist()))), parts


def _characteristics(settings: KVcSettings, points: Measured, curved: Curvature) -> Characteristics:
    """Return the characteristics of the device by earlier runs, with those of this one."""
    near = (settings.station.sources.temperature_k or 0.0) / math.sqrt(3.0)
    at_c = None if settings.temperature_c is None else Kept(value=settings.temperature_c, u=near)
    u_rail_v = settings.rail_tolerance_v / math.sqrt(3.0)
    positive, negative = (
        (Kept(value=each, u=u_rail_v) for each in settings.rails_v) if settings.rails_v else (None, None)
    )
    known = at_temperature(typed(settings.station.characteristics, Characteristics), at_c)
    return structs.replace(
        beside(health_of(settings, points), known),
        modulator_second_per_v=Kept(value=curved.second_per_v, u=curved.u_second_per_v),
        modulator_third_per_v2=Kept(value=curved.third_per_v2, u=curved.u_third_per_v2),
        positive_rail_v=positive,
        negative_rail_v=negative,
    )


_V_VC_BY = {None: "the setting of the {}", "v_vc_meter": "the {}", "multimeter": "the {}, its leads moved by hand"}
"""Source of the V_Vc values by the role of the meter on V_Vc."""


def _scale_factor(
    settings: KVcSettings, noise: BlockNoise, slopes: Floats, of_slopes: Floats, windows: int
) -> Measurand:
    """Return the slope at rate zero of a cubic through the outputs on the table."""
    slope, meter = float(slopes[0]), v_vc.meter_error(settings, "multimeter")
    phases = PhaseErrors.of(settings.station.sources)
    parts = [
        UncertaintyPart(READ_TABLE, math.sqrt(of_slopes[0, 0]), finite(noise.dof)),
        UncertaintyPart(METER_GAIN, abs(slope) * meter.u_gain, None, meter.owner),
        UncertaintyPart(TABLE_RATE, abs(slope) * v_vc.table_rate_error(settings)),
        UncertaintyPart(MISALIGNMENT, abs(slope) * v_vc.alignment_error(settings)),
        *(UncertaintyPart(name, abs(slope) * u) for name, u in v_vc.temperature_errors(settings, windows).items()),
        *(UncertaintyPart(name, abs(slope) * u) for name, u in phases.u("scale_factor").items()),
    ]
    return measurand(slope, "V/(deg/s)", parts, settings.station.sources.missing("scale_factor"), "scale_factor_small")


def _levels(settings: KVcSettings, points: Sequence[Point]) -> tuple[Floats, Floats, Floats, Floats, float, BlockNoise]:
    """Return rates (+r1, -r1, +r2, ...), outputs on the table and driven, V_Vc (at rest first), its u, and noise."""
    cycles, magnitudes = settings.cycles, settings.magnitudes_deg_s
    _, of_table, table_v = null_blocks.mean_differences(points, TABLE, cycles, len(magnitudes))
    driven, of_driven, driven_v = null_blocks.mean_differences(points, DRIVEN, cycles, len(magnitudes))
    levels_v, u_v_vc_v = null_blocks.levels_of(settings, points, driven, magnitudes)
    rate = np.array([sign * rate for rate in magnitudes for sign in (1.0, -1.0)])
    noise = null_blocks.noise_of(settings, [*of_table, *of_driven], points)
    return rate, table_v, driven_v, levels_v, u_v_vc_v, noise


def certificate(settings: KVcSettings, results: KVcResult, made: Provenance) -> NewEntry | None:
    """Return the certificate of the device that was named."""
    if settings.dut is None:
        return None
    curve, days, own = results.curve, results.days_to_wanted_u95, {part.source: part for part in results.k_vc.parts}
    if days is None and 1e6 * results.k_vc.u95 >= settings.wanted_u95_ppm * abs(results.k_vc.value):
        days = 0.0
    shares = [
        CurveShare(source=name, of=own[name].of, dof=own[name].dof, covariance=part)
        for name, part in results.curve_parts.items()
    ]
    known = Certificate(
        serial=settings.dut,
        issued=made.finished,
        valid_until=made.finished + timedelta(days=settings.validity_days),
        procedure="kvc",
        k_vc=KvcCurve(
            coefficients=curve.coefficients,
            covariance=curve.covariance,
            v_vc_min_v=curve.v_vc_low_v,
            v_vc_max_v=curve.v_vc_high_v,
            shares=tuple(shares),
            lack_of_fit_deg_s=curve.lack_of_fit_deg_s,
            missing=results.k_vc.missing,
        ),
        conditions=conditions_of(settings, made, settings.temperature_c),
        scale_factor_v_per_deg_s=as_kept(results.scale_factor),
        bias_v=as_kept(results.bias),
        unseen=UNSEEN,
        characteristics=results.characteristics,
        sensitivities=results.sensitivities,
        k_vc_drift_ppm_per_year=settings.station.sources.k_vc_drift_ppm_per_year,
        wanted_u95_ppm=settings.wanted_u95_ppm,
        u95_until=None if days is None or days > _FAR_DAYS else made.finished + timedelta(days=days),
        remarks=(f"V_Vc is taken from {results.v_vc_by}", *results.holds_not),
    )
    return NewEntry(known, settings.store.root)


def k_vc_report(settings: KVcSettings, _points: Sequence[Point], results: KVcResult) -> Report:
    """Report the pairs, the curve, the budget of K_Vc, and the sources that are in no uncertainty."""
    columns = heads("rate [deg/s]:g | V_Vc [V]:.6f | u [V]:.1e | rate - curve [deg/s]:.1e | mismatch [V]:.1e")
    rows = [structs.astuple(pair) for pair in results.pairs]
    curve, curved = results.curve, results.curvature
    fits = f"chi-square {curve.chi_square:.1f}, {curve.dof} degrees of freedom, p = {curve.lack_of_fit_p or 0.0:.2g}"
    second = f"{curved.second_per_v:.5g} (u {curved.u_second_per_v:.1g})"
    third = f"{curved.third_per_v2:.5g} (u {curved.u_third_per_v2:.1g})"
    # The time until U95 of K_Vc reaches the wanted value
    known, days = settings.station.sources, results.days_to_wanted_u95
    wanted = f"U95 of {settings.wanted_u95_ppm:g} ppm"
    interval = f"K_Vc keeps its U95 ({drift_words(known)})"
    if days is not None:
        interval = f"K_Vc reaches a {wanted} after {days:.0f} days ({drift_words(known)})"
    elif known.k_vc_drift_ppm_per_year:
        interval = f"K_Vc already exceeds a {wanted} ({drift_words(known)})"
    words = [
        said_of("K_Vc, small signals", results.k_vc),
        "curve: " + ", ".join(f"k{i} = {k:.8g}" for i, k in enumerate(curve.coefficients)) + " (deg/s)/V^i",
        f"  deviation from the curve {curve.lack_of_fit_deg_s:.1e} deg/s rms ({fits}); in no uncertainty",
        f"modulator: V + {second} V^2 + {third} V^3",
        said_of("scale factor of small signals", results.scale_factor),
        said_of("output at rest", results.bias),
        f"V_Vc is taken from {results.v_vc_by}",
        interval,
        *v_vc.known_words(settings, "table_rate_error", "misalignment_deg"),
    ]
    rate = Axis("rate", "deg/s")
    left = Series("rate - curve", [p.rate_deg_s for p in results.pairs], [p.residual_deg_s for p in results.pairs])
    return Report(
        [
            Table(columns, rows, "V_Vc that gives the same output change as the table"),
            Text("\n".join(words)),
            budget_table("K_Vc", results.k_vc),
            sensitivity_table([e for e in results.sensitivities if settings.rails or e.quantity != "rails_v"]),
            Figure("Deviation from the curve", rate, Axis("rate - curve", "deg/s"), [left]),
            *lists_of_omissions(results.holds_not, UNSEEN),
        ]
    )


@framed(powered, watched)
def k_vc(settings: KVcSettings) -> Plan:
    """Find the V_Vc of each rate by a null comparison with the table."""
    yield from v_vc.ready_v_vc_meter(settings, settings.v_vc_range_v)
    yield Settle(settings.settle_s, "gyro settles, table at rest")
    often, steps = (settings.cycles, settings.match_iterations), (TABLE, SEARCH, DRIVEN)
    _, _, levels_v = yield from nulled(settings, settings.magnitudes_deg_s, *often, steps)
    yield from examined(settings, None, looked_for=settings.health, exchange=settings.exchange)
    yield from measured_levels(settings, (0.0, *levels_v.values()))


KVC = Procedure(
    name="kvc",
    method=(
        "The table turns the gyroscope at rates of both signs; at each, V_Vc is adjusted with the table at rest until "
        "the output, less its zero, is the same (a null comparison), and V_Vc is measured. Rate over V_Vc, as a curve "
        "with its uncertainty, is the certificate of the device."
    ),
    settings=KVcSettings,
    watched=Watched(),
    plan=k_vc,
    results=k_vc_results,
    report=k_vc_report,
    entry=certificate,
    uses=roles("power", "oscilloscope", "v_vc_meter"),
)
