"""Measured data of a run, as the results of a procedure see it: its points, and all else that the journal keeps.

A run keeps its points in memory and nothing more; readings and what steps have found are in the journal, and are read
from there when they are asked for. So it is the same for a run that has just ended and for its record.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property, partial
from itertools import accumulate, pairwise
from operator import itemgetter
from typing import TYPE_CHECKING, Any, Self, TypeVar, overload

from msgspec import Struct
from msgspec.structs import replace

from vcfbench.analysis.correlation import Correlation
from vcfbench.records.schema import Point
from vcfbench.steps.decode import Recorded, result_of, step_of
from vcfbench.steps.step import Step, StepResult

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from vcfbench.station.settings import Sources

_Found = TypeVar("_Found", bound=StepResult)
_Mark = TypeVar("_Mark", bound=Step)
_Lines = Callable[[], Iterable[Mapping[str, Any]]]


class WindowReadings(Struct, frozen=True, eq=False):
    """The raw readings of one window: bench times at which they were asked for (s), and voltages (V), both (n,).

    `number` is that of the step in the run, from 1; `step` the step that took them.
    """

    number: int
    step: Step | Recorded
    t_s: NDArray[np.float64]
    voltage_v: NDArray[np.float64]


class Readings(Struct, frozen=True, eq=False):
    """All raw readings of a run, window after window."""

    windows: tuple[WindowReadings, ...]

    @property
    def t_s(self) -> NDArray[np.float64]:
        """Bench times of all readings, s, shape (n,)."""
        return _joined([window.t_s for window in self.windows])

    @property
    def voltage_v(self) -> NDArray[np.float64]:
        """Voltages of all readings, V, shape (n,)."""
        return _joined([window.voltage_v for window in self.windows])


class Measured(Sequence[Point]):
    """The points of a run, in the order of measurement, and the other contents of its journal.

    Args:
        points: the averaged points, as they were measured.
        lines: begins to read the journal: its lines, as :func:`vcfbench.records.journal.lines_of` gives them.
        known: whose certificates correct what is given out, points and readings alike; points count from one reference
            then, wherever the run paused, and scatter as their means do. None gives out what was read.

    >>> [f"{point.output_v:+.3f}" for point in run.measured], len(run.measured.readings.voltage_v)
    (['-0.167', '-0.041', '+0.084'], 15)
    """

    def __init__(self, points: Iterable[Point], lines: _Lines = tuple, known: Sources | None = None) -> None:
        self._raw = tuple(points)
        self._lines = lines
        self._parts: dict[type[Step], Any] = {}
        self._known = known if known is not None and (known.corrects or self._paused or self.growth > 1.0) else None
        if self._known is None:
            self._points = self._raw
        else:
            corrected = (self._known.corrected_point(point.referred()) for point in self._raw)
            grown = math.sqrt(self.growth)
            self._points = tuple(replace(point, std_v=grown * point.std_v) for point in corrected)

    def read_again_from(self, lines: _Lines) -> None:
        """Read the journal from `lines` from now on; data read already is kept."""
        self._lines = lines

    @overload
    def __getitem__(self, index: int) -> Point: ...

    @overload
    def __getitem__(self, index: slice) -> tuple[Point, ...]: ...

    def __getitem__(self, index: int | slice) -> Point | tuple[Point, ...]:
        return self._points[index]

    def corrected(self, known: Sources) -> Measured:
        """Return the run with the corrections of the meters' certificates, and with no others."""
        if self._known is None and not known.corrects and not self._paused and self.growth == 1.0:
            return self
        return self._with(self._raw, self._lines, known)

    @cached_property
    def growth(self) -> float:
        """Factor of the variance of windows' means, where their readings are not independent of each other.

        Raises:
            ConfigError: the journal cannot be read any more.
        """
        found = Correlation()
        for line in self._lines():
            if line.get("type") == "step" and "point" in line:
                found.add([each["voltage_v"] for each in line["result"].get("readings", ())])
        return found.growth

    def moved(self, output_v: Sequence[float], v_vc_v: Sequence[float]) -> Measured:
        """Return the run with the output of each point moved, V, (n,), and its measured V_Vc, V, (n,)."""
        return _Moved(self, tuple(zip(output_v, v_vc_v, strict=True)))

    def set_otherwise(self, share: float) -> Measured:
        """Return the run with V_Vc larger by `share` than it was set, at each point."""
        points = (replace(point, v_vc_v=(1.0 + share) * point.v_vc_v) for point in self._raw)
        return self._with(points, self._lines, self._known)

    def moved_within(self, readings_v: NDArray[np.float64]) -> Measured:
        """Return the run of one record with each of its readings moved, V, (n,)."""
        moved = _Moved(self, [(float(readings_v.mean()), 0.0)])
        moved.within_v = readings_v
        return moved

    def changed(self, change: Callable[[StepResult], StepResult]) -> Measured:
        """Return the run with each result that is no point as `change` makes it, in their order."""
        changed = _Moved(self, [(0.0, 0.0)] * len(self))
        changed.change = change
        return changed

    @property
    def _paused(self) -> bool:
        """True if some points count from another reference than the rest."""
        return any(point.moved_v for point in self._raw)

    def _with(self, points: Iterable[Point], lines: _Lines, known: Sources | None) -> Self:
        return type(self)(points, lines, known)

    def __len__(self) -> int:
        return len(self._points)

    def __repr__(self) -> str:
        return f"<Measured: {len(self)} points>"

    @property
    def readings(self) -> Readings:
        """Every reading of every window that came to its end; read from the journal when first asked for.

        Raises:
            ConfigError: the journal cannot be read any more.
        """
        return self._kept[0]

    def found(self, kind: type[_Found]) -> tuple[tuple[Step, _Found], ...]:
        """Return the results of `kind` or a subclass, each with its step, in the order of the run.

        Of a window too long for one line of the journal the result holds the point; its readings are in `readings`.

        Raises:
            ConfigError: the journal cannot be read any more.
        """
        return tuple((step, result) for step, result in self._kept[1] if isinstance(result, kind))

    @property
    def broken_off(self) -> bool:
        """True if the run was broken off and resumed: some of its steps are those of an earlier record.

        Raises:
            ConfigError: the journal cannot be read any more.
        """
        return len({line.get("taken_over") for line in self._lines() if line.get("type") == "step"}) > 1

    def parted(self, kind: type[_Mark]) -> tuple[tuple[_Mark, Measured], ...]:
        """Return each step of `kind` with the data measured from it to the next of them, or to the end of the run.

        So each part of a run in parts can be evaluated like a run.

        Raises:
            ConfigError: the journal cannot be read any more.
        """
        if kind in self._parts:
            parts: tuple[tuple[_Mark, Measured], ...] = self._parts[kind]
            return parts
        marks: list[tuple[_Mark, int, int]] = []
        points = 0
        for line in self._lines():
            if line.get("type") != "step":
                continue
            if line["step_kind"] == kind.__name__:
                step = step_of(line)
                if isinstance(step, kind):
                    marks.append((step, line["n"], points))
            points += "point" in line
        ends: list[tuple[int | None, int]] = [*((begin, first) for _, begin, first in marks[1:]), (None, len(self))]
        found = tuple(
            (step, self._with(self._raw[first:last], partial(_between, self._lines, begin, end), self._known))
            for (step, begin, first), (end, last) in zip(marks, ends, strict=False)  # without marks there is an end
        )
        self._parts[kind] = found
        return found

    @cached_property
    def _point_numbers(self) -> tuple[int, ...]:
        """Numbers of the steps that took the points."""
        return tuple(line["n"] for line in self._lines() if line.get("type") == "step" and "point" in line)

    @cached_property
    def _kept(self) -> tuple[Readings, tuple[tuple[Step, StepResult], ...]]:
        """Go through the journal once: one window's readings are in memory as they stand there, the rest as arrays."""
        windows, found, known = [], [], self._known
        for line, readings in _steps(self._lines()):
            step, result = step_of(line), result_of(line)
            if readings:
                import numpy as np  # noqa: PLC0415  # as above

                rows = np.concatenate(readings)
                window = WindowReadings(line["n"], step, rows[:, 0].copy(), rows[:, 1].copy())
                if known is not None:
                    window = replace(window, voltage_v=known.corrected(window.voltage_v))
                windows.append(window)
            if isinstance(step, Step) and isinstance(result, StepResult):
                found.append((step, result if known is None else result.referred().corrected(step, known)))
        return Readings(tuple(windows)), tuple(found)


