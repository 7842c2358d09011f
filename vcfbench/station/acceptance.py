"""Acceptance of results: each limit of ``[acceptance]`` against its result."""

import math
from collections.abc import Sequence
from typing import Any, Final, Literal, Self

from msgspec import Struct

from vcfbench.records.schema import Point, pooled_std_v
from vcfbench.records.stated import stated
from vcfbench.station.settings import Limit
from vcfbench.values.kinds import KINDS, Named, limit_words
from vcfbench.values.value import Form, Unstated, Value
from vcfbench.values.verdict import Word, judge

INCOMPLETE: Final = " with an incomplete U95"
"""Words behind a verdict on a value whose U95, or E_n, lacks a contribution: it may be another with all of them."""


class Verdict(Struct, frozen=True):
    """One limit and its result; `value` is None for a bound or a missing value, which does not pass.

    `word` was found by `rule`; it is ``not measured`` where the procedure does not measure this at all, as K_Vc in a
    turntable run. `u95` is the value's expanded uncertainty; of what is stated in another `form` `ends` are those of
    what holds with 95 %, None where there is none. U95, or that in an E_n, is incomplete without what is `missing`.

    >>> limit = run.verdict.limits[0]
    >>> limit.word, limit.low, limit.high
    ('pass', -0.0127, -0.0124)
    """

    key: str
    value: float | None
    low: float
    high: float
    word: Word | Literal["not measured"] = "not measured"
    rule: str = ""
    u95: float | None = None
    missing: tuple[str, ...] = ()
    form: Form = "plus-minus"
    ends: tuple[float | None, float | None] | None = None

    @classmethod
    def of(cls, limit: Limit, value: Value | None) -> Self:
        """Judge one value; None is one that could not be found."""
        found = judge(value, limit.low, limit.high, guarded=limit.guarded)
        of_limit = (limit.low, limit.high, found.word, found.rule.value)
        if value is None:
            return cls(limit.key, None, *of_limit)
        least, most = (each if math.isfinite(each) else None for each in value.ends)
        ends = None if value.form == "plus-minus" else (least, most)
        return cls(limit.key, value.value, *of_limit, value.u95, tuple(value.missing), value.form, ends)

    @property
    def found(self) -> Value | None:
        """The judged value, or None."""
        if self.value is None and self.ends is None:
            return None
        low, high = self.ends or (None, None)
        return Value(self.key, self.value, u95=self.u95, form=self.form, low=low, high=high)

    @property
    def measured(self) -> bool:
        """Return True if the procedure measures this."""
        return self.word != "not measured"

    @property
    def conditional(self) -> str:
        """Return ``conditional pass`` or ``conditional fail`` of a marginal value (ILAC-G8), else ""."""
        if self.word != "marginal" or self.value is None:
            return ""
        return f"conditional {'pass' if self.low <= self.value <= self.high else 'fail'}"

    @property
    def stated(self) -> str:
        """Return the verdict for a certificate: word or condition, the rule, and a mark if U95 is incomplete."""
        rule = f" ({self.rule})" if self.rule else ""
        return f"{self.conditional or self.word}{INCOMPLETE if self.missing else ''}{rule}"

    @property
    def said(self) -> str:
        """Return the word for people, its condition, and a mark if U95 is incomplete."""
        condition = f" ({self.conditional})" if self.conditional else ""
        return self.word.upper() + condition + (INCOMPLETE if self.missing else "")

    def as_json(self) -> dict[str, Any]:
        """Return limit, value, verdict and rule, with the interval of the value."""
        members = {"key": self.key, "value": self.value, "low": self.low, "high": self.high, "verdict": self.word}
        more: dict[str, Any] = {"rule": self.rule, "u95": self.u95, "missing": [*self.missing]}
        if self.ends is not None:
            more |= {"form": self.form, "ends": [*self.ends]}
        return members | {name: each for name, each in more.items() if each not in (None, "", [])}


class Acceptance(Struct, frozen=True):
    """The verdict on a run: it passes if at least one limit was judged and none failed.

    >>> run.verdict.passed, run.verdict.word
    (True, 'pass')
    """

    limits: tuple[Verdict, ...]
    values: tuple[Value, ...] = ()
    """The values that were judged: several kinds have one key, so a limit does not say of which it is."""

    def __eq__(self, other: object) -> bool:
        """Return True if the limits are the same: values that are read back have less to tell."""
        return isinstance(other, Acceptance) and self.limits == other.limits

    def __hash__(self) -> int:
        return hash(self.limits)

    def judged(self, limit: Verdict) -> Value | None:
        """Return the value that `limit` was held against, as far as it is known, or None."""
        return next((each for each in self.values if limit_key(each) == limit.key), limit.found)

    def named(self, limit: Verdict) -> Named:
        """Return the words of the value that `limit` was held against, and its unit in print."""
        return next((each.named for each in self.values if limit_key(each) == limit.key), limit_words(limit.key))

    @property
    def passed(self) -> bool:
        """Return True if no limit failed, and none is marginal."""
        return self.word == "pass"

    @property
    def word(self) -> Word:
        """Return ``fail`` when a limit failed, else ``marginal`` when one is, else ``pass``."""
        words = {limit.word for limit in self.limits}
        return "fail" if "fail" in words else "marginal" if "marginal" in words else "pass"

    @property
    def conditional(self) -> str:
        """Return the worst condition of a marginal verdict; a bound that leaves both has that of a failure."""
        marginal = [limit for limit in self.limits if limit.word == "marginal"]
        if self.word != "marginal":
            return ""
        passes = all(limit.conditional == "conditional pass" for limit in marginal)
        return f"conditional {'pass' if passes else 'fail'}"

    @property
    def said(self) -> str:
        """Return the word for people, and the parts that U95 lacks."""
        missing = dict.fromkeys(name for limit in self.limits for name in limit.missing)
        return self.word.upper() + (f"{INCOMPLETE}, without {', '.join(missing)}" if missing else "")

    def as_json(self) -> dict[str, Any]:
        """Return the verdict and each limit's."""
        return {"verdict": self.word, "limits": [limit.as_json() for limit in self.limits]}


def limit_key(value: Value | Unstated) -> str:
    """Return the key in ``[acceptance]`` of the limit that a value is held against: that of its kind, or its name."""
    return (KINDS[value.kind].limit if value.kind else "") or value.name


def judged(limits: Sequence[Limit], results: object, points: Sequence[Point]) -> Acceptance | None:
    """Judge the values of `results` and the noise of `points`; None when no limit is for this procedure.

    A limit is for the first value whose kind has its key, or whose name is its key.
    """
    if not limits:
        return None
    found: dict[str, Value | None] = {}
    if any(point.n > 1 for point in points):
        noise = Value("reading_noise_v", pooled_std_v(points), "V", kind="reading_noise_v")
        found["reading_noise_v"] = noise
    for each in stated(results):
        found.setdefault(limit_key(each), None if isinstance(each, Unstated) else each)
    verdicts = tuple(
        Verdict.of(limit, found[limit.key]) if limit.key in found else Verdict(limit.key, None, limit.low, limit.high)
        for limit in limits
    )
    values = tuple(each for each in (found.get(limit.key) for limit in limits) if each is not None)
    return Acceptance(verdicts, values) if any(verdict.measured for verdict in verdicts) else None
