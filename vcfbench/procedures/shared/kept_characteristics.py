"""Characteristics that K_Vc depends on, kept under the device's name for its next certificate."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

from msgspec import Struct

from vcfbench.procedures.procedure import Provenance
from vcfbench.records.devices import Characterisation, Characteristics, Conditions, DeviceStore, NewEntry
from vcfbench.station.settings import DeviceSettings


class KeptSettings(DeviceSettings, frozen=True, kw_only=True):
    """Settings of procedures that keep characteristics of a device."""

    def recalled(self) -> Self:
        """See that it can be kept under the device's name, where one is given."""
        if self.dut is not None:
            DeviceStore(Path(self.devices)).require_room(self.dut)
        return self


def conditions_of(settings: DeviceSettings, made: Provenance, temperature_c: float | None = None) -> Conditions:
    """Return the conditions of a measurement, for the device store."""
    return Conditions(
        bench=made.bench,
        run=made.run,
        simulated=made.simulated,
        positive_rail_v=settings.positive_rail_v,
        negative_rail_v=settings.negative_rail_v,
        temperature_c=temperature_c,
        instruments=dict(made.instruments),
    )


class Keeps(Struct, frozen=True):
    """Makes the device entry of a procedure; `found` returns that of settings and results, None for nothing."""

    procedure: str
    found: Callable[[Any, Any], Characteristics | None]

    def __call__(self, settings: Any, results: Any, made: Provenance) -> NewEntry | None:
        """Return the entry, None where no device was named or nothing was found."""
        seen = None if settings.dut is None else self.found(settings, results)
        if seen is None:
            return None

        at_c = seen.temperature_c
        record = Characterisation(
            serial=settings.dut,
            done=made.finished,
            procedure=self.procedure,
            characteristics=seen,
            conditions=conditions_of(settings, made, None if at_c is None else at_c.value),
        )
        return NewEntry(record, Path(settings.devices))
