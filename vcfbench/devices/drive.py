"""The drive's frequency as a thermometer: at which temperature values hold, and how far that moved during a run."""

import math
from collections.abc import Iterator

from msgspec import structs

from vcfbench.devices.thermometer import rise_by_drive, thermometer
from vcfbench.records.device_values import Characteristics
from vcfbench.station.settings import ProcedureSettings
from vcfbench.steps import DriveFrequency, DriveReading
from vcfbench.steps.measured import Measured
from vcfbench.typed import typed
from vcfbench.uncertainty.oscilloscope import TIME_BASE
from vcfbench.values.definition import Drive

_SIGMAS = 3.0


def drive_of(settings: ProcedureSettings, measured: Measured) -> Drive | None:
    """Return the drive's frequency by the records before and after all points; None: there are none.

    The time base is in the frequency and not in its change. Of several checks the last counts; none where they come
    before the warm-up, or where the temperature is changed.
    """
    looks = [each.fitted for _, each in measured.found(DriveReading) if each.fitted is not None]
    again = [each for _, each in measured.found(DriveFrequency) if not each.trouble]
    seen = [*(looks[-1:] if settings.checked_warm else []), *again[-1:]]
    if not seen:
        return None
    middle_hz = sum(each.frequency_hz for each in seen) / len(seen)
    u_hz = math.hypot(*(each.u_hz for each in seen)) / len(seen)
    known = characteristics_of(settings)
    whole_u_hz = math.hypot(u_hz, TIME_BASE / math.sqrt(3.0) * middle_hz)
    if (per_k := thermometer(known.drive_ppm_k)) is None:
        return Drive(middle_hz, whole_u_hz)
    found = Drive(middle_hz, whole_u_hz, assumed="" if known.drive_ppm_k else f"{per_k.value:g} ppm/K assumed")
    if len(seen) > 1:
        first, last = ((each.frequency_hz, each.u_hz) for each in seen)
        moved_k, u_moved_k = rise_by_drive(first, last, per_k)
        found = structs.replace(found, moved_k=moved_k, u_moved_k=u_moved_k)
    if known.drive_hz and known.drive_ppm_k and known.temperature_c:
        then = known.drive_hz.value, known.drive_hz.u
        rise_k, u_k = rise_by_drive(then, (middle_hz, whole_u_hz), per_k)
        at_c, u_k = known.temperature_c.value + rise_k, math.hypot(known.temperature_c.u, u_k)
        found = structs.replace(found, temperature_c=at_c, u_temperature_k=u_k)
    return found


def characteristics_of(settings: ProcedureSettings) -> Characteristics:
    """Return the characteristics of the device by earlier runs, of those in the settings."""
    of_certificate: Characteristics | None = getattr(getattr(settings.station, "known", None), "characteristics", None)
    return of_certificate or typed(settings.station.characteristics, Characteristics)


def drive_remarks(settings: ProcedureSettings, measured: Measured, drive: Drive | None) -> Iterator[str]:
    """Yield the remarks of a report on the drive: a last record that failed, and a device that warmed too much."""
    yield from (f"the drive once more: {each.trouble}" for _, each in measured.found(DriveFrequency) if each.trouble)
    if drive and (said := beyond_bearing(settings, drive)):
        yield said


def beyond_bearing(settings: ProcedureSettings, drive: Drive) -> str:
    """Return a remark on a temperature that moved beyond the uncertainties, else nothing."""
    known = settings.station.sources
    borne_k = (known.temperature_k or 0.0) + (known.warm_up_k or 0.0)
    if drive.moved_k is None or abs(drive.moved_k) - _SIGMAS * (drive.u_moved_k or 0.0) <= borne_k:
        return ""
    return (
        f"The device's temperature moved by {drive.moved_k:+.1f} K during the run, by its drive's frequency; the "
        f"uncertainties hold {borne_k:g} K (uncertainty.temperature_k and warm_up_k)"
    )
