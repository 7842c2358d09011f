"""The trigger system of the Truevolt series: readings go to a memory that forgets the oldest (guide p. 204, 306)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from simrack.instruments.hp34401a.trigger import TriggerSequence, TriggerSystem


class RingTriggerSystem(TriggerSystem):
    """Keeps the newest readings; `overflowed` is called whenever one is lost."""

    def __init__(self, *around: Any, capacity: int, overflowed: Callable[[], None]) -> None:
        self._overflowed = overflowed
        super().__init__(*around)
        self.capacity = capacity

    def preset(self) -> None:
        """Take the settings of *RST, CONFigure and MEASure; the trigger's slope is negative (p. 306, example)."""
        super().preset()
        self.slope = "NEG"
        self.last: float | None = None
        self.paced_by, self.interval_s, self._begun_s = "IMM", 1.0, 0.0

    def _start_reading(self, sequence: TriggerSequence) -> None:
        """Begin a reading; by the timer, an interval after the beginning of the one before."""
        if self.paced_by == "TIM" and sequence.samples < self.sample_count:
            sequence.armed_s = self._begun_s + self.interval_s
        super()._start_reading(sequence)
        self._begun_s = max(self._clock.now(), sequence.armed_s)

    def keep(self, sequence: TriggerSequence, value: float) -> None:
        """Store a reading; the oldest gives way without an error."""
        del sequence
        self.last = value
        self.memory.append(value)
        if len(self.memory) > self.capacity:
            del self.memory[0]
            self._overflowed()

    def take(self, most: int) -> list[float]:
        """Return and forget the oldest readings."""
        taken, self.memory = self.memory[:most], self.memory[most:]
        return taken
