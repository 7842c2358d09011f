"""What a run cannot see: the smallest step, pulse, ramp and change of gain that its own tests would have refused.

A fault is a pattern in time over all windows of the run. The tests (:mod:`vcfbench.procedures.shared.steady.jumps`) say
at which size each is refused with 95 %; what it does to a value at that size is how the value moves when the windows
are moved so and evaluated again.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import count
from typing import Any, TypeAlias

import numpy as np
from msgspec import Struct

from vcfbench.analysis.arrays import Floats
from vcfbench.procedures.procedure import Watched
from vcfbench.procedures.shared.steady.jumps import GAIN, OFFSET, V_VC_GAIN, V_VC_OFFSET, groups, patterns, refused_from
from vcfbench.procedures.shared.steady.walk import Limits, Seen, Walk
from vcfbench.procedures.shared.sweep.agreement import SLOPES
from vcfbench.station.settings import ProcedureSettings
from vcfbench.steps.step import Step, StepResult

OFFSETS = frozenset({OFFSET, V_VC_OFFSET})
"""Units that are volts; the others are shares."""
MATTERS = 1.0 / 3.0
"""Share of U95 from which what is not seen is told: with less a value stays within 1.05 U95."""
UNIT = 1e-3
"""Size for which effects are told where none is refused: 1 mV, or 0.1 %."""
MATTERS_UNREFUSED = 0.1 * MATTERS
"""The same of what 1 mV, or 0.1 %, does where no size is refused: ten times as much is no rare fault."""
_MOST_GAIN = 1.0 - SLOPES[0]
"""A larger change of gain is no share of what the run answers: the slope between neighbours tells it."""
_PROBE_V = 1e-6
"""By how much a window is moved to see what it does: values are as good as linear in it."""
_MOST_PROBES = 32
"""Evaluations at most; of more windows neighbours at one setting are moved together."""


Evaluated: TypeAlias = Callable[[Floats, Floats], Mapping[str, float]]
"""Values by name with the points moved, V, (n,), and V_Vc as measured beside them, V, (n,)."""


class Unseen(Struct, frozen=True):
    """A kind of fault that a run may have had: below `size` it is not refused where it moves a value.

    `size` is in V, or relative of a gain; None where none is refused, and `effects` are those of 1 mV, or 0.1 %.
    `effects` has by name, in its unit, what may have moved each value by more than a third of its U95.
    """

    kind: str
    size: float | None
    unit: str
    effects: Mapping[str, float]


class Course(Struct, frozen=True):
    """The windows of a run in their order, each with its place among the points, None of a reference.

    `walks` are those that were watched, each with the places of its windows in this order.
    """

    windows: tuple[Seen, ...]
    places: tuple[int | None, ...]
    walks: tuple[tuple[Walk, tuple[int, ...]], ...]

    @property
    def at_s(self) -> Floats:
        """The middles of the windows, bench time, (n,)."""
        return np.array([each.middle_s for each in self.windows])


def course_of(settings: ProcedureSettings, steps: Sequence[tuple[Step, StepResult]], watched: Watched | None) -> Course:
    """Return the windows among the performed steps; without `watched` nothing was held against anything."""
    limits = Limits.of(settings)
    whole, walks = Walk(settings, limits), [(Walk(settings, limits), list[int]())]
    for step, result in steps:
        if watched is not None and watched.anew is not None and isinstance(step, watched.anew):
            walks.append((Walk(settings, limits), []))
        seen = whole.take(step, result)
        if seen is not None and watched is not None and (watched.steps is None or seen.point.step in watched.steps):
            walk, places = walks[-1]
            walk.add(seen)
            places.append(len(whole.windows) - 1)
    numbers = count()
    of_points = tuple(None if each.reference else next(numbers) for each in whole.windows)
    return Course(tuple(whole.windows), of_points, tuple((walk, tuple(places)) for walk, places in walks))


def unseen(course: Course, u95: Mapping[str, float], values: Evaluated) -> Iterator[Unseen]:
    """Yield the faults that would not have been refused and may have moved a value by more than a third of its U95.

    Args:
        course: the windows, and those that were watched.
        u95: of each value, in its unit.
        values: evaluates the run again.
    """
    points = [each.point for each in course.windows]
    output = np.array([point.output_v for point in points])
    v_vc = np.array([point.v_vc_measured_v or 0.0 for point in points])
    per_output, per_v_vc = (_per_volt(course, u95, values, of_v_vc=each) for each in (False, True))
    kinds = [(OFFSET, per_output), (GAIN, per_output * output), (V_VC_OFFSET, per_v_vc), (V_VC_GAIN, per_v_vc * v_vc)]
    at_s, number = course.at_s, len(points)
    begin, end = np.triu_indices(number + 1, 1)
    to_an_end, all_through = (begin == 0) | (end == number), end - begin == number
    for unit, effects in kinds:  # (values, windows): what a unit of each window does
        if not effects.any():
            continue
        stretches, walks = smallest_sizes(course, unit)
        # What a stretch does, (values, stretches), and a walk of 1 from each window to the end, (values, n)
        sums = np.concatenate([np.zeros((len(effects), 1)), np.cumsum(effects, axis=1)], axis=1)
        done, sizes = np.abs(sums[:, end] - sums[:, begin]), stretches[begin, end]
        rise = np.maximum(0.0, at_s - at_s[:, None]) / np.maximum(at_s[-1] - at_s, 1e-9)[:, None]
        walked = np.abs(effects @ rise.T)
        if unit in OFFSETS:
            kinds_of = {"step": to_an_end & ~all_through, "pulse": ~to_an_end}
        else:
            kinds_of = {"change": ~all_through}
        parts = [(kind, done[:, own], sizes[own]) for kind, own in kinds_of.items()]
        for kind, moved, size in [*parts, ("ramp" if unit in OFFSETS else "creep", walked, walks)]:
            never = np.isinf(size) | ((size > _MOST_GAIN) & (unit not in OFFSETS))
            for some, from_size in ((~never, size[~never]), (never, None)):
                if found := _of_kind(kind, unit, moved[:, some], from_size, u95):
                    yield found


def smallest_sizes(course: Course, unit: str) -> tuple[Floats, Floats]:
    """Return from which size on the run refuses each stretch, (n + 1, n + 1), and each walk to the end, (n,).

    A stretch begins with the window of its row and ends before that of its column. A walk begins at the window, its
    size is that at the end of the run. Infinite where it is never refused.
    """
    number, at_s = len(course.windows), course.at_s
    stretches, walks = np.full((number + 1, number + 1), math.inf), np.full(number, math.inf)
    for walk, places in course.walks:
        where = {id(each): place for each, place in zip(walk.windows, places, strict=True)}
        for windows in groups(walk):
            own = np.array([where[id(each)] for each in windows])
            found = next((each for each in patterns(walk, windows) if each.unit == unit), None)
            if found is None:
                continue
            smallest, table = found.smallest(refused_from(walk)), np.full((len(own) + 1,) * 2, math.inf)
            table[found.begin, found.end] = smallest[: len(found.begin)]
            at = np.searchsorted(own, np.arange(number + 1))
            stretches = np.minimum(stretches, table[np.ix_(at, at)])
            # A walk that begins between two windows shows no less than that from the later one
            lasts_s = at_s[own[-1]] - at_s[own[0]]
            slopes = np.full(len(own) + 1, math.inf)
            slopes[: len(own) - 2] = smallest[len(found.begin) :] / lasts_s
            walks = np.minimum(walks, slopes[at[:number]] * np.maximum(at_s[-1] - at_s, 1e-9))
    return stretches, walks


def _of_kind(kind: str, unit: str, done: Floats, size: Floats | None, u95: Mapping[str, float]) -> Unseen | None:
    """Return one kind of fault, None where it moves no value.

    `done`, (values, m), is what a size of 1 does, `size`, (m,), from where on it is refused, None: never.
    """
    limits = (MATTERS_UNREFUSED if size is None else MATTERS) * np.array(list(u95.values()))
    moved = done * (UNIT if size is None else size)
    matters = (moved > limits[:, None]).any(axis=0)  # of these places, where it does so much
    if not matters.any():
        return None
    most = zip(u95, moved.max(axis=1).tolist(), limits.tolist(), strict=True)
    effects = {name: each for name, each, limit in most if each > limit}
    return Unseen(kind, None if size is None else float(size[matters].max()), unit, effects)


def _per_volt(course: Course, u95: Mapping[str, float], values: Evaluated, *, of_v_vc: bool) -> Floats:
    """Return what a volt more in each window does to each value, (values, windows); 0 of references."""
    found = np.zeros((len(u95), len(course.windows)))
    taken = {
        at: place
        for at, (each, place) in enumerate(zip(course.windows, course.places, strict=True))
        if place is not None and (not of_v_vc or each.point.v_vc_measured_v is not None)
    }
    number = sum(place is not None for place in course.places)
    none = np.zeros(number)
    if not taken:
        return found
    before = values(none, none)
    for together in _probes(course, list(taken)):
        moved = np.zeros(number)
        moved[[taken[at] for at in together]] = _PROBE_V
        after = values(none, moved) if of_v_vc else values(moved, none)
        per_v = [(after[name] - before[name]) / (_PROBE_V * len(together)) for name in u95]
        found[:, together] = np.array(per_v)[:, None]
    return found


def _probes(course: Course, taken: Sequence[int]) -> list[list[int]]:
    """Return which windows are moved together: neighbours in time at one setting, where there are very many."""
    size = math.ceil(len(taken) / _MOST_PROBES)
    alike: dict[Any, list[int]] = {}
    for at in taken:
        alike.setdefault((course.windows[at].setting, course.windows[at].point.step), []).append(at)
    return [each[at : at + size] for each in alike.values() for at in range(0, len(each), size)]
