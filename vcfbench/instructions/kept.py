"""Entries under a device's name: characteristics that K_Vc depends on, and its flicker, as `zero` found it."""

from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar, cast

from msgspec import Struct, structs, to_builtins

from vcfbench.clock import utc_now
from vcfbench.errors import ConfigError
from vcfbench.files import shown
from vcfbench.instructions.procedure import Provenance
from vcfbench.records import device_values, devices
from vcfbench.station.bounds import said
from vcfbench.station.settings import DeviceSettings

S = TypeVar("S", bound=DeviceSettings)


class KeptSettings(DeviceSettings, frozen=True, kw_only=True):
    """Settings of procedures that keep characteristics of a device."""

    def recalled(self) -> Self:
        """Return these settings with the characteristics of the device; ConfigError: it has no room for more."""
        if self.dut is not None:
            devices.DeviceStore(Path(self.devices)).require_room(self.dut)
        return with_characteristics(super().recalled())


def conditions_of(
    settings: DeviceSettings, made: Provenance, temperature_c: float | None = None
) -> device_values.Conditions:
    """Return the conditions of a measurement, for the device store."""
    positive_v, negative_v = settings.rails_v or (None, None)
    return device_values.Conditions(
        bench=made.bench,
        run=made.run,
        simulated=made.simulated,
        positive_rail_v=positive_v,
        negative_rail_v=negative_v,
        temperature_c=temperature_c,
        instruments=dict(made.instruments),
    )


class Keeps(Struct, frozen=True):
    """Makes the device entry of a procedure; `found` returns that of settings and results, None for nothing."""

    procedure: str
    found: Callable[[Any, Any], device_values.Characteristics | None]

    def __call__(self, settings: Any, results: Any, made: Provenance) -> devices.NewEntry | None:
        """Return the entry, None where no device was named or nothing was found."""
        seen = None if settings.dut is None else self.found(settings, results)
        if seen is None:
            return None

        at_c = seen.temperature_c
        record = devices.Characterisation(
            serial=settings.dut,
            done=made.finished,
            procedure=self.procedure,
            characteristics=seen,
            conditions=conditions_of(settings, made, None if at_c is None else at_c.value),
        )
        return devices.NewEntry(record, Path(settings.devices))


class KnownFlickerSettings(DeviceSettings, frozen=True, kw_only=True):
    """Settings of procedures with the flicker of the device in their budgets."""

    outdated: Annotated[bool, said("also use certificates and records that are out of date")] = False

    def recalled(self) -> Self:
        """Return these settings with characteristics and flicker of the device."""
        return with_characteristics(with_flicker(self, outdated=self.outdated))


def with_characteristics(settings: S) -> S:
    """Return the settings with the characteristics of their device by earlier procedures."""
    if settings.dut is None:
        return settings
    seen = devices.DeviceStore(Path(settings.devices), settings.station.simulated).characteristics(settings.dut)
    plain = {} if seen is None else to_builtins(seen)
    return structs.replace(settings, station=structs.replace(settings.station, characteristics=plain))


def with_flicker(settings: S, *, outdated: bool) -> S:
    """Return the settings with the flicker of their device, where a static record has it; it is assumed no more.

    It goes before what the bench file tells, which is of no one device. ConfigError: the record is out of date, or what
    is known of the device cannot be read.
    """
    serial, now = settings.dut, utc_now()
    entry = (
        None
        if serial is None
        else devices.DeviceStore(Path(settings.devices), settings.station.simulated).static_noise(serial)
    )
    if entry is None:
        return settings
    record, known = cast("devices.StaticNoise", entry.record), settings.station.sources
    require_valid(record, shown(entry.path), now, outdated=outdated)
    found, days = record.bias_instability_deg_h, (now - record.done).days
    sources = structs.replace(
        known,
        bias_instability_deg_h=found.value,
        bias_instability_dof=found.dof,
        bias_instability_from=f"static record {entry.name} of {serial}, {record.done:%Y-%m-%d}, {days} days old, "
        f"u {found.u:.2g} deg/h",
        assumed={key: words for key, words in known.assumed.items() if not key.startswith("bias_instability_")},
    )
    return structs.replace(settings, station=structs.replace(settings.station, sources=sources))


def require_valid(
    record: devices.Certificate | devices.StaticNoise, where: str, now: datetime, *, outdated: bool
) -> None:
    """See that a record is valid `now`, unless an `outdated` one may be used; ConfigError: it is not."""
    if record.valid_at(now) or outdated:
        return
    kind, anew = "certificate", "calibrate K_Vc anew (vcfbench run kvc)"
    if isinstance(record, devices.StaticNoise):
        kind, anew = "static record", f"record the noise anew (vcfbench run zero --dut {record.serial})"
    since = record.issued if isinstance(record, devices.Certificate) else record.done
    until = "" if record.valid_until is None else f" to {record.valid_until:%Y-%m-%d %H:%M}"
    raise ConfigError(
        f"{where}: the {kind} is valid from {since:%Y-%m-%d %H:%M}{until}, not now",
        hint=f"{anew}; --set outdated=true uses it nevertheless",
    )
