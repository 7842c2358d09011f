"""Acceptance of results: each limit of ``[acceptance]`` against its result."""

from collections.abc import Sequence
from typing import Any, Final, Literal

from msgspec import Struct

from vcfbench.records.plain import plain
from vcfbench.records.schema import Point, pooled_std_v
from vcfbench.station.settings import Limit
from vcfbench.values.verdict import conformity

INCOMPLETE: Final = " with an incomplete U95"
"""Words behind a verdict whose guard band, or E_n, lacks a contribution: it may be another with all of them."""


class Verdict(Struct, frozen=True):
    """One limit and its result; `value` is None where the result could not be computed, which does not pass.

    `measured` is False where the procedure does not measure this at all, as K_Vc in a turntable run.
    `u95` is the guard band, the value's expanded uncertainty; None where there is none, or none of that value. It, or
    the U95 in an E_n, is incomplete without what is `missing`.
    """

    key: str
    value: float | None
    low: float
    high: float
    measured: bool = True
    u95: float | None = None
    missing: tuple[str, ...] = ()

    @property
    def word(self) -> str:
        """Return ``pass``, ``marginal``, ``fail``, or ``not measured``."""
        if not self.measured:
            return "not measured"
        if self.value is None:
            return "fail"
        return conformity(self.value, self.u95 or 0.0, self.low, self.high)

    def as_json(self) -> dict[str, Any]:
        """Return limit, value and verdict, and the guard band where there is one."""
        members = {"key": self.key, "value": self.value, "low": self.low, "high": self.high, "verdict": self.word}
        members |= {} if self.u95 is None else {"u95": self.u95}
        return members | ({"missing": list(self.missing)} if self.missing else {})

    @property
    def said(self) -> str:
        """Return the word for people, and whether the guard band is incomplete."""
        return self.word.upper() + (INCOMPLETE if self.missing else "")


class Acceptance(Struct, frozen=True):
    """The verdict on a run: it passes when nothing fails and something was judged."""

    limits: tuple[Verdict, ...]

    @property
    def passed(self) -> bool:
        """Tell whether no limit failed, and none is marginal."""
        return self.word == "pass"

    @property
    def word(self) -> Literal["pass", "marginal", "fail"]:
        """Return ``fail`` when a limit failed, else ``marginal`` when one is, else ``pass``."""
        words = {limit.word for limit in self.limits}
        return "fail" if "fail" in words else "marginal" if "marginal" in words else "pass"

    @property
    def said(self) -> str:
        """Return the word for people, and what guard bands lack."""
        missing = dict.fromkeys(name for limit in self.limits for name in limit.missing)
        return self.word.upper() + (f"{INCOMPLETE}, without {', '.join(missing)}" if missing else "")

    def as_json(self) -> dict[str, Any]:
        """Return the verdict and each limit's."""
        return {"verdict": self.word, "limits": [limit.as_json() for limit in self.limits]}


def judged(limits: Sequence[Limit], results: object, points: Sequence[Point]) -> Acceptance | None:
    """Judge `results` (as a procedure gives them) and the noise of `points`; None when no limit is for this procedure.

    Results with `acceptance_values` are judged by those (by the keys of ``[acceptance]``; None where one could not be
    computed), of any others the numbers whose names are limits; with `acceptance_u95` by expanded uncertainties, too,
    and `acceptance_missing` says what those lack.
    """
    if not limits:
        return None
    values: dict[str, float | None]
    if hasattr(results, "acceptance_values"):
        values = dict(results.acceptance_values())
    else:
        flat = plain(results)
        named = flat.items() if isinstance(flat, dict) else ()
        values = {name: value for name, value in named if value is None or isinstance(value, int | float)}
    if any(point.n > 1 for point in points):
        values["reading_noise_v"] = pooled_std_v(points)
    guards: dict[str, float] = getattr(results, "acceptance_u95", dict)()
    missing: dict[str, tuple[str, ...]] = getattr(results, "acceptance_missing", dict)()
    verdicts = tuple(
        Verdict(
            *(limit.key, values.get(limit.key), limit.low, limit.high),
            measured=limit.key in values,
            u95=guards.get(limit.key) if limit.guarded else None,
            missing=missing.get(limit.key, ()) if limit.guarded or limit.key not in guards else (),
        )
        for limit in limits
    )
    return Acceptance(verdicts) if any(verdict.measured for verdict in verdicts) else None
