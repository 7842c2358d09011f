"""Scatter of the readings of a window, tested against that of the other windows of the run.

Nothing is known of a gyroscope's noise beforehand, so the run itself is the measure: each window is held against all
others. Within a window the readings stand about a straight line, because a gyroscope that warms up drifts; how far the
farthest of them stands from it, against the scatter of all the others of the run, is Student's t, and the scatter of
the window against that of the run is Fisher's F. A window is refused when chance would do so once in `FALSE_ALARM`.

A window too long for one chunk of the journal is held against the run chunk by chunk, as soon as each is closed: over
hours nothing drifts along a straight line, over a minute it does.
"""

import math
from collections.abc import Sequence
from itertools import accumulate, combinations
from statistics import fmean

from msgspec import Struct, field

from vcfbench.values.quantile import f_is_improbable, t_tail

FALSE_ALARM = 1e-9
"""Probability that one test refuses a window of Gaussian, stationary noise.

A calibration of 43 windows makes 170 tests: one honest run in six million is refused, not one in a thousand.
"""

_LEAST_RATIO = 3.0
"""A window may scatter three times as much as the run or as little, whatever its number of readings.

Noise may grow with the rate, and the windows of a run are taken at different rates.
"""

_NEVER = 5.9
"""Below so many standard deviations no number of readings makes a reading improbable enough: not worth the tail."""

_STILL = 0.5
"""Steps of the last digit by which readings of something that stands still may scatter."""

_TABLE = 5e-5
"""Ripple and flutter of a turning table, relative to the output's change by its rate: they add to the scatter.

Rate tables promise stabilities of 10 to 100 ppm; seen is only a gyroscope of less noise than that.
"""

_LIKE = 0.9
"""Share of the squares that a step must take away to be named; of noise alone it takes some 0.6."""

_DIES_AWAY = 5.0
"""First half of a window that settles over the second, both about the second's mean; of a straight line it is 3.7."""

_COUNTS = 5.0
"""Readings that are off by no more than so many steps of the meter's last digit are not looked at."""


class Scatter(Struct, frozen=True):
    """The scatter of one window about its straight line: sum of squares (V^2) with its degrees of freedom, its extreme.

    `table_v2` is what the table may add to the variance of one reading. `farthest` is the number of the reading that
    stands farthest, from 1; `distance_v` how far it stands from the line through the others, and `leverage` how much it
    would have drawn that line to itself.
    """

    n: int
    squares_v2: float
    degrees: int
    farthest: int
    residual_v: float
    leverage: float
    table_v2: float = 0.0
    readings_v: Sequence[float] = ()

    @property
    def std_v(self) -> float:
        """Standard deviation of one reading about the line, V."""
        return math.sqrt(self.squares_v2 / self.degrees)

    @property
    def distance_v(self) -> float:
        """Distance of the farthest reading from the line through the others, V."""
        return self.residual_v / (1.0 - self.leverage)

    @classmethod
    def of(cls, readings_v: Sequence[float], table_v2: float = 0.0) -> "Scatter | None":
        """Return the scatter of equally spaced readings; None for fewer than three, which are always on a line."""
        n = len(readings_v)
        if n < 3:
            return None
        middle, mean_v = 0.5 * (n - 1), math.fsum(readings_v) / n
        spread = n * (n * n - 1) / 12.0
        slope_v = math.fsum((i - middle) * v for i, v in enumerate(readings_v)) / spread
        residuals = [v - mean_v - slope_v * (i - middle) for i, v in enumerate(readings_v)]
        leverages = [1.0 / n + (i - middle) ** 2 / spread for i in range(n)]
        far = max(range(n), key=lambda i: residuals[i] ** 2 / (1.0 - leverages[i]))
        squares = math.fsum(residual * residual for residual in residuals)
        return cls(n, squares, n - 2, far + 1, residuals[far], leverages[far], table_v2, readings_v)


