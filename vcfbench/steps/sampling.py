"""Records that an instrument takes by itself: readings of the multimeter on a grid, the response to a sine."""

import math
from typing import Literal, Self

from msgspec import Struct
from msgspec.structs import replace

from vcfbench.errors import ConfigError
from vcfbench.interfaces import SamplesVoltage
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.station.settings import Sources
from vcfbench.steps.step import Context, Effect, Step, StepResult, does
from vcfbench.steps.table import read_rate


class SineResponse(StepResult, Struct, frozen=True):
    """Samples of the multimeter while V_Vc was a sine: voltages (V) in the order of time.

    `interval_s` is the spacing asked for; the meter's overhead makes the true one a little longer. `aperture_s` is the
    integration time of each.
    """

    interval_s: float
    aperture_s: float
    voltages_v: tuple[float, ...]

    def corrected(self, step: Step, known: Sources) -> Self:
        return replace(self, voltages_v=tuple(map(known.corrected, self.voltages_v)))

    def describe(self) -> str:
        mean_v = math.fsum(self.voltages_v) / len(self.voltages_v)
        square = math.fsum((each - mean_v) ** 2 for each in self.voltages_v) / len(self.voltages_v)
        return f"{math.sqrt(2.0 * square):.4g} V"


@does(Effect.MEASURES, "output", overhead_s=0.5)
class SampleSine(Step, Struct, frozen=True):
    """Sample the output while V_Vc is a sine: `samples` readings, one every `interval_s`, taken by the meter itself.

    The frequency (Hz) and amplitude (V) of V_Vc stand here for the record. A dry run answers with `gain` over that at
    rest, or where there is none with a response that peaks at `split_hz`.
    """

    frequency_hz: float
    amplitude_v: float
    samples: int
    interval_s: float
    split_hz: float
    gain: float | None = None

    def describe(self) -> str:
        return f"sample the output: {self.samples} readings, one every {1e3 * self.interval_s:g} ms"

    @property
    def physical_s(self) -> float:
        return self.samples * self.interval_s

    def perform(self, context: Context) -> SineResponse:
        """Start the meter's own sampling, and fetch the readings; ConfigError if the meter cannot."""
        meter, clock = context.bench.multimeter, context.bench.clock
        if not isinstance(meter, SamplesVoltage):
            raise _takes_none("multimeter")
        began_s = clock.now()
        lasts_s = meter.start_sampling(self.samples, self.interval_s)
        # What the meter needs between two readings is not known below a millisecond.
        clock.sleep_until(began_s + lasts_s + 1e-3 * self.samples)
        return SineResponse(self.interval_s, meter.aperture_s, meter.sampled_voltages_v())

    def predict(self, gyro: LinearGyro) -> SineResponse:
        """Predict a sine without noise."""
        ratio = self.frequency_hz / self.split_hz
        gain = 1.0 / math.hypot(1.0 - ratio**2, 0.1 * ratio) if self.gain is None else self.gain
        amplitude_v = gyro.scale_factor * gyro.k_vc * self.amplitude_v * gain
        step_rad = 2.0 * math.pi * self.frequency_hz * self.interval_s
        voltages_v = tuple(gyro.bias_v + amplitude_v * math.cos(n * step_rad) for n in range(self.samples))
        return SineResponse(self.interval_s, 0.0, voltages_v)


def _takes_none(role: str) -> ConfigError:
    return ConfigError(f"the {role} takes no readings by itself, as sampling a sine asks for")


class ModulatedRecord(StepResult, Struct, frozen=True):
    """Readings of the output, of V_Vc, or of both at the same time.

    `output_v` and `v_vc_v` (V) stand in the order in which they were taken, none of what was not sampled; each
    integrates over `aperture_s`. `interval_s` is the spacing that was asked for. `output_t_s` and `v_vc_t_s` are the
    bench times at which the first began, s. `table_rate_deg_s` is the read-back of the table at the end, None where
    none was asked.
    """

    interval_s: float
    aperture_s: float
    output_t_s: float
    output_v: tuple[float, ...]
    v_vc_t_s: float
    v_vc_v: tuple[float, ...]
    table_rate_deg_s: float | None

    def corrected(self, step: Step, known: Sources) -> Self:
        by_hand = isinstance(step, SampleModulated) and step.of == "v_vc"
        v_vc = known.corrected if by_hand else known.v_vc_corrected
        output_v = tuple(map(known.corrected, self.output_v))
        return replace(self, output_v=output_v, v_vc_v=tuple(map(v_vc, self.v_vc_v)))

    def describe(self) -> str:
        means = [f"{math.fsum(each) / len(each):+.5f} V" for each in (self.output_v, self.v_vc_v) if each]
        return ", V_Vc ".join(means)


