"""Sensitivities of a device's K_Vc to its characteristics, and its change since its certificate.

The closed form is that of :mod:`vcfbench.analysis.k_vc_model`. What a certificate does not know of the device is
assumed as wide as the class of silicon tuning forks has it, and named; what is not known makes no uncertainty smaller.
"""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from statistics import fmean

from msgspec import Struct, structs

from vcfbench.analysis.k_vc_model import QUANTITIES, Gyroscope, change_ppm, sensitivities
from vcfbench.errors import ConfigError
from vcfbench.records.device_values import Characteristics, Measured, Sensitivity, Share
from vcfbench.reports.document import Table, heads
from vcfbench.values.kinds import in_words


def _within(value: float, limit: float) -> Measured:
    """Return a value that is as likely anywhere within a limit either way."""
    return Measured(value=value, u=limit / math.sqrt(3.0))


_QUANTITIES: Mapping[str, tuple[str, float, float]] = {
    "drive_hz": ("Hz", 3500.0, 0.0),
    "split_hz": ("Hz", 25.0, 15.0),
    "q_anti_phase": ("", 1200.0, 600.0),
    "in_phase_split_hz": ("Hz", 150.0, 75.0),
    "q_in_phase": ("", 1200.0, 600.0),
    "in_phase_share": ("", 0.1, 0.1),
    "carrier_phase_deg": ("deg", 0.0, 3.0),
    "demodulator_phase_deg": ("deg", 0.0, 3.0),
    "comb_mismatch": ("", 0.0, 0.01),
    "v_vc_feedthrough": ("", 0.0, 1e-3),
    "drive_amplitude_v": ("V", 1.0, 0.0),
    "carrier_amplitude_v": ("V", 1.0, 0.0),
}
"""Units of the quantities that K_Vc depends on, and what is assumed where nobody measured them: value and limit.

Frequencies and Q are those of the paper's class; both amplitudes count as a ratio alone, so that their size is free;
combs of one mask differ by 1 % at most; the limits are assumed. The split is on either side."""
ASSUMED = {name: _within(value, limit) for name, (_, value, limit) in _QUANTITIES.items()}
UNITS = {name: unit for name, (unit, _, _) in _QUANTITIES.items()} | {"temperature_c": "K", "rails_v": "V"}

ASSUMED_DRIVE_PPM_K = _within(-30.0, 15.0)
"""Coefficient of the drive frequency: silicon's stiffness falls by some 60 ppm/K; K_Vc is as 1/frequency."""
ASSUMED_SPLIT_HZ_K = _within(0.0, 0.02)
"""Coefficient of the split: modes of one piece of silicon whose coefficients differ by a fifth (assumed)."""
FURTHEST_K = 20.0
"""From the certificate's temperature, where nobody has measured K_Vc at others: so far an assumed coefficient holds."""
ASSUMED_Q_PER_K = _within(-2e-3, 2e-3)
"""Relative change of the quality factors with temperature: gas shut in at few pascals damps as the square root of its
temperature, -0.17 %/K; supports lose less of it, thermoelastic losses more (assumed, without a source: unverified)."""
ASSUMED_PPM_V = Measured(value=0.0, u=200.0 / math.sqrt(3.0))
"""Coefficient of K_Vc by the rails, where nobody measured it: the drive may follow them and the carrier not."""


class KvcPart(Struct, frozen=True):
    """Effect of the change of one quantity on K_Vc, the others unchanged."""

    quantity: str
    unit: str
    then: float
    now: float
    ppm: float
    u_ppm: float


class KvcChange(Struct, frozen=True):
    """Amount by which K_Vc is larger than it was, ppm; `parts` are those of each quantity alone, the largest first.

    `together_ppm` is what they do beyond their sum. What was not measured both times is in no part.
    """

    ppm: float
    u_ppm: float
    parts: tuple[KvcPart, ...]
    together_ppm: float


_AMPLITUDES = ("drive_amplitude_v", "carrier_amplitude_v")
_Inputs = dict[str, Measured]


def inputs_of(*known: Characteristics) -> list[_Inputs]:
    """Return the inputs of the closed form by the first of `known`: twice where none of them has the split's sign.

    Amplitudes that were not both measured count as equal. The modes' shares have the signs of their stiffnesses.
    """
    split_hz = next((each.split_hz.value for each in known if each.split_hz is not None), None)
    found = []
    for sign in (1.0, -1.0) if split_hz is None else (split_hz,):
        inputs = {name: getattr(known[0], name) or each for name, each in ASSUMED.items()}
        inputs["split_hz"] = known[0].split_hz or (known[0].split_size_hz or ASSUMED["split_hz"]).signed(sign)
        if known[0].in_phase_share is None:
            inputs["in_phase_share"] = ASSUMED["in_phase_share"].signed(sign * inputs["in_phase_split_hz"].value)
        found.append(inputs)
    return found


