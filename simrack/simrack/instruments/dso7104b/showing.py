"""Screen of the DSO7104B: the records of the last acquisition, their traces, and the data sent of them."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from typing import Any

from simrack.instruments.dso7104b.math_settings import math_trace
from simrack.instruments.dso7104b.measurements import MeasuredTrace, Thresholds
from simrack.instruments.dso7104b.record import Record
from simrack.instruments.dso7104b.settings import ScopeSettings
from simrack.scpi import Parts, Pending, ScpiError, block_header

_SCREEN_POINTS = 1000


class ShownRecords:
    """The records on the screen, one a segment.

    `state` are the settings as they stand, `time_base_error` the relative one of the instrument's clock. `analysed`
    says that :MEASure:STATistics? counts all segments.
    """

    def __init__(self, state: ScopeSettings, time_base_error: float) -> None:
        self._state = state
        self._time_base_error = time_base_error
        self.records: list[Record] = []
        self.analysed = False
        self._segmented = False
        self._traces: dict[tuple[int, str], MeasuredTrace] = {}
        self._sent: tuple[Record, tuple[Any, ...], Parts] | None = None

    def show(self, records: list[Record], *, segmented: bool = False) -> None:
        """Replace all shown records by these; the first is displayed."""
        self.records, self._segmented = records, segmented
        self._state.acquire.segment = 1
        self.analysed = False
        self._sent = None
        self._traces.clear()

    @property
    def record(self) -> Record:
        """The record on the screen, of the chosen segment; -230 if there is none."""
        if not self.records:
            raise ScpiError(-230, "Data corrupt or stale")
        index: int = self._state.acquire.segment
        return self.records[min(index, len(self.records)) - 1]

    def segments(self) -> int:
        """Return the number of acquired segments; 0 of an acquisition that was not segmented."""
        return len(self.records) if self._segmented else 0

    def time_tag_s(self) -> float:
        """Return the trigger of the chosen segment after that of the first, s."""
        if not self.segments():
            return 0.0
        elapsed_s = self.record.trigger_s - self.records[0].trigger_s
        return elapsed_s * (1.0 + self._time_base_error)

    def measuring(self, source: str, record: Record | None = None) -> Generator[None, None, MeasuredTrace]:
        """Return, after slices of work, the trace of `source` for measurements; -230 where it is not shown."""
        if not self._state.is_shown(source):
            raise ScpiError(-230)
        return (yield from self.tracing(source, record))

    def tracing(self, source: str, record: Record | None = None) -> Generator[None, None, MeasuredTrace]:
        """Return, after slices of work, the acquired trace of `source`, shown or not."""
        shown = record or self.record
        found = self._traces.get((shown.number, source))
        if found is None:
            found = self._traces[shown.number, source] = yield from self._trace(source, shown)
        return found

    def _trace(self, source: str, record: Record) -> Generator[None, None, MeasuredTrace]:
        if source == "FUNC":
            math_ = math_trace(self._state, record, _SCREEN_POINTS)
            return MeasuredTrace(math_.places(), math_.values, clipped=math_.clipped, thresholds=self._thresholds())
        channel = int(source[4:])
        points = record.measured_points(channel, _SCREEN_POINTS)
        shown = seen = yield from record.digitising(channel, points)
        if record.kept.kind == "PEAK":
            seen = yield from record.digitising(channel, points, extremes=True)
        yield
        times, thresholds = record.screen.times_s(points), self._thresholds()
        yield
        return MeasuredTrace(times, shown.volts, clipped=seen.clipped, thresholds=thresholds, peaks=seen.volts)

    def _thresholds(self) -> Thresholds:
        kind, upper, middle, lower = self._state.measure.thresholds
        return Thresholds() if kind == "STAN" else Thresholds(upper, middle, lower, absolute=kind == "ABS")

    def forget_traces(self) -> None:
        """Discard the measurements, because their definitions have changed."""
        self._traces.clear()

    def sent(self, asked: tuple[Any, ...], parts: Iterator[bytes]) -> Any:
        """Return the record as :WAVeform:DATA? sends it, a block of `parts`, or the block sent the last time."""
        kept = self._sent
        if kept is not None and kept[0] is self.record and kept[1] == asked:
            return kept[2]
        record, made = self.record, list[bytes]()

        def make() -> Generator[None, None, Parts]:
            for part in parts:
                made.append(part)
                yield
            self._sent = (record, asked, Parts((block_header(sum(map(len, made)), 8), *made)))
            return self._sent[2]

        return Pending.worked_out(make())
