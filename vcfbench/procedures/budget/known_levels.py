"""What V_Vc is known by, and how well: the meter that measured it, else the generator that it was set on."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from msgspec import Struct

from vcfbench.bench.settings import V_VC_RANGE_V

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from vcfbench.bench.settings import Sources
    from vcfbench.record.schema import Point

__all__ = ["KnownLevels", "known_levels"]


class KnownLevels(Struct, frozen=True):
    """What V_Vc is known by, and how well: gain and offset are the same at all levels of one of its ranges."""

    by: str
    ranges_v: tuple[float, ...]
    gain: float | None
    offset_v: float | None
    sigmas: float | None
    besides: str
    """What every level has of its own."""
    u_besides_v: Callable[[float], float]
    """Of one level of the virtual line, V."""
    reading_v: float | None
    """Scatter of one reading of V_Vc, V; None where it was set."""

    def range_of(self, level_v: float) -> int:
        """Return the place of the range that a level is on."""
        return next((n for n, upper in enumerate(self.ranges_v) if abs(level_v) <= upper), len(self.ranges_v) - 1)

    def u_mean_v(self, level_v: float, per_reading: float) -> float:
        """Return the standard uncertainty of what a level has of its own, V, the mean of 1 / `per_reading` readings."""
        return self.u_besides_v(level_v) if self.reading_v is None else self.reading_v * math.sqrt(per_reading)


def known_levels(points: Sequence[Point], known: Sources) -> KnownLevels:
    """Return what V_Vc is known by: the meter that measured it, else the generator that it was set on."""
    scatter_v = [point.v_vc_std_v for point in points if point.v_vc_std_v is not None]
    if not scatter_v:
        ranges = known.generator_ranges_v or (math.inf,)

        def resolved(level_v: float) -> float:
            upper_v = next((each for each in ranges if abs(level_v) <= each), ranges[-1])
            return _step_v(upper_v, known.generator_bits) / math.sqrt(12.0)

        gain, offset_v = known.generator_gain, known.generator_offset_v
        return KnownLevels("generator", ranges, gain, offset_v, None, "resolution", resolved, None)
    pooled_v = math.sqrt(math.fsum(each**2 for each in scatter_v) / len(scatter_v))
    samples = min(point.n for point in points)
    return KnownLevels(
        "V_Vc meter",
        (V_VC_RANGE_V,),
        known.v_vc_gain,
        known.v_vc_offset_v,
        known.v_vc_sigmas,
        "readings",
        lambda _level_v: pooled_v / math.sqrt(samples),
        pooled_v,
    )


def _step_v(upper_v: float, bits: int) -> float:
    return 2.0 * upper_v / 2**bits if bits and math.isfinite(upper_v) else 0.0
