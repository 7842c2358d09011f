"""Math of the 34401A: null, dB, dBm, min-max, limit test (User's Guide p. 63-69, 124-128)."""

from __future__ import annotations

import math
from types import MappingProxyType

from msgspec import Struct

from simrack.handlers import Handlers
from simrack.scpi import INFINITY, ScpiError

OVERLOAD = INFINITY
"""What an overload reads as (p. 82)."""
MATH_RULES = MappingProxyType(
    {
        "NULL": ("VOLT", "VOLT:AC", "CURR", "CURR:AC", "RES", "FRES", "FREQ", "PER"),
        "AVER": ("VOLT", "VOLT:RAT", "VOLT:AC", "CURR", "CURR:AC", "RES", "FRES", "FREQ", "PER"),
        "LIM": ("VOLT", "VOLT:RAT", "VOLT:AC", "CURR", "CURR:AC", "RES", "FRES", "FREQ", "PER"),
        "DB": ("VOLT", "VOLT:AC"),
        "DBM": ("VOLT", "VOLT:AC"),
    }
)
"""Which functions each math operation goes with (p. 63)."""
_LIMIT_LOW = 1 << 11
_LIMIT_HIGH = 1 << 12


class MathResult(Struct, frozen=True):
    """A reading after math, QUEStionable bits of a failed limit, an error."""

    value: float
    limit_bits: int = 0
    error: ScpiError | None = None


class Math:
    """The math registers and the one operation that may be on."""

    _OPERATIONS = Handlers()

    def __init__(self) -> None:
        self.dbm_reference = 600.0
        self.reset()

    def reset(self) -> None:
        """Take the *RST state; the dBm reference is non-volatile."""
        self.operation = "NULL"
        self.on = False
        self.null_offset: float | None = None
        self.db_reference: float | None = None
        self.lower = 0.0
        self.upper = 0.0
        self._forget()

    def _forget(self) -> None:
        self._count = 0
        self._sum = 0.0
        self._minimum = 0.0
        self._maximum = 0.0

    def choose(self, operation: str) -> None:
        """Select an operation."""
        self.operation = operation
        if self.on:
            self.switch(on=True)

    def switch(self, *, on: bool) -> None:
        """Switch math; going on clears the registers that the first reading fills."""
        self.on = on
        if on and self.operation == "AVER":
            self._forget()
        elif on and self.operation == "NULL":
            self.null_offset = None
        elif on and self.operation == "DB":
            self.db_reference = None

    def minimum(self) -> float:
        """Return the lowest reading since min-max was enabled."""
        return self._minimum

    def maximum(self) -> float:
        """Return the highest reading."""
        return self._maximum

    def average(self) -> float:
        """Return the mean of the readings, 0 without one."""
        return self._sum / self._count if self._count else 0.0

    def count(self) -> int:
        """Return the number of readings that there were."""
        return self._count

    def apply(self, value: float) -> MathResult:
        """Return the reading `value` after math; an overload passes, and cannot become a reference (540)."""
        if abs(value) >= OVERLOAD:
            return self._overload(value)
        result: MathResult = getattr(self, self._OPERATIONS[self.operation])(value)
        return result

    def _overload(self, value: float) -> MathResult:
        needs_null = self.operation == "NULL" and self.null_offset is None
        if needs_null or (self.operation == "DB" and self.db_reference is None):
            self.on = False
            return MathResult(value, error=ScpiError(540))
        bits = (_LIMIT_HIGH if value > 0 else _LIMIT_LOW) if self.operation == "LIM" else 0
        return MathResult(value, bits)

    @_OPERATIONS.of("NULL")
    def _null(self, value: float) -> MathResult:
        if self.null_offset is None:
            self.null_offset = value
        return MathResult(value - self.null_offset)

    def _in_dbm(self, value: float) -> float:
        """Return the power; of 0 V, which has none, an overload (sibling's guide, 34461A)."""
        if value == 0.0:
            return -OVERLOAD
        return 20.0 * math.log10(abs(value)) - 10.0 * math.log10(self.dbm_reference * 1e-3)

    @_OPERATIONS.of("DBM")
    def _dbm(self, value: float) -> MathResult:
        return MathResult(self._in_dbm(value))

    @_OPERATIONS.of("DB")
    def _db(self, value: float) -> MathResult:
        level = self._in_dbm(value)
        if level == -OVERLOAD:
            return self._overload(level)
        if self.db_reference is None:
            self.db_reference = level
        return MathResult(level - self.db_reference)

    @_OPERATIONS.of("AVER")
    def _statistics(self, value: float) -> MathResult:
        self._minimum = value if not self._count else min(self._minimum, value)
        self._maximum = value if not self._count else max(self._maximum, value)
        self._count += 1
        self._sum += value
        return MathResult(value)

    @_OPERATIONS.of("LIM")
    def _limit(self, value: float) -> MathResult:
        low = _LIMIT_LOW if value < self.lower else 0
        return MathResult(value, low | (_LIMIT_HIGH if value > self.upper else 0))
