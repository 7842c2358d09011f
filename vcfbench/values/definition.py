"""Definition of a value: the settings that must agree before two values are compared, and the conditions of both."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any, Final, Self

from msgspec import Struct, structs

from vcfbench.values.kinds import in_words

WITHIN: Final = 1e-3
"""Rates that differ by less, relative, are the same; and those by less than `WITHIN_DEG_S`."""
WITHIN_DEG_S: Final = 0.01


class Definition(Struct, frozen=True):
    """Settings that define a value, in addition to its kind: values with different ones are different measurands.

    `levels_deg_s` are the rates of a line, falling, each with its weight in windows, the least that are in proportion.
    `choices` are settings of the procedure that define the value, by name, as they are printed.
    """

    levels_deg_s: tuple[tuple[float, int], ...] = ()
    choices: tuple[tuple[str, str], ...] = ()

    @classmethod
    def of(cls, rates_deg_s: Iterable[float] = (), choices: Mapping[str, str] = MappingProxyType({})) -> Self:
        """Return that of these rates, each as often as it is visited, and choices."""
        visits = Counter(rate + 0.0 for rate in rates_deg_s)
        least = math.gcd(*visits.values()) if visits else 1
        levels = tuple((rate, visits[rate] // least) for rate in sorted(visits, reverse=True))
        return cls(levels, tuple(choices.items()))

    @property
    def levels_words(self) -> str:
        """The levels in words: ``17 rates, 200 to -200 deg/s``, or all of a few; nothing where there are none."""
        if not self.levels_deg_s:
            return ""
        rates = [f"{rate:g}" for rate, _ in self.levels_deg_s]
        said = ", ".join(rates) if len(rates) <= 5 else f"{len(rates)} rates, {rates[0]} to {rates[-1]}"
        return f"{said} deg/s"

    @property
    def words(self) -> str:
        """Return the definition in words: ``over 50, 0, -50 deg/s; earth: bias``."""
        over = [f"over {self.levels_words}"] if self.levels_deg_s else []
        return "; ".join(
            [*over, *(f"{in_words(name)[0]}: {printed} {in_words(name)[1]}".rstrip() for name, printed in self.choices)]
        )

    def as_json(self) -> dict[str, list[list[Any]]]:
        """Return it as lists of pairs."""
        return {"levels_deg_s": [[*each] for each in self.levels_deg_s], "choices": [[*each] for each in self.choices]}

    def unlike(self, other: "Definition") -> str:
        """Return the settings in which another differs: ``match rate: 10 and 20``; empty if there are none."""
        mine, yours = dict(self.choices), dict(other.choices)
        said = [
            f"{in_words(name)[0]}: {mine.get(name, 'none')} and {yours.get(name, 'none')} {in_words(name)[1]}".rstrip()
            for name in dict.fromkeys([*mine, *yours])
            if mine.get(name) != yours.get(name)
        ]
        if not alike(self.levels_deg_s, other.levels_deg_s):
            said.append(f"rates: {self.levels_words or 'none'} and {other.levels_words or 'none'}")
        return "; ".join(said)


class Drive(Struct, frozen=True):
    """Frequency of the drive during a run, Hz, and the temperature of the device by it.

    `moved_k` is how far that moved from the first record to the last, None where there is no first one of a warm
    device; `temperature_c` is that of the device where its own coefficient is known, else it is `assumed` for moves.
    """

    frequency_hz: float
    u_hz: float
    moved_k: float | None = None
    u_moved_k: float | None = None
    temperature_c: float | None = None
    u_temperature_k: float | None = None
    assumed: str = ""

    @property
    def words(self) -> str:
        """Return ``drive 3488.93 Hz; during the run the device warmed by 1.1 K (U95 0.5 K)``."""
        said = f"drive {self.frequency_hz:.2f} Hz"
        if self.moved_k is None:
            return said
        by = f", by {self.assumed}" if self.assumed else ""
        u95_k = 2.0 * (self.u_moved_k or 0.0)
        moved = f"{'cooled' if self.moved_k < 0.0 else 'warmed'} by {abs(self.moved_k):.1f} K (U95 {u95_k:.1f} K{by})"
        if abs(self.moved_k) <= u95_k:
            moved = f"changed its temperature by less than {abs(self.moved_k) + u95_k:.1f} K (95 %{by})"
        return f"{said}; during the run the device {moved}"


class Conditions(Struct, frozen=True):
    """Conditions under which a value holds; None if not given."""

    rails_v: tuple[float, float] | None = None
    """Positive and negative rail."""
    temperature_c: float | None = None
    drive: Drive | None = None

    def as_json(self) -> dict[str, Any]:
        """Return them by name."""
        drive = {} if self.drive is None else {"drive": structs.asdict(self.drive)}
        return {"rails_v": self.rails_v and [*self.rails_v], "temperature_c": self.temperature_c, **drive}

    @property
    def words(self) -> str:
        """Return the conditions in words: ``23.5 degC, rails +10, -10 V``."""
        said = ["a temperature that was not stated" if self.temperature_c is None else f"{self.temperature_c:.4g} degC"]
        if self.drive is not None and self.temperature_c is not None and self.temperature_c == self.drive.temperature_c:
            said = [f"{said[0]} (U95 {2.0 * (self.drive.u_temperature_k or 0.0):.1f} K, by the drive's frequency)"]
        if rails_v := [f"{each:+g}" for each in self.rails_v or () if each]:  # one supply has no negative rail
            said.append(f"rail{'s' * (len(rails_v) > 1)} {', '.join(rails_v)} V")
        return ", ".join(said) + ("" if self.drive is None else f"; {self.drive.words}")


def alike(first: tuple[tuple[float, int], ...], second: tuple[tuple[float, int], ...]) -> bool:
    """Return True if levels, each with its weight, are the same."""
    pairs = zip(first, second, strict=False)
    return len(first) == len(second) and all(
        math.isclose(a, b, rel_tol=WITHIN, abs_tol=WITHIN_DEG_S) and of_a == of_b for (a, of_a), (b, of_b) in pairs
    )
