"""Records of an oscilloscope, one visit of a state after the other: did what they show step or creep between them?

Each visit of a state has a mean. Records of one visit share what it is aimed by, so that the noise is what a fault
leaves of the scatter between visits. Faults are the patterns in time of :mod:`patterns`.
"""

import math
from collections.abc import Callable, Hashable, Iterable
from typing import Any

import numpy as np
from msgspec import Struct

from vcfbench.analysis.arrays import Floats
from vcfbench.belief.patterns import MOST_WINDOWS, ONE_SIDED, Patterns, patterns_of
from vcfbench.errors import MeasurementError
from vcfbench.steps.step import StepResult
from vcfbench.values.quantile import t_quantile

DEG, SHARE = "deg", "of itself"
"""Units of faults in records."""
_CHANCE = 1e-5
"""Of a fault that is none, by the number of visits: a series has about as many patterns that differ."""
_LEAST_LEFT, _ROUNDING = 2, 1e-9


class Visit(Struct, frozen=True):
    """A state, what the records of one visit showed, and their result as the journal has it."""

    state: Hashable
    values: tuple[float, ...]
    result: StepResult


class Compared(Struct, frozen=True):
    """Faults, Student's t of each, (m,), and the t from which on one is refused."""

    found: Patterns
    t: Floats
    most: float

    @property
    def refused_from(self) -> float:
        """The size, in standard uncertainties, of a fault that is refused with 95 %."""
        return self.most + ONE_SIDED


class InTurn(Struct, frozen=True):
    """A quantity as visits showed it in turn: in `DEG`, or as a `SHARE` of itself.

    `wander` is how far it may walk in a run by itself (a kelvin, in such a gyroscope). `spoilt` makes a visit's result
    what it had been with a fault of a size.
    """

    what: str
    unit: str
    wander: float
    visits: tuple[Visit, ...]
    spoilt: Callable[[Any, float], StepResult]

    def compared(self) -> Compared | None:
        """Return the faults that are looked for; None of too few visits, or of such as do not scatter."""
        states = dict.fromkeys(each.state for each in self.visits)
        left = len(self.visits) - len(states)
        if left < _LEAST_LEFT or len(self.visits) > MOST_WINDOWS:
            return None
        means = np.array([math.fsum(each.values) / len(each.values) for each in self.visits])
        free = np.array([[float(each.state == state) for state in states] for each in self.visits])
        rest = means - free @ np.linalg.lstsq(free, means, rcond=None)[0]
        variance = float(rest @ rest) / left
        if not variance:
            return None
        count = np.arange(len(means), dtype=float)
        covariance = variance * np.eye(len(means)) + self.wander**2 * np.minimum.outer(count, count) / count[-1]
        found = next(patterns_of(means, free, covariance, count, {self.unit: np.ones(len(means))}))
        # A fault scatters visits itself: its size is held against what is left beside it
        beside = np.maximum(left - np.square(found.sigmas), _ROUNDING) / (left - 1)
        return Compared(found, np.abs(found.sigmas) / np.sqrt(beside), t_quantile(_CHANCE / len(means), left - 1))


def require_alike(series: Iterable[InTurn]) -> None:
    """See that nothing stepped or crept between records; MeasurementError: it did."""
    for each in series:
        if (compared := each.compared()) is None:
            continue
        found, place = compared.found, int(compared.t.argmax())
        if compared.t[place] <= compared.most:
            continue
        pattern, size = found.pattern(place), float(found.sizes[place])
        first, last = pattern.first + 1, pattern.last + 1
        raise MeasurementError(
            f"{each.what} {'creeps' if pattern.walks else 'is another'} by {size:+.3g} {each.unit} in the records of "
            f"visits {first} to {last} of {len(each.visits)} ({compared.t[place]:.0f} standard uncertainties)",
            instrument="oscilloscope",
            hint="check probes and leads, and events at that time",
        )
