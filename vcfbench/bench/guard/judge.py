"""Guards of the instruments, and their words when they refuse."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from vcfbench.bench.guard.message import Unreadable
from vcfbench.bench.guard.rules import Ask, BeyondLimit, OnlyQuestions
from vcfbench.bench.guard.table import table_rules
from vcfbench.errors import LimitError
from vcfbench.models import find_model, resolve

if TYPE_CHECKING:
    from vcfbench.bench.description import BenchDescription
    from vcfbench.bench.guard.rules import Rules

__all__ = ["Ask", "Guard", "guard_of"]


class Guard(Protocol):
    """A judge of messages before they are sent."""

    def judge(self, message: str, ask: Ask) -> None:
        """Raise LimitError when `message` may not be sent; `ask` puts questions to the instrument."""
        ...


class RoleGuard:
    """The guard of one instrument of a bench."""

    def __init__(self, role: str, resource: str, rules: Rules) -> None:
        self._role = role
        self._resource = resource
        self._rules = rules

    def judge(self, message: str, ask: Ask) -> None:
        """Raise LimitError when `message` may not be sent."""
        try:
            self._rules.judge(message, ask)
        except BeyondLimit as refusal:
            raise self._refused(str(refusal), message) from None
        except Unreadable as refusal:
            words = f"it could move or energise something, and cannot be judged: {refusal}"
            raise self._refused(words, message) from None

    def _refused(self, words: str, message: str) -> LimitError:
        return LimitError(
            words, instrument=self._role, resource=self._resource, command=message, hint="nothing was sent"
        )


def guard_of(role: str, description: BenchDescription) -> Guard:
    """Return the guard of the instrument of `role`, within the limits of the bench file."""
    part = getattr(description, role)
    rules = table_rules(part, description.limits) if role == "rate_table" else _rules(part, description)
    return RoleGuard(role, part.resource, rules)


def _rules(part: Any, description: BenchDescription) -> Rules:
    """Return the rules of the words that an instrument speaks; of words that nobody has rules for, only questions."""
    row = find_model(part.like or part.model)
    if row is None or row.console is None:
        return OnlyQuestions(part.model)
    rules: Rules = resolve(row.console)(description)
    return rules
