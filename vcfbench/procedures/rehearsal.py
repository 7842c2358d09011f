"""Walk a plan without a bench: every step with the time at which it would begin, nothing opened or sent."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from vcfbench.interfaces import Regulation
from vcfbench.procedures import steps
from vcfbench.procedures.steps import (
    Acquire,
    AwaitDrive,
    AwaitRate,
    CheckRails,
    ConfigureGenerator,
    Done,
    DriveReading,
    RailReading,
    RailsReading,
    RateReading,
    Reading,
    SetVvc,
    Step,
    StepResult,
    VvcSetting,
    Window,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from vcfbench.procedures.settings import CalibrationSettings
    from vcfbench.procedures.steps import Plan

__all__ = ["Rehearsed", "StraightGyro", "rehearse"]


@dataclass(frozen=True, slots=True)
class Rehearsed:
    """A step of a rehearsed plan: its number from 1, its beginning (s from that of the plan) and the step."""

    number: int
    t_s: float
    step: Step


@dataclass(slots=True)
class StraightGyro:
    """Answers every step as a bench would whose gyro is a straight line and whose K_Vc is as expected.

    `k_vc` is in (deg/s)/V, `scale_factor` in V/(deg/s), `bias_v` in V; the latter two's values have no bearing on the
    order of the steps.
    """

    k_vc: float
    scale_factor: float = -0.0125
    bias_v: float = 0.0
    v_vc_v: float = 0.0
    enabled: bool = False

    @classmethod
    def expected(cls, settings: CalibrationSettings) -> StraightGyro:
        """Return the gyro that the bench file expects: the middle of what it should show, or the guess of K_Vc."""
        expected = settings.expected
        return cls(
            settings.k_vc_guess if expected.k_vc_deg_s_per_v is None else _middle(expected.k_vc_deg_s_per_v),
            -0.0125 if expected.scale_factor_v_per_deg_s is None else _middle(expected.scale_factor_v_per_deg_s),
            0.0 if expected.bias_v is None else _middle(expected.bias_v),
        )

    def predict(self, step: Step) -> StepResult:  # noqa: PLR0911  # one case a kind of step
        """Return what `step` would give."""
        match step:
            case SetVvc() | ConfigureGenerator():
                self.v_vc_v = step.v_vc_v
                return VvcSetting(step.v_vc_v)
            case steps.EnableVvc() | steps.DisableVvc():
                self.enabled = isinstance(step, steps.EnableVvc)
                return Done()
            case AwaitRate():
                return RateReading(step.rate_deg_s, 0.0)
            case AwaitDrive():
                return DriveReading(_middle(step.frequency_hz), _middle(step.amplitude_v), _middle(step.phase_deg), 1)
            case CheckRails():
                return RailsReading(tuple(_rail(rail.output, rail.voltage_v) for rail in step.rails))
            case Acquire():
                return self._window(step)
            case _:
                return Done()

    def _window(self, step: Acquire) -> Window:
        rate_deg_s = step.table_deg_s + (self.k_vc * self.v_vc_v if self.enabled else 0.0)
        output_v = self.bias_v + self.scale_factor * rate_deg_s
        readings = tuple(Reading(number * step.interval_s, output_v) for number in range(step.samples))
        return Window(readings, step.table_deg_s, tuple(_rail(rail.output, rail.voltage_v) for rail in step.rails))


def _rail(output: str, voltage_v: float) -> RailReading:
    return RailReading(output, voltage_v, 0.0, Regulation.CONSTANT_VOLTAGE)


def _middle(window: tuple[float, float]) -> float:
    return 0.5 * (window[0] + window[1])


def rehearse(plan: Plan, gyro: StraightGyro) -> Iterator[Rehearsed]:
    """Yield the steps of `plan` as `gyro` would let it go; their durations add up to the estimate of the bench time."""
    t_s, number = 0.0, 0
    try:
        step = next(plan)
        while True:
            number += 1
            yield Rehearsed(number, t_s, step)
            t_s += step.duration_s
            step = plan.send(gyro.predict(step))
    except StopIteration:
        return
