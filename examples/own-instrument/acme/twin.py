"""The simulated ACME M1, written from the same manual and not from its driver."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from simrack.scpi import (
    COMMON_COMMANDS,
    GPIB,
    Command,
    CommandTable,
    Dialect,
    Limits,
    Number,
    ScpiEngine,
    ScpiTwin,
    real,
)

if TYPE_CHECKING:
    from numpy.random import Generator
    from simrack.leads import Leads

__all__ = ["M1Errors", "SimulatedM1"]


@dataclass(frozen=True, slots=True)
class M1Errors:
    """What a specimen has of its own; p. 30 promises 0.01 % of the reading."""

    gain_error: float

    @classmethod
    def none(cls) -> M1Errors:
        """Return an ideal specimen."""
        return cls(0.0)

    @classmethod
    def drawn(cls, random: Generator) -> M1Errors:
        """Return one of those that are sold."""
        return cls(random.uniform(-1e-4, 1e-4))


class SimulatedM1(ScpiTwin):
    """The meter at the end of its leads, which see a node of the gyroscope's PCB."""

    errors_class: ClassVar[type] = M1Errors

    def __init__(self, world: Leads, *, errors: M1Errors, node: str) -> None:
        self._world = world
        self._errors = errors
        self._node = node
        self.engine = ScpiEngine(self, _TABLE, world.clock, dialect=Dialect(), interface=GPIB)
        self.reset()

    def identity(self) -> str:
        """Return the answer to ``*IDN?`` (p. 5)."""
        return "ACME,M1,0042,1.0"

    def reset(self) -> None:
        """Take the settings of ``*RST`` (p. 6)."""
        self.range_v = 100.0

    def set_range(self, range_v: float) -> None:
        """Select a range (p. 9)."""
        self.range_v = range_v

    def reading_v(self) -> float:
        """Return a reading; 9.9E37 is an overload (p. 11)."""
        volts = self._world.value_v(self._node) * (1.0 + self._errors.gain_error)
        return volts if abs(volts) <= 1.2 * self.range_v else 9.9e37


_TABLE = CommandTable(
    *COMMON_COMMANDS,
    Command(
        "RANGE",
        (Number(unit="V", limits=Limits(0.0, 100.0, 100.0)),),
        do=SimulatedM1.set_range,
        query=lambda meter: meter.range_v,
        reply=real(8),
    ),
    Command("MEASURE", query=SimulatedM1.reading_v, reply=real(8), query_takes_s=0.2),
)
