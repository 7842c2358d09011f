"""Latency of a stream: the table ramps up and back, and both are watched."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from msgspec import Struct

from vcfbench.drivers.streams.decoder import Sample
from vcfbench.drivers.streams.reader import StreamReader
from vcfbench.drivers.together import kept
from vcfbench.interfaces import RateTable
from vcfbench.station.limits import LimitChecks
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.steps.step import Context, Effect, Step, StepResult, does, problem
from vcfbench.steps.table import AwaitRate, SetRate

if TYPE_CHECKING:
    from vcfbench.analysis.latency import Ramp

_REST_S = 0.5
"""Time before and after each ramp that is watched too, beside the latency that the bench file tells, s."""
_TURN_S = 0.01
"""Longest wait for frames between two read-backs, s."""
_Frames = list[tuple[float, Sample]]


class LatencySeen(StepResult, Struct, frozen=True):
    """Age of the stream's numbers as they come, s, with its u; None where too little was seen of a ramp.

    `trouble` is the error of a stream that failed; all was measured before, so it costs the latency alone.
    """

    latency_s: float | None = None
    u_latency_s: float | None = None
    trouble: str = ""

    def describe(self) -> str:
        if self.latency_s is None or self.u_latency_s is None:
            few = "too few frames, or too few read-backs of the table, within a ramp"
            return f"latency not measured: {self.trouble or few}"
        return f"its numbers are {1e3 * self.latency_s:.1f} ms old as they come, u {1e3 * self.u_latency_s:.1f} ms"


@does(Effect.MEASURES, "the stream's latency", overhead_s=0.5)
class MeasureLatency(Step, Struct, frozen=True):
    """Ramp the table from rest to a rate and back, and watch its read-back and the frames meanwhile.

    What a frame shows is old by its own span, the filters of the device, its transmission and that of an adapter: all
    of it is in the latency. By how much the table's read-back is old is known from the bench file alone.
    """

    rate_deg_s: float
    acceleration_deg_s2: float
    tolerance_deg_s: float
    deadline_s: float

    def describe(self) -> str:
        ramps = f"{self.rate_deg_s:+g} deg/s and back at {self.acceleration_deg_s2:g} deg/s^2"
        return f"the stream's latency: table to {ramps}"

    @property
    def _ramps(self) -> tuple[SetRate, SetRate]:
        there = SetRate(self.rate_deg_s, self.acceleration_deg_s2, 0.0)
        return there, SetRate(0.0, self.acceleration_deg_s2, self.rate_deg_s)

    @property
    def physical_s(self) -> float:
        return sum(each.ramp_s + 2.0 * _REST_S for each in self._ramps)

    def within(self, limits: LimitChecks) -> None:
        for each in self._ramps:
            each.within(limits)

    def perform(self, context: Context) -> LatencySeen:
        return self.of_all({"": context})[""]

    def of_all(self, contexts: Mapping[str, Context]) -> dict[str, LatencySeen]:
        """Do it once for all devices on the table; return the result of each."""
        from vcfbench.analysis.latency import mean_latency  # noqa: PLC0415  # numpy takes longer than all else

        readers = {name: _reader(each) for name, each in contexts.items()}
        context = next(iter(contexts.values()))
        table = context.bench.rate_table
        ramps: dict[str, list[Ramp]] = {name: [] for name in readers}
        failed = dict[str, Any]()
        for each in self._ramps:
            for name, ramp in _followed(each, readers, failed, table, context).items():
                ramps[name].append(ramp)
            AwaitRate(each.rate_deg_s, 0.0, self.tolerance_deg_s, self.deadline_s).perform(context)
        found = {name: mean_latency(each, readers[name].stream.table_readback_s) for name, each in ramps.items()}
        lost = {name: LatencySeen(trouble=each.what) for name, each in failed.items()}
        seen = {name: LatencySeen() if e is None else LatencySeen(e.latency_s, e.u_s) for name, e in found.items()}
        return seen | lost

    def predict(self, gyro: LinearGyro) -> LatencySeen:
        return LatencySeen()


def _reader(context: Context) -> StreamReader:
    reader = context.bench.multimeter
    if not isinstance(reader, StreamReader):
        raise problem(reader, "it is no stream")
    return reader


def _followed(
    ramp: SetRate, readers: Mapping[str, StreamReader], failed: dict[str, Any], table: RateTable, context: Context
) -> "dict[str, Ramp]":
    """Do a ramp, with some rest before and after it; return read-backs and frames by device.

    A stream that fails is in `failed` with its error, and is read no more.
    """
    clock = context.bench.clock
    frames: dict[str, _Frames] = {name: [] for name in readers}
    looks: list[tuple[float, float, float]] = []

    def watch(until_s: float) -> None:
        while clock.now() < until_s:
            for name, each in readers.items():
                if name not in failed:
                    with kept(failed, name):
                        frames[name] += each.frames(_TURN_S)
            asked_s = clock.now()
            rate_deg_s = table.rate_deg_s()
            looks.append((asked_s, clock.now(), rate_deg_s))

    rest_s = _REST_S + max(each.stream.latency_s for each in readers.values())
    for name, each in readers.items():
        with kept(failed, name):
            each.flush()
    watch(clock.now() + rest_s)
    ramp.command(context.bench)
    watch(clock.now() + ramp.ramp_s + rest_s)
    return {name: _ramp(each, looks, frames[name]) for name, each in readers.items()}


def _ramp(reader: StreamReader, looks: list[tuple[float, float, float]], frames: _Frames) -> "Ramp":
    from vcfbench.analysis.latency import Ramp, course_by_counter  # noqa: PLC0415  # as above

    stream = reader.stream
    frames = frames if stream.counter is not None else []  # without one nothing tells when a frame had come
    came_s, number = course_by_counter(
        [(t_s, each.counter or 0, each.value) for t_s, each in frames],
        period_s=1.0 / stream.sample_rate_hz,
        numbers=1 if stream.counter is None else stream.counter.numbers,
        of_angle=stream.kind == "angle",
        turn=stream.turn,
    )
    return Ramp.of_looks(looks, came_s, number)
