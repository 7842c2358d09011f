"""Steps of a stream that replaces the multimeter."""

from msgspec import Struct

from vcfbench.drivers.streams.reader import StreamReader
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.steps.step import Context, Effect, Step, StepResult, does, problem


class StreamSeen(StepResult, Struct, frozen=True):
    """Frames of the readings so far: those that counted, those that were left out, and the device's clock.

    Missing ones are counted by the counter; without one the time of the readings tells them, with `u_dropped`.
    `clock_ppm` is how fast it is against bench time, with its u; None where no counter tells.
    """

    frames: int = 0
    dropped: int = 0
    u_dropped: float = 0.0
    bad: int = 0
    repeated: int = 0
    clock_ppm: float | None = None
    u_clock_ppm: float | None = None
    temperature_c: float | None = None

    def describe(self) -> str:
        by_time = f" by the time they took (u {self.u_dropped:.2g})" if self.u_dropped else ""
        said = [f"{self.frames} frames, {self.dropped} missing{by_time}, {self.bad} spoilt, {self.repeated} repeated"]
        if self.clock_ppm is None or self.u_clock_ppm is None:
            said.append("the device's clock was not measured: no counter, or no time")
        else:
            said.append(f"the device's clock is {self.clock_ppm:+.0f} ppm fast, u {self.u_clock_ppm:.0f} ppm")
        if self.temperature_c is not None:
            said.append(f"the device says {self.temperature_c:.1f} degC")
        return "; ".join(said)


@does(Effect.MEASURES, "the stream")
class LookAtStream(Step, Struct, frozen=True):
    """Take down the counts of the frames of the run, and the device's clock against bench time."""

    def describe(self) -> str:
        return "the stream: frames that counted, frames that were left out, the device's clock"

    def perform(self, context: Context) -> StreamSeen:
        reader = context.bench.multimeter
        if not isinstance(reader, StreamReader):
            raise problem(reader, "it is no stream")
        return StreamSeen(**reader.health())

    def predict(self, gyro: LinearGyro) -> StreamSeen:
        return StreamSeen()
