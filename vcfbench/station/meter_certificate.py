"""A voltmeter of a bench file with the values of its certificate, which must be that of the same instrument."""

from __future__ import annotations

from typing import TYPE_CHECKING

from msgspec import structs

from vcfbench.station.meter_dcc import read_meter_dcc
from vcfbench.station.strict import refusal

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench.station.description import MultimeterRole
    from vcfbench.station.meter_dcc import MeterCertificate


def with_certificate(part: MultimeterRole, role: str, source: str, folder: Path) -> MultimeterRole:
    """Return a meter with the points, the number and the day of the certificate that it names, found from `folder`.

    Raises:
        ConfigError: the file is not understood, is of another instrument, or contradicts what stands beside it.
    """
    found = read_meter_dcc(folder / str(part.calibration_dcc))
    where = f"{source}: {role}"
    if part.calibration:
        raise refusal(f"{where}.calibration", "nothing beside calibration_dcc, which holds the table", "one more")
    _require_same(found, part, where)
    beside = (("certificate", part.certificate, found.number), ("calibrated", part.calibrated, found.calibrated))
    for key, stated, own in beside:
        if stated is not None and stated != own:
            raise refusal(f"{where}.{key}", f"{own}, as calibration_dcc has it, or nothing", str(stated))
    return structs.replace(
        part, calibration=found.points, certificate=found.number, calibrated=found.calibrated, calibration_dcc=None
    )


def _require_same(found: MeterCertificate, part: MultimeterRole, where: str) -> None:
    """See that the certificate is that of the instrument: by its model, and by each number that both tell."""
    models = [_plain(each) for each in (part.model, part.like) if each is not None]
    if found.model and not any(each in _plain(found.model) or _plain(found.model) in each for each in models):
        raise refusal(f"{where}.calibration_dcc", f"the certificate of a {part.model}", f"that of {found.said()}")
    serial = None if part.serial_number == "0" else part.serial_number
    numbers = {"serial_number": serial, "inventory_number": part.inventory_number}
    stated = {key: each for key, each in numbers.items() if each is not None}
    if not stated:
        expected = f"the number of the instrument as its certificate has it: {found.said()}"
        raise refusal(f"{where}.inventory_number (or serial_number)", expected, "nothing")
    known = {_plain(number) for _, number in found.numbers}
    by_maker = any(issuer == "manufacturer" for issuer, _ in found.numbers)
    matched = [_plain(each) in known for each in stated.values()]
    if not any(matched) or (serial is not None and by_maker and _plain(serial) not in known):
        said = " and ".join(f"{key} {each}" for key, each in stated.items())
        raise refusal(f"{where}.calibration_dcc", f"the certificate of {said}", f"that of {found.said()}")


def _plain(text: str) -> str:
    """Return letters and digits alone: spaces and dashes are written as one likes."""
    return "".join(filter(str.isalnum, text)).lower()
