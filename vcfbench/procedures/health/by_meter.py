"""What the multimeter tells of what K_Vc depends on: the amplitudes of carrier and drive, its leads moved there."""

from __future__ import annotations

import math
from statistics import fmean, stdev
from typing import TYPE_CHECKING

from vcfbench.plans.step import answer
from vcfbench.plans.steps import AcMeasured, ConfigureMeter, MeasureAc, NotChecked, Note, move_leads
from vcfbench.procedures.measurand import Measurand, UncertaintyPart, measurand
from vcfbench.specifications import AC_VOLTS

if TYPE_CHECKING:
    from vcfbench.plans.measured import Measured
    from vcfbench.plans.step import Routine
    from vcfbench.procedures.known.v_vc import KnownVvcSettings
    from vcfbench.record.devices import Characteristics

_READINGS = 8
_BETWEEN = 3e-5
"""By which a 34401A may drift between its readings of drive and carrier, in a few minutes (assumed), rectangular."""


def compared_amplitudes(settings: KnownVvcSettings) -> Routine[None]:
    """Have the leads of the multimeter moved to drive and carrier and back, and read the AC volts of both."""
    model = settings.station.instruments["multimeter"].model
    if model not in AC_VOLTS:
        yield NotChecked("amplitudes of drive and carrier", f"nothing is known of the AC volts of a {model}")
        return
    yield Note("Health: amplitudes of drive and carrier, by the multimeter")
    expected_v = fmean(settings.drive.amplitude_v) / math.sqrt(2.0)
    yield move_leads("multimeter", "carrier")
    carrier = answer((yield MeasureAc("carrier", _READINGS, expected_v)), AcMeasured)
    yield move_leads("multimeter", "drive")
    drive = answer((yield MeasureAc("drive", _READINGS, expected_v)), AcMeasured)
    if drive.range_v < carrier.range_v:
        yield MeasureAc("drive", _READINGS, expected_v, carrier.range_v)
    yield move_leads("multimeter", "output")
    yield ConfigureMeter(float(settings.meter_range_v), float(settings.nplc))


def same_oscilloscope(settings: KnownVvcSettings, then: Characteristics) -> bool:
    """Tell whether the bench has the oscilloscope that saw the amplitudes of the certificate, beyond doubt."""
    placed, seen = settings.station.instruments.get("oscilloscope"), then.carrier_amplitude_v
    return placed is not None and seen is not None and any(share.of == placed.owner for share in seen.shares)


def carrier_over_drive(settings: KnownVvcSettings, measured: Measured) -> Measurand | None:
    """Return the carrier's amplitude over the drive's; None where they were not read.

    The drive on both ranges tells what the carrier's range is off against the other; the error of range is taken to be
    one of its zero. What is left goes with how far the two levels are apart, and cancels with the same meter later.
    """
    seen = [(step, each) for step, each in measured.found(AcMeasured) if isinstance(step, MeasureAc)]
    if not seen:
        return None
    carrier, drive, *again = [each for _, each in seen]
    carrier_v, drive_v = fmean(carrier.voltages_v), fmean(drive.voltages_v)
    if again:
        carrier_v -= fmean(again[0].voltages_v) - drive_v
    scatter = [stdev(each.voltages_v) / math.sqrt(_READINGS) / carrier_v for each in (carrier, *again)]
    scatter.append(stdev(drive.voltages_v) / math.sqrt(_READINGS) / drive_v)
    placed = settings.station.instruments["multimeter"]
    limit = AC_VOLTS[placed.model]
    compared = bool(again) or carrier.range_v == drive.range_v
    apart = abs(1.0 - drive_v / carrier_v) if compared else 1.0
    limits = {f"zero of AC volts, {drive.range_v:g} V range": limit.range * drive.range_v / drive_v * apart}
    if not compared:
        limits[f"zero of AC volts, {carrier.range_v:g} V range"] = limit.range * carrier.range_v / carrier_v
    if carrier.range_v != drive.range_v:
        limits |= {f"gain of AC volts, {each.range_v:g} V range": limit.reading * apart for each in (carrier, drive)}
    ratio = carrier_v / drive_v
    return measurand(
        ratio,
        "",
        [
            UncertaintyPart("records", ratio * math.hypot(*scatter), len(scatter) * (_READINGS - 1)),
            UncertaintyPart("drift between two readings", ratio * _BETWEEN / math.sqrt(3.0)),
            *(UncertaintyPart(name, ratio * each / math.sqrt(3.0), of=placed.owner) for name, each in limits.items()),
        ],
    )
