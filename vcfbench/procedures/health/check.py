"""Changes of K_Vc, cause by cause: corrected, not measured, or such that K_Vc cannot be stated."""

import math
from collections.abc import Collection, Iterator, Mapping
from itertools import product
from typing import Final, Literal, TypeVar

from msgspec import Struct, structs

from vcfbench.devices.device import KnownDeviceSettings
from vcfbench.devices.k_vc_change import inputs_of, k_vc_change
from vcfbench.procedures.health.explained import rise_since
from vcfbench.records.device_values import Characteristics
from vcfbench.records.device_values import Measured as Kept
from vcfbench.reports.document import Table, Text, heads
from vcfbench.uncertainty.phases import PhaseErrors
from vcfbench.values import sources as source_names
from vcfbench.values.quantile import t_quantile
from vcfbench.values.value import UncertaintyPart

NOT_MEASURED: Final = "not measured"
AMPLITUDES: Final = "ratio of carrier to drive amplitude"
CARRIER_PHASE, DEMODULATOR_PHASE = "phase of the carrier", "phase of the demodulator"
MAY_HAVE: Final[tuple[tuple[str, Mapping[str, float], str], ...]] = (
    ("Q", {"q_anti_phase": -0.5, "q_in_phase": -0.5}, "by 50 %"),
    ("mode split", {"split_hz": 0.5}, "by 0.5 Hz"),
    ("in-phase mode", {"in_phase_split_hz": 5.0}, "by 5 Hz"),
    (CARRIER_PHASE, {"carrier_phase_deg": 1.0}, "by 1 deg"),
    (DEMODULATOR_PHASE, {"demodulator_phase_deg": 1.0}, "by 1 deg"),
    ("feedthrough of V_Vc", {"v_vc_feedthrough": 5e-4}, "by 500 ppm"),
    (AMPLITUDES, {"drive_amplitude_v": 0.005, "carrier_amplitude_v": 0.0}, "by 0.5 %"),
)
"""Largest possible changes where nobody looks; of Q and amplitudes a share.

The limits are this program's own, there is no source for them. Q halves where gas that damps a mode comes to twice its
pressure. Half a hertz of split is 3e-4 of a mode's spring, 5 Hz of the in-phase mode 3e-3. A degree is 0.8 us at 3.5
kHz: a capacitor at the corner of a filter, off by 3 %. 5e-4 of what the modes answer and 0.5 % of the drive alone are
as far as `experiments/ageing.py` goes. `k_vc_not_measured_ppm` replaces them all.
"""
_AMPLITUDES = ("drive_amplitude_v", "carrier_amplitude_v")
_COUNTED = frozenset({source_names.CARRIER_PHASE, source_names.DEMODULATOR_PHASE})
"""Phases measured by health, or counted as not measured: not missing, though no bench file says it."""


S = TypeVar("S", bound=KnownDeviceSettings)


def missing_of(settings: KnownDeviceSettings) -> tuple[str, ...]:
    """Return the missing contributions of a scale factor."""
    return tuple(name for name in settings.missing_without_table if name not in _COUNTED)


def gaps_of(settings: KnownDeviceSettings) -> Iterator[str]:
    """Yield in words the unknown quantities."""
    yield from (f"MISSING {gap.words}" for gap in settings.own_gaps() if gap.name not in _COUNTED)


def unmeasured(settings: KnownDeviceSettings, measured: Collection[str] = ()) -> list[UncertaintyPart]:
    """Return the possible unmeasured changes of K_Vc, relative; limits of phases in the bench file count elsewhere."""
    stated = settings.station.sources
    if {name for name, *_ in MAY_HAVE} <= {*measured}:
        return []
    if stated.k_vc_not_measured_ppm is not None:
        u = 1e-6 * stated.k_vc_not_measured_ppm / math.sqrt(3.0)
        part = UncertaintyPart(f"{NOT_MEASURED} (uncertainty.k_vc_not_measured_ppm)", u, rectangular=True)
        return [part] if u else []
    keys = {CARRIER_PHASE: "carrier_phase_deg", DEMODULATOR_PHASE: "demodulator_phase_deg"}
    but = [*measured, *(name for name, key in keys.items() if key not in stated.assumed)]
    parts = not_measured(settings.known.characteristics, but=but)
    # One change since the certificate: between two entries nobody takes it for one of the gyroscope until it shows
    return [structs.replace(part, of=f"{settings.known.source}: {part.source}") for part in parts]


def at_phases(settings: S, measured: Collection[str]) -> S:
    """Return the settings such that values are those at the phases of now, where these were `measured`."""
    if CARRIER_PHASE not in measured:
        return settings
    known = settings.station.sources
    gone = {"carrier_phase_deg", "demodulator_phase_deg", "bias_deg_s_demodulator_deg"}
    assumed = {key: words for key, words in known.assumed.items() if key not in gone}
    sources = structs.replace(known, carrier_phase_deg=0.0, demodulator_phase_deg=0.0, assumed=assumed)
    return structs.replace(settings, station=structs.replace(settings.station, sources=sources))


