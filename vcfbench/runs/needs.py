"""Match of a bench with the needs of a run: roles, capabilities, the thermometer of the room."""

from collections.abc import Sequence

from msgspec.structs import replace

from vcfbench.bench.bench import Bench
from vcfbench.drivers.hands import BY_HAND
from vcfbench.drivers.registry import find_driver
from vcfbench.errors import ConfigError, MeasurementError
from vcfbench.instructions.procedure import AnyProcedure
from vcfbench.interfaces import lacking
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.layers import settings_of
from vcfbench.records.metadata import RunMetadata
from vcfbench.safety.roles import needed_roles
from vcfbench.station.description import BenchDescription

AS_SET = "as it is set"
"""What a procedure lacks whose settings the bench does not bear."""


def require_needs(procedure: AnyProcedure, description: BenchDescription) -> None:
    """Raise ConfigError when the bench lacks an instrument that `procedure` needs, or one lacks a capability.

    Raises:
        ConfigError: it has not; procedure, bench, and what its bench file lacks are in the words.
    """
    if description.stream and not procedure.streams:
        able = ", ".join(name for name, each in PROCEDURES.items() if each.streams)
        raise ConfigError(
            f"{procedure.name} needs an output that is a voltage, or V_Vc, and that of bench {description.name} is a "
            "stream of numbers ([gyro.stream])",
            hint=f"of a stream there are {able}",
        )
    missing = [role for role in procedure.needs if getattr(description, role, None) is None]
    if missing:
        tables = ", ".join(f"[{role}]" for role in missing)
        coming = ': it measures how the device comes on, which a person may switch (by = "hand")'
        raise ConfigError(
            f"{procedure.name} needs {_listed(missing)}, which bench {description.name} does not have",
            hint=f"its bench file needs {'a table' if len(missing) == 1 else 'the tables'} {tables}"
            + (coming if "power" in missing else "")
            + (", or [gyro.stream] of a digital output" if procedure.streams and "multimeter" in missing else ""),
        )
    if procedure.either and all(getattr(description, role, None) is None for role in procedure.either):
        raise ConfigError(
            f"{procedure.name} needs {' or '.join(procedure.either)}, and bench {description.name} has neither",
            hint=f"its bench file needs a table {' or '.join(f'[{role}]' for role in procedure.either)}",
        )
    for role, capability in (*procedure.needs.items(), *procedure.either.items(), *procedure.uses.items()):
        if getattr(description, role, None) is not None:
            part = getattr(description, role)
            model = part.dialect if role == "rate_table" else part.model
            if role in description.by_hand:
                kind = BY_HAND[role]
            else:
                kind = find_driver(model, None if role == "rate_table" else part.like).driver_class
            if absent := lacking(kind, capability):
                raise ConfigError(
                    f"{procedure.name} needs {capability.__name__}, and the driver of {model} has no {_listed(absent)}",
                    instrument=role,
                    resource=part.resource,
                    hint=f"put another model into the bench file of {description.name}",
                )


def require_several(procedure: AnyProcedure, description: BenchDescription) -> None:
    """Raise ConfigError when several devices cannot be measured together by `procedure`."""
    if not procedure.several:
        able = ", ".join(name for name, each in PROCEDURES.items() if each.several)
        raise ConfigError(
            f"{procedure.name} needs separate steps for each device, and bench {description.name} has "
            f"{len(description.several)} ([[device]])",
            hint=f"of several at once there are {able}; else a bench file for each device alone",
        )


def with_duts(description: BenchDescription, dut: str | None) -> BenchDescription:
    """Return the bench with its several devices by the serial numbers `dut`, with commas between them.

    Raises:
        ConfigError: there are more or fewer of them, or one twice.
    """
    names = [] if dut is None else dut.split(",")
    devices = description.devices or ()
    if not names or (len(names) == 1 and not devices):
        return description
    if len(names) != len(devices) or len({*names}) < len(names):
        wanted = f"{len(devices)} serial numbers with commas between them, one for each [[device]]"
        raise ConfigError(f"dut: expected {wanted if devices else 'one serial number'}, got {dut!r}")
    return replace(
        description, devices=tuple(replace(each, name=name) for each, name in zip(devices, names, strict=True))
    )


def what_can_run(description: BenchDescription, not_ready: Sequence[str] = ()) -> dict[str, str | None]:
    """Return for every known procedure the bench's lack for it, or its settings', in words; None where it can run.

    `not_ready` are roles, and the watchdog, that were tried and are not.
    """
    lacks: dict[str, str | None] = {}
    for name, procedure in PROCEDURES.items():
        try:
            require_needs(procedure, description)
            if description.several:
                require_several(procedure, description)
        except ConfigError as error:
            lacks[name] = error.what
            continue
        try:
            settings_of(procedure, description, recalled=False)
        except ConfigError as error:
            lacks[name] = f"{name} {AS_SET}: {error.what}"
            continue
        opened = ["watchdog", *(each.name for each in needed_roles(description, roles_of(procedure, description)))]
        failed = [each for each in not_ready if each.partition(" of ")[0] in opened]
        lacks[name] = f"{name} opens {_listed(failed)}, not ready" if failed else None
    return lacks


def roles_of(procedure: AnyProcedure, description: BenchDescription) -> tuple[str, ...]:
    """Return the roles that a run of `procedure` opens on this bench, in addition to actuators."""
    there = (role for role in (*procedure.either, *procedure.uses) if getattr(description, role, None) is not None)
    return (*procedure.needs, *there)


def _listed(names: list[str] | tuple[str, ...]) -> str:
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


def require_ambient(metadata: RunMetadata, description: BenchDescription) -> None:
    """Raise ConfigError if the bench lacks the instrument that reads the room's temperature."""
    if metadata.ambient_from is not None and getattr(description, metadata.ambient_from) is None:
        raise ConfigError(
            f"ambient_from: the {metadata.ambient_from} should read the temperature of the room, but bench "
            f"{description.name} has none",
            hint="--ambient-temperature-c takes degC as well",
        )


def with_ambient(metadata: RunMetadata, bench: Bench) -> RunMetadata:
    """Return the metadata of the run, with the room's temperature if an instrument reads it.

    Raises:
        MeasurementError: air flows, so that its temperature is not that of the room.
    """
    if metadata.ambient_from is None or metadata.ambient_temperature_c is not None:
        return metadata
    chamber = bench.chamber
    if chamber.flow_enabled():
        raise MeasurementError(
            "air flows, so the chamber does not read the temperature of the room",
            instrument=chamber.name,
            resource=chamber.resource,
        )
    return replace(metadata, ambient_temperature_c=chamber.air_temperature_c())