class Foreseen(Measured):
    """The points that a dry run foresees, with the noise that they may have; records of sines are foreseen without.

    `white_v_sqrt_s` is the random walk of the integrated output at rest.
    """

    def __init__(
        self, points: Iterable[Point], lines: _Lines, known: Sources | None = None, white_v_sqrt_s: float = 0.0
    ) -> None:
        super().__init__(points, lines, known)
        self.white_v_sqrt_s = white_v_sqrt_s

    def _with(self, points: Iterable[Point], lines: _Lines, known: Sources | None) -> Self:
        return type(self)(points, lines, known, self.white_v_sqrt_s)


class _Moved(Measured):
    """Data of a run, each point moved by so much output and V_Vc, V; other results are as `change` makes them.

    The readings of a window move with its mean, or each by its own of `within_v`.
    """

    within_v: NDArray[np.float64] | None = None
    change: Callable[[StepResult], StepResult] | None = None

    def __init__(self, of: Measured, moves: Sequence[tuple[float, float]]) -> None:
        self.growth = of.growth  # the journal is read once
        super().__init__(of._raw, of._lines, of._known)  # noqa: SLF001  # of the same class
        self._of, self._moves = of, moves
        self._points = tuple(point.moved(*move) for point, move in zip(of, moves, strict=True))

    def parted(self, kind: type[_Mark]) -> tuple[tuple[_Mark, Measured], ...]:
        parts = self._of.parted(kind)
        first = len(self) - sum(len(part) for _, part in parts)
        ends = accumulate((len(part) for _, part in parts), initial=first)
        moves = [self._moves[begin:end] for begin, end in pairwise(ends)]
        return tuple((step, _Moved(part, own)) for (step, part), own in zip(parts, moves, strict=True))

    @cached_property
    def _kept(self) -> tuple[Readings, tuple[tuple[Step, StepResult], ...]]:
        readings, found = self._of._kept  # noqa: SLF001  # as above
        moves = iter(self._moves)
        points = {id(each): next(moves) for _, each in found if each.recorded_point is not None}
        by_number = dict(zip(self._of._point_numbers, self._moves, strict=True))  # noqa: SLF001  # as above
        windows = []
        for each in readings.windows:
            moved_v = by_number.get(each.number, (0.0,))[0] if self.within_v is None else self.within_v
            windows.append(replace(each, voltage_v=each.voltage_v + moved_v))

        def moved(each: StepResult) -> StepResult:
            if id(each) in points:
                return each.moved(*points[id(each)])
            return each if self.change is None else self.change(each)

        return Readings(tuple(windows)), tuple((step, moved(each)) for step, each in found)


