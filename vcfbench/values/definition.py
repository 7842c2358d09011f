"""Definition of a value: what must agree before two values of one kind are compared, and under what they were found."""

import math
from collections.abc import Iterable
from typing import Final, Self

from msgspec import Struct

WITHIN: Final = 1e-3
"""Rates that differ by less, relative, are the same; and those by less than `WITHIN_DEG_S`."""
WITHIN_DEG_S: Final = 0.01


class Definition(Struct, frozen=True):
    """What a value is of, beside its kind: values of which it is not the same are of other measurands.

    `levels_deg_s` are the rates of a line, falling, each with its share of the windows. `choices` are settings of the
    procedure that define the value, by name, as they are printed.
    """

    levels_deg_s: tuple[tuple[float, float], ...] = ()
    choices: tuple[tuple[str, str], ...] = ()

    @classmethod
    def of(cls, rates_deg_s: Iterable[float] = (), choices: Iterable[tuple[str, str]] = ()) -> Self:
        """Return that of these rates, each as often as it is visited, and choices."""
        rates = [rate + 0.0 for rate in rates_deg_s]
        levels = tuple((rate, rates.count(rate) / len(rates)) for rate in sorted(set(rates), reverse=True))
        return cls(levels, tuple(choices))

    @property
    def levels_words(self) -> str:
        """The levels in words: ``17 rates, 200 to -200 deg/s``, or all of a few."""
        rates = [f"{rate:g}" for rate, _ in self.levels_deg_s]
        said = ", ".join(rates) if len(rates) <= 5 else f"{len(rates)} rates, {rates[0]} to {rates[-1]}"
        return f"{said} deg/s"

    def unlike(self, other: "Definition") -> str:
        """Say in what another differs: ``match rate: 10 and 20``; nothing where it is the same."""
        mine, yours = dict(self.choices), dict(other.choices)
        said = [
            f"{name.replace('_', ' ')}: {mine.get(name, 'none')} and {yours.get(name, 'none')}"
            for name in dict.fromkeys([*mine, *yours])
            if mine.get(name) != yours.get(name)
        ]
        if not alike(self.levels_deg_s, other.levels_deg_s):
            said.append(f"rates: {self.levels_words} and {other.levels_words}")
        return "; ".join(said)


class Conditions(Struct, frozen=True):
    """Conditions under which a value holds; None where nobody told."""

    rails_v: tuple[float, float] | None = None
    """Positive and negative rail."""
    temperature_c: float | None = None

    @property
    def words(self) -> str:
        """What is told of them: ``23.5 degC, rails +10, -10 V``."""
        said = [] if self.temperature_c is None else [f"{self.temperature_c:g} degC"]
        said += [] if self.rails_v is None else ["rails " + ", ".join(f"{each:+g}" for each in self.rails_v) + " V"]
        return ", ".join(said)


def alike(first: tuple[tuple[float, float], ...], second: tuple[tuple[float, float], ...]) -> bool:
    """Tell whether levels, each with its share, are the same."""
    pairs = zip(first, second, strict=False)
    return len(first) == len(second) and all(
        math.isclose(a, b, rel_tol=WITHIN, abs_tol=WITHIN_DEG_S) and math.isclose(of_a, of_b, rel_tol=WITHIN)
        for (a, of_a), (b, of_b) in pairs
    )
