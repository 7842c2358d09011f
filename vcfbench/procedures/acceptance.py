"""Whether results pass: each limit of ``[acceptance]`` against its result."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from vcfbench.procedures.results import pooled_std_v
from vcfbench.record.plain import plain

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from vcfbench.bench.settings import Limit
    from vcfbench.record.schema import Point

__all__ = ["Acceptance", "HasAcceptanceValues", "Verdict", "judged"]


@dataclass(frozen=True, slots=True)
class Verdict:
    """One limit and its result; `value` is None where the result could not be computed, which does not pass.

    `measured` tells whether the procedure measures this at all: a limit of K_Vc says nothing of a turntable run.
    """

    key: str
    value: float | None
    low: float
    high: float
    measured: bool = True

    @property
    def word(self) -> str:
        """Return ``pass``, ``fail``, or ``not measured``."""
        if not self.measured:
            return "not measured"
        return "pass" if self.value is not None and self.low <= self.value <= self.high else "fail"

    def as_json(self) -> dict[str, Any]:
        """Return limit, value and verdict."""
        return {"key": self.key, "value": self.value, "low": self.low, "high": self.high, "verdict": self.word}


@dataclass(frozen=True, slots=True)
class Acceptance:
    """The verdict on a run: it passes when nothing fails and something was judged."""

    limits: tuple[Verdict, ...]

    @property
    def passed(self) -> bool:
        """Tell whether no limit failed."""
        return all(limit.word != "fail" for limit in self.limits)

    def as_json(self) -> dict[str, Any]:
        """Return the verdict and each limit's."""
        return {"verdict": "pass" if self.passed else "fail", "limits": [limit.as_json() for limit in self.limits]}


@runtime_checkable
class HasAcceptanceValues(Protocol):
    """A result that says itself what ``[acceptance]`` limits."""

    def acceptance_values(self) -> Mapping[str, float | None]:
        """Return its numbers by the keys of ``[acceptance]``; None where one could not be computed."""
        ...


def judged(limits: Sequence[Limit], results: object, points: Sequence[Point]) -> Acceptance | None:
    """Judge `results` (as a procedure gives them) and the noise of `points`; None when no limit is for this procedure.

    Results with `acceptance_values` are judged by those; of any others the numbers whose names are limits.
    """
    if not limits:
        return None
    values = dict(_values(results))
    if any(point.n > 1 for point in points):
        values["reading_noise_v"] = pooled_std_v(points)
    verdicts = tuple(
        Verdict(limit.key, values.get(limit.key), limit.low, limit.high, limit.key in values) for limit in limits
    )
    return Acceptance(verdicts) if any(verdict.measured for verdict in verdicts) else None


def _values(results: object) -> Mapping[str, float | None]:
    if isinstance(results, HasAcceptanceValues):
        return results.acceptance_values()
    flat = plain(results)
    named = flat.items() if isinstance(flat, dict) else ()
    return {name: value for name, value in named if value is None or isinstance(value, int | float)}