def _of_either(found: Sequence[Measured]) -> Measured:
    """Return the mean of the values by either sign of the split, each as likely."""
    middle = fmean(each.value for each in found)
    return Measured(value=middle, u=math.sqrt(fmean(each.u**2 + (each.value - middle) ** 2 for each in found)))


def _gyroscope(values: Mapping[str, float]) -> Gyroscope:
    return Gyroscope(**{name: values[name] for name in QUANTITIES})


def k_vc_sensitivities(known: Characteristics) -> tuple[Sensitivity, ...]:
    """Return the sensitivities of K_Vc to all that it depends on, those of temperature and rails too.

    Their uncertainties are what those of all the quantities leave.
    """
    of_each = [_sensitivities(inputs) for inputs in inputs_of(known)]
    per_k, measured_k = temperature_coefficient(known)
    per_v = known.k_vc_ppm_v or ASSUMED_PPM_V
    rows = [
        (name, by.value, by.u, getattr(known, name) is None)
        for name in QUANTITIES
        for by in [_of_either([each[name] for each in of_each])]
    ]
    rows += [
        ("temperature_c", per_k.value, per_k.u, not measured_k),
        ("rails_v", per_v.value, per_v.u, known.k_vc_ppm_v is None),
    ]
    return tuple(
        Sensitivity(quantity=name, unit=UNITS[name], ppm_per_unit=value, u_ppm_per_unit=u, assumed=assumed)
        for name, value, u, assumed in rows
    )


def _sensitivities(inputs: _Inputs) -> dict[str, Measured]:
    values = {name: each.value for name, each in inputs.items()}
    found, variances = sensitivities(_gyroscope(values)), dict.fromkeys(QUANTITIES, 0.0)
    for name, each in inputs.items():
        if each.u:
            up, down = (sensitivities(_gyroscope(_moved(values, name, sign * each.u))) for sign in (1.0, -1.0))
            for other in QUANTITIES:
                variances[other] += (0.5 * (up[other] - down[other])) ** 2
    return {name: Measured(value=found[name], u=math.sqrt(variances[name])) for name in QUANTITIES}


_LEAST_SPLIT_HZ, _LEAST_Q, _MOST_SHARE = 0.01, 1.0, 0.95
"""Beyond which no value means anything; uncertainties that reach further are cut there. A mode stays on its side."""


def _moved(values: Mapping[str, float], name: str, by: float) -> dict[str, float]:
    value = values[name] + by
    if name in {"split_hz", "in_phase_split_hz"}:
        side = math.copysign(1.0, values[name])
        value = side * max(side * value, _LEAST_SPLIT_HZ)
    elif name in {"q_anti_phase", "q_in_phase"}:
        value = max(value, _LEAST_Q)
    elif name == "in_phase_share":
        value = min(value, _MOST_SHARE)
    return {**values, name: value}


def temperature_coefficient(known: Characteristics, seen: Collection[str] = ()) -> tuple[Measured, bool]:
    """Return the temperature coefficient of K_Vc, ppm/K, and True if it was measured.

    As measured on a table, or else by the closed form from the coefficients of drive frequency, split and Q. What split
    and Q do is left out where they are among those `seen`, which have it.
    """
    if known.k_vc_ppm_k is not None and not seen:
        return known.k_vc_ppm_k, True
    coefficients = {
        "drive": known.drive_ppm_k or ASSUMED_DRIVE_PPM_K,
        "split": known.split_hz_k or ASSUMED_SPLIT_HZ_K,
        "q": known.q_per_k or ASSUMED_Q_PER_K,
    }

    def ppm_k(at: Mapping[str, float]) -> float:
        by = sensitivities(_gyroscope(at))
        parts = {name: by[name] * at[name] * at["q"] for name in ("q_anti_phase", "q_in_phase")}
        parts["split_hz"] = by["split_hz"] * math.copysign(at["split"], at["split"] * at["split_hz"])
        if known.k_vc_ppm_k is not None:
            return known.k_vc_ppm_k.value - math.fsum(part for name, part in parts.items() if name in seen)
        return -at["drive"] + math.fsum(part for name, part in parts.items() if name not in seen)

    whole, found = known.k_vc_ppm_k, []
    for inputs in inputs_of(known):
        of = {**inputs, **coefficients}
        values = {name: each.value for name, each in of.items()}
        moved = [
            0.5 * (ppm_k(_moved(values, name, each.u)) - ppm_k(_moved(values, name, -each.u)))
            for name, each in of.items()
            if each.u
        ]
        found.append(Measured(value=ppm_k(values), u=math.hypot(_LEFT_PPM_K if whole is None else whole.u, *moved)))
    return _of_either(found), known.drive_ppm_k is not None or whole is not None