def by_phases(settings: KnownDeviceSettings) -> list[UncertaintyPart]:
    """Return the possible effect of the phases on a scale factor by K_Vc since its certificate, relative.

    Of limits that are assumed :func:`unmeasured` has what they do to K_Vc, and this what they do to the output.
    """
    errors, assumed = PhaseErrors.of(settings.station.sources), settings.station.sources.assumed
    whole, output = errors.u("self_calibrated"), errors.u("scale_factor")
    keys = {source_names.CARRIER_PHASE: "carrier_phase_deg", source_names.DEMODULATOR_PHASE: "demodulator_phase_deg"}
    found = {name: (output if keys[name] in assumed else whole).get(name) for name in keys}
    return [UncertaintyPart(name, u) for name, u in found.items() if u]


def not_measured(then: Characteristics | None, *, but: Collection[str] = ()) -> list[UncertaintyPart]:
    """Return the possible changes of K_Vc without a measurement now, relative parts by cause, except `but`.

    Each is the limit of what may have changed times what the device makes of it; what the certificate does not know of
    the device counts as wide as its class.
    """
    equal = {name: Kept(value=1.0, u=0.0) for name in _AMPLITUDES}  # only how their ratio changes counts
    devices, found = [known | equal for known in inputs_of(then or Characteristics())], []
    for name, moved, by in MAY_HAVE:
        if name not in but:
            ends = []
            for known, sign in product(devices, (1.0, -1.0)):  # a leak has one direction
                device = structs.replace(Characteristics(), **known)
                values = {
                    each: known[each].value * (1.0 + share)
                    if each.startswith("q_") or each in _AMPLITUDES
                    else known[each].value + sign * share
                    for each, share in moved.items()
                }
                after = {each: Kept(value=value, u=0.0) for each, value in values.items()}
                ends.append(k_vc_change(device, structs.replace(Characteristics(), **after)))
            worst = max(ends, key=lambda end: abs(end.ppm))
            u = 1e-6 * math.hypot(worst.ppm / math.sqrt(3.0), worst.u_ppm)
            found.append(UncertaintyPart(f"{NOT_MEASURED}: {name} ({by}, assumed)", u, rectangular=True))
    return found


AMPLITUDES_WORTH_PPM = 1000.0
"""A ratio of amplitudes that is known to less than this corrects K_Vc; else it is worse than nothing."""
SEEN = 3.0
"""A change by so many of its standard uncertainties is one."""
_CHANCE = 1e-4
"""Probability that records of an unchanged gyroscope, few and noisy, show a change of its phase."""
UNEXPLAINED_DEG = 0.15
"""Largest deviation of the sense signal's phase from its value by carrier, splits and Q.

This program's own limit, no standard's: seven times what records scatter by, and what would be 150 ppm if it acted as
the carrier's phase does.
"""
STILL_UNSEEN = (
    "the force of the feedback combs per volt (gap, overlap, charges), and their mismatch",
    "the modulator's gain for small signals",
    "masses and their shares in the modes",
    "the drive pick-off: its gain appears as drive amplitude, its phase as carrier and demodulator phase",
)
"""Causes of K_Vc that no bench without a table sees: they are in its drift."""
_CHARGED_SPLIT_HZ = 0.05
"""A change of the split that temperature does not explain: charges on the combs are springs as well."""
_NAMES: Final = {
    "drive_hz": "drive frequency (temperature)",
    "split_hz": "mode split",
    "q_anti_phase": "Q of the anti-phase mode",
    "in_phase_split_hz": "split of the in-phase mode",
    "q_in_phase": "Q of the in-phase mode",
    "carrier_phase_deg": "phase of the carrier",
    "demodulator_phase_deg": "phase of the demodulator",
    "v_vc_feedthrough": "feedthrough of V_Vc",
    "temperature_c": "temperature",
    "rails_v": "rails",
}
TEMPERATURES: Final = (_NAMES["drive_hz"], _NAMES["temperature_c"])
"""The causes that temperature is seen by."""
Done = Literal["corrected", "not measured", "refused", "explained"]


class Cause(Struct, frozen=True):
    """One cause: its values then and now, its effect on K_Vc (ppm, with its u), and its treatment."""

    cause: str
    unit: str
    then: float
    now: float
    ppm: float
    u_ppm: float
    done: Done


class HealthCheck(Struct, frozen=True, kw_only=True):
    """Change of K_Vc since its certificate; `ppm` is the increase, with its standard uncertainty.

    `together_ppm` is what all causes do beyond the sum of each alone; it is in `ppm`. `refused` says why K_Vc cannot be
    stated; nothing there: it can. `warning` is of what cannot be seen but may be suspected.
    """

    causes: tuple[Cause, ...]
    ppm: float
    u_ppm: float
    together_ppm: float
    refused: tuple[str, ...]
    warning: str | None
    measured: tuple[str, ...]
    """Characteristics measured now, of all that may have changed."""


