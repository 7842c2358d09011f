"""The windows of a run in their order; those at one setting must agree.

That is within the uncertainty of the difference: noise of the readings, flicker, warm-up, temperature.
"""

import math
from collections.abc import Sequence
from typing import Any, Protocol, Self, runtime_checkable

from msgspec import Struct, field

from vcfbench.analysis.correlation import Correlation
from vcfbench.errors import MeasurementError
from vcfbench.instructions.schedule import EARTH_DEG_S, Order, SweepSettings
from vcfbench.records.schema import Point
from vcfbench.station.settings import ProcedureSettings
from vcfbench.steps import Acquire, AskOperator, DisableVvc, EnableVvc, VerifyZero, Window
from vcfbench.steps.step import LOOK_AT_SIGNALS, Step, StepResult

_SIGMAS = 6.0
"""Two means of one setting may differ by so many standard uncertainties: 1000 runs of 100 comparisons, one in 5000."""

_FEW_DOF = 40.0
"""Growth of the sigmas over the degrees of freedom of the noise: Student's t of the same chance."""

_LOOP_DRIFT = 1e-2
"""A loop is there to show a hysteresis, which must not end it; one of more of the span is none to be calibrated."""

_FLICKER_DEG_H = 20.0
"""B where nobody knows it: twice that of the worst gyroscope that is called tactical (IEEE 1554: 0.1 to 10 deg/h)."""

_WARM_UP_K, _BIAS_DEG_H_K, _SCALE_FACTOR_PPM_K = 1.0, 100.0, 300.0
"""Warm-up and its effects where nobody knows them: those of a MEMS gyroscope without compensation."""

_WANDERS_K = 0.5
"""Wander of a room's temperature within a run, where nobody knows it."""


def sigmas(dof: float) -> float:
    """Return how many standard uncertainties apart is too many, the noise known with so many degrees of freedom."""
    return _SIGMAS + _FEW_DOF / max(1.0, dof)


class Seen(Struct, frozen=True):
    """A window: its point, its settings, and its bench time."""

    point: Point
    driven: bool
    """True if the generator was on."""
    rails_v: tuple[float, ...]
    table_deg_s: float
    reference: bool
    """True if it is for comparison alone."""
    begin_s: float
    end_s: float
    up: str = ""
    """Axis of the case that points up, where a person has turned it."""

    @property
    def setting(self) -> tuple[bool, tuple[float, ...], float, float, str]:
        """Settings that the output depends on."""
        return self.driven, self.rails_v, self.table_deg_s, self.point.v_vc_v if self.driven else 0.0, self.up

    @property
    def middle_s(self) -> float:
        """Bench time of its middle."""
        return 0.5 * (self.begin_s + self.end_s)

    def describe(self) -> str:
        """Name the setting."""
        at = f"V_Vc of {self.point.v_vc_v:+.6g} V" if self.driven else f"{self.table_deg_s:+g} deg/s"
        at = f"{self.up} up" if self.up else at
        return f"{at} (step {self.point.step}, {self.begin_s:.1f} to {self.end_s:.1f} s)"


@runtime_checkable
class _Turned(Protocol):
    """Settings of a procedure in which a person turns the case."""

    tilt_deg: float
    heading_deg: float


