"""Results over temperature: temperature coefficients of scale factor, bias and frequency, hysteresis."""

import math
from collections.abc import Iterator, Sequence
from statistics import fmean

import numpy as np
from msgspec import Struct, structs

from vcfbench.analysis.chopped import CHOPPED, Block, BlockNoise, block_noise
from vcfbench.bench.bench import Bench
from vcfbench.errors import ConfigError
from vcfbench.instructions import v_vc
from vcfbench.instructions.scale_factor import ScaleFactor, scale_factor_used
from vcfbench.procedures import bandwidth
from vcfbench.procedures.temperature.settings import TemperatureSettings
from vcfbench.reports.document import Axis, Figure, Report, Series, Table, Text, heads
from vcfbench.steps import SineRecords, SineResponse, TemperatureReading
from vcfbench.steps.measured import Measured
from vcfbench.steps.step import Step
from vcfbench.uncertainty.measurand import divided, value_table
from vcfbench.uncertainty.oscilloscope import TIME_BASE, DriveRecords
from vcfbench.uncertainty.over_temperature import (
    Cause,
    Parabola,
    Temperatures,
    most,
    over_temperature,
    relative_over_temperature,
)
from vcfbench.values.sources import METER_GAIN, METER_OFFSET, MISALIGNMENT, TABLE_RATE, V_VC_GAIN
from vcfbench.values.value import Measurand, Value

_MEASURED = 1
"""`step` of the windows that are measured; those of the soak have another."""

NOT_HELD = (
    "The uncertainties contain the scatter of the readings, flicker, the wander of the bias (bias_instability_deg_h), "
    "the temperatures (u_temperature_k, common to all; u_each_temperature_k), and errors common to all temperatures, "
    "which cancel in the coefficients: gain and offset of the reading and, of a scale factor, {}. They do not contain: "
    "the scale factor from the output to deg/s, an incomplete soak, a sensor whose error changes with temperature, the "
    "gyroscope's own heat (constant above the air), deviation from the parabola, and the effect of drift other than "
    "flicker on the bias."
)
BY_V_VC = (
    "The scale factor is stated against V_Vc (V/V). K_Vc is proportional to 1 / drive frequency, so the scale factor "
    "against the rate adds the coefficient of the frequency, if drive amplitude, carrier, combs and masses stay."
)


class AtTemperature(Step, Struct, frozen=True):
    """Heading of the steps at a temperature, degC; `direction` is the one that it was approached from."""

    temperature_c: float
    direction: str

    def describe(self) -> str:
        return f"{self.temperature_c:+g} degC, {self.direction}"

    def command(self, bench: Bench) -> None:
        """Do nothing."""


class PointOfTemperature(Struct, frozen=True):
    """One temperature: its reading (degC; at the device, else of the air, else as a person set it), and direction.

    `slope` is the scale factor, V/(deg/s) by the table or V/V by V_Vc; `bias_deg_s` that with the generator off.
    """

    temperature_c: float
    direction: str
    slope: float
    u_slope: float
    bias_deg_s: float
    u_bias_deg_s: float
    frequency_hz: float | None
    u_frequency_hz: float | None
    split_hz: Measurand | None


class TemperatureResult(Struct, frozen=True):
    """Results of the run over temperature; coefficients are those at `reference_c`, of a parabola through all points.

    What was not measured (frequency, split) is None. A hysteresis is that going down less that going up, the largest of
    the temperatures that were come to both ways; None where there is none. The largest of several differences is never
    zero, so its U95 is that of all of them together: a hysteresis that is not larger is not seen, and below
    the sum of both. `..._lack_of_fit` is the deviation from the parabola, root mean square over the degrees of
    freedom; it is in no uncertainty.
    """

    reference_c: float
    by: str
    scale_factor: Measurand
    scale_factor_tc: Measurand
    scale_factor_tc2: Measurand
    scale_factor_hysteresis: Measurand | None
    scale_factor_lack_of_fit_ppm: float | None
    bias: Measurand
    bias_tc: Measurand
    bias_hysteresis: Measurand | None
    bias_lack_of_fit_deg_s: float | None
    frequency: Measurand | None
    frequency_tc: Measurand | None
    frequency_hysteresis: Measurand | None
    split: Measurand | None
    split_tc: Measurand | None
    points: tuple[PointOfTemperature, ...]
    scale_factor_v_per_deg_s: ScaleFactor

    def stated(self) -> Iterator[Value]:
        """Yield its values; a hysteresis that is not seen as its bound."""
        at = f"at {self.reference_c:g} degC"
        named = {
            "scale_factor": (f"scale factor {at}", self.scale_factor),
            "scale_factor_tc": ("temperature coefficient of the scale factor", self.scale_factor_tc),
            "scale_factor_tc2": ("its change with temperature", self.scale_factor_tc2),
            "scale_factor_hysteresis": ("hysteresis of the scale factor", self.scale_factor_hysteresis),
            "bias": (f"bias {at}", self.bias),
            "bias_tc": ("temperature coefficient of the bias", self.bias_tc),
            "bias_hysteresis": ("hysteresis of the bias", self.bias_hysteresis),
            "frequency": (f"drive frequency {at}", self.frequency),
            "frequency_tc": ("temperature coefficient of the drive frequency", self.frequency_tc),
            "frequency_hysteresis": ("hysteresis of the drive frequency", self.frequency_hysteresis),
            "split": (f"mode split {at}", self.split),
            "split_tc": ("temperature coefficient of the mode split", self.split_tc),
        }
        for name, (words, found) in named.items():
            if found is None:
                continue
            value = found.called(name, "", words)  # at one level and one temperature: of no kind that limits are for
            seen = not name.endswith("hysteresis") or abs(found.value) > found.u95
            yield value if seen else value.bound("size-below", most(found))


