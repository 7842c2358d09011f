"""Opens one instrument of a bench and makes sure that it is the one meant."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

from msgspec import structs

from vcfbench.errors import BenchError, WrongInstrument

if TYPE_CHECKING:
    from vcfbench.bench.description import BenchDescription
    from vcfbench.bench.station import Station
    from vcfbench.interfaces import Identity, Instrument

__all__ = ["open_role"]


def open_role(role: str, description: BenchDescription, stand: Station) -> tuple[Instrument, Identity]:
    """Open the instrument of `role` and ask who it is; what is not the one meant is closed again, untouched.

    Raises:
        ConnectFailed: nobody answers.
        WrongInstrument: another model or another specimen answers.
    """
    instrument = _open(role, description, stand)
    try:
        identity = instrument.identify()
        _require_specimen(role, description, identity, instrument)
    except BenchError:
        with suppress(BenchError):  # the first error tells more than that the connection did not close either
            instrument.close()
        raise
    return instrument, identity


def _open(role: str, description: BenchDescription, stand: Station) -> Instrument:
    from vcfbench.drivers.registry import open_instrument  # noqa: PLC0415

    part = getattr(description, role)
    settings = structs.asdict(part)
    model = settings.pop("model", None) or settings.pop("dialect")
    resource = settings.pop("resource")
    return open_instrument(
        role,
        model,
        stand.rate_table if role == "rate_table" else resource,
        library=stand.visa_library,
        clock=stand.clock,
        settings=settings,
    )


def _require_specimen(role: str, description: BenchDescription, identity: Identity, instrument: Instrument) -> None:
    wanted = getattr(getattr(description, role), "serial_number", None)
    if wanted is not None and identity.serial != wanted:
        raise WrongInstrument(
            f"expected the {identity.model} with serial number {wanted}, number {identity.serial} answers",
            instrument=instrument.name,
            resource=instrument.resource,
        )
