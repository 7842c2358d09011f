"""Which guard stands before which instrument, and what it says when it refuses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from vcfbench.bench.guard.generator import GeneratorRules
from vcfbench.bench.guard.message import Unreadable
from vcfbench.bench.guard.meter import MeterRules
from vcfbench.bench.guard.rules import Ask, Beyond, NoRules, OnlyQuestions
from vcfbench.bench.guard.supply import SupplyRules
from vcfbench.bench.guard.table import table_rules
from vcfbench.errors import LimitError

if TYPE_CHECKING:
    from collections.abc import Callable

    from vcfbench.bench.description import BenchDescription
    from vcfbench.bench.guard.rules import Rules

__all__ = ["Ask", "Guard", "guard_of"]


class Guard(Protocol):
    """What is asked before a message is sent."""

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
        except Beyond as refusal:
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
    known = role == "rate_table" or part.model in _LANGUAGES
    return RoleGuard(role, part.resource, _RULES[role](description) if known else OnlyQuestions(part.model))


_LANGUAGES = ("E3631A", "33220A", "34401A", "DSO7104B")


_RULES: dict[str, Callable[[BenchDescription], Rules]] = {
    "power": lambda bench: SupplyRules(bench.limits, bench.wiring.rails),
    "rate_source": lambda bench: GeneratorRules(bench.limits.max_v_vc_v),
    "vibration_source": lambda bench: GeneratorRules(bench.limits.max_v_vc_v),
    "multimeter": lambda _bench: MeterRules(),
    "oscilloscope": lambda _bench: NoRules(),
    "rate_table": lambda bench: table_rules(bench.rate_table, bench.limits),
}
