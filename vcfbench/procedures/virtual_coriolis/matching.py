"""Step 2 of the paper as arithmetic: which V_Vc gives the output that the table gave at 10 deg/s, hence K_Vc."""

import math
from collections.abc import Iterable
from typing import Self

from msgspec import Struct

from vcfbench.errors import MeasurementError
from vcfbench.records.schema import Point
from vcfbench.station.settings import Match

_CLOSE_ENOUGH = 5e-4
"""Residual of the output over its span at which the rest is interpolated. The chord is within some per cent of the
tangent, so what the interpolation leaves is some per cent of this."""

_USABLE = 1e-2
"""Residual over span beyond which step 2 has failed."""

_BETWEEN_RANGES = 0.1
"""The same where the target lies between what was tried: levels between the ends of two ranges of a generator cannot be
set, and the two are some per cent apart."""


class Mean(Struct, frozen=True):
    """The mean output (V) of `n` readings at one setting of V_Vc (V), and their sample standard deviation (V)."""

    v_vc_v: float
    output_v: float
    std_v: float
    n: int

    @property
    def u_output_v(self) -> float:
        """Type A standard uncertainty of the mean, V."""
        return self.std_v / math.sqrt(self.n)

    @classmethod
    def of(cls, points: Iterable[Point]) -> Self:
        """Return the mean of windows that were taken at the same setting."""
        windows = tuple(points)
        count = sum(point.n for point in windows)
        output_v = math.fsum(point.n * point.output_v for point in windows) / count
        variance = math.fsum((point.n - 1) * point.std_v**2 for point in windows) / (count - len(windows))
        return cls(windows[0].v_vc_v, output_v, math.sqrt(variance), count)


