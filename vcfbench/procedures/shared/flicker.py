"""The flicker of a device, as a static record found it: kept in the device store by `zero`, taken from there later."""

from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar, cast

from msgspec import structs

from vcfbench.clock import utc_now
from vcfbench.errors import ConfigError
from vcfbench.files import shown
from vcfbench.records.devices import DeviceStore, StaticNoise
from vcfbench.station.bounds import said
from vcfbench.station.settings import DeviceSettings

S = TypeVar("S", bound=DeviceSettings)


class KnownFlickerSettings(DeviceSettings, frozen=True, kw_only=True):
    """Settings of procedures with the flicker of the device in their budgets."""

    outdated: Annotated[bool, said("whether what is known may be used that is out of date")] = False

    def recalled(self) -> Self:
        """Return these settings with the flicker of the device."""
        return with_flicker(self, outdated=self.outdated)


def with_flicker(settings: S, *, outdated: bool) -> S:
    """Return the settings with the flicker of their device, where a static record has it; it is assumed no more.

    ConfigError: the record is out of date, or what is known of the device cannot be read.
    """
    if settings.dut is None:
        return settings
    found = flicker_sources(DeviceStore(Path(settings.devices)), settings.dut, utc_now(), outdated=outdated)
    known = settings.station.sources
    left = {key: words for key, words in known.assumed.items() if key not in found}
    station = structs.replace(settings.station, sources=structs.replace(known, **found, assumed=left))
    return structs.replace(settings, station=station)


def flicker_sources(store: DeviceStore, serial: str, now: datetime, *, outdated: bool) -> Mapping[str, Any]:
    """Return the known flicker of a device by the keys of `Sources`; nothing without a static record.

    It goes before what the bench file tells, which is of no one device. ConfigError: the record is out of date, or what
    is known of the device cannot be read.
    """
    entry = store.static_noise(serial)
    if entry is None:
        return {}
    record = cast("StaticNoise", entry.record)
    if not (record.valid_at(now) or outdated):
        until = "" if record.valid_until is None else f" to {record.valid_until:%Y-%m-%d %H:%M}"
        raise ConfigError(
            f"{shown(entry.path)}: the static record is valid from {record.done:%Y-%m-%d %H:%M}{until}, not now",
            hint=f"record the noise anew (vcfbench run zero --dut {serial}); --set outdated=true takes it all the same",
        )
    found, days = record.bias_instability_deg_h, (now - record.done).days
    said = f"static record {entry.name} of {serial}, {record.done:%Y-%m-%d}, {days} days old, u {found.u:.2g} deg/h"
    return {
        "bias_instability_deg_h": found.value,
        "bias_instability_dof": found.dof,
        "bias_instability_from": said,
    }
