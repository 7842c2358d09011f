"""A self-calibration from its points: scale factor, bias, non-linearity, changes since the certificate.

Each result is a function of the curve's coefficients, of V_Vc and of the outputs; its uncertainty is that of those
through the function's derivatives. Two results of one device share much: the certificate's curve, the meters. What both
share has the same effect on both, so it cancels in their difference; a part says with `of` whose it is.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Annotated

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.chopped import BlockNoise, polynomial_through_zero
from vcfbench.analysis.column import CalibrationColumn
from vcfbench.analysis.model_fit import derivatives
from vcfbench.analysis.scale_factor import characterise
from vcfbench.devices.certificate import (
    Drift,
    Here,
    curve_parts,
    drift_of,
    drift_parts,
    lists_of_omissions,
)
from vcfbench.devices.device import KnownDeviceSettings
from vcfbench.devices.k_vc_since import K_VC_DRIFT, K_VC_ON_THE_WAY, k_vc_since, with_temperature
from vcfbench.errors import ConfigError
from vcfbench.instructions import v_vc
from vcfbench.instructions.kept import conditions_of
from vcfbench.instructions.procedure import Provenance
from vcfbench.procedures.health import check as health_check
from vcfbench.procedures.health.explained import explained_parts
from vcfbench.procedures.health.found import beside, health_of, unchanged
from vcfbench.procedures.health.plan import EXCHANGE, HEALTH
from vcfbench.procedures.null_comparison import blocks as null_blocks
from vcfbench.procedures.self_calibration import shape
from vcfbench.records.device_values import Characteristics
from vcfbench.records.device_values import Measured as Kept
from vcfbench.records.devices import NewEntry, SelfCalibration
from vcfbench.records.schema import Point
from vcfbench.records.stated import BEYOND_SHEETS
from vcfbench.reports.document import Axis, Figure, Report, Series, Table, Text, heads
from vcfbench.station.bounds import Rate, said, several
from vcfbench.station.invalid_value import InvalidValue
from vcfbench.steps.measured import Foreseen, Measured
from vcfbench.uncertainty.columns import combined
from vcfbench.uncertainty.known_levels import known_levels
from vcfbench.uncertainty.measurand import as_kept, budget_table, finite, measurand, quotient, said_of
from vcfbench.values.sources import METER_GAIN, RESOLUTION, V_VC_GAIN, V_VC_NOISE, V_VC_OFFSET
from vcfbench.values.value import Measurand, UncertaintyPart, Unstated, Value


class SelfCalibrationSettings(KnownDeviceSettings, frozen=True, kw_only=True):
    """Settings of a self-calibration, in addition to those of all procedures."""

    virtual_rates_deg_s: Annotated[tuple[Rate, ...], several(2, 100, "rates that V_Vc stands for, with both signs")] = (
        *(10.0, 20.0, 50.0, 100.0, 200.0),
    )

    health: Annotated[bool, said(HEALTH, option=True)] = True
    exchange: Annotated[bool, said(EXCHANGE)] = True

    @property
    def magnitudes_deg_s(self) -> tuple[float, ...]:
        """The rates without sign, each once, rising."""
        return tuple(sorted({abs(rate) for rate in self.virtual_rates_deg_s}))

    def contradictions(self) -> Iterator[InvalidValue]:
        yield from super().contradictions()
        if self.magnitudes_deg_s[0] == 0.0 or len(self.magnitudes_deg_s) < 2:
            expected = "at least two rates of different size, without 0"
            yield InvalidValue("virtual_rates_deg_s", expected, list(self.virtual_rates_deg_s))


AT_REST, DRIVEN = 1, 2
"""The steps, as in its points: generator off, and the blocks of V_Vc."""

ORDER = 3
"""Order of the polynomial whose slope at rest is the scale factor of small signals."""

_HOLDS_NOT = (
    BEYOND_SHEETS,
    "changes of K_Vc itself: see the changes that only a rate table shows",
    "drift of a meter between two entries: its error is assumed to be the same in both",
    "deviation from the certificate's curve and from the line of this run",
)


class Level(Struct, frozen=True):
    """One level of V_Vc: its rate, and the output with its zero subtracted."""

    rate_deg_s: float
    v_vc_v: float
    output_v: float


class SelfCalibrationResult(Struct, frozen=True, kw_only=True):
    """Result of a self-calibration."""

    scale_factor: Measurand
    """Scale factor of small signals: the slope of a cubic at rate 0 of the certificate's curve, V/(deg/s)."""
    line: Measurand
    """Slope of the least-squares line through all levels and their zero, V/(deg/s)."""
    bias: Measurand
    """Output at rest, generator off, V."""
    bias_deg_s: Measurand
    """The same as a rate."""
    nonlinearity: Measurand
    """Largest residual about the line over the span, ppm (max_span)."""
    virtual: CalibrationColumn
    """The column of outputs against the rates that V_Vc stood for, zeros added again."""
    levels: tuple[Level, ...]
    noise: BlockNoise
    k_vc_from: str
    v_vc_by: str
    health: health_check.HealthCheck | None
    """Changes of the characteristics that K_Vc depends on; None where they were not measured, now or then."""
    characteristics: Characteristics | None
    """Measured characteristics."""
    modulator: tuple[float, float] | None
    """Second (1/V) and third order (1/V^2) of the modulator, where its shape has changed; None: it is as it was."""
    since: tuple[str, ...]
    """Assumed changes of K_Vc since its certificate."""
    unseen: tuple[str, ...]
    """Errors that the method cannot see."""
    holds_not: tuple[str, ...]
    drift: Drift | None
    """Since the certificate; None where nothing earlier is known."""

    @property
    def by_v_vc(self) -> tuple[Measurand, ...]:
        """Its values under their names."""
        return (
            self.scale_factor.called("scale_factor", "scale_factor_small"),
            self.line.called("line", "scale_factor_by_v_vc"),
            self.bias.called("bias", "bias_at_rest"),
            self.bias_deg_s.called("bias_deg_s", "bias_at_rest_deg_s"),
            self.nonlinearity.called("nonlinearity", "nonlinearity_by_v_vc"),
        )

    def stated(self) -> Iterator[Value]:
        """Yield its values, the drift last."""
        yield from self.by_v_vc
        if self.drift is not None:
            yield from self.drift.stated()


