"""The settings of a procedure, from where they are given: each place goes before the one above it.

::

    the class of its settings          defaults
    [procedure]                        for all procedures that know the key
    [procedure.NAME]                   for this one
    --set KEY=VALUE, settings={...}    for this run

What is wrong is one line with the place that gave it, the key, what was expected and what came.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeVar
from zlib import crc32

from msgspec import ValidationError, structs, to_builtins

from vcfbench.clock import today
from vcfbench.errors import ConfigError
from vcfbench.files import dotted
from vcfbench.models import ROLES, data_sheet_of
from vcfbench.specifications import (
    AGILENT_33220A,
    HP_34401A,
    ROOM_C,
    WORST_OF_CLASS,
    Accuracy,
    VoltmeterSpecification,
    accuracy_at,
)
from vcfbench.station.invalid_value import InvalidValue
from vcfbench.station.layering import Layer, chosen_settings, keys_of, merged, named, setting_keys, shared_layer
from vcfbench.station.parts import CalibrationPoint
from vcfbench.station.settings import V_VC_RANGE_V, MeterKnown, PlacedInstrument, ProcedureSettings, Sources, Station
from vcfbench.strict import refusal, unknown_key, words
from vcfbench.typed import typed, unboxed

if TYPE_CHECKING:
    from vcfbench.drivers.streams.description import Stream
    from vcfbench.instructions.procedure import AnyProcedure, Procedure
    from vcfbench.specifications import LevelSpecification
    from vcfbench.station.description import BenchDescription

S = TypeVar("S", bound=ProcedureSettings)


def asked_in_python(settings: Mapping[str, Any]) -> Layer:
    """Return the request of a script: ``settings={...}``, a mapping (ConfigError), numpy's numbers as Python's."""
    if not isinstance(settings, Mapping) or not all(isinstance(key, str) for key in settings):
        raise ConfigError(f"settings: expected a mapping of keys to values, got {settings!r}")
    plain = to_builtins(dict(settings), enc_hook=lambda each: unboxed(each) if hasattr(each, "tolist") else str(each))
    return Layer(plain, lambda keys: f"settings: {dotted(('procedure', *keys))}")


def of_device(procedure: AnyProcedure, asked: Layer | None, dut: str | None) -> Layer | None:
    """Return the request, with the device `dut` if its history counts for `procedure`."""
    keys = {} if dut is None else procedure.settings.keys_of_device(dut)
    given, naming = ({}, dotted) if asked is None else (asked.values, asked.naming)
    return Layer(merged(keys, given), naming) if keys else asked


def settings_of(
    procedure: Procedure[S, Any],
    description: BenchDescription,
    asked: Layer | None = None,
    source: str | None = None,
    *,
    recalled: bool = True,
) -> S:
    """Return the settings of `procedure` on the bench of `description`, with the request for this run.

    The bench file is `source` in errors (ConfigError: a key is unknown, a value cannot be, or the meter has no data
    sheet), its name without one. What is known of the device is looked up unless `recalled` is false.
    """
    layers = [*layers_of(procedure, description, source or description.name), *([asked] if asked else [])]
    chosen = _settled(procedure.settings, layers, _station(description))
    counts_s = getattr(chosen, chosen.waits)
    if 0.0 < chosen.warm_up_s < counts_s and any(layer.has(("warm_up_s",)) for layer in layers[1:]):
        expected = f"{chosen.waits}, which counts here and is {counts_s:g} s"
        raise refusal(named(layers, ("warm_up_s",)), expected, words(chosen.warm_up_s))
    resolution_v, meter = None, description.multimeter
    if description.stream:
        resolution_v = description.stream.last_digit
    elif meter is not None:
        sheet: VoltmeterSpecification | None = data_sheet_of(meter.like or meter.model)
        if sheet is None:
            raise ConfigError(
                f"multimeter.model: the resolution of a {meter.model} is not known",
                hint="set multimeter.like to a known model, or name a data sheet (specifications) in vcfbench.models",
            )
        try:
            resolution_v = meter.resolution_v or sheet.resolution_v(float(chosen.meter_range_v), float(chosen.nplc))
        except ValueError as error:
            raise ConfigError(f"procedure.nplc: {error}") from error
    sources = _sources(description, chosen)
    station = structs.replace(chosen.station, meter_resolution_v=resolution_v, sources=sources)
    made = structs.replace(chosen, station=station).made_plain()
    return made.recalled() if recalled else made


def recorded_settings(procedure: Procedure[S, Any], values: Any) -> S:
    """Return the settings of `procedure` that a record holds; ConfigError where they are those of another version."""
    try:
        settings = typed(values, procedure.settings)
    except ValidationError as error:
        raise ConfigError(f"this version cannot read the settings of the record: {error}") from None
    written = to_builtins(settings)
    without = {"simulated", "gyro"}  # no result of before goes by them
    of_station = set(written["station"]) - set(values.get("station", ())) - without
    if missing := sorted(set(written) - set(values)) + sorted(of_station):
        raise ConfigError(f"this version cannot read the settings of the record: {', '.join(missing)} missing")
    return settings


def with_settings(description: BenchDescription, settings: ProcedureSettings) -> BenchDescription:
    """Return the bench with `settings` in place of its ``[procedure]`` settings for all procedures."""
    shared = plain_settings(settings, setting_keys(ProcedureSettings))
    return structs.replace(description, procedure_table={**description.procedure_table, **shared})


def plain_settings(settings: ProcedureSettings, keys: Sequence[str]) -> dict[str, Any]:
    """Return those of `settings` that are called `keys`, as a bench file has them."""
    values: dict[str, Any] = to_builtins(settings)
    return {key: values[key] for key in keys}


def check_tables(description: BenchDescription, source: str) -> None:
    """Check ``[procedure]`` and its tables for single procedures; of one that is not installed when it is run.

    ConfigError: a key is unknown to every procedure, or a value cannot be.
    """
    station = _station(description)
    shared_keys = shared_layer(ProcedureSettings, description.procedure_table, source)
    _sources(description, _checked(ProcedureSettings, [shared_keys], station)[0])
    shared = setting_keys(ProcedureSettings)
    own = {key: value for key, value in description.procedure_table.items() if key not in shared and value != {}}
    if not own:
        return
    from vcfbench.procedures.catalogue import PROCEDURES  # noqa: PLC0415  # few bench files need it

    loaded = PROCEDURES.loaded()
    for key, value in own.items():
        addressed = [each for each in loaded if each.name == key or key in setting_keys(each.settings)]
        for procedure in addressed:
            _checked(procedure.settings, layers_of(procedure, description, source), station)
        if addressed or key in PROCEDURES:
            continue
        where = f"{source}: {dotted(('procedure', key))}"
        if not isinstance(value, dict):
            known = {name for each in loaded for name in setting_keys(each.settings)}
            raise unknown_key(key, sorted(known), where)
        if close := difflib.get_close_matches(key, ["drive", *PROCEDURES], n=1, cutoff=0.8):
            raise unknown_key(key, close, where)


def layers_of(procedure: AnyProcedure, description: BenchDescription, source: str) -> list[Layer]:
    """Return the settings of the bench file `source` for `procedure`: those for all, then those for this one."""
    own = description.procedure_table.get(procedure.name, {})
    path = ("procedure", procedure.name)
    if not isinstance(own, dict):
        raise refusal(f"{source}: {dotted(path)}", "a table", words(own))
    return [
        shared_layer(procedure.settings, description.procedure_table, source),
        Layer(own, lambda keys: f"{source}: {dotted((*path, *keys))}"),
    ]


def _settled(kind: type[S], layers: Sequence[Layer], station: Station) -> S:
    """Return the settings that `layers` come to at `station`, which must bear them."""
    chosen, unsaid = _checked(kind, layers, station)
    for invalid_value in unsaid:
        keys, came = keys_of(invalid_value.path), words(invalid_value.came)
        said = f"{named(layers, keys)}: expected {invalid_value.expected}, got {came}, the default"
        raise ConfigError(said, hint=f"set {keys[0]} in [procedure] of the bench file")
    return chosen


def _checked(kind: type[S], layers: Sequence[Layer], station: Station) -> tuple[S, list[InvalidValue]]:
    """Return the settings that `layers` come to, and the defaults that `station` does not bear.

    ConfigError: a value that somebody gave cannot be. A default hinders the run of its own procedure alone.
    """
    chosen = structs.replace(chosen_settings(kind, layers), station=station)
    unsaid = []
    for invalid_value in chosen.contradictions():
        keys = keys_of(invalid_value.path)
        if any(layer.has(keys[:1]) for layer in layers):
            raise refusal(named(layers, keys), invalid_value.expected, words(invalid_value.came))
        unsaid.append(invalid_value)
    return chosen, unsaid


def _station(description: BenchDescription) -> Station:
    """Return the station by the bench file; the meter's resolution depends on the chosen settings."""
    placed = {role: getattr(description, role) for role in ROLES}
    (low_c, high_c), ambient_c = ROOM_C, description.site.ambient_c or ROOM_C
    outside_k = max(0.0, low_c - min(ambient_c), max(ambient_c) - high_c)
    flat = description.uncertainty.meter_limits == "rectangular"
    # The known corrections of the voltmeters by role, if any beside the data sheet
    voltmeters = [role for role in ("multimeter", "v_vc_meter") if placed[role] is not None]
    known = {role: MeterKnown(outside_k, placed[role].calibration, flat) for role in voltmeters}
    return Station(
        instruments={role: _placed_part(part, description.name) for role, part in placed.items() if part is not None},
        meters={role: each for role, each in known.items() if each != MeterKnown()},
        rails=description.wiring.rails,
        oscilloscope=None if description.oscilloscope is None else description.wiring.oscilloscope,
        mains_hz=description.site.mains_hz,
        latitude_deg=description.site.latitude_deg,
        limits=description.limits,
        gyro=description.gyro,
        expected=description.expected,
        acceptance=description.acceptance,
        simulated=description.simulated,
    )


