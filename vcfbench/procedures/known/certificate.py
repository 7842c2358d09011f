"""What an earlier entry of a device tells: what its curve is made of, and how far a scale factor has drifted."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from vcfbench.analysis.conformity import conformity, e_n
from vcfbench.procedures.measurand import Measurand, UncertaintyPart, measurand
from vcfbench.report.digits import incomplete
from vcfbench.report.document import Text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from vcfbench.procedures.known.device import Reference
    from vcfbench.record.devices import KvcCurve, Measured, Share

__all__ = ["Drift", "drift_of", "drift_parts", "shares_of"]

Floats: TypeAlias = "NDArray[np.float64]"


@dataclass(frozen=True, slots=True)
class Drift:
    """How far the scale factor is from that of an earlier entry."""

    since: str
    """Which entry, and when."""
    change_ppm: Measurand
    """Of the earlier one; what both share has cancelled."""
    cancelled: tuple[str, ...]
    """What both share."""
    e_n: float
    """Change over its expanded uncertainty: above 1 the scale factor has changed."""
    limit_ppm: float | None
    verdict: str
    """``pass``, ``marginal`` or ``fail``: by the limit with the expanded uncertainty as guard band, or by E_n."""


def shares_of(curve: KvcCurve) -> list[tuple[str, str | None, float | None, Floats]]:
    """Return what the covariance of a curve is made of: source, whose it is, degrees of freedom, its covariance."""
    if not curve.shares:
        return [("its covariance", None, None, np.array(curve.covariance))]
    return [(share.source, share.of, share.dof, np.array(share.covariance)) for share in curve.shares]


def drift_of(scale_factor: Measurand, reference: Reference, limit_ppm: float | None) -> Drift:
    """Return how far `scale_factor` is from that of an earlier entry; parts of the same owner cancel."""
    earlier = reference.scale_factor_v_per_deg_s
    change = 1e6 * (scale_factor.value / earlier.value - 1.0)
    now, then = _relative(scale_factor), _relative_kept(reference)
    parts, cancelled = _difference(now, then)
    found = measurand(change, "ppm", parts, (*earlier.missing, *scale_factor.missing))
    if limit_ppm is None:
        verdict = "pass" if abs(change) <= found.expanded_u else "fail"
    else:
        verdict = conformity(change, found.expanded_u, -limit_ppm, limit_ppm).value
    since = f"{reference.kind} {reference.name} of {reference.done[:10]}"
    return Drift(since, found, cancelled, e_n(0.0, 0.0, change, found.expanded_u), limit_ppm, verdict)


def _relative(found: Measurand) -> list[UncertaintyPart]:
    size = abs(found.value)
    return [UncertaintyPart(part.source, 1e6 * part.u / size, part.dof, part.of) for part in found.parts]


def _relative_kept(reference: Reference) -> list[UncertaintyPart]:
    kept: Measured = reference.scale_factor_v_per_deg_s
    size = abs(kept.value)
    if not kept.shares:
        return [UncertaintyPart("the earlier entry", 1e6 * kept.u / size, kept.dof)]
    return [
        UncertaintyPart(f"then: {share.source}", 1e6 * share.u / size, share.dof, _owner(reference, share))
        for share in kept.shares
    ]


def _owner(reference: Reference, share: Share) -> str | None:
    """Return whose a part is; those of a certificate's own are in every result by its curve."""
    if share.of is None and reference.kind == "certificate":
        return f"certificate {reference.name}: {share.source}"
    return share.of


def _difference(
    now: Sequence[UncertaintyPart], then: Sequence[UncertaintyPart]
) -> tuple[list[UncertaintyPart], tuple[str, ...]]:
    """Return the parts of the difference, and what of them has cancelled."""
    owners: dict[str, list[UncertaintyPart]] = {}
    for part in then:
        if part.of is not None:
            owners.setdefault(_key(part), []).append(part)
    left: list[UncertaintyPart] = [part for part in then if part.of is None]
    cancelled = []
    for part in now:
        same = owners.pop(_key(part), None) if part.of is not None else None
        if same is None:
            left.append(part)
            continue
        left.append(UncertaintyPart(part.source, part.u - math.fsum(each.u for each in same), None, part.of))
        cancelled.append(f"{part.source} ({part.of})")
    left += [part for parts in owners.values() for part in parts]
    return left, tuple(cancelled)


def _key(part: UncertaintyPart) -> str:
    """Return what two parts must share to be one: the owner, and gain or offset of it."""
    return f"{part.of}: {part.source.rsplit(': ', maxsplit=1)[-1]}"


def drift_parts(drift: Drift | None) -> list[Any]:
    """Return what is reported of the drift since an earlier entry."""
    if drift is None:
        return [Text("drift: nothing earlier is known of the device")]
    found = drift.change_ppm
    limit = "by E_n" if drift.limit_ppm is None else f"limit {drift.limit_ppm:g} ppm, guard band U95"
    change = f"{found.value:+.1f} ppm, u {found.u:.2g}, U95 {found.expanded_u:.2g}{incomplete(found.missing)}"
    words = [
        f"drift since {drift.since}: {change}; E_n {drift.e_n:.2f}: {drift.verdict.upper()} ({limit})",
        *(f"  cancels: {each}" for each in drift.cancelled),
    ]
    return [Text("\n".join(words))]
