"""Whether results pass: each limit of ``[acceptance]`` against its result."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from vcfbench.procedures.results import pooled_std_v

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from vcfbench.procedures.settings import Limit
    from vcfbench.record.schema import Point

__all__ = ["Acceptance", "Verdict", "judged"]


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


def judged(limits: Sequence[Limit], results: Mapping[str, Any], points: Sequence[Point]) -> Acceptance | None:
    """Judge `results` (as a procedure gives them) and the noise of `points`; None when no limit is for this procedure.

    Scale factor, bias and non-linearity are those of the column measured on the table.
    """
    values = _values(results, points)
    verdicts = tuple(
        Verdict(limit.key, values.get(limit.key), limit.low, limit.high, limit.key in values) for limit in limits
    )
    return Acceptance(verdicts) if any(verdict.measured for verdict in verdicts) else None


def _values(results: Mapping[str, Any], points: Sequence[Point]) -> dict[str, float | None]:
    """Return the results by the keys of the bench file."""
    column = results.get("turntable", results)
    scale_factor, bias_v = column["scale_factor"]["value"], column["bias"]["value"]
    values = {
        "scale_factor_v_per_deg_s": scale_factor,
        "bias_v": bias_v,
        "bias_deg_s": bias_v / scale_factor if scale_factor else None,
        "nonlinearity_ppm": column["nonlinearity_ppm"]["max_span"],
        "reading_noise_v": pooled_std_v(points),
    }
    if "k_vc" in results:
        values["k_vc_deg_s_per_v"] = results["k_vc"]["value"]
        values["scale_factor_error_percent"] = results["scale_factor_error_percent"]
    return values