@does(Effect.MEASURES, "output", overhead_s=0.5)
class SampleModulated(Step, Struct, frozen=True):
    """Sample while V_Vc is a sine, or rests: `samples` readings, one every `interval_s`, by the meters themselves.

    An interval of one integration time leaves no gap between the readings.

    `of` is what is sampled: the output by the multimeter, V_Vc by it (its leads were moved there), or both at once,
    V_Vc by its own meter. Frequency (Hz) and amplitude (V) of V_Vc stand here for the record; 0 V is rest.
    `table_deg_s` is what the table must read back at the end, within `tolerance_deg_s`; None asks no table.
    """

    frequency_hz: float
    amplitude_v: float
    samples: int
    interval_s: float
    of: Literal["output", "v_vc", "both"]
    table_deg_s: float | None
    tolerance_deg_s: float

    def describe(self) -> str:
        what = {"output": "the output", "v_vc": "V_Vc", "both": "output and V_Vc at once"}[self.of]
        return f"sample {what}: {self.samples} readings, one every {1e3 * self.interval_s:g} ms"

    @property
    def physical_s(self) -> float:
        return self.samples * self.interval_s

    def perform(self, context: Context) -> ModulatedRecord:
        """Start the meters' own sampling, and fetch the readings.

        Raises:
            ConfigError: a meter cannot take readings by itself.
            MeasurementError: the table does not turn as it should.
        """
        clock, ends_s = context.bench.clock, 0.0
        begun: list[tuple[SamplesVoltage, float]] = []
        for role in ("v_vc_meter", "multimeter") if self.of == "both" else ("multimeter",):
            meter = getattr(context.bench, role)
            if not isinstance(meter, SamplesVoltage):
                raise _takes_none(role)
            gaps = self.interval_s > 1.001 * meter.aperture_s
            lasts_s = meter.start_sampling(self.samples, self.interval_s)
            begun.append((meter, clock.now()))
            # what the meter needs between two readings is not known below a millisecond
            ends_s = max(ends_s, begun[-1][1] + lasts_s + (1e-3 * self.samples if gaps else 0.0))
        clock.sleep_until(ends_s)
        taken = [(began_s, context.believable(meter.sampled_voltages_v)) for meter, began_s in reversed(begun)]
        table = None if self.table_deg_s is None else read_rate(context, self.table_deg_s, self.tolerance_deg_s)
        none: tuple[float, tuple[float, ...]] = (0.0, ())
        output, v_vc = (none, *taken) if self.of == "v_vc" else (*taken, none)[:2]
        return ModulatedRecord(self.interval_s, begun[-1][0].aperture_s, *output, *v_vc, table)

    def predict(self, gyro: LinearGyro) -> ModulatedRecord:
        """Predict a sine, the modes following at once, and the noise that `gyro` has."""
        step_rad = 2.0 * math.pi * self.frequency_hz * self.interval_s
        rate_deg_s = self.table_deg_s or 0.0
        swing_v = gyro.scale_factor * gyro.k_vc
        v_vc_v = tuple(self.amplitude_v * math.cos(n * step_rad) for n in range(self.samples))
        middle_v = gyro.bias_v + gyro.scale_factor * rate_deg_s
        noise_v = gyro.record_noise_v(self.samples, self.interval_s, self.interval_s)
        output_v = tuple(middle_v + swing_v * each + noise for each, noise in zip(v_vc_v, noise_v, strict=True))
        sampled = self.of
        return ModulatedRecord(
            self.interval_s,
            self.interval_s,
            0.0,
            output_v if sampled != "v_vc" else (),
            0.0,
            v_vc_v if sampled != "output" else (),
            self.table_deg_s,
        )
