"""Common base of the simulated tables with binary frames or unasked status."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from random import Random
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from simrack.adjustment import Adjustment
from simrack.clock import Clock
from simrack.rate_tables.axis import TableErrors, TableWorld
from simrack.rate_tables.interlocked import Interlocked
from simrack.rate_tables.line import LineDevice, SerialTiming

if TYPE_CHECKING:
    import numpy as np


class StreamErrors(TableErrors, frozen=True):
    """Imperfections of a table that sends its status unasked; zero switches each off. No specimen has them drawn.

    Raises:
        ValueError: the jitter is longer than the period, or the share is none.
    """

    stream_jitter_s: float = 0.0
    """By how much a status comes late at most, s: each by a time of its own, all up to this equally likely, 0...0.1."""
    stream_lost: float = 0.0
    """Share of the statuses that never come, 0...1."""

    def __post_init__(self) -> None:
        """Refuse values beyond the bounds."""
        super().__post_init__()
        _jitter(self.stream_jitter_s)
        _share(self.stream_lost)

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> StreamErrors:
        """Return a specimen: the read-back as of any table."""
        return cls(**{name: getattr(TableErrors.drawn(rng), name) for name in TableErrors.__struct_fields__})


class UnsolicitedStatus(NamedTuple):
    """A status that leaves now, and its delay."""

    message: bytes
    late_s: float


class FrameDevice(LineDevice):
    """A device that takes frames of a fixed length which begin with `header` and whose last byte checks the others.

    A damaged frame costs one byte: the search for a header goes on behind it.
    """

    def __init__(self, world: TableWorld, timing: SerialTiming, *, header: bytes, length: int) -> None:
        super().__init__(world, timing, terminators=b"", longest=length)
        self._header = header
        self._length = length

    def message_size(self, data: bytes | bytearray) -> int:
        """Return the length of the first frame in `data`, or of the bytes before any; 0 while a frame is incomplete."""
        begins = data.find(self._header[:1])
        if begins:
            return begins if begins > 0 else len(data)
        if len(data) < self._length:
            return 0
        return self._length if self._intact(bytes(data[: self._length])) else 1

    def _take(self, part: bytes) -> None:
        for byte in part:
            self._input.append(byte)
            while self._input and not self._may_begin():
                del self._input[0]
            if len(self._input) == self._length:
                frame = bytes(self._input)
                self._input.clear()
                self._send(self._answer(frame))

    def _may_begin(self) -> bool:
        begun = min(len(self._input), len(self._header))
        if self._input[:begun] != self._header[:begun]:
            return False
        return len(self._input) < self._length or self._intact(bytes(self._input))

    def _finish_message(self) -> None:
        """Do nothing: frames end by their length."""

    def _intact(self, frame: bytes) -> bool:
        """Return True if the check of a frame of the right length and header holds."""
        raise NotImplementedError


_PERIOD_S = 0.1


class StatusStream:
    """Status that a table sends by itself every 0.1 s, as late and as lossy as `errors` say."""

    def __init__(self, clock: Clock, errors: TableErrors, noise_seed: int) -> None:
        self._clock = clock
        self._jitter_s = getattr(errors, "stream_jitter_s", 0.0)
        self._lost = getattr(errors, "stream_lost", 0.0)
        self._random = Random(noise_seed)  # noqa: S311  (no secret)
        self.due_s = clock.now() + _PERIOD_S

    def due(self, make: Callable[[], bytes]) -> UnsolicitedStatus | None:
        """Return the status that is due now, if one is, and not lost; of several slept through only the last.

        It is made at its instant, lost or late: what it says is not younger for being late.
        """
        now = self._clock.now()
        if now < self.due_s:
            return None
        self.due_s = (math.floor(now / _PERIOD_S + 1e-9) + 1) * _PERIOD_S
        status = UnsolicitedStatus(make(), self._jitter_s * self._random.random())
        return None if self._random.random() < self._lost else status

    def adjustments(self) -> Iterable[Adjustment]:
        """Return the adjustments of a served table."""
        late, lost = "by how much a status comes late at most", "share of the statuses that never come"
        yield Adjustment("stream.jitter_s", "s", late, lambda: self._jitter_s, self._set_jitter)
        yield Adjustment("stream.lost", "1", lost, lambda: self._lost, self._set_lost)

    def _set_jitter(self, value: Any) -> None:
        self._jitter_s = _jitter(value)

    def _set_lost(self, value: Any) -> None:
        self._lost = _share(value)


class Streaming(Interlocked, LineDevice):
    """A table that sends its status unasked."""

    errors_class: ClassVar = StreamErrors
    most_unread: ClassVar[int]
    """Statuses that wait to be read at most: a host's serial buffer is no longer (4096 bytes)."""
    _stream: StatusStream

    def adjustments(self) -> Iterable[Adjustment]:
        """Return the adjustments of a served table from outside its wire."""
        return [*super().adjustments(), *self._stream.adjustments()]

    def _advance(self) -> None:
        super()._advance()
        self._follow()
        status = self._stream.due(self._status)
        if status is not None and len(self._output) < self.most_unread:
            self._send(*status)

    def _own_events_s(self) -> tuple[float, ...]:
        return (*super()._own_events_s(), self._stream.due_s)

    def _follow(self) -> None:
        """Go on to the next state, where the axis has."""

    def _status(self) -> bytes:
        raise NotImplementedError


def _jitter(seconds: Any) -> float:
    return _between(seconds, 0.1)


def _share(share: Any) -> float:
    return _between(share, 1.0)


def _between(value: Any, most: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value <= most:
        raise ValueError(f"a number at least 0 and at most {most:g}")
    return float(value)
