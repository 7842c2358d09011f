"""The trigger system of the 34401A: idle, waiting, measuring; where readings go (p. 71-85, 115-117, 126)."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator

from msgspec import Struct, field

from simrack.clock import Clock
from simrack.instruments.hp34401a.inputs import MeterReading
from simrack.scpi import ScpiError

MEMORY = 512
"""Readings that INITiate can store (p. 84)."""
_ARMING_S = 0.02
"""From leaving idle to waiting for the trigger (p. 79: about 20 ms)."""


class TriggerSequence(Struct):
    """A running measurement: the rest of it and its readings so far.

    Args:
        triggers: triggers still to come, infinity for ever. samples: readings left of the present trigger.
        stored: whether readings go to memory (INITiate) or straight out (READ?).
        streamed: more than can be held, so readings go out while others are taken.
    """

    triggers: float
    samples: int
    stored: bool
    streamed: bool
    armed_s: float
    readings: deque[float] = field(default_factory=deque)
    current: MeterReading | None = None
    triggered: bool = False
    stalled: bool = False


class TriggerSystem:
    """Takes triggers and has readings begun.

    Args:
        clock: bench time.
        begin: begins a reading at or after an instant.
        finished: gives a finished reading its math and status, and returns what becomes of it.
        work_out: has what takes this computer long worked out, at once or in slices.
        capacity: how many readings can be stored.
    """

    def __init__(
        self,
        clock: Clock,
        begin: Callable[[float], MeterReading],
        finished: Callable[[float], float],
        work_out: Callable[[Iterator[object]], None],
        capacity: int = MEMORY,
    ) -> None:
        self.capacity = capacity
        self._clock = clock
        self._begin = begin
        self._finished = finished
        self._work_out = work_out
        self.preset()

    def preset(self) -> None:
        """Take the settings that *RST, CONFigure and MEASure share (p. 112); the memory is cleared."""
        self.sequence: TriggerSequence | None = None
        self.memory: list[float] = []
        self.source = "IMM"
        self.delay_s = 0.0
        self.delay_auto = True
        self.sample_count = 1
        self.trigger_count = 1.0
        self.feed = "CALC"
        self._external_pending = False

    @property
    def readings_to_come(self) -> float:
        """Number of readings of a sequence, infinity for ever."""
        return self.sample_count * self.trigger_count

    def start(self, *, stored: bool, arming_s: float = _ARMING_S) -> TriggerSequence:
        """Leave idle; -213 when measuring already. Readings of READ? that the memory would not hold go out at once."""
        if self.sequence is not None:
            raise ScpiError(-213)
        if stored:
            self.memory = []
        streamed = not stored and self.readings_to_come > self.capacity
        armed = self._clock.now() + arming_s
        self.sequence = TriggerSequence(self.trigger_count, self.sample_count, stored, streamed, armed)
        if self.source == "IMM":
            self.fire()
        elif self._external_pending:
            self._external_pending = False
            self.fire()
        return self.sequence

    def abort(self) -> None:
        """Go idle (p. 116)."""
        self.sequence = None
        self._external_pending = False

    def waiting(self) -> bool:
        """True if a trigger would be taken."""
        return self.sequence is not None and not self.sequence.triggered

    def fire(self) -> None:
        """Take a trigger."""
        sequence = self.sequence
        if sequence is None:
            return
        sequence.triggered = True
        sequence.samples = self.sample_count
        self._start_reading(sequence)

    def external(self) -> None:
        """The external trigger input: taken in wait-for-trigger, one is kept while measuring, none in idle."""
        if self.source != "EXT" or self.sequence is None:
            return
        if not self.waiting():
            self._external_pending = True
        elif self._clock.now() >= self.sequence.armed_s:
            self.fire()

    def service(self) -> None:
        """Finish readings that are due and start the next ones."""
        sequence = self.sequence
        while sequence is not None and sequence.current is not None and sequence.current.end_s <= self._clock.now():
            self._finish_reading(sequence)
            sequence = self.sequence

    def streams(self) -> bool:
        """True if a reading can go out while others are taken."""
        return self.sequence is not None and self.sequence.streamed and len(self.sequence.readings) > 1

    def take_streamed(self) -> list[float]:
        """Return readings that can go out while others are taken; the last stays until there is another."""
        sequence = self.sequence
        if sequence is None or not sequence.streamed:
            return []
        taken = [sequence.readings.popleft() for _ in range(len(sequence.readings) - 1)]
        if sequence.stalled:
            self._start_reading(sequence)
        return taken

    def _start_reading(self, sequence: TriggerSequence) -> None:
        """Begin a reading; with nobody to read those that wait, the meter waits too (p. 84, unverified)."""
        sequence.stalled = sequence.streamed and len(sequence.readings) >= self.capacity
        if not sequence.stalled:
            sequence.current = self._begin(max(self._clock.now(), sequence.armed_s))

    def _finish_reading(self, sequence: TriggerSequence) -> None:
        reading = sequence.current
        assert reading is not None  # noqa: S101  (service looked)
        if reading.labour is None:
            self._take(sequence, reading.value())
            return
        sequence.current = None

        def labour() -> Iterator[None]:
            assert reading.labour is not None  # noqa: S101  (for the type checker)
            outcome = yield from reading.labour()
            if self.sequence is sequence:
                self._take(sequence, outcome)

        self._work_out(labour())

    def _take(self, sequence: TriggerSequence, outcome: float | MeterReading) -> None:
        """Keep the reading, and begin the next."""
        if isinstance(outcome, MeterReading):
            sequence.current = outcome
            return
        sequence.current = None
        self.keep(sequence, self._finished(outcome))
        sequence.samples -= 1
        if sequence.samples > 0:
            self._start_reading(sequence)
        else:
            sequence.triggers -= 1
            sequence.triggered = False
            if sequence.triggers <= 0:
                self.sequence = None
            elif self.source == "IMM" or self._external_pending:
                self._external_pending = False
                self.fire()

    def keep(self, sequence: TriggerSequence, value: float) -> None:
        """Put a reading where it belongs."""
        if not sequence.stored:
            sequence.readings.append(value)
        elif self.feed:
            self.memory.append(value)
