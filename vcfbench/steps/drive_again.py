"""The drive once more, at the end of a run."""

from typing import Any

from msgspec import Struct

from vcfbench.drivers.together import kept
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.steps.scope import DriveFrequency, drive_frequency, scale_v_per_div
from vcfbench.steps.step import Context, Effect, Step, does


@does(Effect.MEASURES, "drive signal", overhead_s=0.3)
class MeasureDriveAgain(Step, Struct, frozen=True):
    """Take one record of the drive at the end of a run; amplitude (V) and frequency (Hz) are known roughly.

    All was measured before, so an oscilloscope that fails here costs this record alone.
    """

    channel: int
    amplitude_v: float
    expected_hz: float
    timebase_s_per_div: float | None = None
    """None: time base and trigger are those of the drive already."""

    def describe(self) -> str:
        return "oscilloscope: frequency of the drive once more"

    def perform(self, context: Context) -> DriveFrequency:
        scope, failed = context.bench.oscilloscope, dict[str, Any]()
        with kept(failed, scope.name):
            if self.timebase_s_per_div is not None:
                scope.configure_timebase(self.timebase_s_per_div)
                scope.configure_trigger(self.channel, 0.0)
            scope.configure_channel(self.channel, scale_v_per_div(self.amplitude_v))
            scope.acquire(self.channel)
            return drive_frequency(context, self.channel, self.amplitude_v, self.expected_hz)
        return DriveFrequency(0.0, 0.0, f"not measured: {failed[scope.name].what}")

    def predict(self, gyro: LinearGyro) -> DriveFrequency:
        return DriveFrequency(self.expected_hz, 0.0)
