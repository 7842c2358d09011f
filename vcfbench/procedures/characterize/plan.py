"""All procedures of one gyroscope in their order, in one session: one start-up, one shut-down, one data sheet.

Each part is a procedure as it is, with its own plan, settings and results; nothing here knows what any of them does.
The supply stays on from part to part: that one plan switches off at its end is left out, unless the next wants to see
the power come. What the bench cannot do is left out, and it is said why.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from typing import Annotated, Any, Self, cast

from msgspec import Struct, structs, to_builtins
from msgspec import field as key

from vcfbench import interfaces
from vcfbench.bench.bench import Bench
from vcfbench.errors import BenchError
from vcfbench.files import dotted
from vcfbench.instructions.kept import Keeps
from vcfbench.instructions.procedure import AnyProcedure, Procedure, Provenance, roles
from vcfbench.instructions.v_vc import has_v_vc_meter
from vcfbench.models import driver_of, find_model
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.characterize.data_sheet import SheetRow, data_sheet_report, line_of, sheet_rows
from vcfbench.procedures.layers import meter_worth
from vcfbench.records.device_values import Characteristics
from vcfbench.records.devices import NewEntry, together
from vcfbench.records.stated import stated
from vcfbench.reports.document import Report
from vcfbench.station.bounds import said, several
from vcfbench.station.invalid_value import InvalidValue
from vcfbench.station.layering import Layer, chosen_settings, keys_of, setting_keys
from vcfbench.station.settings import V_VC_RANGE_V, DeviceSettings, MeterKnown, ProcedureSettings, Station
from vcfbench.steps import DisableSupply, Done, EnableSupply, NotChecked, Plan, Settle
from vcfbench.steps.measured import Measured
from vcfbench.steps.step import Step, StepResult
from vcfbench.typed import typed
from vcfbench.values.kinds import KINDS
from vcfbench.values.value import Unstated, Value

_CERTIFIES = "kvc"
_OFF_S = 10.0
"""Without power before a part that wants to see it come: rails, drive and sense modes are at rest by then."""
_SEE_POWER_COME = frozenset({"warmup", "power"})
_SCALE_FACTOR, _U_SCALE_FACTOR = "scale_factor_v_per_deg_s", "scale_factor_u_v_per_deg_s"


class CertificatePart(Struct, frozen=True):
    """A procedure as a part of the whole, with a data sheet's settings as its defaults.

    `roles` must be on the bench beside those that the procedure needs.
    """

    name: str
    conditions: Callable[[Any], str]
    defaults: Mapping[str, Any] = key(default_factory=dict)
    roles: tuple[str, ...] = ()


_WARM = ("warm_up_s", "powered_s")
"""Keys for the time under power before something is measured: 0 for all parts but the first, the session is warm."""


def _line_through(own: Any) -> str:
    return f"line through {len(own.rates_deg_s)} rates to {own.fastest_deg_s:g} deg/s"


PARTS = (
    CertificatePart("warmup", lambda own: f"from power-on, {own.shortest_s:g} s and more, at rest"),
    CertificatePart("polarity", lambda own: f"{own.polarity_rate_deg_s:g} deg/s, {own.polarity_v_vc_v:g} V of V_Vc"),
    CertificatePart(
        "power", lambda own: f"rails moved by {own.rail_step_v:g} V, {own.level_deg_s:g} deg/s by {own.by.value}"
    ),
    CertificatePart("turntable", _line_through),
    CertificatePart(
        "virtual-coriolis", lambda own: f"{_line_through(own)}, V_Vc {'measured' if has_v_vc_meter(own) else 'as set'}"
    ),
    CertificatePart(
        "kvc", lambda own: f"at small rates, matched to {own.fastest_deg_s:g} deg/s, V_Vc {own.v_vc.value}"
    ),
    CertificatePart("bandwidth", lambda own: f"sine of {own.sine_amplitude_v:g} V on V_Vc, at rest"),
    CertificatePart("resonance", lambda _own: "ring-down and sweep, at rest"),
    CertificatePart("phase", lambda own: f"{own.rate_deg_s:g} deg/s and {own.v_vc_v:g} V of V_Vc, both signs"),
    CertificatePart(
        "vibration",
        lambda own: f"{len(own.vibration_hz)} virtual vibrations of {own.vibration_amplitude_v:g} V, at rest",
    ),
    CertificatePart("zero", lambda own: f"at rest, {own.duration_s:g} s", {"duration_s": 600.0}),
    CertificatePart(
        "temperature",
        lambda own: f"{min(own.temperatures_c):g} to {max(own.temperatures_c):g} degC, by {own.by.value}",
        roles=("chamber",),
    ),
)
"""The parts in their order: cold ones before warm ones, and those that heat or cool last."""

_BY_NAME = {each.name: each for each in PARTS}

PartSettings = Annotated[dict[str, Any], said("settings of this part, as [procedure.NAME] has them")]


class CharacterizeSettings(ProcedureSettings, frozen=True, kw_only=True):
    """The parts and their own settings; settings of the whole go to every part."""

    parts: Annotated[tuple[str, ...], several(1, 50, "procedures, in the order in which they are run")] = tuple(
        each.name for each in PARTS
    )
    warmup: PartSettings = key(default_factory=dict)
    polarity: PartSettings = key(default_factory=dict)
    power: PartSettings = key(default_factory=dict)
    turntable: PartSettings = key(default_factory=dict)
    virtual_coriolis: PartSettings = key(default_factory=dict, name="virtual-coriolis")
    kvc: PartSettings = key(default_factory=dict)
    bandwidth: PartSettings = key(default_factory=dict)
    resonance: PartSettings = key(default_factory=dict)
    phase: PartSettings = key(default_factory=dict)
    vibration: PartSettings = key(default_factory=dict)
    zero: PartSettings = key(default_factory=dict)
    temperature: PartSettings = key(default_factory=dict)

    @classmethod
    def keys_of_device(cls, dut: str, devices: str | None = None) -> dict[str, Any]:
        """Return the keys of the part that keeps a certificate."""
        return {"kvc": {"dut": dut} | ({} if devices is None else {"devices": devices})}

    @property
    def named_device(self) -> str | None:
        """The device whose certificate is kept."""
        return self.kvc.get("dut")

    @property
    def devices(self) -> str:
        """The directory of the devices."""
        return cast("DeviceSettings", self.of(_CERTIFIES)).devices

    @property
    def warm_again_s(self) -> float:
        """Waiting time of the first part; the gyroscope is warm for the others."""
        return self.of(self.parts[0]).warm_again_s

    def given(self, name: str) -> dict[str, Any]:
        """Return the own settings of the part `name`."""
        found = getattr(self, name.replace("-", "_"), {})
        return dict(found) if isinstance(found, dict) else {}

    def of(self, name: str) -> ProcedureSettings:
        """Return the settings of the part `name`: its defaults here, those of the whole, its own.

        Raises:
            ConfigError: a key is unknown to it, or a value cannot be.
        """
        kind = PROCEDURES[name].settings
        usual, here = _written(ProcedureSettings()), _written(self)
        first = name == self.parts[0]
        shared = {key: here[key] for key in usual if here[key] != usual[key] and (first or key not in _WARM)}
        warm = {} if first else {key: 0.0 for key in _WARM if key in setting_keys(kind)}
        usually = _BY_NAME[name].defaults if name in _BY_NAME else {}

        def naming(keys: Any) -> str:
            return dotted(("procedure", "characterize", name, *keys))

        layers = [Layer(each, naming) for each in ({**usually, **warm}, shared, self.given(name))]
        own: ProcedureSettings = chosen_settings(kind, layers)
        return structs.replace(own, station=self._station_of(name, own))

    def _station_of(self, name: str, own: ProcedureSettings) -> Station:
        """Return a part's station: its meter's accuracy goes by its own range and integration time.

        The gyroscope is warmed by the first part's waiting, cooled by power cuts since; how long the parts between take
        is not counted, so a little too much is left.
        """
        station, sources, resolution_v = self.station, self.station.sources, self.station.meter_resolution_v
        meter, v_vc_meter = station.sheet_of("multimeter"), station.sheet_of("v_vc_meter")
        range_v, v_vc_range_v = float(own.meter_range_v), float(getattr(own, "v_vc_range_v", V_VC_RANGE_V))
        if v_vc_meter is not None and v_vc_range_v != V_VC_RANGE_V:
            known, days = station.meters.get("v_vc_meter", MeterKnown()), sources.v_vc_meter_age_days
            sources = structs.replace(sources, **meter_worth("v_vc", v_vc_meter, known, v_vc_range_v, days))
        if meter is not None and resolution_v is not None:
            known, days = station.meters.get("multimeter", MeterKnown()), sources.meter_age_days
            sources = structs.replace(sources, **meter_worth("meter", meter, known, range_v, days))
            resolution_v = meter.resolution_v(range_v, float(own.nplc))
        before = self.parts[: self.parts.index(name)] if name in self.parts else ()
        if before and sources.warm_up_k is not None:
            left = math.exp(-self.of(self.parts[0]).warm_again_s / sources.warm_up_time_s)
            cuts = sum(each in _SEE_POWER_COME for each in (*before[1:], name))
            left += cuts * -math.expm1(-_OFF_S / sources.warm_up_time_s)
            sources = structs.replace(sources, warm_up_k=sources.warm_up_k * min(1.0, left))
        return structs.replace(station, meter_resolution_v=resolution_v, sources=sources)

    def made_plain(self) -> Self:
        """Return these settings with those of each part written out, if not the default.

        Raises:
            ConfigError: a key is unknown to a part, or a value cannot be.
        """
        here, written = _written(self), {}
        for part in PARTS:
            own = self.of(part.name)
            usual = _written(type(own)())
            written[part.name.replace("-", "_")] = {
                key: value
                for key, value in _written(own).items()
                if key in part.defaults or (value != usual[key] and (key in _WARM or here.get(key) != value))
            }
        return structs.replace(self, **written)

    def recalled(self) -> Self:
        seen = self.station.characteristics
        for name in self.parts:
            if not self.lacking(name):
                known = self.of(name).recalled().station.characteristics
                seen = known if name == _CERTIFIES else seen
        return self.beside(seen)

    def beside(self, characteristics: dict[str, Any]) -> Self:
        """Return these settings with the device's characteristics that K_Vc depends on."""
        return structs.replace(self, station=structs.replace(self.station, characteristics=characteristics))

    def lacking(self, name: str) -> str:
        """Name the bench's lack for the part `name`; empty where it has all."""
        return self._absent(name) or next(self._not_borne(name, self.of(name).contradictions()), "")

    def _absent(self, name: str) -> str:
        """Name the instruments that the part `name` lacks, and their lacking abilities."""
        procedure = PROCEDURES[name]
        roles = [*procedure.needs, *(_BY_NAME[name].roles if name in _BY_NAME else ())]
        there = set(self.station.instruments) - {"rate_table"}
        there |= {"rate_table"} if self.station.limits.max_rate_deg_s is not None else set()
        if missing := [role for role in roles if role not in there]:
            return f"the bench has no {' and no '.join(missing)}"
        for role, capability in procedure.needs.items():
            placed = self.station.instruments.get(role)
            row = None if placed is None else find_model(placed.model)
            driver = None if row is None else driver_of(row)
            if placed is None or driver is None:
                continue
            if absent := interfaces.lacking(getattr(driver, "driver_class", driver), capability):
                return f"the {role} ({placed.model}) has no {', '.join(absent)}"
        return ""

    def _not_borne(self, name: str, found: Iterable[InvalidValue]) -> Iterator[str]:
        """Yield what this place does not bear of the part `name`: nobody said it."""
        for each in found:
            if keys_of(each.path)[0] not in self.given(name):
                yield f"{each.path}: expected {each.expected}, got {each.came}"

    def contradictions(self) -> Iterator[InvalidValue]:
        yield from super().contradictions()
        for index, name in enumerate(self.parts):
            if name not in PROCEDURES or PROCEDURES[name].settings is type(self):
                yield InvalidValue(f"parts[{index}]", f"a procedure: {', '.join(_BY_NAME)}", name)
                return
            if type(PROCEDURES[name].settings().station) is not Station:
                expected = "a procedure that uses no entry of the device"
                yield InvalidValue(f"parts[{index}]", expected, name)
                return
        if len(set(self.parts)) < len(self.parts):
            yield InvalidValue("parts", "each procedure once", list(self.parts))
        for name in self.parts:
            found = () if self._absent(name) else tuple(self.of(name).contradictions())
            if not any(self._not_borne(name, found)):
                for each in found:
                    yield InvalidValue(f"{name}.{each.path}", each.expected, each.came)


