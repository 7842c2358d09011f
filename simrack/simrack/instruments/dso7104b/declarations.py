"""Declarations of the DSO7104B's commands: settings kept by name, sources, numbers in its NR3."""

from __future__ import annotations

from collections.abc import Callable

from simrack.instruments.dso7104b.instrument import SimulatedDso7104B
from simrack.scpi import Choice, Command, Integer, Limits, Number, Register, ScpiError, signed_integer
from simrack.scpi.lexer import Token

CHANNEL = Choice(("CHANnel<1-4>",))
VOLTS = Number(unit="V")
SECONDS = Number(unit="S")


class SourceParameter(Choice, frozen=True):
    """A channel or the math trace, which has two names and answers to FUNC (6000 series programmer's guide)."""

    words: tuple[str, ...] = ("CHANnel<1-4>", "FUNCtion", "MATH")

    def parse(self, token: Token) -> str:
        """Return `CHAN1` or `FUNC`."""
        word = Choice.parse(self, token)
        return "FUNC" if word == "MATH" else word


SOURCE = SourceParameter()
OPTIONAL_SOURCE = SourceParameter(required=False)


def registers(pattern: str, read_event: str, of: Callable[[SimulatedDso7104B], Register]) -> tuple[Command, Command]:
    """Declare the enable mask and the event query of a register."""

    def write(model: SimulatedDso7104B, mask: int) -> None:
        of(model).enable = mask

    return (
        Command(
            pattern,
            (Integer(limits=Limits(0, 65535)),),
            do=write,
            query=lambda model: of(model).enable,
            reply=signed_integer,
            reads=True,
        ),
        Command(read_event, query=lambda model: of(model).read_event(), reply=signed_integer),
    )


def learned(pattern: str, shape: str) -> Command:
    """Declare the query of a subsystem's settings, `shape` with fields of :class:`.settings.ScopeSettings`."""
    return Command(pattern, query=lambda model: shape.format(model.state), reads=True)


def clipped(model: SimulatedDso7104B, value: float, low: float, high: float) -> float:
    """Clip to the limits, with -222."""
    if low <= value <= high:
        return value
    model.engine.report(ScpiError(-222))
    return min(max(value, low), high)


def nothing(_: SimulatedDso7104B, *arguments: object) -> None:
    """Do nothing: the effect cannot be seen from outside."""
    del arguments
