"""Measurement of V_Vc: by a second meter, by the one meter with its leads moved, or by the setting.

What a generator was set to it reads back to the last digit, however far it is off; so V_Vc is measured unless somebody
says that the setting is believed, and then the generator's accuracy is the uncertainty.
"""

import math
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from enum import Enum
from pathlib import Path
from typing import Annotated, Literal, Self

from msgspec import Struct
from msgspec.structs import replace

from vcfbench import steps
from vcfbench.errors import ConfigError, MeasurementError
from vcfbench.instructions.kept import KnownFlickerSettings
from vcfbench.instructions.routines import SMALL_V, set_v_vc, take, v_vc_on, window_of
from vcfbench.instructions.schedule import ABBA_SIGNS
from vcfbench.records.devices import DeviceStore
from vcfbench.records.schema import Point
from vcfbench.specifications import AGILENT_33220A, LevelSpecification
from vcfbench.station.bounds import ranged, said
from vcfbench.station.invalid_value import InvalidValue
from vcfbench.station.settings import V_VC_RANGE_V, ProcedureSettings
from vcfbench.steps import AcquireWithVvc, ConfigureVvcMeter, MeasureVvc, Note, VvcMeasured, Window, move_leads
from vcfbench.steps.measured import Measured
from vcfbench.steps.step import Routine, answer
from vcfbench.values.sources import TEMPERATURE, WARM_UP

READINGS = "readings"
K_VC_UNIT = "(deg/s)/V"
"""Unit of the rate that a volt of V_Vc stands for."""
_OVER_RANGE = 1.2
"""A meter's range measures so much of itself."""
_MAINS_S_PER_DIV = 5e-3
"""Ten divisions show two periods of the mains and more."""
_SHOWN_V, SHOWN_SHARE = 0.05, 0.1
"""How far an oscilloscope may show a level from where it was set: its offset and noise, its gain and the generator's.
A sine of the mains of 50 mV makes a modulator of 1.5 % a volt off by 20 uV."""


def has_v_vc_meter(settings: ProcedureSettings) -> bool:
    """Return True if a second meter measures V_Vc together with the output."""
    believed = isinstance(settings, KnownVvcSettings) and settings.v_vc is VvcKnown.SET
    return "v_vc_meter" in settings.station.instruments and not believed


def ready_v_vc_meter(settings: ProcedureSettings, range_v: float) -> Routine[None]:
    """Set up the meter on V_Vc, where there is one; see V_Vc arrive, where a channel of the oscilloscope is on it."""
    if has_v_vc_meter(settings):
        yield ConfigureVvcMeter(float(range_v), float(settings.nplc))
    wiring = settings.station.oscilloscope
    if wiring is None or (channel := wiring.channel_of("v_vc")) is None:
        return
    yield Note("Does V_Vc arrive as it is set?")
    yield steps.ConfigureScope(_MAINS_S_PER_DIV, channel)
    yield from v_vc_on()
    for level_v in (0.0, min(SMALL_V, settings.station.limits.max_v_vc_v or SMALL_V)):
        set_v = yield from set_v_vc(settings, level_v)
        look = steps.FindAmplitudes((channel,), V_VC_RANGE_V, set_v)
        (seen_v,) = answer((yield look), steps.Amplitudes).amplitudes_v
        if abs(seen_v - set_v) > _SHOWN_V + SHOWN_SHARE * set_v:
            raise MeasurementError(
                f"V_Vc was set to {set_v:+.4g} V and shows up to {seen_v:.3g} V on channel {channel}",
                instrument="oscilloscope",
                hint="check the lead of V_Vc: a terminator or an input of 50 ohm halves it; the modulator sees mains "
                "pick-up, which meters average away",
            )
    yield steps.DisableVvc()


def take_driven(
    settings: ProcedureSettings,
    step: int,
    *,
    rate_deg_s: float,
    v_vc_v: float,
    table_deg_s: float | None = 0.0,
    tolerance_v: float | None = None,
) -> Routine[Point]:
    """Average one window with V_Vc on; a second meter, if present, measures V_Vc too.

    It must be within `tolerance_v` of its setting; by default that of :func:`v_vc_tolerance_v`.
    """
    if not has_v_vc_meter(settings):
        return (yield from take(settings, step, rate_deg_s=rate_deg_s, v_vc_v=v_vc_v, table_deg_s=table_deg_s))
    within_v = v_vc_tolerance_v(settings, v_vc_v) if tolerance_v is None else tolerance_v
    common = window_of(settings)
    acquire = AcquireWithVvc(step, rate_deg_s, v_vc_v, table_deg_s, v_vc_tolerance_v=within_v, **common)
    return answer((yield acquire), Window).point


def both_signs(
    settings: ProcedureSettings, step: int, level_v: float, *, tolerance_v: float | None = None
) -> Routine[list[Point]]:
    """Average a window at V_Vc of both signs, +, -, -, +, with the table at rest; `tolerance_v` as `take_driven`."""
    points: list[Point] = []
    asked_v = set_v = 0.0
    for sign in ABBA_SIGNS:
        if asked_v != sign * level_v:
            asked_v = sign * level_v
            set_v = yield from set_v_vc(settings, asked_v)
        taken = take_driven(settings, step, rate_deg_s=0.0, v_vc_v=set_v, table_deg_s=None, tolerance_v=tolerance_v)
        points.append((yield from taken))
    return points