class _Seen(Struct, frozen=True):
    """Measured data at one temperature: blocks of outputs (V), their level, begin and end (bench time, s)."""

    temperature_c: float
    direction: str
    blocks: tuple[Block, ...]
    level: float
    begin_s: float
    end_s: float
    drive: DriveRecords | None
    split_hz: Measurand | None

    @property
    def slope(self) -> float:
        """Output over level."""
        chopped = fmean(block.differences_v[0] - block.differences_v[1] for block in self.blocks)
        return 0.5 * chopped / self.level

    @property
    def zero_v(self) -> float:
        """Output at rest, V."""
        return fmean(block.zero_v for block in self.blocks)


def temperature_results(settings: TemperatureSettings, measured: Measured) -> TemperatureResult:
    """Return the results of the run."""
    scale = scale_factor_used(settings)
    seen = [_seen(settings, at, part) for at, part in measured.parted(AtTemperature)]
    temperatures = Temperatures(
        *(np.array([each.temperature_c for each in seen]), [each.direction == "up" for each in seen]),
        *(settings.reference_c, settings.u_temperature_k, settings.u_each_temperature_k),
    )
    # The noise of the windows, by the residuals of blocks beside levels and drift
    std_v = math.sqrt(fmean(point.std_v**2 for point in measured if point.step == _MEASURED))
    slot_s = fmean((each.end_s - each.begin_s) / (len(CHOPPED) * settings.cycles) for each in seen)
    window_s = settings.samples * settings.sample_interval_s
    blocks = [block for each in seen for block in each.blocks]
    noise = block_noise(blocks, std_v, settings.samples, window_s, max(slot_s, window_s))
    slopes, table = [each.slope for each in seen], settings.by.value == "table"
    (of_plus, both), (_, of_minus) = noise.covariance_v2
    u_slope = math.sqrt(0.25 * (of_plus + of_minus - 2.0 * both) / settings.cycles / fmean(e.level for e in seen) ** 2)
    of_slope = Cause("readings and flicker", u_slope**2 * np.eye(len(seen)), noise.dof)
    mean = fmean(slopes)
    volts = slopes if table else [scale.value] * len(seen)
    of_factor = [of_slope, *_of_instruments(settings, mean)]
    factor = relative_over_temperature(temperatures, slopes, of_factor, "V/(deg/s)" if table else "V/V")
    biases = [(each.zero_v - settings.null_v) / by for each, by in zip(seen, volts, strict=True)]
    u_bias = noise.white_v / math.sqrt(2.0 * settings.cycles) / abs(fmean(volts))
    of_bias = _of_bias(settings, seen, (u_bias, fmean(volts)), noise)
    if table:
        of_bias.append(Cause("scale factor", np.diag((u_slope / mean * np.array(biases)) ** 2), noise.dof))
    bias = over_temperature(temperatures, biases, of_bias, "deg/s")
    bias = bias if table else _divided(bias, scale)
    frequency, split = _drive_over_temperature(settings, temperatures, [each.drive for each in seen]), None
    if len(splits := [each.split_hz for each in seen if each.split_hz is not None]) == len(seen):
        fits = Cause("fits of the response", np.diag([each.u**2 for each in splits]))
        split = over_temperature(temperatures, [each.value for each in splits], [fits], "Hz")
    return TemperatureResult(
        reference_c=settings.reference_c,
        by=settings.by.value,
        scale_factor=factor.value,
        scale_factor_tc=factor.tc,
        scale_factor_tc2=factor.tc2,
        scale_factor_hysteresis=factor.hysteresis,
        scale_factor_lack_of_fit_ppm=factor.lack_of_fit,
        bias=bias.value,
        bias_tc=bias.tc,
        bias_hysteresis=bias.hysteresis,
        bias_lack_of_fit_deg_s=bias.lack_of_fit,
        frequency=None if frequency is None else frequency.value,
        frequency_tc=None if frequency is None else frequency.tc,
        frequency_hysteresis=None if frequency is None else frequency.hysteresis,
        split=None if split is None else split.value,
        split_tc=None if split is None else split.tc,
        points=tuple(
            PointOfTemperature(
                *(each.temperature_c, each.direction, each.slope, u_slope, bias_deg_s, u_bias),
                None if each.drive is None else each.drive.frequency_hz,
                None if each.drive is None else each.drive.u_hz,
                each.split_hz,
            )
            for each, bias_deg_s in zip(seen, biases, strict=True)
        ),
        scale_factor_v_per_deg_s=scale,
    )


