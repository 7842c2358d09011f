"""The input at which an output stops to follow: where it falls short of the straight line through small inputs."""

from collections.abc import Sequence
from typing import Self

import numpy as np
from msgspec import Struct

_NEAR = 1.01
"""Ratio of two inputs between which the slope at a limit is taken: nearer, the steps of their source are seen."""
_LEAST = 1e-3
"""Least slope, over the line's, at which an output is taken to leave what the line allows."""


class Line(Struct, frozen=True):
    """Straight line through small inputs of both signs: output at no input (V), slope, the inputs' distance."""

    zero_v: float
    slope: float
    apart: float

    @classmethod
    def of(cls, inputs: Sequence[float], outputs_v: Sequence[float]) -> Self:
        """Return it by the six windows 0, +, -, -, +, 0."""
        (zero, high, low), (zero_v, high_v, low_v) = (
            [0.5 * (each[first] + each[second]) for first, second in ((0, 5), (1, 4), (2, 3))]
            for each in (inputs, outputs_v)
        )
        slope = (high_v - low_v) / (high - low)
        return cls(zero_v - slope * zero, slope, high - low)

    def lacks(self, at: float, output_v: float) -> float:
        """Return the part of its output that lacks where the input is `at`; negative where there is more."""
        return 1.0 - (output_v - self.zero_v) / (self.slope * at)

    def weights(self, at: float, may_lack: float) -> tuple[float, ...]:
        """Return the weights of its windows in what an output at `at` may be."""
        lever = 0.5 * (1.0 - may_lack) * at / self.apart
        return (0.5, lever, -lever, -lever, lever, 0.5)


class Limit(Struct, frozen=True):
    """Input at which the output lacks more than it may: between two that were taken, with equal chance anywhere.

    `first` is the place of the nearer one that falls short. `rises` is the output's slope from there on over the
    line's. `leaves` is how fast it leaves what the line allows, over the line's slope: an error of the output moves the
    limit by itself over both slopes.
    """

    at: float
    half_width: float
    first: int
    rises: float
    leaves: float


def limit_of(line: Line, may_lack: float, inputs: Sequence[float], outputs_v: Sequence[float]) -> Limit | None:
    """Return the limit of inputs of one sign; None where the output followed all of them."""
    order = np.argsort(np.abs(inputs))
    short = [int(each) for each in order if line.lacks(inputs[each], outputs_v[each]) > may_lack]
    followed = [int(each) for each in order if each not in short]
    if not short:
        return None
    first, last = short[0], followed[-1]
    beyond = next((each for each in short if abs(inputs[each]) >= _NEAR * abs(inputs[first])), last)
    rise_v, apart = outputs_v[beyond] - outputs_v[first], inputs[beyond] - inputs[first]
    rises = rise_v / apart / line.slope if apart else 0.0
    at, half = 0.5 * (inputs[first] + inputs[last]), 0.5 * abs(inputs[first] - inputs[last])
    return Limit(at, half, first, rises, max(abs(1.0 - may_lack - rises), _LEAST))
