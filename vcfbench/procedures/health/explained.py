"""Explanation of a change of the scale factor since the certificate, with its size, and the rest."""

import math
from typing import NamedTuple

from vcfbench.devices.thermometer import rise_by_drive, thermometer
from vcfbench.records.device_values import Characteristics, Measured
from vcfbench.reports.document import Text
from vcfbench.values.printing import grouped
from vcfbench.values.value import Measurand


class Rise(NamedTuple):
    """Rise of the device's temperature, K, its standard uncertainty, and its source."""

    kelvin: float
    u: float
    by: str


def rise_since(then: Characteristics, now: Characteristics) -> Rise | None:
    """Return the rise of temperature, from the drive's frequency if measured, else as stated, or None."""
    if then.drive_hz is not None and now.drive_hz is not None and (per_k := thermometer(then.drive_ppm_k)):
        before, after = ((each.value, each.u) for each in (then.drive_hz, now.drive_hz))
        return Rise(*rise_by_drive(before, after, per_k), "the drive's frequency")
    if then.temperature_c is not None and now.temperature_c is not None:
        kelvin = now.temperature_c.value - then.temperature_c.value
        return Rise(kelvin, math.hypot(now.temperature_c.u, then.temperature_c.u), "temperature_c")
    return None


def explained_parts(change_ppm: Measurand, then: Characteristics | None, now: Characteristics | None) -> list[Text]:
    """Return the part of a change that temperature and rails explain, and the rest; empty if neither is known."""
    if then is None or now is None:
        return []
    unmoved: list[str] = []
    causes: list[tuple[str, float, float, Measured | None, str]] = []
    if (rise := rise_since(then, now)) is not None and abs(rise.kelvin) <= 2.0 * rise.u:
        unmoved.append(f"the temperature, unchanged within {2.0 * rise.u:.1f} K (U95)")
    elif rise is not None:
        words = f"{rise.kelvin:+.1f} K (U95 {2.0 * rise.u:.1f}, by {rise.by})"
        causes.append((words, rise.kelvin, rise.u, then.table_slope_ppm_k, "vcfbench run temperature --by table"))
    rails = [(then.positive_rail_v, now.positive_rail_v), (then.negative_rail_v, now.negative_rail_v)]
    known = [(before, after) for before, after in rails if before is not None and after is not None]
    if len(known) == len(rails):
        wider_v = sum(abs(after.value) - abs(before.value) for before, after in known) / len(rails)
        u_v = math.hypot(*(each.u for pair in known for each in pair)) / len(rails)
        if abs(wider_v) <= 2.0 * u_v:
            unmoved.append(f"the rails, unchanged within {2.0 * u_v:.3f} V (U95)")
        else:
            words = f"{wider_v:+.3f} V of both rails"
            causes.append((words, wider_v, u_v, then.table_slope_ppm_v, "vcfbench run power --by table"))
    said, left, square = [], change_ppm.value, change_ppm.u95**2
    for words, by, u_by, slope, ask in causes:
        if slope is None:
            said.append(f"{words}, effect on this device not known ({ask})")
            continue
        u = math.hypot(slope.u * by, slope.value * u_by)
        said.append(f"{slope.value * by:+.0f}±{grouped(2.0 * u)} ppm by {words}")
        left -= slope.value * by
        square += 4.0 * u**2
    what = "; ".join(said) or f"nothing ({'; '.join(unmoved) or 'temperature and rails were not compared'})"
    seen = "more than its U95" if abs(left) > math.sqrt(square) else "within its U95"
    return [
        Text(
            f"The scale factor has changed by {change_ppm.value:+.0f} ppm since the certificate. Explained by: "
            f"{what}. Unexplained: {left:+.0f}±{grouped(math.sqrt(square))} ppm, {seen}."
        )
    ]
