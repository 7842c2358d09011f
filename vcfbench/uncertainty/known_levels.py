"""Uncertainty of V_Vc: of the meter that measured it, else of the generator that it was set on."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from msgspec import Struct, structs
from numpy.typing import NDArray

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.budget import Source
from vcfbench.records.schema import Point
from vcfbench.station.settings import V_VC_RANGE_V, Sources
from vcfbench.uncertainty.line import limited
from vcfbench.values.sources import Errors, SourceName

_ONE_LEVEL = 0.02
"""Levels that differ by no more of themselves are taken to be on one range, wherever the ranges are."""


class LevelEffects(Struct, frozen=True):
    """Errors of V_Vc, which is known `by` meter or generator, and the effect of a unit of each on each value."""

    sources: tuple[Source, ...]
    by: str
    effects: Mapping[str, Mapping[SourceName, float]]

    def through(self, value: str, q: Errors) -> Any:
        """Return the effect of the errors of V_Vc on a value."""
        return sum(size * q[name] for name, size in self.effects[value].items())


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

    def shared(self, volts: Floats, per_v: Floats, counts: int = 0) -> Iterator[tuple[str, str, Floats, Source]]:
        """Yield the errors that levels share: ``"gain"`` or ``"offset"``, range, effect on each value, and the error.

        `per_v`, (values, levels), is what a volt of error of each level adds to each value; where no ranges are known,
        those that are worst for the value at the place `counts` count.
        """
        gain = "gain", "1", per_v * volts, lambda _low_v: self.gain or 0.0
        kinds, sizes_v = (gain, ("offset", "V", per_v, self.offset_limit_v)), np.abs(volts)
        if self.ranges_v:
            own, lows_v = np.array([self.range_of(each) for each in volts]), (0.0, *self.ranges_v)
            on = [(n, f"{self.ranges_v[n]:g} V range") for n in sorted(set(own.tolist()))]
            ranges = [(kind, where, own == n, lows_v[n]) for n, where in on for kind in kinds]
        else:
            ranges = [(kind, *each) for kind in kinds for each in _worst_ranges(sizes_v, kind[2][counts], kind[3])]
        for (kind, unit, effects, limit), where, here, low_v in ranges:
            error = limited(f"{self.by} {kind}, {where}", limit(low_v), unit, self.sigmas)
            yield kind, where, effects[:, here].sum(axis=1), error

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

    def errors(self, moved: Mapping[str, tuple[Floats, Floats]], own: Mapping[str, tuple[Any, ...]]) -> LevelEffects:
        """Return the errors of levels, and the effect of one unit of each on each value.

        `moved` holds of each value the levels, V, and what a volt of error of each of them adds to it; `own` is what
        the levels' own errors make of it, as a :class:`Source` has it: u, unit, degrees of freedom, rectangular.
        """
        sources: dict[SourceName, Source] = {}
        effects: dict[str, dict[SourceName, float]] = {value: {} for value in moved}
        for value, (volts, through) in moved.items():
            of = "" if self.ranges_v else f": {value}"  # the worst of one value is not that of another
            for _, _, effect, error in sorted(self.shared(volts, through[None]), key=lambda each: each[0]):
                name = SourceName(f"{error.name}{of}")
                sources[name], effects[value][name] = structs.replace(error, name=name), float(effect[0])
        for value, stated in own.items():
            name = SourceName(f"{self.by} {self.besides}: {value}")
            sources[name], effects[value][name] = Source(name, 0.0, *stated), 1.0
        return LevelEffects(tuple(sources.values()), self.by, effects)

    def u_mean_v(self, level_v: float, per_reading: float) -> float:
        """Return the standard uncertainty of a level's own error, V, the mean of 1 / `per_reading` readings."""
        return self.u_besides_v(level_v) if self.reading_v is None else self.reading_v * math.sqrt(per_reading)


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


def _worst_ranges(
    sizes: Floats, weights: Floats, limit: Callable[[float], float]
) -> Iterator[tuple[str, NDArray[np.bool_], float]]:
    """Yield the ranges that make the sum of the levels' errors least certain: in words, the levels there, the lowest.

    An error that a range shares adds the square of the sum of its weights, times its limit: best[n] is the largest sum
    of squares that ranges up to the n-th size can make, found from the smaller ones.
    """
    # Levels within 2 % of one another have the same size
    alike, first = sizes.copy(), 0.0
    for at in np.argsort(sizes):
        first = first if sizes[at] <= (1.0 + _ONE_LEVEL) * first else float(sizes[at])
        alike[at] = first
    steps = np.array(sorted(set(alike.tolist())))  # np.unique would load numpy.ma
    limits = np.array([limit(each) for each in steps.tolist()])
    place = np.searchsorted(steps, alike).ravel()
    total = np.concatenate([[0.0], np.cumsum(np.bincount(place, weights=weights))])
    best, begins = np.zeros(steps.size + 1), np.zeros(steps.size + 1, dtype=int)
    for end in range(1, steps.size + 1):
        made = best[:end] + (limits[:end] * (total[end] - total[:end])) ** 2
        begins[end] = made.argmax()
        best[end] = made[begins[end]]
    end = steps.size
    while end:
        here = (place >= begins[end]) & (place < end)
        low_v, high_v = float(sizes[here].min()), float(sizes[here].max())
        yield f"{low_v:.3g} to {high_v:.3g} V", here, low_v
        end = int(begins[end])
