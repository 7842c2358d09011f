"""Everything about the multimeter: its range, and averaging windows."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar, Self

from msgspec import Struct
from msgspec.structs import replace

from vcfbench.bench.bench import Bench
from vcfbench.interfaces import SamplesVoltage
from vcfbench.records.schema import Point, fits_one_chunk
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.station.settings import Sources
from vcfbench.steps.scatter import NoiseSeen
from vcfbench.steps.step import Context, Effect, Reading, Step, StepResult, does, problem
from vcfbench.steps.supply import ConfigureRail, RailReading, predicted_rail, read_rail
from vcfbench.steps.table import read_rate
from vcfbench.steps.tally import Tally

ReadBack = tuple[tuple[RailReading, ...], float | None]
"""What was read back at the end of a window: the rails, and the table's rate, deg/s, where one was asked."""


class Window(StepResult, Struct, frozen=True):
    """One averaging window: its readings, and the state of the bench read back at its end.

    `readings` are all of a window that fits one chunk; those of a longer one are in the journal only, and it has none.
    `table_rate_deg_s` is the read-back of the table, None where none was asked, `rails` that of the supply, `point`
    what the readings come to.
    """

    readings: tuple[Reading, ...]
    table_rate_deg_s: float | None
    rails: tuple[RailReading, ...]
    point: Point

    @property
    def mean_v(self) -> float:
        """Mean of the readings, V."""
        return self.point.output_v

    @property
    def std_v(self) -> float:
        """Sample standard deviation of the readings (n - 1), V."""
        return self.point.std_v

    @property
    def recorded_point(self) -> Point | None:
        return self.point

    def corrected(self, step: Step, known: Sources) -> Self:
        readings = tuple(each.corrected(known) for each in self.readings)
        return replace(self, readings=readings, point=known.corrected_point(self.point))

    def as_json(self) -> dict[str, Any]:
        """Return readings and read-backs; the point too, if it cannot be computed from the readings."""
        values = StepResult.as_json(self)
        if self.readings and not self.point.moved_u_v:
            del values["point"]
        else:
            values["point"] = self.point.as_json()
        return values

    def counted_from(self, moved_v: float, u_v: float) -> Self:
        """Return the window with its point counted from where the output was before."""
        return replace(self, point=replace(self.point, moved_v=moved_v, moved_u_v=u_v))

    def moved(self, output_v: float, v_vc_v: float) -> Self:
        return replace(self, point=self.point.moved(output_v, v_vc_v))

    def referred(self) -> Self:
        """Return the window with its mean as it would be, had the output not moved in pauses."""
        return replace(self, point=self.point.referred()) if self.point.moved_v else self

    def describe(self) -> str:
        return f"{self.mean_v:+.5f} V, s {self.std_v:.1e} V"


class ZeroWindow(Window, frozen=True):
    """A window that is compared with earlier ones, and is no point of the run."""

    @property
    def recorded_point(self) -> None:
        """None: the window is for comparison alone."""
        return


@does(Effect.SETS, "multimeter", overhead_s=0.1)
class ConfigureMeter(Step, Struct, frozen=True):
    """Select the multimeter's fixed DC range and integration time."""

    range_v: float
    nplc: float

    def describe(self) -> str:
        return f"multimeter: DC {self.range_v:g} V range, {self.nplc:g} power-line cycles, autozero on"

    def command(self, bench: Bench) -> None:
        bench.multimeter.configure_dc_voltage(self.range_v, self.nplc)


class OutputSeen(StepResult, Struct, frozen=True):
    """A few readings of the output, V, that are compared with others and are no window."""

    voltages_v: tuple[float, ...]

    @property
    def mean_v(self) -> float:
        """Their mean, V."""
        return math.fsum(self.voltages_v) / len(self.voltages_v)

    @property
    def variance_v2(self) -> float:
        """Variance of one reading (n - 1), V^2."""
        return math.fsum((each - self.mean_v) ** 2 for each in self.voltages_v) / (len(self.voltages_v) - 1)

    def describe(self) -> str:
        return f"{self.mean_v:+.5f} V"


@does(Effect.MEASURES, "the output")
class LookAtOutput(Step, Struct, frozen=True):
    """Read the output `count` times, at least two, with the table at `rate_deg_s`.

    Where it turns it must read back that rate, within `tolerance_deg_s`, when the readings are taken.
    """

    count: int
    rate_deg_s: float = 0.0
    tolerance_deg_s: float = 0.0

    def describe(self) -> str:
        return f"the output at {self.rate_deg_s:+g} deg/s, {self.count} readings"

    @property
    def physical_s(self) -> float:
        return 0.3 * self.count

    def perform(self, context: Context) -> OutputSeen:
        read = context.bench.multimeter.read_voltage_v
        seen = OutputSeen(tuple(context.believable(read) for _ in range(self.count)))
        self.read_back(context)
        return seen

    def read_back(self, context: Context) -> None:
        """Read the rate back where it turns: else a table that stopped is taken for a gyroscope without an answer."""
        if self.rate_deg_s:
            read_rate(context, self.rate_deg_s, self.tolerance_deg_s)

    def predict(self, gyro: LinearGyro) -> OutputSeen:
        return OutputSeen((gyro.output_v(self.rate_deg_s),) * self.count)


