"""Faults that a run cannot see: the smallest step, pulse, ramp and change of gain that its own tests refuse.

A fault is a pattern in time over all windows of the run. The tests (:mod:`vcfbench.belief.jumps`) say
at which size each is refused with 95 %; what it does to a value at that size is how the value moves when the windows
are moved so and evaluated again.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import count
from typing import Any, TypeAlias

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from vcfbench.analysis.arrays import Floats
from vcfbench.belief.agreement import SLOPES
from vcfbench.belief.in_turn import DEG, InTurn
from vcfbench.belief.jumps import GAIN, OFFSET, V_VC_GAIN, V_VC_OFFSET, groups, patterns, refused_from
from vcfbench.belief.patterns import MOST_WINDOWS
from vcfbench.belief.walk import Limits, Seen, Walk
from vcfbench.errors import ConfigError, MeasurementError
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
_MOST_DEG = 45.0
"""The same of a phase."""
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
    """A possible fault of a run: below `size` the run does not refuse it.

    `size` is in V, or relative of a gain, or in `unit` of `what`; None where none is refused, and `effects` are those
    of 1 mV, or 0.1 %.
    `effects` has by name, in its unit, what may have moved each value by more than a third of its U95. `why` says why
    no size is refused.
    """

    kind: str
    size: float | None
    unit: str
    effects: Mapping[str, float]
    why: str = ""
    what: str = ""
    """What is another, of records that are no windows."""


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

    @property
    def marks(self) -> NDArray[np.intp]:
        """Windows at which faults begin, or before which they end, (m,): all, of very many some."""
        number = len(self.windows)
        some = number if number <= MOST_WINDOWS else max(16, MOST_WINDOWS**2 // number)
        return np.unique(np.rint(np.linspace(0, number, some + 1)).astype(np.intp))


def course_of(settings: ProcedureSettings, steps: Sequence[tuple[Step, StepResult]], watched: Watched | None) -> Course:
    """Return the windows among the performed steps; without `watched` no window was compared."""
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
    """Yield the faults below the limits that may have moved a value by more than a third of its U95.

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
    at_s, places, marks = course.at_s, np.arange(len(points)), course.marks
    of_begin, of_end = np.nonzero(np.triu(np.ones((len(marks), len(marks)), dtype=bool), 1))
    begin, end = (marks[each].astype(np.int32) for each in (of_begin, of_end))
    to_an_end, all_through = (begin == 0) | (end == len(points)), end - begin == len(points)
    rise = np.maximum(0.0, at_s - at_s[marks[:-1], None]) / np.maximum(at_s[-1] - at_s[marks[:-1]], 1e-9)[:, None]
    walks = np.arange(len(begin) + len(rise)) >= len(begin)  # behind the stretches

    def apart(some: Floats) -> Floats:
        return np.concatenate([some, np.zeros(len(rise), dtype=bool)])

    for unit, (per_v, scale) in units.items():
        if not per_v.any():
            continue
        stretched, walked = smallest_sizes(course, unit)
        sizes = np.concatenate([stretched[of_begin, of_end], walked])
        del stretched
        sums = np.concatenate([np.zeros((len(per_v), 1)), np.cumsum(per_v * scale, axis=1)], axis=1)
        risen = (per_v * scale) @ rise.T
        kinds = {"change": apart(~all_through), "creep": walks}
        if unit in OFFSETS:
            kinds = {"step": apart(to_an_end & ~all_through), "pulse": apart(~to_an_end), "ramp": walks}

        def exactly(fault: int, size: float, unit: str = unit, scale: Floats = scale) -> Mapping[str, float]:
            stretch = (places >= begin[fault]) & (places < end[fault]) if not walks[fault] else rise[fault - len(begin)]
            return _moved(course, values, before, size * scale * stretch, of_v_vc=unit in {V_VC_OFFSET, V_VC_GAIN})

        never = np.isinf(sizes) | ((sizes > _MOST_GAIN) & (unit not in OFFSETS))
        for kind, own in kinds.items():
            for some, refused in ((own & ~never, True), (own & never, False)):
                at = np.flatnonzero(some)
                done = (  # by 1 of each, value by value: all together need much memory
                    np.abs(np.concatenate([each[end] - each[begin], rising]))[at]
                    for each, rising in zip(sums, risen, strict=True)
                )
                faults = _Faults(at, sizes[at] if refused else None)
                if found := faults.worst(done, u95, bent, exactly):
                    size, effects, worst = found
                    last = int(end[worst]) if worst < len(begin) else len(points)
                    first = int(begin[worst]) if worst < len(begin) else int(marks[worst - len(begin)])
                    moved = np.flatnonzero(per_v.any(axis=0))
                    why = "" if refused else _why(course, first, last, frozenset(moved.tolist()))
                    yield Unseen(kind, size, unit, effects, why)


