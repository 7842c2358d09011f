"""A check of the validation: its question, the answer that is right, and the answer that came."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Literal

from msgspec import Struct

from vcfbench.clock import WallClock
from vcfbench.errors import BenchError

if TYPE_CHECKING:
    from collections.abc import Callable

Verdict = Literal["PASS", "FAIL", "NOT CHECKED"]


class Found(Struct, frozen=True):
    """Answer of a check and the right answer; `passed` None: the check was impossible, and `came` has the reason."""

    expected: str
    came: str
    passed: bool | None


class Check(Struct, frozen=True):
    """A question to the program; `source` says where its right answer comes from."""

    name: str
    question: str
    source: str
    answer: Callable[[], Found]


def check(name: str, question: str, source: str) -> Callable[[Callable[[], Found]], Check]:
    """Make a function, which gives the answer, a check."""
    return partial(Check, name, question, source)


class Checked(Struct, frozen=True):
    """A check that was made."""

    area: str
    name: str
    question: str
    source: str
    expected: str
    came: str
    verdict: Verdict
    took_s: float


def made(area: str, check: Check) -> Checked:
    """Make a check; an exception is its answer and a failure."""
    clock = WallClock()
    begun_s = clock.now()
    try:
        found = check.answer()
    except (ArithmeticError, LookupError, OSError, TypeError, ValueError, AttributeError, BenchError) as error:
        found = Found("an answer", f"{type(error).__name__}: {error}", passed=False)
    verdict: Verdict = "NOT CHECKED" if found.passed is None else "PASS" if found.passed else "FAIL"
    return Checked(
        *(area, check.name, check.question, check.source, found.expected, found.came), *(verdict, clock.now() - begun_s)
    )


def same(expected: object, came: object) -> Found:
    """Return True if both read alike."""
    return Found(str(expected), str(came), passed=str(expected) == str(came))
