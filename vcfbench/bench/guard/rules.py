"""Base of the guards."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol, TypeVar

from vcfbench.bench.guard.message import Unreadable, header_pattern, read_message

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from vcfbench.bench.description import BenchDescription
    from vcfbench.bench.guard.message import MessagePart

_Rule = TypeVar("_Rule")
_State = TypeVar("_State")

Ask = Callable[[str], str]
"""Puts a question to the instrument and returns its answer."""


class BeyondLimit(Exception):
    """The message would leave a limit of the bench; the words say which."""


class Rules(Protocol):
    """The rules of one kind of instrument."""

    def judge(self, message: str, ask: Ask) -> None:
        """Raise BeyondLimit or Unreadable when `message` may not be sent."""
        ...


class NoRules:
    """The rules of an instrument that only listens: there are none."""

    def judge(self, message: str, ask: Ask) -> None:
        """Let everything pass."""


def no_rules(description: BenchDescription) -> NoRules:
    """Return the rules of an instrument that only listens."""
    del description
    return NoRules()


class OnlyQuestions:
    """The rules of an instrument whose language is not known here: questions, self-tests excepted."""

    def __init__(self, model: str) -> None:
        self._model = model

    def judge(self, message: str, ask: Ask) -> None:
        """Raise Unreadable unless everything in `message` asks."""
        del ask
        for part in read_message(message):
            refuse_self_test(part)
            if not part.query:
                raise Unreadable(f"the commands of {self._model} are not known here, only questions pass")


def at_most(what: str, value: float, limit: float, unit: str) -> None:
    """Raise BeyondLimit for a magnitude above `limit`; the last digit of a sum is forgiven."""
    if not abs(value) <= limit * (1.0 + 1e-9):
        raise BeyondLimit(f"{what} {value:g} {unit} is beyond the bench's limit of {limit:g} {unit}")


def is_one_of(part: MessagePart, spellings: Iterable[str]) -> bool:
    """Tell whether the header of `part` is one of those that are printed as `spellings`."""
    return any(header_pattern(each).fullmatch(part.path) for each in spellings)


def rule_of(rules: Mapping[str, _Rule], part: MessagePart) -> _Rule:
    """Return the rule for the header of `part`, of `rules` by header as printed; raises Unreadable."""
    for spelling, rule in rules.items():
        if header_pattern(spelling).fullmatch(part.path):
            return rule
    raise Unreadable(f"{part.path} is not known to set nothing")


def acted_out(
    message: str,
    ask: Ask,
    asked: Callable[[Ask], _State],
    rule_for: Callable[[MessagePart], Callable[[_State, MessagePart], None]],
    passes: Callable[[MessagePart], bool],
) -> Iterator[tuple[_State, Callable[[_State, MessagePart], None]]]:
    """Let each command of a message act on the instrument's state; yield the state after each, and its rule.

    Args:
        message: what may be sent.
        ask: puts questions to the instrument.
        asked: returns what the instrument is set to; called once, when the first command needs it.
        rule_for: returns what a command does to it; raises Unreadable.
        passes: whether a command needs no look at anything.

    Raises:
        Beyond, Unreadable: a command may not be sent.
    """
    state: _State | None = None
    for part in read_message(message):
        refuse_self_test(part)
        if part.query or passes(part):
            continue
        rule = rule_for(part)
        state = state or asked(ask)
        rule(state, part)
        yield state, rule


def refuse_self_test(part: MessagePart) -> None:
    """Refuse ``*TST?``: the outputs' levels during it are not in the manuals at hand (unverified)."""
    if part.query and part.path == "*TST":
        raise Unreadable("what the outputs do in a self-test is not known")