def _divided(bias: Parabola, scale: ScaleFactor) -> Parabola:
    """Return rates with the u of the scale factor that the outputs were divided by."""
    value, tc, tc2 = (divided(each, scale.value, scale.u) for each in (bias.value, bias.tc, bias.tc2))
    largest, hysteresis = bias.hysteresis, None
    if largest is not None:  # its U95 is that of all differences together
        hysteresis = divided(largest, scale.value, scale.u)
        hysteresis = structs.replace(hysteresis, u95=largest.u95 / largest.u * hysteresis.u)
    return structs.replace(bias, value=value, tc=tc, tc2=tc2, hysteresis=hysteresis)


def _seen(settings: TemperatureSettings, at: AtTemperature, part: Measured) -> _Seen:
    """Return the measured data at one temperature."""
    points = [point for point in part if point.step == _MEASURED]
    if len(points) != (expected := len(CHOPPED) * settings.cycles):
        raise ConfigError(f"expected {expected} windows at {at.temperature_c:g} degC, got {len(points)}")
    outputs = [point.output_v for point in points]
    read = part.found(TemperatureReading)
    temperature_c = at.temperature_c
    if read:
        device_c = read[-1][1].device_c
        temperature_c = read[-1][1].air_c if device_c is None else device_c
    frequency = None
    if records := part.found(SineRecords):
        frequency = DriveRecords.of(records[0][1].records)
    driven = points[CHOPPED.index(1)]
    times = [window.t_s for window in part.readings.windows[-len(points) :]]
    return _Seen(
        temperature_c,
        at.direction,
        tuple(Block(tuple(outputs[n : n + len(CHOPPED)])) for n in range(0, len(outputs), len(CHOPPED))),
        driven.rate_deg_s if settings.by.value == "table" else driven.v_vc_v,
        float(times[0][0]),
        float(times[-1][-1]),
        frequency,
        bandwidth.results(settings.sweep, part).split_hz if part.found(SineResponse) else None,
    )


def _drive_over_temperature(
    settings: TemperatureSettings, temperatures: Temperatures, seen: Sequence[DriveRecords | None]
) -> Parabola | None:
    """Return the drive's frequency over temperature; None without an oscilloscope."""
    if len(drives := [each for each in seen if each is not None]) < len(seen):
        return None
    found_hz = [each.frequency_hz for each in drives]
    time_base = _at_all(settings, "time base", TIME_BASE / math.sqrt(3.0) * fmean(found_hz))
    return relative_over_temperature(temperatures, found_hz, [*_of_records(drives), time_base], "Hz")


def _of_records(drives: Sequence[DriveRecords]) -> list[Cause]:
    """Return the causes of drive frequencies: noise of their records, and digits.

    Those err alike where the frequency is the same to their u, as after a way up and down: half of it counts as that.
    """
    noise = np.diag([each.u_noise_hz**2 for each in drives])
    at_hz, digits = (np.array(each) for each in zip(*((d.frequency_hz, d.u_digits_hz) for d in drives), strict=True))
    alike = np.abs(np.subtract.outer(at_hz, at_hz)) <= np.maximum.outer(digits, digits)
    both = 0.5 * (alike + np.eye(len(drives))) * np.outer(digits, digits)
    return [Cause("records", noise, 7.0 * len(drives)), Cause("digits", both)]


