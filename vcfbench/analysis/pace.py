"""Times of the readings of a log: their interval, and its irregularities.

Times are written with few digits and kept by a clock that someone sets, so one step tells little: the interval is the
mean over the longest piece without a break. A break is where the times are ahead of an even row, or behind it, from
there on: a gap, or a clock that was set. A time that is late by itself, or written twice, is none.
"""

from itertools import pairwise

import numpy as np
from msgspec import Struct

from vcfbench.analysis.arrays import Floats
from vcfbench.errors import ConfigError

_BREAK = 0.75
"""Part of the interval by which the times must be ahead from there on."""
_STEPS = 10_000
"""Steps that tell to how many digits the times are written."""
_SIGMAS = 3.0
_COMMON = 0.05
"""Share of them that a step has that comes of rounding; a missing reading is rarer."""


class Pace(Struct, frozen=True):
    """Interval of a log, the rows of its longest piece without a break, and the rows at which something is uneven.

    A break, repeat or step backwards has the number of the row behind it, from 0.
    """

    interval_s: float
    begin: int
    end: int
    jitter_s: float
    """Standard deviation of the steps in that piece."""
    breaks: tuple[int, ...]
    repeats: tuple[int, ...]
    backwards: tuple[int, ...]


def pace_of(times_s: Floats) -> Pace:
    """Return the pace of a log from its times, s, shape (n,).

    Raises:
        ConfigError: there are fewer than three times, most of them repeat, or they run backwards.
    """
    if times_s.size < 3:
        raise ConfigError(f"{times_s.size} times are too few to give the interval of the readings")
    steps = np.diff(times_s)
    usual = float(np.median(steps))
    if usual <= 0.0:
        kind = "run backwards" if usual < 0.0 else "repeat"
        raise ConfigError(f"most of the times {kind}, so the interval of the readings is unknown")
    ahead = np.concatenate([[0.0], np.cumsum(steps - usual)])
    before = np.concatenate([ahead[:1], ahead[:-1]])
    after = np.concatenate([ahead[1:], ahead[-1:]])
    allowed = max(_BREAK * usual, 1.5 * _least_digit(steps))
    gone_ahead = np.minimum(ahead[1:], after[1:]) - np.maximum(ahead[:-1], before[:-1]) > allowed
    gone_back = np.maximum(ahead[1:], after[1:]) - np.minimum(ahead[:-1], before[:-1]) < -allowed
    breaks = np.flatnonzero(gone_ahead | gone_back) + 1
    edges = [0, *breaks.tolist(), times_s.size]
    begin, end = max(pairwise(edges), key=lambda piece: piece[1] - piece[0])
    if end - begin < 3:
        raise ConfigError("no three times in a row are even, so the interval of the readings is unknown")
    interval_s = float(times_s[end - 1] - times_s[begin]) / (end - 1 - begin)
    jitter_s = float(np.std(steps[begin : end - 1]))
    # What times that scatter do not tell from a whole number of readings a second, or of seconds, is one
    whole_s = 1.0 / round(1.0 / interval_s) if interval_s <= 1.0 else float(round(interval_s))
    if abs(whole_s - interval_s) * (end - 1 - begin) <= _SIGMAS * jitter_s:
        interval_s = whole_s
    return Pace(
        interval_s,
        begin,
        end,
        jitter_s,
        tuple(breaks.tolist()),
        tuple((np.flatnonzero(steps == 0.0) + 1).tolist()),
        tuple((np.flatnonzero(steps < 0.0) + 1).tolist()),
    )


def _least_digit(steps: Floats) -> float:
    """Return the unit of the last digit in which times are written, where rounding makes them uneven; else 0."""
    few = np.sort(steps[:_STEPS])
    edges = np.flatnonzero(np.diff(few, prepend=-np.inf, append=np.inf) > 1e-3 * float(np.median(few)))
    common = few[edges[:-1]][np.diff(edges) > _COMMON * few.size]
    return float(np.diff(common).min()) if common.size > 1 else 0.0
