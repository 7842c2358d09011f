"""What a procedure finds of what K_Vc depends on, kept under the device's name for its next certificate."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Protocol

from msgspec import Meta

from vcfbench.bench.settings import ProcedureSettings

if TYPE_CHECKING:
    from typing import Self

    from vcfbench.procedures.procedure import Provenance
    from vcfbench.record.devices import Characteristics, NewEntry

__all__ = ["KeptSettings", "kept", "require_room"]


class KeptSettings(ProcedureSettings, frozen=True, kw_only=True):
    """What procedures are told that keep what they find of a device."""

    dut: Annotated[
        Annotated[str, Meta(min_length=1, max_length=200)] | None,
        Meta(description="serial number of the gyroscope, as --dut: what K_Vc depends on is kept under it"),
    ] = None
    devices: Annotated[
        str, Meta(min_length=1, description="directory of what is known of the devices", extra={"option": True})
    ] = "devices"

    @classmethod
    def keys_of_device(cls, dut: str) -> dict[str, Any]:
        """Return the key of the device."""
        return {"dut": dut}

    @property
    def named_device(self) -> str | None:
        """The device under whose serial number it is kept."""
        return self.dut

    def recalled(self) -> Self:
        """See that it can be kept under the device's name, where one is given."""
        require_room(self)
        return self


class _Named(Protocol):
    @property
    def dut(self) -> str | None: ...
    @property
    def devices(self) -> str: ...
    @property
    def positive_rail_v(self) -> float: ...
    @property
    def negative_rail_v(self) -> float: ...


def require_room(settings: _Named) -> None:
    """See that an entry can be kept under the device's name, where one is given; ConfigError where none can."""
    if settings.dut is not None:
        from vcfbench.record.devices import DeviceStore  # noqa: PLC0415  # few name a device

        DeviceStore(Path(settings.devices)).require_room(settings.dut)


def kept(settings: _Named, made: Provenance, procedure: str, seen: Characteristics) -> NewEntry | None:
    """Return the entry of what was found, None where no device was named."""
    if settings.dut is None:
        return None
    from vcfbench.record.devices import Characterisation, Conditions, NewEntry  # noqa: PLC0415  # as above

    at_c = seen.temperature_c
    conditions = Conditions(
        bench=made.bench,
        run=made.run,
        simulated=made.simulated,
        positive_rail_v=settings.positive_rail_v,
        negative_rail_v=settings.negative_rail_v,
        temperature_c=None if at_c is None else at_c.value,
        instruments=dict(made.instruments),
    )
    record = Characterisation(
        serial=settings.dut, done=made.finished, procedure=procedure, characteristics=seen, conditions=conditions
    )
    return NewEntry(record, Path(settings.devices))
