"""Corrections of a voltmeter's readings on a range by its certificate."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

from vcfbench.specifications import Accuracy, VoltmeterSpecification, accuracy_at
from vcfbench.station.parts import CalibrationPoint
from vcfbench.station.settings import MeterKnown


def certified(
    short: str, sheet: VoltmeterSpecification, known: MeterKnown, range_v: float, age_days: float
) -> dict[str, Any]:
    """Return corrections and standard uncertainties by the certificate's levels on a range, by the keys of Sources.

    What the meter drifted since is what the data sheet's limits grow by. What the levels do not tell, the gain at 0 V
    alone or the offset at one level, is that of the data sheet.
    """
    own = known.on(range_v)
    promised, sigmas = accuracy_at(sheet, range_v, age_days, known.outside_k)
    of_limit = math.sqrt(3.0) if sigmas is None else sigmas
    # By how much limits grow from a calibration to its age, and to a room outside of where they hold. A sheet without
    # limits of the first day has theirs grow from nothing, evenly up to the first age that it knows
    here, _ = accuracy_at(sheet, range_v, age_days)
    first = min(sheet.accuracy.get(range_v, {1: None}))
    fresh, _ = accuracy_at(sheet, range_v, 1.0)
    if first > 1:
        left = max(0.0, 1.0 - age_days / first)
        fresh = Accuracy(here.reading * left, here.range * left)
    grown = Accuracy(promised.reading - fresh.reading, promised.range - fresh.range)
    (slope, offset_v), (u_slope, u_offset_v) = _line(own)
    left_v = max(abs(each.correction_v - offset_v - slope * each.level_v) for each in own) / math.sqrt(3.0)
    u_gain = promised.reading / of_limit if u_slope is None else u_slope
    u_zero_v = promised.range * range_v / of_limit if u_offset_v is None else u_offset_v
    return {
        f"{short}_gain_correction": slope,
        f"{short}_offset_correction_v": offset_v,
        f"{short}_gain": math.hypot(u_gain, grown.reading / of_limit),
        f"{short}_offset_v": math.hypot(u_zero_v, grown.range * range_v / of_limit, left_v),
        f"{short}_sigmas": 1.0,
    }


def _line(own: Sequence[CalibrationPoint]) -> tuple[tuple[float, float], tuple[float | None, float | None]]:
    """Return slope and offset of the corrections, V, and their standard uncertainties; None: the levels do not tell it.

    Levels count by 1/u^2. Nobody tells how their errors go together: the uncertainties are those of the worst case.
    """
    us = [max(each.expanded_v / each.k, _LEAST_V) for each in own]
    weights = [1.0 / u**2 for u in us]
    total = math.fsum(weights)
    middle = math.fsum(w * each.level_v for w, each in zip(weights, own, strict=True)) / total
    spread = math.fsum(w * (each.level_v - middle) ** 2 for w, each in zip(weights, own, strict=True))
    if not spread > 1e-12 * total * max(each.level_v**2 for each in own):
        mean = math.fsum(w * each.correction_v for w, each in zip(weights, own, strict=True)) / total
        return ((mean / middle, 0.0), (max(us) / abs(middle), None)) if middle else ((0.0, mean), (None, max(us)))
    of_slope = [w * (each.level_v - middle) / spread for w, each in zip(weights, own, strict=True)]
    of_offset = [w / total - middle * each for w, each in zip(weights, of_slope, strict=True)]

    def applied(shares: Sequence[float]) -> Iterator[float]:
        yield math.fsum(share * each.correction_v for share, each in zip(shares, own, strict=True))
        yield math.fsum(abs(share) * u for share, u in zip(shares, us, strict=True))

    (slope, u_slope), (offset_v, u_offset_v) = applied(of_slope), applied(of_offset)
    return (slope, offset_v), (u_slope, u_offset_v)


_LEAST_V = 1e-12
"""Least standard uncertainty: a certificate that states none at a level makes no other level worthless."""
