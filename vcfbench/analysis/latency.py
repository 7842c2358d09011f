"""Latency of an output behind the table, by ramps of both."""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from msgspec import Struct

from vcfbench.analysis.arrays import Floats

_FROM, _TO = 0.2, 0.8
"""Part of a ramp that is straight: a table may round its ends."""
_LEAST = 5
"""Points in that part that a line needs."""


class Latency(Struct, frozen=True):
    """Latency of an output behind the table, s, with its standard uncertainty."""

    latency_s: float
    u_s: float


class Ramp(Struct, frozen=True, eq=False):
    """One ramp, from rest or to it: read-backs of the table and numbers of the stream.

    `asked_s` and `answered_s` are the bench times around each read-back (n,), `rate_deg_s` the read-backs (n,);
    `came_s` is when each frame had come, s (m,), `number` its output (m,) in any unit.
    """

    asked_s: Floats
    answered_s: Floats
    rate_deg_s: Floats
    came_s: Floats
    number: Floats

    @classmethod
    def of_looks(cls, looks: Sequence[tuple[float, float, float]], came_s: Floats, number: Floats) -> "Ramp":
        """Return the ramp by each look at the table: when it was asked and answered, s, and its rate, deg/s."""
        asked_s, answered_s, rate_deg_s = np.array(looks).T
        return cls(asked_s, answered_s, rate_deg_s, came_s, number)

    @property
    def latency(self) -> Latency | None:
        """Latency of half the way; None where table or output has too few points on the ramp.

        A read-back is of an instant between question and answer: half a width of it, rectangular.
        """
        table = _half_way(0.5 * (self.asked_s + self.answered_s), self.rate_deg_s)
        stream = _half_way(self.came_s, self.number)
        if table is None or stream is None:
            return None
        asking_s = float((self.answered_s - self.asked_s).mean()) / math.sqrt(12.0)
        return Latency(stream[0] - table[0], math.hypot(stream[1], table[1], asking_s))


def mean_latency(ramps: Sequence[Ramp], readback_s: float) -> Latency | None:
    """Return the mean over the ramps, behind the table itself; None where one has none.

    The read-back is itself old, by 0 to `readback_s`, s: its middle is added, and the rest is in u (rectangular). What
    is the same in all ramps is in the largest u of one.
    """
    found = [each.latency for each in ramps]
    if not found or None in found:
        return None
    known = [each for each in found if each is not None]
    mean_s = math.fsum(each.latency_s for each in known) / len(known)
    apart_s = max(abs(each.latency_s - mean_s) for each in known)
    u_s = math.hypot(max(each.u_s for each in known), apart_s, readback_s / math.sqrt(12.0))
    return Latency(mean_s + 0.5 * readback_s, u_s)


def _half_way(t_s: Floats, value: Floats) -> tuple[float, float] | None:
    """Return the instant of half the way from first to last level, s, with its u by the scatter about the line."""
    tenth = max(3, len(value) // 20)
    if len(value) < 2 * tenth + _LEAST:
        return None
    low, high = float(np.median(value[:tenth])), float(np.median(value[-tenth:]))
    if low == high:
        return None
    part = (value - low) / (high - low)
    after = int(np.argmax(part > _TO)) or len(part)
    on = np.flatnonzero((part[:after] > _FROM) & (part[:after] <= _TO))
    if len(on) < _LEAST:
        return None
    x = part[on] - 0.5
    design = np.column_stack([np.ones(len(on)), x])
    coefficients, *_ = np.linalg.lstsq(design, t_s[on], rcond=None)
    left = t_s[on] - design @ coefficients
    variance = float(left @ left) / (len(on) - 2) * float(np.linalg.inv(design.T @ design)[0, 0])
    return float(coefficients[0]), math.sqrt(variance)


def course_by_counter(
    frames: Sequence[tuple[float, int, float]], *, period_s: float, numbers: int, of_angle: bool, turn: float
) -> tuple[Floats, Floats]:
    """Return arrivals by the counter, s (n,), and numbers of frames (n,), of an angle its growth a frame.

    Args:
        frames: bench time of finding it (s), counter and number of each frame.
        period_s: time from frame to frame, s.
        numbers: numbers of the counter, after which it begins anew.
        of_angle: whether the number is an angle.
        turn: angle at which it begins anew; 0: never.
    """
    counter, came_s, value = [0], list[float](), list[float]()
    for (_, before, number_before), (t_s, at, number) in pairwise(frames):
        if gone := (at - before) % numbers:
            grown = number - number_before
            grown -= turn * round(grown / turn) if turn else 0.0
            counter.append(counter[-1] + gone)
            came_s.append(t_s)
            value.append(grown / gone if of_angle else number)
    if not value:
        return np.empty(0), np.empty(0)
    return instants_by_counter(counter[1:], np.array(came_s), period_s), np.array(value)


def instants_by_counter(counter: Sequence[int], came_s: Floats, period_s: float) -> Floats:
    """Return the arrivals of frames by their counter, s (n,): the line below all times of finding them.

    Who asks a table meanwhile finds frames late, and never early.
    """
    on_line = np.asarray(counter) * period_s
    return on_line + float((came_s - on_line).min())
