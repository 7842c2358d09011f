"""Earlier entries of a device: the contributions to its curve, and the drift of a scale factor since.

The certificate is what a drift is counted from. A step is seen against it and against the last entry, a creep that each
run hides in its noise by the cumulative sum over all entries.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.control_chart import cusum, recursive_residuals
from vcfbench.devices.device import KnownDevice, KnownDeviceSettings, Reference
from vcfbench.instructions.v_vc import v_vc_error
from vcfbench.records.device_values import Characteristics, Measured
from vcfbench.records.stated import NOT_CONTAINED
from vcfbench.reports.document import Text
from vcfbench.station.acceptance import Acceptance, Verdict, judged
from vcfbench.station.settings import Limit
from vcfbench.uncertainty.measurand import measurand
from vcfbench.values.kinds import KINDS
from vcfbench.values.printing import incomplete
from vcfbench.values.value import Measurand, UncertaintyPart, Value
from vcfbench.values.verdict import e_n


class Change(Struct, frozen=True):
    """Change of the scale factor since one earlier entry."""

    since: str
    """Which entry, and when."""
    change_ppm: Measurand
    """Change relative to the earlier one; common errors have cancelled."""
    cancelled: tuple[str, ...]
    """Errors common to both."""
    e_n: float
    """Change over its expanded uncertainty: above 1 it is seen."""


class Here(Struct, frozen=True):
    """Conditions of a run in a comparison with earlier ones, and the limit of an unmeasured coefficient."""

    temperature_c: float | None = None
    rails_v: tuple[float, float] | None = None
    limit_ppm_k: float = 0.0

    @classmethod
    def of(cls, settings: KnownDeviceSettings) -> "Here":
        """Return those of a run with these settings."""
        limit_ppm_k = settings.station.sources.scale_factor_ppm_k
        return cls(settings.temperature_c, settings.rails_v, limit_ppm_k or 0.0)


class Moved(NamedTuple):
    """Effect of other conditions on a scale factor, ppm, the parts of its uncertainty, and words for each."""

    ppm: float
    parts: tuple[UncertaintyPart, UncertaintyPart]
    words: tuple[str, ...]


class Drift(Change, frozen=True):
    """Change of the scale factor since the certificate, and its drift over the entries since then."""

    last: Change | None
    """Since the entry before; None where that is the certificate."""
    cusum: float
    """Creep over all entries by the certificate: tabular CUSUM in standard uncertainties, each of its own entry."""
    failed_before: tuple[str, ...]
    """Entries by this certificate whose drift failed twice in a row: so it stays until it has a new certificate."""
    verdict: Literal["pass", "marginal", "fail"]
    limits: tuple[Verdict, ...]
    """Limits of its verdict."""

    def stated(self) -> Iterator[Value]:
        """Yield the change, and its quantities with limits; an E_n is by the U95 of the change."""
        missing = self.change_ppm.missing
        yield self.change_ppm.called("drift_ppm")
        yield Value("e_n", self.e_n, kind="e_n", missing=missing)
        if self.last is not None:
            yield Value("e_n_since_last", self.last.e_n, kind="e_n_since_last", missing=missing)
        yield Value("cusum", self.cusum, kind="cusum")
        yield Value("failed_before", float(len(self.failed_before)), kind="failed_before")


def curve_parts(settings: KnownDeviceSettings) -> tuple[list[tuple[str, Floats, float | None, str]], bool]:
    """Return the contributions to the covariance of K_Vc's curve: source, covariance, degrees of freedom, its owner.

    And whether V_Vc is measured by the meter of the certificate: then its volts are those of the certificate, its
    errors are in the curve already, and they are none of the contributions.
    """
    curve, source, by = settings.known.k_vc, settings.known.source, v_vc_error(settings).owner
    shares = [(share.source, share.of, share.dof, np.array(share.covariance)) for share in curve.shares]
    shares = shares or [("its covariance", None, None, np.array(curve.covariance))]
    same_meter = settings.v_vc_role is not None and any(of == by for _, of, _, _ in shares)
    found = [
        (f"certificate: {name}", covariance, dof, of or f"{source}: {name}")
        for name, of, dof, covariance in shares
        if not (same_meter and of == by)
    ]
    return found, same_meter


def drift_of(
    scale_factor: Measurand,
    known: KnownDevice,
    limits: Sequence[Limit],
    here: Here = Here(),  # noqa: B008  # frozen
) -> Drift | None:
    """Return how far `scale_factor` is from that of the certificate, and how the entries since then went.

    None where nothing earlier is known. Parts of the same owner cancel. What other conditions did, `here` and then, is
    taken off by the device's coefficients. It is judged by those of `limits` that are its.
    """
    if known.reference is None:
        return None
    first = _change(scale_factor, known.reference, known, here)
    last = _change(scale_factor, known.history[-1], known, here) if known.history else None
    earlier = (known.reference, *known.history)
    base = known.reference.scale_factor_v_per_deg_s.value
    now = [each.scale_factor_v_per_deg_s.value for each in earlier] + [scale_factor.value]
    # The covariance of the entries by their parts: those of the same owner are one
    keys: dict[str, int] = {}
    placed = [
        (row, keys.setdefault(_key(part) if part.of is not None else f"{row}, {number}", len(keys)), part.u)
        for row, parts in enumerate([*map(_relative_kept, earlier), _relative(scale_factor)])
        for number, part in enumerate(parts)
    ]
    by_source = np.zeros((len(now), len(keys)))
    for row, column, u in placed:
        by_source[row, column] += u
    moved = [_moved(each, known, here) for each in earlier]
    by_conditions = np.array([*([part.u for part in of.parts] for of in moved), [0.0, 0.0]])
    covariance = by_source @ by_source.T + by_conditions @ by_conditions.T
    as_here = 1e6 * (np.array(now) / base - 1.0) + np.array([*(of.ppm for of in moved), 0.0])
    residuals = recursive_residuals(as_here, covariance)
    summed = float(cusum(residuals)[-1])
    seen = first.since, first.change_ppm, first.cancelled, first.e_n, last, summed, known.failed_before
    found = Drift(*seen, "pass", ())
    keys_of_own = {KINDS[each.kind].limit for each in found.stated()}
    own = judged([limit for limit in limits if limit.key in keys_of_own], found, ())
    return found if own is None else replace(found, verdict=own.word, limits=own.limits)


def _moved(then: Reference, known: KnownDevice, here: Here) -> Moved:
    """Return the effect of other conditions on the scale factor since an earlier entry."""
    of = known.characteristics or Characteristics()
    then_c, here_c = then.temperature_c, here.temperature_c
    warmer_k = 0.0 if then_c is None or here_c is None else here_c - then_c
    slope = of.table_slope_ppm_k or Measured(value=0.0, u=here.limit_ppm_k / math.sqrt(3.0))
    wider_v, per_v = 0.0, of.table_slope_ppm_v
    if then.rails_v is not None and here.rails_v is not None and per_v is not None:
        wider_v = 0.5 * (here.rails_v[0] - then.rails_v[0] + then.rails_v[1] - here.rails_v[1])
    per_v = per_v or Measured(value=0.0, u=0.0)
    parts = (
        UncertaintyPart("temperature coefficient", slope.u * warmer_k),
        UncertaintyPart("coefficient of the rails", per_v.u * wider_v),
    )
    unknown = ", and no temperature coefficient of the device is known" if of.table_slope_ppm_k is None else ""
    words = [f"{warmer_k:+.4g} K: {slope.value * warmer_k:+.0f} ppm{unknown}"] if warmer_k else []
    words += [f"{wider_v:+.4g} V of both rails: {per_v.value * wider_v:+.0f} ppm"] if wider_v else []
    return Moved(slope.value * warmer_k + per_v.value * wider_v, parts, tuple(words))


def _change(scale_factor: Measurand, reference: Reference, known: KnownDevice, here: Here) -> Change:
    """Return the amount by which `scale_factor` is from that of an earlier entry, other conditions taken off."""
    moved = _moved(reference, known, here)
    change = 1e6 * (scale_factor.value / reference.scale_factor_v_per_deg_s.value - 1.0) - moved.ppm
    owners: dict[str, list[UncertaintyPart]] = {}
    parts: list[UncertaintyPart] = []
    for part in _relative_kept(reference):
        (parts if part.of is None else owners.setdefault(_key(part), [])).append(part)
    cancelled = []
    for part in _relative(scale_factor):
        same = owners.pop(_key(part), None) if part.of is not None else None
        if same is None:
            parts.append(part)
            continue
        parts.append(replace(part, u=part.u - math.fsum(each.u for each in same), dof=None))
        cancelled.append(f"{part.source} ({part.of})")
    parts += [part for left in owners.values() for part in left]
    parts += [part for part in moved.parts if part.u]
    missing = (*reference.scale_factor_v_per_deg_s.missing, *scale_factor.missing)
    found = measurand(change, "ppm", parts, missing)
    since = f"{reference.kind} {reference.name} of {reference.done[:10]}"
    since += f" (corrected for {'; '.join(moved.words)})" if moved.words else ""
    return Change(since, found, tuple(cancelled), e_n(0.0, 0.0, change, found.u95))


def _relative(found: Measurand) -> list[UncertaintyPart]:
    size = abs(found.value)
    return [replace(part, u=1e6 * part.u / size) for part in found.parts]


def _relative_kept(reference: Reference) -> list[UncertaintyPart]:
    kept: Measured = reference.scale_factor_v_per_deg_s
    size = abs(kept.value)
    if not kept.shares:
        return [UncertaintyPart("the earlier entry", 1e6 * kept.u / size, kept.dof)]
    # those of a certificate's own are in every result by its curve
    own = f"certificate {reference.name}: " if reference.kind == "certificate" else ""
    return [
        UncertaintyPart(
            *(f"then: {share.source}", 1e6 * share.u / size, share.dof),
            f"{own}{share.source}" if own and share.of is None else share.of,
        )
        for share in kept.shares
    ]


def _key(part: UncertaintyPart) -> str:
    """Return the identity of a part: the owner, and its gain or offset."""
    return f"{part.of}: {part.source.rsplit(': ', maxsplit=1)[-1]}"


def drift_parts(drift: Drift | None) -> list[Any]:
    """Return the report of the drift since the certificate, and of the entries since then."""
    if drift is None:
        return [Text("drift: the device has no earlier entry")]
    words = []
    for name, change in (("drift", drift), ("and", drift.last)):
        if change is not None:
            found = change.change_ppm
            value = f"{found.value:+.1f} ppm, u {found.u:.2g}, U95 {found.u95:.2g}{incomplete(found.missing)}"
            words.append(f"{name} since {change.since}: {value}; E_n {change.e_n:.2f}")
            words += [f"  cancels: {each}" for each in change.cancelled]
    judged_by = ", ".join(
        f"{each.key} {each.low:g} to {each.high:g}"
        + ("" if each.u95 is None else ", guard band U95")
        + ("" if each.word == "pass" else f": {each.word}")
        for each in drift.limits
    )
    words.append(f"creep (CUSUM, k 0.5): {drift.cusum:.1f} standard uncertainties")
    words.append(f"drift: {Acceptance(drift.limits).said} ({judged_by})")
    if drift.verdict != "fail" and drift.e_n > 1.0:
        words.append("  beyond its U95, as by chance once in 20 runs: repeat the run")
    if drift.verdict == "fail" and not drift.failed_before:
        words.append("  repeat the run: it does not use this result; a second failure is kept")
    if drift.failed_before:
        words.append(
            f"  the drift failed in {', '.join(drift.failed_before)}: the device stays failed, whatever later runs "
            "find, until a rate table gives it a new certificate (vcfbench run kvc)"
        )
    return [Text("\n".join(words))]


def lists_of_omissions(holds_not: Sequence[str], unseen: Sequence[str]) -> list[Text]:
    """Return as texts the sources in no uncertainty, and the errors that the method cannot see, if any."""
    named = {NOT_CONTAINED: holds_not, "changes that only a rate table shows:": unseen}
    return [Text("\n  ".join([name, *lines])) for name, lines in named.items() if lines]
