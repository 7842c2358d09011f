"""Opens one instrument of a bench and makes sure that it is the one meant."""

from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from msgspec import structs

from vcfbench.bench.ground import UnopenedBench
from vcfbench.drivers.hands import BY_HAND
from vcfbench.drivers.registry import open_instrument
from vcfbench.drivers.streams.shared import sharing
from vcfbench.drivers.together import Outputs, kept
from vcfbench.errors import BenchError
from vcfbench.interfaces import Identity, Instrument
from vcfbench.station.description import CALIBRATION_KEYS, BenchDescription


def open_role(
    role: str, description: BenchDescription, stand: UnopenedBench, **more: Any
) -> tuple[Instrument, Identity]:
    """Open the instrument of `role` and ask for its identity; another than the one meant is closed again, untouched.

    Its driver's settings are those of the bench file, and those of the station that it needs; `more` come before them.

    Raises:
        ConnectFailed: nobody answers.
        WrongInstrument: another model or another specimen answers.
    """
    if role == "multimeter" and description.several:
        return _outputs(description, stand, more)
    part = getattr(description, role)
    if role in description.by_hand:
        made = BY_HAND[role](role, part, stand.hands, structs.asdict(description.limits))
        return made, made.identify()
    settings = structs.asdict(part)
    for key in (*CALIBRATION_KEYS, "by", "resolution_v"):
        settings.pop(key, None)
    if role in {"multimeter", "v_vc_meter"}:
        settings["mains_hz"] = float(description.site.mains_hz)
    if role == "rate_table":
        limits = description.limits
        settings |= {"model": settings.pop("dialect"), "max_rate_deg_s": limits.max_rate_deg_s}
        settings["max_acceleration_deg_s2"] = limits.max_acceleration_deg_s2
    settings |= more
    model, resource, like = settings.pop("model"), settings.pop("resource"), settings.pop("like", None)
    if role == "rate_table" and stand.rate_table != resource:  # its wire is elsewhere, messages name the bench file's
        settings["port"] = stand.rate_table
    name = role
    if role == "multimeter" and description.stream:
        name = "stream"  # for messages: no meter reads it
        settings = {"stream": description.stream, "port": stand.streams.get(resource)} | more
    instrument = open_instrument(
        name, model, resource, library=stand.visa_library, clock=stand.clock, settings=settings, like=like
    )
    try:
        return instrument, instrument.identify()
    except BenchError:
        with suppress(BenchError):  # the first error tells more than that the connection did not close either
            instrument.close()
        raise


def _outputs(
    description: BenchDescription, stand: UnopenedBench, more: Mapping[str, Any]
) -> tuple[Instrument, Identity]:
    """Open the output of each of several gyroscopes; fields of one stream share its connection.

    One that does not answer is told to the person at the bench, and costs the others nothing.
    """
    shared = {"shared": sharing()} if description.stream else {}
    opened: dict[str, Any] = {}
    found: dict[str, Identity] = {}
    missing: dict[str, BenchError] = {}
    try:
        for name in description.several:
            with kept(missing, name):
                opened[name], found[name] = open_role(
                    "multimeter", description.of_device(name), stand, **shared, **more
                )
    except BaseException:
        for each in opened.values():
            with suppress(BenchError):
                each.close()
        raise
    if not opened:
        raise BenchError.joined(missing)
    made: Any = Outputs(opened, found, missing)
    return made, made.identify()
