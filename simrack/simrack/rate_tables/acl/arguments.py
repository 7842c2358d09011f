"""The arguments of the ACUTROL3000's commands: counted, read and checked.

Every function raises :class:`Refusal` for what the controller does not take.
"""

from __future__ import annotations

from collections.abc import Callable

from simrack.rate_tables.acl.refusal import OUT_OF_RANGE, Refusal

Arguments = tuple[str, ...]
Action = Callable[[Arguments], None]
Query = Callable[[Arguments], str]

MODES = ("Position", "Rate", "Arate", "Synthesis", "Track", "Abort", "Off")
"""In the order of TM-8004-C 4.7; their place is taken as the code in A1STATE bits 0-3 (inferred)."""


def counted(arguments: Arguments, count: int) -> Arguments:
    """Return the arguments, which must be `count`."""
    if len(arguments) != count:
        raise Refusal(OUT_OF_RANGE)
    return arguments


def one(arguments: Arguments) -> str:
    """Return the only argument."""
    return counted(arguments, 1)[0]


def check_axis(arguments: Arguments, *, most: int = 1, everything: bool = True) -> None:
    """Refuse an axis that does not exist; ALL is for commands only."""
    if not 1 <= len(arguments) <= most:
        raise Refusal(OUT_OF_RANGE)
    if arguments[0] != "1" and not (everything and arguments[0].upper() == "ALL"):
        raise Refusal(OUT_OF_RANGE)


def axis_values(arguments: Arguments, count: int) -> tuple[float, ...]:
    """Return the `count` numbers that follow the axis."""
    axis, *values = counted(arguments, count + 1)
    check_axis((axis,))
    return tuple(number(value) for value in values)


def number(text: str) -> float:
    """Return a number: NRf with blanks allowed around the exponent, no suffix, no infinity (TM-8004-C 2.6.1.2)."""
    compact = "".join(text.split())
    if not compact or not set(compact) <= set("+-.0123456789eE"):
        raise Refusal(OUT_OF_RANGE)
    try:
        value = float(compact)
    except ValueError:
        raise Refusal(OUT_OF_RANGE) from None
    if abs(value) > 1e30:
        raise Refusal(OUT_OF_RANGE)
    return value


def integer(text: str, low: int, high: int) -> int:
    """Return a whole number from `low` to `high`."""
    value = number(text)
    if value != int(value) or not low <= value <= high:
        raise Refusal(OUT_OF_RANGE)
    return int(value)


def check_within(value: float, high: float) -> None:
    """Refuse what is negative or above `high`."""
    # zero is taken, and inhibits every change of motion: the manual only says "should never be commanded"
    if not 0.0 <= value <= high:
        raise Refusal(OUT_OF_RANGE)


def word(text: str, words: tuple[str, ...]) -> str:
    """Return the first of `words` that begins with `text`."""
    found = next((each for each in words if text and each.upper().startswith(text.upper())), None)
    if found is None:
        raise Refusal(OUT_OF_RANGE)
    return found


def switch(arguments: Arguments) -> bool:
    """Return whether the only argument is ON, and not OFF."""
    text = one(arguments).upper()
    if text not in {"ON", "OFF"}:
        raise Refusal(OUT_OF_RANGE)
    return text == "ON"


def message_count(text: str) -> int:
    """Return how many messages are wanted: a number, or ALL."""
    return 64 if text.upper() == "ALL" else integer(text, 1, 64)
