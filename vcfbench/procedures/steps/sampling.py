"""Records that an instrument takes by itself: readings of the multimeter on a grid, the response to a sine."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from vcfbench.errors import ConfigError
from vcfbench.interfaces import SamplesVoltage
from vcfbench.procedures.step import Effect, Step, StepResult

if TYPE_CHECKING:
    from vcfbench.bench.linear_gyro import LinearGyro
    from vcfbench.procedures.step import Context


@dataclass(frozen=True, slots=True)
class SineResponse(StepResult):
    """What the multimeter sampled while V_Vc was a sine: voltages (V) in the order in which they were taken.

    `interval_s` is the spacing that was asked for; what the meter needs beside it makes the true one a little longer.
    `aperture_s` is how long each integrates.
    """

    interval_s: float
    aperture_s: float
    voltages_v: tuple[float, ...]

    def describe(self) -> str:
        """Name about how large the sine is."""
        mean_v = math.fsum(self.voltages_v) / len(self.voltages_v)
        square = math.fsum((each - mean_v) ** 2 for each in self.voltages_v) / len(self.voltages_v)
        return f"{math.sqrt(2.0 * square):.4g} V"


@dataclass(frozen=True, slots=True)
class SampleSine(Step):
    """Sample the output while V_Vc is a sine: `samples` readings, one every `interval_s`, taken by the meter itself.

    The frequency (Hz) and amplitude (V) of V_Vc stand here for the record. `split_hz` is what a dry run answers with:
    a response that peaks there.
    """

    effect: ClassVar[Effect] = Effect.MEASURES
    subject: ClassVar[str] = "output"
    overhead_s: ClassVar[float] = 0.5

    frequency_hz: float
    amplitude_v: float
    samples: int
    interval_s: float
    split_hz: float

    def describe(self) -> str:
        """Name the record."""
        return f"sample the output: {self.samples} readings, one every {1e3 * self.interval_s:g} ms"

    @property
    def physical_s(self) -> float:
        """The record, s."""
        return self.samples * self.interval_s

    def perform(self, context: Context) -> SineResponse:
        """Let the meter take them, and fetch them.

        Raises:
            ConfigError: the meter cannot take readings by itself.
        """
        meter, clock = context.bench.multimeter, context.bench.clock
        if not isinstance(meter, SamplesVoltage):
            raise ConfigError("the multimeter takes no readings by itself, as sampling a sine asks for")
        began_s = clock.now()
        lasts_s = meter.start_sampling(self.samples, self.interval_s)
        # What the meter needs between two readings is not known below a millisecond.
        clock.sleep_until(began_s + lasts_s + 1e-3 * self.samples)
        return SineResponse(self.interval_s, meter.aperture_s, meter.sampled_voltages_v())

    def predict(self, gyro: LinearGyro) -> SineResponse:
        """Predict a sine without noise, with the gain of a mode at `split_hz`."""
        ratio = self.frequency_hz / self.split_hz
        gain = 1.0 / math.hypot(1.0 - ratio**2, 0.1 * ratio)
        amplitude_v = gyro.scale_factor * gyro.k_vc * self.amplitude_v * gain
        step_rad = 2.0 * math.pi * self.frequency_hz * self.interval_s
        voltages_v = tuple(gyro.bias_v + amplitude_v * math.cos(n * step_rad) for n in range(self.samples))
        return SineResponse(self.interval_s, 0.0, voltages_v)