def _placed_part(part: Any, station: str) -> PlacedInstrument:
    numbers = ((part.serial_number, "no."), (part.inventory_number, "inventory no."))
    where = next((f"{said} {number}" for number, said in numbers if number is not None), None)
    dated = [(part.calibrated, "calibrated"), (part.certificate, "certificate")]
    if points := getattr(part, "calibration", ()):
        dated.append((f"{crc32(repr(points).encode()):08x}", "corrected by the table"))
    calibrated = " ".join(f"{said} {what}" for what, said in dated if what is not None)
    return PlacedInstrument(
        model=part.like or part.model,
        where=where or f"at {part.resource}",
        station=station if where is None else None,
        calibrated=calibrated or None,
    )


def _sources(description: BenchDescription, chosen: ProcedureSettings) -> Sources:
    """Return the sources of uncertainty; ConfigError when the stated age of a meter is beyond its data sheet."""
    known = structs.asdict(description.uncertainty)
    idle = {"bias_deg_s_demodulator_deg"} if known["demodulator_phase_deg"] == 0.0 else set()
    left_open = {key: each for key, each in WORST_OF_CLASS.items() if known[key] is None and key not in idle}
    known |= {key: each.value for key, each in left_open.items()}
    known["generator_ranges_v"] = tuple(sorted(known["generator_ranges_v"] or ()))
    output = _stream_sources(description.stream) if description.stream else None
    instruments = output or _meter_sources(description, chosen, "multimeter")
    instruments |= _meter_sources(description, chosen, "v_vc_meter")
    if (placed := description.rate_source) is not None:
        sheet: LevelSpecification = data_sheet_of(placed.like or placed.model) or AGILENT_33220A  # the worst known
        gain, offset_v = known["generator_error"], known["generator_offset_v"]
        instruments |= {
            "generator_gain": sheet.setting if gain is None else gain,
            "generator_offset_v": sheet.offset_v if offset_v is None else offset_v,
            "generator_reach_v": sheet.ranges_v[-1],
            "generator_bits": sheet.bits,
        }
    same = {key: known[key] for key in Sources.__struct_fields__ if key in known and key not in instruments}
    assumed = {
        key: f"uncertainty.{key}: {each.value:g}{' ' * bool(each.unit)}{each.unit}, assumed ({each.source})"
        for key, each in left_open.items()
    }
    found = Sources(**instruments, **same, table_rate=known["table_rate_error"], assumed=assumed)
    if "bias_instability_deg_h" not in assumed:
        return found
    return structs.replace(found, bias_instability_from=assumed["bias_instability_deg_h"])