@does(Effect.MEASURES, "output")
class Acquire(Step, Struct, frozen=True):
    """Take `samples` readings on a grid of `interval_s`; the window counts `samples * interval_s` seconds.

    `step` is the number of the paper's step. `rate_deg_s` is the rate that the point stands for: the table's rate, in
    step 4 the equivalent rate K_Vc V_Vc. `table_deg_s` is what the table must read back (within `tolerance_deg_s`) at
    the end, None where no table is asked; `rails` what the supply must (within `rail_tolerance_v`). `resolution_v` is
    that of one reading; `noise_v` is what the scatter of the readings is expected to be, (least, most), None when
    nothing is known of it.
    """

    step: int
    rate_deg_s: float
    v_vc_v: float
    table_deg_s: float | None
    tolerance_deg_s: float
    rails: tuple[ConfigureRail, ...]
    rail_tolerance_v: float
    samples: int
    interval_s: float
    resolution_v: float
    noise_v: tuple[float, float] | None = None

    columns: ClassVar[tuple[str, ...]] = ("voltage_v",)
    """Fields of a reading that are summed up."""
    taken_as: ClassVar[type[Window]] = Window

    def describe(self) -> str:
        return (
            f"average {self.samples} readings, one every {self.interval_s:g} s: "
            f"{self.rate_deg_s:+.6g} deg/s, V_Vc {self.v_vc_v:+.6g} V"
        )

    @property
    def physical_s(self) -> float:
        return self.samples * self.interval_s

    def perform(self, context: Context) -> Window:
        """Read on the grid, hold the window to its full length, and read back table and rails before it ends.

        Raises:
            MeasurementError: the meter cannot follow, a read-back is not as it should be, or the readings do not
                scatter as those of the run do.
        """
        clock = context.bench.clock
        start_s = clock.now()
        tallies = self.tallies()
        self._read(start_s, tallies, context)
        window = self.window(tallies, self.read_back(context), context)
        clock.sleep_until(start_s + self.physical_s)
        return window

    def read_back(self, context: Context) -> ReadBack:
        """Read the rails back, and the table's rate if the point is on a table."""
        asked = () if "power" in context.bench.by_hand else self.rails  # a person read them when they came on
        rails = tuple(read_rail(context, rail, self.rail_tolerance_v) for rail in asked)
        if self.table_deg_s is None:
            return rails, None
        return rails, read_rate(context, self.table_deg_s, self.tolerance_deg_s)

    def window(self, tallies: Sequence[Tally], read_back: ReadBack, context: Context) -> Window:
        """Return the window of the readings; MeasurementError if they do not scatter as expected."""
        tally = tallies[0]
        last = context.rest()
        self._add(tallies, last)
        # Raise MeasurementError unless the readings scatter as the bench file expects, apart from drift
        if self.noise_v is not None and not self.noise_v[0] <= tally.within_std_v <= self.noise_v[1]:
            low_v, high_v = self.noise_v
            raise problem(
                context.bench.multimeter,
                f"the readings scatter by {tally.within_std_v:.2g} V, the bench file expects {low_v:g} to {high_v:g} V "
                "(expected.reading_noise_v)",
            )
        self._require_like_the_run(last, tally.count, context)
        rails, table_deg_s = read_back
        return self.taken_as(last if tally.chunks == 1 else (), table_deg_s, rails, self._point(*tallies))

    def predict(self, gyro: LinearGyro) -> Window:
        output_v = gyro.output_v(self.table_deg_s or 0.0)
        rails = tuple(map(predicted_rail, self.rails))
        tallies = self.tallies()
        if not fits_one_chunk(self.samples, self.interval_s):
            tallies[0].count, tallies[0].mean_v = self.samples, output_v
            return self.taken_as((), self.table_deg_s, rails, self._point(*tallies))
        times_s = [number * self.interval_s for number in range(self.samples)]
        readings = tuple(self._predicted(t_s, output_v + gyro.noise_v(t_s)) for t_s in times_s)
        self._add(tallies, readings)
        return self.taken_as(readings, self.table_deg_s, rails, self._point(*tallies))

    def recorded(self, result: Mapping[str, Any]) -> Mapping[str, Any]:
        if "point" in result or not result.get("readings"):
            return result
        tallies = self.tallies()
        for tally, name in zip(tallies, self.columns, strict=True):
            tally.add([reading[name] for reading in result["readings"]])
        return {**result, "point": self._point(*tallies).as_json()}

    def recall(self, readings_v: Sequence[float], context: Context) -> None:
        if context.noise is None:
            context.noise = NoiseSeen(self.resolution_v)
        context.noise.doubt(readings_v, turning=bool(self.table_deg_s))  # nothing is wrong with them: the run went on

    def _point(self, output: Tally, *_others: Tally) -> Point:
        return Point(self.step, self.rate_deg_s, self.v_vc_v, output.mean_v, output.std_v, output.count)

    def tallies(self) -> list[Tally]:
        """Return the empty sums of the window, one of each column."""
        return [Tally() for _ in self.columns]

    def _add(self, tallies: Sequence[Tally], readings: Sequence[Reading]) -> None:
        """Add one chunk to the sums."""
        for tally, name in zip(tallies, self.columns, strict=True):
            tally.add([getattr(reading, name) for reading in readings])

    def _reading(self, t_s: float, context: Context) -> Reading:
        """Take one reading; `t_s` is the bench time at which it is asked for."""
        return Reading(t_s, context.believable(context.bench.multimeter.read_voltage_v))

    def _predicted(self, t_s: float, output_v: float) -> Reading:
        """Return the reading that `output_v` would give."""
        return Reading(t_s, output_v)

    def _read(self, start_s: float, tallies: Sequence[Tally], context: Context) -> None:
        """Take all readings."""
        for t_s in self.instants_s(start_s, context.bench):
            self.take(self._reading(t_s, context), tallies, context)

    def instants_s(self, start_s: float, bench: Bench) -> Iterator[float]:
        """Yield the bench time of each reading when it is come; MeasurementError: the meter cannot follow."""
        typed = "multimeter" in bench.by_hand  # a person takes the time that it takes
        for number in range(self.samples):
            instant_s = start_s + number * self.interval_s
            if not typed:
                bench.clock.sleep_until(instant_s)
            t_s = bench.clock.now()
            if t_s - instant_s > 0.5 * self.interval_s and not typed:
                meters = "the meter" if len(self.columns) == 1 else "the meter, or that on V_Vc,"
                raise problem(
                    bench.multimeter,
                    f"reading {number + 1} of {self.samples} began {t_s - instant_s:.2g} s late: "
                    f"{meters} cannot follow one reading every {self.interval_s:g} s",
                )
            yield t_s

    def take(self, reading: Reading, tallies: Sequence[Tally], context: Context) -> None:
        """Take a reading; sum up and doubt each chunk of a long window as it is closed."""
        if closed := context.take(reading):
            self._add(tallies, closed)
            self._require_like_the_run(closed, tallies[0].count, context)

    def _require_like_the_run(self, chunk: tuple[Reading, ...], count: int, context: Context) -> None:
        """See that the latest chunk of `count` readings, or the whole window, scatters as those of the run do."""
        if context.noise is None:
            context.noise = NoiseSeen(self.resolution_v)
        if said := context.noise.doubt([each.voltage_v for each in chunk], turning=bool(self.table_deg_s)):
            first = count - len(chunk) + 1
            among = "" if len(chunk) == self.samples else f" (readings {first} to {count} of {self.samples})"
            raise problem(context.bench.multimeter, f"{said}{among}; a mean of them is no measurement")