class NotStated(Struct, frozen=True, kw_only=True):
    """A self-calibration without a value of K_Vc: the bias, and the changes of its characteristics."""

    bias: Measurand
    """Output at rest, generator off, V."""
    health: health_check.HealthCheck
    k_vc_from: str

    def refusal(self) -> str:
        """Return the reason why no value of K_Vc is stated."""
        return f"K_Vc of {self.k_vc_from} does not hold any more: {'; '.join(self.health.refused)}"

    def stated(self) -> Iterator[Value | Unstated]:
        """Yield the bias: values by K_Vc could not be found."""
        yield self.bias.called("bias", "bias_at_rest")
        kinds = ("scale_factor_small", "bias_at_rest_deg_s", "nonlinearity_by_v_vc", "drift_ppm", "e_n")
        yield from (Unstated(kind, kind) for kind in kinds)


class _Measured(Struct, frozen=True):
    """The levels: V_Vc with that of the zero first, outputs with their zeros subtracted."""

    v_vc_v: Floats
    output_v: Floats
    zero_v: float
    u_v_vc_v: float
    noise: BlockNoise
    covariance_v2: Floats
    windows: int
    """Number of windows of the whole run."""
    output_orders: Floats | None = None
    """Second and third order of the output against the rate, where the modulator's are found from them; else None."""

    def rates(self, coefficients: Floats, v_vc_v: Floats) -> Floats:
        """Return the rates of the levels, from that of the zero on."""
        powers = np.polynomial.polynomial.polyval(v_vc_v, coefficients)
        return np.asarray(powers[1:] - powers[0])

    def curve(self, coefficients: Floats, v_vc_v: Floats, output_v: Floats) -> Floats:
        """Return the curve of K_Vc with the present modulator."""
        if self.output_orders is None:
            return coefficients
        return shape.bent(coefficients, v_vc_v, output_v, self.covariance_v2, self.output_orders)

    def estimates(self, coefficients: Floats, v_vc_v: Floats, output_v: Floats) -> Floats:
        """Return scale factor, slope of the line (V/(deg/s)) and non-linearity (ppm).

        The output is curved, and its zero is where this generator has its own: the slope is that at rate 0 of the
        certificate's curve, where the table's is.
        """
        coefficients = self.curve(coefficients, v_vc_v, output_v)
        rate = self.rates(coefficients, v_vc_v)
        slopes, _, _ = polynomial_through_zero(rate, output_v, self.covariance_v2, ORDER)
        zero_deg_s = np.polynomial.polynomial.polyval(v_vc_v[0], coefficients)
        slope = np.polynomial.polynomial.polyval(-zero_deg_s, null_blocks.derivative_of(slopes))
        x, y = np.array([0.0, *rate]), np.array([0.0, *output_v])
        line = np.polynomial.polynomial.polyfit(x, y, 1)
        left = np.abs(y - np.polynomial.polynomial.polyval(x, line)).max()
        return np.array([slope, line[1], 1e6 * left / abs(line[1] * np.ptp(x))])