def _meter_sources(description: BenchDescription, chosen: ProcedureSettings, role: str) -> dict[str, Any]:
    """Return the contributions of the meter of `role`, by the keys of :class:`Sources`."""
    short, key, range_v = "meter", "meter_age_days", float(chosen.meter_range_v)
    if role == "v_vc_meter":
        short, key, range_v = "v_vc", f"v_vc_{key}", float(getattr(chosen, "v_vc_range_v", V_VC_RANGE_V))
    part, known = getattr(description, role), chosen.station.meters.get(role, MeterKnown())
    stated: float | None = getattr(description.uncertainty, key)
    age_days, said = _age_days(part, role) if stated is None else (stated, f"uncertainty.{key}")
    worth: dict[str, Any] = {}
    sheet: VoltmeterSpecification | None = None if part is None else data_sheet_of(part.like or part.model)
    if sheet is not None:
        said += "".join(f"; {each}" for each in large_corrections(part, role, sheet))
        if range_v not in sheet.accuracy:
            said += f"; no data sheet of a {sheet.model} on {range_v:g} V: the 34401A's is assumed"
        elif sheet.known_accuracy(range_v, age_days) is None:
            if stated is not None:
                raise ConfigError(f"uncertainty.{key}: {sheet.beyond(range_v)}")
            said += f"; {sheet.beyond(range_v)}, so its limits are assumed to grow further with time"
        (low_c, high_c), ambient_c = ROOM_C, description.site.ambient_c
        if ambient_c is None:
            said += f"; room assumed within {low_c:g} to {high_c:g} degC (site.ambient_c)"
        elif min(ambient_c) < low_c or max(ambient_c) > high_c:
            said += f"; room {min(ambient_c):g} to {max(ambient_c):g} degC"
        if own := known.on(range_v):
            said += f"; certificate, {len(own)} levels on {range_v:g} V; since then by the data sheet"
        worth = meter_worth(short, sheet, known, range_v, age_days)
        if role == "multimeter":
            worth["meter_gain"] = _with_load(worth, description, range_v)
    return {key: age_days, key.replace("_days", "_from"): said, **worth}


