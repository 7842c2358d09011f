"""The temperature of the room by an instrument of the bench: the chamber's sensor, as long as no air flows past it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from msgspec.structs import replace

from vcfbench.errors import ConfigError, MeasurementError

if TYPE_CHECKING:
    from vcfbench.bench.bench import Bench
    from vcfbench.records.metadata import RunMetadata
    from vcfbench.station.description import BenchDescription


def require_ambient(metadata: RunMetadata, description: BenchDescription) -> None:
    """Raise ConfigError when the bench lacks the instrument that shall tell the temperature of the room."""
    if metadata.ambient_from is not None and getattr(description, metadata.ambient_from) is None:
        raise ConfigError(
            f"ambient_from: the {metadata.ambient_from} shall tell the temperature of the room, and bench "
            f"{description.name} has none",
            hint="--ambient-temperature-c takes degC as well",
        )


def with_ambient(metadata: RunMetadata, bench: Bench) -> RunMetadata:
    """Return the metadata of the run, with the temperature of the room where an instrument shall tell it.

    Raises:
        MeasurementError: air flows, so that its temperature is not that of the room.
    """
    if metadata.ambient_from is None or metadata.ambient_temperature_c is not None:
        return metadata
    chamber = bench.chamber
    if chamber.flow_enabled():
        raise MeasurementError(
            "air flows, its temperature is not that of the room", instrument=chamber.name, resource=chamber.resource
        )
    return replace(metadata, ambient_temperature_c=chamber.air_temperature_c())