_LEFT_PPM_K = 0.05
"""Residual effect of the in-phase mode's own coefficients."""


def at_temperature(known: Characteristics, at_c: Measured | None) -> Characteristics:
    """Return the characteristics of a device at another temperature, where that and the coefficients are known.

    Where it is not, neither is the frequency, which was found at a temperature of its own.
    """
    if at_c is None:
        return known if known.temperature_c is None else structs.replace(known, temperature_c=None, drive_hz=None)
    moved: dict[str, Measured] = {"temperature_c": at_c}
    if known.temperature_c is not None:
        rise_k = at_c.value - known.temperature_c.value
        drive_hz_k = None
        if known.drive_hz is not None and known.drive_ppm_k is not None:
            per_ppm = 1e-6 * known.drive_hz.value
            drive_hz_k = Measured(value=per_ppm * known.drive_ppm_k.value, u=per_ppm * known.drive_ppm_k.u)
        per_kelvin = (("drive_hz", drive_hz_k), ("split_hz", known.split_hz_k), ("split_size_hz", known.split_hz_k))
        for name, per_k in per_kelvin:  # that of a split is of its size
            found: Measured | None = getattr(known, name)
            if found is not None and per_k is not None and rise_k:
                size = abs(found.value) + per_k.value * rise_k
                moved[name] = Measured(
                    value=math.copysign(size, found.value * size), u=math.hypot(found.u, per_k.u * rise_k)
                )
    return structs.replace(known, **moved)


def sensitivity_table(found: Sequence[Sensitivity]) -> Table:
    """Return the sensitivities as reports show them."""
    columns = heads("<quantity | K_Vc [ppm per unit]:.4g | u [ppm per unit]:.2g | <unit | <basis")
    rows = [
        (
            in_words(each.quantity)[0],
            each.ppm_per_unit,
            each.u_ppm_per_unit,
            each.unit,
            "assumed" if each.assumed else "measured",
        )
        for each in found
    ]
    return Table(columns, rows, "sensitivity of K_Vc to each quantity, except combs and masses (10 000 ppm = 1 %)")


def require_characterised(seen: Characteristics | None, now_c: float | None) -> None:
    """See that K_Vc is known at the temperature of now; ConfigError: it was measured at others alone."""
    if seen is None or seen.temperature_c is None or now_c is None:
        return
    then_c = seen.temperature_c.value
    if seen.least_temperature_c is None or seen.most_temperature_c is None:
        low_c, high_c = then_c - FURTHEST_K, then_c + FURTHEST_K
        why = f"{FURTHEST_K:g} K either side of the certificate"
    else:
        low_c, high_c = min(then_c, seen.least_temperature_c), max(then_c, seen.most_temperature_c)
        why = "where its coefficients were measured"
    if not low_c <= now_c <= high_c:
        raise ConfigError(
            f"temperature_c: K_Vc is known from {low_c:g} to {high_c:g} degC ({why}), not at {now_c:g} degC",
            hint="measure there (vcfbench run temperature --dut, then run kvc), or bring the gyroscope into that range",
        )


def k_vc_change(then: Characteristics, now: Characteristics) -> KvcChange:
    """Return the change of K_Vc by the quantities measured both times, however large the changes are.

    Temperature counts where the drive frequency was not measured both times, which shows it; the rails where the
    amplitudes of drive and carrier were not. What both measurements share (`Share.of`) cancels.
    """
    then, now = map(_against_drive, (then, now))
    known = then if then.split_size_hz is None else structs.replace(then, split_hz=then.split_size_hz)
    seen = {name: found for name in QUANTITIES if getattr(known, name) and (found := getattr(now, name))}
    if any(name not in seen for name in _AMPLITUDES):  # one of them alone says nothing of their ratio
        seen = {name: each for name, each in seen.items() if name not in _AMPLITUDES}
    # Temperature and rails, where the quantities that they act by were not measured
    steps = []
    if "drive_hz" not in seen and then.temperature_c and now.temperature_c:
        per_k, _ = temperature_coefficient(then, seen)
        steps.append(_step("temperature_c", per_k, then.temperature_c, now.temperature_c))
    if "drive_amplitude_v" not in seen and then.positive_rail_v and now.positive_rail_v:
        per_v = then.k_vc_ppm_v or ASSUMED_PPM_V
        steps.append(_step("rails_v", per_v, then.positive_rail_v, now.positive_rail_v))

    of_each = [_changes(first, seen) for first in inputs_of(then, now)]
    by_values = [
        KvcPart(name, UNITS[name], then_value, now_value, by.value, by.u)
        for name, (then_value, now_value, _) in of_each[0][1].items()
        for by in [_of_either([parts[name][2] for _, parts in of_each])]
    ]
    together, parts = _of_either([whole for whole, _ in of_each]), [*by_values, *steps]
    u = math.hypot(together.u, *(each.u_ppm for each in steps))
    whole = together.value + math.fsum(each.ppm for each in steps)
    beyond = whole - math.fsum(part.ppm for part in parts)
    return KvcChange(whole, u, tuple(sorted(parts, key=lambda part: -abs(part.ppm))), beyond)


