"""Possible change of K_Vc since its certificate where nobody has looked: by time, and by the stated temperatures.

What cannot be seen without a table (combs, their gap and charges, masses) may have drifted in one direction all the
time, so its limit grows in proportion to the time since the certificate, and any drift within is as likely.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from vcfbench.procedures.shared.known.device import KnownDevice, KnownDeviceSettings
from vcfbench.procedures.shared.known.k_vc_change import KvcChange, temperature_coefficient
from vcfbench.procedures.shared.measurand import UncertaintyPart, measurand
from vcfbench.records.devices import Characteristics
from vcfbench.station.settings import Sources

K_VC_HEALTH = "what was measured of K_Vc's causes"
K_VC_DRIFT, K_VC_TEMPERATURE = "K_Vc's drift since the certificate", "temperature since the certificate, in K_Vc"

YEAR_DAYS = 365.25
_CHARGED_SPLIT_HZ = 0.05
"""A change of the split that temperature does not explain: charges on the combs are springs as well."""


@dataclass(frozen=True, slots=True)
class KvcSince:
    """Change of K_Vc by time and temperature since its certificate."""

    factor: float
    """K_Vc now over that of the certificate."""
    parts: tuple[UncertaintyPart, ...]
    """Uncertainty of that, relative."""
    said: tuple[str, ...]
    """Corrections and assumptions, in words."""


def k_vc_since(settings: KnownDeviceSettings, seen: KvcChange | None = None) -> KvcSince:
    """Return the change of K_Vc as far as time and temperature tell; `seen`: that by its causes, once measured.

    Then temperature is one of them.
    """
    known, sources = settings.known, settings.station.sources
    if seen is None:
        ppm, parts, said = _warmed(settings, known)
    else:
        ppm, parts = seen.ppm, [UncertaintyPart(K_VC_HEALTH, 1e-6 * seen.u_ppm)]
        said = [f"K_Vc corrected by {ppm:+.1f} ppm, u {seen.u_ppm:.2g}, for what was measured of its causes (health)"]
    days = known.days_since or 0.0
    if limit := 1e-6 * sources.k_vc_drift_ppm_per_year * days / YEAR_DAYS:
        u, whose = limit / math.sqrt(3.0), f"{known.source}: {K_VC_DRIFT}"
        parts = [UncertaintyPart(K_VC_DRIFT, u, None, whose, rectangular=True), *parts]
        since = f"{days:.0f} days since the certificate ({drift_words(sources)})"
        said = [f"K_Vc: {u * 1e6:.3g} ppm (u) for its drift in {since}", *said]
    return KvcSince(1.0 + 1e-6 * ppm, tuple(parts), tuple(said))


def drift_words(known: Sources) -> str:
    """Say how far K_Vc may drift, and where that is from."""
    key = "k_vc_drift_ppm_per_year"
    return known.assumed.get(key, f"uncertainty.{key}: {known.k_vc_drift_ppm_per_year:g} ppm a year")


def _warmed(settings: KnownDeviceSettings, known: KnownDevice) -> tuple[float, list[UncertaintyPart], list[str]]:
    """Return the change of K_Vc by temperature, ppm, its uncertainty, and both in words."""
    seen, now_c = known.characteristics or Characteristics(), settings.temperature_c
    per_k, measured = temperature_coefficient(seen)
    within_k = settings.station.sources.temperature_k
    by_reading = math.hypot(per_k.value, per_k.u) * (within_k or 0.0) / math.sqrt(3.0)
    if seen.temperature_c is None or now_c is None:
        return 0.0, [UncertaintyPart(K_VC_TEMPERATURE, 1e-6 * by_reading)] if by_reading else [], []
    rise_k = now_c - seen.temperature_c.value
    ppm = per_k.value * rise_k
    u = math.hypot(per_k.u * rise_k, per_k.value * seen.temperature_c.u, by_reading)
    whose = f"{per_k.value:+.1f} ppm/K, u {per_k.u:.2g}, {'measured' if measured else 'assumed'}"
    said = [f"K_Vc corrected by {ppm:+.1f} ppm, u {u:.2g}, for {rise_k:+.2f} K since the certificate ({whose})"]
    return ppm, [UncertaintyPart(K_VC_TEMPERATURE, 1e-6 * u)] if u else [], said if rise_k else []


def days_until(wanted_u95_ppm: float, today: Sequence[UncertaintyPart], drift_ppm_per_year: float) -> float | None:
    """Return the days until U95 of K_Vc reaches the wanted value; None where it is beyond that today.

    Args:
        wanted_u95_ppm: ppm of K_Vc.
        today: what U95 is made of on the day of the certificate, ppm.
        drift_ppm_per_year: at most; with 0 the answer is infinity.
    """

    def u95_ppm(days: float) -> float:
        u = drift_ppm_per_year * days / YEAR_DAYS / math.sqrt(3.0)
        return measurand(0.0, "ppm", [*today, UncertaintyPart(K_VC_DRIFT, u, rectangular=True)]).expanded_u

    if u95_ppm(0.0) >= wanted_u95_ppm:
        return None
    if drift_ppm_per_year <= 0.0:
        return math.inf
    early, late = 0.0, YEAR_DAYS * 2.0 * wanted_u95_ppm / drift_ppm_per_year
    while late - early > 1e-3 * late:
        middle = 0.5 * (early + late)
        early, late = (middle, late) if u95_ppm(middle) < wanted_u95_ppm else (early, middle)
    return early


def charging_warning(then: Characteristics, now: Characteristics) -> str | None:
    """Say that the combs may have charged where the split has changed by more than temperature does; else None.

    A charge is a spring, and changes the force that a volt makes, which nothing else shows (Micromachines 2023, 14,
    1755): the split is the only witness of what would change K_Vc unseen.
    """
    if then.split_hz is None or now.split_hz is None:
        return None
    at_c = then.temperature_c, now.temperature_c
    rise_k = 0.0 if at_c[0] is None or at_c[1] is None else at_c[1].value - at_c[0].value
    per_k = (then.split_hz_k.value, then.split_hz_k.u) if then.split_hz_k is not None else (0.0, 0.01)
    moved_hz = now.split_hz.value - then.split_hz.value - per_k[0] * rise_k
    u_hz = math.hypot(now.split_hz.u, then.split_hz.u, per_k[1] * rise_k)
    if abs(moved_hz) <= max(2.0 * u_hz, _CHARGED_SPLIT_HZ):
        return None
    return (
        f"the split has changed by {moved_hz:+.3f} Hz (u {u_hz:.2g}) beyond what temperature does: charges on the "
        "combs may have done that, and would change K_Vc unseen; a table tells (vcfbench run kvc)"
    )
