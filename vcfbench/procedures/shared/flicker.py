"""The flicker of a device, as a static record found it: kept in the device store by `zero`, taken from there later."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from msgspec import Meta, structs

from vcfbench.clock import utc_now
from vcfbench.errors import ConfigError
from vcfbench.files import shown
from vcfbench.station.settings import DeviceSettings

if TYPE_CHECKING:
    from collections.abc import Mapping
    from datetime import datetime
    from typing import Self

    from vcfbench.records.devices import DeviceStore
    from vcfbench.station.settings import Sources


class KnownFlickerSettings(DeviceSettings, frozen=True, kw_only=True):
    """Settings of procedures with the flicker of the device in their budgets."""

    outdated: Annotated[bool, Meta(description="whether what is known may be used that is out of date")] = False

    def recalled(self) -> Self:
        """Return these settings with the flicker of the device, where a static record has told it.

        Raises:
            ConfigError: it is out of date, or what is known of the device cannot be read.
        """
        if self.dut is None:
            return self
        from vcfbench.records.devices import DeviceStore  # noqa: PLC0415  # few runs name a device

        found = flicker_sources(DeviceStore(Path(self.devices)), self.dut, utc_now(), outdated=self.outdated)
        sources = with_flicker(self.station.sources, found)
        return structs.replace(self, station=structs.replace(self.station, sources=sources))


def with_flicker(sources: Sources, found: Mapping[str, Any]) -> Sources:
    """Return `sources` with the flicker that was `found`, if any was; it is assumed no more."""
    if not found:
        return sources
    left = {key: words for key, words in sources.assumed.items() if key not in found}
    return structs.replace(sources, **found, assumed=left)


def flicker_sources(store: DeviceStore, serial: str, now: datetime, *, outdated: bool) -> Mapping[str, Any]:
    """Return the known flicker of a device by the keys of `Sources`; nothing without a static record.

    It goes before what the bench file tells, which is of no one device.

    Raises:
        ConfigError: the record is out of date, or what is known of the device cannot be read.
    """
    from vcfbench.records.devices import StaticNoise  # noqa: PLC0415  # as above

    entry = store.static_noise(serial)
    if entry is None:
        return {}
    record = entry.record
    assert isinstance(record, StaticNoise)  # noqa: S101  # the store says so
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
