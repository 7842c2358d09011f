"""What the simulated tables with binary frames or unasked status have in common."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from vcfbench.sim.rate_tables.line import LineDevice, SerialTiming

if TYPE_CHECKING:
    from collections.abc import Callable

    from vcfbench.clock import Clock
    from vcfbench.sim.rate_tables.axis import TableWorld

__all__ = ["FrameDevice", "StatusStream"]


class FrameDevice(LineDevice):
    """A device that takes frames of a fixed length which begin with `header` and whose last byte checks the others.

    A damaged frame costs one byte: the search for a header goes on behind it.
    """

    def __init__(self, world: TableWorld, timing: SerialTiming, *, header: bytes, length: int) -> None:
        super().__init__(world, timing, terminators=b"", longest=length)
        self._header = header
        self._length = length

    def message_size(self, data: bytes | bytearray) -> int:
        """Return the length of the first frame in `data`, or of what can be none; 0 while a frame is incomplete."""
        begins = data.find(self._header[:1])
        if begins:
            return begins if begins > 0 else len(data)
        if len(data) < self._length:
            return 0
        return self._length if self._intact(bytes(data[: self._length])) else 1

    def _take(self, byte: int) -> None:
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
        """Tell whether the check of a frame of the right length and header holds."""
        raise NotImplementedError


class StatusStream:
    """Status that a table sends by itself every `period_s`."""

    def __init__(self, clock: Clock, period_s: float) -> None:
        self._clock = clock
        self._period_s = period_s
        self.due_s = clock.now() + period_s

    def due(self, make: Callable[[], bytes]) -> bytes | None:
        """Return the message that is due now, if one is; of several that were slept through only the last."""
        now = self._clock.now()
        if now < self.due_s:
            return None
        self.due_s = (math.floor(now / self._period_s + 1e-9) + 1) * self._period_s
        return make()