_MOST_LIMITS = 10.0
"""Limits of the data sheet by which a meter may be off, or its certificate not know it; ten years are no more."""


def large_corrections(part: Any, role: str, sheet: VoltmeterSpecification) -> Iterator[str]:
    """Yield each correction beyond the data sheet's limit; ConfigError: a correction or its U is beyond ten of them."""
    for number, each in enumerate(part.calibration):
        known = sheet.accuracy.get(each.range_v) or HP_34401A.accuracy.get(each.range_v)
        if known is None:
            continue
        limit = known[max(known)]
        limit_v = limit.reading * abs(each.level_v) + limit.range * each.range_v
        for key in ("correction_v", "expanded_v"):
            came_v = getattr(each, key)
            if abs(came_v) > _MOST_LIMITS * limit_v:
                expected = f"at most {_MOST_LIMITS * limit_v:.2g} V, ten limits of the data sheet (in V, not mV?)"
                raise refusal(f"{role}.calibration[{number}].{key}", expected, words(came_v))
        if abs(each.correction_v) > limit_v:
            times = abs(each.correction_v) / limit_v
            yield f"CORRECTED at {each.level_v:g} V by {times:.2g} limits of the data sheet: is the meter in order?"


def _stream_sources(stream: Stream) -> dict[str, Any]:
    """Return the contributions of a stream in place of a meter: its clock, where its numbers go by that."""
    said = f"stream: {stream.name}, {stream.kind} in {stream.unit}, means over {stream.aperture_s:g} s"
    worth = {"meter_gain": stream.clock_share, "meter_offset_v": 0.0, "meter_sigmas": None}
    return {"meter_age_days": 0.0, "meter_age_from": said, **worth}


_HIGH_OHM, _HIGH_V, _USUAL_OHM = 1e10, 10.0, 1e7
"""Input resistance that voltmeters are told to have, to what range, and that of the others: 34401A, p. 53."""


def _with_load(worth: Mapping[str, Any], description: BenchDescription, range_v: float) -> float:
    """Return the limit of the multimeter's gain with its load on the output, as if it were one of its sigmas."""
    output_ohm = description.uncertainty.output_ohm
    output_ohm = WORST_OF_CLASS["output_ohm"].value if output_ohm is None else output_ohm
    high = range_v <= _HIGH_V and "multimeter" not in description.by_hand
    loaded = output_ohm / (_HIGH_OHM if high else _USUAL_OHM)
    return math.hypot(worth["meter_gain"], loaded * (worth["meter_sigmas"] or math.sqrt(3.0)) / math.sqrt(3.0))


_USUAL_AGE_DAYS = 365.0