def _written(settings: ProcedureSettings) -> dict[str, Any]:
    """Return the settable values, as a bench file has them."""
    values = cast("dict[str, Any]", to_builtins(settings))
    return {key: values[key] for key in setting_keys(type(settings))}


class BeginPart(Step, Struct, frozen=True):
    """Heading of a part, by its name; results assign the following steps to it."""

    name: str

    def describe(self) -> str:
        return f"Part: {self.name}"

    def command(self, bench: Bench) -> None:
        """Do nothing."""


class _Session(Struct):
    """State of the supply, left on or not by a part that has ended."""

    left_on: bool = False


def plan(settings: CharacterizeSettings) -> Plan:
    """Do the plan of every possible part, with the supply always on; whatever happens, it is off at the end."""
    session = _Session()
    for name in settings.parts:
        if why := settings.lacking(name):
            yield NotChecked(name, why)
    try:
        for name in settings.parts:
            if settings.lacking(name):
                continue
            yield BeginPart(name)
            yield from _kept_on(PROCEDURES[name].plan(settings.of(name)), session)
    finally:
        if session.left_on:
            yield DisableSupply()


def _kept_on(part: Plan, session: _Session) -> Plan:
    """Pass on the steps of a part, but for the last switching off; switching on again changes nothing.

    Switching off is held back until the part asks for something else: then it was not its end, and is done. A step
    that switches on and looks at it, a kind of its own, finds the supply off. Once something has failed, all is done.
    """
    held, failed = False, False
    advance: Callable[[], Step] = partial(next, part)
    while True:
        try:
            step = advance()
        except StopIteration:
            session.left_on = session.left_on or held
            return
        try:
            if held:
                held = False
                yield DisableSupply()
            if type(step) is DisableSupply and not failed:
                held, session.left_on = True, False
                advance = partial(part.send, Done())
                continue
            if isinstance(step, EnableSupply) and session.left_on:
                session.left_on = False
                if type(step) is not EnableSupply:
                    yield DisableSupply()
                    yield Settle(_OFF_S, "rails and gyro come to rest: the power is to be seen coming")
            result: StepResult = yield step
        except BenchError as error:
            failed = True
            advance = partial(cast("Callable[[BenchError], Step]", part.throw), error)
        else:
            advance = partial(part.send, result)