def _of_instruments(settings: TemperatureSettings, slope: float) -> list[Cause]:
    """Return the instruments' errors of a scale factor, the same at all temperatures: their offsets cancel.

    By V_Vc as it is set both signs are of one range of the generator. By the table its rate and the angle count.
    """
    relative = {METER_GAIN: v_vc.meter_error(settings, "multimeter").u_gain}
    if settings.by.value == "table":
        relative[TABLE_RATE] = v_vc.table_rate_error(settings)
        relative[MISALIGNMENT] = v_vc.alignment_error(settings)
    else:
        relative[V_VC_GAIN] = v_vc.generator_sheet(settings).setting / math.sqrt(3.0)
    return [_at_all(settings, source, u * abs(slope)) for source, u in relative.items()]


def _at_all(settings: TemperatureSettings, source: str, u: float) -> Cause:
    """Return a cause that is the same at all temperatures, so that no coefficient sees it."""
    return Cause(source, np.zeros((len(settings.temperatures_c),) * 2), None, u)


def _of_bias(
    settings: TemperatureSettings, seen: Sequence[_Seen], u_at: tuple[float, float], noise: BlockNoise
) -> list[Cause]:
    """Return the causes of a bias: its readings, the meter, and its wander from one temperature to the next.

    `u_at` are the u of its readings and the scale factor by which it is a rate. The meter's gain tells at a null.

    Flicker of coefficient B has the density (B^2 / pi) / f: no variance, but that of differences, by the logarithm of
    the time between them, which is all that slopes and hysteresis are made of.
    """
    (u, volts), meter = u_at, v_vc.meter_error(settings, "multimeter")
    null = [_at_all(settings, METER_GAIN, meter.u_gain * abs(settings.null_v / volts))] if settings.null_v else []
    wander = settings.bias_instability_deg_h / 3600.0
    middle_s = np.array([0.5 * (each.begin_s + each.end_s) for each in seen])
    lasts_s = fmean(each.end_s - each.begin_s for each in seen)
    apart_s = np.abs(np.subtract.outer(middle_s, middle_s))
    logarithm = np.log(np.where(apart_s > 0.0, apart_s, lasts_s * math.exp(-1.5)))
    flicker = -(wander**2) / math.pi * logarithm
    return [
        Cause("readings", u**2 * np.eye(len(seen)), 2.0 * noise.dof if math.isinf(noise.dof) else noise.dof),
        Cause("wander (flicker)", flicker, None, math.sqrt(2.0 * math.log(2.0) / math.pi) * wander),
        _at_all(settings, METER_OFFSET, meter.u_offset_v / abs(volts)),
        *null,
    ]


def temperature_report(settings: TemperatureSettings, _measured: Measured, results: TemperatureResult) -> Report:
    """Report the coefficients, every temperature, and the figures over it."""
    unit = results.scale_factor.unit
    of_points = heads(
        f"temperature [degC]:.1f | <direction | scale factor [{unit}]:.7g | u [{unit}]:.1g | "
        "bias [deg/s]:.5f | u [deg/s]:.1g | drive frequency [Hz]:.4f | mode split [Hz]:.4f"
    )
    points = [
        (
            *(each.temperature_c, each.direction, each.slope, each.u_slope, each.bias_deg_s, each.u_bias_deg_s),
            *(each.frequency_hz, None if each.split_hz is None else each.split_hz.value),
        )
        for each in results.points
    ]
    factor, bias = results.scale_factor_lack_of_fit_ppm, results.bias_lack_of_fit_deg_s
    left = (
        "as many points as coefficients: the fit of the parabola cannot be checked"
        if factor is None or bias is None
        else f"deviation from the parabolas: scale factor {factor:.3g} ppm, bias {bias:.2g} deg/s"
    )
    by_v_vc = results.by == "v-vc"
    source = "the gain of the generator" if by_v_vc else "rate and angle of the table"
    said = [left, BY_V_VC if by_v_vc else "", NOT_HELD.format(source)]
    if results.split is None:
        said.insert(0, "mode split: not measured (--set split=true)")
    if settings.chamber is None:
        said.insert(0, "temperatures as set by a person, not measured")
    ppm = [1e6 * (p.slope / results.scale_factor.value - 1.0) for p in results.points]
    biases = [p.bias_deg_s for p in results.points]
    figures = []
    for name, unit, values in (("scale factor", "ppm", ppm), ("bias", "deg/s", biases)):
        series = []
        for direction in ("up", "down"):
            of = [(p.temperature_c, y) for p, y in zip(results.points, values, strict=True) if p.direction == direction]
            if of:
                series.append(Series(direction, [x for x, _ in of], [y for _, y in of]))
        axes = Axis("temperature", "degC"), Axis(name, unit)
        figures.append(Figure(f"{name} over temperature", *axes, series))
    return Report(
        [value_table(results.stated()), Table(of_points, points), Text("\n".join(filter(None, said))), *figures]
    )