def checked(then: Characteristics, now: Characteristics) -> HealthCheck:
    """Return the changes of K_Vc's causes, with the treatment of each."""
    seen = structs.replace(now, in_phase_share=None)  # force and pick-off of either mode stay as they were
    alone = Characteristics(drive_amplitude_v=seen.drive_amplitude_v, carrier_amplitude_v=seen.carrier_amplitude_v)
    amplitudes = k_vc_change(then, alone)
    worth = bool(amplitudes.parts) and amplitudes.u_ppm <= AMPLITUDES_WORTH_PPM
    whole = k_vc_change(
        then, seen if worth else structs.replace(seen, drive_amplitude_v=None, carrier_amplitude_v=None)
    )
    causes, refused = [], []
    for part in whole.parts:
        if part.quantity not in _AMPLITUDES:
            name = _NAMES.get(part.quantity, part.quantity)
            causes.append(Cause(name, part.unit, part.then, part.now, part.ppm, part.u_ppm, "corrected"))
    if amplitudes.parts:  # of which only the ratio counts
        done: Done = "corrected" if worth else "not measured"
        if not worth and abs(amplitudes.ppm) > SEEN * amplitudes.u_ppm:
            done = "refused"
            refused.append(
                f"the ratio of carrier to drive amplitude has changed K_Vc by {amplitudes.ppm:+.0f} ppm, with u "
                f"{amplitudes.u_ppm:.0f} ppm, since the probes were not exchanged"
            )
        causes.append(Cause(AMPLITUDES, "", _ratio(then), _ratio(seen), amplitudes.ppm, amplitudes.u_ppm, done))
    if then.sense_phase_deg is not None and now.sense_phase_deg is not None:  # K_Vc would change by its tangent
        before, after = then.sense_phase_deg, now.sense_phase_deg
        phase, done = "unexplained phase of the sense signal", "explained"
        moved_deg = after.value - before.value
        factor = t_quantile(_CHANCE, min(each.dof or math.inf for each in (before, after)))
        if abs(moved_deg) > max(factor * math.hypot(after.u, before.u), UNEXPLAINED_DEG):
            done = "refused"
            refused.append(
                f"the phase of the sense signal has changed by {moved_deg:+.2f} deg, unexplained by carrier, splits "
                "and Q"
            )
        causes.append(Cause(phase, "deg", before.value, after.value, 0.0, 0.0, done))
    return HealthCheck(
        causes=tuple(sorted(causes, key=lambda cause: -abs(cause.ppm))),
        ppm=whole.ppm,
        u_ppm=whole.u_ppm,
        together_ppm=whole.together_ppm,
        refused=tuple(refused),
        warning=charging_warning(then, seen),
        measured=tuple(
            name
            for name, moved, _ in MAY_HAVE
            if all(getattr(now, each) for each in moved) and (worth or name != AMPLITUDES)
        ),
    )


def charging_warning(then: Characteristics, now: Characteristics) -> str | None:
    """Return a warning of charged combs if temperature does not explain the change of the split; else None.

    A charge is a spring, and changes the force that a volt makes, which nothing else shows (Micromachines 2023, 14,
    1755): the split is the only witness of what would change K_Vc unseen. The drive's frequency is the thermometer.
    """
    first_hz = then.split_hz or then.split_size_hz
    if first_hz is None or now.split_hz is None:
        return None
    rise = rise_since(then, now)
    rise_k = 0.0 if rise is None else rise.kelvin
    per_k = Kept(value=0.0, u=0.01) if then.split_hz_k is None else then.split_hz_k
    moved_hz = abs(now.split_hz.value) - abs(first_hz.value) - per_k.value * rise_k
    u_hz = math.hypot(now.split_hz.u, first_hz.u, per_k.u * rise_k)
    if abs(moved_hz) <= max(2.0 * u_hz, _CHARGED_SPLIT_HZ):
        return None
    return (
        f"the split has changed by {moved_hz:+.3f} Hz in size (u {u_hz:.2g}) more than temperature explains: charges "
        "on the combs may be the cause, and would change K_Vc undetected; check on a rate table (vcfbench run kvc)"
    )


def _ratio(of: Characteristics) -> float:
    carrier, drive = of.carrier_amplitude_v, of.drive_amplitude_v
    return carrier.value / drive.value if carrier and drive else math.nan


def health_parts(found: HealthCheck) -> list[Table | Text]:
    """Return the table of all causes, and their total."""
    columns = heads("<quantity | then:.7g | now:.7g | <unit | effect on K_Vc [ppm]:+.1f | u [ppm]:.2g | <status")
    rows = [(each.cause, each.then, each.now, each.unit, each.ppm, each.u_ppm, each.done) for each in found.causes]
    together = f"{found.ppm:+.1f} ppm, u {found.u_ppm:.2g}, of which {found.together_ppm:+.1f} ppm by interaction"
    words = [f"K_Vc has changed by {together}", *(f"K_Vc is not stated: {why}" for why in found.refused)]
    words += [] if found.warning is None else [f"warning: {found.warning}"]
    return [
        Table(columns, rows, "Health: quantities that K_Vc depends on, at the certificate and now"),
        Text("\n".join(words)),
    ]