def unseen_in_turn(
    each: InTurn, u95: Mapping[str, float], before: Mapping[str, float], values: Callable[[Floats], Mapping[str, float]]
) -> Iterator[Unseen]:
    """Yield the faults between records that may have moved a value; `values` are those with each visit moved, (n,)."""
    if (compared := each.compared()) is None:
        return
    found, states = compared.found, [visit.state for visit in each.visits]
    per = np.zeros((len(u95), found.count))
    for state in dict.fromkeys(states):  # visits of one state have the same weight
        alike = np.array([own == state for own in states])
        moved = values(_PROBE_V * alike)
        per[:, alike] = np.array([(moved[name] - before[name]) / _PROBE_V / alike.sum() for name in u95])[:, None]
    places, lasts = np.arange(found.count), max(found.count - 1, 1)
    rise = np.maximum(0.0, places - places[: max(0, found.count - 2), None]) / lasts
    sums = np.concatenate([np.zeros((len(per), 1)), np.cumsum(per, axis=1)], axis=1)
    done = np.abs(np.concatenate([sums[:, found.end] - sums[:, found.begin], per @ rise.T], axis=1))
    sizes = found.smallest(compared.refused_from)
    walks, never = np.arange(done.shape[1]) >= len(found.begin), sizes > (_MOST_DEG if each.unit == DEG else _MOST_GAIN)
    for kind, own in (("change", ~walks), ("creep", walks)):
        for some, refused in ((own & ~never, True), (own & never, False)):
            at = np.flatnonzero(some)
            faults = _Faults(at, sizes[at] if refused else None)
            if worst := faults.worst(done[:, at], u95, frozenset(), lambda *_: {}):
                few = "the records are too few" if np.isfinite(sizes[at]).all() else "it looks like the measured effect"
                why = "" if refused else few
                yield Unseen(kind, worst[0], each.unit, worst[1], why, each.what)


def _why(course: Course, first: int, last: int, moving: frozenset[int]) -> str:
    """Return the reason for which a fault from window `first` to before `last` is refused at no size.

    `moving` are the windows that move a value.
    """
    place = {id(each): at for walk, places in course.walks for each, at in zip(walk.windows, places, strict=True)}
    parts = [frozenset(place[id(each)] for each in own) for walk, _ in course.walks for own in groups(walk)]
    spoilt = moving & frozenset(range(first, last))
    if not spoilt & frozenset().union(*parts):
        return "these windows are not compared with others"
    if len(parts) > 1 and all(part <= spoilt or not part & spoilt for part in parts):
        return "it comes between parts of the run that are not compared"
    return "it looks like the measured effect"


def smallest_sizes(course: Course, unit: str) -> tuple[Floats, Floats]:
    """Return from which size on the run refuses each stretch, (m, m), and each walk to the end, (m - 1,), by its marks.

    A stretch begins with the window of its row and ends before that of its column. A walk begins at the window, its
    size is that at the end of the run. Infinite where it is never refused, as where there are too many windows.
    """
    marks, at_s = course.marks, course.at_s
    stretches, walks = np.full((len(marks), len(marks)), math.inf), np.full(len(marks) - 1, math.inf)
    for walk, places in course.walks:
        where = {id(each): place for each, place in zip(walk.windows, places, strict=True)}
        for windows in groups(walk):
            own = np.array([where[id(each)] for each in windows])
            found = next(patterns(walk, windows, unit), None) if len(own) <= MOST_WINDOWS else None
            if found is None:
                continue
            smallest, table = found.smallest(refused_from(walk)), np.full((len(own) + 1,) * 2, math.inf)
            table[found.begin, found.end] = smallest[: len(found.begin)]
            at = np.searchsorted(own, marks)
            stretches = np.minimum(stretches, table[np.ix_(at, at)])
            # A walk that begins between two windows shows no less than that from the later one
            lasts_s = at_s[own[-1]] - at_s[own[0]]
            slopes = np.full(len(own) + 1, math.inf)
            slopes[: len(own) - 2] = smallest[len(found.begin) :] / lasts_s
            slopes[len(own) - 2] = table[-2, -1] / (at_s[own[-1]] - at_s[own[-2]])  # what moves the last window alone
            walks = np.minimum(walks, slopes[at[:-1]] * np.maximum(at_s[-1] - at_s[marks[:-1]], 1e-9))
    return stretches, walks


class _Faults(Struct, frozen=True):
    """Faults of one kind: their places among all, and from where on each is refused, (m,); None: at no size."""

    places: NDArray[np.intp]
    sizes: Floats | None

    def worst(
        self,
        done: Iterable[Floats],
        u95: Mapping[str, float],
        bent: frozenset[str],
        exactly: Callable[[int, float], Mapping[str, float]],
    ) -> tuple[float | None, Mapping[str, float], int] | None:
        """Return the size from which on all are refused that move a value, the largest effects, and a fault of these.

        None where none moves any. `done` is what 1 of each does to each value, (m,). What is `bent` is evaluated with
        the worst fault of each such value, the first of all and one in their middle.
        """
        places, sizes = self.places, self.sizes
        if not len(places):
            return None
        matters, share = np.zeros(len(places), dtype=bool), MATTERS_UNREFUSED if sizes is None else MATTERS
        most, worst, first = dict[str, float](), {0, len(places) // 2}, (0.0, 0)
        for (name, half), each in zip(u95.items(), done, strict=True):
            moved = each * (UNIT if sizes is None else sizes)
            matters |= moved > share * half
            most[name] = float(moved[at := int(moved.argmax())])
            worst |= {at} if name in bent else set()
            first = max(first, (most[name] / half, int(places[at])))
        for at in worst if bent else ():
            whole = exactly(int(places[at]), UNIT if sizes is None else float(sizes[at]))
            most |= {name: max(most[name], whole[name]) for name in bent}
        effects = {name: most[name] for name, half in u95.items() if most[name] > share * half}
        if not effects:
            return None
        size = None if sizes is None else float((sizes[matters] if matters.any() else sizes).max())
        return size, effects, first[1]


def _moved(
    course: Course, values: Evaluated, before: Mapping[str, float], by_window: Floats, *, of_v_vc: bool
) -> Mapping[str, float]:
    """Return the amount by which the values move from those `before` with each window moved by so much, V.

    None moves where the evaluation refuses such readings: the run would have stated nothing.
    """
    taken = [at for at, place in enumerate(course.places) if place is not None]
    moved, none = by_window[taken], np.zeros(len(taken))
    try:
        after = values(none, moved) if of_v_vc else values(moved, none)
    except (ConfigError, MeasurementError):
        return dict.fromkeys(before, 0.0)
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