def self_calibration_results(settings: SelfCalibrationSettings, points: Measured) -> SelfCalibrationResult | NotStated:
    """Return scale factor, bias, non-linearity and drift from the levels; why not, where K_Vc cannot be stated."""
    seen, known = _measured(settings, points), settings.known
    characteristics, check = _health(settings, points)
    if check is not None and check.refused:
        roughly = float(seen.estimates(np.array(known.k_vc.coefficients), seen.v_vc_v, seen.output_v)[0])
        bias = null_blocks.bias_at_rest(settings, points, AT_REST, seen.noise, roughly)
        return NotStated(bias=bias, health=check, k_vc_from=known.source)
    factor, since, said = k_vc_since(settings)
    if check is not None:
        warmth_seen = any(each.cause in health_check.TEMPERATURES for each in check.causes)
        factor, since, said = k_vc_since(settings, (check.ppm, check.u_ppm), warmth_seen=warmth_seen)
    coefficients = np.array(known.k_vc.coefficients) * factor
    seen = _with_shape(settings, seen, coefficients)
    values = seen.estimates(coefficients, seen.v_vc_v, seen.output_v)
    settings.require_known(float(values[0]))
    measured = () if check is None else check.measured
    settings = health_check.at_phases(settings, measured)
    moved = [*since, *health_check.by_phases(settings), *health_check.unmeasured(settings, measured)]
    parts = _parts(settings, seen, coefficients, moved)
    without = health_check.missing_of(settings)
    units, missing = ("V/(deg/s)", "V/(deg/s)", "ppm"), {"V/(deg/s)": without, "ppm": ()}
    scale_factor, line, nonlinearity = (
        measurand(float(value), unit, of_value, missing[unit])
        for value, unit, of_value in zip(values, units, parts, strict=True)
    )
    curve = seen.curve(coefficients, seen.v_vc_v, seen.output_v)
    rates = seen.rates(curve, seen.v_vc_v)
    bias = null_blocks.bias_at_rest(settings, points, AT_REST, seen.noise, scale_factor.value)
    # The column has the combined uncertainties of its slope and of the bias at rest
    u_v = math.sqrt(float(seen.covariance_v2[0, 0]))
    column = characterise([*rates, 0.0], [*(seen.zero_v + seen.output_v), seen.zero_v], u_v).column(settings.null_v)
    return SelfCalibrationResult(
        scale_factor=scale_factor,
        line=line,
        bias=bias,
        health=check,
        characteristics=characteristics,
        modulator=None if seen.output_orders is None else (float(curve[2] / curve[1]), float(curve[3] / curve[1])),
        bias_deg_s=quotient(bias, scale_factor, "deg/s", less=settings.null_v),
        nonlinearity=nonlinearity,
        virtual=replace(column, scale_factor=combined(column.scale_factor, line), bias=combined(column.bias, bias)),
        levels=tuple(Level(*map(float, each)) for each in zip(rates, seen.v_vc_v[1:], seen.output_v, strict=True)),
        noise=seen.noise,
        k_vc_from=known.source,
        v_vc_by=v_vc.v_vc_error(settings).name,
        unseen=health_check.STILL_UNSEEN if health_check.CARRIER_PHASE in measured else known.unseen,
        since=said,
        holds_not=(*known.holds_not, *_HOLDS_NOT, *health_check.gaps_of(settings)),
        drift=drift_of(scale_factor, known, settings.acceptance, Here.of(settings)),
    )


def _health(
    settings: SelfCalibrationSettings, points: Measured
) -> tuple[Characteristics | None, health_check.HealthCheck | None]:
    """Return the measured characteristics that K_Vc depends on, and their changes since the certificate."""
    then = settings.known.characteristics
    health = health_of(settings, points, then)
    if not health:
        return None, None
    if isinstance(points, Foreseen) and then is not None:
        health = unchanged(health, then)
    near_k = (settings.station.sources.temperature_k or 0.0) / math.sqrt(3.0)
    at_c = None if settings.temperature_c is None else Kept(value=settings.temperature_c, u=near_k)
    now = beside(health, Characteristics(temperature_c=at_c))
    return now, None if then is None else health_check.checked(then, now)