class NoiseSeen(Struct):
    """The scatter of the windows of a run so far; `resolution_v` is the step of the meter's last digit, V."""

    resolution_v: float
    _seen: int = 0
    _extremes: dict[str, tuple[int, Scatter]] = field(default_factory=dict)
    _squares_v2: float = 0.0
    _degrees: int = 0
    _table_squares_v2: float = 0.0
    _rest_v: float | None = None

    @property
    def std_v(self) -> float | None:
        """Standard deviation of one reading in all windows so far, V."""
        return math.sqrt(self._squares_v2 / self._degrees) if self._degrees else None

    def doubt(self, readings_v: Sequence[float], *, turning: bool = False) -> str:
        """Take the readings of one more window; name the doubt about it or an earlier one, empty if there is none.

        An earlier window is looked at again, for the first ones had little to be held against: the one with the reading
        that stands farthest, the one that scatters most, the one that scatters least. On a table that is `turning` the
        readings may scatter by its ripple besides, of the output's distance from the first window at rest.
        """
        if self._rest_v is None and not turning:
            self._rest_v = math.fsum(readings_v) / len(readings_v)
        moved_v = math.fsum(readings_v) / len(readings_v) - (self._rest_v or 0.0) if turning else 0.0
        scatter = Scatter.of(readings_v, (_TABLE * moved_v) ** 2)
        if scatter is None:
            return ""
        earlier = tuple(self._extremes.values())
        # Keep the windows that are looked at again, and no others: a run may have any number of them
        self._seen += 1
        variance_v2 = scatter.squares_v2 / scatter.degrees
        for name, is_beyond in (
            ("far", lambda most: _off_v2(scatter) > _off_v2(most)),
            ("wide", lambda most: variance_v2 > most.squares_v2 / most.degrees),
            ("narrow", lambda least: variance_v2 < least.squares_v2 / least.degrees),
        ):
            if name not in self._extremes or is_beyond(self._extremes[name][1]):
                self._extremes[name] = (self._seen, scatter)
        self._squares_v2 += scatter.squares_v2
        self._degrees += scatter.degrees
        self._table_squares_v2 += scatter.degrees * scatter.table_v2
        if said := self._complaint(scatter):
            return said
        for number, window in earlier:
            if said := self._complaint(window):
                return f"window {number} of the run: {said}"
        return ""

    def _complaint(self, window: Scatter) -> str:
        return self._outlier(window) or self._wide_or_narrow(window)

    def _outlier(self, window: Scatter) -> str:
        """Hold the farthest reading against the scatter of all other readings of the run (Student's t)."""
        off_v2 = _off_v2(window)
        degrees = self._degrees - 1
        if degrees < 1:
            return ""
        std_v = math.sqrt(max(0.0, self._squares_v2 - off_v2) / degrees + window.table_v2)
        std_v = max(std_v, self.resolution_v)
        if abs(window.distance_v) <= _COUNTS * self.resolution_v or off_v2 < (_NEVER * std_v) ** 2:
            return ""
        if window.n * t_tail(math.sqrt(off_v2) / std_v, degrees) >= FALSE_ALARM:
            return ""
        return (
            f"reading {window.farthest} of {window.n} is {window.distance_v:+.3g} V off the others, "
            f"where one reading scatters by {std_v:.2g} V{_likeness(window.readings_v)}"
        )

    def _wide_or_narrow(self, window: Scatter) -> str:
        """Hold the window's scatter against that of all other windows (Fisher's F)."""
        degrees = self._degrees - window.degrees
        if degrees < 1:
            return ""
        others_v2 = max(0.0, self._squares_v2 - window.squares_v2)
        run_v = math.sqrt(others_v2 / degrees + window.table_v2)
        above = (max(window.std_v, self.resolution_v) / max(run_v, self.resolution_v)) ** 2
        if above > _LEAST_RATIO**2 and f_is_improbable(above, window.degrees, degrees, chance=FALSE_ALARM):
            return (
                f"the readings scatter by {window.std_v:.2g} V, those of the other windows by {run_v:.2g} V"
                f"{_likeness(window.readings_v)}"
            )
        by_table_v2 = self._table_squares_v2 - window.degrees * window.table_v2
        run_v = math.sqrt(max(0.0, others_v2 - by_table_v2) / degrees)
        below = (run_v / max(window.std_v, _STILL * self.resolution_v, 1e-12)) ** 2
        if below > _LEAST_RATIO**2 and f_is_improbable(below, degrees, window.degrees, chance=FALSE_ALARM):
            return (
                f"the readings scatter by {window.std_v:.2g} V only, about {fmean(window.readings_v):+.4g} V, those of "
                f"the other windows by {run_v:.2g} V: a lead is off, the output is at its end, or the others were "
                f"disturbed{_likeness(self._extremes['wide'][1].readings_v)}"
            )
        return ""


def _off_v2(window: Scatter) -> float:
    """Return the amount by which the sum of squares falls when the farthest reading is left out, V^2."""
    return window.residual_v**2 / (1.0 - window.leverage)


def _likeness(readings_v: Sequence[float]) -> str:
    """Return the likely kind of readings that scatter too much, empty if there is none.

    A settling output is farthest off in the first reading, and its second half is quiet; ringing is as well.
    """
    n, half = len(readings_v), len(readings_v) // 2
    end_v = math.fsum(readings_v[half:]) / (n - half)
    off = [each - end_v for each in readings_v]
    sums = list(accumulate(off, initial=0.0))
    squares = math.fsum(each * each for each in off) - sums[n] ** 2 / n
    # Each span of readings against the others of the window
    most, size_v, first, end = 0.0, 0.0, 0, 0
    for begin, stop in combinations(range(1, n + 1), 2):
        share_n = (stop - begin) * (n - stop + begin) / n
        differ_v = (sums[stop] - sums[begin] - sums[n] * (stop - begin) / n) / share_n
        if stop - begin < n - 1 and differ_v * differ_v * share_n > most:
            most, size_v, first, end = differ_v * differ_v * share_n, differ_v, begin, stop
    if most > _LIKE * squares and n > 4:  # three or four look like anything
        if end - first == 1:
            return f": as a contact or a bump (leads, fixture){', or a step' * (end == n)}"
        if end == n:
            return f": it stepped by {size_v:+.2g} V at reading {first + 1} of {n}, and stayed there"
        where = f"from reading {first + 1} to {end} of {n}"
        return f": off by {size_v:+.2g} V {where}, and back, as a contact or a bump (leads, fixture)"
    quiet_v2 = _DIES_AWAY**2 * math.fsum(each * each for each in off[half:]) / (n - half)
    early = [each * each for each in off[:half]]
    if early[0] == max(each * each for each in off) and math.fsum(early) > quiet_v2 * half:
        alone = math.fsum(early[1:]) <= quiet_v2 * (half - 1)
        step = "a step, for the first reading alone is off, or " * alone
        return f": {step}it dies away from the first reading on, as what has not settled does (a longer settle_s)"
    return ""
