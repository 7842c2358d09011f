"""Uncertainty of V_Vc: of the meter that measured it, else of the generator that it was set on."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.budget import Source
from vcfbench.procedures.shared.budget.line import limited
from vcfbench.records.schema import Point
from vcfbench.station.settings import V_VC_RANGE_V, Sources

_ONE_LEVEL = 0.02
"""Levels that differ by no more of themselves are taken to be on one range, wherever the ranges are."""


class KnownLevels(Struct, frozen=True):
    """Source and uncertainty of V_Vc: gain and offset errors are the same at all levels of one of its ranges.

    Where nobody knows the ranges (`ranges_v` is empty), they are taken to be those that make each value least certain.
    """

    by: str
    ranges_v: tuple[float, ...]
    """Largest level of each range, V."""
    gain: float | None
    offset_v: float | None
    sigmas: float | None
    besides: str
    """Name of the error that every level has of its own."""
    u_besides_v: Callable[[float], float]
    """Standard uncertainty of one level of the virtual line by that, V."""
    reading_v: float | None
    """Scatter of one reading of V_Vc, V; None where it was set."""

    def range_of(self, level_v: float) -> int:
        """Return the place of the range that a level is on."""
        return next((n for n, upper in enumerate(self.ranges_v) if abs(level_v) <= upper), len(self.ranges_v) - 1)

    def offset_limit_v(self, low_v: float) -> float:
        """Return the limit of the offset of a range whose levels begin at `low_v`, V, as that of a rectangle.

        A data sheet limits the error of a level, gain V + offset: the offset of a range may be as large as its lowest
        level leaves room for. The limit is that of the same variance where any gain is as likely, and then any offset.
        """
        offset_v, room_v = self.offset_v or 0.0, (self.gain or 0.0) * low_v if self.reading_v is None else 0.0
        return math.sqrt(offset_v**2 + offset_v * room_v + room_v**2 / 3.0)

    def shared(self, kind: str, volts: Floats, weights: Floats) -> list[tuple[str, NDArray[np.bool_], float]]:
        """Return the shared errors of levels: the ranges by name, the levels on each, and the limit of the error there.

        `kind` is ``"gain"`` or ``"offset"``; a unit of the error adds `weights`, by level.
        """
        limit = self.offset_limit_v if kind == "offset" else lambda _low_v: self.gain or 0.0
        if self.ranges_v:
            own, lows = np.array([self.range_of(each) for each in volts]), (0.0, *self.ranges_v)
            return [(f"{self.ranges_v[n]:g} V range", own == n, limit(lows[n])) for n in sorted(set(own.tolist()))]
        found = []
        # The levels without their sign; those within 2 % of one another have the same
        sizes, first = np.abs(volts), 0.0
        for place in np.argsort(sizes):
            first = first if sizes[place] <= (1.0 + _ONE_LEVEL) * first else float(sizes[place])
            sizes[place] = first
        for here in _worst_ranges(sizes, weights, limit):
            low_v, high_v = float(np.abs(volts[here]).min()), float(np.abs(volts[here]).max())
            found.append((f"{low_v:.3g} to {high_v:.3g} V", here, limit(low_v)))
        return found

    def covariance_v2(self, volts: Floats) -> Floats:
        """Return the covariance of the errors of levels, of each its own and of a range in common, V^2.

        Where nobody knows the ranges a level shares its range with its opposite.
        """
        ranges = np.array([self.range_of(each) for each in volts]) if self.ranges_v else np.abs(volts)
        lows_v = [(0.0, *self.ranges_v)[each] for each in ranges] if self.ranges_v else ranges
        offset_v = np.array([self.offset_limit_v(float(each)) for each in lows_v])
        shared = ((self.gain or 0.0) ** 2 * np.outer(volts, volts) + np.outer(offset_v, offset_v)) / 3.0
        own_v = np.array([self.u_besides_v(each) for each in volts])
        own = (volts[:, None] == volts) * np.outer(own_v, own_v)
        return np.asarray((ranges[:, None] == ranges) * shared + own)

    def errors(self, moved: Mapping[str, tuple[Floats, Floats]]) -> tuple[list[Source], dict[str, dict[str, float]]]:
        """Return the sources of errors that levels share, and the effect of one unit of each on each value.

        `moved` holds of each value the levels, V, and what a volt of error of each of them adds to it.
        """
        sources: dict[str, Source] = {}
        effects: dict[str, dict[str, float]] = {value: {} for value in moved}
        for value, (volts, through) in moved.items():
            of = "" if self.ranges_v else f": {value}"  # the worst of one value is not that of another
            for kind, unit, weights in (("gain", "1", through * volts), ("offset", "V", through)):
                for where, here, limit in self.shared(kind, volts, weights):
                    name = f"{self.by} {kind}, {where}{of}"
                    sources[name] = limited(name, limit, unit, self.sigmas)
                    effects[value][name] = float(weights[here].sum())
        return list(sources.values()), effects

    def covariances(self, volts: Floats, per_v: Floats, counts: int) -> Iterator[tuple[str, str, Floats]]:
        """Yield the covariance of several values by errors that levels share, by kind and range.

        `per_v`, (values, levels), is what a volt of error of each level adds to each value; where no ranges are known,
        those that are worst for the value at the place `counts` count.
        """
        for kind, effects in (("gain", per_v * volts), ("offset", per_v)):
            for where, here, limit in self.shared(kind, volts, effects[counts]):
                moved = effects[:, here].sum(axis=1) * limit / (self.sigmas or math.sqrt(3.0))
                yield kind, where, np.outer(moved, moved)

    def u_mean_v(self, level_v: float, per_reading: float) -> float:
        """Return the standard uncertainty of a level's own error, V, the mean of 1 / `per_reading` readings."""
        return self.u_besides_v(level_v) if self.reading_v is None else self.reading_v * math.sqrt(per_reading)