def _between(lines: _Lines, begin: int, end: int | None) -> Iterator[Mapping[str, Any]]:
    """Yield the lines of steps from number `begin` on, before `end`; None is that of all others."""
    for line in lines():
        number = line.get("n")
        if number is not None and begin <= number and (end is None or number < end):
            yield line


def _steps(lines: Iterable[Mapping[str, Any]]) -> Iterator[tuple[Mapping[str, Any], list[NDArray[np.float64]]]]:
    """Yield the line of each step that was performed, with its readings, a row each, in the pieces that are there."""
    chunks: list[NDArray[np.float64]] = []
    for line in lines:
        if line.get("type") == "readings":
            chunks.append(_rows(line["readings"]))
        elif line.get("type") in ("step", "error"):
            taken, chunks = chunks, []
            if line["type"] == "step":
                own = line["result"].get("readings", ())
                yield line, [*taken, _rows(own)] if own else taken


def _rows(readings: Sequence[Mapping[str, float]]) -> NDArray[np.float64]:
    import numpy as np  # noqa: PLC0415  # most results need points alone

    columns = [np.fromiter(map(itemgetter(name), readings), np.float64, len(readings)) for name in ("t_s", "voltage_v")]
    return np.column_stack(columns)


def _joined(arrays: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    import numpy as np  # noqa: PLC0415  # as above

    return np.concatenate(arrays) if arrays else np.empty(0)