def generator_sheet(settings: ProcedureSettings) -> LevelSpecification:
    """Return the data sheet of the bench's generator, that of a 33220A where it has none."""
    return settings.station.sheet_of("rate_source") or AGILENT_33220A


def v_vc_tolerance_v(settings: ProcedureSettings, v_vc_v: float) -> float:
    """Return the tolerance of V_Vc about its setting: the generator's accuracy and a quarter more, V."""
    return 1.25 * generator_sheet(settings).limit_v(v_vc_v)


def at_measured_levels(points: Sequence[Point]) -> Sequence[Point]:
    """Return the points at the V_Vc that was measured; those at which it was not stay as they are.

    All windows of one step at one setting have one level, the mean of what was measured at them.
    """
    levels_v = mean_levels_v([(point.step, point.v_vc_v) for point in points], points)
    return [replace(point, v_vc_v=level_v) for point, level_v in zip(points, levels_v, strict=True)]


def mean_levels_v(settings: Sequence[Hashable], points: Sequence[Point]) -> list[float]:
    """Return V_Vc of each point, V: the mean of the measured values at its setting, else the setting."""
    seen: dict[Hashable, list[float]] = {}
    for setting, point in zip(settings, points, strict=True):
        if point.v_vc_measured_v is not None:
            seen.setdefault(setting, []).append(point.v_vc_measured_v)
    levels_v = {setting: math.fsum(volts) / len(volts) for setting, volts in seen.items()}
    return [levels_v.get(setting, point.v_vc_v) for setting, point in zip(settings, points, strict=True)]


def standing_for(points: Sequence[Point], step: int, rate_of: Callable[[float], float]) -> Sequence[Point]:
    """Return the points, with the rates of their measured V_Vc for those of `step`."""
    return [
        replace(point, rate_deg_s=rate_of(point.v_vc_v))
        if point.step == step and point.v_vc_measured_v is not None
        else point
        for point in points
    ]


class VvcKnown(Enum):
    """Source of V_Vc: measured, or set."""

    MEASURED = "measured"
    SET = "set"


class KnownVvcSettings(KnownFlickerSettings, frozen=True, kw_only=True):
    """Settings of procedures that use V_Vc."""

    v_vc: Annotated[
        VvcKnown,
        said("V_Vc is measured (by v_vc_meter, or the one meter moved by hand), or taken as set", option=True),
    ] = VvcKnown.MEASURED
    v_vc_range_v: Annotated[Literal[1, 10, 100], said("fixed range of the meter on V_Vc")] = 10
    temperature_c: Annotated[
        Annotated[float, ranged(-100.0, 200.0)] | None, said("temperature of the gyroscope, if it was measured")
    ] = None
    cycles: Annotated[int, ranged(1, 100, "measurements of every level")] = 2

    @property
    def store(self) -> DeviceStore:
        """Store of the devices."""
        return DeviceStore(Path(self.devices), self.station.simulated)

    def recalled(self) -> Self:
        """Return these settings with the flicker of the device, where one is named; the store has room for findings."""
        if self.dut is not None:
            self.store.entries(self.dut)
            self.store.require_room(self.dut)
        return super().recalled()

    @property
    def v_vc_role(self) -> Literal["v_vc_meter", "multimeter"] | None:
        """The role of the meter that measures V_Vc, or None if the setting is used."""
        if self.v_vc is VvcKnown.SET:
            return None
        return "v_vc_meter" if has_v_vc_meter(self) else "multimeter"

    def beyond_range(self, v_vc_v: float, rate_deg_s: float) -> Iterator[InvalidValue]:
        """Yield the range of the meter on V_Vc, where V_Vc is measured and is beyond it at the rate."""
        if self.v_vc_role is not None and abs(v_vc_v) > _OVER_RANGE * self.v_vc_range_v:
            expected = f"a range for {abs(v_vc_v):.4g} V, the V_Vc of {rate_deg_s:g} deg/s"
            yield InvalidValue("v_vc_range_v", expected, self.v_vc_range_v)


class InstrumentAccuracy(Struct, frozen=True):
    """Accuracy of an instrument, as standard uncertainties, and its identity.

    `owner` is what two results must share for the error to be the same in both.
    """

    name: str
    owner: str
    u_gain: float
    u_offset_v: float


def meter_error(settings: ProcedureSettings, role: str) -> InstrumentAccuracy:
    """Return how far meter or generator of `role` may be off, on its range and so long after its calibration."""
    short = "v_vc" if role == "v_vc_meter" else "generator" if role == "rate_source" else "meter"
    known, placed = settings.station.sources, settings.station.instruments[role]
    sigmas = getattr(known, f"{short}_sigmas", None)  # limits of so many, else rectangular
    u_gain, u_offset_v = (
        (getattr(known, f"{short}_{kind}") or 0.0) / (math.sqrt(3.0) if sigmas is None else sigmas)
        for kind in ("gain", "offset_v")
    )
    return InstrumentAccuracy(placed.name, placed.owner, u_gain, u_offset_v)