class Matching(Struct, frozen=True):
    """State of the match of the two outputs so far.

    `zero_table` and `turning` are the outputs on the table at rest and at `rate_deg_s`, generator off; `zero_virtual`
    is the output at rest with the generator on at 0 V; `tries` are those at other settings of V_Vc. Under
    :attr:`Match.ZERO` each side is taken from its own zero.
    """

    match: Match
    rate_deg_s: float
    zero_table: Mean
    turning: Mean
    zero_virtual: Mean
    tries: tuple[Mean, ...]

    @classmethod
    def of(cls, points: Iterable[Point], match: Match, rate_deg_s: float) -> Self:
        """Do the arithmetic of steps 1 and 2 on their points.

        Step 1 holds the zero and the output at the matching rate, step 2 the zero with the generator on and at least
        one setting of V_Vc; all windows of a step with the same rate and V_Vc are one mean.
        """
        groups: dict[tuple[int, float, float], list[Point]] = {}
        for point in points:
            if point.step in {1, 2}:
                groups.setdefault((point.step, point.rate_deg_s, point.v_vc_v), []).append(point)
        zero_table, turning, zero_virtual, *tries = (Mean.of(group) for group in groups.values())
        return cls(match, rate_deg_s, zero_table, turning, zero_virtual, tuple(tries))

    @property
    def target_v(self) -> float:
        """The output that the virtual side must come to, V."""
        if self.match is Match.ABSOLUTE:
            return self.turning.output_v
        return self.turning.output_v - self.zero_table.output_v + self.zero_virtual.output_v

    @property
    def span_v(self) -> float:
        """Distance of the target from the virtual side's zero, V."""
        return self.target_v - self.zero_virtual.output_v

    @property
    def best(self) -> Mean:
        """The try with the most readings, among equals the one whose output is nearest to the target."""
        return min(self.tries, key=lambda attempt: (-attempt.n, abs(attempt.output_v - self.target_v)))

    @property
    def residual_v(self) -> float:
        """Distance of the best try from the target, V."""
        return self.best.output_v - self.target_v

    @property
    def compared(self) -> tuple[Mean, ...]:
        """The means whose noise is part of the comparison."""
        if self.match is Match.ABSOLUTE:
            return (self.turning, self.best)
        return (self.turning, self.best, self.zero_table, self.zero_virtual)

    @property
    def u_residual_v(self) -> float:
        """Type A standard uncertainty of the residual, V."""
        return math.hypot(*(mean.u_output_v for mean in self.compared))

    def equal(self) -> bool:
        """Return True if the outputs are equal within their noise, or nearly enough to interpolate."""
        return abs(self.residual_v) <= max(3.0 * self.u_residual_v, _CLOSE_ENOUGH * abs(self.span_v))

    def is_between(self) -> bool:
        """Return True if tries lie on either side of the target."""
        away_v = [attempt.output_v - self.target_v for attempt in self.tries]
        return min(away_v) < 0.0 < max(away_v)

    def usable(self) -> bool:
        """Return True if the best try is near enough to the target for K_Vc to mean anything."""
        share = _BETWEEN_RANGES if self.is_between() else _USABLE
        return abs(self.residual_v) <= max(3.0 * self.u_residual_v, share * abs(self.span_v))

    @property
    def slope(self) -> float:
        """Output over V_Vc (V/V), the slope of the chord from the zero, whose V_Vc may not be 0 V, to the best try.

        The chord, not the secant through the last two tries: those lie within each other's noise once the outputs are
        equal. MeasurementError: the output does not respond to V_Vc.
        """
        return self._slope_to(self.best)

    def _slope_to(self, attempt: Mean) -> float:
        answer_v, level_v = attempt.output_v - self.zero_virtual.output_v, attempt.v_vc_v - self.zero_virtual.v_vc_v
        if level_v == 0.0 or abs(answer_v) <= max(3.0 * attempt.u_output_v, 1e-3 * abs(self.span_v)):
            raise MeasurementError(
                f"the output does not respond to V_Vc: {answer_v:+.4g} V for {attempt.v_vc_v:.6g} V",
                instrument="rate_source",
                step="2",
                hint="check the V_Vc lead and the generator's output",
            )
        return answer_v / level_v

    @property
    def v_vc_equal_v(self) -> float:
        """V_Vc at equal outputs, interpolated along the chord from the best try, V."""
        return self.best.v_vc_v - self.residual_v / self.slope

    @property
    def next_v(self) -> float:
        """V_Vc to be tried next, V: along the chord of the last try, which is on the range that a generator has now."""
        last = self.tries[-1]
        return last.v_vc_v - (last.output_v - self.target_v) / self._slope_to(last)

    @property
    def level_v(self) -> float:
        """Rise of V_Vc for that output, V: from that of the zero, or from none where outputs are absolute."""
        return self.v_vc_equal_v - (0.0 if self.match is Match.ABSOLUTE else self.zero_virtual.v_vc_v)

    @property
    def k_vc(self) -> float:
        """K_Vc = rate / V_Vc at equality, (deg/s)/V (the factor of the paper's equation (16), in deg/s).

        MeasurementError: the outputs are equal without any V_Vc, so there is nothing to divide by.
        """
        v_vc_v = self.level_v
        if v_vc_v == 0.0:
            raise MeasurementError("the output does not respond to the table's rate", instrument="multimeter", step="2")
        return self.rate_deg_s / v_vc_v

    def rate_of(self, v_vc_v: float) -> float:
        """Return the rate that a V_Vc stands for, deg/s."""
        return self.k_vc * v_vc_v

    def level_for(self, rate_deg_s: float) -> float:
        """Return the V_Vc that stands for a rate, V."""
        return rate_deg_s / self.k_vc

    def u_k_vc(self, std_v: float, common_v: float) -> float:
        """Return the standard uncertainty of K_Vc, (deg/s)/V.

        Args:
            std_v: standard deviation of one reading, V; it goes down with the number of readings of each mean.
            common_v: standard uncertainty that all readings of a mean share (resolution), V.

        The table's rate and the generator's level are taken as exact: their type B parts belong to a budget.

        """
        u_v = math.hypot(*(math.hypot(std_v / math.sqrt(mean.n), common_v) for mean in self.compared))
        return abs(self.k_vc / self.level_v / self.slope) * u_v