def _age_days(part: Any, role: str) -> tuple[float, str]:
    """Return the days since a meter was calibrated, and where they are from: its table, or else a year."""
    calibrated = getattr(part, "calibrated", None)
    if calibrated is None:
        return _USUAL_AGE_DAYS, f"assumed: the bench file has no {role}.calibrated"
    days = (today() - calibrated).days
    if days < -1:  # where the bench stands it may be a day later
        raise refusal(f"{role}.calibrated", "a day that is past", str(calibrated))
    return float(max(days, 0)), f"calibrated {calibrated}"


def meter_worth(
    short: str, sheet: VoltmeterSpecification, known: MeterKnown, range_v: float, age_days: float
) -> dict[str, Any]:
    """Return limits and corrections of a voltmeter on a range, by the keys of Sources, which begin with `short`.

    Where its certificate has levels on the range, their corrections and standard uncertainties stand for the data
    sheet: what the meter drifted since is what that sheet's limits grow by, and what the levels do not tell, the gain
    at 0 V alone or the offset at one level, is that of the sheet.
    """
    promised, sigmas = accuracy_at(sheet, range_v, age_days, known.outside_k)
    sigmas = None if known.rectangular else sigmas
    own, of_limit = known.on(range_v), math.sqrt(3.0) if sigmas is None else sigmas
    if not own:
        return {
            f"{short}_gain": promised.reading,
            f"{short}_offset_v": promised.range * range_v,
            f"{short}_sigmas": sigmas,
            f"{short}_gain_correction": 0.0,
            f"{short}_offset_correction_v": 0.0,
        }
    # By how much limits grow from a calibration to its age, and to a room outside of where they hold. A sheet without
    # limits of the first day has theirs grow from nothing, evenly up to the first age that it knows
    here, _ = accuracy_at(sheet, range_v, age_days)
    first = min(sheet.accuracy.get(range_v, {1: None}))
    fresh, _ = accuracy_at(sheet, range_v, 1.0)
    if first > 1:
        left = max(0.0, 1.0 - age_days / first)
        fresh = Accuracy(here.reading * left, here.range * left)
    grown = Accuracy(promised.reading - fresh.reading, promised.range - fresh.range)
    (slope, offset_v), (u_slope, u_offset_v) = _line(own)
    left_v = max(abs(each.correction_v - offset_v - slope * each.level_v) for each in own) / math.sqrt(3.0)
    u_gain = promised.reading / of_limit if u_slope is None else u_slope
    u_zero_v = promised.range * range_v / of_limit if u_offset_v is None else u_offset_v
    return {
        f"{short}_gain_correction": slope,
        f"{short}_offset_correction_v": offset_v,
        f"{short}_gain": math.hypot(u_gain, grown.reading / of_limit),
        f"{short}_offset_v": math.hypot(u_zero_v, grown.range * range_v / of_limit, left_v),
        f"{short}_sigmas": 1.0,
    }


def _line(own: Sequence[CalibrationPoint]) -> tuple[tuple[float, float], tuple[float | None, float | None]]:
    """Return slope and offset of the corrections, V, and their standard uncertainties; None: the levels do not tell it.

    Levels count by 1/u^2. Nobody tells how their errors go together: the uncertainties are those of the worst case.
    """
    us = [max(each.expanded_v / each.k, _LEAST_V) for each in own]
    weights = [1.0 / u**2 for u in us]
    total = math.fsum(weights)
    middle = math.fsum(w * each.level_v for w, each in zip(weights, own, strict=True)) / total
    spread = math.fsum(w * (each.level_v - middle) ** 2 for w, each in zip(weights, own, strict=True))
    if not spread > 1e-12 * total * max(each.level_v**2 for each in own):
        mean = math.fsum(w * each.correction_v for w, each in zip(weights, own, strict=True)) / total
        return ((mean / middle, 0.0), (max(us) / abs(middle), None)) if middle else ((0.0, mean), (None, max(us)))
    of_slope = [w * (each.level_v - middle) / spread for w, each in zip(weights, own, strict=True)]
    of_offset = [w / total - middle * each for w, each in zip(weights, of_slope, strict=True)]

    def applied(shares: Sequence[float]) -> Iterator[float]:
        yield math.fsum(share * each.correction_v for share, each in zip(shares, own, strict=True))
        yield math.fsum(abs(share) * u for share, u in zip(shares, us, strict=True))

    (slope, u_slope), (offset_v, u_offset_v) = applied(of_slope), applied(of_offset)
    return (slope, offset_v), (u_slope, u_offset_v)


_LEAST_V = 1e-12
"""Least standard uncertainty: a certificate that states none at a level makes no other level worthless."""