class MayClip:
    """A window at which the output may be clipped: then its readings have no noise, and need not scatter as others."""

    def _require_like_the_run(self, chunk: tuple[Reading, ...], count: int, context: Context) -> None:
        """Ask nothing."""

    def recall(self, readings_v: Sequence[float], context: Context) -> None:
        """Keep nothing: no window is held against these."""


class AcquireClipped(MayClip, Acquire, frozen=True):
    """Take a window of an output that may be clipped."""


class VerifyZero(Acquire, frozen=True):
    """Take the zero before or after everything else, or a level again: a window that is compared, and is no point."""

    taken_as: ClassVar[type[Window]] = ZeroWindow

    def describe(self) -> str:
        at = f"V_Vc of {self.v_vc_v:+.6g} V again" if self.v_vc_v else "the zero"
        return f"{at}, to compare: {self.samples} readings, one every {self.interval_s:g} s"


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

    def _read(self, start_s: float, tallies: Sequence[Tally], context: Context) -> None:
        clock, meter = context.bench.clock, context.bench.multimeter
        if not isinstance(meter, SamplesVoltage):
            raise problem(meter, "it takes no readings by itself, which a record without gaps needs")
        for first in range(0, self.samples, self.burst):
            count = min(self.burst, self.samples - first)
            lasts_s = meter.start_sampling(count, self.interval_s)
            begun_s = clock.now()
            clock.sleep_until(begun_s + lasts_s)
            for number, voltage_v in enumerate(context.believable(meter.sampled_voltages_v)):
                self.take(Reading(begun_s + number * self.interval_s, voltage_v), tallies, context)
