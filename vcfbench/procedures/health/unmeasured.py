"""Possible changes of K_Vc that nobody measured: their part of its U95, and its missing contributions."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from typing import Final

from msgspec import structs

from vcfbench.procedures.shared.budget import phases
from vcfbench.procedures.shared.known.device import KnownDeviceSettings
from vcfbench.procedures.shared.known.k_vc_change import ASSUMED, k_vc_change
from vcfbench.procedures.shared.measurand import UncertaintyPart
from vcfbench.records.devices import Characteristics
from vcfbench.records.devices import Measured as Kept

NOT_MEASURED: Final = "not measured"
AMPLITUDES: Final = "carrier over drive, amplitudes"
CARRIER_PHASE, DEMODULATOR_PHASE = "phase of the carrier", "phase of the demodulator"
MAY_HAVE: Final[tuple[tuple[str, Mapping[str, float], str], ...]] = (
    ("Q", {"q_anti_phase": -0.5, "q_in_phase": -0.5}, "to 50 %"),
    ("mode split", {"split_hz": 0.5}, "by 0.5 Hz"),
    ("in-phase mode", {"in_phase_split_hz": 5.0}, "by 5 Hz"),
    (CARRIER_PHASE, {"carrier_phase_deg": 1.0}, "by 1 deg"),
    (DEMODULATOR_PHASE, {"demodulator_phase_deg": 1.0}, "by 1 deg"),
    ("V_Vc that comes through", {"v_vc_feedthrough": 5e-4}, "by 500 ppm"),
)
"""Largest possible changes where nobody looks; of Q a share.

The limits are this program's own, there is no source for them. Q halves where gas that damps a mode comes to twice its
pressure. Half a hertz of split is 3e-4 of a mode's spring, 5 Hz of the in-phase mode 3e-3. A degree is 0.8 us at 3.5
kHz: a capacitor at the corner of a filter, off by 3 %. 5e-4 of what the modes answer is as far as
`benchmarks/ageing.py` goes. `k_vc_not_measured_ppm` replaces them all.
"""
_COUNTED = frozenset({phases.CARRIER_PHASE, phases.DEMODULATOR_PHASE})
"""Phases measured by health, or counted as not measured: not missing, though no bench file says it."""


def missing_of(settings: KnownDeviceSettings, *, amplitudes: bool = False) -> tuple[str, ...]:
    """Return the missing contributions of a scale factor: `amplitudes`, too, unless their ratio was measured.

    No figure stands for how far that may have changed.
    """
    missing = tuple(name for name in settings.missing_without_table if name not in _COUNTED)
    stated = amplitudes or settings.station.sources.k_vc_not_measured_ppm is not None
    return missing if stated else (*missing, AMPLITUDES)


def gaps_of(settings: KnownDeviceSettings, missing: Collection[str]) -> Iterator[str]:
    """Yield in words the unknown quantities, of those `missing` too."""
    yield from (f"MISSING {gap.words}" for gap in settings.own_gaps() if gap.name not in _COUNTED)
    if AMPLITUDES in missing:
        yield (
            f"MISSING the ratio of {AMPLITUDES}, since the certificate: by the oscilloscope of the certificate (its "
            "inventory_number in both bench files), or by AC volts (kvc --set ac_volts=true); or say that "
            "k_vc_drift_ppm_per_year has it: uncertainty.k_vc_not_measured_ppm"
        )


def unmeasured(settings: KnownDeviceSettings, measured: Collection[str] = ()) -> list[UncertaintyPart]:
    """Return the possible unmeasured changes of K_Vc, relative; limits of phases in the bench file count elsewhere."""
    stated = settings.station.sources
    if CARRIER_PHASE in measured:
        return []
    if stated.k_vc_not_measured_ppm is not None:
        u = 1e-6 * stated.k_vc_not_measured_ppm / math.sqrt(3.0)
        part = UncertaintyPart(f"{NOT_MEASURED} (uncertainty.k_vc_not_measured_ppm)", u, rectangular=True)
        return [part] if u else []
    limits = {CARRIER_PHASE: stated.carrier_phase_deg, DEMODULATOR_PHASE: stated.demodulator_phase_deg}
    but = [*measured, *(name for name, limit in limits.items() if limit is not None)]
    return not_measured(settings.known.characteristics, but=but)


def not_measured(then: Characteristics | None, *, but: Collection[str] = ()) -> list[UncertaintyPart]:
    """Return the possible changes of K_Vc without a measurement now, relative parts by cause, except `but`.

    Each is the limit of what may have changed times what the device makes of it; what the certificate does not know of
    the device counts as wide as its class.
    """
    known = {name: getattr(then, name, None) or each for name, each in ASSUMED.items()}
    device = structs.replace(Characteristics(), **known)
    found = []
    for name, moved, by in MAY_HAVE:
        if name not in but:
            ends = [k_vc_change(device, _moved(known, moved, sign)) for sign in (1.0, -1.0)]
            worst = max(ends, key=lambda end: abs(end.ppm))
            u = 1e-6 * math.hypot(worst.ppm / math.sqrt(3.0), worst.u_ppm)
            found.append(UncertaintyPart(f"{NOT_MEASURED}: {name} ({by}, assumed)", u, rectangular=True))
    return found


def _moved(known: Mapping[str, Kept], moved: Mapping[str, float], sign: float) -> Characteristics:
    """Return the moved characteristics, without a further uncertainty; a leak has one direction."""
    values = {
        name: known[name].value * (1.0 + by) if name.startswith("q_") else known[name].value + sign * by
        for name, by in moved.items()
    }
    return structs.replace(Characteristics(), **{name: Kept(value=value, u=0.0) for name, value in values.items()})
