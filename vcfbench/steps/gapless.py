"""Readings that the multimeter takes by itself, one integration time after the other, as many as its memory holds."""

from vcfbench.interfaces import SamplesVoltage
from vcfbench.steps.meter import Acquire
from vcfbench.steps.step import Context, Reading, problem
from vcfbench.steps.tally import Tally

_BETWEEN_S = 2.0
"""Estimated time between two bursts: both transfers, autozero, setting up."""


class AcquireGapless(Acquire, frozen=True, kw_only=True):
    """Take `samples` readings without time between them, in bursts of `burst`, which the meter's memory must hold.

    `interval_s` is one integration time. Between bursts the readings are fetched and a zero is taken, which is the
    only time that is lost. The times of readings are those at which they were due.
    """

    burst: int

    def describe(self) -> str:
        return (
            f"{self.samples} readings of {self.interval_s:g} s without gaps, in bursts of {self.burst} that the meter "
            "takes by itself"
        )

    @property
    def duration_s(self) -> float:
        return self.physical_s + -(-self.samples // self.burst) * _BETWEEN_S

    def _read(self, start_s: float, tally: Tally, context: Context) -> None:
        clock, meter = context.bench.clock, context.bench.multimeter
        if not isinstance(meter, SamplesVoltage):
            raise problem(meter, "it takes no readings by itself, which a record without gaps needs")
        for first in range(0, self.samples, self.burst):
            count = min(self.burst, self.samples - first)
            lasts_s = meter.start_sampling(count, self.interval_s)
            begun_s = clock.now()
            clock.sleep_until(begun_s + lasts_s)
            for number, voltage_v in enumerate(context.believable(meter.sampled_voltages_v)):
                if closed := context.take(Reading(begun_s + number * self.interval_s, voltage_v)):
                    self._take_in(closed, tally, context)
