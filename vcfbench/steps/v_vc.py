"""Measurement of V_Vc: together with the output by a second multimeter, or alone by a meter with its leads there."""

from collections.abc import Sequence
from typing import ClassVar, Literal, Self

from msgspec import Struct
from msgspec.structs import replace

from vcfbench.bench.bench import Bench
from vcfbench.interfaces import BeginsReadings, Multimeter
from vcfbench.records.schema import Point
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.station.settings import Sources
from vcfbench.steps.meter import Acquire, ConfigureMeter, MayClip, Window
from vcfbench.steps.step import Context, Effect, Reading, Step, StepResult, does, problem
from vcfbench.steps.tally import Tally


class ConfigureVvcMeter(ConfigureMeter, frozen=True):
    """Select the fixed DC range and integration time of the meter on V_Vc."""

    subject: ClassVar[str] = "V_Vc meter"

    def describe(self) -> str:
        return f"meter on V_Vc: DC {self.range_v:g} V range, {self.nplc:g} power-line cycles, autozero on"

    def command(self, bench: Bench) -> None:
        bench.v_vc_meter.configure_dc_voltage(self.range_v, self.nplc)


class PairedReading(Reading, frozen=True):
    """One reading of the output, and the simultaneous one of the meter on V_Vc, V."""

    v_vc_v: float

    def corrected(self, known: Sources) -> Self:
        return replace(self, voltage_v=known.corrected(self.voltage_v), v_vc_v=known.v_vc_corrected(self.v_vc_v))


class VvcWindow(Window, frozen=True):
    """An averaging window in which V_Vc was measured as well; its point holds mean and scatter of both."""

    readings: tuple[PairedReading, ...]

    def describe(self) -> str:
        return f"{Window.describe(self)}, V_Vc measured {self.point.v_vc_measured_v:+.6g} V"


class AcquireWithVvc(Acquire, frozen=True, kw_only=True):
    """Take a window of the output, and with each reading one of the meter on V_Vc, on the same grid.

    V_Vc is begun first, where its meter can be left alone with a reading, so that both integrate at the same time. The
    mean of V_Vc must be within `v_vc_tolerance_v` of the setting `v_vc_v`: leads that are elsewhere are found here.
    """

    v_vc_tolerance_v: float

    columns: ClassVar[tuple[str, ...]] = ("voltage_v", "v_vc_v")
    taken_as: ClassVar[type[Window]] = VvcWindow

    def describe(self) -> str:
        return f"{Acquire.describe(self)}, V_Vc measured"

    def _reading(self, t_s: float, context: Context) -> Reading:
        """Read both; a V_Vc that could not be begun is read afterwards."""
        output, meter = context.bench.multimeter, context.bench.v_vc_meter
        if not isinstance(meter, BeginsReadings):
            output_v = context.believable(output.read_voltage_v)
            return PairedReading(t_s, output_v, context.believable(meter.read_voltage_v))
        meter.begin_reading()
        output_v = context.believable(output.read_voltage_v)
        return PairedReading(t_s, output_v, context.believable(meter.begun_reading_v))

    def _predicted(self, t_s: float, output_v: float) -> Reading:
        return PairedReading(t_s, output_v, self.v_vc_v)

    def perform(self, context: Context) -> Window:
        """Take the window; MeasurementError also when the measured V_Vc is not the set one."""
        window = Acquire.perform(self, context)
        measured_v = window.point.v_vc_measured_v
        if measured_v is not None:
            require_as_set(context.bench.v_vc_meter, measured_v, self.v_vc_v, self.v_vc_tolerance_v)
        return window

    def _point(self, output: Tally, *others: Tally) -> Point:
        (v_vc,) = others
        measured_v = v_vc.mean_v if v_vc.count else self.v_vc_v
        return replace(super()._point(output), v_vc_measured_v=measured_v, v_vc_std_v=v_vc.std_v)


class AcquireClippedWithVvc(MayClip, AcquireWithVvc, frozen=True, kw_only=True):
    """Take a window of an output that may be clipped, and V_Vc with it."""


class VvcMeasured(StepResult, Struct, frozen=True):
    """V_Vc as a meter read it: each reading, their mean and sample standard deviation (n - 1), V."""

    v_vc: tuple[Reading, ...]
    mean_v: float
    std_v: float

    def corrected(self, step: Step, known: Sources) -> Self:
        by_hand = isinstance(step, MeasureVvc) and step.meter == "multimeter"
        by = known.corrected if by_hand else known.v_vc_corrected
        v_vc = tuple(replace(each, voltage_v=by(each.voltage_v)) for each in self.v_vc)
        return replace(self, v_vc=v_vc, mean_v=by(self.mean_v))

    def describe(self) -> str:
        return f"V_Vc {self.mean_v:+.6g} V, s {self.std_v:.1e} V"


@does(Effect.MEASURES, "V_Vc")
class MeasureVvc(Step, Struct, frozen=True):
    """Measure V_Vc alone: `samples` readings on a grid of `interval_s`, and nothing of the output.

    `meter` is the one whose leads are on V_Vc: a bench with one meter has them moved there before, and back after.
    Their mean must be within `tolerance_v` of the setting `v_vc_v`.
    """

    v_vc_v: float
    samples: int
    interval_s: float
    tolerance_v: float
    meter: Literal["v_vc_meter", "multimeter"] = "v_vc_meter"

    def describe(self) -> str:
        return f"measure V_Vc, set to {self.v_vc_v:+.6g} V: {self.samples} readings, one every {self.interval_s:g} s"

    @property
    def physical_s(self) -> float:
        return self.samples * self.interval_s

    def perform(self, context: Context) -> VvcMeasured:
        """Read on the grid and hold the window to its full length.

        Raises:
            MeasurementError: what was measured is not what was set.
        """
        clock, meter = context.bench.clock, getattr(context.bench, self.meter)
        start_s = clock.now()
        readings = []
        for number in range(self.samples):
            clock.sleep_until(start_s + number * self.interval_s)
            readings.append(Reading(clock.now(), context.believable(meter.read_voltage_v)))
        clock.sleep_until(start_s + self.physical_s)
        measured = _measured(readings)
        require_as_set(meter, measured.mean_v, self.v_vc_v, self.tolerance_v)
        return measured

    def predict(self, gyro: LinearGyro) -> VvcMeasured:
        """Predict the setting, without noise."""
        return _measured([Reading(number * self.interval_s, self.v_vc_v) for number in range(self.samples)])


def _measured(readings: Sequence[Reading]) -> VvcMeasured:
    tally = Tally()
    tally.add([each.voltage_v for each in readings])
    return VvcMeasured(tuple(readings), tally.mean_v, tally.std_v)


def require_as_set(meter: Multimeter, measured_v: float, set_v: float, tolerance_v: float) -> None:
    """Raise MeasurementError when V_Vc is not at its setting, within the tolerance: the leads may be elsewhere."""
    if not abs(measured_v - set_v) <= tolerance_v:
        raise problem(
            meter,
            f"reads {measured_v:+.6g} V where V_Vc was set to {set_v:+.6g} V, within {tolerance_v:.2g} V",
            "check its leads on the V_Vc input, their polarity, and the generator's output",
        )
