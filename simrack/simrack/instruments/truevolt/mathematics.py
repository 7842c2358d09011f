"""Null, scaling, averaging, statistics and limits of meters, which may all be on at once (guide, CALCulate, NULL)."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

from msgspec import Struct

_LOW, _HIGH = 1 << 11, 1 << 12
"""QUEStionable bits of a failed limit test."""


def scaled(reading: float, operation: str, gain: float, offset: float, reference: float) -> float:
    """Return a reading after an operation, by the words of any maker: m x + b, percent, reciprocal, dB, dBm, null."""
    square = reading * reading
    made: dict[str, Callable[[], float]] = {
        **dict.fromkeys(("SCAL", "MXB"), lambda: gain * reading + offset),
        **dict.fromkeys(("PCT", "PERC"), lambda: 100.0 * (reading - reference) / reference),
        "REC": lambda: 1.0 / reading,
        "DB": lambda: 10.0 * math.log10(square / reference**2),
        "DBM": lambda: 10.0 * math.log10(square / reference * 1e3),
        "NULL": lambda: reading - reference,
    }
    try:
        return made[operation]() if operation in made else reading
    except (ValueError, ZeroDivisionError):  # of nothing, or over nothing
        return math.nan


class Recent(Struct):
    """The latest readings, for a mean that moves with them."""

    readings: deque[float] = deque()

    def mean(self, reading: float, count: int) -> float:
        """Take a reading; return the mean of the last so many, which one forgets them all."""
        self.readings = deque((*self.readings, reading), maxlen=count)
        return math.fsum(self.readings) / len(self.readings)


class Null(Struct):
    """Null value, taken off every reading of a function; in automatic it is the first reading."""

    on: bool = False
    value: float = 0.0
    automatic: bool = True
    _wanted: bool = False

    def switch(self, *, on: bool) -> None:
        """Switch it; going on in automatic, the next reading becomes the value."""
        self.on = on
        self._wanted = on and self.automatic

    def set_value(self, value: float) -> None:
        """Take a value, which ends automatic."""
        self.value, self.automatic, self._wanted = value, False, False

    def apply(self, reading: float) -> float:
        """Return a reading without the null value."""
        if not self.on:
            return reading
        if self._wanted:
            self.value, self._wanted = reading, False
        return reading - self.value


class Statistics(Struct):
    """Running statistics over readings since they were cleared; not a number without any."""

    on: bool = False
    count: int = 0
    minimum: float = math.nan
    maximum: float = math.nan
    mean: float = math.nan
    _squares: float = 0.0

    def clear(self) -> None:
        """Forget all readings."""
        self.count, self._squares = 0, 0.0
        self.minimum = self.maximum = self.mean = math.nan

    def switch(self, *, on: bool) -> None:
        """Switch it; switching on clears it."""
        self.on = on
        if on:
            self.clear()

    def take(self, reading: float) -> None:
        """Take a reading (Welford's recurrence)."""
        self.count += 1
        before = 0.0 if self.count == 1 else self.mean
        self.mean = before + (reading - before) / self.count
        self._squares += (reading - before) * (reading - self.mean)
        self.minimum = reading if self.count == 1 else min(self.minimum, reading)
        self.maximum = reading if self.count == 1 else max(self.maximum, reading)

    def deviation(self) -> float:
        """Return the sample standard deviation, 0 of one reading."""
        return math.nan if self.count == 0 else math.sqrt(self._squares / max(self.count - 1, 1))

    def span(self) -> float:
        """Return the peak-to-peak value."""
        return self.maximum - self.minimum


class LimitTest(Struct):
    """Limits that readings are held against."""

    on: bool = False
    lower: float = 0.0
    upper: float = 0.0

    def bits(self, reading: float) -> int:
        """Return the QUEStionable bits of a reading."""
        if not self.on:
            return 0
        return (_LOW if reading < self.lower else 0) | (_HIGH if reading > self.upper else 0)