class PartResult(Struct, frozen=True):
    """Outcome of a part: its results, None where its measurements gave none, and then the reason."""

    name: str
    conditions: str
    results: Any
    no_result: str | None = None


class NotMeasured(Struct, frozen=True):
    """A part that this bench does not allow, and the reason."""

    name: str
    reason: str


class CharacterizeResult(Struct, frozen=True):
    """The data sheet, the results of its parts, and the parts not on it."""

    data_sheet: tuple[SheetRow, ...]
    not_measured: tuple[NotMeasured, ...]
    parts: tuple[PartResult, ...]

    def stated(self) -> Iterator[Value | Unstated]:
        """Yield the values of its parts, each under the name of its part; first those of the line, as on the sheet."""
        for part in sorted(self.parts, key=lambda each: each.name != line_of(self.data_sheet)):
            for each in stated(part.results):
                yield structs.replace(each, name=f"{part.name}.{each.name}")


def results(settings: CharacterizeSettings, measured: Measured) -> CharacterizeResult:
    """Compute the results of each part from its own data, and put them together."""
    by_name = {begin.name: part for begin, part in measured.parted(BeginPart)}
    found: dict[str, PartResult] = {}
    last = [name for name in by_name if hasattr(PROCEDURES[name].settings, _SCALE_FACTOR)]
    for name in [*(each for each in by_name if each not in last), *last]:
        found[name] = _part_result(PROCEDURES[name], _with_scale_factor(settings.of(name), found), by_name[name])
    if _CERTIFIES in by_name:
        # The characteristics that K_Vc depends on, as the parts found them, else as known of the device
        made = [typed(settings.station.characteristics, Characteristics)]
        for each in found.values():
            keep = PROCEDURES[each.name].entry
            if isinstance(keep, Keeps) and each.results is not None:
                made.append(keep.found(settings.of(each.name), each.results) or Characteristics())
        seen = cast("dict[str, Any]", to_builtins(together(made)))
        own = _with_scale_factor(settings.beside(seen).of(_CERTIFIES), found)
        found[_CERTIFIES] = _part_result(PROCEDURES[_CERTIFIES], own, by_name[_CERTIFIES])
    parts = tuple(found[name] for name in by_name)
    skipped = tuple(NotMeasured(name, why) for name in settings.parts if (why := settings.lacking(name)))
    failed = tuple(NotMeasured(part.name, part.no_result) for part in parts if part.no_result is not None)
    rows = (row for part in parts for row in sheet_rows(part.name, part.results, part.conditions))
    return CharacterizeResult(tuple(rows), (*skipped, *failed), parts)