def _with_shape(settings: SelfCalibrationSettings, seen: _Measured, coefficients: Floats) -> _Measured:
    """Return the levels such that the modulator's orders are found anew, where the certificate's do not hold."""
    then = settings.known.characteristics
    output = shape.output_orders(then)
    if not settings.health or then is None or output is None or settings.v_vc_role is None:
        return seen  # what a generator was set to has steps of its own, which look like a shape
    orders, covariance = shape.orders_of(coefficients, seen.v_vc_v, seen.output_v, seen.covariance_v2)
    if settings.known.reference is not None:  # the amplifier bends by its volts, of which a rate makes another number
        slope = float(seen.estimates(coefficients, seen.v_vc_v, seen.output_v)[0])
        gain = slope / settings.known.reference.scale_factor_v_per_deg_s.value
        output = output * np.array([gain, gain**2])
    return replace(seen, output_orders=output) if shape.has_changed(orders, covariance, output, then) else seen


def _measured(settings: SelfCalibrationSettings, points: Sequence[Point]) -> _Measured:
    magnitudes = settings.magnitudes_deg_s
    driven, blocks, output_v = null_blocks.mean_differences(points, DRIVEN, settings.cycles, len(magnitudes))
    levels_v, u_v_vc_v = null_blocks.levels_of(settings, points, driven, magnitudes)
    # See that no V_Vc is beyond the curve by more than a generator may be off
    curve = settings.known.k_vc
    margin_v = 0.05 * (curve.v_vc_max_v - curve.v_vc_min_v) / 2.0
    for level_v in levels_v:
        if not curve.v_vc_min_v - margin_v <= level_v <= curve.v_vc_max_v + margin_v:
            raise ConfigError(
                f"V_Vc of {level_v:g} V: K_Vc is known from {curve.v_vc_min_v:g} to {curve.v_vc_max_v:g} V only"
            )
    noise = null_blocks.noise_of(settings, blocks, points)
    return _Measured(
        levels_v,
        output_v,
        math.fsum(each.zero_v for each in blocks) / len(blocks),
        u_v_vc_v,
        noise,
        null_blocks.block_covariance(noise, len(magnitudes), settings.cycles),
        len(points),
    )


def _parts(
    settings: SelfCalibrationSettings, seen: _Measured, k: Floats, since: Sequence[UncertaintyPart]
) -> list[list[UncertaintyPart]]:
    """Return the contributions to each of the three estimates."""
    v, y = seen.v_vc_v, seen.output_v
    by_output = derivatives(lambda at: seen.estimates(k, v, at), y, np.full(y.size, 1e-4 * np.abs(y).max()))
    by_v = derivatives(lambda at: seen.estimates(k, at, y), v, np.full(v.size, 1e-5 * np.abs(v).max()))
    sizes = 1e-5 * abs(k[1]) * np.abs(v).max() ** (1.0 - np.arange(k.size))
    by_k = derivatives(lambda at: seen.estimates(at, v, y), k, sizes)
    meter, error = v_vc.meter_error(settings, "multimeter"), v_vc.v_vc_error(settings)
    values = seen.estimates(k, v, y)
    alike = np.array([abs(values[0]), abs(values[1]), 0.0])
    found: list[tuple[str, Floats, float | None, str | None]] = [
        (v_vc.READINGS, _u_of(by_output, seen.covariance_v2), finite(seen.noise.dof), None),
        (V_VC_NOISE, _u_of(by_v, np.eye(v.size) * seen.u_v_vc_v**2), None, None),
        (METER_GAIN, alike * meter.u_gain, None, meter.owner),
    ]
    if seen.output_orders is not None:
        orders = seen.output_orders
        by_orders = derivatives(
            lambda at: replace(seen, output_orders=at).estimates(k, v, y), orders, 1e-2 * np.abs(orders)
        )
        u_orders = shape.OUTPUT_LIMIT / math.sqrt(3.0) * orders
        found.append((shape.OUTPUT_CURVE, _u_of(by_orders, np.diag(u_orders**2)), None, None))
    warmth = with_temperature(v_vc.temperature_errors(settings, seen.windows), since)
    found += [(part.source, alike * part.u, part.dof, part.of) for part in warmth]
    of_curve, same_meter = curve_parts(settings)
    found += [(name, _u_of(by_k, covariance), dof, of) for name, covariance, dof, of in of_curve]
    if not same_meter and settings.v_vc_role is not None:
        found.append((V_VC_GAIN, np.abs(by_v @ v) * error.u_gain, None, error.owner))
        found.append((V_VC_OFFSET, np.abs(by_v.sum(axis=1)) * error.u_offset_v, None, error.owner))
    limits = {
        name
        for name, *_ in found
        if name in {K_VC_DRIFT, K_VC_ON_THE_WAY} or name.startswith(health_check.NOT_MEASURED)
    }
    parts = [
        [UncertaintyPart(name, float(u[place]), dof, of, rectangular=name in limits) for name, u, dof, of in found]
        for place in range(values.size)
    ]
    if settings.v_vc_role is None:  # a generator whose setting is believed: by each of its ranges
        levels = known_levels((), settings.station.sources)
        own_v = np.array([levels.u_besides_v(volts) for volts in v])
        for place, of_value in enumerate(parts):
            of_value.append(UncertaintyPart(RESOLUTION, float(np.linalg.norm(by_v[place] * own_v))))
            for kind, where, effect, of_range in levels.shared(v, by_v, place):
                name, u = V_VC_GAIN if kind == "gain" else V_VC_OFFSET, float(abs(effect[place])) * of_range.u
                of_value.append(UncertaintyPart(f"{name}, {where}", u, None, error.owner, rectangular=True))
    return parts


