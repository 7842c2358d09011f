"""Possible change of K_Vc since its certificate without health: by time, and by the stated temperatures.

What cannot be seen without a table (combs, their gap and charges, masses, the drive's pick-off) may have drifted in one
direction all the time, so its limit grows in proportion to the time since the certificate, and any drift within is as
likely. What a shock or another mounting does on the way has a limit of its own, from the first day on.
"""

import math
from collections.abc import Mapping, Sequence

from vcfbench.devices.device import KnownDeviceSettings
from vcfbench.devices.k_vc_change import temperature_coefficient
from vcfbench.records.device_values import Characteristics
from vcfbench.station.settings import Sources
from vcfbench.uncertainty.measurand import measurand
from vcfbench.values.sources import TEMPERATURE
from vcfbench.values.value import UncertaintyPart

K_VC_HEALTH = "changes of K_Vc measured by health"
K_VC_DRIFT, K_VC_TEMPERATURE = (
    "drift of K_Vc since the certificate",
    "change of K_Vc with temperature since the certificate",
)
K_VC_ON_THE_WAY = "change of K_Vc in transport from the table"

YEAR_DAYS = 365.25


def k_vc_since(
    settings: KnownDeviceSettings, by_causes_ppm: tuple[float, float] | None = None, *, warmth_seen: bool = False
) -> tuple[float, list[UncertaintyPart], tuple[str, ...]]:
    """Return K_Vc over the certificate's, by time and temperature, its u, relative, and both in words.

    Its causes count as `by_causes_ppm` once they are measured: the change and its u. Unless `warmth_seen`, the
    temperature is not among them, and its possible effect counts as well.
    """
    known, sources = settings.known, settings.station.sources
    then, now_c, said, ppm = known.characteristics or Characteristics(), settings.temperature_c, [], 0.0
    per_k, measured = temperature_coefficient(then)
    u, near_k = 0.0, (sources.temperature_k or 0.0) / math.sqrt(3.0)
    by_reading = math.hypot(per_k.value, per_k.u) * near_k  # of both readings, or how far they are apart
    if then.temperature_c is not None and now_c is not None:
        rise_k = now_c - then.temperature_c.value
        ppm, u = per_k.value * rise_k, math.hypot(per_k.u * rise_k, per_k.value * then.temperature_c.u)
        whose = f"{per_k.value:+.1f} ppm/K, u {per_k.u:.2g}, {'measured' if measured else 'assumed'}"
        u_all = math.hypot(u, by_reading)
        words = f"K_Vc corrected by {ppm:+.1f} ppm, u {u_all:.2g}, for {rise_k:+.2f} K since the certificate ({whose})"
        said = [words] if rise_k else []
    by_warmth = {K_VC_TEMPERATURE: u, TEMPERATURE: by_reading}
    parts = [UncertaintyPart(name, 1e-6 * each) for name, each in by_warmth.items() if each and not warmth_seen]
    if by_causes_ppm is not None:
        ppm, u = by_causes_ppm
        parts = [UncertaintyPart(K_VC_HEALTH, 1e-6 * u), *parts]
        said = [f"K_Vc corrected by {ppm:+.1f} ppm, u {u:.2g}, for the changes measured by health"]
    days = known.days_since or 0.0
    if limit := 1e-6 * sources.k_vc_drift_ppm_per_year * days / YEAR_DAYS:
        u = limit / math.sqrt(3.0)
        parts = [UncertaintyPart(K_VC_DRIFT, u, None, f"{known.source}: {K_VC_DRIFT}", rectangular=True), *parts]
        since = f"{days:.0f} days since the certificate ({drift_words(sources)})"
        said = [f"K_Vc: {u * 1e6:.3g} ppm (u) for its drift in {since}", *said]
    if known.days_since is not None and (way_ppm := sources.k_vc_on_the_way_ppm):
        u, of = 1e-6 * way_ppm / math.sqrt(3.0), f"{known.source}: {K_VC_ON_THE_WAY}"
        parts = [UncertaintyPart(K_VC_ON_THE_WAY, u, None, of, rectangular=True), *parts]
        key = "k_vc_on_the_way_ppm"
        said = [sources.assumed.get(key, f"K_Vc: uncertainty.{key}, {way_ppm:g} ppm at most"), *said]
    return 1.0 + 1e-6 * ppm, parts, tuple(said)


def with_temperature(of_output: Mapping[str, float], since: Sequence[UncertaintyPart]) -> list[UncertaintyPart]:
    """Return relative parts of an output by its temperature, and those of K_Vc `since` its certificate.

    One error of the temperature does both. Of the output's coefficient the size is known alone: they add up.
    """
    own, others = dict(of_output), [part for part in since if part.source not in of_output]
    for part in since:
        if part.source in own:
            own[part.source] += part.u
    return [*(UncertaintyPart(name, u) for name, u in own.items()), *others]


def drift_words(known: Sources) -> str:
    """Say the amount by which K_Vc may drift, and where that is from."""
    key = "k_vc_drift_ppm_per_year"
    return known.assumed.get(key, f"uncertainty.{key}: {known.k_vc_drift_ppm_per_year:g} ppm per year")


def days_until(wanted_u95_ppm: float, today: Sequence[UncertaintyPart], drift_ppm_per_year: float) -> float | None:
    """Return the days until U95 of K_Vc reaches the wanted value; None where it is beyond that today.

    Args:
        wanted_u95_ppm: ppm of K_Vc.
        today: what U95 is made of on the day of the certificate, ppm.
        drift_ppm_per_year: at most; with 0 the answer is infinity.
    """

    def u95_ppm(days: float) -> float:
        u = drift_ppm_per_year * days / YEAR_DAYS / math.sqrt(3.0)
        return measurand(0.0, "ppm", [*today, UncertaintyPart(K_VC_DRIFT, u, rectangular=True)]).u95

    if u95_ppm(0.0) >= wanted_u95_ppm:
        return None
    if drift_ppm_per_year <= 0.0:
        return math.inf
    early, late = 0.0, YEAR_DAYS * 2.0 * wanted_u95_ppm / drift_ppm_per_year
    while late - early > 1e-3 * late:
        middle = 0.5 * (early + late)
        early, late = (middle, late) if u95_ppm(middle) < wanted_u95_ppm else (early, middle)
    return early