def _part_result(procedure: AnyProcedure, own: ProcedureSettings, part: Measured) -> PartResult:
    known = _BY_NAME.get(procedure.name)
    conditions = "" if known is None else known.conditions(own)
    if procedure.in_one_piece and part.broken_off:
        return PartResult(procedure.name, conditions, None, procedure.in_one_piece)
    try:
        return PartResult(procedure.name, conditions, procedure.results(own, part.corrected(own.station.sources)))
    except BenchError as error:
        return PartResult(procedure.name, conditions, None, str(error))


def _with_scale_factor(own: ProcedureSettings, found: Mapping[str, PartResult]) -> ProcedureSettings:
    """Return the settings of a part with the scale factor that another one has found, unless it is told one.

    That of small rates goes before a line's: it is what holds at rest, the slope of a line through a curved output not.
    """
    if not hasattr(own, _SCALE_FACTOR) or getattr(own, _SCALE_FACTOR) is not None:
        return own
    for part in sorted(found.values(), key=lambda each: each.name != _CERTIFIES):
        values = (each for each in stated(part.results) if each.kind and KINDS[each.kind].limit == _SCALE_FACTOR)
        if isinstance(factor := next(values, None), Value) and factor.value:
            u = {_U_SCALE_FACTOR: factor.u} if factor.u and hasattr(own, _U_SCALE_FACTOR) else {}
            return structs.replace(own, **{_SCALE_FACTOR: factor.value}, **u)
    return own


def report(settings: CharacterizeSettings, _measured: Measured, found: CharacterizeResult) -> Report:
    """Report the data sheet."""
    rails = "rails " + " and ".join(f"{rail.voltage_v:+g} V" for rail in settings.rails)
    return data_sheet_report(found.data_sheet, [(each.name, each.reason) for each in found.not_measured], rails)


def entry(settings: CharacterizeSettings, found: CharacterizeResult, made: Provenance) -> NewEntry | None:
    """Return the device entry of the first part that keeps one."""
    for part in found.parts:
        keep = PROCEDURES[part.name].entry
        kept = None if keep is None or part.results is None else keep(settings.of(part.name), part.results, made)
        if kept is not None:
            return kept
    return None


CHARACTERIZE = Procedure(
    name="characterize",
    method=(
        "The procedures of a characterisation are done one after the other in one session, each as by itself; the "
        "data sheet brings their results together."
    ),
    settings=CharacterizeSettings,
    plan=plan,
    results=results,
    report=report,
    needs=roles("multimeter"),
    uses=roles("power", "rate_source", "oscilloscope", "rate_table", "v_vc_meter", "chamber"),
    entry=entry,
)
