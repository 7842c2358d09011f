"""The multimeter as an ohmmeter, on a bench without power."""

import math

from msgspec import Struct

from vcfbench.interfaces import ReadsResistance
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.steps.step import Context, Effect, Step, StepResult, does, problem

_READING_S = 0.5


class ResistanceSeen(StepResult, Struct, frozen=True):
    """Readings of one line, ohm; none where any was beyond the range."""

    readings_ohm: tuple[float, ...]

    @property
    def mean_ohm(self) -> float:
        """Their mean, ohm; inf beyond the range."""
        return math.fsum(self.readings_ohm) / len(self.readings_ohm) if self.readings_ohm else math.inf

    def describe(self) -> str:
        return f"{self.mean_ohm:.6g} ohm" if self.readings_ohm else "beyond the range"


@does(Effect.MEASURES, "a resistance")
class MeasureResistance(Step, Struct, frozen=True):
    """Read the resistance of the `line` that the multimeter's leads are on, by so many `wires`.

    `expected_ohm` is what a dry run answers with.
    """

    line: str
    range_ohm: float
    nplc: float
    count: int
    wires: int
    expected_ohm: float

    def describe(self) -> str:
        return f"resistance of {self.line}: {self.count} readings by {self.wires} wires, {self.range_ohm:g} ohm range"

    @property
    def physical_s(self) -> float:
        return _READING_S * self.count

    def perform(self, context: Context) -> ResistanceSeen:
        """Read it; MeasurementError where the meter measures no resistance."""
        meter = context.bench.multimeter
        if not isinstance(meter, ReadsResistance):
            raise problem(meter, "it measures no resistance")
        meter.configure_resistance(self.range_ohm, self.nplc, self.wires)
        readings = tuple(context.believable(meter.read_resistance_ohm) for _ in range(self.count))
        return ResistanceSeen(readings if all(map(math.isfinite, readings)) else ())

    def predict(self, gyro: LinearGyro) -> ResistanceSeen:
        return ResistanceSeen((self.expected_ohm,) * self.count)