class LevelEffects(Struct, frozen=True):
    """Errors of V_Vc, which is known `by` meter or generator, and the effect of a unit of each on each value."""

    sources: tuple[Source, ...]
    by: str
    effects: Mapping[str, Mapping[str, float]]

    def through(self, value: str, q: Mapping[str, Any]) -> Any:
        """Return the effect of the errors of V_Vc on a value."""
        return sum(size * q[name] for name, size in self.effects[value].items())


def known_levels(points: Sequence[Point], known: Sources) -> KnownLevels:
    """Return the uncertainty of V_Vc: of the meter that measured it, else of the generator that it was set on."""
    scatter_v = [point.v_vc_std_v for point in points if point.v_vc_std_v is not None]
    if not scatter_v:
        ranges, reach_v = known.generator_ranges_v, known.generator_reach_v

        def resolved(level_v: float) -> float:
            upper_v = next((each for each in ranges if abs(level_v) <= each), reach_v)
            bits = known.generator_bits
            return 2.0 * upper_v / 2**bits / math.sqrt(12.0) if bits and math.isfinite(upper_v) else 0.0

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


def _worst_ranges(sizes: Floats, weights: Floats, limit: Callable[[float], float]) -> Iterator[NDArray[np.bool_]]:
    """Yield which levels are on each range, the ranges so that the sum of the levels' errors is least certain.

    An error that a range shares adds the square of the sum of its weights, times its limit: best[n] is the largest sum
    of squares that ranges up to the n-th size can make, found from the smaller ones.
    """
    steps = np.array(sorted(set(sizes.tolist())))  # np.unique would load numpy.ma
    limits = np.array([limit(each) for each in steps.tolist()])
    place = np.searchsorted(steps, sizes).ravel()
    total = np.concatenate([[0.0], np.cumsum(np.bincount(place, weights=weights))])
    best, begins = np.zeros(steps.size + 1), np.zeros(steps.size + 1, dtype=int)
    for end in range(1, steps.size + 1):
        made = best[:end] + (limits[:end] * (total[end] - total[:end])) ** 2
        begins[end] = made.argmax()
        best[end] = made[begins[end]]
    end = steps.size
    while end:
        yield (place >= begins[end]) & (place < end)
        end = int(begins[end])