def known_words(settings: KnownVvcSettings, *keys: str) -> list[str]:
    """Return the ages of the meters' calibrations, with their source, and the assumed values of `keys`."""
    known = settings.station.sources
    ages = [("multimeter", known.meter_age_days, known.meter_age_from)]
    if settings.v_vc_role == "v_vc_meter":
        ages.append(("meter on V_Vc", known.v_vc_meter_age_days, known.v_vc_meter_age_from))
    said = [f"{meter}: {days:g} days after calibration ({where})" for meter, days, where in ages]
    return said + [known.assumed[key] for key in (*keys, *_OF_WARM_UP) if key in known.assumed]


_OF_WARM_UP = ("warm_up_k", "warm_up_time_s", "scale_factor_ppm_k")


def alignment_error(settings: ProcedureSettings) -> float:
    """Return the error by the angle between the gyroscope's axis and the table's, a relative standard uncertainty."""
    return (1.0 - math.cos(math.radians(settings.station.sources.misalignment_deg or 0.0))) / math.sqrt(3.0)


def table_rate_error(settings: ProcedureSettings) -> float:
    """Return the relative standard uncertainty of the table's rate."""
    return (settings.station.sources.table_rate or 0.0) / math.sqrt(3.0)


def temperature_errors(settings: KnownVvcSettings, windows: int) -> dict[str, float]:
    """Return the errors of a scale factor by temperature and warm-up, relative standard uncertainties by source.

    Of the warm-up it is the mean over a run of so many windows; nothing where the bench file does not know it.
    """
    return of_warmth(settings, windows * (settings.samples * settings.sample_interval_s + settings.settle_s))


def of_warmth(settings: ProcedureSettings, lasted_s: float) -> dict[str, float]:
    """Return by source the relative standard uncertainties of a scale factor, from temperature and warm-up."""
    per_k = 1e-6 * (settings.station.sources.scale_factor_ppm_k or 0.0)
    return {name: per_k * u_k for name, u_k in away_from_warm_k(settings, lasted_s).items()}


def away_from_warm_k(settings: ProcedureSettings, lasted_s: float) -> dict[str, float]:
    """Return by source how far the gyroscope is from the temperature of its values, K, standard uncertainties.

    Of the warm-up it is the mean over a run of `lasted_s` that begins after the wait; nothing where the bench file does
    not know it.
    """
    known = settings.station.sources
    found: dict[str, float] = {}
    if known.temperature_k is not None:
        found[TEMPERATURE] = known.temperature_k / math.sqrt(3.0)
    if known.warm_up_k is not None:
        lasted = lasted_s / known.warm_up_time_s
        begun = math.exp(-settings.start_up_s / known.warm_up_time_s)
        mean = -math.expm1(-lasted) / lasted if lasted else 1.0
        found[WARM_UP] = known.warm_up_k / math.sqrt(3.0) * begun * mean
    return found


def v_vc_error(settings: KnownVvcSettings) -> InstrumentAccuracy:
    """Return how far V_Vc may be off: by the meter that measured it, or by the generator that it was set on."""
    return meter_error(settings, settings.v_vc_role or "rate_source")


def measured_levels(settings: KnownVvcSettings, levels_v: Iterable[float]) -> Routine[None]:
    """Measure V_Vc at each level by the one meter, whose leads a person moves there and back.

    The levels are those at which the output was measured; the generator sets them once more. Where V_Vc was measured
    beside the output, or its setting is believed, nothing is done.
    """
    if settings.v_vc_role != "multimeter":
        return
    yield Note("V_Vc by the one multimeter, at every level that was used")
    yield from v_vc_on()
    yield move_leads("multimeter", "v_vc")
    for level_v in levels_v:
        v_vc_v = yield from set_v_vc(settings, level_v)
        tolerance_v = v_vc_tolerance_v(settings, v_vc_v)
        yield MeasureVvc(v_vc_v, settings.samples, settings.sample_interval_s, tolerance_v, "multimeter")
    yield move_leads("multimeter", "output")


def measured_level(points: Sequence[Point], by_hand: Mapping[float, float]) -> float:
    """Return V_Vc of windows at one setting, V: measured by a second meter, by hand, or else the setting."""
    seen = [point.v_vc_measured_v for point in points if point.v_vc_measured_v is not None]
    return math.fsum(seen) / len(seen) if seen else by_hand.get(points[0].v_vc_v, points[0].v_vc_v)


def levels_by_hand(settings: KnownVvcSettings, points: Sequence[Point]) -> Mapping[float, float]:
    """Return V_Vc as the one multimeter measured it, V, by its setting; empty where it was known otherwise.

    ConfigError: it was not measured.
    """
    if settings.v_vc_role != "multimeter":
        return {}
    found = points.found(VvcMeasured) if isinstance(points, Measured) else ()
    known = {step.v_vc_v: result.mean_v for step, result in found if isinstance(step, MeasureVvc)}
    if not known:
        raise ConfigError("V_Vc was not measured; --v-vc set uses the generator's setting instead")
    return known