class Limits(Struct, frozen=True):
    """Limits of the output's shift between two windows, V, in addition to the noise of their readings."""

    flicker_v: float
    """B as a voltage."""
    warm_up_s: float
    """Time constant of the warm-up."""
    warm_up_v: float
    """Shift of the zero, from the first window on."""
    warm_up_share: float
    """Shift of the output by a rate, relative to that output, from the first window on."""
    wander_v: float
    """Largest shift of the zero in the run, by temperature or as the bench file says."""
    wander_share: float
    table_rate: float
    """Relative, of the rate of one window."""
    placed_share: float = 0.0
    """By how a case that a person turns stands otherwise the next time, relative to what gravity does."""
    placed_v: float = 0.0
    """The same by the Earth's rate."""

    @classmethod
    def of(cls, settings: ProcedureSettings) -> Self:
        """Return the limits that the bench file knows, the worst of the class where it does not."""
        known, expected = settings.station.sources, settings.expected
        per_deg_h = abs(settings.expected_gyro().scale_factor) / 3600.0
        stated = None if "bias_instability_deg_h" in known.assumed else known.bias_instability_deg_h
        flicker = _FLICKER_DEG_H if stated is None else stated
        bias = _BIAS_DEG_H_K if known.bias_deg_h_k is None else known.bias_deg_h_k
        share = 1e-6 * (_SCALE_FACTOR_PPM_K if known.scale_factor_ppm_k is None else known.scale_factor_ppm_k)
        begun_k = (_WARM_UP_K if known.warm_up_k is None else known.warm_up_k) * math.exp(
            -settings.start_up_s / known.warm_up_time_s
        )
        stated_k = None if "temperature_k" in known.assumed else known.temperature_k
        wander_k = _WANDERS_K if stated_k is None else stated_k
        wander_v = bias * per_deg_h * wander_k if expected.zero_drift_v is None else expected.zero_drift_v
        return cls(
            flicker_v=flicker * per_deg_h,
            warm_up_s=known.warm_up_time_s,
            warm_up_v=bias * per_deg_h * begun_k,
            warm_up_share=share * begun_k,
            wander_v=wander_v,
            wander_share=share * wander_k,
            table_rate=known.table_rate or 0.0,
            placed_share=math.sin(math.radians(settings.tilt_deg)) if isinstance(settings, _Turned) else 0.0,
            placed_v=3600.0 * per_deg_h * EARTH_DEG_S * math.sin(math.radians(settings.heading_deg))
            if isinstance(settings, _Turned)
            else 0.0,
        )

    def of_placing_v(self, outputs_v: Sequence[float]) -> float:
        """Return the largest shift between two times in one position of the case, from all `outputs_v`."""
        return self.placed_share * (max(outputs_v) - min(outputs_v)) + self.placed_v