def _u_of(by: Floats, covariance: Floats) -> Floats:
    return np.sqrt(np.maximum(0.0, np.diag(by @ covariance @ by.T)))


def entry_of(
    settings: SelfCalibrationSettings, results: SelfCalibrationResult | NotStated, made: Provenance
) -> NewEntry | None:
    """Return the entry of the device that was named."""
    if settings.dut is None or isinstance(results, NotStated):
        return None
    drift = results.drift
    last = None if drift is None else drift.last
    record = SelfCalibration(
        serial=settings.dut,
        done=made.finished,
        procedure="self-calibration",
        certificate=settings.known.certificate,
        scale_factor_v_per_deg_s=as_kept(results.scale_factor),
        bias_v=as_kept(results.bias),
        nonlinearity_ppm=as_kept(results.nonlinearity),
        conditions=conditions_of(settings, made, settings.temperature_c),
        characteristics=results.characteristics,
        drift_ppm=None if drift is None else as_kept(drift.change_ppm),
        e_n=None if drift is None else drift.e_n,
        since_last_ppm=None if last is None else as_kept(last.change_ppm),
        cusum=None if drift is None else drift.cusum,
        drift_verdict=None if drift is None else drift.verdict,
        verdict=made.verdict,
        remarks=(f"K_Vc from {results.k_vc_from}", f"V_Vc is taken from the {results.v_vc_by}"),
    )
    return NewEntry(record, settings.store.root)


def self_calibration_report(
    settings: SelfCalibrationSettings, _points: Sequence[Point], results: SelfCalibrationResult | NotStated
) -> Report:
    """Report the levels, the results with their budget, the drift, and the errors that the method cannot see."""
    if isinstance(results, NotStated):
        return Report([*health_check.health_parts(results.health), Text(said_of("output at rest", results.bias))])
    columns = heads("rate [deg/s]:.4f | V_Vc [V]:.6f | output - zero [V]:.5f")
    rows = [(level.rate_deg_s, level.v_vc_v, level.output_v) for level in results.levels]
    words = [
        *(said_of(each.named.words, each) for each in results.by_v_vc),
        f"K_Vc from {results.k_vc_from}; V_Vc is taken from the {results.v_vc_by}",
        *results.since,
    ]
    if results.modulator is not None:
        now = f"V {results.modulator[0]:+.5g} V^2 {results.modulator[1]:+.5g} V^3"
        words.append(
            f"the modulator's curve has changed since the certificate, to {now}; the output's is assumed unchanged"
        )
    words += v_vc.known_words(settings)
    rates = [*(level.rate_deg_s for level in results.levels), 0.0]
    residuals = Series("output - line", rates, [1e3 * left_v for left_v in results.virtual.residuals_v])
    parts = [
        Table(columns, rows, "V_Vc and its virtual rate"),
        *([] if results.health is None else health_check.health_parts(results.health)),
        Text("\n".join(words)),
        budget_table("the scale factor", results.scale_factor),
        *drift_parts(results.drift),
        Figure("Output less line", Axis("rate", "deg/s"), Axis("output - line", "mV"), [residuals]),
        *lists_of_omissions(results.holds_not, results.unseen),
    ]
    if results.drift is not None:
        then, known = settings.known.characteristics, settings.known.reference
        was = results.scale_factor.value if known is None else known.scale_factor_v_per_deg_s.value
        change = replace(results.drift.change_ppm, value=1e6 * (results.scale_factor.value / was - 1.0))
        parts += explained_parts(change, then, results.characteristics)
    return Report(parts)
