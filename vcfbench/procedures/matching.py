"""Step 2 of the paper as arithmetic: which V_Vc gives the output that the table gave at 10 deg/s, hence K_Vc."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from vcfbench.errors import MeasurementError
from vcfbench.procedures.settings import Match

__all__ = ["Matching", "Try"]

_CLOSE_ENOUGH = 5e-4
"""Residual of the output over its span at which the rest is interpolated. The chord is within some per cent of the
tangent, so what the interpolation leaves is some per cent of this."""

_USABLE = 1e-2
"""Residual over span beyond which step 2 has failed."""


@dataclass(frozen=True, slots=True)
class Try:
    """One setting of V_Vc (V), the mean output (V) and the standard uncertainty of that mean (V)."""

    v_vc_v: float
    output_v: float
    u_output_v: float


@dataclass(frozen=True, slots=True)
class Matching:
    """What is known so far about the equality of the two outputs; each method that adds returns a new value.

    `zero_table_v` and `turning_v` are the outputs on the table at rest and at `rate_deg_s`, generator off;
    `zero_virtual_v` is the output at rest with the generator on at 0 V. Under :attr:`Match.ZERO` each side is taken
    from its own zero.
    """

    match: Match
    rate_deg_s: float
    zero_table_v: float
    turning_v: float
    zero_virtual_v: float = math.nan
    tries: tuple[Try, ...] = ()

    @classmethod
    def against_table(cls, match: Match, rate_deg_s: float, *, zero_v: float, turning_v: float) -> Matching:
        """Start from step 1."""
        return cls(match, rate_deg_s, zero_v, turning_v)

    def with_zero(self, zero_virtual_v: float) -> Matching:
        """Add the output at rest with the generator on at 0 V."""
        return replace(self, zero_virtual_v=zero_virtual_v)

    def with_try(self, v_vc_v: float, output_v: float, u_output_v: float) -> Matching:
        """Add one setting of V_Vc and what came of it."""
        return replace(self, tries=(*self.tries, Try(v_vc_v, output_v, u_output_v)))

    @property
    def target_v(self) -> float:
        """The output that the virtual side must come to, V."""
        if self.match is Match.ABSOLUTE:
            return self.turning_v
        return self.turning_v - self.zero_table_v + self.zero_virtual_v

    @property
    def span_v(self) -> float:
        """How far the target lies from the virtual side's zero, V."""
        return self.target_v - self.zero_virtual_v

    @property
    def best(self) -> Try:
        """The try whose output is nearest to the target."""
        return min(self.tries, key=lambda attempt: abs(attempt.output_v - self.target_v))

    @property
    def residual_v(self) -> float:
        """What the best try is away from the target, V."""
        return self.best.output_v - self.target_v

    @property
    def u_residual_v(self) -> float:
        """Standard uncertainty of the residual, all means taken to be as good as that of the best try, V."""
        means = 2 if self.match is Match.ABSOLUTE else 4
        return math.sqrt(means) * self.best.u_output_v

    def equal(self) -> bool:
        """Tell whether the outputs are equal within their noise, or nearly enough to interpolate."""
        return abs(self.residual_v) <= max(3.0 * self.u_residual_v, _CLOSE_ENOUGH * abs(self.span_v))

    def usable(self) -> bool:
        """Tell whether the best try is near enough to the target for K_Vc to mean anything."""
        return abs(self.residual_v) <= max(3.0 * self.u_residual_v, _USABLE * abs(self.span_v))

    @property
    def slope(self) -> float:
        """Output over V_Vc (V/V) along the chord from the zero to the best try.

        The chord, not the secant through the last two tries: those lie within each other's noise once the outputs are
        equal.

        Raises:
            MeasurementError: the output does not answer to V_Vc.
        """
        best = self.best
        answer_v = best.output_v - self.zero_virtual_v
        if best.v_vc_v == 0.0 or abs(answer_v) <= max(3.0 * best.u_output_v, 1e-3 * abs(self.span_v)):
            raise MeasurementError(
                f"the output does not answer to V_Vc: {answer_v:+.4g} V for {best.v_vc_v:.6g} V",
                instrument="rate_source",
                step="2",
                hint="check the V_Vc lead and the generator's output",
            )
        return answer_v / best.v_vc_v

    @property
    def v_vc_equal_v(self) -> float:
        """V_Vc at equal outputs, interpolated along the chord from the best try, V."""
        return self.best.v_vc_v - self.residual_v / self.slope

    @property
    def k_vc(self) -> float:
        """K_Vc = rate / V_Vc at equality, (deg/s)/V (the factor of the paper's equation (16), in deg/s)."""
        return self.rate_deg_s / self.v_vc_equal_v

    def u_k_vc(self, u_output_v: float) -> float:
        """Standard uncertainty of K_Vc when each mean has `u_output_v`, (deg/s)/V.

        The table's rate and the generator's level are taken as exact: their type B parts belong to a budget.
        """
        means = 2 if self.match is Match.ABSOLUTE else 4
        return abs(self.k_vc / self.v_vc_equal_v / self.slope) * math.sqrt(means) * u_output_v