class Walk(Struct):
    """All windows of a run so far, in their order."""

    settings: ProcedureSettings
    limits: Limits
    windows: list[Seen] = field(default_factory=list)
    alike: dict[tuple[Any, ...], list[Seen]] = field(default_factory=dict)
    """The same by their settings."""
    driven: bool = False
    up: str = ""
    """Axis of the case that points up, where a person has turned it."""
    dof: int = 0
    """Degrees of freedom of the scatter of readings."""
    squares_v2: float = 0.0
    """Squares of that scatter, all windows together."""
    correlation: Correlation = field(default_factory=Correlation)
    """That of the readings with the next ones."""
    steps: frozenset[int] | None = None
    """Steps of the points that are held against each other; None: all."""

    @property
    def variance_v2(self) -> float:
        """Variance of one reading, pooled over all windows; of so many as their number their mean has its part."""
        return self.correlation.growth * self.squares_v2 / max(1, self.dof)

    def take(self, step: Step, result: StepResult) -> Seen | None:
        """Take notice of a performed step, and return its window where it is one."""
        if isinstance(step, EnableVvc | DisableVvc):
            self.driven = isinstance(step, EnableVvc)
        if isinstance(step, AskOperator):
            self.up = str(dict(step.adjustments).get("up_axis", self.up))
        if not isinstance(step, Acquire) or not isinstance(result, Window):
            return None
        point, ended_s = result.point, self.windows[-1].end_s if self.windows else 0.0
        asked_s = result.readings[0].t_s if result.readings else 0.0
        begin_s = max(asked_s, ended_s + (0.0 if result.readings else self.settings.settle_s))
        seen = Seen(
            point,
            self.driven,
            tuple(rail.voltage_v for rail in step.rails),
            step.table_deg_s or 0.0,
            isinstance(step, VerifyZero),
            begin_s,
            begin_s + step.physical_s,
            self.up,
        )
        if self.steps is not None and point.step not in self.steps:
            return None
        self.correlation.add([each.voltage_v for each in result.readings])
        self.add(seen)
        return seen

    def add(self, seen: Seen) -> None:
        """Add a window."""
        self.squares_v2 += (seen.point.n - 1) * seen.point.std_v**2
        self.dof += seen.point.n - 1
        self.windows.append(seen)
        self.alike.setdefault(seen.setting, []).append(seen)

    def note(self, step: Step, result: StepResult) -> None:
        """Add a performed step; MeasurementError if a setting gives another output than before."""
        if (seen := self.take(step, result)) is not None and not self.settings.creeps:
            self.require_same(seen)

    def require_same(self, seen: Seen) -> None:
        """Compare the last window, `seen`, with earlier ones of its setting; MeasurementError if they differ."""
        for earlier in self.alike[seen.setting][:-1]:
            was_v, allowed_v = earlier.point.output_v, self._allowed_v(earlier, seen)
            moved_v = seen.point.output_v - was_v
            if abs(moved_v) <= allowed_v:
                continue
            raise MeasurementError(
                f"the output was {was_v:+.6g} V at {earlier.describe()} and is now {seen.point.output_v:+.6g} V at "
                f"{seen.describe()}: {moved_v:+.3g} V apart, at most {allowed_v:.2g} V are noise and drift",
                instrument="multimeter",
                step=str(seen.point.step),
                hint="check leads, contacts, temperature, and events in between; let the gyroscope warm up "
                "(procedure.warm_up_s); expected.zero_drift_v of the bench file allows a drift",
            )

    def _allowed_v(self, earlier: Seen, latest: Seen) -> float:
        """Return the amount by which the means of two windows at one setting may be apart, V."""
        limits, one, other = self.limits, earlier.point, latest.point
        variance = self.variance_v2 * (1.0 / one.n + 1.0 / other.n) + self.settings.meter_resolution_v**2 / 6.0
        if earlier.table_deg_s:  # the table's own rate, and its ripple
            rate_deg_s = abs(earlier.table_deg_s)
            alike = [each.point.std_v**2 for each in self.windows if abs(each.table_deg_s) == rate_deg_s]
            ripple = max(0.0, self.correlation.growth * math.fsum(alike) / len(alike) - self.variance_v2) / one.n
            rate_v = limits.table_rate * (one.output_v - self.windows[0].point.output_v)
            variance += 2.0 * (ripple + rate_v**2)
        apart = max(latest.middle_s - earlier.middle_s, 1e-3) / max(earlier.end_s - earlier.begin_s, 1e-3)
        variance += 2.0 / math.pi * limits.flicker_v**2 * (1.5 + math.log(max(1.0, apart)))
        moves_v = abs(earlier.point.output_v - self.windows[0].point.output_v)
        begin_s = self.windows[0].begin_s
        cooled = math.exp(-(earlier.middle_s - begin_s) / limits.warm_up_s)
        cooled -= math.exp(-(latest.middle_s - begin_s) / limits.warm_up_s)
        drift_v = cooled * (limits.warm_up_v + limits.warm_up_share * moves_v)
        drift_v += limits.wander_v + limits.wander_share * moves_v
        drift_v += self.limits.of_placing_v([each.point.output_v for each in self.windows]) if latest.up else 0.0
        if isinstance(self.settings, SweepSettings) and self.settings.order is Order.LOOP:
            outputs = [each.point.output_v for each in self.windows]
            drift_v += _LOOP_DRIFT * (max(outputs) - min(outputs))
        return max(sigmas(self.dof) * math.sqrt(variance) + drift_v, 2.0 * self.settings.meter_resolution_v)


def require_answer(settings: ProcedureSettings, points: Sequence[Point]) -> None:
    """See that the means at rest and at a rate (or V_Vc) of both signs are farther apart than noise puts them.

    MeasurementError: they are not.
    """
    outputs, dof = [point.output_v for point in points], sum(point.n - 1 for point in points)
    if not any(point.std_v for point in points):  # a plan that is only looked at, or a bench without noise
        return
    variance = math.fsum((point.n - 1) * point.std_v**2 for point in points) / dof / min(point.n for point in points)
    u_v = math.sqrt(variance + settings.meter_resolution_v**2 / 12.0 + Limits.of(settings).flicker_v ** 2)
    if max(outputs) - min(outputs) < 1.5 * sigmas(dof) * u_v:
        raise MeasurementError(
            f"the output does not respond to {'V_Vc' if any(point.v_vc_v for point in points) else 'the rate'}: from "
            f"{min(outputs):+.6g} to {max(outputs):+.6g} V in {len(points)} windows, "
            f"where one mean is known to {u_v:.1g} V",
            instrument="multimeter",
            step=str(points[-1].step),
            hint=LOOK_AT_SIGNALS,
        )