def _against_drive(of: Characteristics) -> Characteristics:
    """Return the carrier's amplitude as that over the drive's, which has none of the errors that both have."""
    drive, carrier = (getattr(of, name) for name in _AMPLITUDES)
    if drive is None or carrier is None:
        return of
    errors: dict[object, Share] = {}
    ratio = carrier.value / drive.value
    for sign, each in ((1.0, carrier), (-1.0, drive)):
        for place, share in enumerate(each.shares or (Share(source="u", u=each.u),)):
            key = (share.of, share.source) if share.of else (sign, place)
            earlier = errors[key].u if key in errors else 0.0
            errors[key] = structs.replace(share, u=earlier + sign * ratio * share.u / each.value)
    u = math.hypot(*(each.u for each in errors.values()))
    over = Measured(value=ratio, u=u, shares=tuple(errors.values()))
    return structs.replace(of, drive_amplitude_v=Measured(value=1.0, u=0.0), carrier_amplitude_v=over)


def _changes(first: _Inputs, seen: _Inputs) -> tuple[Measured, dict[str, tuple[float, float, Measured]]]:
    """Return the change of K_Vc by all quantities that were `seen`, ppm; and then, now and the change by each."""

    def total(before: Mapping[str, float], after: Mapping[str, float]) -> float:
        return change_ppm(_gyroscope(before), after)

    before = {name: each.value for name, each in first.items()}
    after = {name: each.value for name, each in seen.items()}
    parts = {}
    for name, value in after.items():
        u = _u_of(total, {name: first[name]}, {name: seen[name]}, before)
        parts[name] = before[name], value, Measured(value=total(before, {name: value}), u=u)
    return Measured(value=total(before, after), u=_u_of(total, first, seen, before)), parts


def _step(name: str, per_unit: Measured, then: Measured, now: Measured) -> KvcPart:
    moved, u_moved = now.value - then.value, math.hypot(then.u, now.u)
    u = math.hypot(per_unit.u * moved, per_unit.value * u_moved, per_unit.u * u_moved)
    return KvcPart(name, UNITS[name], then.value, now.value, per_unit.value * moved, u)


def _u_of(
    total: Callable[[Mapping[str, float], Mapping[str, float]], float],
    first: _Inputs,
    second: _Inputs,
    before: Mapping[str, float],
) -> float:
    """Return the uncertainty of a change by those of its inputs, from half the difference at both ends of each.

    `first` and `second` are the inputs that are moved; the others stay as in `before`.
    """
    after = {name: each.value for name, each in second.items()}

    def half(name: str, u_then: float, u_now: float) -> float:
        ends = []
        for sign in (1.0, -1.0):
            moved = _moved(after, name, sign * u_now) if name in after else after
            ends.append(total(_moved(before, name, sign * u_then), moved))
        return 0.5 * (ends[0] - ends[1])

    found = []
    for name, each in first.items():
        other = second.get(name)
        # The errors that both have in common, by owner and source
        earlier = {(share.of, share.source): share.u for share in each.shares if share.of}
        later = {(share.of, share.source): share.u for share in (other.shares if other else ()) if share.of}
        common = [(earlier[owner], u) for owner, u in later.items() if owner in earlier]
        found.append(half(name, _left(each, [u for u, _ in common]), 0.0))
        if other is not None:
            found.append(half(name, 0.0, _left(other, [u for _, u in common])))
        found += [half(name, u_then, u_now) for u_then, u_now in common]
    return math.hypot(*found)


def _left(found: Measured, common: list[float]) -> float:
    return math.sqrt(max(0.0, found.u**2 - math.fsum(u * u for u in common)))
