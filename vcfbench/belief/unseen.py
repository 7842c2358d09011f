"""Faults that a run cannot see: the smallest step, pulse, ramp and change of gain that its own tests refuse.

A fault is a pattern in time over all windows of the run. The tests (:mod:`vcfbench.belief.jumps`) say
at which size each is refused with 95 %; what it does to a value at that size is how the value moves when the windows
are moved so and evaluated again.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import count
from typing import Any, TypeAlias

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from vcfbench.analysis.arrays import Floats
from vcfbench.belief.agreement import SLOPES
from vcfbench.belief.jumps import GAIN, OFFSET, V_VC_GAIN, V_VC_OFFSET, groups, patterns, refused_from
from vcfbench.belief.walk import Limits, Seen, Walk
from vcfbench.instructions.procedure import Watched
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
_MANY, _FEW_PROBES = 640, 8
"""From so many windows on so few: an evaluation takes time with their square."""
_MOST_SETTINGS = 64
"""More settings than that are moved with their neighbours."""


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


def unseen(
    course: Course, u95: Mapping[str, float], values: Evaluated, bent: frozenset[str] = frozenset()
) -> Iterator[Unseen]:
    """Yield the faults that would not have been refused and may have moved a value by more than a third of its U95.

    Args:
        course: the windows, and those that were watched.
        u95: of each value, in its unit.
        values: evaluates the run again.
        bent: names of values that are not linear in the windows, as a spread: evaluated with some faults whole.
    """
    points = [each.point for each in course.windows]
    ones, output = np.ones(len(points)), np.array([point.output_v for point in points])
    v_vc = np.array([point.v_vc_measured_v or 0.0 for point in points])
    none = np.zeros(sum(place is not None for place in course.places))
    before = values(none, none)
    per_output, per_v_vc = (_per_volt(course, u95, values, before, of_v_vc=each) for each in (False, True))
    units = {
        OFFSET: (per_output, ones),
        GAIN: (per_output, output),
        V_VC_OFFSET: (per_v_vc, ones),
        V_VC_GAIN: (per_v_vc, v_vc),
    }
    at_s, places = course.at_s, np.arange(len(points))
    begin, end = np.triu_indices(len(points) + 1, 1)
    to_an_end, all_through = (begin == 0) | (end == len(points)), end - begin == len(points)
    rise = np.maximum(0.0, at_s - at_s[:, None]) / np.maximum(at_s[-1] - at_s, 1e-9)[:, None]
    walks = np.arange(len(begin) + len(points)) >= len(begin)  # behind the stretches

    def apart(some: Floats) -> Floats:
        return np.concatenate([some, np.zeros(len(points), dtype=bool)])

    for unit, (per_v, scale) in units.items():
        if not per_v.any():
            continue
        stretched, walked = smallest_sizes(course, unit)
        sizes = np.concatenate([stretched[begin, end], walked])
        # What 1 of each does, (values, faults)
        sums = np.concatenate([np.zeros((len(per_v), 1)), np.cumsum(per_v * scale, axis=1)], axis=1)
        done = np.abs(np.column_stack([sums[:, end] - sums[:, begin], (per_v * scale) @ rise.T]))
        kinds = {"change": apart(~all_through), "creep": walks}
        if unit in OFFSETS:
            kinds = {"step": apart(to_an_end & ~all_through), "pulse": apart(~to_an_end), "ramp": walks}

        def exactly(fault: int, size: float, unit: str = unit, scale: Floats = scale) -> Mapping[str, float]:
            stretch = (places >= begin[fault]) & (places < end[fault]) if not walks[fault] else rise[fault - len(begin)]
            return _moved(course, values, before, size * scale * stretch, of_v_vc=unit in {V_VC_OFFSET, V_VC_GAIN})

        never = np.isinf(sizes) | ((sizes > _MOST_GAIN) & (unit not in OFFSETS))
        for kind, own in kinds.items():
            for some, refused in ((own & ~never, True), (own & never, False)):
                of_kind = _Faults(np.flatnonzero(some), done[:, some], sizes[some] if refused else None)
                if effects := of_kind.effects(u95, bent, exactly):
                    yield Unseen(kind, of_kind.size(u95), unit, effects)


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


class _Faults(Struct, frozen=True):
    """Faults of one kind: their places among all, what 1 of each does, (values, m), and from where on it is refused."""

    places: NDArray[np.intp]
    done: Floats
    sizes: Floats | None
    """(m,); None: at no size."""

    def _moved(self) -> Floats:
        return np.asarray(self.done * (UNIT if self.sizes is None else self.sizes))

    def _limits(self, u95: Mapping[str, float]) -> Floats:
        return (MATTERS_UNREFUSED if self.sizes is None else MATTERS) * np.array(list(u95.values()))

    def size(self, u95: Mapping[str, float]) -> float | None:
        """Return from which size on all are refused that move a value, None at none."""
        if self.sizes is None:
            return None
        matters = (self._moved() > self._limits(u95)[:, None]).any(axis=0)
        return float((self.sizes[matters] if matters.any() else self.sizes).max())

    def effects(
        self, u95: Mapping[str, float], bent: frozenset[str], exactly: Callable[[int, float], Mapping[str, float]]
    ) -> Mapping[str, float]:
        """Return the largest effect on each value that one of them moves."""
        if not len(self.places):
            return {}
        moved = self._moved()
        most = dict(zip(u95, moved.max(axis=1).tolist(), strict=True))
        # The worst of each that is not linear, the first of all and one in their middle
        worst = {int(moved[place].argmax()) for place, name in enumerate(u95) if name in bent}
        for at in {*worst, 0, len(self.places) // 2} if worst else ():
            whole = exactly(int(self.places[at]), UNIT if self.sizes is None else float(self.sizes[at]))
            most |= {name: max(most[name], whole[name]) for name in bent}
        limits = zip(u95, self._limits(u95).tolist(), strict=True)
        return {name: most[name] for name, limit in limits if most[name] > limit}


def _moved(
    course: Course, values: Evaluated, before: Mapping[str, float], by_window: Floats, *, of_v_vc: bool
) -> Mapping[str, float]:
    """Return the amount by which the values move from those `before` with each window moved by so much, V."""
    taken = [at for at, place in enumerate(course.places) if place is not None]
    moved, none = by_window[taken], np.zeros(len(taken))
    after = values(none, moved) if of_v_vc else values(moved, none)
    return {name: abs(after[name] - before[name]) for name in before}


def _per_volt(
    course: Course, u95: Mapping[str, float], values: Evaluated, before: Mapping[str, float], *, of_v_vc: bool
) -> Floats:
    """Return the effect of a volt more in each window on each value, (values, windows); 0 of references."""
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
    for together in _probes(course, list(taken)):
        moved = np.zeros(number)
        moved[[taken[at] for at in together]] = _PROBE_V
        after = values(none, moved) if of_v_vc else values(moved, none)
        per_v = [(after[name] - before[name]) / (_PROBE_V * len(together)) for name in u95]
        found[:, together] = np.array(per_v)[:, None]
    return found


def _probes(course: Course, taken: Sequence[int]) -> list[list[int]]:
    """Return which windows are moved together: neighbours in time at one setting, where there are very many.

    Of very many settings neighbouring ones.
    """
    size = math.ceil(len(taken) / (_MOST_PROBES if len(taken) < _MANY else _FEW_PROBES))
    alike: dict[Any, list[int]] = {}
    for at in taken:
        alike.setdefault((course.windows[at].point.step, course.windows[at].setting), []).append(at)
    if len(alike) > _MOST_SETTINGS:
        alike = {None: [at for level in sorted(alike) for at in alike[level]]}
    return [each[at : at + size] for each in alike.values() for at in range(0, len(each), size)]
