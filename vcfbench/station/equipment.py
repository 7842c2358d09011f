"""The instruments of a bench with the dates of their calibration, as a run finds them on its day."""

from collections.abc import Collection, Iterator, Mapping
from datetime import date

from vcfbench.interfaces import Identity
from vcfbench.records.metadata import Equipment
from vcfbench.station.description import BenchDescription


def equipment_on(
    day: date, description: BenchDescription, roles: Collection[str], identities: Mapping[str, Identity]
) -> tuple[Equipment, ...]:
    """Return the instruments in `roles` of the bench, with their identities where they were asked."""
    found = []
    for role in roles:
        part, identity = getattr(description, role), identities.get(role)
        due = part.calibration_due
        # The serial number that was answered, else the bench file's; an instrument that has none answers 0
        numbers = ("" if identity is None else identity.serial, getattr(part, "serial_number", None))
        instrument = Equipment(
            role=role,
            model=part.model or part.dialect,
            resource=part.resource,
            identity=identity,
            serial_number=next((each for each in numbers if each not in (None, "", "0")), None),
            inventory_number=part.inventory_number,
            calibrated=part.calibrated,
            calibration_due=due,
            certificate=part.certificate,
            overdue=due is not None and day > due,
        )
        found.append(instrument)
    return tuple(found)


def overdue_words(equipment: Collection[Equipment]) -> Iterator[str]:
    """Yield a warning for each instrument whose calibration is overdue."""
    for each in equipment:
        if each.overdue:
            yield f"{each.role} ({each.model}, {each.resource}): its calibration was due {each.calibration_due}"


def calibration_words(equipment: Equipment) -> str:
    """Return the state of an instrument's calibration: ``due 2027-01-15``."""
    if equipment.overdue:
        return f"OVERDUE since {equipment.calibration_due}"
    if equipment.calibration_due is not None:
        return f"due {equipment.calibration_due}"
    return "-" if equipment.calibrated is None else f"calibrated {equipment.calibrated}"
