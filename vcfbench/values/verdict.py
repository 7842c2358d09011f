"""Agreement of results with each other and with a limit: E_n (ISO 13528) and guard bands (JCGM 106, ILAC-G8)."""

import math
from enum import Enum
from typing import Final, Literal

from msgspec import Struct

from vcfbench.errors import ConfigError
from vcfbench.values.kinds import KINDS
from vcfbench.values.value import Value

Word = Literal["pass", "marginal", "fail"]


class Rule(Enum):
    """Decision rule of a verdict, in the words printed with it."""

    SIMPLE = "simple acceptance"
    NO_U95 = "no U95: simple acceptance"
    GUARDED = "guarded, w = U95"
    INTERVAL = "guarded by its 95 % interval"
    BOUND = "all that its bound leaves"
    ITSELF = "as it stands"
    NOT_FOUND = "not found"


RULES: Final = {
    Rule.SIMPLE: "a value within its limits passes, its uncertainty set aside (ILAC-G8, w = 0)",
    Rule.NO_U95: "a value without U95 has no guard band: it passes within its limits (ILAC-G8, w = 0)",
    Rule.GUARDED: "a value nearer to a limit than its U95 is marginal (ILAC-G8, w = U95)",
    Rule.INTERVAL: "a value whose 95 % interval holds a limit is marginal (ILAC-G8, w to that side)",
    Rule.BOUND: "it passes where all that the bound leaves is within the limits, fails where none of it is",
    Rule.ITSELF: "a count, or an E_n, which has its U95 in it, is held against its limits",
    Rule.NOT_FOUND: "a value that could not be found keeps no limit",
}
"""What each rule means."""


class Judgement(Struct, frozen=True):
    """A verdict and the rule that it was found by.

    `inside` says of a marginal one whether the value itself is within the limits, None where there is only a bound.
    """

    word: Word
    rule: Rule
    inside: bool | None = None


def judge(value: Value | None, low: float, high: float, *, guarded: bool) -> Judgement:
    """Judge a value against its limits, both included; None is one that could not be found.

    Guarded, it passes where all that is stated of it with 95 % is within them, fails where none of it is, and else is
    marginal: with 95 % a value +- U95 passes that conforms with at least 97.5 %. Otherwise the value alone is judged. A
    bound of which nothing was found is judged by all that it leaves either way.

    Raises:
        ConfigError: a lower limit above the upper one.
    """
    if not low <= high:
        raise ConfigError(f"no verdict with limits {low:g} to {high:g}")
    if value is None:
        return Judgement("fail", Rule.NOT_FOUND)
    found = value.value
    inside = None if found is None else low <= found <= high
    if value.kind and KINDS[value.kind].stands_alone:
        rule = Rule.ITSELF
    elif value.form == "plus-minus":
        rule = Rule.NO_U95 if value.u95 is None else Rule.GUARDED if guarded else Rule.SIMPLE
    elif found is None or guarded:
        rule = Rule.INTERVAL if value.form == "interval" else Rule.BOUND
    else:
        rule = Rule.SIMPLE
    if rule in {Rule.ITSELF, Rule.NO_U95, Rule.SIMPLE}:
        return Judgement("pass" if inside else "fail", rule)
    least, most = value.ends
    if rule is Rule.GUARDED and found is not None and value.u95 is not None:
        # by distances from the limits, as documented: the ends are rounded once more
        outside = found < low - value.u95 or found > high + value.u95
        within = low + value.u95 <= found <= high - value.u95
    else:
        outside, within = most < low or least > high, low <= least and most <= high
    word: Word = "fail" if outside else "pass" if within else "marginal"
    return Judgement(word, rule, inside if word == "marginal" else None)


def e_n(first: float, expanded_u_first: float, second: float, expanded_u_second: float) -> float:
    """Return |second - first| over the root of the sum of the squared expanded uncertainties; above 1 they disagree.

    Only for independent results: the difference of those that share instruments is a result of their budget.

    Raises:
        ConfigError: neither has an uncertainty.
    """
    difference, expanded_u = second - first, math.hypot(expanded_u_first, expanded_u_second)
    if not (expanded_u > 0.0 and math.isfinite(expanded_u) and math.isfinite(difference)):
        raise ConfigError(f"E_n of a difference of {difference:g} needs a positive uncertainty, got {expanded_u:g}")
    return abs(difference) / expanded_u
